"""What a benchmark found, in sentences.

Everything is made of the rows alone. Sentences count and compare what the rows say; none is there
for its result. One time is less than another only where noise does not explain it
(`pareto.clearly_less`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from .pareto import clearly_less, front, tied
from .run import KINDS, Row
from .words import BUILT_IN, COSTS, ERRORS, error_text, listed, span

__all__ = ["STEADY", "caution", "classes", "drift", "verdicts"]

STEADY = 1.5
"""Times the built-in's shortest time that its longest may take on a quiet machine."""


def verdicts(rows: Sequence[Row]) -> str:
    """What the numbers say, as a list in Markdown."""
    closed = [row for row in rows if row["form"] == "closed form"]
    said = [caution(rows), _noise(rows)]
    for about in (_against_built_in, _by_terms, _exact, _f82, _tables, _nowhere):
        said += about(rows, closed)
    tables = [row for row in rows if row["form"] == "table"]
    missing = [r["model"] for r in rows if r["form"] != "table" and not r["in_plugin"]]
    missing += [f"all {len(tables)} tables"] if tables else []
    if missing:
        said.append(
            f"**Not in the plugin**, so without times of a BSDF and a picture: {listed(missing)}."
        )
    return "\n".join(f"- {text}" for text in said if text)


def classes(
    rows: Sequence[Row], than: Row | Callable[[Row], Row | None], cost: str
) -> tuple[list[Row], list[Row], list[Row]]:
    """Rows that cost less than another, no different, and more; those without a time in none."""
    less: list[Row] = []
    same: list[Row] = []
    more: list[Row] = []
    for row in rows:
        other = than(row) if callable(than) else than
        if other is None or row.get(cost) is None or other.get(cost) is None:
            continue
        if clearly_less(row, other, cost):
            less.append(row)
        elif clearly_less(other, row, cost):
            more.append(row)
        else:
            same.append(row)
    return less, same, more


def drift(rows: Sequence[Row]) -> dict[str, float]:
    """The built-in's slowest time over its fastest, by kind, over the groups of the run."""
    found = {}
    for kind in KINDS:
        column = f"{kind}_built_in_ns"
        times = [row[column] for row in rows if row.get(column) is not None]
        if times:
            found[kind] = max(times) / min(times)
    return found


def caution(rows: Sequence[Row]) -> str:
    """A paragraph where the machine was not quiet, else nothing."""
    worst = max(drift(rows).values(), default=1.0)
    if worst <= STEADY:
        return ""
    return (
        "**The machine was not quiet**: in this run the built-in itself took up to "
        f"{worst:.1f} times its shortest time. Short and long kernels suffer differently, so "
        "ratios of times are biased, most for the fastest models. Errors, bytes and operations "
        "are not affected."
    )


def _noise(rows: Sequence[Row]) -> str:
    """Who might stand on the staircase of RMSE if it were measured again."""
    parts = []
    for cost in COSTS:
        if cost.endswith("_ratio") and any(row.get(cost) is not None for row in rows):
            names = [row["model"] for row in tied(rows, cost, "d_rmse", integrates=True)]
            few = f"{COSTS[cost]}: {len(names)}"
            parts.append(few + (f" ({listed(names)})" if 0 < len(names) <= 4 else ""))
    if not parts:
        return ""
    return (
        "**Noise.** So many models beside the staircase of RMSE are tied with it, for nothing as "
        f"accurate takes clearly less time: {'; '.join(parts)}."
    )


def _against_built_in(rows: Sequence[Row], closed: Sequence[Row]) -> list[str]:
    built_in = _named(rows, BUILT_IN)
    if built_in is None or not closed:
        return []
    parts = []
    for kind, name in KINDS.items():
        less, same, more = classes(closed, built_in, f"{kind}_ratio")
        if less or same or more:
            text = f"{name} {len(less)} / {len(same)} / {len(more)}"
            if 0 < len(more) <= 6:
                text += f" (more: {listed([row['model'] for row in more])})"
            parts.append(f"{text}, ratios {span(row.get(f'{kind}_ratio') for row in closed)}")
    said = []
    if parts:
        said.append(
            f"**Time of the {len(closed)} closed forms against the exact built-in**, less / no "
            "different / more: " + ";\n  ".join(parts) + "."
        )
    counts = []
    for error, name in ERRORS.items():
        known = [row for row in closed if row.get(error) is not None]
        if known and built_in.get(error) is not None:
            nearer = sum(row[error] < built_in[error] for row in known)
            counts.append(f"{name}, {nearer} of {len(known)}")
    if counts:
        said.append(
            f"**Closed forms more accurate than the built-in**: {'; '.join(counts)}. For colour "
            "the built-in has one index per channel, closed forms the integrated spectrum."
        )
    return said


def _by_terms(rows: Sequence[Row], closed: Sequence[Row]) -> list[str]:
    said = []
    for terms in sorted({row["terms"] for row in closed}):
        same = [row for row in closed if row["terms"] == terms]
        least = [
            f"{name.partition(',')[0]} {_least(same, error)}"
            for error, name in ERRORS.items()
            if error.startswith("d") and any(row.get(error) is not None for row in same)
        ]
        said.append(
            f"**{terms} terms, closed form:** RGB {_span(same, 'compute_ratio')} of the built-in "
            f"compute-bound and {_span(same, 'streaming_ratio')} streaming, "
            f"{_span(same, 'bsdf_ratio')} of the BSDF, {_span(same, 'render_ratio')} of a "
            f"picture; on measured materials the least are: {', '.join(least)}."
        )
    return said


def _exact(rows: Sequence[Row], closed: Sequence[Row]) -> list[str]:
    parts = []
    for name in ("exact, native", "exact, wide"):
        row = _named(rows, name)
        if row is not None and row.get("compute_ratio") is not None:
            parts.append(
                f"{name.partition(', ')[2]} {row['compute_ratio']:.2f} compute-bound and "
                f"{_span([row], 'streaming_ratio')} streaming"
            )
    return (
        [f"**Our exact equations**, of the built-in's time: {', '.join(parts)}."] if parts else []
    )


def _f82(rows: Sequence[Row], closed: Sequence[Row]) -> list[str]:
    f82 = _named(rows, "F82")
    if f82 is None or not closed or f82.get("compute_ratio") is None:
        return []
    less, same, _ = classes(closed, f82, "compute_ratio")
    both = [row["model"] for row in (*less, *same) if row["d_rmse"] <= f82["d_rmse"]]
    worse = [row["model"] for row in closed if row["d_rmse"] >= f82["d_rmse"]]
    operations = f" and {f82['operations']} operations" if f82.get("operations") else ""
    return [
        f"**F82** takes {f82['compute_ratio']:.2f} of the built-in compute-bound{operations}. Of "
        f"the {len(closed)} closed forms {len(less)} take less, {len(same)} are no different; no "
        f"dearer and at least as accurate: {listed(both) if both else 'none'}. Its RMSE on "
        "measured materials is "
        f"{error_text(f82['d_rmse'])}; "
        + (f"that of {listed(worse)} is no lower." if worse else "all of ours are lower.")
    ]


def _tables(rows: Sequence[Row], closed: Sequence[Row]) -> list[str]:
    tables = [row for row in rows if row["form"] == "table" and row.get("compute_ratio")]
    if not tables or not closed:
        return []
    by_name = {row["model"]: row for row in rows}

    def form(row: Row) -> Row | None:
        return by_name.get(f"{row['family']}, {row['terms']} terms")

    def wider(row: Row) -> Row | None:
        return by_name.get(row["model"].replace("float16", "float32"))

    less, same, more = classes(tables, form, "compute_ratio")
    fastest = min(tables, key=lambda row: row["compute_ratio"])
    text = (
        "**Tables** against the closed form of the same functions, compute-bound in RGB, less / "
        f"no different / more time: {len(less)} / {len(same)} / {len(more)}. The fastest, "
        f"{fastest['model']}, takes {fastest['compute_ratio']:.2f} of the built-in."
    )
    halves = [row for row in tables if row["storage"] == "float16"]
    less, same, more = classes(halves, wider, "compute_ratio")
    if less or same or more:
        text += (
            f" Half floats against float32: {len(less)} / {len(same)} / {len(more)}, at half the "
            "bytes."
        )
    return [text]


def _nowhere(rows: Sequence[Row], closed: Sequence[Row]) -> list[str]:
    if not closed:
        return []
    somewhere = {
        row["model"]
        for cost in COSTS
        for error in ERRORS
        for row in front(rows, cost, error, integrates=True)
    }
    nowhere = [row["model"] for row in closed if row["model"] not in somewhere]
    return [
        "**On no front** of any cost and any of these errors, even among models that can be "
        "integrated ahead of time: "
        + (f"of the {len(closed)} closed forms {listed(nowhere)}." if nowhere
           else f"none of the {len(closed)} closed forms.")
    ]  # fmt: skip


def _named(rows: Sequence[Row], name: str) -> Row | None:
    return next((row for row in rows if row["model"] == name), None)


def _span(rows: Sequence[Row], column: str) -> str:
    return span(row.get(column) for row in rows)


def _least(rows: Sequence[Row], error: str) -> str:
    known = [row for row in rows if row.get(error) is not None]
    best = min(known, key=lambda row: row[error])
    return f"{error_text(best[error])} ({best['family']})"

"""What a benchmark found, in words and tables, and as files.

Everything is made of the rows alone, so that a page can be checked against the file of numbers
beside it. Sentences count and compare what the rows say; none is there for its result.
"""

from __future__ import annotations

import csv
import io
import os
import statistics
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from .._files import write_json, write_text
from .._markdown import markdown_table
from .bench import KINDS, Bench, Row
from .pareto import pareto_front

__all__ = [
    "COSTS",
    "ERRORS",
    "LIMITS",
    "about_line",
    "budget_table",
    "caution",
    "cost_slack",
    "cost_table",
    "document",
    "drift",
    "error_table",
    "front",
    "read_csv",
    "recipe_table",
    "size_table",
    "to_csv",
    "verdicts",
    "write",
]

COSTS = {
    "compute_ratio": "compute-bound kernel",
    "streaming_ratio": "streaming kernel",
    "bsdf_ratio": "BSDF only",
    "render_ratio": "whole render",
    "bytes": "bytes",
    "operations": "operations",
}
"""Columns of costs, and what they are called."""

ERRORS = {
    "d_max": "largest error",
    "d_rmse": "RMSE",
    "d_albedo_mean": "mean error of the albedo",
    "delta_e_mean": "mean ΔE00",
}
"""Errors that fronts are drawn for; the first three on measured materials (set d)."""

NOT_IN_PLUGIN = "not in the plugin"

_BUDGETS = (0.25, 0.5, 0.75, 1.0, 1.5)
LIMITS = {
    "compute_ratio": _BUDGETS,
    "streaming_ratio": _BUDGETS,
    "bsdf_ratio": (0.6, 0.7, 0.8, 1.0),
}
LIMITS |= {"bytes": (16, 64, 128, 256, 1024), "operations": (10, 25, 50, 75, 100)}

BUILT_IN = "mi.fresnel_conductor"

STEADY = 1.5
"""Times the built-in's shortest time that its longest may take on a quiet machine."""


def cost_slack(rows: Sequence[Row], cost: str) -> float:
    """By how much measured times must differ to count: twice the median relative spread.

    None of it for bytes and operations, which are counted.
    """
    if not cost.endswith("_ratio"):
        return 0.0
    spread = cost.replace("_ratio", "_spread")
    relative = [
        row[spread] / row[cost] for row in rows if row[cost] is not None and row[spread] > 0.0
    ]
    return max(0.01, 2.0 * statistics.median(relative)) if relative else 0.01


def front(rows: Sequence[Row], cost: str, error: str, integrates: bool) -> list[Row]:
    """The models that nothing beats, from the cheapest to the most accurate.

    With `integrates` among those that can be integrated over rough surfaces ahead of time.
    """
    among = [
        row
        for row in rows
        if row[cost] is not None
        and row[error] is not None
        and (row["integrates"] or not integrates)
    ]
    errors = [float(f"{row[error]:.2g}") for row in among]  # to two digits: more is nothing gained
    places = pareto_front([row[cost] for row in among], errors, cost_slack(rows, cost))
    return [among[place] for place in places]


def about_line(about: dict[str, Any]) -> str:
    """On what, and how, the times were taken."""
    from ..machine import describe_machine

    backend = {"llvm": "CPU (LLVM)", "cuda": "GPU (CUDA)"}[about["backend"]]
    return (
        f"{backend}: {describe_machine(about)}. Medians of {about['rounds']} rounds ± half the "
        f"distance between quartiles, seed {about['seed']}."
    )


def recipe_table(rows: Sequence[Row]) -> str:
    """Times, operations and errors of all models but those in tables."""
    head = [
        "model", "kernel, RGB", "BSDF only", "operations", "a: largest / RMSE", "cp", "d", "low",
        "ΔE00, mean / largest",
    ]  # fmt: skip
    lines = []
    for row in _without_tables(rows):
        cells = [row["model"], _ratio(row, "compute"), _ratio(row, "bsdf", short=True)]
        cells += [str(row["operations"])]
        cells += [_pair(row, f"{name}_max", f"{name}_rmse") for name in ("a", "cp", "d", "low")]
        cells += [_pair(row, "delta_e_mean", "delta_e_max", 3)]
        lines.append(cells)
    return markdown_table(head, lines)


def cost_table(rows: Sequence[Row]) -> str:
    """All costs of all models but those in tables."""
    packets = any(row["packet_operations"] is not None for row in rows)
    head = ["model", *KINDS.values(), "bytes shared + a material", "operations"]
    head += ["with comparisons, selections, conversions"] if packets else []
    lines = []
    for row in _without_tables(rows):
        cells = [row["model"], *(_ratio(row, kind) for kind in KINDS)]
        cells += [f"{row['shared_bytes']} + {row['material_bytes']}", str(row["operations"])]
        cells += [str(row["packet_operations"])] if packets else []
        lines.append(cells)
    return markdown_table(head, lines)


def error_table(rows: Sequence[Row]) -> str:
    """What `recipe_table` leaves out: p99 and mean, and the albedo, of all models but tables."""
    head = ["model"]
    for name in ("a", "cp", "d", "low"):
        head += [f"{name}: p99 / mean", f"{name}, albedo: largest / p99 / mean / RMSE"]
    head += ["ΔE00, p99 / RMSE"]
    lines = []
    for row in _without_tables(rows):
        cells = [row["model"]]
        for name in ("a", "cp", "d", "low"):
            cells += [_pair(row, f"{name}_p99", f"{name}_mean")]
            albedo = [row[f"{name}_albedo_{error}"] for error in ("max", "p99", "mean", "rmse")]
            cells += ["–" if None in albedo else " / ".join(map(_short, albedo))]
        lines.append([*cells, _pair(row, "delta_e_p99", "delta_e_rmse", 3)])
    return markdown_table(head, lines)


def size_table(rows: Sequence[Row]) -> str:
    """Tables by terms, size and format: ranges over the recipes."""
    forms = {row["model"]: row for row in rows if row["form"] == "closed form"}
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        if row["form"] == "table":
            groups.setdefault((row["terms"], row["size"], row["storage"]), []).append(row)
    lines = []
    for (terms, size, storage), members in groups.items():
        added = []
        for row in members:
            form = forms.get(f"{row['family']}, {terms} terms")
            if form is not None:
                added.append(row["d_max"] / form["d_max"] - 1.0)
        cells = [f"{terms} terms, {size} samples, {storage}", str(members[0]["shared_bytes"])]
        for kind in ("compute", "streaming", "compute_one", "streaming_one"):
            cells.append(_range(row[f"{kind}_ratio"] for row in members))
        cells.append(f"{members[0]['operations']} + {members[0]['gathers']} loads")
        cells.append(_range((row["d_max"] for row in members), 4))
        cells.append(f"{100 * max(added):+.1f} %" if added else "–")
        lines.append(cells)
    head = [
        "table", "bytes", KINDS["compute"], KINDS["streaming"], KINDS["compute_one"],
        KINDS["streaming_one"], "operations", "d: largest error",
        "at most, against the closed form",
    ]  # fmt: skip
    return markdown_table(head, lines)


def budget_table(rows: Sequence[Row], cost: str) -> str:
    """For budgets of one kind, the models with the least errors that can be integrated ahead."""
    able = [row for row in rows if row["integrates"] and row[cost] is not None]
    lines = []
    for limit in LIMITS.get(cost, ()):
        within = [row for row in able if row[cost] <= limit]
        if not within:
            lines.append([f"≤ {limit:g}", *["none"] * len(ERRORS)])
            continue
        cells = [f"≤ {limit:g}"]
        for error in ERRORS:
            best = min(within, key=lambda row: (row[error], row[cost]))
            cells.append(f"{best['model']} ({_short(best[error])})")
        lines.append(cells)
    return markdown_table([COSTS[cost], *ERRORS.values()], lines)


def verdicts(rows: Sequence[Row]) -> str:
    """What the numbers say, as a list in Markdown."""
    by_name = {row["model"]: row for row in rows}
    closed = [row for row in rows if row["form"] == "closed form"]
    tables = [row for row in rows if row["form"] == "table"]
    said = [text for text in (caution(rows), _noise(rows)) if text]
    if closed:
        parts = []
        for kind in KINDS:
            timed = [row for row in closed if row[f"{kind}_ratio"] is not None]
            slower = [row for row in timed if row[f"{kind}_ratio"] >= 1.0]
            text = f"{KINDS[kind]}: {len(timed) - len(slower)} of {len(timed)}"
            if slower and len(slower) <= 8:
                text += f" (not {_listed([row['model'] for row in slower])})"
            parts.append(f"{text}, ratios {_range(row[f'{kind}_ratio'] for row in timed)}")
        said.append(
            "**Closed forms against the exact built-in.** So many take less time than it: "
            + ";\n  ".join(parts)
            + f". {_accuracy(closed, by_name)}"
        )
    for count in sorted({row["terms"] for row in closed}):
        timed = [row for row in closed if row["terms"] == count]
        said.append(
            f"**{count} terms, closed form:** RGB {_range(r['compute_ratio'] for r in timed)} of "
            f"the built-in compute-bound and {_range(r['streaming_ratio'] for r in timed)} "
            f"streaming, {_range(r['bsdf_ratio'] for r in timed)} of the BSDF, "
            f"{_range(r['render_ratio'] for r in timed)} of a picture; on measured materials the "
            f"least of the largest errors is {_least(timed, 'd_max')}, the least RMSE "
            f"{_least(timed, 'd_rmse')}, the least mean ΔE00 {_least(timed, 'delta_e_mean')}."
        )
    exact = [by_name[name] for name in ("exact, native", "exact, wide") if name in by_name]
    if exact:
        said.append(
            "**Our exact equations** take "
            + " and ".join(
                f"{row['compute_ratio']:.2f} ({row['model'].partition(', ')[2]})" for row in exact
            )
            + " of the built-in's time compute-bound, "
            + " and ".join(f"{row['streaming_ratio']:.2f}" for row in exact)
            + " streaming."
        )
    if "F82" in by_name and closed:
        f82 = by_name["F82"]
        both = [
            row["model"]
            for row in closed
            if row["compute_ratio"] <= f82["compute_ratio"] and row["d_rmse"] <= f82["d_rmse"]
        ]
        worse = [row["model"] for row in closed if row["d_rmse"] >= f82["d_rmse"]]
        said.append(
            f"**F82** takes {f82['compute_ratio']:.2f} of the built-in compute-bound and "
            f"{f82['operations']} operations, {_cheaper(closed, f82)} of the closed forms take "
            f"less; {'none' if not both else ', '.join(both)} is both as cheap and as accurate. "
            f"Its RMSE on measured materials is {_short(f82['d_rmse'])}; "
            + (f"that of {_listed(worse)} is no lower." if worse else "all of ours are lower.")
        )
    if tables and closed:
        said.append(_about_tables(tables, by_name))
    somewhere = _on_fronts(rows)
    nowhere = [row["model"] for row in closed if row["model"] not in somewhere]
    if closed:
        said.append(
            "**On no front** of any cost and any of the four errors, even among models that can be "
            "integrated ahead of time: "
            + (f"of the {len(closed)} closed forms {_listed(nowhere)}." if nowhere
               else f"none of the {len(closed)} closed forms.")
        )  # fmt: skip
    missing = [row["model"] for row in _without_tables(rows) if not row["in_plugin"]]
    missing += [f"all {len(tables)} tables"] if tables else []
    if missing:
        said.append(
            f"**Not in the plugin**, so without times of a BSDF and a picture: {_listed(missing)}."
        )
    return "\n".join(f"- {text}" for text in said)


def _accuracy(closed: Sequence[Row], by_name: dict[str, Row]) -> str:
    """How many closed forms are nearer to the measured materials than the built-in, by error."""
    built_in = by_name.get(BUILT_IN)
    if built_in is None:
        return ""
    counts = []
    for error, name in ERRORS.items():
        nearer = sum(row[error] < built_in[error] for row in closed if row[error] is not None)
        counts.append(f"{name}: {nearer} of {len(closed)}")
    return (
        f"Nearer than it to the measured materials are, by {'; by '.join(counts)}. For colour the "
        "built-in has one index per channel, closed forms the integrated spectrum."
    )


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
    slacks = [
        f"{COSTS[cost]} {100 * cost_slack(rows, cost):.1f} %"
        for cost in COSTS
        if cost.endswith("_ratio") and any(row[cost] is not None for row in rows)
    ]
    return (
        "**Noise.** Times count as equal on the fronts where they differ by less than twice the "
        f"median spread of their kind: {', '.join(slacks)}."
    )


def _about_tables(tables: Sequence[Row], by_name: dict[str, Row]) -> str:
    slower, total = 0, 0
    for row in tables:
        form = by_name.get(f"{row['family']}, {row['terms']} terms")
        if form is not None:
            total += 1
            slower += row["compute_ratio"] > form["compute_ratio"]
    fastest = min(tables, key=lambda row: row["compute_ratio"])
    halves = [row for row in tables if row["storage"] == "float16"]
    pairs = []
    for row in halves:
        other = by_name.get(row["model"].replace("float16", "float32"))
        if other is not None:
            pairs.append(row["compute_ratio"] / other["compute_ratio"])
    text = (
        f"**Tables**: {slower} of {total} take more time, compute-bound in RGB, than the closed "
        f"form of the same functions. The fastest, {fastest['model']}, takes "
        f"{fastest['compute_ratio']:.2f} of the built-in."
    )
    if pairs:
        text += f" Half floats take {_range(pairs)} of the time of float32 and half the bytes."
    return text


def _on_fronts(rows: Sequence[Row]) -> set[str]:
    return {
        row["model"]
        for cost in COSTS
        for error in ERRORS
        for row in front(rows, cost, error, integrates=True)
    }


def document(bench: Bench) -> str:
    """Everything, for a file of its own."""
    rows = bench.rows
    parts = [
        "# Speed against error",
        about_line(bench.about),
        verdicts(rows),
        recipe_table(rows),
        *(f"## Best within a budget: {COSTS[cost]}\n\n{budget_table(rows, cost)}"
          for cost in LIMITS),
        f"## Costs\n\n{cost_table(rows)}",
        f"## Errors\n\n{error_table(rows)}",
    ]  # fmt: skip
    if any(row["form"] == "table" for row in rows):
        parts.append(f"## Tables\n\n{size_table(rows)}")
    return "\n\n".join(parts) + "\n"


def write(bench: Bench, folder: str | os.PathLike[str], stem: str = "speed_vs_error") -> list[Path]:
    """CSV, JSON and Markdown; the paths."""
    paths = [Path(folder) / f"{stem}.{suffix}" for suffix in ("csv", "json", "md")]
    write_text(paths[0], to_csv(bench.rows))
    write_json(paths[1], {"about": bench.about, "rows": bench.rows})
    write_text(paths[2], document(bench))
    return paths


def to_csv(rows: Sequence[Row]) -> str:
    """Numbers with six digits; empty where there is none."""
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})
    return text.getvalue()


def read_csv(path: str | os.PathLike[str]) -> list[Row]:
    """Rows as `to_csv` wrote them."""
    with open(path, encoding="utf-8", newline="") as file:
        return [{key: _value(text) for key, text in row.items()} for row in csv.DictReader(file)]


def _value(text: str) -> Any:
    if text in ("", "True", "False"):
        return {"": None, "True": True, "False": False}[text]
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _without_tables(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row["form"] != "table"]


def _ratio(row: Row, kind: str, short: bool = False) -> str:
    ratio = row[f"{kind}_ratio"]
    if ratio is None:
        return "–" if short else NOT_IN_PLUGIN
    return f"{ratio:.2f} ± {row[f'{kind}_spread']:.2f}"


def _pair(row: Row, first: str, second: str, digits: int = 4) -> str:
    values = row[first], row[second]
    return "–" if None in values else " / ".join(_short(value, digits) for value in values)


def _short(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}f}" if value >= 0.5 * 10.0**-digits else f"{value:.0e}"


def _range(values: Iterable[float | None], digits: int = 2) -> str:
    known = [f"{value:.{digits}f}" for value in values if value is not None]
    if not known:
        return "–"
    low, high = min(known, key=float), max(known, key=float)
    return low if low == high else f"{low}–{high}"


def _least(rows: Sequence[Row], error: str) -> str:
    best = min(rows, key=lambda row: row[error])
    return f"{_short(best[error], 3 if error == 'delta_e_mean' else 4)} ({best['family']})"


def _cheaper(rows: Sequence[Row], than: Row) -> str:
    return str(sum(row["compute_ratio"] < than["compute_ratio"] for row in rows) or "none")


def _listed(names: Sequence[str]) -> str:
    quoted = [name.replace(", ", " with ") if "terms" in name else name for name in names]
    return quoted[0] if len(quoted) == 1 else f"{'; '.join(quoted[:-1])} and {quoted[-1]}"

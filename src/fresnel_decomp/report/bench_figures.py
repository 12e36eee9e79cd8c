"""Pareto plots of a benchmark: error over cost, and the models that nothing beats.

Colour says the recipe, the number beside a mark its terms. The dark line is the front of models
that can be integrated over rough surfaces ahead of time, the dashed one that of all models.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from . import style
from .bench import Row
from .bench_tables import COSTS, ERRORS, front

__all__ = ["draw_cost", "draw_overview", "figure_paths", "write_figures"]

RATIO_COSTS = tuple(cost for cost in COSTS if cost.endswith("_ratio"))
AXIS_LABELS = {
    "compute_ratio": "time / mi.fresnel_conductor, compute-bound kernel, RGB",
    "streaming_ratio": "time / mi.fresnel_conductor, streaming kernel, RGB",
    "bsdf_ratio": "time / roughconductor, BSDF only",
    "render_ratio": "time / roughconductor, whole render",
    "bytes": "bytes: constants or table, and one RGB material",
    "operations": "arithmetic operations, RGB",
}
ERROR_LABELS = {
    "d_max": "largest error, measured materials",
    "d_rmse": "RMSE, measured materials",
    "d_albedo_mean": "mean error of the albedo, measured materials",
    "delta_e_mean": "mean ΔE$_{00}$, measured materials",
}
NAMES = {
    "mi.fresnel_conductor": "exact built-in",
    "mi.fresnel_polarized": "mi.fresnel_polarized",
    "exact, native": "ours exact, native",
    "exact, wide": "ours exact, wide",
}
_GREY = "#606060"
_LABEL_SIZE = 6.8
_MARKERS = {"Schlick": "X", "F82": "h", "Lazanyi": "p", "Gulbrandsen": "d", "exact": "*"}
_MARKERS |= {"Mitsuba": "*"}


def figure_paths(folder: str | os.PathLike[str], stem: str = "speed_vs_error") -> dict[str, Path]:
    """The overview under "overview", and for each cost a figure of its own."""
    folder = Path(folder)
    names = {cost: cost.removesuffix("_ratio") for cost in COSTS}
    single = {cost: folder / f"{stem}_{name}.png" for cost, name in names.items()}
    return {"overview": folder / f"{stem}.png"} | single


def write_figures(rows: Sequence[Row], folder: str | os.PathLike[str], note: str) -> list[Path]:
    """Draw all of them; those for which nothing was measured are left out."""
    paths = figure_paths(folder)
    draw_overview(rows, paths["overview"], note)
    written = [paths["overview"]]
    for cost in COSTS:
        if sum(row[cost] is not None for row in rows) > 1:
            draw_cost(rows, cost, paths[cost], note)
            written.append(paths[cost])
    return written


def draw_overview(rows: Sequence[Row], path: Path, note: str = "", error: str = "d_rmse") -> None:
    """One panel for each kind of cost."""
    with style.styled():
        fig = style.figure(11.6, 7.8)
        for place, cost in enumerate(COSTS):
            axes = _place(fig, place % 3, place // 3, 3, 2)
            _panel(axes, rows, cost, error)
            axes.set_title(COSTS[cost], loc="left")
            if place % 3 == 0:
                axes.set_ylabel(ERROR_LABELS[error])
        _frame(fig, rows, "Cost against error of Fresnel models", note)
        style.save(fig, path, dpi=150)


def draw_cost(rows: Sequence[Row], cost: str, path: Path, note: str = "") -> None:
    """One panel for each of four errors."""
    with style.styled():
        fig = style.figure(10.0, 8.4)
        for place, error in enumerate(ERRORS):
            axes = _place(fig, place % 2, place // 2, 2, 2)
            _panel(axes, rows, cost, error)
            axes.set_title(ERROR_LABELS[error], loc="left")
            axes.set_ylabel("ΔE$_{00}$" if error == "delta_e_mean" else "error")
        _frame(fig, rows, f"Error over cost: {COSTS[cost]}", note)
        style.save(fig, path, dpi=150)


def _place(fig: Any, column: int, line: int, columns: int, lines: int) -> Any:
    width, height = fig.get_size_inches()
    left, top, below, gap_x, gap_y = 0.78, 1.14, 0.52, 0.66, 0.82
    w = (width - left - 0.12 - gap_x * (columns - 1)) / columns
    h = (height - top - below - gap_y * (lines - 1)) / lines
    x, y = left + column * (w + gap_x), height - top - (line + 1) * h - line * gap_y
    return fig.add_axes((x / width, y / height, w / width, h / height))


def _frame(fig: Any, rows: Sequence[Row], title: str, note: str) -> None:
    """Title, key and the line about the machine."""
    from matplotlib.lines import Line2D

    width, height = fig.get_size_inches()

    def write(x: float, y: float, text: str, **options: Any) -> None:
        fig.text(x / width, 1.0 - y / height, text, va="center", **options)

    write(0.12, 0.2, title, size=12)
    write(0.12, 0.42, note, size=7, color=_GREY)
    families = [name for name in style.RECIPE_COLOURS if any(r["family"] == name for r in rows)]
    marks = [
        Line2D([], [], color=style.RECIPE_COLOURS[name], marker=style.RECIPE_MARKERS[name], lw=0,
               ms=5, label=name)
        for name in families
    ]  # fmt: skip
    if any(row["form"] == "table" for row in rows):
        marks.append(Line2D([], [], color=_GREY, marker=".", lw=0, ms=5, label="table, float32"))
        marks.append(
            Line2D([], [], color=_GREY, marker=".", mfc="white", mew=0.6, lw=0, ms=5,
                   label="table, float16")
        )  # fmt: skip
    marks += [
        Line2D([], [], color="#1a1a1a", marker="X", lw=0, ms=5, label="other, preintegrable"),
        Line2D(
            [],
            [],
            color="#1a1a1a",
            marker="p",
            mfc="white",
            lw=0,
            ms=5,
            label="other, not preintegrable",
        ),
        Line2D([], [], color="#1a1a1a", lw=1.4, label="front, preintegrable"),
        Line2D([], [], color="#8a8a8a", lw=1.0, ls="--", label="front, all"),
    ]
    fig.legend(
        handles=marks, loc="upper left", bbox_to_anchor=(0.08 / width, 1.0 - 0.5 / height),
        ncols=len(marks) if width > 10 else (len(marks) + 1) // 2, fontsize=7, handlelength=1.4,
        columnspacing=1.0, handletextpad=0.4, borderaxespad=0.0,
    )  # fmt: skip


class _Point(NamedTuple):
    row: Row
    x: float
    y: float


def _panel(axes: Any, rows: Sequence[Row], cost: str, error: str) -> None:
    shown = [r for r in rows if r[cost] is not None and r[error] is not None and r[cost] > 0]
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(AXIS_LABELS[cost], size=7.8)
    if not shown:
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", color=_GREY)
        return
    floor = _floor([r for r in shown if r["family"] not in ("exact", "Mitsuba")], error)
    points = [_Point(r, r[cost], max(r[error], floor / 2.0)) for r in shown]
    x = np.array([p.x for p in points])
    axes.set_xlim(
        x.min() / 1.22, x.max() * 1.35 if cost not in ("render_ratio",) else x.max() * 1.1
    )
    axes.set_ylim(floor / 3.2, 2.0 * max(p.y for p in points))
    if any(r[error] < floor for r in shown):
        axes.axhspan(floor / 3.2, floor, color="#f3f3f3", lw=0, zorder=0)
        axes.text(
            0.008, 0.012, f"below {floor:g}", transform=axes.transAxes, ha="left", va="bottom",
            size=6, color=_GREY,
        )  # fmt: skip
    for point in points:
        _mark(axes, point)
    fronts = []
    by_name = {p.row["model"]: p for p in points}
    for able, look in (
        (False, {"color": "#8a8a8a", "lw": 1.0, "ls": "--", "zorder": 2.0}),
        (True, {"color": "#1a1a1a", "lw": 1.4, "zorder": 2.5}),
    ):
        best = [by_name[row["model"]] for row in front(rows, cost, error, integrates=able)]
        _stairs(axes, best, look)
        fronts.append(best)
    for point in {id(p): p for p in (*fronts[0], *fronts[1])}.values():
        _spread(axes, point, cost)
    names = {p.row["model"] for p in fronts[1]}
    labelled = fronts[1] + [p for p in fronts[0] if p.row["model"] not in names]
    others = [p for p in points if p.row["form"] == "formula" and p not in labelled]
    _label(axes, points, labelled, others)
    _ticks(axes, cost)


def _floor(rows: Sequence[Row], error: str) -> float:
    """A round number below every approximation's error."""
    least = min((r[error] for r in rows), default=1e-4)
    power = 10.0 ** np.floor(np.log10(max(least, 1e-7) * 0.8))
    return float(next(s * power for s in (5.0, 2.0, 1.0) if s * power <= 0.8 * max(least, 1e-7)))


def _mark(axes: Any, point: _Point) -> None:
    row = point.row
    colour = style.RECIPE_COLOURS.get(row["family"], "#1a1a1a")
    if row["form"] == "table":
        half = row["storage"] == "float16"
        axes.plot(
            point.x, point.y, color=colour, marker=".", ms=3.6, lw=0, alpha=0.55, zorder=2.2,
            mfc="white" if half else colour, mew=0.5,
        )  # fmt: skip
        return
    if row["form"] == "closed form":
        axes.plot(
            point.x, point.y, color=colour, marker=style.RECIPE_MARKERS[row["family"]], ms=5.0,
            lw=0, zorder=3.0,
        )  # fmt: skip
        axes.annotate(
            str(row["terms"]), (point.x, point.y), xytext=(3.4, -3.4),
            textcoords="offset points", size=5.2, color=colour, zorder=3.1, va="center",
        )  # fmt: skip
        return
    axes.plot(
        point.x, point.y, color="#1a1a1a", marker=_MARKERS[row["family"]], ms=5.6, lw=0, zorder=3.2,
        mfc="#1a1a1a" if row["integrates"] else "white", mew=0.8,
    )  # fmt: skip


def _spread(axes: Any, point: _Point, cost: str) -> None:
    """Half the distance between quartiles, to either side."""
    if not cost.endswith("_ratio"):
        return
    spread = point.row[cost.replace("_ratio", "_spread")]
    ends = [max(point.x - spread, axes.get_xlim()[0]), min(point.x + spread, axes.get_xlim()[1])]
    colour = style.RECIPE_COLOURS.get(point.row["family"], "#1a1a1a")
    axes.plot(ends, [point.y, point.y], color=colour, lw=2.6, alpha=0.35, zorder=2.8)


def _stairs(axes: Any, best: Sequence[_Point], look: dict[str, Any]) -> None:
    """What a budget buys: steps down from each model of a front to the next, on to the right."""
    if not best:
        return
    xs, ys = [best[0].x], [axes.get_ylim()[1]]
    ends = [*(point.x for point in best[1:]), axes.get_xlim()[1]]
    for here, end in zip(best, ends, strict=True):
        xs += [here.x, end]
        ys += [here.y, here.y]
    axes.plot(xs, ys, **look)


def _name(row: Row) -> str:
    if row["form"] == "formula":
        return NAMES.get(row["model"], str(row["model"]))
    text = f"{row['family']} {row['terms']}"
    if row["form"] == "table":
        text += f", table {row['size']}{' half' if row['storage'] == 'float16' else ''}"
    return text


def _label(
    axes: Any, points: Sequence[_Point], first: Sequence[_Point], others: Sequence[_Point]
) -> None:
    """Names beside marks, where they hide least; those of the front in bold come first."""
    unit = 72.0 / axes.figure.dpi  # points a pixel
    at = {id(p): axes.transData.transform((p.x, p.y)) * unit for p in points}
    box = axes.get_window_extent()
    left, bottom, right, top = (v * unit for v in (box.x0, box.y0, box.x1, box.y1))
    taken: list[tuple[float, float, float, float]] = []
    marks = [(x - 2.5, y - 2.5, x + 2.5, y + 2.5) for x, y in at.values()]
    for point in [*first, *others]:
        strong = point in first
        text = _name(point.row)
        x, y = at[id(point)]
        width, height = 0.56 * _LABEL_SIZE * len(text) * (1.06 if strong else 1.0), _LABEL_SIZE
        best: tuple[float, float, float] | None = None
        for distance in (5.0, 11.0, 18.0, 27.0, 38.0):
            for dx, dy in _DIRECTIONS:
                x0 = x + distance * dx + (0.0 if dx > 0 else -width if dx < 0 else -width / 2)
                y0 = y + distance * dy - height / 2
                own = (x0, y0, x0 + width, y0 + height)
                outside = (
                    max(0.0, left + 1 - own[0]) + max(0.0, own[2] - right + 1)
                    + max(0.0, bottom + 1 - own[1]) + max(0.0, own[3] - top + 1)
                )  # fmt: skip
                hidden = sum(_overlap(own, other) for other in taken)
                covered = sum(_overlap(own, other) for other in marks)
                penalty = 60.0 * outside + 8.0 * hidden + covered + 1.6 * distance
                if best is None or penalty < best[0]:
                    best = penalty, x0, y0
        assert best is not None
        _, x0, y0 = best
        taken.append((x0, y0, x0 + width, y0 + height))
        colour = style.RECIPE_COLOURS.get(point.row["family"], "#1a1a1a")
        near_x = min(max(x, x0), x0 + width)
        near_y = min(max(y, y0), y0 + height)
        if np.hypot(near_x - x, near_y - y) > 6.5:
            ends = np.array([[x, y], [near_x, near_y]]) / unit
            ends = axes.transData.inverted().transform(ends)
            axes.plot(*ends.T, color=colour, lw=0.4, alpha=0.7, zorder=3.3)
        place = axes.transData.inverted().transform((x0 / unit, (y0 + height / 2) / unit))
        axes.text(
            *place, text, size=_LABEL_SIZE, color=colour, va="center", ha="left", zorder=4.0,
            fontweight="bold" if strong and point.row["integrates"] else "normal",
            bbox={"boxstyle": "square,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.6},
        )  # fmt: skip


_DIRECTIONS = (
    (1.0, 0.35), (1.0, -0.6), (0.7, 1.0), (-1.0, 0.35), (-1.0, -0.6), (0.0, 1.0), (0.0, -1.0),
    (0.7, -1.0), (-0.7, 1.0), (-0.7, -1.0),
)  # fmt: skip


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return max(0.0, min(a[2], b[2]) - max(a[0], b[0])) * max(0.0, min(a[3], b[3]) - max(a[1], b[1]))


def _ticks(axes: Any, cost: str) -> None:
    """Round numbers that people read, instead of powers of ten."""
    from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator

    low, high = axes.get_xlim()
    steps = (
        (0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.15, 1.2, 1.3)
        if high < 1.6 and cost in RATIO_COSTS
        else tuple(s * 10.0**p for p in range(-2, 6) for s in (1, 2, 5))
    )
    ticks = [tick for tick in steps if low <= tick <= high]
    while len(ticks) > 8:
        ticks = ticks[::2]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    if cost in RATIO_COSTS:
        axes.axvline(1.0, color="#c0c0c0", lw=0.7, zorder=1.0)

"""Pareto plots of a benchmark: error over cost, and the models that nothing beats by name.

The wide yellow staircase is the front of models that can be integrated over rough surfaces ahead
of time: whoever goes up from a budget meets it at the best model for that budget, whose name stands
at the left end of the step. It is `pareto.front`, of which the tables of budgets are made too.
"""

from __future__ import annotations

import itertools
import math
import os
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..report import style
from .pareto import counted, front, tied
from .run import Row
from .words import COSTS, ERRORS

__all__ = ["draw_cost", "draw_overview", "figure_paths", "write_figures"]

OVERVIEW = ("compute_ratio", "bsdf_ratio", "bytes")
"""Costs that the figure of README shows."""

AXIS_LABELS = {
    "compute_ratio": "time / mi.fresnel_conductor",
    "streaming_ratio": "time / mi.fresnel_conductor",
    "bsdf_ratio": "time / roughconductor",
    "render_ratio": "time / roughconductor",
    "bytes": "bytes, shared and of one RGB material",
    "operations": "operations and loads, RGB",
}
HOW_TO_READ = (
    "Go up from your budget to the yellow line, then left along the step: the model named there "
    "has the least error for that budget. Rings: times within noise of the line."
)
_FRONT = "#ecbb00"
_ALL = "#7a68a6"
_INK = "#1a1a1a"
_GREY = "#606060"
_SIZE = 9.0  # points; a figure 8.65 inches wide has them on a page that is 830 pixels wide
_WIDTH = 8.65
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
        if sum(row.get(cost) is not None for row in rows) > 1:
            draw_cost(rows, cost, paths[cost], note)
            written.append(paths[cost])
    return written


def draw_overview(rows: Sequence[Row], path: Path, note: str = "", error: str = "d_rmse") -> None:
    """Three kinds of cost, and how to read them."""
    with style.styled():
        fig = style.figure(_WIDTH, 7.6)
        for place, cost in enumerate(OVERVIEW):
            axes = _place(fig, place, 2)
            _panel(axes, rows, cost, error)
            axes.set_title(COSTS[cost][0].upper() + COSTS[cost][1:], loc="left", size=11)
            axes.set_ylabel(ERRORS[error], size=_SIZE)
        _key(fig, _place(fig, 3, 2), rows, note)
        style.save(fig, path)


def draw_cost(rows: Sequence[Row], cost: str, path: Path, note: str = "") -> None:
    """One panel for each of five errors, and how to read them."""
    with style.styled():
        fig = style.figure(_WIDTH, 11.0)
        for place, error in enumerate(ERRORS):
            axes = _place(fig, place, 3)
            _panel(axes, rows, cost, error)
            title = ERRORS[error].replace("mean error of the albedo", "mean albedo error")
            axes.set_title(_plain(title[0].upper() + title[1:]), loc="left", size=10)
        _key(fig, _place(fig, len(ERRORS), 3), rows, note)
        style.save(fig, path)


def _plain(text: str) -> str:
    return text.replace("ΔE00", "ΔE$_{00}$")


def _place(fig: Any, place: int, lines: int) -> Any:
    """Axes number `place` of two columns, from the top left."""
    width, height = fig.get_size_inches()
    left, top, right, below, gap_x, gap_y = 0.74, 0.34, 0.1, 0.52, 0.7, 0.86
    w = (width - left - right - gap_x) / 2
    h = (height - top - below - gap_y * (lines - 1)) / lines
    line, column = divmod(place, 2)
    x, y = left + column * (w + gap_x), height - top - (line + 1) * h - line * gap_y
    return fig.add_axes((x / width, y / height, w / width, h / height))


def _key(fig: Any, axes: Any, rows: Sequence[Row], note: str) -> None:
    """How to read the panels, what the marks are, and where times were taken."""
    from matplotlib.lines import Line2D

    axes.set_axis_off()

    def write(y: float, text: str, **options: Any) -> None:
        axes.text(0.0, y, text, transform=axes.transAxes, va="top", linespacing=1.25, **options)

    write(1.04, "How to read", size=11)
    write(0.95, textwrap.fill(HOW_TO_READ, 58), size=_SIZE)

    def mark(label: str, marker: str, colour: str = _INK, **options: Any) -> Any:
        return Line2D(
            [], [], color=colour, marker=marker, lw=0, label=label, **({"ms": 6.5} | options)
        )

    marks = [
        mark(name, style.RECIPE_MARKERS[name], style.RECIPE_COLOURS[name])
        for name in style.RECIPE_COLOURS
        if any(row["family"] == name for row in rows)
    ]
    if any(row["form"] == "table" for row in rows):
        marks += [mark("table, float32", "o", _GREY, ms=3.0)]
        marks += [mark("table, float16", "x", _GREY, ms=3.6, mew=0.8)]
    marks += [
        mark("other model", "X"),
        mark("not preintegrable", "d", mfc="white"),
        mark("within noise of the line", "o", _FRONT, mfc="none", ms=11, mew=1.4),
        Line2D([], [], color=_FRONT, lw=4.0, label="best for a budget"),
        Line2D([], [], color=_ALL, lw=1.4, ls="--", label="with not preintegrable"),
    ]
    axes.legend(
        handles=marks, loc="upper left", bbox_to_anchor=(-0.02, 0.66), ncols=2, fontsize=_SIZE,
        handlelength=1.6, columnspacing=1.2, handletextpad=0.5, borderaxespad=0.0,
        labelspacing=0.45,
    )  # fmt: skip
    axes.text(
        0.0, -0.14, textwrap.fill(note, 54), transform=axes.transAxes, va="bottom", size=_SIZE,
        color=_GREY, linespacing=1.2,
    )  # fmt: skip


_Segment = tuple[tuple[float, float], tuple[float, float]]


class _Point(NamedTuple):
    row: Row
    x: float
    y: float


def _panel(axes: Any, rows: Sequence[Row], cost: str, error: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(AXIS_LABELS[cost], size=_SIZE)
    axes.tick_params(labelsize=_SIZE)
    known = [(r, counted(r, cost), counted(r, error)) for r in rows]
    shown = [(r, x, y) for r, x, y in known if x is not None and y is not None and x > 0]
    if not shown:
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", color=_GREY)
        return
    floor = _floor([y for r, _, y in shown if not _is_exact(r)])
    points = [_Point(r, x, max(y, floor / 2.0)) for r, x, y in shown]
    under = any(y < floor for _, _, y in shown)
    xs, ys = [p.x for p in points], [p.y for p in points]
    widen = max(max(xs) / min(xs), 1.2) ** 0.06
    axes.set_xlim(min(xs) / widen**1.6, max(xs) * widen)
    low, high = (floor / 3.2 if under else min(ys)), max(max(ys), 1.2 * min(ys))
    axes.set_ylim(low if under else low / (high / low) ** 0.1, high * (high / low) ** 0.06)
    if under:
        axes.axhspan(low, floor, color="#f1f1f1", lw=0, zorder=0)
    by_model = {p.row["model"]: p for p in points}
    best, every = (
        [by_model[row["model"]] for row in front(rows, cost, error, integrates=integrates)]
        for integrates in (True, False)
    )
    rings = [by_model[row["model"]] for row in tied(rows, cost, error, integrates=True)]
    _stairs(axes, every, color=_ALL, lw=1.4, ls="--", zorder=2.0)
    steps = _stairs(axes, best, color=_FRONT, lw=4.0, zorder=2.4, solid_joinstyle="miter")
    strong = {id(p) for p in best}
    for point in points:
        _mark(axes, point, strong=id(point) in strong, pale=_pale(point, best, rings))
    for point in rings:
        axes.plot(
            point.x, point.y, color=_FRONT, marker="o", mfc="none", ms=11, mew=1.4, lw=0, zorder=2.9
        )
    bars = [bar for point in best if (bar := _spread(axes, point, cost))]
    _ticks(axes, cost)
    _Labels(axes, points, [*itertools.pairwise(steps), *bars]).write(best, points)


def _is_exact(row: Row) -> bool:
    return row["family"] in ("exact", "Mitsuba")


def _pale(point: _Point, best: Sequence[_Point], rings: Sequence[_Point]) -> bool:
    """What is beaten stands back; models outside the contest do not."""
    return point.row["form"] != "formula" and not any(point is p for p in (*best, *rings))


def _floor(errors: Sequence[float]) -> float:
    """A round number below every approximation's error."""
    least = 0.8 * max(min(errors, default=1e-4), 1e-7)
    power = 10.0 ** math.floor(math.log10(least))
    return next(s * power for s in (5.0, 2.0, 1.0) if s * power <= least * (1.0 + 1e-9))


def _mark(axes: Any, point: _Point, strong: bool, pale: bool) -> None:
    row = point.row
    colour = style.RECIPE_COLOURS.get(row["family"], _INK)
    if row["form"] == "table":
        half = row["storage"] == "float16"
        axes.plot(
            point.x, point.y, color=colour, marker="x" if half else "o", ms=2.8 if half else 2.2,
            mew=0.6, lw=0, alpha=0.45 if pale else 1.0, zorder=2.1 if pale else 3.2,
        )  # fmt: skip
    elif row["form"] == "closed form":
        axes.plot(
            point.x, point.y, color=colour, marker=style.RECIPE_MARKERS[row["family"]], lw=0,
            ms=8.0 if strong else 5.5, mec="white" if strong else colour,
            mew=0.7 if strong else 0.0, alpha=0.45 if pale else 1.0,
            zorder=3.4 if strong else 2.2 if pale else 3.0,
        )  # fmt: skip
    else:
        axes.plot(
            point.x, point.y, color=_INK, marker=_MARKERS[row["family"]], ms=8.0, lw=0, zorder=3.3,
            mfc=_INK if row["integrates"] else "white",
            mec="white" if row["integrates"] else _INK, mew=0.7 if row["integrates"] else 0.9,
        )  # fmt: skip


def _spread(axes: Any, point: _Point, cost: str) -> _Segment | None:
    """Half the distance between quartiles, to either side."""
    spread = point.row.get(cost.replace("_ratio", "_spread")) if cost.endswith("_ratio") else None
    if not spread:
        return None
    low, high = axes.get_xlim()
    colour = style.RECIPE_COLOURS.get(point.row["family"], _INK)
    ends = (max(point.x - spread, low), point.y), (min(point.x + spread, high), point.y)
    axes.plot(*zip(*ends, strict=True), color=colour, lw=1.1, zorder=3.1, solid_capstyle="butt")
    return ends


def _stairs(axes: Any, best: Sequence[_Point], **look: Any) -> list[tuple[float, float]]:
    """What a budget buys: down at each model of a front to its error, then on to the right."""
    if not best:
        return []
    corners = [(best[0].x, axes.get_ylim()[1])]
    ends = [*(point.x for point in best[1:]), axes.get_xlim()[1]]
    for here, end in zip(best, ends, strict=True):
        corners += [(here.x, here.y), (end, here.y)]
    axes.plot(*zip(*corners, strict=True), **look)
    return corners


def _name(row: Row) -> str:
    if row["form"] == "formula":
        return str(row["model"])
    text = f"{row['family']} {row['terms']}"
    if row["form"] == "table":
        text += f", table {row['size']}{' half' if row['storage'] == 'float16' else ''}"
    return text


Box = tuple[float, float, float, float]


class _Labels:
    """Names beside marks, off all lines, marks and other names; in points from the corner."""

    def __init__(self, axes: Any, points: Sequence[_Point], segments: Sequence[_Segment]) -> None:
        self.axes, self.unit = axes, 72.0 / axes.figure.dpi
        bounds = axes.get_window_extent()
        self.frame: Box = tuple(v * self.unit for v in bounds.extents)
        self.at = {id(p): self.points((p.x, p.y)) for p in points}
        self.marks = [
            (_square(self.at[id(p)], 2.0 if p.row["form"] == "table" else 4.5),
             0.25 if p.row["form"] == "table" else 1.0)
            for p in points
        ]  # fmt: skip
        ends = [(self.points(a), self.points(b)) for a, b in segments]
        self.lines: list[Box] = [
            (min(a[0], b[0]) - 2.5, min(a[1], b[1]) - 2.5, max(a[0], b[0]) + 2.5,
             max(a[1], b[1]) + 2.5)
            for a, b in ends
        ]  # fmt: skip
        self.taken: list[Box] = []

    def points(self, place: tuple[float, float]) -> tuple[float, float]:
        x, y = self.axes.transData.transform(place) * self.unit
        return float(x), float(y)

    def write(self, best: Sequence[_Point], points: Sequence[_Point]) -> None:
        """The front in bold, then the other formulas; exact models share one name."""
        for point in best:
            self.label(point, _name(point.row), "bold")
        formulas = [p for p in points if p.row["form"] == "formula" and p not in best]
        exact = [p for p in formulas if _is_exact(p.row)]
        for point in formulas:
            if point not in exact:
                self.label(point, _name(point.row), "normal")
        if exact:
            first = min(exact, key=lambda p: p.x)
            self.label(first, f"exact ({len(exact)})" if len(exact) > 1 else "exact", "normal")

    def label(self, point: _Point, text: str, weight: str) -> None:
        x, y = self.at[id(point)]
        width, height = _extent(text, weight)
        choices = [
            (x + distance * dx + (0.0 if dx > 0.3 else -width if dx < -0.3 else -width / 2),
             y + distance * dy - height / 2, distance)
            for distance in (8.0, 12.0, 17.0, 23.0, 30.0, 38.0, 48.0, 60.0)
            for dx, dy in _DIRECTIONS
        ]  # fmt: skip
        x0, y0, _ = min(
            choices, key=lambda c: self.penalty((c[0], c[1], c[0] + width, c[1] + height), c[2])
        )
        own = (x0, y0, x0 + width, y0 + height)
        self.taken.append(own)
        colour = style.RECIPE_COLOURS.get(point.row["family"], _INK)
        near = (min(max(x, own[0]), own[2]), min(max(y, own[1]), own[3]))
        back = self.axes.transData.inverted()
        if math.hypot(near[0] - x, near[1] - y) > 10.0:
            ends = back.transform(np.array([[x, y], near]) / self.unit)
            self.axes.plot(*ends.T, color=colour, lw=0.7, zorder=2.6)
        place = back.transform((x0 / self.unit, (y0 + height / 2) / self.unit))
        self.axes.text(
            *place, text, size=_SIZE, color=colour, va="center_baseline", ha="left", zorder=4.0,
            fontweight=weight,
        )  # fmt: skip

    def penalty(self, own: Box, distance: float) -> float:
        left, bottom, right, top = self.frame
        outside = (
            max(0.0, left + 2 - own[0]) + max(0.0, own[2] - right + 1)
            + max(0.0, bottom + 2 - own[1]) + max(0.0, own[3] - top + 1)
        )  # fmt: skip
        hidden = sum(_overlap(own, other) for other in self.taken)
        struck = sum(_overlap(own, line) for line in self.lines)
        covered = sum(weight * _overlap(own, mark) for mark, weight in self.marks)
        return 60.0 * outside + 20.0 * hidden + 8.0 * struck + 2.0 * covered + 2.0 * distance


_DIRECTIONS = (
    (-1.0, -0.35), (-0.8, -0.8), (-1.0, 0.0), (0.0, -1.0), (-1.0, 0.4), (1.0, 0.6), (1.0, 0.0),
    (0.8, -0.8), (0.0, 1.0), (-0.7, 1.0), (0.7, 1.0),
)  # fmt: skip


def _extent(text: str, weight: str) -> tuple[float, float]:
    """Width and height of a name in points."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    font = FontProperties(family=style.RC["font.family"], weight=weight)
    return float(
        TextPath((0, 0), text, size=_SIZE, prop=font).get_extents().width
    ) + 2.0, _SIZE + 1.0


def _square(centre: tuple[float, float], half: float) -> Box:
    return centre[0] - half, centre[1] - half, centre[0] + half, centre[1] + half


def _overlap(a: Box, b: Box) -> float:
    return max(0.0, min(a[2], b[2]) - max(a[0], b[0])) * max(0.0, min(a[3], b[3]) - max(a[1], b[1]))


def _ticks(axes: Any, cost: str) -> None:
    """Round numbers that people read; powers of ten where decimals would be too long."""
    from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator

    low, high = axes.get_xlim()
    if high / low < 8.0 and cost.endswith("_ratio"):
        step = 0.05 if high - low < 0.45 else 0.1 if high - low < 1.0 else 0.2
        ticks = [round(step * i, 2) for i in range(1, int(high / step) + 1)]
    else:
        ticks = [s * 10.0**p for p in range(-3, 6) for s in (1, 2, 5)]
    ticks = [tick for tick in ticks if low <= tick <= high]
    if len(ticks) > 7:
        whole = [tick for tick in ticks if math.log10(tick) % 1.0 < 1e-9]
        ticks = whole if len(whole) >= 3 else ticks[::2]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_formatter(NullFormatter())
    powers = axes.get_ylim()[0] < 1e-4

    def written(value: float, _: Any) -> str:
        exponent = round(math.log10(value))
        return f"10$^{{{exponent}}}$" if powers else f"{value:g}"

    axes.yaxis.set_major_formatter(written)
    if cost.endswith("_ratio"):
        axes.axvline(1.0, color="#c0c0c0", lw=0.8, zorder=1.0)

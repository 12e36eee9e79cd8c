"""Draws renders of several models beside their reference, and maps of the differences."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._check import input_error
from ..images import ImageDifference, compare, display
from . import style

__all__ = ["RenderRow", "draw_renders"]

_CELL, _GAP, _CAPTION = 1.62, 0.06, 0.20  # inches
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.44, 0.14, 0.30, 0.62


@dataclass(frozen=True)
class RenderRow:
    """One line of the grid: a material at a roughness."""

    label: str
    reference: NDArray[np.float32]
    images: Mapping[str, NDArray[np.float32]]
    """Linear images by model."""
    differences: Mapping[str, ImageDifference]
    """Of each of them from the reference."""
    exposure: float = 0.0
    """In stops, of the pictures and for FLIP and ΔE00."""

    @classmethod
    def compute(
        cls,
        label: str,
        images: Mapping[str, ArrayLike],
        reference: str = "exact",
        exposure: float = 0.0,
    ) -> RenderRow:
        """Measure all images against the one called `reference`."""
        arrays = {name: np.asarray(image, np.float32) for name, image in images.items()}
        if reference not in arrays:
            raise input_error(
                f"images {', '.join(arrays)} without {reference!r}",
                "a mapping that includes the reference",
                "Render it too.",
            )
        truth = arrays.pop(reference)
        differences = {name: compare(truth, image, exposure) for name, image in arrays.items()}
        return cls(label, truth, arrays, differences, exposure)


def draw_renders(
    rows: Sequence[RenderRow], path: str | os.PathLike[str], title: str | None = None
) -> None:
    """Write the grid: reference, models, FLIP maps of the models, signed-difference maps of them.

    Both kinds of maps have one scale for the whole figure, so that any two of them compare.

    Parameters
    ----------
    rows : sequence of RenderRow
        With the same models in all of them.
    path : path
        `.png`, `.pdf` or `.svg`.
    title : str, optional
        Above the grid.
    """
    models = list(rows[0].images) if rows else []
    if not models or any(list(row.images) != models for row in rows):
        raise input_error(
            f"rows with models {[list(row.images) for row in rows]}",
            "at least one row, the same models in each",
            "Render every model for every row.",
        )
    flip_limit = style.nice_limit(_upper(d.flip_map for r in rows for d in r.differences.values()))
    sign_limit = style.nice_limit(
        _upper(np.abs(d.signed_map) for r in rows for d in r.differences.values())
    )
    columns = 1 + 3 * len(models)
    heights = [_CELL * row.reference.shape[0] / row.reference.shape[1] for row in rows]
    width = _LEFT + columns * (_CELL + _GAP) + 2 * _GAP + _RIGHT
    top = _TOP + (0.30 if title else 0.0)
    height = top + sum(heights) + len(rows) * (_CAPTION + _GAP) + _BOTTOM

    with style.styled():
        fig = style.figure(width, height)

        def left(column: int) -> float:
            groups = (column > len(models)) + (column > 2 * len(models))
            return _LEFT + column * (_CELL + _GAP) + groups * _GAP

        def place(x: float, y: float, wide: float, high: float) -> Any:
            return fig.add_axes((x / width, 1 - (y + high) / height, wide / width, high / height))

        def write(x: float, y: float, text: str, **options: Any) -> None:
            fig.text(x / width, 1 - y / height, text, **{"ha": "center", "va": "center"} | options)

        if title:
            write(_LEFT, 0.24, title, ha="left", size=11)
        heads = ["Exact (reference)", *(_label(m) for m in models)]
        heads += [f"FLIP: {_label(m)}" for m in models]
        heads += [f"{_label(m)} − exact" for m in models]
        for column, head in enumerate(heads):
            write(left(column) + _CELL / 2, top - 0.13, head, size=9)

        y = top
        for row, high in zip(rows, heights, strict=True):
            write(_LEFT / 2, y + high / 2, _fold(row.label), rotation=90, size=9.5)
            cells: list[tuple[Callable[..., Any], NDArray[Any], str]] = []
            gap = [row.differences[m] for m in models]
            cells.append((_picture, display(row.reference, row.exposure), ""))
            for model, d in zip(models, gap, strict=True):
                caption = f"mean ΔE$_{{00}}$ {d.delta_e:.2f}"
                cells.append((_picture, display(row.images[model], row.exposure), caption))
            for d in gap:
                cells.append((_flip_map(flip_limit), d.flip_map, f"mean {d.flip:.4f}"))
            for d in gap:
                cells.append((_signed_map(sign_limit), d.signed_map, f"RMSE {_short(d.rmse)}"))
            mappables = []
            for column, (draw, values, caption) in enumerate(cells):
                axes = place(left(column), y, _CELL, high)
                mappables.append(draw(axes, values))
                axes.set_axis_off()
                write(left(column) + _CELL / 2, y + high + 0.5 * _CAPTION, caption, size=8.5)
            y += high + _CAPTION + _GAP

        ends = [(1 + len(models), 2 * len(models)), (1 + 2 * len(models), 3 * len(models))]
        names = ["FLIP (0: no visible difference)", "linear luminance, model − exact"]
        ticks = [np.linspace(0, flip_limit, 5), np.linspace(-sign_limit, sign_limit, 5)]
        for (first, last), name, at, sides in zip(ends, names, ticks, ("max", "both"), strict=True):
            start, stop = left(first) + 0.15, left(last) + _CELL - 0.15
            bar = fig.colorbar(
                mappables[first],
                cax=place(start, y + 0.06, stop - start, 0.10),
                orientation="horizontal",
                extend=sides,
                extendfrac=0.03,
                ticks=at,
                format=lambda value, _: f"{value:g}".replace("-", "−"),
            )
            bar.set_label(name, size=8.5, labelpad=2)
            bar.ax.grid(False)
            bar.outline.set_linewidth(0.5)
        style.save(fig, path)


def _upper(maps: Any) -> float:
    """What nearly all values of all maps stay below; the colour bars' arrows stand for the rest."""
    return max(float(np.percentile(values, 99.5)) for values in maps)


def _label(model: str) -> str:
    return style.MODEL_LABELS.get(model, model)


def _fold(label: str, longest: int = 18) -> str:
    """Break a label that is longer than a picture is high, after the comma nearest its middle."""
    commas = [i for i in range(len(label)) if label[i : i + 2] == ", "]
    if len(label) <= longest or not commas:
        return label
    at = min(commas, key=lambda i: abs(i - len(label) / 2)) + 1
    return f"{label[:at]}\n{label[at + 1 :]}"


def _short(value: float) -> str:
    return f"{value:.4f}" if value == 0 or value >= 1e-3 else f"{value:.2g}"


def _picture(axes: Any, values: NDArray[Any]) -> Any:
    return axes.imshow(values, vmin=0, vmax=1, aspect="auto")


def _flip_map(limit: float) -> Callable[..., Any]:
    return lambda axes, values: axes.imshow(
        values, cmap=style.SEQUENTIAL, vmin=0, vmax=limit, aspect="auto"
    )


def _signed_map(limit: float) -> Callable[..., Any]:
    return lambda axes, values: axes.imshow(
        values, cmap=style.DIVERGING, vmin=-limit, vmax=limit, aspect="auto"
    )

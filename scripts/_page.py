"""A page laid out in inches from its top left corner, for pictures with captions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fresnel_decomp.images import display
from fresnel_decomp.report import style

LABELS = style.MODEL_LABELS | {"exact": "Exact (reference)"}
GREY = "#606060"

Box = tuple[float, float, float]
"""Left, top and side of a square in a picture, as fractions of its side."""


class Page:
    """Make and save it inside `style.styled()`."""

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height = width, height
        self.figure = style.figure(width, height)

    def axes(self, x: float, y: float, width: float, height: float) -> Any:
        box = (
            x / self.width,
            1.0 - (y + height) / self.height,
            width / self.width,
            height / self.height,
        )
        return self.figure.add_axes(box)

    def write(self, x: float, y: float, text: str, **options: Any) -> None:
        """Text centred on a point, unless options say otherwise."""
        centred = {"ha": "center", "va": "center"}
        self.figure.text(x / self.width, 1.0 - y / self.height, text, **centred | options)

    def picture(
        self, x: float, y: float, side: float, image: np.ndarray, box: Box | None = None
    ) -> None:
        """A linear image as a screen shows it, with a box around what is shown enlarged."""
        axes = self.axes(x, y, side, side)
        axes.imshow(display(image), vmin=0, vmax=1, aspect="auto")
        axes.set_axis_off()
        if box is not None:
            left, top, size = (fraction * len(image) - 0.5 for fraction in box)
            axes.plot(
                [left, left + size, left + size, left, left],
                [top, top, top + size, top + size, top],
                color="white",
                lw=0.9,
            )

    def flip_map(self, x: float, y: float, side: float, values: np.ndarray, limit: float) -> Any:
        axes = self.axes(x, y, side, side)
        axes.set_axis_off()
        return axes.imshow(values, cmap=style.SEQUENTIAL, vmin=0, vmax=limit, aspect="auto")

    def flip_bar(self, x: float, y: float, width: float, mappable: Any) -> None:
        """The colour bar of FLIP maps; it needs .4 inch."""
        limit = mappable.get_clim()[1]
        self.colour_bar(
            x, y, width, mappable, "FLIP (0: no visible difference)",
            extend="max", extendfrac=0.03, format=lambda value, _: f"{value:g}",
            ticks=np.linspace(0.0, limit, 4 if f"{limit:e}"[0] in "36" else 5),
        )  # fmt: skip

    def colour_bar(
        self,
        x: float,
        y: float,
        width: float,
        mappable: Any,
        label: str,
        *,
        height: float = 0.09,
        size: float = 8.0,
        labelpad: float = 2.0,
        **options: Any,
    ) -> None:
        """A horizontal bar with its label below."""
        cax = self.axes(x, y, width, height)
        bar = self.figure.colorbar(mappable, cax=cax, orientation="horizontal", **options)
        bar.set_label(label, size=size, labelpad=labelpad)
        bar.ax.tick_params(labelsize=size - 0.5)
        bar.ax.grid(False)
        bar.outline.set_linewidth(0.5)

    def save(self, path: Path, dpi: float) -> None:
        style.save(self.figure, path, dpi=dpi)


def enlarged(image: np.ndarray, box: Box) -> np.ndarray:
    """The part of a square image that a box marks."""
    left, top, size = (round(fraction * len(image)) for fraction in box)
    return image[top : top + size, left : left + size]


def curve_looks(model: str) -> dict[str, Any]:
    """Looks of curves whose colour says the channel: the exact one wide and pale below the rest."""
    if model == "exact":
        return {"lw": 4.0, "alpha": 0.35, "solid_capstyle": "butt"}
    return {"lw": 1.4, "ls": style.MODEL_LINES[model]}


def caption(numbers: Mapping[str, float]) -> str:
    """The two numbers under a picture."""
    return f"ΔE$_{{00}}$ {numbers['delta_e']:.2f}, FLIP {numbers['flip']:.4f}"


def flip_limit(maps: Any) -> float:
    """One scale for all FLIP maps of a figure; the arrow of the bar stands for the rest."""
    return style.nice_limit(max(float(np.percentile(values, 99.5)) for values in maps))

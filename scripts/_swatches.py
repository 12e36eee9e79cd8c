"""Swatches of colours by angle, the exact one and a model's side by side, for a person to judge."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import _colour_models as models
from _page import Page
from fresnel_decomp import RECIPES, delta_e_2000, linear_to_srgb, load_material
from fresnel_decomp.colour import rgb_weights
from fresnel_decomp.fresnel import conductor
from fresnel_decomp.report import style

DEGREES = (0, 30, 50, 60, 70, 75, 80, 85)
TELLING = ("Au", "Cu", "Be", "VN", "TiN", "Te")
"""Coloured metals, and those that some model misses most."""

DEFAULT = models.spectral(next(iter(RECIPES)))


def swatches(name: str, illuminant: str = "D65") -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """(angles, 3) exact colours at `DEGREES`, and those of every model."""
    material = load_material(name)
    spectrum = conductor(models.COSINES[:, None], *material.at(models.WAVELENGTH_NM))
    exact = spectrum @ rgb_weights(illuminant).T
    curves = models.curves(material, illuminant, exact)
    at = list(DEGREES)
    return exact[at], {model: curve[at] for model, curve in curves.items()}


def draw_models(path: Path, names: Sequence[str]) -> None:
    """For each material a block of rows, one a model; each patch is exact on the left."""
    shown = [models.MITSUBA, models.BALANCED, "Schlick", "F82", "Gulbrandsen", DEFAULT]
    columns = 2
    blocks = -(-len(names) // columns)
    row_height, width = 0.27, 4.9
    height = blocks * (len(shown) * row_height + 0.62) + 0.3
    with style.styled():
        page = Page(columns * width, height)
        for index, name in enumerate(names):
            exact, curves = swatches(name)
            left = (index % columns) * width + 1.62
            top = 0.62 + (index // columns) * (len(shown) * row_height + 0.62)
            axes = page.axes(left, top, width - 1.75, len(shown) * row_height)
            image = np.ones((len(shown), 2 * len(DEGREES), 3))
            for row, model in enumerate(shown):
                image[row, 0::2], image[row, 1::2] = exact, curves[model]
            patches(axes, image)
            for row, model in enumerate(shown):
                label = "Decomposition" if model == DEFAULT else model
                axes.text(-0.65, row, label, ha="right", va="center", size=7.5)
                for column, value in enumerate(delta_e_2000(curves[model], exact)):
                    patch = curves[model][column]
                    number(axes, 2 * column + 1, row, value, patch)
            for column, degrees in enumerate(DEGREES):
                text = f"{degrees}°"
                axes.text(2 * column + 0.5, -0.62, text, ha="center", va="bottom", size=7.5)
            axes.text(-0.65, -0.62, name, ha="right", va="bottom", size=10.5, weight="bold")
        page.write(
            0.01 * columns * width,
            0.06,
            "Each patch: exact colour in D65 on the left, the model's on the right; ΔE00 on it.",
            ha="left",
            va="top",
            size=8.5,
        )
        page.save(path, dpi=150)


def draw_all(path: Path, names: Sequence[str]) -> None:
    """Every material in three rows: Mitsuba's RGB indices, exact, spectral coefficients."""
    columns = 3
    rows = -(-len(names) // columns)
    width, block = 3.3, 0.56
    height = rows * block + 0.62
    with style.styled():
        page = Page(columns * width, height)
        for index, name in enumerate(names):
            exact, curves = swatches(name)
            column, row = divmod(index, rows)
            axes = page.axes(column * width + 0.72, 0.55 + row * block, width - 0.82, 0.48)
            image = np.stack([curves[models.MITSUBA], exact, curves[DEFAULT]])
            patches(axes, image, aspect="auto")
            axes.text(-0.62, 1, name, ha="right", va="center", size=8)
            for line, model in ((0, models.MITSUBA), (2, DEFAULT)):
                worst = delta_e_2000(curves[model], exact)
                at = int(worst.argmax())
                number(axes, at, line, worst[at], curves[model][at])
            if row == 0:
                for at, degrees in enumerate(DEGREES):
                    axes.text(at, -0.7, f"{degrees}°", ha="center", va="bottom", size=7)
        page.write(
            0.01 * columns * width,
            0.05,
            "Rows of each material, under D65: one RGB index as Mitsuba makes it | exact | "
            "decomposition of the spectrum. Numbers: largest ΔE00 of the row.",
            ha="left",
            va="top",
            size=8.5,
        )
        page.save(path, dpi=150)


def patches(axes: Any, image: np.ndarray, aspect: str = "auto") -> None:
    axes.imshow(linear_to_srgb(image), aspect=aspect, interpolation="nearest")
    axes.set_axis_off()


def number(axes: Any, x: float, y: float, value: float, patch: np.ndarray) -> None:
    """A colour difference on a patch, in a colour that reads on it."""
    ink = "black" if patch @ [0.21, 0.72, 0.07] > 0.2 else "white"
    axes.text(x, y, f"{value:.1f}", ha="center", va="center", size=6, color=ink)

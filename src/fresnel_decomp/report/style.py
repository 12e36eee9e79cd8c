"""One look for every figure: colours of the models, type, resolution, whole files.

Figures are made with `matplotlib.figure.Figure` and never with pyplot, so that nothing here
chooses a backend for the notebook or program it runs in.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, cast

from .._files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "CHANNEL_COLOURS",
    "DIVERGING",
    "MODEL_COLOURS",
    "MODEL_LABELS",
    "MODEL_LINES",
    "RC",
    "RECIPE_COLOURS",
    "RECIPE_MARKERS",
    "SEQUENTIAL",
    "figure",
    "nice_limit",
    "save",
    "styled",
]

MODEL_COLOURS = {
    "exact": "#1a1a1a",
    "decomposition": "#0072b2",
    "schlick": "#d55e00",
    "f82": "#009e73",
    "lazanyi": "#cc79a7",
    "gulbrandsen": "#56b4e9",
}
"""After Okabe and Ito (2008): told apart with any colour vision, and in print."""

MODEL_LINES: dict[str, Any] = {
    "exact": "-",
    "decomposition": (0, (5, 1.5)),
    "schlick": (0, (1, 1.2)),
    "f82": (0, (4, 1.2, 1, 1.2)),
    "lazanyi": (0, (2.5, 1.2)),
    "gulbrandsen": (0, (6, 1.2, 1, 1.2, 1, 1.2)),
}
"""Dashes, so that colour is never the only difference."""

MODEL_LABELS = {
    "exact": "Exact",
    "decomposition": "Decomposition",
    "schlick": "Schlick",
    "f82": "F82",
    "lazanyi": "Lazanyi",
    "gulbrandsen": "Gulbrandsen",
}

RECIPE_COLOURS = {
    "notebook": "#1a1a1a",
    "talk": "#8a8a8a",
    "balanced": "#0072b2",
    "robust": "#009e73",
    "minimax": "#d55e00",
    "albedo": "#cc79a7",
}
RECIPE_MARKERS = dict(zip(RECIPE_COLOURS, "osD^vP", strict=True))

CHANNEL_COLOURS = {"R": "#c8322b", "G": "#2c8a3d", "B": "#2f5fc4"}

SEQUENTIAL = "magma"
DIVERGING = "RdBu_r"

RC: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same everywhere
    "mathtext.fontset": "dejavusans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "normal",
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.5,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "figure.dpi": 100.0,
    "savefig.dpi": 200.0,
    "figure.facecolor": "white",
    "svg.hashsalt": "fresnel_decomp",
}


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Draw in our style inside the block; matplotlib's settings are as before after it."""
    import matplotlib

    with matplotlib.rc_context(cast(Any, RC)):
        yield


def figure(width: float, height: float, **options: Any) -> Figure:
    """A figure of that size in inches, tied to no backend; make it inside `styled()`."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), **options)


def save(fig: Figure, path: str | os.PathLike[str], dpi: float = RC["savefig.dpi"]) -> None:
    """Write a figure, whole or not at all, without a date: equal figures give equal files."""
    suffix = os.path.splitext(path)[1].lower()
    undated: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with replacing(path) as temporary, styled():
        fig.savefig(temporary, dpi=dpi, metadata=undated.get(suffix))


def nice_limit(value: float) -> float:
    """The smallest round number that is at least `value`: an end for a colour bar."""
    if not value > 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(
        step * power for step in (1, 1.6, 2, 3, 4, 6, 8, 10) if step * power >= value * (1 - 1e-9)
    )

"""The figure of a basis: its functions over the angle and over the cosine, nodes marked."""

from __future__ import annotations

import os

import numpy as np

from ..basis import Basis
from . import style

__all__ = ["FUNCTION_COLOURS", "draw_basis"]

FUNCTION_COLOURS = ("#1a1a1a", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9")


def draw_basis(basis: Basis, path: str | os.PathLike[str]) -> None:
    """Write the figure of one basis; the closed form's error is in the second row."""
    degrees = np.linspace(0.0, 90.0, 1801)
    cosines = {"angle": np.cos(np.radians(degrees)), "cosine": np.linspace(0.0, 1.0, 2001)}
    places = {"angle": degrees, "cosine": cosines["cosine"]}
    nodes = {"angle": np.degrees(basis.nodes), "cosine": np.cos(basis.nodes)}
    axis_labels = {"angle": "angle of incidence (degrees)", "cosine": "cosine of that angle"}
    with style.styled():
        fig = style.figure(9.0, 4.7)
        grid = fig.add_gridspec(
            2, 2, height_ratios=(3, 1), left=0.08, right=0.985, top=0.86, bottom=0.11,
            hspace=0.12, wspace=0.16,
        )  # fmt: skip
        for column, kind in enumerate(cosines):
            above = fig.add_subplot(grid[0, column])
            below = fig.add_subplot(grid[1, column], sharex=above)
            cos_theta = np.clip(cosines[kind], 0.0, 1.0)
            values, closed = basis(cos_theta), basis.closed_form(cos_theta)
            for i in range(basis.terms):
                colour = FUNCTION_COLOURS[i]
                above.plot(places[kind], values[:, i], color=colour, label=f"$b_{i}$")
                below.plot(places[kind], (closed - values)[:, i], color=colour, lw=0.9)
            for node in nodes[kind]:
                above.axvline(node, color="#909090", lw=0.8, ls=":")
                below.axvline(node, color="#909090", lw=0.8, ls=":")
            above.tick_params(labelbottom=False)
            above.set_xlim(places[kind][0], places[kind][-1])
            if kind == "angle":
                above.set_xticks(range(0, 91, 15))
                above.set_ylabel("basis function")
                below.set_ylabel("closed form\n− extracted")
            below.set_xlabel(axis_labels[kind])
            below.ticklabel_format(axis="y", scilimits=(0, 0), useMathText=True)
        fig.suptitle(
            f"{basis.recipe}, {basis.terms} terms; nodes at "
            + ", ".join(f"{node:.4f}" for node in basis.nodes)
            + " rad (dotted)",
            x=0.08,
            y=0.975,
            ha="left",
            size=10.5,
        )
        handles, labels = fig.axes[0].get_legend_handles_labels()
        fig.legend(
            handles, labels, loc="upper right", ncols=basis.terms, frameon=False,
            bbox_to_anchor=(0.99, 0.985),
        )  # fmt: skip
        style.save(fig, path, dpi=150)

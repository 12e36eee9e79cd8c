"""Figure 2 of the talk: an edge tint that Schlick's approximation cannot show.

First compute, then draw:

    python scripts/fig02_edge_tint.py compute
    python scripts/fig02_edge_tint.py draw
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from _figure import Figure, Job, read_table
from _figure_commands import commands, main
from _page import Page, caption, curve_looks, flip_limit
from _renders import MODELS, Case, read_case, render_cases, write_curves
from fresnel_decomp.report import style
from fresnel_decomp.subjects import from_gulbrandsen

NAME = "fig02_edge_tint"
REFLECTIVITY = (0.44, 0.44, 0.44)
EDGE_TINT = (0.0, 1.0, 0.0)
ALPHA = 0.08
TITLES = {
    "exact": "Monte-Carlo reference",
    "decomposition": "Decomposition",
    "schlick": "Schlick",
}


def compute(job: Job) -> dict[str, Any]:
    subject = from_gulbrandsen(REFLECTIVITY, EDGE_TINT)
    errors = write_curves(job.folder / "curves.csv", subject)
    return {
        "eta_rgb": subject.eta.tolist(),
        "k_rgb": subject.k.tolist(),
        "largest_curve_error": errors,
        "renders": render_cases(job, [Case("edge", subject, ALPHA)]),
    }


def draw(folder: Path, pictures: Path) -> None:
    """Renders side by side; below them the curves and the FLIP maps."""
    table = read_table(folder / "curves.csv")
    rendered = read_case(NAME, folder, "edge")
    side, gap, left, top = 2.6, 0.08, 0.12, 0.66
    lower = top + side + 0.36
    limit = flip_limit(rendered.flip_maps.values())
    with style.styled():
        page = Page(2 * left + 3 * side + 2 * gap, lower + side + 0.56)
        page.write(left, 0.2, f"r = (0.44, 0.44, 0.44), g = (0, 1, 0), α = {ALPHA:g}",
                   ha="left", size=11)  # fmt: skip
        mappable = None
        for column, model in enumerate(MODELS):
            x = left + column * (side + gap)
            page.write(x + side / 2, top - 0.14, TITLES[model], size=10)
            page.picture(x, top, side, rendered.images[model])
            if model != "exact":
                text = caption(rendered.numbers[model])
                page.write(x + side / 2, top + side + 0.15, f"mean {text}", size=9)
                values = rendered.flip_maps[model]
                mappable = page.flip_map(x, lower, side, values, limit)
        page.flip_bar(left + side + gap + 0.4, lower + side + 0.1, 2 * side + gap - 0.8, mappable)

        draw_curves(page.axes(left + 0.46, lower + 0.02, side - 0.62, side - 0.02), table)
        page.save(pictures / FIGURE.pictures[0], dpi=130)


def draw_curves(axes: Any, table: Mapping[str, np.ndarray]) -> None:
    """Reflectance of the tinted channel and of the other two, which are alike."""
    neutral, tinted, untinted = "#303030", style.CHANNEL_COLOURS["G"], "#8d3a86"
    curves = [
        *((model, "G", tinted) for model in ("exact", "decomposition")),
        *((model, "R", untinted) for model in ("exact", "decomposition")),
        ("schlick", "G", neutral),  # the same in all channels
    ]
    for model, channel, colour in curves:
        values = table[f"{model}_{channel}"]
        axes.plot(table["theta_deg"], values, color=colour, **curve_looks(model))
    for model in MODELS:
        axes.plot([], [], color=neutral, label=style.MODEL_LABELS[model], **curve_looks(model))
    axes.plot([], [], color=tinted, label="green, g = 1")
    axes.plot([], [], color=untinted, label="red, blue, g = 0")
    axes.legend(loc="upper left", fontsize=8, handlelength=2.4, borderaxespad=0.2)
    axes.set_xlim(0, 90)
    axes.set_xticks(range(0, 91, 30))
    axes.set_ylim(0.3, 1.02)
    axes.set_xlabel("angle of incidence (degrees)")
    axes.set_ylabel("reflectance")


FIGURE = Figure(
    name=NAME,
    title="Talk, Figure 2: edge tint, r = .44, g = (0, 1, 0), alpha = .08",
    minutes=0.6,
    compute=compute,
    draw=draw,
    pictures=(f"{NAME}.png",),
    parameters={"r": REFLECTIVITY, "g": EDGE_TINT, "alpha": ALPHA},
    scene="studio",
    size=400,
)

command = commands(FIGURE)

if __name__ == "__main__":
    main(command)

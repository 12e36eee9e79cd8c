"""Figure 1b of the talk: beryllium's curve and renders, exact, decomposed and by Schlick.

First compute, then draw:

    python scripts/fig01b_beryllium.py compute
    python scripts/fig01b_beryllium.py draw
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from _figure import Figure, Job, read_sidecar, read_table
from _figure_commands import commands, main
from _page import LABELS, Page, caption, curve_looks, enlarged, flip_limit
from _renders import MODELS, Case, read_case, render_cases, write_curves
from fresnel_decomp.report import style
from fresnel_decomp.subjects import from_material

NAME = "fig01b_beryllium"
MATERIAL = "Be"
ALPHA = 0.1
RIM = (0.6, 0.1, 0.3)


def compute(job: Job) -> dict[str, Any]:
    subject = from_material(MATERIAL)
    errors = write_curves(job.folder / "curves.csv", subject)
    return {
        "eta_rgb": subject.eta.tolist(),
        "k_rgb": subject.k.tolist(),
        "largest_curve_error": errors,
        "renders": render_cases(job, [Case(MATERIAL, subject, ALPHA)]),
    }


def draw(folder: Path, pictures: Path) -> None:
    """Curves and residuals on the left; renders, their rims and FLIP maps on the right."""
    table = read_table(folder / "curves.csv")
    errors = read_sidecar(NAME, folder)["results"]["largest_curve_error"]
    rendered = read_case(NAME, folder, MATERIAL)
    side, gap, top, left = 1.66, 0.07, 0.62, 5.0
    second, third = top + side + 0.3, top + 2 * side + 0.3 + gap
    limit = flip_limit(rendered.flip_maps.values())
    with style.styled():
        page = Page(left + 3 * side + 2 * gap + 0.1, third + side + 0.6)
        page.write(0.74, 0.2, f"Beryllium, α = {ALPHA:g}", ha="left", size=11)
        draw_curves(page, table, max(errors.values()), top, third + side)
        mappable = None
        for column, model in enumerate(MODELS):
            x = left + column * (side + gap)
            page.write(x + side / 2, top - 0.13, LABELS[model], size=9.5)
            page.picture(x, top, side, rendered.images[model], RIM)
            page.picture(x, second, side, enlarged(rendered.images[model], RIM))
            if model != "exact":
                text = caption(rendered.numbers[model])
                page.write(x + side / 2, top + side + 0.14, text, size=8.5)
                mappable = page.flip_map(x, third, side, rendered.flip_maps[model], limit)
        page.write(left - 0.15, second + side / 2, "enlarged", rotation=90, size=9.5)
        page.write(left + side - 0.08, third + side / 2, "FLIP", rotation=90, size=9.5)
        x = left + side + gap + 0.3
        page.flip_bar(x, third + side + 0.1, 2 * side + gap - 0.6, mappable)
        page.save(pictures / FIGURE.pictures[0], dpi=140)


def draw_curves(
    page: Page, table: Mapping[str, np.ndarray], largest: float, top: float, bottom: float
) -> None:
    """Curves of the three channels over their residuals, between two heights of the page."""
    split = top + 0.62 * (bottom - top)
    curves = page.axes(0.74, top, 3.75, split - top - 0.06)
    residuals = page.axes(0.74, split + 0.06, 3.75, bottom - split - 0.06)
    for channel, colour in style.CHANNEL_COLOURS.items():
        for model in MODELS:
            values = table[f"{model}_{channel}"]
            curves.plot(table["theta_deg"], values, color=colour, **curve_looks(model))
            if model != "exact":
                error = values - table[f"exact_{channel}"]
                residuals.plot(table["theta_deg"], error, color=colour, **curve_looks(model))
    for model in MODELS:
        label = style.MODEL_LABELS[model]
        curves.plot([], [], color="#303030", label=label, **curve_looks(model))
    for channel, name in zip(style.CHANNEL_COLOURS, ("red", "green", "blue"), strict=True):
        curves.plot([], [], color=style.CHANNEL_COLOURS[channel], label=name)
    curves.legend(loc="upper left", ncols=2, columnspacing=1.4, handlelength=2.4)
    low = min(float(table[f"exact_{channel}"].min()) for channel in style.CHANNEL_COLOURS)
    curves.set_ylim(low - 0.04, 1.02)
    curves.set_ylabel("reflectance")
    curves.tick_params(labelbottom=False)
    residuals.set_yscale("symlog", linthresh=1e-3)
    residuals.set_ylim(-1.6 * largest, 1.6 * largest)
    powers = [p for p in (-3, -2, -1) if 10.0**p <= largest]
    residuals.set_yticks(
        [*(-(10.0**p) for p in powers[::-1]), 0.0, *(10.0**p for p in powers)],
        [*(f"−$10^{{{p}}}$" for p in powers[::-1]), "0", *(f"$10^{{{p}}}$" for p in powers)],
    )
    residuals.minorticks_off()
    residuals.set_ylabel("model − exact")
    residuals.set_xlabel("angle of incidence (degrees)")
    for axes in (curves, residuals):
        axes.set_xlim(0, 90)
        axes.set_xticks(range(0, 91, 15))
        axes.yaxis.set_label_coords(-0.145, 0.5)


FIGURE = Figure(
    name=NAME,
    title="Talk, Figure 1b: a beryllium curve and render against Schlick's",
    minutes=0.5,
    compute=compute,
    draw=draw,
    pictures=(f"{NAME}.png",),
    parameters={"material": MATERIAL, "alpha": ALPHA},
    scene="studio",
    size=400,
)

command = commands(FIGURE)

if __name__ == "__main__":
    main(command)

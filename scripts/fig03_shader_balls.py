"""Shader balls of chromium, rhodium and tungsten from smooth to rough.

First compute, then draw:

    python scripts/fig03_shader_balls.py compute
    python scripts/fig03_shader_balls.py draw
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from _figure import Figure, Job
from _figure_commands import commands, main
from _page import LABELS, Page, flip_limit
from _renders import MODELS, Case, read_case, render_cases
from fresnel_decomp.report import style
from fresnel_decomp.subjects import from_material

NAME = "fig03_shader_balls"
MATERIALS = {"Cr": "Chromium", "Rh": "Rhodium", "W": "Tungsten"}
ALPHAS = (0.02, 0.1, 0.3)


def stem(material: str, alpha: float) -> str:
    return f"{material}_alpha{alpha:g}"


def compute(job: Job) -> dict[str, Any]:
    subjects = {material: from_material(material) for material in MATERIALS}
    cases = [
        Case(stem(material, alpha), subjects[material], alpha)
        for material in MATERIALS
        for alpha in ALPHAS
    ]
    return {"renders": render_cases(job, cases)}


def draw(folder: Path, pictures: Path) -> None:
    """A picture per metal with a row per roughness; all FLIP maps have one scale."""
    rendered = {
        (material, alpha): read_case(NAME, folder, stem(material, alpha))
        for material in MATERIALS
        for alpha in ALPHAS
    }
    limit = flip_limit(v for r in rendered.values() for v in r.flip_maps.values())
    side, gap, left, top, below = 1.62, 0.06, 0.42, 0.62, 0.22
    for (material, full_name), picture in zip(MATERIALS.items(), FIGURE.pictures, strict=True):
        with style.styled():
            columns = 2 * len(MODELS) - 1
            width = left + columns * (side + gap) + 0.2
            page = Page(width, top + len(ALPHAS) * (side + gap + below) + 0.5)
            page.write(left, 0.2, full_name, ha="left", size=11)
            mappable = None
            for row, alpha in enumerate(ALPHAS):
                y = top + row * (side + gap + below)
                page.write(left - 0.16, y + side / 2, f"α = {alpha:g}", rotation=90, size=9.5)
                case = rendered[material, alpha]
                for column, model in enumerate(MODELS):
                    x = left + column * (side + gap)
                    page.picture(x, y, side, case.images[model])
                    if row == 0:
                        page.write(x + side / 2, top - 0.13, LABELS[model], size=9.5)
                    if model == "exact":
                        continue
                    text = f"ΔE$_{{00}}$ {case.numbers[model]['delta_e']:.2f}"
                    page.write(x + side / 2, y + side + below / 2, text, size=8.5)
                    x = left + (column + 2) * (side + gap) + 0.08
                    mappable = page.flip_map(x, y, side, case.flip_maps[model], limit)
                    if row == 0:
                        page.write(x + side / 2, top - 0.13, f"FLIP: {LABELS[model]}", size=9.5)
                    text = f"mean {case.numbers[model]['flip']:.4f}"
                    page.write(x + side / 2, y + side + below / 2, text, size=8.5)
            x = left + 3 * (side + gap) + 0.08
            page.flip_bar(
                x + 0.2, top + len(ALPHAS) * (side + gap + below), 2 * side + gap - 0.4, mappable
            )
            page.save(pictures / picture, dpi=108)


FIGURE = Figure(
    name=NAME,
    title="Shader balls of Cr, Rh and W at alpha = .02, .1 and .3",
    minutes=3.8,
    compute=compute,
    draw=draw,
    pictures=tuple(f"{NAME}_{material}.png" for material in MATERIALS),
    parameters={"materials": list(MATERIALS), "alphas": ALPHAS},
    scene="shader-ball",
    size=256,
)

command = commands(FIGURE)

if __name__ == "__main__":
    main(command)

"""Figure 1c of the talk: beryllium from smooth to rough.

First compute, then draw:

    python scripts/fig01c_roughness.py compute
    python scripts/fig01c_roughness.py draw
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from _figure import Figure, Job
from _figure_commands import commands, main
from _page import LABELS, Page, caption
from _renders import MODELS, Case, read_case, render_cases
from fresnel_decomp.report import style
from fresnel_decomp.subjects import from_material

NAME = "fig01c_roughness"
MATERIAL = "Be"
ALPHAS = (0.05, 0.1, 0.2, 0.4, 0.6)


def stem(alpha: float) -> str:
    return f"{MATERIAL}_alpha{alpha:g}"


def compute(job: Job) -> dict[str, Any]:
    subject = from_material(MATERIAL)
    cases = [Case(stem(alpha), subject, alpha) for alpha in ALPHAS]
    return {"renders": render_cases(job, cases)}


def draw(folder: Path, pictures: Path) -> None:
    """A column per roughness, a row per model."""
    side, gap, left, top, below = 1.62, 0.06, 0.42, 0.62, 0.22
    with style.styled():
        width = left + len(ALPHAS) * (side + gap) + 0.08
        page = Page(width, top + 3 * side + 2 * below + 2 * gap + 0.08)
        page.write(left, 0.2, "Beryllium, from smooth to rough", ha="left", size=11)
        for column, alpha in enumerate(ALPHAS):
            x, y = left + column * (side + gap), top
            rendered = read_case(NAME, folder, stem(alpha))
            page.write(x + side / 2, top - 0.13, f"α = {alpha:g}", size=9.5)
            for model in MODELS:
                page.picture(x, y, side, rendered.images[model])
                if column == 0:
                    page.write(left - 0.16, y + side / 2, LABELS[model], rotation=90, size=9.5)
                if model != "exact":
                    text = caption(rendered.numbers[model])
                    page.write(x + side / 2, y + side + below / 2, text, size=8)
                    y += below
                y += side + gap
        page.save(pictures / FIGURE.pictures[0], dpi=125)


FIGURE = Figure(
    name=NAME,
    title="Talk, Figure 1c: varying roughness",
    minutes=1.2,
    compute=compute,
    draw=draw,
    pictures=(f"{NAME}.png",),
    parameters={"material": MATERIAL, "alphas": ALPHAS},
    scene="studio",
    size=256,
)

command = commands(FIGURE)

if __name__ == "__main__":
    main(command)

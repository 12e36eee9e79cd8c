"""The principled BSDF: its Fresnel terms against exact curves, its energy, its cost, its looks.

    python scripts/principled_study.py --page docs/principled.md   # what is missing, then draw
    python scripts/principled_study.py --quick                     # tiny, to see that it runs

Interrupt it when you like: finished images are kept, and the same command goes on from them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import metal_edge
from _figure import Figure, read_sidecar
from _figure_commands import main, study
from _markdown import markdown, marks
from _page import GREY, Page
from _principled import (
    CARD,
    COPPER,
    COSINES,
    METALLIC,
    ROUGHNESS,
    Results,
    compute,
    exact_metal,
    metal_curves,
)
from fresnel_decomp.images import compare, read_exr
from fresnel_decomp.report import style

NAME = "principled_study"
MARKS = {
    name: marks(name)
    for name in (
        "curves", "mixing", "furnace", "indices", "cost", "pictures", "metals", "colours", "ranges"
    )
}  # fmt: skip
# --- tables --------------------------------------------------------------------------------------


def tables(results: Results) -> dict[str, str]:
    terms = list(next(iter(results["curves"].values())))
    curves = markdown(
        ["RMSE · largest · ΔE00", *terms],
        [
            [
                label,
                *(
                    f"{row[t]['rmse']:.4f} · {row[t]['largest']:.3f} · {row[t]['delta_e']:.2f}"
                    for t in terms
                ),
            ]
            for label, row in results["curves"].items()
        ],
    )
    recipes = markdown(
        ["plastic, η = 1.5", "RMSE", "largest error", "albedo at 60°, roughness 0.5"],
        [
            [name, f"{row['rmse']:.5f}", f"{row['largest']:.4f}", f"{100 * row['albedo']:+.2f} %"]
            for name, row in results["recipes"].items()
        ],
    )
    mixing = markdown(
        ["plastic and, at metallic", *next(iter(results["mixing"].values()))],
        [
            [name, *(f"{value:.3f}" for value in row.values())]
            for name, row in results["mixing"].items()
        ],
    )
    columns = list(next(iter(results["furnace"].values())))
    energy = markdown(
        ["roughness", *columns],
        [
            [roughness, *(f"{row[c]:.4f}" for c in columns)]
            for roughness, row in results["furnace"].items()
        ],
    )
    columns = list(next(iter(results["indices"].values())))
    indices = markdown(
        ["exact, white base", *columns],
        [[name, *(f"{row[c]:+.4f}" for c in columns)] for name, row in results["indices"].items()],
    )
    methods = list(next(iter(results["cost"].values())))
    cost = markdown(
        ["time, Mitsuba's principled = 1", *methods],
        [
            [name, *(f"{row[m][0]:.2f} ± {row[m][1]:.2f}" for m in methods)]
            for name, row in results["cost"].items()
        ],
    )
    names = {"schlick": "Schlick", "usual": "usual edge", "edge": "edge colour",
             "nodes": "node colours"}  # fmt: skip
    pictures = markdown(
        ["mean ΔE00 of the picture", *names.values()],
        [
            [metal, *(f"{results['renders'][metal][n]['delta_e']:.2f}" for n in names)]
            for metal in ("Au", "Cu")
        ],
    )
    beside = ", ".join(
        f"{results['renders'][m]['delta_e']:.2f} at metallic {m}" for m in ("0", "0.5", "1")
    )
    return {
        "curves": f"{curves}\n\n{recipes}",
        "mixing": mixing,
        "furnace": energy,
        "indices": indices,
        "cost": cost,
        "pictures": f"{pictures}\n\nBetween ours and Mitsuba's principled: {beside}.",
    }


# --- drawing -------------------------------------------------------------------------------------


def draw(folder: Path, pictures: Path) -> None:
    results = read_sidecar(NAME, folder)["results"]
    draw_grid(folder, pictures / FIGURE.pictures[0])
    draw_edges(results, folder, pictures / FIGURE.pictures[1])
    draw_comparison(results, folder, pictures / FIGURE.pictures[2])


def draw_grid(folder: Path, path: Path) -> None:
    """Metallic over roughness, and beside it one with textures."""
    side, gap, left, top, ball = 1.0, 0.04, 0.62, 0.42, 3.3
    height = top + len(METALLIC) * (side + gap)
    with style.styled():
        page = Page(left + len(ROUGHNESS) * (side + gap) + 0.25 + ball + 0.08, height + 0.06)
        for column, roughness in enumerate(ROUGHNESS):
            x = left + column * (side + gap) + side / 2
            page.write(x, top - 0.11, f"{roughness:g}", size=8.5)
        page.write(left + 2.5 * (side + gap), 0.12, "roughness", size=9.5)
        page.write(0.1, top + 2.5 * (side + gap), "metallic", size=9.5, rotation=90)
        for row, metallic in enumerate(METALLIC):
            y = top + row * (side + gap)
            page.write(left - 0.2, y + side / 2, f"{metallic:g}", size=8.5)
            for column, roughness in enumerate(ROUGHNESS):
                image = read_exr(folder / f"grid_{metallic:g}_{roughness:g}.exr")
                page.picture(left + column * (side + gap), y, side, image)
        x = left + len(ROUGHNESS) * (side + gap) + 0.25
        y = 0.5 * (height - ball) + 0.3
        page.write(x + ball / 2, y - 0.32, "base colour, metallic and roughness", size=9)
        page.write(x + ball / 2, y - 0.14, "from images: worn paint on copper", size=9)
        page.picture(x, y, ball, read_exr(folder / "images_textured.exr"))
        page.save(path, dpi=120)


TITLES = {
    "exact": "measured spectrum",
    "schlick": "base colour,\nSchlick",
    "usual": "base colour,\nusual edge",
    "edge": "and edge colour\nat 82°",
    "nodes": "and colours\nat the nodes",
}


def draw_edges(results: Results, folder: Path, path: Path) -> None:
    """Gold and copper by what is known of their edges; below each its curves' errors."""
    side, gap, left, top, below = 1.7, 0.06, 0.36, 0.5, 0.24
    colours = {"schlick": style.MODEL_COLOURS["schlick"], "usual": style.MODEL_COLOURS["f82"],
               "edge": style.MODEL_COLOURS["decomposition"],
               "nodes": style.MODEL_COLOURS["lazanyi"]}  # fmt: skip
    curve_names = {"schlick": "schlick", "usual": "decomposition",
                   "edge": "decomposition, edge colour",
                   "nodes": "decomposition, node colours"}  # fmt: skip
    block, plot = side + below, 1.5
    width = left + len(TITLES) * (side + gap) + 0.06
    with style.styled():
        page = Page(width, top + 2 * block + 0.35 + plot + 0.55)
        for row, (metal, label) in enumerate((("Au", "gold"), ("Cu", "copper"))):
            y = top + row * block
            page.write(left - 0.16, y + side / 2, label, rotation=90, size=10)
            for column, (name, title) in enumerate(TITLES.items()):
                x = left + column * (side + gap)
                page.picture(x, y, side, read_exr(folder / f"edge_{metal}_{name}.exr"))
                if row == 0:
                    page.write(x + side / 2, top - 0.06, title, size=8.5, va="bottom")
                if name != "exact":
                    value = results["renders"][metal][name]["delta_e"]
                    page.write(x + side / 2, y + side + below / 2, f"ΔE$_{{00}}$ {value:.2f}",
                               size=8)  # fmt: skip
        y = top + 2 * block + 0.35
        half = (width - left - 0.3) / 2
        for column, (metal, label) in enumerate((("Au", "gold"), ("Cu", "copper"))):
            axes = page.axes(left + 0.32 + column * (half + 0.1), y, half - 0.42, plot)
            exact, *given = exact_metal(metal)
            curves = metal_curves(*given)
            angles = np.degrees(np.arccos(COSINES.clip(0.0, 1.0)))
            for name, curve_name in curve_names.items():
                error = np.abs(curves[curve_name] - exact).max(axis=1)
                axes.plot(angles, error.clip(1e-6), color=colours[name], lw=1.3,
                          label=TITLES[name].replace("\n", " "))  # fmt: skip
            axes.set_yscale("log")
            axes.set_ylim(1e-4, 0.3)
            axes.set_xlim(0, 90)
            axes.set_xticks(range(0, 91, 15))
            axes.set_xlabel("angle of incidence (degrees)")
            axes.set_title(f"{label}: largest error of a channel", size=9)
            if column == 0:
                axes.set_ylabel("error of reflectance")
            else:  # where its curves leave room
                axes.legend(fontsize=7.5, loc="upper left")
        page.save(path, dpi=115)


def draw_comparison(results: Results, folder: Path, path: Path) -> None:
    """Mitsuba's principled and ours, and where they differ."""
    side, gap, left, top = 2.0, 0.06, 0.62, 0.3
    limit = 0.0
    maps, images = {}, {}
    for metallic in ("0", "0.5", "1"):
        pair = [read_exr(folder / f"mitsuba_{metallic}_{name}.exr") for name in ("theirs", "ours")]
        images[metallic], maps[metallic] = pair, compare(*pair).flip_map
        limit = max(limit, float(np.percentile(maps[metallic], 99.5)))
    limit = style.nice_limit(limit)
    with style.styled():
        page = Page(left + 3 * (side + gap) + 0.06, top + 3 * (side + gap) + 0.5)
        titles = ("Mitsuba's principled", "decomposed_principled", "difference, FLIP")
        mappable = None
        for row, metallic in enumerate(images):
            y = top + row * (side + gap)
            page.write(0.14, y + side / 2, f"metallic {metallic}", rotation=90, size=9.5)
            value = results["renders"][metallic]["delta_e"]
            page.write(0.38, y + side / 2, f"ΔE$_{{00}}$ {value:.2f}", rotation=90, size=8.5,
                       color=GREY)  # fmt: skip
            for column, title in enumerate(titles):
                x = left + column * (side + gap)
                if row == 0:
                    page.write(x + side / 2, top - 0.12, title, size=9)
                if column < 2:
                    page.picture(x, y, side, images[metallic][column])
                else:
                    mappable = page.flip_map(x, y, side, maps[metallic], limit)
        page.flip_bar(left + 2 * (side + gap) + 0.1, top + 3 * (side + gap) + 0.06, side - 0.2,
                      mappable)  # fmt: skip
        page.save(path, dpi=120)


FIGURE = Figure(
    name=NAME,
    title="Principled BSDF: Fresnel terms, energy, cost, metallic over roughness",
    minutes=6.0,
    compute=compute,
    draw=draw,
    pictures=("principled_grid.png", "principled_edges.png", "principled_mitsuba.png"),
    parameters={
        "base_color": COPPER,
        "metallic": METALLIC,
        "roughness": ROUGHNESS,
        "card": CARD,
    },
    scene="studio",
    size=192,
    spp=64,
)


command = study(FIGURE, lambda results: tables(results) | metal_edge.tables(), MARKS)


if __name__ == "__main__":
    main(command)

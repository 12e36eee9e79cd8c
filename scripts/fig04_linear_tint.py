"""Edge tint on a linear scale: equal steps of beta look equal, equal steps of g do not.

First compute, then draw:

    python scripts/fig04_linear_tint.py compute
    python scripts/fig04_linear_tint.py draw

The tint goes from blue to red, (g_R, g_G, g_B) = (t, 1/2, 1 - t), and the same for beta, at one
reflectivity. Everything is rendered with the decomposition.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from _figure import Figure, Job, read_sidecar, read_table, write_table
from _figure_commands import commands, main
from _page import Page
from fresnel_decomp import Gulbrandsen, LinearTint, convert, delta_e_2000, load_basis
from fresnel_decomp.images import read_exr, write_exr
from fresnel_decomp.report import style

NAME = "fig04_linear_tint"
REFLECTIVITY = 0.6
ALPHA = 0.15
STEPS = 7
CURVES = (0.2, 0.4, 0.6, 0.8, 0.95)
SCALES = {"g": "edge tint g", "beta": "linear β"}
COLOURS = {"g": "#d55e00", "beta": "#0072b2"}


def coefficients(scale: str, r: Any, value: Any) -> np.ndarray:
    """(..., terms) of the default basis."""
    basis = load_basis()
    r, value = np.broadcast_arrays(np.asarray(r, float), np.asarray(value, float))
    if scale == "beta":
        return LinearTint(r, value, basis).coefficients
    return convert(Gulbrandsen(r, value), "coefficients", basis=basis).value.coefficients


def tint(step: int) -> np.ndarray:
    t = step / (STEPS - 1)
    return np.array([t, 0.5, 1.0 - t])


def compute(job: Job) -> dict[str, Any]:
    values = np.linspace(0.0, 1.0, 101)
    columns = {"value": values}
    for scale in SCALES:
        for r in CURVES:
            c = coefficients(scale, r, values)[:, 2:]
            length = np.linalg.norm(c - c[0], axis=1)
            columns[f"{scale}_{r:g}"] = length / length[-1]
        c = coefficients(scale, REFLECTIVITY, values)
        columns |= {f"{scale}_c2": c[:, 2], f"{scale}_c3": c[:, 3]}
    write_table(job.folder / "spacing.csv", columns)
    images = render(job)
    steps = {
        scale: [float(delta_e_2000(a, b).mean()) for a, b in itertools.pairwise(pictures)]
        for scale, pictures in images.items()
    }
    return {
        "delta_e_of_steps": steps,
        "largest_to_smallest": {scale: max(found) / min(found) for scale, found in steps.items()},
    }


def render(job: Job) -> dict[str, list[np.ndarray]]:
    """Spheres for every step; those of an earlier run are read."""
    from fresnel_decomp.mitsuba.comparison import render_scene
    from fresnel_decomp.mitsuba.scenes import load_scene
    from fresnel_decomp.mitsuba.variants import variant_scope

    images: dict[str, list[np.ndarray]] = {scale: [] for scale in SCALES}
    with variant_scope(job.settings["variant"]):
        for scale in SCALES:
            for step in range(STEPS):
                path = job.folder / f"{scale}_{step}.exr"
                if not path.is_file():
                    c = coefficients(scale, REFLECTIVITY, tint(step))
                    bsdf = {
                        "type": "decomposed_conductor",
                        "distribution": "ggx",
                        "alpha": ALPHA,
                        **{f"c{i}": {"type": "rgb", "value": c[:, i].tolist()} for i in range(4)},
                    }
                    scene = load_scene(job.settings["scene"], bsdf, job.settings["size"])
                    image = render_scene(scene, job.settings["spp"], job.settings["seed"])
                    write_exr(path, image)
                images[scale].append(read_exr(path))
                done = sum(map(len, images.values()))
                job.report(f"{scale}, step {step + 1}", done / (STEPS * len(SCALES)))
    return images


def draw(folder: Path, pictures: Path) -> None:
    table = read_table(folder / "spacing.csv")
    results = read_sidecar(NAME, folder)["results"]
    side, gap, left, top = 1.22, 0.05, 0.98, 3.4
    width = left + STEPS * (side + gap) + 0.1
    with style.styled():
        page = Page(width, top + 2 * (side + 0.34) + 0.16)
        draw_distance(page.axes(0.62, 0.36, 2.55, 2.3), table)
        draw_plane(page.axes(3.95, 0.36, 2.55, 2.3), table)
        draw_steps(page.axes(7.2, 0.36, 2.55, 2.3), results["delta_e_of_steps"])
        for row, (scale, label) in enumerate(SCALES.items()):
            y = top + row * (side + 0.34)
            ratio = results["largest_to_smallest"][scale]
            page.write(0.1, y + side / 2 - 0.14, label, ha="left", size=9, color=COLOURS[scale])
            page.write(0.1, y + side / 2 + 0.1, f"steps 1 : {ratio:.1f}", ha="left", size=8)
            symbol = "g" if scale == "g" else "β"
            for step in range(STEPS):
                x = left + step * (side + gap)
                page.picture(x, y, side, read_exr(folder / f"{scale}_{step}.exr"))
                text = ", ".join(f"{v:.2g}" for v in tint(step))
                page.write(x + side / 2, y + side + 0.1, f"{symbol} = ({text})", size=6.5)
        page.save(pictures / FIGURE.pictures[0], dpi=130)


def draw_distance(axes: Any, table: dict[str, np.ndarray]) -> None:
    """How far the coefficients have come."""
    axes.plot(table["value"], table["beta_0.6"], color=COLOURS["beta"], lw=2.0, label="β, any r")
    for i, r in enumerate(CURVES):
        shade = 0.35 + 0.65 * i / (len(CURVES) - 1)
        label = f"g, r = {r:g}"
        curve = table[f"g_{r:g}"]
        axes.plot(table["value"], curve, color=COLOURS["g"], alpha=shade, lw=1.3, label=label)
    axes.legend(fontsize=6.5, loc="upper left", borderaxespad=0.1, labelspacing=0.25)
    axes.set_xlabel("g or β")
    axes.set_ylabel("way of the coefficients from 0 to 1", size=8)
    axes.set_title("Spacing", loc="left", size=9)


def draw_plane(axes: Any, table: dict[str, np.ndarray]) -> None:
    """Equal steps of both scales in the plane of c_2 and c_3."""
    for scale, marker in (("g", "o"), ("beta", "s")):
        c2, c3 = table[f"{scale}_c2"], table[f"{scale}_c3"]
        axes.plot(c2, c3, color=COLOURS[scale], lw=1.0)
        axes.plot(c2[::10], c3[::10], marker, color=COLOURS[scale], ms=4, label=SCALES[scale])
    axes.set_xlabel("$c_2$")
    axes.set_ylabel("$c_3$")
    axes.legend(loc="best", fontsize=7.5)
    axes.set_title(f"Steps of 0.1, r = {REFLECTIVITY:g}", loc="left", size=9)


def draw_steps(axes: Any, steps: dict[str, list[float]]) -> None:
    """Colour differences between neighbouring renders."""
    for i, (scale, values) in enumerate(steps.items()):
        at = np.arange(len(values)) + (i - 0.5) * 0.38
        axes.bar(at, values, 0.36, color=COLOURS[scale], label=SCALES[scale])
    axes.set_xticks(range(STEPS - 1), [f"{i + 1}–{i + 2}" for i in range(STEPS - 1)])
    axes.set_xlabel("neighbouring renders below")
    axes.set_ylabel("mean ΔE$_{00}$ between them", size=8)
    axes.legend(fontsize=7.5, loc="upper center")
    axes.set_ylim(0.0, 1.35 * max(map(max, steps.values())))


FIGURE = Figure(
    name=NAME,
    title="Edge tint from blue to red: steps of g and of the linear beta",
    minutes=2.0,
    compute=compute,
    draw=draw,
    pictures=(f"{NAME}.png",),
    parameters={"r": REFLECTIVITY, "alpha": ALPHA, "steps": STEPS, "curves": CURVES},
    scene="studio",
    size=240,
)

command = commands(FIGURE)

if __name__ == "__main__":
    main(command)

"""Inverse rendering: error against time and samples, for every route from good and bad starts.

    python scripts/inverse_study.py --page docs/inverse.md

Five images of a gold sphere, with the exact Fresnel term of Mitsuba's `roughconductor` and random
numbers of their own, are what everything is recovered from. Interrupt it when you like: finished
runs are kept, and the same command goes on from them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from _figure import Figure, read_sidecar
from _figure_commands import main, study
from _inverse import (
    ALPHA,
    CASES,
    METALS,
    REPEAT_SIZE,
    REPEAT_VIEWS,
    REPEATS,
    SPP,
    TEXELS,
    VIEWS,
    WAVELENGTHS,
    compute,
)
from _markdown import markdown, marks
from _page import GREY, Page
from fresnel_decomp.images import read_exr
from fresnel_decomp.report import style

NAME = "inverse_study"
MARKS = marks("inverse study")
METAL_MARKS = marks("inverse metals")
CALIBRATION_MARKS = marks("inverse errors")
TEXTURE_MARKS = marks("inverse texture")

# --- tables --------------------------------------------------------------------------------------


def short(value: float | None) -> str:
    """Two digits."""
    if value is None:
        return "∞"
    if value == 0.0:
        return "0"
    if value >= 10.0:
        return f"{value:.0f}"
    if value >= 1.0:
        return f"{value:.1f}"
    digits = 1 - int(np.floor(np.log10(value)))
    return f"{value:.{digits}f}".lstrip("0")


def route_table(results: Mapping[str, Any]) -> str:
    rows = []
    for case in CASES:
        if case.stem not in results["routes"]:
            continue
        found = results["routes"][case.stem]
        alpha, error = found["alpha"]
        rows.append(
            [
                case.label,
                case.start,
                short(found["error"]),
                "given" if case.roughness == "known" else f"{alpha:.4f} ± {short(error)}",
                f"{100.0 * found['residual']:.2f} %",
                str(found["iterations"]),
                f"{found['samples'] / 1e6:.0f}",
                short(found["seconds"]),
                "yes" if found["converged"] else "no",
            ]
        )
    head = ("route", "start", "largest curve error", "α", "residual", "iterations",
            "paths, millions", "seconds", "converged")  # fmt: skip
    return markdown(head, rows)


def metal_table(results: Mapping[str, Any]) -> str:
    rows = []
    for metal, found in results["metals"].items():
        nodes, index = found["nodes"], found["indices"]
        pairs = [
            f"{short(index['values'][n][1])} ± {short(index['standard_errors'][n][1])} "
            f"({short(found['truth'][n][1])})"
            for n in ("eta", "k")
        ]
        five = found["five terms"]
        rows.append([metal, short(nodes["error"]), short(found["limit"]), short(five["error"]),
                     short(index["error"]), *pairs])  # fmt: skip
    head = ("metal", "node colours", "fit at the nodes", "balanced, 5 terms", "(eta, k)",
            "eta, green", "k, green")  # fmt: skip
    return markdown(head, rows)


def calibration_table(results: Mapping[str, Any]) -> str:
    rows = []
    labels = {"f0": "F(0°)", "f1": "F(83°)", "f2": "F(75°)"}
    for name, scores in results["calibration"].items():
        z = np.array(scores)
        inside = [f"{100.0 * np.mean(np.abs(z) < bound):.0f} %" for bound in (1.0, 2.0)]
        rows.append([labels.get(name, name), *inside, f"{z.std():.2f}", f"{z.mean():+.2f}"])
    head = ("parameter", "within one", "within two", "standard deviation", "mean")
    return markdown(head, rows)


def texture_table(results: Mapping[str, Any]) -> str:
    labels = {"texels": "every texel by itself", "regions": "materials' places known"}
    rows = [
        [
            labels[name],
            f"{100.0 * found['identified']:.0f} %",
            *(f"{short(m)} / {short(p)}" for m, p in zip(found["mean"], found["p95"], strict=True)),
            f"{100.0 * found['residual']:.1f} %",
        ]
        for name, found in results["texture"].items()
    ]
    head = ("unknowns", "identified", "F(0°)", "F(83°)", "F(75°)", "residual")
    return markdown(head, rows)


# --- drawing -------------------------------------------------------------------------------------

COLOURS = {
    "linear, node colours": "#0072b2",
    "linear, (eta, k)": "#56b4e9",
    "linear, (r, g)": "#332288",
    "hybrid, (eta, k) and α": "#009e73",
    "gradient, node colours": "#e69f00",
    "gradient, (eta, k), fitted": "#cc79a7",
    "gradient, (eta, k), exact": "#d55e00",
    "gradient, node colours and α": "#7f7f7f",
}


def draw(folder: Path, pictures: Path) -> None:
    results = read_sidecar(NAME, folder)["results"]
    draw_routes(results, pictures / FIGURE.pictures[0])
    draw_texture(folder, pictures / FIGURE.pictures[1])


def draw_routes(results: Mapping[str, Any], path: Path) -> None:
    """Largest curve error over camera paths and over time."""
    with style.styled():
        page = Page(9.6, 3.7)
        panels = [page.axes(0.65, 0.35, 3.0, 2.75), page.axes(4.05, 0.35, 3.0, 2.75)]
        for axes, column, label in zip(
            panels, (1, 0), ("camera paths", "seconds on two cores"), strict=True
        ):
            for case in CASES:
                if case.stem not in results["routes"]:
                    continue
                steps = np.array(results["routes"][case.stem]["path"], float)
                looks: dict[str, Any] = {"color": COLOURS[case.label], "lw": 1.3}
                looks["ls"] = (0, (3, 1.5)) if case.start == "bad" else "-"
                if case.route == "linear":
                    looks |= {"marker": "o", "ms": 4.5}
                axes.plot(steps[:, column], steps[:, 2], **looks)
                axes.plot(*steps[-1, [column, 2]], marker="o", ms=4.5, color=looks["color"])
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_xlabel(label)
            axes.axhline(0.01, color=GREY, lw=0.7, ls=":")
        panels[0].set_ylabel("largest error of the curves")
        panels[1].set_yticklabels([])
        panels[1].set_ylim(panels[0].get_ylim())
        handles = [
            panels[0].plot([], [], color=colour, label=label)[0]
            for label, colour in COLOURS.items()
        ]
        handles.append(panels[0].plot([], [], color=GREY, ls=(0, (3, 1.5)), label="bad start")[0])
        panels[1].legend(handles=handles, loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=8)
        page.save(path, dpi=150)


def draw_texture(folder: Path, path: Path) -> None:
    """The two-metal sphere: one of its images, what was recovered, and that rendered."""
    names = ("truth", "texels", "regions")
    titles = ("truth", "every texel by itself", "places known")
    side, gap, top = 2.1, 0.12, 0.32
    with style.styled():
        page = Page(0.62 + 3 * (side + gap), top + side + gap + side / 2 + 0.06)
        for i, (name, title) in enumerate(zip(names, titles, strict=True)):
            x = 0.5 + i * (side + gap)
            page.write(x + side / 2, 0.17, title, size=9.5)
            stem = "texture_image" if name == "truth" else f"texture_{name}_image"
            page.picture(x, top, side, read_exr(folder / f"{stem}.exr"))
            texture = np.repeat(np.repeat(read_exr(folder / f"texture_{name}.exr"), 4, 0), 4, 1)
            axes = page.axes(x, top + side + gap, side, side / 2)
            from fresnel_decomp.images import display

            axes.imshow(display(texture), vmin=0, vmax=1, aspect="auto", interpolation="nearest")
            axes.set_axis_off()
        page.write(0.25, top + side / 2, "first of six images", rotation=90, size=8.5)
        page.write(0.25, top + side + gap + side / 4, "F(0°)", rotation=90, size=8.5)
        page.save(path, dpi=130)


FIGURE = Figure(
    name=NAME,
    title="Inverse rendering: error against time and samples, and a sphere of two metals",
    minutes=11.0,
    compute=compute,
    draw=draw,
    pictures=("inverse_routes.png", "inverse_two_metals.png"),
    parameters={
        "cases": [asdict(case) for case in CASES],
        "metals": METALS,
        "alpha": ALPHA,
        "views": VIEWS,
        "wavelengths": WAVELENGTHS,
        "texels": TEXELS,
        "repeats": (REPEATS, REPEAT_VIEWS, REPEAT_SIZE),
    },
    scene="sphere in the studio's light",
    size=64,
    spp=SPP,
)


def texts(results: dict[str, Any]) -> dict[str, str]:
    """Tables for the terminal and the page."""
    return {
        "routes": route_table(results),
        "metals": metal_table(results),
        "texture": texture_table(results),
        "calibration": calibration_table(results),
    }


command = study(
    FIGURE,
    texts,
    {
        "routes": MARKS,
        "metals": METAL_MARKS,
        "texture": TEXTURE_MARKS,
        "calibration": CALIBRATION_MARKS,
    },
)


if __name__ == "__main__":
    main(command)

"""Area lights by linearly transformed cosines against path tracing, and what each step costs.

    python scripts/area_light_study.py            # compute what is missing, then draw
    python scripts/area_light_study.py --quick    # tiny images, to see that everything runs
    python scripts/area_light_study.py --page docs/area_lights.md

Interrupt it when you like: finished images are kept, and the same command goes on from them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from _area_lights import (
    ALPHAS,
    MATERIALS,
    METALS,
    OBJECTS,
    RECIPES,
    SHAPES,
    SHOWN,
    Scene,
    compute,
)
from _figure import Figure, read_sidecar
from _figure_commands import main, study
from _kept import image_of
from _markdown import markdown, marks
from _page import Page
from fresnel_decomp.area_light import CORRECTIONS
from fresnel_decomp.report import style

NAME = "area_light_study"
MARKS = marks("area light study")
EXPOSURES = {"plastic": 2.5}
Results = Mapping[str, Any]


# --- tables --------------------------------------------------------------------------------------


def percent(value: float) -> str:
    """Two significant digits, in percent."""
    value *= 100.0
    return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}" if value >= 0.995 else f"{value:.2f}"


def tables(results: Results) -> str:
    """Errors by source, in Markdown: ranges over both shapes of light."""
    found = results["scenes"]

    def span(scene: tuple[str, float], value: Callable[[Any], float]) -> str:
        values = [value(found[Scene(scene[0], shape, scene[1]).stem]) for shape in SHAPES]
        least, most = percent(min(values)), percent(max(values))
        return least if least == most else f"{least}–{most}"

    places = [(o, a) for o in OBJECTS for a in ALPHAS]
    head = ["NRMSE, %", *(f"{o}, α = {a:g}" for o, a in places)]
    rows = [
        ["noise of the reference", *(span(p, lambda s: s["noise"]) for p in places)],
        ["lobe", *(span(p, lambda s: s["lobe"]) for p in places)],
    ]
    parts = [markdown(head, rows)]

    def row(label: str, material: str, *keys: str) -> list[str]:
        def value(scene: Any) -> float:
            at: Any = scene["materials"][material]
            for key in keys:
                at = at[key]
            return float(at)

        return [label, *(span(p, value) for p in places)]

    for key, names in (
        ("fresnel", RECIPES),
        ("half_vector", CORRECTIONS),
        ("total", CORRECTIONS),
    ):
        titles = {"fresnel": "Fresnel", "half_vector": "half vector", "total": "all together"}
        parts.append(
            markdown(
                [f"{titles[key]}, NRMSE, %", *head[1:]],
                [row(f"{m}, {n}", m, key, n) for m in MATERIALS for n in names],
            )
        )
    return "\n\n".join(parts)


def summary(results: Results) -> list[str]:
    """Ranges over all scenes, in words."""
    scenes = list(results["scenes"].values())

    def span(values: Sequence[float]) -> str:
        return f"{percent(min(values))}–{percent(max(values))} %"

    lines = [f"lobe: {span([s['lobe'] for s in scenes])}, mean "
             f"{percent(float(np.mean([s['lobe'] for s in scenes])))} %"]  # fmt: skip
    for group, members in (("metals", METALS), ("plastic", ("plastic",))):
        rows = [s["materials"][m] for s in scenes for m in members]
        for recipe in RECIPES:
            lines.append(
                f"Fresnel, {group}, {recipe}: {span([r['fresnel'][recipe] for r in rows])}"
            )
        for key in ("half_vector", "total"):
            for c in CORRECTIONS:
                lines.append(f"{key}, {group}, {c}: {span([r[key][c] for r in rows])}")
    return lines


# --- pictures ------------------------------------------------------------------------------------


def draw(folder: Path, pictures: Path) -> None:
    results = read_sidecar(NAME, folder)["results"]
    draw_errors(results, pictures / FIGURE.pictures[0])
    for name, path in zip(OBJECTS, FIGURE.pictures[1:], strict=True):
        draw_object(results, folder, name, pictures / path)


def draw_errors(results: Results, path: Path) -> None:
    """NRMSE by source on one logarithmic axis, a group for each material."""
    corrections = {"none": "#7a7a7a", "plain": "#009e73", "normalised": "#cc79a7",
                   "blended": "#56b4e9"}  # fmt: skip
    series: list[tuple[str, tuple[str, ...], str, str, bool]] = [
        ("lobe", ("lobe",), "#1a1a1a", "s", True),
        *((f"half vector, {c}", ("half_vector", c), colour, "o", c == "plain")
          for c, colour in corrections.items()),
        ("Fresnel, talk", ("fresnel", "talk"), "#0072b2", "^", False),
        ("Fresnel, notebook", ("fresnel", "notebook"), "#0072b2", "v", False),
        ("Fresnel, balanced", ("fresnel", "balanced"), "#0072b2", "D", True),
    ]  # fmt: skip
    with style.styled():
        page = Page(7.6, 3.7)
        axes = page.axes(0.72, 0.16, 4.9, 2.8)
        places = [(o, a) for o in OBJECTS for a in ALPHAS]
        for label, keys, colour, marker, filled in series:
            for group, material in enumerate(MATERIALS):
                values = []
                for thing, alpha in places:
                    scene = results["scenes"][Scene(thing, "rectangle", alpha).stem]
                    found: Any = scene if keys[0] == "lobe" else scene["materials"][material]
                    for key in keys:
                        found = found[key]
                    values.append(100.0 * found)
                x = np.arange(len(places)) + group * (len(places) + 1.2)
                for part in (slice(0, 3), slice(3, 6)):
                    axes.plot(
                        x[part],
                        values[part],
                        color=colour,
                        marker=marker,
                        ms=4,
                        lw=0.8,
                        mfc=colour if filled else "white",
                        label=label if group == 0 and part.start == 0 else None,
                    )
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_ylabel("NRMSE (%)")
        ticks = [i + g * (len(places) + 1.2) for g in range(len(MATERIALS)) for i in range(6)]
        axes.set_xticks(ticks, [f"{a:g}"[1:] for _ in MATERIALS for _, a in places], size=6.5)
        axes.grid(axis="x", visible=False)
        for group, label in enumerate(MATERIALS.values()):
            start = group * (len(places) + 1.2)
            for half, name in enumerate(OBJECTS):
                axes.text(start + 1 + 3 * half, -0.1, name, ha="center", va="top", size=6.5,
                          transform=axes.get_xaxis_transform())  # fmt: skip
            axes.text(start + 2.5, -0.16, label.replace(", ", "\n"), ha="center", va="top", size=8,
                      transform=axes.get_xaxis_transform())  # fmt: skip
        axes.text(-0.02, -0.045, "α", ha="right", va="center", size=8, transform=axes.transAxes)
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=8)
        page.save(path, dpi=130)


def draw_object(results: Results, folder: Path, name: str, path: Path) -> None:
    """Mitsuba, linearly transformed cosines and their difference, by material and roughness."""
    rows = [(m, s) for m in MATERIALS for s in SHAPES if m == "plastic" or (m, s) in _SHOWN_ROWS]
    side, gap, left, top, below, middle = 0.94, 0.04, 0.46, 0.6, 0.19, 0.14
    block = 3 * (side + gap) + middle
    limit = 0.3
    with style.styled():
        page = Page(left + len(ALPHAS) * block, top + len(rows) * (side + below) + 0.56)
        shown_map: Any = None
        for row, (material, shape) in enumerate(rows):
            y = top + row * (side + below)
            label = f"{MATERIALS[material].split(',')[0]},\n{shape}"
            page.write(left - 0.22, y + side / 2, label, rotation=90, size=8)
            correction = "plain"
            for part, alpha in enumerate(ALPHAS):
                scene = Scene(name, shape, alpha)
                start = left + part * block
                reference = image_of(folder, scene, f"{material}_mc_exact")
                image = image_of(folder, scene, f"{material}_ltc_{SHOWN}_{correction}")
                scale = 2.0 ** EXPOSURES.get(material, 0.0)
                page.picture(start, y, side, reference * scale)
                page.picture(start + side + gap, y, side, image * scale)
                axes = page.axes(start + 2 * (side + gap), y, side, side)
                difference = (image - reference).mean(axis=2) * scale
                shown_map = axes.imshow(difference, cmap=style.DIVERGING, vmin=-limit,
                                        vmax=limit, aspect="auto")  # fmt: skip
                axes.set_axis_off()
                total = results["scenes"][scene.stem]["materials"][material]["total"][correction]
                page.write(start + 1.5 * (side + gap), y + side + below / 2,
                           f"NRMSE {percent(total)} %", size=7)  # fmt: skip
                if row == 0:
                    page.write(start + 1.5 * (side + gap), 0.14, f"α = {alpha:g}", size=10)
                    for column, title in enumerate(("Mitsuba", "LTC", "difference")):
                        x = start + column * (side + gap) + side / 2
                        page.write(x, top - 0.1, title, size=8)
        y = top + len(rows) * (side + below) + 0.08
        page.colour_bar(
            left + block, y, 3 * (side + gap) - gap, shown_map,
            "LTC − Mitsuba, linear, as exposed (white is 1)", height=0.08, size=7.5,
            extend="both", extendfrac=0.03,
            format=lambda value, _: f"{value:g}".replace("-", "−"),
        )  # fmt: skip
        page.save(path, dpi=112)


_SHOWN_ROWS = {("Be", "disk"), ("Au", "rectangle"), ("Al", "disk"), ("Au", "disk")}

FIGURE = Figure(
    name=NAME,
    title="Area lights by linearly transformed cosines against path tracing",
    minutes=13.0,
    compute=compute,
    draw=draw,
    pictures=("area_lights_errors.png", *(f"area_lights_{name}.png" for name in OBJECTS)),
    parameters={
        "materials": list(MATERIALS),
        "alphas": ALPHAS,
        "recipes": RECIPES,
        "shown": SHOWN,
        "corrections": CORRECTIONS,
    },
    scene="lit by one area light",
    size=96,
    spp=225,
)


def texts(results: Mapping[str, Any]) -> dict[str, str]:
    """Tables and a summary, for the terminal and the page."""
    said = "\n".join(summary(results))
    return {"study": f"{tables(results)}\n\n```text\n{said}\n```"}


command = study(FIGURE, texts, {"study": MARKS})


if __name__ == "__main__":
    main(command)

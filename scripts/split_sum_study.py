"""Split-sum shading against path tracing: Fresnel term, table and split-sum, each by itself.

    python scripts/split_sum_study.py            # compute what is missing, then draw
    python scripts/split_sum_study.py --quick    # tiny images, to see that everything runs

Interrupt it when you like: finished images are kept, and the same command goes on from them.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from _figure import Figure, read_sidecar
from _figure_commands import main, study
from _kept import image_of
from _page import Page
from _split_sum import (
    ALPHAS,
    BALLS,
    EDGE_TINT,
    MATERIALS,
    MODELS,
    SPHERES,
    SPLIT_SPP,
    Scene,
    compute,
    light_effort,
    prefiltered,
    reference_image,
)
from fresnel_decomp._files import replacing
from fresnel_decomp.images import display, read_exr
from fresnel_decomp.report import style

NAME = "split_sum_study"
LABELS = {
    "exact": "exact F̄",
    "decomposition": "table (talk)",
    "notebook": "table (notebook)",
    "balanced": "table (balanced)",
    "schlick": "Schlick A, B",
    "f82": "F82",
}
COLUMNS = ("talk", "notebook", "balanced", "Schlick", "F82")  # of MODELS
TABLES = tuple(f"split_sum_{name}.csv" for name in ("fresnel", "table", "reference", "summary"))
SUMMARY_HEADER = ("", "", "", "exact F̄", *COLUMNS)
Results = Mapping[str, Any]


# --- tables --------------------------------------------------------------------------------------


def cell(numbers: Mapping[str, float]) -> str:
    """NRMSE in percent, mean ΔE00 and mean FLIP."""
    return " · ".join(
        rounded(value) for value in (100.0 * numbers["nrmse"], numbers["delta_e"], numbers["flip"])
    )


def rounded(value: float) -> str:
    """Two significant digits, three above 1."""
    if value >= 10.0:
        return f"{value:.1f}"
    if value >= 1.0:
        return f"{value:.2f}"
    return f"{value:.2g}" if value >= 1e-4 else f"{value:.0e}"


def write_rows(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])


def write_tables(results: Results, folder: Path) -> None:
    """One table per comparison, each cell with the three measures, and their summary."""
    found = results["scenes"]

    def named(scene: Scene) -> list[str]:
        place = "" if scene in SPHERES else f", {scene.shape}, {scene.light}"
        return [f"{MATERIALS[scene.material]}{place}", f"{scene.alpha:g}"]

    rows = [
        [*named(s), *(cell(found[s.stem]["fresnel_alone"][m]) for m in MODELS)] for s in SPHERES
    ]
    write_rows(folder / TABLES[0], ["", "α", *COLUMNS], rows)

    rows = [
        [
            *named(s),
            cell(found[s.stem]["table_alone"]),
            *(cell(found[s.stem]["same_light"][m]) for m in MODELS),
        ]
        for s in SPHERES
    ]
    header = ["", "α", "table alone", *COLUMNS]
    write_rows(folder / TABLES[1], header, rows)

    rows = [
        [
            *named(s),
            cell(found[s.stem]["noise"]),
            *(cell(found[s.stem]["split_sum"][m]) for m in LABELS),
        ]
        for s in (*SPHERES, *BALLS)
        if s.stem in found
    ]
    header = ["", "α", "noise", "exact F̄", *COLUMNS]
    write_rows(folder / TABLES[2], header, rows)
    write_rows(folder / TABLES[3], SUMMARY_HEADER, summary(results))


def summary(results: Results) -> list[list[str]]:
    """What the tables say, as ranges over groups of scenes: rows of `SUMMARY_HEADER`."""
    metals = ("Be", "Au", "Al", "Cu")
    groups = {
        name: [results["scenes"][s.stem] for s in SPHERES if s.material in members]
        for name, members in {
            "metals": metals,
            "beryllium": ("Be",),
            "copper": ("Cu",),
            "plastic": ("plastic",),
            "edge tint": ("edge",),
            "spheres": tuple(MATERIALS),
        }.items()
    }
    groups["shader balls"] = [
        results["scenes"][s.stem] for s in BALLS if s.stem in results["scenes"]
    ]

    def span(numbers: Sequence[Mapping[str, float]], measure: str) -> str:
        scale = 100.0 if measure == "nrmse" else 1.0
        least, most = (rounded(scale * f(n[measure] for n in numbers)) for f in (min, max))
        return least if least == most else f"{least}–{most}"

    rows: list[list[str]] = []

    def add(question: str, group: str, key: str, models: Sequence[str]) -> None:
        """A row for each measure; what is measured once for all models is in one column."""
        for measure, label in (("nrmse", "NRMSE, %"), ("delta_e", "ΔE00")):
            cells = []
            for m in LABELS:
                found = [row[key].get(m, row[key]) for row in groups[group] if m in models]
                cells.append(span(found, measure) if found else "")
            rows.append([question, group, label, *cells])

    for group in ("metals", "plastic", "edge tint"):
        add("(i) Fresnel term alone", group, "fresnel_alone", MODELS)
    for group in ("metals", "spheres"):
        add("(ii) table alone", group, "table_alone", ["decomposition"])
    for group in ("metals", "copper", "plastic", "edge tint"):
        add("(ii) against exact F̄", group, "same_light", MODELS)
    for group in ("beryllium", "copper", "spheres", "shader balls"):
        add("(iii) split-sum", group, "split_sum", tuple(LABELS))
    add("(iii) noise of the reference", "spheres", "noise", ["exact"])
    directions, _ = light_effort(results["light_width"])
    for alpha, error in results["light_error"].items():
        for measure, label in (("rms", "RMS"), ("largest", "largest")):
            question = f"light term, {directions} directions"
            value = rounded(100.0 * error[measure])
            rows.append([question, f"α = {alpha}", f"{label}, %", value, *[""] * len(MODELS)])
    return rows


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table in plain text."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


# --- pictures ------------------------------------------------------------------------------------


def draw(folder: Path, pictures: Path) -> None:
    from fresnel_decomp.mitsuba.variants import variant_scope  # imports the renderer

    sidecar = read_sidecar(NAME, folder)
    results = sidecar["results"]
    write_tables(results, pictures)
    draw_errors(results, pictures / FIGURE.pictures[0])
    draw_spheres(results, folder, pictures / FIGURE.pictures[1])
    draw_edge_tint(results, folder, pictures / FIGURE.pictures[2])
    with variant_scope(sidecar["settings"]["variant"]):  # the sky is baked anew
        draw_lights(results, folder, pictures / FIGURE.pictures[3])


def draw_errors(results: Results, path: Path) -> None:
    """NRMSE of the three comparisons on one logarithmic axis."""
    neutral = "#606060"
    series: list[tuple[str, tuple[str, ...], str, str, bool]] = [
        ("(iii) split-sum, exact F̄", ("split_sum", "exact"), neutral, "s", True),
        ("(i) Schlick alone", ("fresnel_alone", "schlick"), style.MODEL_COLOURS["schlick"], "^",
         False),
        ("(i) F82 alone", ("fresnel_alone", "f82"), style.MODEL_COLOURS["f82"], "D", False),
        ("(i) 4 terms alone, talk", ("fresnel_alone", "decomposition"),
         style.MODEL_COLOURS["decomposition"], "o", True),
        ("(i) 4 terms alone, notebook", ("fresnel_alone", "notebook"),
         style.MODEL_COLOURS["gulbrandsen"], "o", False),
        ("(i) 4 terms alone, balanced", ("fresnel_alone", "balanced"),
         style.MODEL_COLOURS["lazanyi"], "P", True),
        ("(ii) table and shading alone", ("table_alone",), "#9a6bb5", "v", True),
    ]  # fmt: skip
    gap = 1.0
    place = {
        scene.stem: index + gap * (index // len(ALPHAS)) for index, scene in enumerate(SPHERES)
    }
    with style.styled():
        page = Page(7.6, 3.9)
        axes = page.axes(0.72, 0.16, 4.75, 2.95)
        for label, keys, colour, marker, filled in series:
            values = []
            for scene in SPHERES:
                found: Any = results["scenes"][scene.stem]
                for key in keys:
                    found = found[key]
                values.append(100.0 * found["nrmse"])
            x = np.array([place[s.stem] for s in SPHERES]).reshape(-1, len(ALPHAS))
            options = {"color": colour, "marker": marker, "ms": 4.5, "lw": 0.9}
            options["mfc"] = colour if filled else "white"
            for i, (where, group) in enumerate(
                zip(x, np.reshape(values, (-1, len(ALPHAS))), strict=True)
            ):
                axes.plot(where, group, label=label if i == 0 else None, **options)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_ylabel("NRMSE (%)")
        axes.set_xticks(list(place.values()), [f"{s.alpha:g}"[1:] for s in SPHERES], size=7)
        axes.grid(axis="x", visible=False)
        for index, name in enumerate(MATERIALS.values()):
            middle = (index + 0.5) * len(ALPHAS) - 0.5 + gap * index
            axes.text(middle, -0.12, name.replace(", ", "\n"), ha="center", va="top", size=8,
                      transform=axes.get_xaxis_transform())  # fmt: skip
        axes.text(-0.02, -0.045, "α", ha="right", va="center", size=8, transform=axes.transAxes)
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=8)
        page.save(path, dpi=130)


def over_white(image: np.ndarray, coverage: np.ndarray, exposure: float) -> np.ndarray:
    """A picture of an object on the page: what it does not cover is white."""
    return image + ((1.0 - coverage) * 2.0**-exposure)[..., None]


def draw_spheres(results: Results, folder: Path, path: Path) -> None:
    """A row per material at two roughnesses: path traced, four-term table and Schlick."""
    alphas = (0.08, 0.3)
    columns = [None, "decomposition", "schlick"]
    side, gap, left, top, below, middle = 1.2, 0.05, 0.36, 0.62, 0.2, 0.3
    block = len(columns) * (side + gap) + middle
    coverage = read_exr(folder / "coverage_sphere.exr")[..., 0]
    with style.styled():
        page = Page(left + len(alphas) * block - middle + 0.06,
                    top + len(MATERIALS) * (side + gap + below) + 0.05)  # fmt: skip
        for part, alpha in enumerate(alphas):
            start = left + part * block
            page.write(start + (block - middle) / 2, 0.16, f"α = {alpha:g}", size=10.5)
            for row, (material, label) in enumerate(MATERIALS.items()):
                scene = Scene(material, alpha)
                y = top + row * (side + gap + below)
                if part == 0:
                    page.write(left - 0.16, y + side / 2, label, rotation=90, size=9)
                for column, model in enumerate(columns):
                    x = start + column * (side + gap)
                    if model is None:
                        image, title, text = reference_image(folder, scene), "path traced", ""
                    else:
                        image = image_of(folder, scene, f"split_{model}")
                        title = f"split-sum,\n{LABELS[model]}"
                        numbers = results["scenes"][scene.stem]["split_sum"][model]
                        text = f"ΔE$_{{00}}$ {numbers['delta_e']:.2f}"
                    exposed = over_white(image, coverage, scene.exposure) * 2.0**scene.exposure
                    page.picture(x, y, side, exposed)
                    page.write(x + side / 2, y + side + below / 2, text, size=7.5)
                    if row == 0:
                        page.write(x + side / 2, top - 0.06, title, size=8.5, va="bottom")
        page.save(path, dpi=112)


def draw_edge_tint(results: Results, folder: Path, path: Path) -> None:
    """The edge-tint material by all models, at all roughnesses."""
    columns = [None, *LABELS]
    side, gap, left, top, below = 1.25, 0.05, 0.36, 0.5, 0.4
    coverage = read_exr(folder / "coverage_sphere.exr")[..., 0]
    with style.styled():
        page = Page(left + len(columns) * (side + gap) + 0.06,
                    top + len(ALPHAS) * (side + below) + 0.05)  # fmt: skip
        for row, alpha in enumerate(ALPHAS):
            scene = Scene("edge", alpha)
            y = top + row * (side + below)
            page.write(left - 0.16, y + side / 2, f"α = {alpha:g}", rotation=90, size=9)
            for column, model in enumerate(columns):
                x = left + column * (side + gap)
                lines = []
                if model is None:
                    image, title = reference_image(folder, scene), "path traced"
                else:
                    image = image_of(folder, scene, f"split_{model}")
                    title = f"split-sum,\n{LABELS[model]}"
                    found = results["scenes"][scene.stem]
                    lines = [f"to path traced: {found['split_sum'][model]['delta_e']:.2f}"]
                    if model != "exact":
                        same = found["same_light"][model]["delta_e"]
                        lines.append(f"to exact F̄: {same:.2f}")
                page.picture(x, y, side, over_white(image, coverage, 0.0))
                for i, line in enumerate(lines):
                    page.write(x + side / 2, y + side + 0.1 + 0.14 * i, line, size=7.5)
                if row == 0:
                    page.write(x + side / 2, top - 0.06, title, size=8.5, va="bottom")
        page.write(left + side / 2, top + side + 0.1, "mean ΔE$_{00}$ of split-sum:", size=7.5)
        page.save(path, dpi=120)


def draw_lights(results: Results, folder: Path, path: Path) -> None:
    """Both lights, three of their blurred maps, and the shader ball in them."""
    width = results["light_width"]
    lights = [name for name in ("city", "sunsky") if any(
        s.light == name and s.stem in results["scenes"] for s in BALLS)]  # fmt: skip
    balls = {name: [s for s in BALLS if s.light == name] for name in lights}
    columns = ["reference", "exact", "decomposition", "schlick"]
    titles = ["path traced", *(f"split-sum, {LABELS[c]}" for c in columns[1:])]
    side, gap, left, below = 1.7, 0.06, 0.3, 0.22
    total = len(columns) * (side + gap) - gap
    strip = (total - 3 * gap) / 4
    coverage = read_exr(folder / "coverage_shader-ball.exr")[..., 0]
    block = 0.36 + strip / 2 + 0.34 + 2 * (side + below) + 0.16
    with style.styled():
        page = Page(left + total + 0.06, len(lights) * block + 0.02)
        for part, name in enumerate(lights):
            y = part * block + 0.36
            light = prefiltered(name, width)
            for column, alpha in enumerate((0.0, *ALPHAS)):
                x = left + column * (strip + gap)
                level = int(np.argmin(np.abs(light.alphas - alpha)))
                axes = page.axes(x, y, strip, strip / 2)
                axes.imshow(display(light.levels[level]), aspect="auto")
                axes.set_axis_off()
                text = name if level == 0 else f"blurred, α = {light.alphas[level]:.2g}"
                page.write(x + strip / 2, y - 0.12, text, size=8.5)
            y += strip / 2 + 0.3
            for row, scene in enumerate(balls[name]):
                for column, model in enumerate(columns):
                    x = left + column * (side + gap)
                    if model == "reference":
                        image = reference_image(folder, scene)
                    else:
                        image = image_of(folder, scene, f"split_{model}")
                        numbers = results["scenes"][scene.stem]["split_sum"][model]
                        text = (f"NRMSE {100 * numbers['nrmse']:.1f} %, "
                                f"ΔE$_{{00}}$ {numbers['delta_e']:.2f}")  # fmt: skip
                        page.write(x + side / 2, y + side + 0.09, text, size=7.5)
                    page.picture(x, y, side, over_white(image, coverage, 0.0))
                    if row == 0:
                        page.write(x + side / 2, y - 0.08, titles[column], size=8.5)
                label = f"{MATERIALS[scene.material]}, α = {scene.alpha:g}"
                page.write(left - 0.14, y + side / 2, label, rotation=90, size=8.5)
                y += side + below
        page.save(path, dpi=112)


FIGURE = Figure(
    name=NAME,
    title="Split-sum shading against path tracing: six materials, three roughnesses",
    minutes=9.0,
    compute=compute,
    draw=draw,
    pictures=(
        *(f"split_sum_{name}.png" for name in ("errors", "spheres", "edge_tint", "lights")),
        *TABLES,
    ),
    parameters={
        "materials": list(MATERIALS),
        "alphas": ALPHAS,
        "models": MODELS,
        "edge_tint": EDGE_TINT,
        "balls": [scene.stem for scene in BALLS],
        "split_spp": SPLIT_SPP,
    },
    scene="lit object",
    size=192,
    spp=144,
)


def texts(results: Mapping[str, Any]) -> dict[str, str]:
    """For the terminal; the page has tables of its own."""
    return {"summary": "\n".join(aligned([SUMMARY_HEADER, *summary(results)]))}


command = study(FIGURE, texts, {})


if __name__ == "__main__":
    main(command)

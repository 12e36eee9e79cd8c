"""What the full-screen pass says: tables, verdicts, and the picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from _markdown import markdown
from _page import GREY, Page
from _screen_pass import (
    FETCHES,
    PARTS,
    PASSES,
    TEXTURED,
    UNIFORM,
)
from fresnel_decomp._spread import median_and_spread
from fresnel_decomp.images import delta_e, display
from fresnel_decomp.report import style

CLAIM_MS = 0.05
CLAIM = (1280, 720)
EXPOSURE = 1.0  # stops, of the picture and of colour differences
RG = TEXTURED[2]


def base_of(name: str) -> str:
    """Schlick's pass with coefficients of the same kind."""
    return UNIFORM[0] if name in UNIFORM else TEXTURED[0]


def differences(first: Sequence[float], second: Sequence[float]) -> list[float]:
    return [a - b for a, b in zip(first, second, strict=True)]


# --- report --------------------------------------------------------------------------------------


def report(results: Mapping[str, Any]) -> str:
    """Markdown: milliseconds on a GPU, ratios elsewhere."""
    times, settings, about = results["times"], results["settings"], results["about"]
    gpu = settings["variant"].startswith("cuda")
    head = ["pass", "fetches a pixel"]
    head += ["ms", "ms − Schlick's"] if gpu else []
    head += ["time / Schlick's", "NRMSE, % · ΔE00 to exact"]
    rows = []
    for name in PASSES:
        base = times[base_of(name)]
        row = [name, FETCHES[name]]
        if gpu:
            row.append(_number(*median_and_spread(times[name]), digits=4))
            more = median_and_spread(differences(times[name], base))
            row.append("" if name == base_of(name) else _number(*more, digits=4))
        ratio = median_and_spread([a / b for a, b in zip(times[name], base, strict=True)])
        row.append("1" if name == base_of(name) else _number(*ratio, digits=3))
        error = results["errors"][name]
        row.append(
            f"{100 * error['nrmse']:.2f} · {error['delta_e']:.2f}" if "nrmse" in error else ""
        )
        rows.append(row)
    size = f"{settings['width']} × {settings['height']}"
    where = (
        f"Kernel times of {len(times[PASSES[0]])} rounds, {size}, {settings['variant']}, "
        f"{about['device']}, Mitsuba {about['versions']['mitsuba']}, Dr.Jit "
        f"{about['versions']['drjit']}; {days(results['dates'])}."
    )
    label = (
        "Milliseconds on a GPU, with its texture units."
        if gpu
        else "**Ratios on a processor**, which filters textures in software: they do not check the "
        "talk's milliseconds."
    )
    worst = max(error["shader"] for error in results["errors"].values())
    checked = (
        f"All pixels were compared with NumPy before: RMS error below {worst:.1g} of the mean"
        + (
            f", {max(e['shader_as_timed'] for e in results['errors'].values()):.1g} with texture "
            "units."
            if gpu
            else "."
        )
    )
    parts = [label, markdown(head, rows), shares(times), comparisons(times), f"{where} {checked}"]
    if gpu:
        parts.insert(2, verdicts(results))
    return "\n\n".join(parts)


def shares(times: Mapping[str, Sequence[float]]) -> str:
    """Markdown: what each part adds, in percent of the whole pass."""
    screen, light, two, four = (times[name] for name in PARTS)
    rows = []
    for name in PASSES:
        table = two if name.startswith("Schlick") else four
        steps = (screen, differences(light, screen), differences(table, light),
                 differences(times[name], table))  # fmt: skip
        cells = []
        for step in steps:
            share = [100.0 * a / b for a, b in zip(step, times[name], strict=True)]
            cells.append(_number(*median_and_spread(share), digits=0))
        rows.append([name, *cells])
    head = ("% of the pass", "G-buffer, output", "light", "table", "coefficients and sum")
    return markdown(head, rows)


def comparisons(times: Mapping[str, Sequence[float]]) -> str:
    """Markdown: what is dearer, and by how much, in percent of Schlick's pass in the same round."""
    _, _, two, four = (times[name] for name in PARTS)

    def sums(kind: Sequence[str]) -> list[float]:
        return differences(differences(times[kind[1]], four), differences(times[kind[0]], two))

    steps = {
        "table: four channels, not two": (differences(four, two), UNIFORM),
        "coefficients and sum: four terms, not two; uniform": (sums(UNIFORM), UNIFORM),
        "coefficients and sum: three maps, not one; textured": (sums(TEXTURED), TEXTURED),
        "(r, g) in two maps, not coefficients in three": (
            differences(times[RG], times[TEXTURED[1]]), TEXTURED,
        ),
    }  # fmt: skip
    rows = []
    for name, (step, kind) in steps.items():
        share = [100.0 * a / b for a, b in zip(step, times[kind[0]], strict=True)]
        # the verdict on what is printed
        more, half = (round(value, 1) for value in median_and_spread(share))
        rows.append([name, _number(more, half, digits=1), direction(more, half)])
    return markdown(("change", "% of Schlick's pass", "verdict"), rows)


def direction(more: float, half: float) -> str:
    """Whether a difference is one: its sign, or undecided within its spread."""
    if abs(more) <= half:
        return "undecided"
    return "dearer" if more > 0.0 else "cheaper"


def verdict(more: Sequence[float]) -> str:
    """Whether milliseconds more are at most the talk's: within, above, or undecided."""
    middle, half = median_and_spread(more)
    if middle + half <= CLAIM_MS:
        return "within"
    return "above" if middle - half > CLAIM_MS else "undecided"


def verdicts(results: Mapping[str, Any]) -> str:
    """The talk's claim against what was measured; only for a GPU."""
    settings, times = results["settings"], results["times"]
    size = (settings["width"], settings["height"])
    if size != CLAIM:
        return f"At {size[0]} × {size[1]} the talk claims nothing; it is about 1280 × 720."
    lines = []
    for name in PASSES:
        if name == base_of(name):
            continue
        more = differences(times[name], times[base_of(name)])
        middle, half = median_and_spread(more)
        lines.append(
            f"- {name}: {middle:+.4f} ± {half:.4f} ms against {CLAIM_MS} ms: {verdict(more)}"
        )
    device = results["about"]["device"]
    same = device.split(",")[0].endswith("RTX 2070")  # not a 2070 SUPER, nor one of a laptop
    other = "" if same else f" This is another card, {device}."
    return "\n".join([f"The talk: at most {CLAIM_MS} ms on an RTX 2070.{other}", "", *lines])


def days(dates: Sequence[str]) -> str:
    """When the rounds were measured, not when they were reported."""
    first, last = min(dates), max(dates)
    return first if first == last else f"{first} to {last}"


def _number(value: float, half: float, digits: int) -> str:
    return f"{value:.{digits}f} ± {half:.{digits}f}"


# --- picture -------------------------------------------------------------------------------------


def draw(pictures: Mapping[str, np.ndarray], path: Path) -> None:
    """What the passes show, and how far from the exact Fresnel each pixel is."""
    rows, columns, _ = next(iter(pictures.values())).shape
    wide, gap, top, left = 2.62, 0.06, 0.3, 0.25
    tall = wide * rows / columns
    with style.styled():
        width, height = left + 3 * wide + 2 * gap + 0.02, top + 4 * tall + 3 * gap + 0.52
        page = Page(width, height)

        def axes(column: int, row: int) -> Any:
            made = page.axes(left + column * (wide + gap), top + row * (tall + gap), wide, tall)
            made.set_axis_off()
            return made

        mappable = None
        titles = ("exact Fresnel", "Schlick", "four terms")
        for column, title in enumerate(titles):
            page.write(left + column * (wide + gap) + 0.5 * wide, 0.5 * top, title, size=9.5)
            for i, kind in enumerate(("uniform", "textured")):
                exact, picture = (pictures[f"{t.split()[0]}, {kind}"] if t.startswith("exact")
                                  else pictures[f"{t}, {kind}"]
                                  for t in ("exact", title))  # fmt: skip
                axes(column, 2 * i).imshow(display(picture, EXPOSURE), vmin=0, vmax=1)
                if column == 0:
                    continue
                difference = delta_e(exact, picture, EXPOSURE)
                panel = axes(column, 2 * i + 1)
                mappable = panel.imshow(difference, cmap=style.SEQUENTIAL, vmin=0, vmax=10.0)
                mean = f"mean ΔE$_{{00}}$ {difference.mean():.2f}"
                panel.text(
                    0.985,
                    0.05,
                    mean,
                    transform=panel.transAxes,
                    ha="right",
                    va="bottom",
                    color="white",
                    size=8,
                    bbox={"boxstyle": "round,pad=0.25", "fc": "#000000a0", "ec": "none"},
                )
        for i, kind in enumerate(("one material: the talk's edge tint", "textures of six metals")):
            y = top + (2 * i + 1) * tall + (2 * i + 0.5) * gap
            page.write(0.5 * left, y, kind, rotation=90, size=9.0)
            page.write(left + 0.5 * wide, top + (2 * i + 1.5) * tall + (2 * i + 1) * gap,
                  "ΔE$_{00}$ from the exact Fresnel →", size=8.5, color=GREY)  # fmt: skip
        page.colour_bar(
            left + wide + gap, height - 0.42, 2 * wide + gap, mappable, "ΔE$_{00}$",
            labelpad=1, extend="max", extendfrac=0.02, ticks=range(0, 11, 2),
        )  # fmt: skip
        page.save(path, dpi=160)

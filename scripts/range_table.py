"""How far fitted reflectances leave [0, 1], and what clamping them would do.

    python scripts/range_table.py --page docs/decomposition.md --out range.json

For every shipped basis, the four sets of `accuracy_table.py` and one of indices that
`Basis.coefficients` refuses (`total_reflection`): the least and the largest fitted
reflectance with the index and the angle where it occurs, the share of curves that leave [0, 1] by
more than rounding, and what `Decomposition(clamp=True)` changes: the largest error and the RMSE of
the curve, and the *bias* of the cosine-weighted average, 2 ∫ (clamp(F) - F) mu dmu, which is what a
preintegrated table, being linear, cannot follow. Then the colours of measured materials under D65:
how many channels exceed 1 at some angle, and what clamping costs those.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from _command_line import json_option, main, page_option, script
from _markdown import insert, markdown, marks
from fresnel_decomp import (
    RECIPES,
    Basis,
    CurveSet,
    Decomposition,
    __version__,
    conductor,
    curves,
    list_materials,
    load_basis,
    load_material,
)
from fresnel_decomp._files import write_json
from fresnel_decomp.accuracy import SETS as ACCURACY_SETS


def total_reflection() -> CurveSet:
    """Set *tir*: eta = linspace(.3, .99, 24) with k = 0 and eight k from 1e-4 to .3."""
    k = np.append(0.0, np.geomspace(1e-4, 0.3, 8))
    eta, k = np.meshgrid(np.linspace(0.3, 0.99, 24), k, indexing="ij")
    return CurveSet("tir", eta.ravel(), k.ravel())


SETS: dict[str, Callable[[], CurveSet]] = {**ACCURACY_SETS, "tir": total_reflection}
ROUNDING = 1e-9
CHUNK = 256
MARKS = marks("range tables")

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Place:
    """A fitted reflectance that is farther out than any other of its set."""

    value: float
    eta: float
    k: float
    degrees: float


@dataclass(frozen=True)
class Range:
    """What a basis makes of a set of curves."""

    least: Place
    largest: Place
    leaving: float
    """Share of curves with a value outside [0, 1]."""
    max_error: tuple[float, float]
    """Largest error without and with clamping."""
    rmse: tuple[float, float]
    bias: tuple[float, float]
    """Least and largest change of the cosine-weighted average by clamping."""


@script()
@click.option(
    "--sets", multiple=True, type=click.Choice(list(SETS)), help="Repeatable.  [default: all]"
)
@click.option("--terms", multiple=True, type=click.IntRange(3, 6), default=(4,), help="Repeatable.")
@page_option(MARKS)
@json_option
def ranges(
    sets: tuple[str, ...], terms: tuple[int, ...], page: Path | None, out: Path | None
) -> None:
    """How far fitted reflectances leave [0, 1], and what clamping them would do."""
    chosen = {name: SETS[name]() for name in sets or SETS}
    bases = [(recipe, count) for recipe in RECIPES for count in terms]
    results: dict[tuple[str, int, str], Range] = {}
    with Progress(console=Console(stderr=True), transient=True) as progress:
        total = len(bases) * sum(map(len, chosen.values()))
        task = progress.add_task("ranges", total=total)
        for recipe, count in bases:
            for name, curve_set in chosen.items():
                advance = functools.partial(progress.advance, task)
                results[recipe, count, name] = measure(
                    load_basis(recipe, count), curve_set, advance
                )
    found = colours()
    text = f"{range_table(results)}\n\n{clamp_table(results)}\n\n{colour_table(found)}"
    click.echo(text)
    if page:
        insert(page, text, MARKS)
    if out:
        rows = [
            {"recipe": recipe, "terms": count, "set": name, **asdict(result)}
            for (recipe, count, name), result in results.items()
        ]
        write_json(out, {"fresnel_decomp": __version__, "ranges": rows, "colours": found})


def measure(basis: Basis, curve_set: CurveSet, advance: Callable[[int], Any]) -> Range:
    """Range and effect of the clamp over `curves.error_cosines`."""
    everywhere, uniform = curves.error_cosines()
    count = len(uniform)
    # Simpson's rule for 2 ∫ F mu dmu on the uniform cosines, an odd number of them
    simpson = np.full(count, 2.0)
    simpson[1::2], simpson[[0, -1]] = 4.0, 1.0
    weights = 2.0 * uniform * simpson / (3.0 * (count - 1))
    lows: list[Place] = []
    highs: list[Place] = []
    leaving, worst, squares, bias = 0, np.zeros(2), np.zeros(2), np.zeros(2)
    for start in range(0, len(curve_set), CHUNK):
        eta = curve_set.eta[start : start + CHUNK]
        k = curve_set.k[start : start + CHUNK]
        coefficients = basis.coefficients(eta, k, poor_fit="keep")[:, None]
        fit = Decomposition(coefficients, basis)(everywhere)
        clamped = Decomposition(coefficients, basis, clamp=True)(everywhere)
        exact = conductor(everywhere, eta[:, None], k[:, None])
        for places, find in ((lows, np.argmin), (highs, np.argmax)):
            i, j = np.unravel_index(int(find(fit)), fit.shape)
            degrees = float(np.degrees(np.arccos(everywhere[j])))
            places.append(Place(float(fit[i, j]), float(eta[i]), float(k[i]), degrees))
        leaving += int(((fit < -ROUNDING) | (fit > 1.0 + ROUNDING)).any(axis=1).sum())
        for i, values in enumerate((fit, clamped)):
            error = np.abs(values - exact)
            worst[i] = max(worst[i], error.max())
            squares[i] += (error[:, :count] ** 2).sum()
        change = (clamped - fit)[:, :count] @ weights
        bias = np.array([min(bias[0], change.min()), max(bias[1], change.max())])
        advance(len(eta))
    rmse = np.sqrt(squares / (count * len(curve_set)))
    return Range(
        min(lows, key=lambda place: place.value),
        max(highs, key=lambda place: place.value),
        leaving / len(curve_set),
        (float(worst[0]), float(worst[1])),
        (float(rmse[0]), float(rmse[1])),
        (float(bias[0]), float(bias[1])),
    )


def colours() -> list[dict[str, Any]]:
    """Channels of measured materials, linear sRGB under D65, that exceed 1 or fall below 0."""
    cos_theta = np.linspace(0.0, 1.0, 513)
    found = []
    for row in list_materials():
        if not row.usable or row.duplicate_of:
            continue
        material = load_material(row.name)
        exact = material.rgb_reflectance(cos_theta)
        for channel, curve in zip("RGB", exact.T, strict=True):
            over, under = float(curve.max()) - 1.0, -float(curve.min())
            if max(over, under) > ROUNDING:
                found.append(
                    {"material": row.name, "channel": channel, "above": over, "below": under}
                )
    return found


def range_table(results: dict[tuple[str, int, str], Range]) -> str:
    rows = []
    for (recipe, terms, name), result in results.items():
        cells = [f"{recipe}, {terms} terms", name]
        for place in (result.least, result.largest):
            where = f"{place.eta:.3g} + {place.k:.3g}i, {place.degrees:.1f}°"
            # at 1, which all curves reach at grazing incidence, rounding would choose the place
            at_one = abs(place.value - 1.0) <= ROUNDING
            cells.append(f"{place.value:.4f}" if at_one else f"{place.value:.4f} ({where})")
        rows.append([*cells, f"{100.0 * result.leaving:.0f} %"])
    return markdown(["basis", "set", "least", "largest", "curves that leave [0, 1]"], rows)


def clamp_table(results: dict[tuple[str, int, str], Range]) -> str:
    rows = []
    for (recipe, terms, name), result in results.items():
        pairs = [f"{a:.4f} → {b:.4f}" for a, b in (result.max_error, result.rmse)]
        bias = " to ".join(f"{value:+.4f}" for value in result.bias)
        rows.append([f"{recipe}, {terms} terms", name, *pairs, bias])
    return markdown(["by clamping", "set", "largest error", "RMSE", "bias of the average"], rows)


def colour_table(found: list[dict[str, Any]]) -> str:
    rows = [
        [f"{entry['material']}, {entry['channel']}", f"{entry['above']:+.4f}"]
        for entry in sorted(found, key=lambda entry: -entry["above"])
        if entry["above"] > ROUNDING
    ]
    return markdown(["exact colour above 1 (D65)", "lost by clamping, at most"], rows)


if __name__ == "__main__":
    main(ranges)

"""What the Fresnel term alone costs under area lights, by recipe and number of terms.

    python scripts/area_light_fresnel.py --page docs/area_lights.md

The scenes of `area_light_study.py`, by linearly transformed cosines only: the same lobe with the
exact albedo of each metal and with that of a table. There is no noise in it. NRMSE in percent, the
largest of all lights and roughnesses. About two minutes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import click

from _area_lights import METALS, OBJECTS, SCENES, Study
from _command_line import main, page_option, script
from _figure import Job
from _markdown import insert, markdown, marks
from fresnel_decomp import RECIPES, doctor
from fresnel_decomp.images import nrmse

TERMS = (4, 5)
MARKS = marks("area light fresnel")
BOUND = 0.005
"""What a metal's Fresnel term may add."""

Errors = Mapping[tuple[str, str, str], float]


def errors(size: int) -> Errors:
    """The largest NRMSE over lights and roughnesses, by model, metal and object."""
    from fresnel_decomp.mitsuba.variants import variant_scope

    variant = doctor.best_variant()
    settings = {"size": size, "spp": 1, "seed": 0, "variant": variant}
    found: dict[tuple[str, str, str], float] = {}
    with variant_scope(variant), tempfile.TemporaryDirectory() as folder:
        study = Study(Job(Path(folder), settings, lambda step, fraction: None))
        for scene in SCENES:
            inside = study.inside(scene)
            for metal in METALS:
                exact = study.shaded(scene, metal, "exact", "none")[inside][None]
                for recipe in RECIPES:
                    for terms in TERMS:
                        model = f"{recipe}-{terms}"
                        fitted = study.shaded(scene, metal, model, "none")[inside][None]
                        key = (model, metal, scene.object)
                        found[key] = max(found.get(key, 0.0), nrmse(exact, fitted))
    return found


def table(found: Errors) -> str:
    places = [(metal, thing) for metal in METALS for thing in OBJECTS]
    rows = []
    for recipe in RECIPES:
        for terms in TERMS:
            values = [found[f"{recipe}-{terms}", *place] for place in places]
            cells = [f"{100.0 * value:.2f}" for value in values]
            inside = "yes" if max(values) <= BOUND else "no"
            rows.append([f"{recipe}, {terms} terms", *cells, inside])
    head = ["NRMSE, %", *(f"{m}, {o}" for m, o in places), f"all within {100 * BOUND:g} %"]
    return markdown(head, rows)


@script()
@click.option("--size", type=click.IntRange(min=8), default=96, show_default=True)
@page_option(MARKS)
def command(size: int, page: Path | None) -> None:
    """What the Fresnel term alone costs under area lights."""
    text = table(errors(size))
    click.echo(text)
    if page is not None:
        insert(page, text, MARKS)


if __name__ == "__main__":
    main(command)

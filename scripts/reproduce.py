"""Compute and draw the figures that are not finished yet.

    python scripts/reproduce.py
    python scripts/reproduce.py --only fig01a fig02
    python scripts/reproduce.py --quick --out out/trial

Interrupt it when you like: finished images are kept, and the same command goes on from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

import area_light_study
import energy_study
import fig01a_basis
import fig01b_beryllium
import fig01c_roughness
import fig02_edge_tint
import fig03_shader_balls
import fig04_linear_tint
import inverse_study
import principled_study
import split_sum_study
import table_study
from _command_line import script, shown
from _figure import Figure, compute, draw, is_drawn
from _figure_commands import computing, folders, main, say_if_reduced
from fresnel_decomp._check import choose
from fresnel_decomp._files import writable_folder

FIGURES = {
    module.FIGURE.name: module.FIGURE
    for module in (
        fig01a_basis,
        fig01b_beryllium,
        fig01c_roughness,
        fig02_edge_tint,
        fig03_shader_balls,
        fig04_linear_tint,
        inverse_study,
        split_sum_study,
        table_study,
        principled_study,
        area_light_study,
        energy_study,
    )
}


def select(names: Sequence[str]) -> list[Figure]:
    """Figures whose names start with one of these, in order; all of them if none is given.

    Raises
    ------
    InputError
        For a name that no figure starts with.
    """
    chosen = set()
    for name in names:
        matches = [full for full in FIGURES if name and full.startswith(name)]
        if not matches:
            choose("figure", name, FIGURES if "_" in name else [f.split("_")[0] for f in FIGURES])
        chosen.update(matches)
    return [figure for name, figure in FIGURES.items() if not names or name in chosen]


@script()
@click.option("--list", "listing", is_flag=True, help="List the figures and stop.")
@click.option("--only", multiple=True, metavar="NAME...", help="Figures whose names start so.")
@click.argument("more", nargs=-1, metavar="")
@computing()
def reproduce(
    listing: bool,
    only: tuple[str, ...],
    more: tuple[str, ...],
    quick: bool,
    force: bool,
    variant: str | None,
    out: Path | None,
) -> None:
    """Compute and draw the figures that are not finished yet."""
    figures = select([*only, *more])
    if listing:
        for figure in figures:
            click.echo(f"{figure.name:<20}{figure.minutes:4.1f} min  {figure.title}")
        return
    data, pictures = folders(quick, out)
    for folder in (data, pictures):
        writable_folder(folder)
    if any(figure.scene for figure in figures):
        say_if_reduced(variant)
    for figure in figures:
        folder = data / figure.name
        seconds = compute(figure, folder, quick=quick, force=force, variant=variant)
        news = "was finished" if seconds is None else f"computed in {seconds:.1f} s"
        if seconds is not None or not is_drawn(figure, folder, pictures):
            drawn = draw(figure, folder, pictures)
            news += f", drew {', '.join(map(shown, drawn))}"
        click.echo(f"{figure.name:<20}{news}")


if __name__ == "__main__":
    main(reproduce)

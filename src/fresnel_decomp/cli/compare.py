"""`fresnel-decomp compare`: the main job."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .._check import input_error
from ._numbers import Numbers
from ._options import permission_options, terms_option, variant_option
from ._terminal import print_table, progress_bar, resumable

if TYPE_CHECKING:
    from ..subjects import Subject

__all__ = ["compare"]


@click.command()
@click.argument("materials", nargs=-1, metavar="[MATERIAL]...")
@click.option(
    "--eta",
    type=Numbers(),
    multiple=True,
    help="Index per channel: R G B, or one number. With --k; repeatable.",
)
@click.option(
    "--k", type=Numbers(), multiple=True, help="Extinction per channel: R G B, or one number."
)
@click.option(
    "--rg",
    type=Numbers(),
    multiple=True,
    help="Reflectivity and edge tint: r g, or six numbers, r of R G B, then g. Repeatable.",
)
@click.option(
    "--alpha",
    type=float,
    multiple=True,
    default=(0.1,),
    show_default=True,
    help="Roughness, in (0, 1]. Repeatable.",
)
@click.option(
    "--recipe", default="talk", show_default=True, help="Basis, see docs: talk, balanced, ..."
)
@terms_option
@variant_option
@click.option("--spp", type=int, help="Samples per pixel.  [default: 64; 16 in scalar variants]")
@click.option(
    "--size", type=int, help="Pixels along a side.  [default: 256; 64 in scalar variants]"
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the sampler.")
@click.option(
    "--scene", default="studio", show_default=True, help="studio (a sphere) or shader-ball."
)
@permission_options
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for the results.  [default: out/MATERIAL]",
)
def compare(
    materials: Sequence[str],
    eta: Sequence[list[float]],
    k: Sequence[list[float]],
    rg: Sequence[list[float]],
    alpha: Sequence[float],
    out: Path | None,
    variant: str | None,
    allow_partial: bool,
    allow_broken: bool,
    **options: Any,
) -> None:
    """Compare Fresnel models for materials: curves, renders, errors and times.

    MATERIAL is a measured metal ("Be", "gold"; see `fresnel-decomp materials`) or a .spd or CSV
    file of wavelength, n, k. Results are curves.png, renders.png, EXR images, report.json and
    report.md.

    \b
    fresnel-decomp compare Be
    fresnel-decomp compare Au Cu --alpha 0.05 --alpha 0.3
    fresnel-decomp compare --eta 0.2 0.92 1.1 --k 3.9 2.45 2.14
    fresnel-decomp compare --rg 0.44 0.44 0.44 0 1 0 --alpha 0.08
    """
    from .. import doctor

    best = doctor.best_variant()
    from ..report.comparison import Settings, default_folder, run
    from ..report.comparison_words import summary_rows, times_line

    accept = {"allow_partial": allow_partial, "allow_broken": allow_broken}
    subjects = _subjects(materials, eta, k, rg, accept)
    settings = Settings(subjects, tuple(alpha), variant=variant or best, **options)
    settings.check()
    if variant is None and best.startswith("scalar"):
        click.echo(f"No usable LLVM or GPU: rendering in {best} at a reduced size.", err=True)
    folder = default_folder(subjects) if out is None else out
    with resumable(folder), progress_bar() as progress:
        report = run(settings, folder, ["fresnel-decomp", *sys.argv[1:]], progress)
    click.echo(f"Wrote curves.png, renders.png, report.md and report.json to {folder}")
    click.echo(times_line(report))
    print_table(summary_rows(report))


def _subjects(
    materials: Sequence[str],
    eta: Sequence[list[float]],
    k: Sequence[list[float]],
    rg: Sequence[list[float]],
    accept: dict[str, bool],
) -> list[Subject]:
    from ..subjects import from_gulbrandsen, from_indices, from_material

    if len(eta) != len(k):
        raise input_error(
            f"{len(eta)} × --eta and {len(k)} × --k",
            "as many of one as of the other",
            "For example --eta 0.2 0.92 1.1 --k 3.9 2.45 2.14",
        )
    for numbers in rg:
        if len(numbers) not in (2, 6):
            raise input_error(
                f"--rg with {len(numbers)} numbers",
                "r g, or six: r of the channels R, G, B, then g",
                "For example --rg 0.9 0.5",
            )
    subjects = [from_material(material, **accept) for material in materials]
    subjects += [from_indices(*pair) for pair in zip(eta, k, strict=True)]
    subjects += [from_gulbrandsen(n[: len(n) // 2], n[len(n) // 2 :]) for n in rg]
    if not subjects:
        raise input_error(
            "no material", "a MATERIAL, --eta with --k, or --rg", "For example: compare Be"
        )
    given = [(subject.name, subject.material and subject.material.source) for subject in subjects]
    return [s for i, s in enumerate(subjects) if given[i] not in given[:i]]

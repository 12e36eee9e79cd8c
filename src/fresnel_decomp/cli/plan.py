"""`fresnel-decomp plan`: the cheapest Fresnel terms of a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .._check import input_error
from ._options import variant_option
from ._terminal import print_table, progress_bar

__all__ = ["plan"]


@click.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("--max-error", type=float, required=True, help="Bound on the error, by --metric.")
@click.option(
    "--metric",
    default="reflectance",
    show_default=True,
    help="reflectance (0.01 is one per cent of the light), or delta-e (CIEDE2000).",
)
@click.option(
    "--contrast",
    type=float,
    help="Of the light; inf holds in any.  [default: what the emitters have]",
)
@variant_option
@click.option(
    "--out", type=click.Path(path_type=Path), help="Write the scene with the plan to this XML file."
)
def plan(
    scene: Path,
    max_error: float,
    metric: Any,
    contrast: float | None,
    variant: str | None,
    out: Path | None,
) -> None:
    """Plan a scene: the cheapest Fresnel term for each metal that keeps a bound.

    SCENE is a Mitsuba scene in XML. Says what each conductor takes, with its predicted error,
    operations and bytes, and what stays exact and why.

    \b
    fresnel-decomp plan scene.xml --max-error .01
    fresnel-decomp plan scene.xml --max-error 1 --metric delta-e --out planned.xml
    """
    from .. import doctor
    from .._files import writable_folder

    if out is not None:
        if out.suffix != ".xml":
            raise input_error(f"--out {out}", "a file ending in .xml", "Rename it.")
        writable_folder(out.parent)
    chosen = variant or doctor.best_variant()
    doctor.require_variant(chosen)
    import mitsuba as mi

    mi.set_variant(chosen)
    from ..mitsuba.scene_plan import plan_scene
    from ..report.plan import summary

    with progress_bar() as progress:
        planned = plan_scene(
            scene,
            max_error,
            metric,
            contrast=contrast,
            progress=lambda fraction: progress("planning", fraction),
        )
    for part in summary(planned):
        if isinstance(part, str):
            click.echo(part)
        else:
            print_table(part)
    if out is not None:
        planned.write(out)
        click.echo(f"Wrote {out}")

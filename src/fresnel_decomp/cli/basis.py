"""`fresnel-decomp basis`: a basis in a figure and in numbers."""

from __future__ import annotations

from pathlib import Path

import click

from ._options import check_picture, terms_option

__all__ = ["basis"]


@click.command()
@click.option(
    "--recipe", default="talk", show_default=True, help="talk, notebook, balanced, robust, ..."
)
@terms_option
@click.option(
    "--out", type=click.Path(path_type=Path), help="Figure.  [default: out/basis-RECIPE-TERMS.png]"
)
def basis(recipe: str, terms: int | None, out: Path | None) -> None:
    """Plot a basis; print its nodes, conditioning and origin."""
    import numpy as np

    from ..basis import load_basis
    from ..report.basis import draw_basis

    loaded = load_basis(recipe, terms)
    name = Path(recipe).stem if recipe.endswith(".json") else recipe
    path = Path("out") / f"basis-{name}-{loaded.terms}.png" if out is None else out
    check_picture(path)
    draw_basis(loaded, path)
    origin = loaded.provenance
    for number, node in enumerate(loaded.nodes, 2):
        click.echo(
            f"node {number}: {node:.6f} rad = {np.degrees(node):.4f}°, cos = {np.cos(node):.6f}"
        )
    click.echo(f"condition number of the node system: {loaded.condition:.4f}")
    m, n = len(loaded.closed_form.denominator) - 1, loaded.closed_form.numerators.shape[1]
    click.echo(
        f"closed form: degree {n} over {m}, shared denominator, "
        f"within {loaded.closed_form.error:.1e} of the extracted functions"
    )
    click.echo(
        f"training set '{origin['training_set']}': {origin['training_curves']} curves, "
        f"{origin['grid']}, sha256 {origin['training_sha256'][:16]}…"
    )
    click.echo(f"rule: {origin['rule']}; signs: {origin['sign_rule']}")
    click.echo(f"Wrote {path}")

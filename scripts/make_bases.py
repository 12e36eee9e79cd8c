"""Extract the bases that ship with the package and write them to its data folder.

    python scripts/make_bases.py [RECIPE]...

Needed only after a change of the recipes: `load_basis` reads these files, and a test rebuilds them
and compares.
"""

from __future__ import annotations

import time
from pathlib import Path

import click

import fresnel_decomp
from fresnel_decomp import RECIPES, extract_basis
from fresnel_decomp._files import write_json

DATA = Path(fresnel_decomp.__file__).parent / "data"


@click.command()
@click.argument("recipes", nargs=-1, type=click.Choice(list(RECIPES)))
def main(recipes: tuple[str, ...]) -> None:
    """Extract RECIPES (default: all) with 3 to 6 terms."""
    for recipe in recipes or RECIPES:
        for terms in (3, 4, 5, 6):
            start = time.perf_counter()
            basis = extract_basis(recipe, terms)
            extracted = time.perf_counter()
            write_json(DATA / f"{recipe}-{terms}.json", basis.to_json())
            click.echo(
                f"{recipe}-{terms}: nodes {basis.nodes.round(4).tolist()}, "
                f"condition {basis.condition:.2f}, closed form within "
                f"{basis.closed_form.error:.1e}; extraction {extracted - start:.2f} s, "
                f"closed form {time.perf_counter() - extracted:.1f} s"
            )


if __name__ == "__main__":
    main()

"""Extract the bases that ship with the package and write them to its data folder.

    python scripts/make_bases.py [RECIPE]...
    python scripts/make_bases.py --search [--terms 4] [RECIPE]...

Needed only after a change of the recipes: `load_basis` reads these files, and a test rebuilds them
and compares. With --search nothing is written: the nodes, poles and bounds of recipes by
constrained regression are searched for anew and printed beside those that ship.
"""

from __future__ import annotations

import time
from pathlib import Path

import click
from rich.console import Console
from rich.status import Status

import fresnel_decomp
from _command_line import main, script
from fresnel_decomp import RECIPES, extract_basis
from fresnel_decomp._files import write_json
from fresnel_decomp.regression import Design, least_largest_error, regress
from fresnel_decomp.regression_recipes import (
    REGRESSION_RECIPES,
    RegressionRecipe,
    search_design,
    training_for,
)

DATA = Path(fresnel_decomp.__file__).parent / "data"
TERMS = (3, 4, 5, 6)


@script()
@click.argument("recipes", nargs=-1, type=click.Choice(list(RECIPES)))
@click.option("--terms", type=click.IntRange(3, 6), help="Only this number (default: all).")
@click.option("--search", is_flag=True, help="Search for nodes and poles; write nothing.")
def extraction(recipes: tuple[str, ...], terms: int | None, search: bool) -> None:
    """Extract RECIPES (default: all) with 3 to 6 terms."""
    for recipe in recipes or (REGRESSION_RECIPES if search else RECIPES):
        for count in TERMS if terms is None else (terms,):
            if search:
                search_again(recipe, count)
            else:
                extract(recipe, count)


def extract(recipe: str, terms: int) -> None:
    """Extract one basis and write it."""
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


def search_again(recipe: str, terms: int) -> None:
    """Search nodes and pole of one recipe and compare."""
    regression = RECIPES[recipe]
    if not isinstance(regression, RegressionRecipe):
        raise click.UsageError(f"the nodes of '{recipe}' are not searched for")
    start = time.perf_counter()
    training_for(regression.objective)
    with Status("searching", console=Console(stderr=True)) as status:
        found = search_design(
            regression,
            terms,
            report=lambda count, value: status.update(
                f"{recipe}, {terms} terms: {count} evaluations, {value:.5g}"
            ),
        )
    click.echo(f"{recipe}-{terms}, {time.perf_counter() - start:.0f} s")
    shipped = regression.designs.get(terms)
    for name, design in (("found", found), ("ships", shipped)):
        if design is not None:
            click.echo(f"  {name} {describe(regression, terms, design)}")


def describe(recipe: RegressionRecipe, terms: int, design: Design) -> str:
    """Nodes, pole, factor on the bounds, and what they were searched for."""
    factor = design.bounds["a"] / recipe.reference[terms]["a"]
    training = training_for(recipe.objective)
    if recipe.least:
        units = Design(design.nodes, design.pole, design.degrees, recipe.reference[terms])
        value = f"least largest error {least_largest_error(training, units):.5f}"
    else:
        value = f"mean square {regress(training, design, recipe.weights).mean_square:.5f}"
    return f"{design.nodes}, {design.pole:g}, {factor:.4g}: {value}"


if __name__ == "__main__":
    main(extraction)

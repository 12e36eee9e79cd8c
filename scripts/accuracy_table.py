"""How far every model is from the exact Fresnel equations, on four sets of curves.

    python scripts/accuracy_table.py --out accuracy.json
    python scripts/accuracy_table.py --variations

Prints four Markdown tables: errors ("largest / RMSE"), those of the directional albedo ("mean /
RMSE"), where the largest errors are, and the nodes of the bases. The sets are those of
`fresnel_decomp.curves`: a (dielectrics), cp (Gulbrandsen's parameters), d (every measured material
that ships with Mitsuba), low (low-index conductors). The largest error is over all of
`curves.error_cosines`, which is dense at grazing incidence; the RMSE is over 2,049 cosines, uniform
on [0, 1], and all curves of the set. The albedo is that of a rough surface (GGX, separable Smith),
averaged over the view's cosine in [0, 1] and alpha in [.08, 1]. Fits that `Basis.coefficients`
would refuse are kept, so that nothing is left out.

With --variations the models are instead the two recipes of four terms with one choice changed.
"""

from __future__ import annotations

import csv
import functools
import io
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.progress import Progress

from _colour_models import colour_errors
from _command_line import check_suffixes, main, script
from _markdown import markdown
from fresnel_decomp import (
    RECIPES,
    Basis,
    __version__,
    curves,
    extract_basis,
    list_materials,
    load_basis,
)
from fresnel_decomp._files import write_json, write_text
from fresnel_decomp.accuracy import SETS, TERMS, Array, Errors, Fit, decomposition, fits, measure


@script()
@click.option(
    "--sets", multiple=True, type=click.Choice(list(SETS)), help="Repeatable.  [default: all]"
)
@click.option("--variations", is_flag=True, help="Recipes with a choice changed.")
@click.option(
    "--out", multiple=True, type=click.Path(path_type=Path), help="Also write .json and .csv."
)
def accuracy(sets: tuple[str, ...], variations: bool, out: tuple[Path, ...]) -> None:
    """How far every model is from the exact Fresnel equations, on four sets of curves."""
    check_suffixes(out)
    chosen = {name: SETS[name]() for name in sets or SETS}
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("errors", total=sum(map(len, chosen.values())))
        models = varied if variations else fits
        results = {
            name: measure(curve_set, lambda count: progress.advance(task, count), models=models)
            for name, curve_set in chosen.items()
        }
    click.echo(error_table(results, None if variations else colours()))
    if not variations:
        tables = (albedo_table(results), worst_table(results), basis_table())
        click.echo("\n" + "\n\n".join(tables))
    for path in out:
        write(path, results, {name: len(curve_set) for name, curve_set in chosen.items()})


@functools.cache
def changed_recipes() -> dict[str, Basis]:
    """The two recipes of four terms, and each with one of its choices changed."""
    talk, notebook = load_basis("talk"), load_basis("notebook")
    free = extract_basis(curves.talk_training_set())
    whole = extract_basis(curves.notebook_training_set(), nodes=talk.nodes.tolist())
    joint = extract_basis(curves.talk_training_set(), rule="joint", nodes=talk.nodes.tolist())
    return {
        "talk": talk,
        f"its rule, nodes {free.nodes[0]:.4g} and {free.nodes[1]:.4g} where functions peak": free,
        "its rule and nodes, row with r > 1 kept": whole,
        "its curves and nodes, the notebook's rule": joint,
        "notebook": notebook,
        "its functions, nodes 1.45 and 1.31": replace(notebook, nodes=talk.nodes),
    }


def varied(cos_theta: Array) -> dict[str, Fit]:
    """As `fits`, for `changed_recipes`."""
    return {name: decomposition(basis, cos_theta) for name, basis in changed_recipes().items()}


def error_table(
    results: dict[str, dict[str, Errors]], colours: Mapping[str, str] | None = None
) -> str:
    """Largest error and RMSE of each model on each set; what `colours` says of them last."""
    return _models_by_sets(
        results,
        "largest error / RMSE",
        lambda e: f"{e.max:.4f} / {e.rmse:.4f}",
        {"mean / largest ΔE00 (D65)": colours} if colours else {},
    )


def colours() -> dict[str, str]:
    """Mean and largest ΔE00 of each model over all usable materials, see `colour_errors`."""
    usable = [row.name for row in list_materials() if row.usable and not row.duplicate_of]
    return colour_errors(usable)


def albedo_table(results: dict[str, dict[str, Errors]]) -> str:
    """Mean error and RMSE of the directional albedo, of each model on each set."""
    return _models_by_sets(
        results,
        "albedo: mean error / RMSE",
        lambda e: f"{e.albedo_mean:.5f} / {e.albedo_rmse:.5f}",
    )


def worst_table(results: dict[str, dict[str, Errors]]) -> str:
    """Where each model errs most on each set."""
    return _models_by_sets(
        results,
        "largest error at",
        lambda e: f"{e.worst_eta:.2f} + {e.worst_k:.2f}i, {e.worst_degrees:.1f}°",
    )


def basis_table() -> str:
    """Nodes, conditioning and closed form of every basis that ships."""
    rows = []
    for recipe in RECIPES:
        for terms in TERMS:
            basis = load_basis(recipe, terms)
            form = basis.closed_form
            nodes = ", ".join(f"{node:.5g}" for node in basis.nodes)
            degrees = f"{form.numerators.shape[1]} / {form.denominator.size - 1}"
            error = f"{form.error:.1e}" if form.error > 1e-11 else "exact"
            rows.append([recipe, str(terms), nodes, f"{basis.condition:.2f}", degrees, error])
    head = ["recipe", "terms", "nodes (radians)", "condition", "degrees", "closed-form error"]
    return markdown(head, rows)


def _models_by_sets(
    results: dict[str, dict[str, Errors]],
    title: str,
    cell: Callable[[Errors], str],
    more: Mapping[str, Mapping[str, str]] | None = None,
) -> str:
    models, more = next(iter(results.values())), more or {}
    rows = [
        [name, *(cell(results[s][name]) for s in results), *(m[name] for m in more.values())]
        for name in models
    ]
    return markdown([title, *results, *more], rows)


def write(path: Path, results: dict[str, dict[str, Errors]], counts: dict[str, int]) -> None:
    """All numbers, as JSON with versions or as CSV with one row for each set and model."""
    rows = [
        {"set": name, "curves": counts[name], "model": model, **asdict(errors)}
        for name, models in results.items()
        for model, errors in models.items()
    ]
    if path.suffix == ".csv":
        text = io.StringIO()
        writer = csv.DictWriter(text, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        write_text(path, text.getvalue())
        return
    versions = {"fresnel_decomp": __version__, "numpy": np.__version__}
    hashes = {name: SETS[name]().sha256 for name in results}
    write_json(path, {"versions": versions, "sets_sha256": hashes, "errors": rows})


if __name__ == "__main__":
    main(accuracy)

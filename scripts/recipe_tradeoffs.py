"""What recipes trade for what: a figure, and errors on materials that they were not trained on.

    python scripts/accuracy_table.py --out errors.json
    python scripts/recipe_tradeoffs.py figure errors.json
    python scripts/recipe_tradeoffs.py held-out

`figure` draws the largest error against the RMSE of every basis that ships, for each of the four
sets. `held-out` extracts the recipes by constrained regression twice more, each time without every
second material of set d, judges each of these on the materials it did not see, and all on random
indices that are in no training set; it prints a Markdown table.
"""

from __future__ import annotations

import json
from pathlib import Path

import click
import numpy as np

from _command_line import HELP, ROOT, main
from _markdown import markdown
from _page import GREY, Page
from fresnel_decomp import CurveSet, curves, gulbrandsen_to_ior
from fresnel_decomp.accuracy import SETS, TERMS
from fresnel_decomp.regression import Regression, Training, regress
from fresnel_decomp.regression_recipes import REGRESSION_RECIPES
from fresnel_decomp.report import style
from fresnel_decomp.spectra import list_materials

PICTURE = ROOT / "docs" / "figures" / "recipes.png"
TITLES = {
    "a": "a: dielectrics",
    "cp": "cp: reflectivity and edge tint",
    "d": "d: measured materials",
    "low": "low: conductors with η ≤ 1",
}


@click.group(context_settings=HELP)
def tradeoffs() -> None:
    """Trade-offs between recipes."""


@tradeoffs.command()
@click.argument("errors", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), default=PICTURE)
def figure(errors: Path, out: Path) -> None:
    """Draw what accuracy_table.py wrote to ERRORS."""
    rows = json.loads(errors.read_text(encoding="utf-8"))["errors"]
    found = {(row["set"], row["model"]): (row["max"], row["rmse"]) for row in rows}
    with style.styled():
        page = Page(8.8, 7.0)
        for index, name in enumerate(SETS):
            axes = page.axes(0.75 + 4.1 * (index % 2), 0.9 + 3.05 * (index // 2), 3.7, 2.35)
            for recipe, colour in style.RECIPE_COLOURS.items():
                x, y = np.array([found[name, f"{recipe}, {terms} terms"] for terms in TERMS]).T
                axes.plot(x, y, color=colour, lw=0.9, alpha=0.55)
                axes.plot(
                    x,
                    y,
                    color=colour,
                    lw=0,
                    marker=style.RECIPE_MARKERS[recipe],
                    ms=5.5,
                    label=recipe,
                )
                for terms, place in zip(TERMS, zip(x, y, strict=True), strict=True):
                    axes.annotate(
                        str(terms), place, xytext=(4, 3), textcoords="offset points", size=6.5,
                        color=colour,
                    )  # fmt: skip
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_title(TITLES[name], loc="left")
            if index >= 2:
                axes.set_xlabel("largest error")
            if index % 2 == 0:
                axes.set_ylabel("RMSE")
            axes.tick_params(which="both", labelsize=8)
        page.write(0.2, 0.22, "Largest error and RMSE with 3 to 6 terms", ha="left", size=11)
        page.write(0.2, 0.46, "Number beside the mark: terms. Lower left is better.", ha="left",
                   size=8, color=GREY)  # fmt: skip
        handles, labels = axes.get_legend_handles_labels()
        page.figure.legend(
            handles, labels, loc="upper right", ncols=6, bbox_to_anchor=(0.985, 0.995),
            handlelength=0.8, columnspacing=1.1,
        )  # fmt: skip
        page.save(out, dpi=160)
    click.echo(f"Wrote {out}")


@tradeoffs.command()
@click.option("--terms", type=click.IntRange(3, 6), multiple=True, default=(4, 5))
def held_out(terms: tuple[int, ...]) -> None:
    """Print errors on what was not trained on."""
    names = [entry.name for entry in list_materials() if entry.duplicate_of is None]
    halves = [curves.measured_metals(names[first::2]) for first in (0, 1)]
    judged = [half.take(slice(None, None, 4)) for half in halves]  # every fourth nanometre
    others = {name: SETS[name]() for name in ("a", "cp", "low")}
    random = random_indices()
    rows = []
    for objective in dict.fromkeys(recipe.objective for recipe in REGRESSION_RECIPES.values()):
        trainings = [Training({**others, "d": half}, objective) for half in halves]
        for name, recipe in REGRESSION_RECIPES.items():
            if recipe.objective != objective:
                continue
            for count in terms:
                design = recipe.designs[count]
                folds = [regress(training, design, recipe.weights) for training in trainings]
                cells = []
                for fold, seen, unseen in zip(folds, judged, judged[::-1], strict=True):
                    cells += [cell(fold, seen), cell(fold, unseen)]
                cells += [cell(folds[0], members) for members in random]
                rows.append([f"{name}, {count} terms", *cells])
    head = ["largest error / RMSE", "first half, trained", "second, held out",
            "second half, trained", "first, held out", *(s.name for s in random)]  # fmt: skip
    click.echo(markdown(head, rows))


def random_indices(count: int = 2000) -> list[CurveSet]:
    """Dielectrics, (r, g) with n <= 6, and low indices, at random within the ranges of the sets."""
    rng = np.random.default_rng(7)
    eta, k = gulbrandsen_to_ior(rng.uniform(1 / 128, 127 / 128, count), rng.uniform(0, 1, count))
    return [
        CurveSet("random a", rng.uniform(1.01, 3.0, count), np.zeros(count)),
        CurveSet("random cp", eta[eta <= 6.0], k[eta <= 6.0]),
        CurveSet("random low", rng.uniform(0.05, 1.0, count), rng.uniform(0.5, 8.0, count)),
    ]


def cell(regression: Regression, members: CurveSet) -> str:
    """Largest error and RMSE of a regression on a set."""
    cos_theta, uniform = curves.error_cosines()
    functions = regression.functions(cos_theta)
    at_nodes = regression.functions(np.cos(regression.nodes))
    largest, square = 0.0, 0.0
    for start in range(0, len(members), 256):
        part = members.take(slice(start, start + 256))
        f = part.reflectance(np.cos([0.0, *regression.nodes]))
        f0 = f[:, :1]
        inner = np.linalg.solve(at_nodes[:, 1:], (f[:, 1:] - f0 - (1 - f0) * at_nodes[:, 0]).T).T
        error = f0 + (1 - f0) * functions[:, 0] + inner @ functions[:, 1:].T
        error -= part.reflectance(cos_theta)
        largest = max(largest, float(np.abs(error).max()))
        square += float((error[:, : len(uniform)] ** 2).mean(axis=1).sum())
    return f"{largest:.4f} / {np.sqrt(square / len(members)):.4f}"


if __name__ == "__main__":
    main(tradeoffs)

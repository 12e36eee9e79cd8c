"""Recipes by constrained regression: what each minimises, its bounds, nodes and poles.

Bounds and weights are in units of what the recipe `notebook` errs on each set, so that a set of
curves that are hard to follow does not outweigh the others. Nodes and poles are those that
`search_design` finds, rounded; with them a basis is the solution of one convex programme.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from .curves import SETS, CurveSet
from .node_search import search
from .regression import Design, Objective, Training, least_largest_error

__all__ = [
    "NOTEBOOK_ALBEDO_RMSE",
    "NOTEBOOK_MAX",
    "NOTEBOOK_RMSE",
    "REGRESSION_RECIPES",
    "RegressionRecipe",
    "search_design",
    "training_for",
]

NOTEBOOK_MAX = {
    3: {"a": 0.1755, "cp": 0.1180, "d": 0.0663, "low": 0.1755},
    4: {"a": 0.1200, "cp": 0.1001, "d": 0.0375, "low": 0.0542},
    5: {"a": 0.0249, "cp": 0.0319, "d": 0.0090, "low": 0.0459},
    6: {"a": 0.0074, "cp": 0.0213, "d": 0.0062, "low": 0.0343},
}
"""Largest errors of the recipe `notebook`, by number of terms and set."""

NOTEBOOK_RMSE = {"a": 0.0025, "cp": 0.0033, "d": 0.0025, "low": 0.0054}
"""RMSE of `notebook` with 4 terms, by set."""

NOTEBOOK_ALBEDO_RMSE = {"a": 0.00050, "cp": 0.00090, "d": 0.00057, "low": 0.00272}
"""The same of the directional albedo, see `regression.Training`."""

SLACK = 1.05
"""Bounds of `robust` and `minimax` in units of the least possible: 5 % more lower the RMSE by a
quarter to a half."""

DEGREES = {3: (5, 4), 4: (6, 5), 5: (7, 6), 6: (8, 7)}
"""(n, m) by number of terms, see `regression.Design`: no more than `talk` and `notebook` have."""

START = {
    3: (1.395,),
    4: (1.5093, 1.19),
    5: (1.5275, 1.397, 0.968),
    6: (1.536, 1.455, 1.23, 0.823),
}
"""Where searches for nodes begin, with a pole of 0.3."""


@dataclass(frozen=True)
class RegressionRecipe:
    """A named, reproducible way to a basis by constrained regression.

    Attributes
    ----------
    objective : Objective
    weights : mapping
        Of the mean square errors of the sets.
    reference : mapping from numbers of terms to errors by set
        The shape of the bounds.
    least : bool
        Whether nodes are searched for the least largest error, in units of `reference`, and the
        bounds are `SLACK` times that; else nodes are searched for the least objective, and the
        bounds are `reference`.
    designs : mapping from numbers of terms to `Design`
    summary : one line
    """

    objective: Objective
    weights: Mapping[str, float]
    reference: Mapping[int, Mapping[str, float]]
    least: bool
    designs: Mapping[int, Design]
    summary: str

    def training(self) -> CurveSet:
        """All curves of the sets that are fitted."""
        return _all_curves()


def _scaled(factors: Mapping[int, Mapping[str, float]]) -> dict[int, dict[str, float]]:
    """Factors times the largest errors of `notebook`, rounded to four digits."""
    return {
        terms: {name: round(factor * NOTEBOOK_MAX[terms][name], 4) for name, factor in row.items()}
        for terms, row in factors.items()
    }


def _inverse_squares(errors: Mapping[str, float]) -> dict[str, float]:
    return {name: error**-2 for name, error in errors.items()}


def _designs(
    reference: Mapping[int, Mapping[str, float]],
    found: Mapping[int, tuple[tuple[float, ...], float, float]],
) -> dict[int, Design]:
    """From nodes, pole and the factor on the bounds, by number of terms."""
    return {
        terms: Design(
            nodes,
            pole,
            DEGREES[terms],
            {name: bound * factor for name, bound in reference[terms].items()},
        )
        for terms, (nodes, pole, factor) in found.items()
    }


BOTH = Objective(reflectance=1.0, albedo=20.0)
"""Albedos err by a fifth to a quarter of what reflectances do: both count about as much."""

_HALF = {"a": 0.49, "cp": 0.9, "d": 0.62, "low": 1.25}
_BALANCED = _scaled(
    {3: {"a": 0.6, "cp": 0.95, "d": 0.8, "low": 1.25}, 4: _HALF, 5: _HALF, 6: _HALF}
)
_ROBUST = dict.fromkeys(DEGREES, NOTEBOOK_MAX[4])
_MINIMAX = {terms: {"a": 1.0, "d": 1.0} for terms in DEGREES}

REGRESSION_RECIPES = {
    "balanced": RegressionRecipe(
        BOTH,
        _inverse_squares({name: NOTEBOOK_RMSE[name] for name in ("a", "cp", "d")}),
        _BALANCED,
        False,
        _designs(
            _BALANCED,
            {
                3: ((1.4177,), 0.255, 1.0),
                4: ((1.4685, 1.1265), 0.268, 1.0),
                5: ((1.5251, 1.3704, 0.9812), 0.284, 1.0),
                6: ((1.5315, 1.4218, 1.219, 0.8601), 0.404, 1.0),
            },
        ),
        "least RMSE of reflectance and albedo, bounds below the largest errors of `notebook`",
    ),
    "robust": RegressionRecipe(
        BOTH,
        _inverse_squares(NOTEBOOK_RMSE),
        _ROBUST,
        True,
        _designs(
            _ROBUST,
            {
                3: ((1.3951,), 0.291, 1.645),
                4: ((1.5094, 1.1901), 0.288, 0.526),
                5: ((1.5271, 1.3974, 0.9682), 0.351, 0.195),
                6: ((1.5368, 1.4738, 1.2527, 0.7829), 0.551, 0.0804),
            },
        ),
        "nearly the least largest error on every set at once, low indices included",
    ),
    "minimax": RegressionRecipe(
        BOTH,
        _inverse_squares(NOTEBOOK_RMSE),
        _MINIMAX,
        True,
        _designs(
            _MINIMAX,
            {
                3: ((1.4682,), 0.174, 0.0476),
                4: ((1.5043, 1.2674), 0.159, 0.0139),
                5: ((1.5283, 1.4122, 1.1007), 0.135, 0.00377),
                6: ((1.5373, 1.4647, 1.3086, 0.9795), 0.412, 0.00116),
            },
        ),
        "nearly the least largest error on dielectrics and measured metals",
    ),
    "albedo": RegressionRecipe(
        Objective(0.0, 1.0),
        _inverse_squares(NOTEBOOK_ALBEDO_RMSE),
        NOTEBOOK_MAX,
        False,
        _designs(
            NOTEBOOK_MAX,
            {
                3: ((1.372,), 0.114, 1.0),
                4: ((1.4097, 1.0573), 0.161, 1.0),
                5: ((1.5212, 1.294, 0.9243), 0.201, 1.0),
                6: ((1.5308, 1.3863, 1.1467, 0.7662), 0.52, 1.0),
            },
        ),
        "least RMSE of the directional albedo, for image-based light",
    ),
}


@functools.cache
def training_for(objective: Objective) -> Training:
    """All four sets, prepared for regressions; takes seconds and 100 MB."""
    return Training(_sets(), objective)


@functools.cache
def _sets() -> dict[str, CurveSet]:
    return {name: make() for name, make in SETS.items()}


@functools.cache
def _all_curves() -> CurveSet:
    sets = _sets().values()
    eta, k = (np.concatenate([getattr(s, name) for s in sets]) for name in ("eta", "k"))
    return CurveSet(", ".join(SETS), eta, k)


def search_design(
    recipe: RegressionRecipe,
    terms: int,
    training: Training | None = None,
    report: Callable[[int, float], object] = lambda count, value: None,
) -> Design:
    """Search nodes and pole of a recipe anew; a minute for each number of terms.

    Parameters
    ----------
    recipe : RegressionRecipe
    terms : int in 3..6
    training : Training
        Default: all curves of the four sets, with the recipe's objective.
    report : callable
        Told the number of evaluations and the objective after each.
    """
    training = training or training_for(recipe.objective)
    start = Design(START[terms], 0.3, DEGREES[terms], recipe.reference[terms])
    found = search(training, start, None if recipe.least else recipe.weights, report=report)
    if not recipe.least:
        return found
    factor = float(f"{SLACK * least_largest_error(training, found):.3g}")
    return replace(found, bounds={n: b * factor for n, b in recipe.reference[terms].items()})

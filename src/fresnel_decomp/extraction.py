"""From exact curves to a `Basis`, by a recipe or from curves of one's own.

Whatever the way, singular vectors (`singular_vectors`) or constrained regression (`regression`),
functions are kept as Chebyshev series and the basis says where it came from.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ._check import choose, input_error
from ._coefficients import check_count
from ._version import __version__
from .basis import Basis
from .curves import CurveSet
from .recipes import RECIPES
from .regression import regress
from .regression_recipes import RegressionRecipe, training_for
from .singular_vectors import SIGN_RULE, Rule, extract

__all__ = ["extract_basis"]

SERIES_ERROR = 1e-4
"""What series of 1,024 terms may err by, for curves with n next to 1; as much as closed forms."""


def extract_basis(
    training: CurveSet | str = "talk",
    terms: int = 4,
    *,
    rule: Rule | None = None,
    nodes: Sequence[float] | None = None,
    grid: int | None = None,
) -> Basis:
    """Extract a basis from exact curves; under a second for 1,000 curves at 1,000 cosines.

    Recipes by constrained regression take some seconds more, for their 19,593 curves.

    Parameters
    ----------
    training : str or CurveSet
        The name of a recipe, which fixes rule, nodes and grid; or a user's own set.
    terms : int in 3..6
    rule, nodes, grid
        For a user's own set only; see `singular_vectors.extract` (default "deflation", no given
        nodes, 1,000 cosines).

    Raises
    ------
    InputError
        For an unknown recipe, curves with kinks, and as `singular_vectors.extract`.

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp import CurveSet, extract_basis
    >>> metals = CurveSet("mine", np.linspace(0.2, 3.0, 40), np.linspace(6.0, 2.0, 40))
    >>> extract_basis(metals, terms=3).terms
    3
    """
    terms = check_count(terms)
    name = "custom"
    if isinstance(training, str):
        name = choose("recipe", training, RECIPES)
        if (rule, nodes, grid) != (None, None, None):
            raise input_error(
                f"recipe '{name}' with a rule, nodes or a grid of your own",
                "a recipe's name alone, or a CurveSet with these options",
                f"Its curves are RECIPES['{name}'].training().",
            )
        recipe = RECIPES[name]
        if isinstance(recipe, RegressionRecipe):
            return _regressed(name, recipe, terms)
        training, rule, nodes, grid = recipe.training(), recipe.rule, recipe.nodes, recipe.grid
    elif not isinstance(training, CurveSet):
        raise input_error(
            f"a training set of type {type(training).__name__}",
            "a recipe's name or a CurveSet",
            "Make one of your indices: CurveSet('mine', eta, k).",
        )
    rule, nodes, grid = rule or "deflation", nodes or (), 1000 if grid is None else grid
    extraction = extract(training, terms, rule, nodes, grid)
    series = _chebyshev(extraction.functions)
    provenance = {
        "recipe": name,
        "terms": terms,
        "training_set": training.name,
        "training_curves": len(training),
        "training_sha256": training.sha256,
        "grid": f"{grid} cosines, uniform on [0, 1]",
        "rule": rule,
        "sign_rule": SIGN_RULE,
        "given_nodes": [float(node) for node in nodes][: terms - 2],
        **_made(series),
    }
    return Basis(name, extraction.nodes, series, provenance)


def _regressed(name: str, recipe: RegressionRecipe, terms: int) -> Basis:
    """The basis of a recipe by constrained regression, with its closed form."""
    import scipy

    design = recipe.designs[terms]
    training = training_for(recipe.objective)
    regression = regress(training, design, recipe.weights)
    series = _chebyshev(regression.functions, 1e-13)
    curves = recipe.training()
    provenance = {
        "recipe": name,
        "terms": terms,
        "training_set": curves.name,
        "training_curves": len(curves),
        "training_sha256": curves.sha256,
        "sets_sha256": {key: members.sha256 for key, members in training.sets.items()},
        "grid": f"{len(training.cos_theta)} cosines, dense at grazing incidence",
        "rule": "regression",
        "sign_rule": SIGN_RULE,
        "given_nodes": list(design.nodes),
        "pole": design.pole,
        "degrees": list(design.degrees),
        "objective": recipe.objective._asdict(),
        "weights": dict(recipe.weights),
        "bounds": dict(design.bounds),
        **_made(series, scipy=scipy.__version__),
    }
    # the rationals are exact: what they are off by from the series is its rounding
    form = replace(regression.form, error=_series_error(regression.functions, series))
    return Basis(name, regression.nodes, series, provenance, form)


def _series_error(functions: Callable[[np.ndarray], np.ndarray], series: np.ndarray) -> float:
    """Largest distance between functions and their series, dense at grazing incidence."""
    cos_theta = np.linspace(0.0, 1.0, 1501) ** 2
    values = np.polynomial.chebyshev.chebval(2.0 * cos_theta - 1.0, series.T).T
    return float(np.abs(functions(cos_theta) - values).max())


def _made(series: np.ndarray, **versions: str) -> dict[str, Any]:
    """With what a basis was made, and the hash by which it is known."""
    rounded = np.round(series, 12).astype("<f8").tobytes()
    return {
        "versions": {"fresnel_decomp": __version__, "numpy": np.__version__, **versions},
        "sha256": hashlib.sha256(rounded).hexdigest(),
    }


def _chebyshev(
    functions: Callable[[np.ndarray], np.ndarray], tolerance: float = 1e-12
) -> np.ndarray:
    """(terms - 1, n) Chebyshev coefficients in 2 cos_theta - 1, of the least sufficient length."""
    for size in (64, 128, 256, 512, 1024):
        x = np.cos(np.pi * (np.arange(size) + 0.5) / size)
        values = functions((x + 1.0) / 2.0)
        angles = np.pi * np.outer(np.arange(size), np.arange(size) + 0.5) / size
        series = (2.0 / size * np.cos(angles) @ values).T
        series[:, 0] /= 2.0
        significant = np.flatnonzero(np.abs(series).max(axis=0) > tolerance)
        if significant[-1] < size - 8:
            return series[:, : significant[-1] + 1]
    error = _series_error(functions, series)
    if error > SERIES_ERROR:
        raise input_error(
            f"a training set whose functions have kinks (their series errs by {error:.2g})",
            "curves that are smooth on [0, 1]",
            "Leave out eta < 1 with little absorption, whose total internal reflection no linear "
            "basis follows.",
        )
    return series

"""Named, reproducible ways to a basis: by singular vectors, or by constrained regression."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .curves import CurveSet, notebook_training_set, talk_training_set
from .regression_recipes import REGRESSION_RECIPES, RegressionRecipe
from .singular_vectors import Rule

__all__ = ["RECIPES", "SVD_RECIPES", "Recipe"]


@dataclass(frozen=True)
class Recipe:
    """A named, reproducible way to a basis by singular vectors.

    Attributes
    ----------
    training : callable returning the `CurveSet`
    rule : "deflation" or "joint"
    nodes : interior nodes in radians, the first `terms - 2` of which are used; where they run out,
        the rule's own choice follows
    grid : number of training cosines, uniform on [0, 1]
    summary : one line
    """

    training: Callable[[], CurveSet]
    rule: Rule
    nodes: tuple[float, ...]
    summary: str
    grid: int = 1000


SVD_RECIPES = {
    "talk": Recipe(
        talk_training_set,
        "deflation",
        (1.45, 1.31),
        "the talk's Eq. 6, coefficients fitted at its published nodes",
    ),
    "notebook": Recipe(
        notebook_training_set,
        "joint",
        (),
        "the procedure of the authors' published notebook, nodes included",
    ),
}

RECIPES: dict[str, Recipe | RegressionRecipe] = {**SVD_RECIPES, **REGRESSION_RECIPES}
"""All recipes that ship: those by singular vectors, and those by constrained regression."""

r"""Bases by constrained regression: least squares under a bound on the largest error.

With T = 1 - F, a model of K terms that is exact at normal incidence (theta_0 = 0), at its interior
nodes theta_1, ..., theta_{K-2} and at grazing incidence is, in cardinal form,

    1 - F̂(c) = Σ_j T(theta_j) l_j(c),   l_j(cos theta_i) = 1 if i = j else 0,   l_j(0) = 0.

Here the functions are rationals with one denominator Q(c) = (1 + c / pole)^m, so that a basis is
its own closed form and smooth by construction. Such l_j are all of

    l_j(c) = [Q(c_j) L_j(c) + w(c) R_j(c)] / Q(c),

L_j Lagrange's polynomials for 0 and the c_j, w(c) = c Π (c - c_j) and R_j any polynomial. The error

    F̂ - F = T(c) - Σ_j T(theta_j) l_j(c)

is linear in the coefficients of R_j, for all curves and angles at once. So for given nodes and pole
the least possible largest error is a linear programme, and least squares under a bound on the error
of every curve is a strictly convex quadratic one: one solution, found to the optimum. Both have
tens of variables and millions of constraints, few of which matter; these are collected as they are
violated (cutting planes). Nodes and pole are searched for outside (`node_search`).
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ._check import input_error
from ._lobe_rule import unit_gauss
from ._programmes import Problem, transmittances
from .albedo import directional_albedo
from .closed_form import ClosedForm
from .curves import CurveSet

__all__ = [
    "Design",
    "Objective",
    "Regression",
    "Training",
    "albedo_operator",
    "least_largest_error",
    "regress",
]


class Objective(NamedTuple):
    """What is squared: weights of two mean square errors.

    Attributes
    ----------
    reflectance : float
        Of the reflectance, uniform over the cosine in [0, 1].
    albedo : float
        Of the directional albedo (GGX, separable Smith), uniform over the view's cosine in [0, 1]
        and alpha in `ALBEDO_ROUGHNESS`.
    """

    reflectance: float = 1.0
    albedo: float = 0.0


ALBEDO_ROUGHNESS = (0.08, 1.0)
"""Range of alpha over which the objective "albedo" averages."""


@dataclass(frozen=True)
class Design:
    """What is settled before a regression.

    Attributes
    ----------
    nodes : interior nodes in radians
    pole : the denominator is (1 + cos_theta / pole)^m
    degrees : (n, m) of the numerators, their factor 1 - cos_theta included, and the denominator,
        n >= m and n >= terms
    bounds : largest error allowed on each set of curves; sets without one are free
    """

    nodes: tuple[float, ...]
    pole: float
    degrees: tuple[int, int]
    bounds: Mapping[str, float]

    def __post_init__(self) -> None:
        n, m = self.degrees
        if not (n >= m >= 1 and n >= len(self.nodes) + 2):
            raise input_error(
                f"degrees {self.degrees} with {len(self.nodes)} interior nodes",
                "(n, m) with n >= m >= 1 and n at least the number of nodes + 2",
                "(terms + 2, terms + 1) is enough for most sets.",
            )
        inside = [node for node in self.nodes if 0.0 < node < np.pi / 2]
        if not self.pole > 0.0 or len(set(inside)) < max(1, len(self.nodes)):
            raise input_error(
                f"nodes {list(self.nodes)}, pole {self.pole}",
                "different angles in (0, pi/2), in radians, and a positive pole",
                "0 and pi/2 are always nodes.",
            )


class Training:
    """Sets of curves, with what regressions need of them: computed once, used for many designs.

    Parameters
    ----------
    sets : mapping from names to `CurveSet`
    objective : Objective
    angles : int
        Bounds hold at about that many cosines, dense at grazing incidence.
    """

    def __init__(
        self,
        sets: Mapping[str, CurveSet],
        objective: Objective = Objective(),  # noqa: B008 (immutable)
        angles: int = 340,
    ) -> None:
        self.sets = dict(sets)
        self.objective = Objective(*objective)
        self.fitted = self.bounded = self.sets
        self.cos_theta = _cosines(angles)
        self.t_bounded = {
            name: transmittances(members, self.cos_theta) for name, members in sets.items()
        }
        self.points, self.operator, weights = albedo_operator()
        self.weights = np.concatenate(
            [objective[0] * _trapezoid(self.cos_theta), objective[1] * weights]
        )
        self.seen = {
            name: self.observe(functools.partial(transmittances, members), self.t_bounded[name])
            for name, members in sets.items()
        }

    def observe(
        self, functions: Callable[[np.ndarray], np.ndarray], at_cosines: np.ndarray
    ) -> np.ndarray:
        """What is squared, of functions: their values at `cos_theta`, their albedos."""
        if not self.objective.albedo:
            return np.pad(at_cosines, ((0, 0), (0, len(self.operator))))
        return np.hstack([at_cosines, functions(self.points) @ self.operator.T])

    def thinned(self, keep: Mapping[str, set[int]], stride: int = 8) -> Training:
        """Every `stride`-th curve of sets with more than 500, and those to `keep` for bounds."""
        steps = {n: stride if len(members) > 500 else 1 for n, members in self.sets.items()}
        fitted = {n: np.arange(0, len(self.sets[n]), steps[n]) for n in self.sets}
        bounded = {n: np.union1d(rows, sorted(keep.get(n, ()))) for n, rows in fitted.items()}
        thin = copy.copy(self)
        thin.fitted = {n: self.sets[n].take(rows) for n, rows in fitted.items()}
        thin.seen = {n: self.seen[n][rows] for n, rows in fitted.items()}
        thin.bounded = {n: self.sets[n].take(rows.astype(int)) for n, rows in bounded.items()}
        thin.t_bounded = {n: self.t_bounded[n][rows.astype(int)] for n, rows in bounded.items()}
        return thin


@dataclass(frozen=True, eq=False)
class Regression:
    """A basis as rationals, and what the regression reached on its own angles and curves.

    Attributes
    ----------
    design : Design
    form : ClosedForm
        b_1, b_2, ...: b_j is l_{j-1} over its value of largest magnitude for j >= 2, and
        b_1 = 1 - l_0 - Σ a_j l_j, where a_j is the regression of T(theta_j) on T(0): what one
        function of the angle alone explains.
    mean_square : float
        The objective.
    largest : dict
        Largest error by set.
    """

    design: Design
    form: ClosedForm
    mean_square: float
    largest: dict[str, float]

    @property
    def nodes(self) -> np.ndarray:
        """(terms - 2,) interior nodes in radians."""
        return np.array(self.design.nodes)

    def functions(self, cos_theta: np.ndarray) -> np.ndarray:
        """(m, terms - 1): b_1, b_2, ... at any (m,) cosines."""
        return self.form(cos_theta)[:, 1:]


def regress(training: Training, design: Design, weights: Mapping[str, float]) -> Regression:
    """The basis of least weighted mean square error whose errors stay within the bounds.

    Parameters
    ----------
    training : Training
    design : Design
    weights : mapping from names of sets to weights of their mean square errors

    Raises
    ------
    InputError
        If no basis of this design stays within the bounds.
    """
    problem = Problem(training, design, weights)
    solution, reached = problem.least_squares(design.bounds)
    if reached > 1.001:
        least, _ = problem.least_maximum(design.bounds)
        raise input_error(
            f"bounds {dict(design.bounds)}",
            f"bounds of at least {least:.4g} times that, for these nodes, pole and degrees",
            "Loosen them, or search for other nodes.",
        )
    return Regression(
        design,
        problem.closed_form(solution),
        problem.mean_square(solution),
        {name: problem.largest(name, solution) for name in training.sets},
    )


def least_largest_error(training: Training, design: Design) -> float:
    """The least t such that errors of t times the bounds are possible: a linear programme."""
    return Problem(training, design, dict.fromkeys(design.bounds, 1.0)).least_maximum(
        design.bounds
    )[0]


def _cosines(angles: int) -> np.ndarray:
    """Cosines in (0, 1): uniform in the angle, and two spacings dense at grazing incidence."""
    part = 4 * angles // 9
    by_angle = np.cos(np.linspace(0.0, np.pi / 2, part))[1:-1]
    squares = np.linspace(0.0, 1.0, part + 1)[1:-1] ** 2
    steep = np.geomspace(1e-3, 0.1, angles // 8)
    return np.unique(np.concatenate([by_angle, squares, steep]))


def _trapezoid(cos_theta: np.ndarray) -> np.ndarray:
    """Weights of the trapezoidal rule on [0, 1] for functions that vanish at both ends."""
    gaps = np.diff(np.concatenate([[0.0], cos_theta, [1.0]]))
    return (gaps[1:] + gaps[:-1]) / 2.0


@functools.cache
def albedo_operator(size: int = 128) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(points, operator, weights): values at points to directional albedos, Gauss rules.

    A curve's Chebyshev interpolant in 2 cos_theta - 1 is integrated in its place.
    """
    mu, mu_weight = unit_gauss(12)
    part, alpha_weight = unit_gauss(6)
    low, high = ALBEDO_ROUGHNESS
    alpha = low + (high - low) * part
    views, roughness = (grid.ravel() for grid in np.meshgrid(mu, alpha, indexing="ij"))
    albedo = directional_albedo(
        lambda c: np.polynomial.chebyshev.chebvander(2.0 * np.asarray(c) - 1.0, size - 1),
        views,
        roughness,
    )
    angles = np.pi * (np.arange(size) + 0.5) / size
    transform = 2.0 / size * np.cos(np.outer(np.arange(size), angles))
    transform[0] /= 2.0
    weights = np.outer(mu_weight, alpha_weight).ravel()
    return (np.cos(angles) + 1.0) / 2.0, albedo @ transform, weights / weights.sum()

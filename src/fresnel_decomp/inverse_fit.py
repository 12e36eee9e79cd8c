"""Least squares for inverse rendering: noise on both sides, inequalities, honest standard errors.

An image is data with noise; so is the rendered derivative by which it is explained, and least
squares with a noisy derivative is biased towards nothing ("attenuation"). Therefore everything is
rendered twice with independent samples, a and b, and products are taken across: J_aᵀ W J_b has no
bias. This is estimation with instrumental variables, one rendering being the other's instrument.
No renderer is needed here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from ._check import input_error

__all__ = [
    "Solution",
    "least_squares",
    "nearest_feasible",
]

DEAD = 1e-7
"""Eigenvalue of the scaled normal matrix, whose diagonal is 1, at which a direction is unknown."""

_MOSTLY = 0.1
"""Squared cosine between a parameter and unknown directions from which nothing is known of it."""

PRIOR_DEVIATION = 12.0**-0.5
"""Standard deviation of a number that may be anything from 0 to 1. A reflectance, or an edge tint,
is called identified if the images know it better than this."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Solution:
    """What `least_squares` found.

    Attributes
    ----------
    x : (n,) float
    covariance : (n, n) float
        Of the solution without constraints; infinite variance where nothing was learnt.
    normal : (n, n) float
        Normal matrix: the weighted misfit grows by (x - x')ᵀ normal (x - x').
    residual : (m,) float
        target - prediction, with the mean of both renderings.
    misfit : float
        Weighted sum of squares across the two renderings, without the bias of their noise.
    unconstrained : (n,) float
        The solution without inequalities.
    root : (n, n) float
        rootᵀ root is the normal matrix, with a little cost where it has none.
    """

    x: Array
    covariance: Array
    normal: Array
    residual: Array
    misfit: float
    unconstrained: Array
    root: Array

    @property
    def constrained(self) -> bool:
        """Whether an inequality decided."""
        return not np.array_equal(self.x, self.unconstrained)

    @property
    def standard_errors(self) -> Array:
        """(n,) float"""
        return np.sqrt(np.diag(self.covariance))


def least_squares(
    columns: ArrayLike,
    offset: ArrayLike,
    target: ArrayLike,
    weight: ArrayLike,
    start: ArrayLike,
    inequalities: tuple[ArrayLike, ArrayLike] | None = None,
) -> Solution:
    """Solve target = offset + columns x, where columns and offset were rendered twice.

    Parameters
    ----------
    columns : (2, m, n) float
        Two independent estimates of the derivative. Give the same twice if it has no noise.
    offset : (2, m) float
    target : (m,) float
    weight : (m,) float >= 0
        One over the variance, up to a factor.
    start : (n,) float
        What directions get that the data say nothing about.
    inequalities : (G, h), optional
        (q, n) and (q,): G x >= h must hold.

    Returns
    -------
    Solution
        The covariance is White's (1980): from the residuals themselves, so neither does the
        weight's scale matter nor whether it is right. It assumes that residuals are independent.

    Raises
    ------
    InputError
        For shapes that do not fit, data that are not finite, negative weights, fewer data than
        unknowns, and infeasible inequalities.

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp.inverse_fit import least_squares
    >>> x = np.linspace(0.0, 1.0, 9)
    >>> J = np.stack([np.ones(9), x], axis=1)
    >>> result = least_squares([J, J], np.zeros((2, 9)), 2.0 + 3.0 * x, np.ones(9), np.zeros(2))
    >>> result.x.round(6)
    array([2., 3.])
    """
    J, o = np.asarray(columns, np.float64), np.asarray(offset, np.float64)
    y, w = np.asarray(target, np.float64), np.asarray(weight, np.float64)
    x0 = np.asarray(start, np.float64)
    m, n = J.shape[-2:]
    if (J.shape, o.shape, y.shape, w.shape) != ((2, m, n), (2, m), (m,), (m,)):
        raise input_error(
            f"arrays of shapes {J.shape}, {o.shape}, {y.shape}, {w.shape}",
            "(2, m, n), (2, m), (m,), (m,)",
            "Give two renderings of the derivative.",
        )
    finite = all(np.isfinite(array).all() for array in (J, o, y, w, x0))
    if not finite or (w < 0.0).any():
        raise input_error(
            "data that are not finite" if not finite else f"a weight of {w.min():g}",
            "finite numbers, and weights >= 0",
            "Give what is to be left out a weight of 0 and finite values.",
        )
    if np.count_nonzero(w) < n:
        raise input_error(
            f"{np.count_nonzero(w)} data for {n} unknowns", "at least as many", "Add images."
        )
    (a, b), wa = J, w[:, None] * J[0]
    normal = 0.5 * (wa.T @ b + b.T @ wa)
    r = y - o - J @ x0  # (2, m): of each rendering
    right = 0.5 * (wa.T @ r[1] + (w[:, None] * b).T @ r[0])
    size = np.einsum("mi,m,mi->i", 0.5 * (a + b), w, 0.5 * (a + b))
    scale = 1.0 / np.sqrt(np.where(size > 0.0, size, 1.0))
    values, vectors = np.linalg.eigh(normal * scale[:, None] * scale)
    known = values > DEAD
    inverse = np.where(known, 1.0 / np.where(known, values, 1.0), 0.0)
    pseudo = scale[:, None] * (vectors * inverse @ vectors.T) * scale
    x = x0 + pseudo @ right
    r = y - o - J @ x
    scores = 0.5 * w[:, None] * (a * r[1][:, None] + b * r[0][:, None])
    covariance = pseudo @ (scores.T @ scores) @ pseudo * (m / max(m - n, 1))
    covariance = with_unknown(covariance, scale[:, None] * vectors[:, ~known])
    free = x
    # what is unknown costs next to nothing to move
    root = np.sqrt(np.where(known, values, 1e-9))[:, None] * vectors.T / scale
    if inequalities is not None:
        G, h = (np.asarray(part, np.float64) for part in inequalities)
        if np.any(G @ x < h - 1e-12):
            x = nearest_feasible(root, x, G, h)
            r = y - o - J @ x
    return Solution(x, covariance, normal, r.mean(axis=0), float(w @ (r[0] * r[1])), free, root)


def with_unknown(covariance: Array, directions: Array) -> Array:
    """Add what is unknown along `directions` (n, q): of order one, infinite where it rules."""
    length = np.linalg.norm(directions, axis=0)
    share = np.sum((directions / np.where(length > 0.0, length, 1.0)) ** 2, axis=1)
    variance = np.diag(covariance) + share
    result = covariance.copy()
    result[np.diag_indices(len(share))] = np.where(share > _MOSTLY, np.inf, variance)
    return result


def nearest_feasible(root: ArrayLike, x: ArrayLike, G: ArrayLike, h: ArrayLike) -> Array:
    """The point next to `x` with G x >= h, where distance is |root (x' - x)|.

    Parameters
    ----------
    root : (n, n) float
        Regular; rootᵀ root is the normal matrix.
    x : (n,) float
    G, h : (q, n), (q,) float

    Returns
    -------
    (n,) float
        Least-distance programming by non-negative least squares (Lawson and Hanson 1974,
        chapter 23).

    Raises
    ------
    InputError
        If no point satisfies all inequalities.

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp.inverse_fit import nearest_feasible
    >>> nearest_feasible(np.eye(2), [-1.0, 2.0], [[1.0, 0.0]], [0.0]).round(6) + 0.0
    array([0., 2.])
    """
    root, x = np.asarray(root, np.float64), np.asarray(x, np.float64)
    G, h = np.asarray(G, np.float64), np.asarray(h, np.float64)
    inverse = np.linalg.inv(root)
    missing = h - G @ x
    unit = max(float(missing.max()), 1e-300)  # the answer scales with what is missing
    E = np.vstack([(G @ inverse).T, missing / unit])
    f = np.zeros(len(E))
    f[-1] = 1.0
    multipliers, distance = scipy.optimize.nnls(E, f, maxiter=50 * E.shape[1])
    if distance < 1e-9:
        raise input_error(
            "inequalities that contradict each other",
            "bounds with values between them",
            "Widen them.",
        )
    r = E @ multipliers - f
    return x + unit * (inverse @ (-r[:-1] / r[-1]))

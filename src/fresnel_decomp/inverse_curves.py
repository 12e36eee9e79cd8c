"""Curves for inverse rendering: what images are linear in, its bounds, and indices from it.

Images are linear in the coefficients of a basis, and so in the reflectances at 0° and at its nodes
that `inverse_fit` finds. From these follow indices of refraction, without another image.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from ._check import choose, input_error
from .basis import Basis
from .fresnel import conductor
from .inverse_fit import DEAD, with_unknown
from .parametrization import gulbrandsen_to_ior

__all__ = ["CurveFit", "curve_limits", "fit_curve_parameters", "node_map"]

Array = NDArray[np.float64]


def node_map(basis: Basis) -> tuple[Array, Array]:
    """Coefficients from reflectances at 0° and at the nodes: c = a + M x.

    Returns
    -------
    a : (terms,) float
    M : (terms, terms - 1) float
    """
    n = basis.terms - 1
    a = basis.coefficients_from_reflectance(0.0, np.zeros(n - 1))
    points = np.eye(n)
    M = (basis.coefficients_from_reflectance(points[:, 0], points[:, 1:]) - a).T
    return a, M


def curve_limits(
    basis: Basis, bounds: tuple[float, float], nodes: bool, angles: int = 91
) -> tuple[Array, Array]:
    """Inequalities G x >= h that keep a curve within bounds, on a grid of angles.

    Parameters
    ----------
    basis : Basis
    bounds : (low, high)
    nodes : bool
        Whether x are reflectances at 0° and the nodes, or coefficients.
    angles : int
        From 0° to 90°, equally spaced.

    Returns
    -------
    G, h : (2 angles, n), (2 angles,) float
    """
    low, high = bounds
    if not low < high:
        raise input_error(f"bounds={bounds}", "low < high", "Use (0.0, 1.05), or None for none.")
    functions = basis(np.sin(np.radians(np.linspace(90.0, 0.0, angles))))
    base = np.zeros(angles)
    if nodes:
        a, M = node_map(basis)
        base, functions = functions @ a, functions @ M
    return (
        np.concatenate([functions, -functions]),
        np.concatenate([low - base, base - high]),
    )


@dataclass(frozen=True, eq=False)
class CurveFit:
    """Parameters of exact curves, fitted to reflectances at 0° and the nodes.

    Attributes
    ----------
    values : (2,) float
        (eta, k) or (r, g).
    covariance : (2, 2) float
        Infinite variances where a parameter does not matter.
    misfit : float
        (x - x̂)ᵀ normal (x - x̂).
    """

    values: Array
    covariance: Array
    misfit: float


def fit_curve_parameters(
    x: ArrayLike,
    normal: ArrayLike,
    covariance: ArrayLike,
    kind: str,
    basis: Basis,
    start: ArrayLike | None = None,
) -> CurveFit:
    """The index whose decomposed curve explains the images best, without another image.

    Since images are linear in x, their misfit *is* (x - x̂)ᵀ N (x - x̂), whatever x depends on: so
    the nonlinear search for (eta, k) needs the normal matrix N and no renderer.

    Parameters
    ----------
    x : (terms - 1,) float
        Reflectances at 0° and at the nodes, by `least_squares`.
    normal, covariance : (terms - 1, terms - 1) float
    kind : {"indices", "gulbrandsen"}
    basis : Basis
    start : (2,) float, optional
        Tried besides a range of edge tints for the reflectivity x[0].

    Returns
    -------
    CurveFit

    Raises
    ------
    InputError
        For another kind.

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp import load_basis
    >>> from fresnel_decomp.fresnel import conductor
    >>> from fresnel_decomp.inverse_curves import fit_curve_parameters
    >>> basis = load_basis()
    >>> x = conductor(np.cos([0.0, *basis.nodes]), 0.4, 2.5)
    >>> fit_curve_parameters(x, np.eye(3), np.eye(3), "indices", basis).values.round(4)
    array([0.4, 2.5])
    """
    choose("kind", kind, ("indices", "gulbrandsen"))
    x, normal = np.asarray(x, np.float64), np.asarray(normal, np.float64)
    cosines = np.cos([0.0, *basis.nodes])
    values, vectors = np.linalg.eigh(normal)
    root = np.sqrt(np.maximum(values, 1e-9 * values[-1]))[:, None] * vectors.T
    tints = (0.0, 0.3, 0.6, 0.8, 0.9, 0.96, 0.99, 1.0)
    r0 = float(np.clip(x[0], 0.002, 0.995))
    starts = [(r0, g) for g in tints]
    curve: Callable[[Array], Array]
    if kind == "indices":
        low, high = np.array([0.02, 0.0]), np.array([20.0, 20.0])
        starts = [gulbrandsen_to_ior(*pair) for pair in starts]

        def curve(p: Array) -> Array:
            return np.asarray(conductor(cosines, p[0], p[1]))
    else:
        low, high = np.array([1e-5, 0.0]), np.array([1.0 - 1e-5, 1.0])

        def curve(p: Array) -> Array:
            return np.asarray(conductor(cosines, *gulbrandsen_to_ior(p[0], p[1])))

    if start is not None:
        starts.append(tuple(np.asarray(start, np.float64).tolist()))
    best = None
    # the misfits only compared by size, so that starts are ranked before any is improved
    ranked = sorted(
        (np.clip(s, low + 1e-6, high - 1e-6) for s in starts),
        key=lambda s: float(np.sum((root @ (curve(s) - x)) ** 2)),
    )
    for begin in ranked[:3]:
        found = scipy.optimize.least_squares(
            lambda p: root @ (curve(p) - x), begin, bounds=(low, high), x_scale="jac",
            xtol=1e-12, ftol=1e-12, gtol=1e-12,
        )  # fmt: skip
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    p = best.x
    step = 1e-5 * np.maximum(np.abs(p), 0.1)
    A = np.empty((len(x), 2))
    for i in range(2):
        d = np.zeros(2)
        d[i] = step[i]
        up, down = np.minimum(p + d, high), np.maximum(p - d, low)
        A[:, i] = (curve(up) - curve(down)) / (up[i] - down[i])
    inner = A.T @ normal @ A
    size = np.sqrt(np.maximum(np.diag(inner), 0.0))
    scale = 1.0 / np.where(size > 0.0, size, 1.0)
    eigenvalues, axes = np.linalg.eigh(inner * scale[:, None] * scale)
    known = eigenvalues > DEAD
    if np.all(np.isfinite(covariance)):
        inverse = np.where(known, 1.0 / np.where(known, eigenvalues, 1.0), 0.0)
        gain = scale[:, None] * (axes * inverse @ axes.T) * scale @ A.T @ normal
        spread = gain @ np.asarray(covariance, np.float64) @ gain.T
    else:
        spread = np.full((2, 2), np.inf)
    spread = with_unknown(spread, scale[:, None] * axes[:, ~known])
    return CurveFit(p, spread, float(2.0 * best.cost))

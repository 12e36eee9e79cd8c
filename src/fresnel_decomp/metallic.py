"""Metals of the metallic workflow: a whole curve from a base colour and, where known, its edge.

A base colour is the reflectance F0 at normal incidence; the *edge colour* f82 is that at cos = 1/7,
about 82 degrees. From both,

    1 - F(mu) = u(mu) (1 - F0) + v(mu) (1 - f82),

with u and v fitted to measured metals: affine in both colours, right where they are given, and 1 at
grazing incidence. Colours far from those of metals give curves that leave [0, 1] between them.
Where no edge colour is known, the usual one of a metal of that base colour stands in,

    1 - f82 = (1 - F0) (p + q F0 + s F0²),      p = 1 - (6/7)^5,

fitted to the same metals, but for p: there are no black metals, and what one is left to reflect at
82 degrees is Schlick's. `scripts/metal_edge.py` makes the numbers anew and compares this with other
ways from a base colour to a curve: an index of refraction, edge tints, Schlick's curve.

Functions here take Python floats, NumPy or Dr.Jit arrays, broadcast, and do not clamp.
"""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np

from ._arguments import one_kind
from ._array import is_drjit, multiply_add, ops_for
from ._check import input_error
from .basis import Basis
from .parametrization import F82_COSINE

__all__ = [
    "MetalEdge",
    "default_edge_colour",
    "dielectric_eta",
    "fit_metal_edge",
    "load_metal_edge",
    "metal_coefficients",
    "metal_reflectance",
]

_BLACK_EDGE = 1.0 - (1.0 - F82_COSINE) ** 5
"""What Schlick's curve of a black surface lacks at cos = 1/7: the number p."""

_LEAST_F0 = 1e-12
"""The square root of F0 has no derivative at 0; a root below this is lost beside 1 anyway."""


@dataclass(frozen=True, eq=False)
class MetalEdge:
    """The functions u and v and the numbers q and s.

    Attributes
    ----------
    cos_theta, u, v : (n,) float
        Nodes of piecewise cubics in sqrt(cos_theta), from 0 to 1; cos = 1/7 is one of them.
    q, s : float
        Of the edge colour that stands in.
    """

    cos_theta: np.ndarray
    u: np.ndarray
    v: np.ndarray
    q: float
    s: float

    def edge_colour(self, base_colour: Any) -> Any:
        """The edge colour that stands in for an unknown one."""
        rise = base_colour * multiply_add(base_colour, self.s, self.q)
        return 1.0 - (1.0 - base_colour) * (_BLACK_EDGE + rise)

    def weights(self, cos_theta: Any) -> tuple[np.ndarray, np.ndarray]:
        """u and v at NumPy cosines in [0, 1]."""
        from scipy.interpolate import PchipInterpolator

        root = np.sqrt(np.asarray(cos_theta, np.float64))
        u, v = (PchipInterpolator(np.sqrt(self.cos_theta), f)(root) for f in (self.u, self.v))
        return u, v


@functools.cache
def load_metal_edge() -> MetalEdge:
    """The functions and numbers that ship with the package."""
    file = resources.files(__package__) / "data" / "metal_edge.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    cos_theta, u, v = (np.array(data[name]) for name in ("cos_theta", "u", "v"))
    return MetalEdge(cos_theta, u, v, data["q"], data["s"])


@functools.lru_cache(maxsize=64)  # kernels of scalar variants ask for the same few at every point
def _weights_at(fitted: MetalEdge, cos_theta: float) -> tuple[float, float]:
    u, v = fitted.weights(cos_theta)
    return float(u), float(v)


def fit_metal_edge(cos_theta: Any, reflectance: Any) -> MetalEdge:
    """Fit u, v, q and s to curves by least squares at each cosine.

    Parameters
    ----------
    cos_theta : (n,) float, ascending from 0 to 1, with 1/7 among them
    reflectance : (n, curves) float
        Colours or spectra of metals at these cosines.

    Raises
    ------
    InputError
        If the cosines are not as said, fewer than two curves are given, or some are not finite.
    """
    cos_theta, curves = np.asarray(cos_theta, np.float64), np.asarray(reflectance, np.float64)
    at = np.flatnonzero(np.isclose(cos_theta, F82_COSINE, rtol=0.0, atol=1e-12))
    ends = cos_theta.size > 2 and (cos_theta[0], cos_theta[-1]) == (0.0, 1.0)
    if not ends or at.size != 1 or np.any(np.diff(cos_theta) <= 0.0):
        raise input_error(
            f"{cos_theta.size} cosines",
            "ascending ones from 0 to 1 with 1/7 among them",
            "Insert it: np.sort(np.append(cosines, 1 / 7)).",
        )
    if curves.ndim != 2 or len(curves) != len(cos_theta) or curves.shape[1] < 2:
        raise input_error(
            f"reflectances of shape {curves.shape}",
            f"({len(cos_theta)}, curves) with at least two curves",
            "One column for each channel of each metal.",
        )
    if not np.isfinite(curves).all():
        raise input_error("reflectances that are not finite", "finite ones", "Drop the others.")
    absorbed = 1.0 - curves
    f0, (first, edge) = curves[-1], absorbed[[-1, int(at[0])]]
    powers = np.stack([first * f0, first * f0**2], axis=1)
    q, s = np.linalg.lstsq(powers, edge - _BLACK_EDGE * first, rcond=None)[0]
    u, v = np.linalg.lstsq(np.stack([first, edge], axis=1), absorbed.T, rcond=None)[0]
    # exact by construction, to rounding
    u[0] = v[0] = u[at[0]] = v[-1] = 0.0
    u[-1] = v[at[0]] = 1.0
    return MetalEdge(cos_theta, u, v, float(q), float(s))


def default_edge_colour(base_colour: Any) -> Any:
    """Reflectance at cos = 1/7 that metals of this base colour usually have.

    Parameters
    ----------
    base_colour : (...) float in [0, 1]

    Examples
    --------
    >>> from fresnel_decomp.metallic import default_edge_colour
    >>> round(default_edge_colour(0.6), 2), default_edge_colour(1.0)
    (0.63, 1.0)
    """
    return load_metal_edge().edge_colour(base_colour)


def metal_reflectance(
    base_colour: Any, edge_colour: Any, cos_theta: float, metal_edge: MetalEdge | None = None
) -> Any:
    """Reflectance at one cosine.

    Parameters
    ----------
    base_colour, edge_colour : (...) float
        At normal incidence and at cos = 1/7.
    cos_theta : float in [0, 1]
    metal_edge : MetalEdge, optional
        Another fit than that which ships.
    """
    base_colour, edge_colour = one_kind(base_colour, edge_colour)
    fitted = load_metal_edge() if metal_edge is None else metal_edge
    u, v = _weights_at(fitted, float(cos_theta))
    return 1.0 - u * (1.0 - base_colour) - v * (1.0 - edge_colour)


def metal_coefficients(
    base_colour: Any, edge_colour: Any, basis: Basis, metal_edge: MetalEdge | None = None
) -> Any:
    """Coefficients of the curve: affine in both colours.

    Parameters
    ----------
    base_colour, edge_colour : (...) float
        At normal incidence and at cos = 1/7; see `default_edge_colour`.
    basis : Basis
    metal_edge : MetalEdge, optional
        Another fit than that which ships.

    Returns
    -------
    (..., terms) float64, or for Dr.Jit a tuple of `terms` arrays.

    Examples
    --------
    >>> from fresnel_decomp import load_basis
    >>> from fresnel_decomp.metallic import metal_coefficients
    >>> basis = load_basis()
    >>> copper = metal_coefficients([0.96, 0.64, 0.54], [0.97, 0.72, 0.66], basis)
    >>> basis.evaluate(copper, 1.0).round(2)
    array([0.96, 0.64, 0.54])
    """
    if not is_drjit(base_colour, edge_colour):
        base_colour, edge_colour = np.broadcast_arrays(
            np.asarray(base_colour, np.float64), np.asarray(edge_colour, np.float64)
        )
    nodes = [
        metal_reflectance(base_colour, edge_colour, float(np.cos(node)), metal_edge)
        for node in basis.nodes
    ]
    if is_drjit(base_colour, edge_colour):
        return basis.coefficients_from_reflectance(base_colour, nodes)
    return basis.coefficients_from_reflectance(base_colour, np.stack(nodes, axis=-1))


def dielectric_eta(f0: Any) -> Any:
    """Index of refraction of a dielectric from its reflectance at normal incidence, exactly.

    Parameters
    ----------
    f0 : (...) float in [0, 1)

    Returns
    -------
    (...) float >= 1: (1 + sqrt(F0)) / (1 - sqrt(F0)). At F0 = 0 the derivative is 0; from above it
    is infinite.

    Examples
    --------
    >>> from fresnel_decomp.metallic import dielectric_eta
    >>> round(float(dielectric_eta(0.04)), 6)
    1.5
    """
    ops = ops_for(f0)
    black = f0 <= _LEAST_F0  # not NaN, which passes
    root = ops.sqrt(ops.select(black, 1.0, f0))
    return ops.select(black, 1.0, (1.0 + root) / ops.select(black, 1.0, 1.0 - root))

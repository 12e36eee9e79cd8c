r"""Directional albedo: what a rough surface reflects of uniform light, for any Fresnel function.

    Fbar(mu, alpha) = ∫ F(wo·h) G2(wi, wo) D(h) / (4 mu) d omega_i

is the preintegration of the talk (Belcour, Bati and Barla 2020, Eq. 2, which already contains the
cosine of the incident light). It is linear in F, so a basis is integrated once and for all.

With slopes t (cos phi, sin phi) of the microfacets in units of alpha, P the density of slopes at
roughness 1, and q = s cos phi, s² = 1 - mu², it reads

    Fbar = 1/sigma(mu) ∫∫ F G' (alpha q t + mu) P(t) t dt dphi,   G' = G2 / G1(wo),

where sigma is finite at mu = 0 (see `microfacet`). Light comes from above the surface for
t <= t*(phi), in closed form and without cancellation

    t* = p / (alpha mu) if q >= 0, else mu / (alpha p),   p = |q| + sqrt(q² + mu²)

so that the integrand is smooth up to its limits and Gauss rules converge exponentially. Their nodes
are spread by two changes of variable, for what happens at small mu and small alpha: the limit t*
jumps at phi = pi/2 over a width of mu, and GGX reaches grazing microfacets only within alpha of its
last angle.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ._array import DrJitOps, Ops, drjit_module, floating_type, is_drjit, one_kind, ops_for
from ._check import choose, input_error
from .microfacet import _SHAPES, DISTRIBUTIONS, SMITH, Distribution, Shape, Smith

__all__ = ["QUADRATURE", "Quadrature", "average_albedo", "average_fresnel", "directional_albedo"]

Fresnel = Callable[[Any], Any]


class Quadrature(NamedTuple):
    """Numbers of Gauss nodes in azimuth, on [0, pi], and in the slope."""

    azimuth: int
    slope: int


QUADRATURE = {"ggx": Quadrature(24, 24), "beckmann": Quadrature(24, 32)}
"""Nodes by default, by distribution."""


def directional_albedo(
    f: Fresnel,
    mu: Any,
    alpha: Any,
    *,
    smith: Smith = "separable",
    distribution: Distribution = "ggx",
    quadrature: tuple[int, int] | None = None,
) -> Any:
    """Integral of a Fresnel function over the reflection of a rough surface.

    Parameters
    ----------
    f : callable
        Reflectance from cosines in [0, 1]: a model, a basis, or `lambda c: conductor(c, eta, k)`.
        NumPy: from (m, ...) to (m, ...) or (m, ..., n), where (...) is the shape of mu and alpha,
        so that parameters of f broadcast against these. Dr.Jit: from an array to an array or a
        tuple of arrays.
    mu : (...) float in [0, 1]
        Cosine of the view direction.
    alpha : (...) float >= 0
        Roughness as the distributions have it, the square of perceptual roughness.
    smith : {"separable", "correlated"}
    distribution : {"ggx", "beckmann"}
    quadrature : pair of int, optional
        Nodes in azimuth and slope, see `QUADRATURE`.

    Returns
    -------
    (...) or (..., n) float, for Dr.Jit an array or a tuple of them: differentiable in mu, in
    alpha and in what f depends on. At alpha = 0 it is f(mu), at mu = 0 the limit. NumPy computes in
    float64, Dr.Jit in the type of mu and alpha.

    Raises
    ------
    InputError
        For scalars out of range. In arrays mu is clamped, and NaN or a negative alpha gives NaN.

    Examples
    --------
    >>> import math
    >>> from fresnel_decomp import directional_albedo
    >>> white = directional_albedo(lambda cos_theta: 1.0 + 0.0 * cos_theta, 1.0, 1.0)
    >>> abs(white - (1.0 - math.log(2.0))) < 1e-6  # exact for separable GGX at normal incidence
    True
    """
    shape = _SHAPES[choose("distribution", distribution, DISTRIBUTIONS)]
    choose("smith", smith, SMITH)
    nodes = _nodes(*(quadrature or QUADRATURE[distribution]))
    mu, alpha = one_kind(mu, alpha)
    for name, value in (("mu", mu), ("alpha", alpha)):
        _check_scalar(name, value)
    if is_drjit(mu, alpha):
        return _on_drjit(f, mu, alpha, smith, shape, nodes)
    return _on_numpy(f, mu, alpha, smith, shape, nodes)


def average_fresnel(f: Fresnel, nodes: int = 64) -> Any:
    """Cosine-weighted average 2 ∫ f(mu) mu dmu over the hemisphere.

    Parameters
    ----------
    f : callable from (m,) cosines to (m,) or (m, n) values

    Returns
    -------
    float or (n,) float64

    Examples
    --------
    >>> from fresnel_decomp import load_basis
    >>> from fresnel_decomp.albedo import average_fresnel
    >>> average_fresnel(load_basis()).round(4)
    array([ 1.    ,  0.0444, -0.0206, -0.0014])
    """
    root, weight = _unit_gauss(nodes)
    mu = root * root  # dense at grazing angles, where Fresnel functions bend
    values = np.asarray(f(mu))
    return np.tensordot(4.0 * weight * root**3, values, 1)[()]


def average_albedo(
    f: Fresnel,
    alpha: Any,
    *,
    smith: Smith = "separable",
    distribution: Distribution = "ggx",
    nodes: int = 32,
) -> Any:
    """Hemispherical albedo 2 ∫ Fbar(mu, alpha) mu dmu: what is reflected of uniform light in all.

    Parameters
    ----------
    f, smith, distribution
        As for `directional_albedo`.
    alpha : (...) float >= 0
    nodes : int
        In mu.

    Returns
    -------
    (...) or (..., n) float64; NumPy only
    """
    root, weight = _unit_gauss(nodes)
    alpha = np.asarray(alpha, np.float64)
    mu = (root * root).reshape(-1, *(1,) * alpha.ndim)
    mu = np.broadcast_to(mu, (nodes, *alpha.shape))
    values = directional_albedo(f, mu, alpha, smith=smith, distribution=distribution)
    return np.tensordot(4.0 * weight * root**3, values, 1)[()]


# --- the rule ------------------------------------------------------------------------------------


class _Nodes(NamedTuple):
    """Gauss nodes and weights: u in [-1, 1] for the azimuth, w in [0, 1] for the slope."""

    u: np.ndarray
    u_weight: np.ndarray
    w: np.ndarray
    w_weight: np.ndarray


@functools.cache
def _unit_gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    x, weight = np.polynomial.legendre.leggauss(count)
    return 0.5 * (x + 1.0), 0.5 * weight


@functools.cache
def _nodes(azimuth: int, slope: int) -> _Nodes:
    u, u_weight = _unit_gauss(azimuth)
    return _Nodes(2.0 * u - 1.0, 2.0 * u_weight, *_unit_gauss(slope))


class _View(NamedTuple):
    """What depends on the view and the roughness alone."""

    mu: Any
    alpha: Any
    sine: Any
    area: Any  # sigma(mu)
    width: Any  # of the change of variable in azimuth
    stretch: Any
    edge: Any  # of that in the slope


def _view(ops: Ops, shape: Shape, mu: Any, alpha: Any, tiny: float) -> _View:
    # Added, not clamped: derivatives pass. At mu = 0 the limit is meant, and at mu = 1 sine has an
    # infinite derivative, of which F depends on the even part only.
    mu = mu + 1e-18
    sine = ops.sqrt(ops.maximum((1.0 - mu) * (1.0 + mu), 0.0) + tiny)
    plain_mu, plain_alpha = ops.detach(mu), ops.detach(alpha)
    width = ops.maximum(plain_mu, 0.035)
    stretch = ops.arcsinh(0.5 * math.pi / width)
    edge = ops.maximum(2.0 * plain_alpha, 1e-4)
    return _View(mu, alpha, sine, shape.projected_area(ops, mu, alpha), width, stretch, edge)


def _azimuth(ops: Ops, view: _View, u: Any) -> tuple[Any, Any, Any, Any]:
    """(q, weight, numerator, denominator) at a node: q = s cos phi, t* = numerator/denominator."""
    wave = ops.sinh(view.stretch * u)
    q = -view.sine * ops.sin(view.width * wave)  # phi = pi/2 + width sinh(stretch u)
    weight = view.width * view.stretch * ops.sqrt(1.0 + wave * wave)
    p = ops.abs(q) + ops.sqrt(q * q + view.mu * view.mu)
    forward = u < 0.0
    numerator = ops.select(forward, p, view.mu)
    denominator = view.alpha * ops.select(forward, view.mu, p)
    return q, weight, numerator, denominator


def _reflection(
    ops: Ops, shape: Shape, smith: str, view: _View, azimuth: Any, slope: Any
) -> tuple[Any, Any]:
    """(wo·h, weight) at a node; the sum over nodes of weight times F is the albedo."""
    q, azimuth_weight, numerator, denominator = azimuth
    across, along, weight = shape.slope_node(ops, numerator, denominator, view.edge, *slope)
    # h is (alpha across (cos phi, sin phi), along) / length
    visible = view.alpha * q * across + view.mu * along
    length = ops.sqrt((view.alpha * across) * (view.alpha * across) + along * along)
    cos_d = ops.minimum(ops.maximum(visible / length, 0.0), 1.0)
    cos_i = ops.minimum(ops.maximum(2.0 * cos_d * (along / length) - view.mu, 0.0), 1.0)
    if smith == "separable":
        area = shape.projected_area(ops, cos_i, view.alpha)
        shadowing = cos_i / ops.maximum(area, 1e-30)
    else:
        lit = cos_i * view.area
        hidden = view.mu * shape.hidden_area(ops, cos_i, view.alpha)
        shadowing = lit / ops.maximum(lit + hidden, 1e-30)
    return cos_d, shadowing * visible * weight * (azimuth_weight * (2.0 / view.area))


def _on_numpy(f: Fresnel, mu: Any, alpha: Any, smith: str, shape: Shape, nodes: _Nodes) -> Any:
    result_type = floating_type(mu, alpha)
    plain = not any(isinstance(value, np.generic | np.ndarray) for value in (mu, alpha))
    mu, alpha = np.broadcast_arrays(np.asarray(mu, np.float64), np.asarray(alpha, np.float64))
    valid = ~np.isnan(mu) & (alpha >= 0.0) & (alpha < np.inf)
    ops = ops_for()
    view = _view(ops, shape, np.clip(mu, 0.0, 1.0), np.where(valid, alpha, 1.0), 1e-14)
    column = (-1, *(1,) * mu.ndim)
    slope = (nodes.w.reshape(column), nodes.w_weight.reshape(column))
    total: Any = 0.0
    for u, u_weight in zip(nodes.u, nodes.u_weight, strict=True):
        q, weight, *limit = _azimuth(ops, view, u)
        azimuth = (q, weight * u_weight, *limit)
        cos_d, weight = _reflection(ops, shape, smith, view, azimuth, slope)
        values = np.asarray(f(cos_d))
        vector = values.ndim > weight.ndim
        total = total + ((weight[..., None] if vector else weight) * values).sum(axis=0)
    total = np.where(valid[..., None] if vector else valid, total, np.nan)
    if total.ndim == 0:
        return float(total) if plain else total.astype(result_type)[()]
    return total.astype(result_type)


def _on_drjit(f: Fresnel, mu: Any, alpha: Any, smith: str, shape: Shape, nodes: _Nodes) -> Any:
    dr = drjit_module()
    assert dr is not None
    ops = DrJitOps()
    result = type(mu * 0.0 + alpha * 0.0)
    mu, alpha = result(mu), result(alpha)
    valid = ~dr.isnan(mu) & (alpha >= 0.0) & (alpha < dr.inf)
    double = dr.type_v(result) == dr.VarType.Float64
    mu, alpha = _clamped(dr, mu), dr.select(valid, alpha, 1.0)
    view = _view(ops, shape, mu, alpha, 1e-12 if double else 1e-6)
    # every node by its number, so that one loop is recorded, and f once
    columns = [
        np.repeat(nodes.u, len(nodes.w)),
        np.repeat(nodes.u_weight, len(nodes.w)),
        np.tile(nodes.w, len(nodes.u)),
        np.tile(nodes.w_weight, len(nodes.u)),
    ]
    count = len(columns[0])

    def term(node: tuple[Any, ...]) -> tuple[Any, ...]:
        u, u_weight, w, w_weight = node
        q, weight, *limit = _azimuth(ops, view, u)
        azimuth = (q, weight * u_weight, *limit)
        cos_d, weight = _reflection(ops, shape, smith, view, azimuth, (w, w_weight))
        return tuple(weight * value for value in _as_tuple(f(cos_d)))

    probe = f(mu)
    zero = tuple(dr.detach(0.0 * value + 0.0 * (mu + alpha)) for value in _as_tuple(probe))
    if dr.is_jit_v(result):
        tables = [_copied(dr, result, column) for column in columns]
        index = dr.uint32_array_t(result)

        def body(i: Any, totals: tuple[Any, ...]) -> tuple[Any, tuple[Any, ...]]:
            terms = term(tuple(dr.gather(result, table, i) for table in tables))
            return i + 1, tuple(a + b for a, b in zip(totals, terms, strict=True))

        _, total = dr.while_loop(
            (index(0), zero),
            lambda i, totals: i < count,
            body,
            max_iterations=-1,
            label="directional albedo",
        )
    else:
        total = zero
        for node in zip(*(column.tolist() for column in columns), strict=True):
            total = tuple(a + b for a, b in zip(total, term(tuple(map(result, node))), strict=True))
    total = tuple(dr.select(valid, value, dr.nan) for value in total)
    return total if isinstance(probe, tuple | list) else total[0]


def _as_tuple(values: Any) -> tuple[Any, ...]:
    return tuple(values) if isinstance(values, tuple | list) else (values,)


def _clamped(dr: Any, value: Any) -> Any:
    """`value` in [0, 1]; dr.clip would have no derivative at the ends."""
    return dr.select(value < 0.0, 0.0, dr.select(value > 1.0, 1.0, value))


def _copied(dr: Any, kind: Any, column: np.ndarray) -> Any:
    """A NumPy array in memory of Dr.Jit: mapped arrays recompile by accidental alignment."""
    copy = kind(column) + dr.opaque(kind, 0.0)
    dr.eval(copy)
    return copy


def _check_scalar(name: str, value: Any) -> None:
    if is_drjit(value) or np.ndim(value):
        return
    upper = 1.0 if name == "mu" else math.inf
    if not (0.0 <= value <= upper and math.isfinite(value)):
        raise input_error(
            f"{name}={value:g}",
            "a cosine in [0, 1]" if name == "mu" else "a finite number >= 0",
            "Arrays may hold any value: mu is clamped there, a bad alpha gives NaN.",
        )

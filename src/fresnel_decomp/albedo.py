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

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ._arguments import floating_type, numpy_arguments, plain_numbers, real_arguments, without_axes
from ._array import DrJitOps, drjit_constant, drjit_module, is_drjit, ops_for
from ._check import choose, input_error, is_whole
from ._distributions import Shape, named_shape
from ._lobe_rule import (
    TWO_PANELS,
    Nodes,
    View,
    at_azimuth,
    reflected,
    rule_nodes,
    seen_from,
    unit_gauss,
)
from .microfacet import SMITH, Distribution, Smith

__all__ = [
    "MOST_NODES",
    "QUADRATURE",
    "ROUGHEST",
    "TWO_PANELS",
    "Quadrature",
    "average_albedo",
    "average_fresnel",
    "directional_albedo",
]

Fresnel = Callable[[Any], Any]


class Quadrature(NamedTuple):
    """Numbers of Gauss nodes in azimuth, on [0, pi], and in the slope.

    From `TWO_PANELS` on, the azimuth has one rule on either side of pi/2, which converges
    exponentially even where the integrand has a kink there; below, one rule over both is better.
    """

    azimuth: int
    slope: int


MOST_NODES = 512
"""In either direction."""

SMOOTH = 1e-18
"""Below this alpha a surface is a mirror: squares would underflow in float32."""

ROUGHEST = 1e6
"""The largest alpha: the fourth power is finite in float32. Roughness above 1 is rarely meant."""

_GROUP = 4  # nodes that Dr.Jit's loop treats in one turn

QUADRATURE = Quadrature(32, 24)
"""By default. For curves that are smooth it errs by less than 3e-6 at the hardest angles and
roughnesses, for a dielectric seen from inside by up to 0.02: see `albedo_refined`."""


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
    alpha : (...) float in [0, ROUGHEST]
        Roughness as the distributions have it, the square of perceptual roughness.
    smith : {"separable", "correlated"}
    distribution : {"ggx", "beckmann"}
    quadrature : pair of int, optional
        Nodes in azimuth and slope, see `QUADRATURE`. The default suits smooth curves; for one with
        a kink, such as `dielectric` with eta < 1, use `albedo_refined.refined_albedo`.

    Returns
    -------
    (...) or (..., n) float, for Dr.Jit an array or a tuple of them: differentiable in mu, in
    alpha and in what f depends on. At alpha = 0 it is f(mu), at mu = 0 the limit. NumPy computes in
    float64, Dr.Jit in the type of mu and alpha.

    Raises
    ------
    InputError
        For scalars out of range, arguments that are not real or do not broadcast, unknown options.
        In arrays mu is clamped, and NaN or an alpha out of range gives NaN.

    Examples
    --------
    >>> import math
    >>> from fresnel_decomp import directional_albedo
    >>> white = directional_albedo(lambda cos_theta: 1.0 + 0.0 * cos_theta, 1.0, 1.0)
    >>> abs(white - (1.0 - math.log(2.0))) < 1e-6  # exact for separable GGX at normal incidence
    True
    """
    shape = named_shape(distribution)
    choose("smith", smith, SMITH)
    nodes = rule_nodes(*checked_quadrature(quadrature))
    mu, alpha = real_arguments(mu=mu, alpha=alpha)
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
    nodes : int, 1 to `MOST_NODES`
        Of the Gauss rule in the root of the cosine. For a curve with a kink take the most.

    Returns
    -------
    float or (n,) float64

    Raises
    ------
    InputError
        For another number of nodes, or if f returns something of another shape.

    Examples
    --------
    >>> from fresnel_decomp import load_basis
    >>> from fresnel_decomp.albedo import average_fresnel
    >>> average_fresnel(load_basis()).round(4)
    array([1.    , 0.0495, 0.1747, 0.3707])
    """
    root, weight = unit_gauss(_node_count(nodes))
    mu = root * root  # dense at grazing angles, where Fresnel functions bend
    values = np.asarray(f(mu))
    if values.ndim == 0:  # a constant
        values = np.broadcast_to(values, mu.shape)
    if len(values) != nodes:
        raise input_error(
            f"f with values of shape {values.shape} at {nodes} cosines",
            "a callable from (m,) cosines to (m,) or (m, n) values",
            "Average one material at a time, or put materials into the last axis.",
        )
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
    alpha : (...) float in [0, ROUGHEST]
        NumPy arrays and Python floats only.
    nodes : int, 1 to `MOST_NODES`
        In mu.

    Returns
    -------
    (...) or (..., n) float64

    Raises
    ------
    InputError
        As `directional_albedo` does, for Dr.Jit arrays, and for another number of nodes.

    Examples
    --------
    >>> from fresnel_decomp.albedo import average_albedo
    >>> round(float(average_albedo(lambda cos_theta: 1.0 + 0.0 * cos_theta, 1.0)), 3)
    0.377
    """
    root, weight = unit_gauss(_node_count(nodes))
    (alpha,) = numpy_arguments(alpha=alpha)
    _check_scalar("alpha", alpha)
    alpha = np.asarray(alpha, np.float64)
    mu = (root * root).reshape(-1, *(1,) * alpha.ndim)
    mu = np.broadcast_to(mu, (nodes, *alpha.shape))
    values = directional_albedo(f, mu, alpha, smith=smith, distribution=distribution)
    return np.tensordot(4.0 * weight * root**3, values, 1)[()]


# --- arguments -----------------------------------------------------------------------------------


def checked_quadrature(quadrature: tuple[int, int] | None) -> tuple[int, int]:
    try:
        azimuth, slope = QUADRATURE if quadrature is None else quadrature
    except (TypeError, ValueError):
        azimuth = slope = 0
    if not (is_whole(azimuth, 2, MOST_NODES) and is_whole(slope, 2, MOST_NODES)) or azimuth % 2:
        raise input_error(
            f"quadrature={quadrature!r}",
            f"two numbers of nodes from 2 to {MOST_NODES}, the first one even",
            f"The default is {tuple(QUADRATURE)}.",
        )
    return int(azimuth), int(slope)


def _node_count(nodes: int) -> int:
    if not is_whole(nodes, 1, MOST_NODES):
        raise input_error(
            f"nodes={nodes!r}", f"a whole number from 1 to {MOST_NODES}", "64 is enough."
        )
    return int(nodes)


def _check_scalar(name: str, value: Any) -> None:
    if is_drjit(value) or np.ndim(value):
        return
    upper = 1.0 if name == "mu" else ROUGHEST
    if not 0.0 <= value <= upper:
        raise input_error(
            f"{name}={value:g}",
            "a cosine in [0, 1]" if name == "mu" else f"a number in [0, {ROUGHEST:g}]",
            "Arrays may hold any value: mu is clamped there, a bad alpha gives NaN.",
        )


# --- sums over nodes -----------------------------------------------------------------------------


def _on_numpy(f: Fresnel, mu: Any, alpha: Any, smith: str, shape: Shape, nodes: Nodes) -> Any:
    result_type = floating_type(mu, alpha)
    plain = plain_numbers(mu, alpha)
    mu, alpha = np.broadcast_arrays(np.asarray(mu, np.float64), np.asarray(alpha, np.float64))
    valid = ~np.isnan(mu) & (alpha >= 0.0) & (alpha <= ROUGHEST)
    smooth = alpha < SMOOTH
    ops = ops_for()
    mu, alpha = np.clip(mu, 0.0, 1.0), np.where(valid & ~smooth, alpha, 1.0)
    view = seen_from(ops, shape, np.where(valid, mu, 1.0), alpha, nodes.width, 1e-14)
    w, w_weight = (column.reshape(-1, *(1,) * mu.ndim) for column in (nodes.w, nodes.w_weight))
    total: Any = 0.0
    for u, u_weight in zip(nodes.u, nodes.u_weight, strict=True):
        azimuth = at_azimuth(ops, shape, view, u, u_weight)
        cos_d, weight = reflected(ops, shape, smith, view, azimuth, w)
        weight = weight * w_weight
        values = np.asarray(f(cos_d))
        vector = values.ndim > weight.ndim
        total = total + ((weight[..., None] if vector else weight) * values).sum(axis=0)
    if np.any(smooth):
        mirror = np.asarray(f(mu[None]))
        mirror = mirror[0] if mirror.ndim else mirror  # of a constant
        total = np.where(smooth[..., None] if vector else smooth, mirror, total)
    total = np.where(valid[..., None] if vector else valid, total, np.nan)
    return without_axes(total.astype(result_type), plain)


def _on_drjit(f: Fresnel, mu: Any, alpha: Any, smith: str, shape: Shape, nodes: Nodes) -> Any:
    dr = drjit_module()
    assert dr is not None
    ops = DrJitOps()
    result = type(mu * 0.0 + alpha * 0.0)
    mu, alpha = result(mu), result(alpha)
    valid = ~dr.isnan(mu) & (alpha >= 0.0) & (alpha <= ROUGHEST)
    double = dr.type_v(result) == dr.VarType.Float64
    smooth = alpha < SMOOTH
    mu, alpha = _clamped(dr, mu), dr.select(valid & ~smooth, alpha, 1.0)
    view = seen_from(ops, shape, mu, alpha, nodes.width, 1e-12 if double else 1e-6)
    # A loop over groups of nodes is recorded. Those of a group share an azimuth and are unrolled:
    # processors work on them side by side, but compilers take their time.
    group = next(size for size in (_GROUP, 3, 2, 1) if len(nodes.w) % size == 0)
    rows = [
        (u, u_weight, *nodes.w[start : start + group], *nodes.w_weight[start : start + group])
        for u, u_weight in zip(nodes.u, nodes.u_weight, strict=True)
        for start in range(0, len(nodes.w), group)
    ]

    def add(totals: tuple[Any, ...], view: View, row: Sequence[Any]) -> tuple[Any, ...]:
        azimuth = at_azimuth(ops, shape, view, row[0], row[1])
        for w, w_weight in zip(row[2 : 2 + group], row[2 + group :], strict=True):
            cos_d, weight = reflected(ops, shape, smith, view, azimuth, w)
            weight = weight * w_weight
            values = _as_tuple(f(cos_d))
            totals = tuple(dr.fma(weight, v, t) for v, t in zip(values, totals, strict=True))
        return totals

    mirror = f(mu)
    total = tuple(dr.detach(0.0 * value + 0.0 * (mu + alpha)) for value in _as_tuple(mirror))
    if dr.is_jit_v(result):
        columns = [drjit_constant(result, column) for column in np.array(rows).T]
        index = dr.uint32_array_t(result)

        def body(i: Any, view: tuple[Any, ...], totals: tuple[Any, ...]) -> tuple[Any, ...]:
            row = [dr.gather(result, column, i) for column in columns]
            return i + 1, view, add(totals, View(*view), row)

        # the view is part of the state, since derivatives of what a loop captures are fragile
        *_, total = dr.while_loop(
            (index(0), tuple(view), total),
            lambda i, view, totals: i < len(rows),
            body,
            max_iterations=-1,
            label="directional albedo",
        )
    else:
        for row in rows:
            total = add(total, view, [float(value) for value in row])
    total = tuple(
        dr.select(valid, dr.select(smooth, reflected, value), dr.nan)
        for reflected, value in zip(_as_tuple(mirror), total, strict=True)
    )
    return total if isinstance(mirror, tuple | list) else total[0]


def _as_tuple(values: Any) -> tuple[Any, ...]:
    return tuple(values) if isinstance(values, tuple | list) else (values,)


def _clamped(dr: Any, value: Any) -> Any:
    """`value` in [0, 1]; dr.clip would have no derivative at the ends."""
    return dr.select(value < 0.0, 0.0, dr.select(value > 1.0, 1.0, value))

r"""The exact Fresnel equations, right at their limits, in value and in derivative.

Unpolarised reflectance R = (R_s + R_p)/2 of a plane boundary with *relative* complex index of
refraction m = eta + i k (k >= 0 absorbs), as a function of the cosine c of the angle of incidence.
Born and Wolf, *Principles of Optics*, 7th ed., sections 1.5 and 14.2, in a form without
cancellation: with

    X = eta² + c² - 1 - k²,  Y = 2 eta k,  W = |X + iY|,  A + iB = sqrt(X + iY),  s² = 1 - c²,
    D_s = W + c² + 2Ac,  N = W c² + s⁴,  D_q = N + 2 A c s²,  V = m² c² - s²,

    R_s = |m² - 1|² / D_s²         T_s = 4 A c / D_s
    R_p = R_s |V|² / D_q²          T_p = T_s (W + s²) / D_q
    R   = R_s N / D_q              T   = 2 A c (D_q + W + s²) / (D_s D_q)

R and T are both sums and products of non-negative terms; whichever is small is returned as
computed and the other one as its complement.

Every function takes Python floats, NumPy arrays or Dr.Jit arrays of any backend, broadcasts, and
returns the same kind. Rule for bad input, here and in `parametrization`: a *scalar*
(NumPy's, and arrays without dimensions, included) outside its range raises `InputError`; in
*arrays*, cos_theta is clamped to [0, 1], and a NaN, an infinity, eta <= 0 or k < 0 gives NaN at
that entry. So may an index whose square leaves the working type: values hold for eta and k in
[1e-150, 1e150] (and k = 0), derivatives in [1e-50, 1e50]; with `precision="native"` on float32 in
[1e-18, 1e18] and [1e-6, 1e6]. "wide" on float32 has no such limits.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np

from ._array import (
    DrJitOps,
    NumPyOps,
    Ops,
    drjit_module,
    floating_type,
    one_kind,
    ops_for,
    real_arrays,
)
from ._check import choose, input_error

__all__ = [
    "conductor",
    "dielectric",
    "polarized",
    "reflectance_components",
    "refracted_cosine",
    "transmittance",
]

Precision = Literal["wide", "native"]


def conductor(cos_theta: Any, eta: Any, k: Any, *, precision: Precision = "wide") -> Any:
    """Unpolarised Fresnel reflectance of an absorbing medium.

    Parameters
    ----------
    cos_theta : (...) float in [0, 1]
        Cosine of the angle of incidence.
    eta, k : (...) float, eta > 0, k >= 0
        Real and imaginary part of the relative index of refraction.
    precision : {"wide", "native"}
        "wide" evaluates float32 input in float64; "native" stays in the input's type, with
        error-compensated sums. The two agree for float64.

    Returns
    -------
    (...) float in [0, 1], of the kind and precision of the input; differentiable with Dr.Jit, with
    closed-form derivatives (at k = 0 the one-sided limit; 0 where the index is matched).

    Raises
    ------
    InputError
        For scalars outside the ranges above; arrays follow the rule of this module.

    Examples
    --------
    >>> from fresnel_decomp import conductor
    >>> round(conductor(1.0, 1.5, 0.0), 6)
    0.04
    """
    return _differentiable(_reflectance, (cos_theta, eta, k), precision)[0]


def dielectric(cos_theta: Any, eta: Any, *, precision: Precision = "wide") -> Any:
    """Unpolarised Fresnel reflectance of a dielectric; 1 beyond the critical angle if eta < 1.

    Parameters, return value and errors as for `conductor`, with k = 0.

    Examples
    --------
    >>> from fresnel_decomp import dielectric
    >>> dielectric(0.1, 0.5)  # total internal reflection
    1.0
    """
    return conductor(cos_theta, eta, 0.0, precision=precision)


def transmittance(cos_theta: Any, eta: Any, k: Any = 0.0, *, precision: Precision = "wide") -> Any:
    """1 - R, accurate where R is near 1 (strong conductors, grazing incidence).

    Parameters, return value and errors as for `conductor`.
    """
    return _differentiable(_reflectance, (cos_theta, eta, k), precision)[1]


def polarized(
    cos_theta: Any, eta: Any, k: Any = 0.0, *, precision: Precision = "wide"
) -> tuple[Any, Any]:
    """(R_s, R_p): reflectances for light polarised perpendicular and parallel to the plane.

    Parameters and errors as for `conductor`.
    """
    return reflectance_components(cos_theta, eta, k, precision=precision)[:2]


def reflectance_components(
    cos_theta: Any, eta: Any, k: Any = 0.0, *, precision: Precision = "wide"
) -> tuple[Any, Any, Any, Any]:
    """(R_s, R_p, T_s, T_p), each accurate on its own: T = 1 - R without its cancellation.

    Parameters and errors as for `conductor`.
    """
    R_s, T_s, R_p, T_p = _differentiable(_components, (cos_theta, eta, k), precision)
    return R_s, R_p, T_s, T_p


def refracted_cosine(cos_theta: Any, eta: Any, *, precision: Precision = "wide") -> Any:
    """Cosine of the refracted angle by Snell's law, sin(theta_t) = sin(theta) / eta.

    Parameters
    ----------
    cos_theta : (...) float in [0, 1]
    eta : (...) float > 0
        Relative index of refraction, transmitted over incident side.
    precision : {"wide", "native"}
        As for `conductor`.

    Returns
    -------
    (...) float in [0, 1]; 0 beyond the critical angle, with zero derivative there.

    Raises
    ------
    InputError
        For scalars outside the ranges above; arrays follow the rule of this module.
    """
    return _differentiable(_refraction, (cos_theta, eta, 0.0), precision)[0]


# --- the equations -------------------------------------------------------------------------------


class _Shared(NamedTuple):
    """Quantities that values and derivatives share; names as in the module's docstring."""

    ops: Ops
    compensated: bool
    c: Any
    eta: Any
    k: Any
    s2: Any
    X: Any
    Y: Any
    W: Any
    A: Any
    B: Any
    D_s: Any
    D_q: Any
    N: Any
    R_s: Any
    matched: Any  # mask: m = 1


def _shared(ops: Ops, c: Any, eta: Any, k: Any, compensated: bool) -> _Shared:
    s2 = (1.0 - c) * (1.0 + c)
    X = _squares_minus_one(ops, eta, c, k, compensated)
    Y = 2.0 * eta * k
    W = _norm(ops, X, Y, compensated)
    t = ops.sqrt(0.5 * (W + ops.abs(X)))
    # t = 0 only where W = 0; there A = B = 0
    other = eta * k / ops.select(t > 0.0, t, 1.0)
    A, B = ops.select(X >= 0.0, t, other), ops.select(X >= 0.0, other, t)
    matched = (eta == 1.0) & (k == 0.0)
    D_s = ops.select(matched, 1.0, W + c * c + 2.0 * A * c)
    # |m² - 1|² as |m - 1|² |m + 1|²: no cancellation, and divided before it could underflow
    less, more = eta - 1.0, eta + 1.0
    R_s = (less * (less / D_s) + k * (k / D_s)) * ((more * more + k * k) / D_s)
    N = W * c * c + s2 * s2
    D_q = N + 2.0 * A * c * s2
    return _Shared(ops, compensated, c, eta, k, s2, X, Y, W, A, B, D_s, D_q, N, R_s, matched)


def _reflectance(q: _Shared, derivatives: bool) -> list[tuple[Any, Any]]:
    """[(R, gradient), (T, gradient)], gradients wrt (c, eta, k) or None."""
    R = q.R_s * (q.N / q.D_q)
    # c last: c / D_s may underflow where T does not
    T = 2.0 * q.A / q.D_s * ((q.D_q + q.W + q.s2) / q.D_q) * q.c
    R, T = _complements(q, R, T)
    if not derivatives:
        return [(R, None), (T, None)]
    of_s, of_p = _derivatives(q)
    # dR_s/dc and dR_p/dc cancel at normal incidence; their sum has the factor s²
    c2, s2 = q.c * q.c, q.s2
    bracket = (
        c2 * (q.W * q.W + 2.0 * q.X - 2.0 * q.W * s2 - 4.0 * q.A * q.A * s2)
        - (q.W + s2 * s2 * (1.0 + s2))
        - 4.0 * q.A * q.c * q.N
    )
    wrt_c = -of_s[0] * s2 * (0.5 * bracket / q.D_q / q.D_q)
    gradient = (wrt_c, 0.5 * (of_s[1] + of_p[1]), 0.5 * (of_s[2] + of_p[2]))
    return [(R, gradient), (T, tuple(-d for d in gradient))]


def _components(q: _Shared, derivatives: bool) -> list[tuple[Any, Any]]:
    """R_s, T_s, R_p, T_p, each with its gradient wrt (c, eta, k) or None."""
    R_s = q.R_s
    T_s_over_c = 4.0 * q.A / q.D_s  # c last: c / D_s may underflow where T_s does not
    T_s = T_s_over_c * q.c
    # compensated even in float64: near Brewster's angle nothing else is left
    real_V = _squares_minus_one(q.ops, (q.c, q.eta), q.c, (q.c, q.k), True)
    imag_V = q.Y * q.c * q.c
    R_p = R_s * ((real_V * real_V + imag_V * imag_V) / q.D_q / q.D_q)
    T_p = T_s_over_c * ((q.W + q.s2) / q.D_q) * q.c
    values = (*_complements(q, R_s, T_s), *_complements(q, R_p, T_p))
    if not derivatives:
        return [(value, None) for value in values]
    of_s, of_p = _derivatives(q)
    gradients = (of_s, tuple(-d for d in of_s), of_p, tuple(-d for d in of_p))
    return list(zip(values, gradients, strict=True))


def _complements(q: _Shared, R: Any, T: Any) -> tuple[Any, Any]:
    """(R, T) with R + T = 1: the smaller as computed. 2/3, since R is a little more accurate."""
    R, T = q.ops.select(q.matched, 0.0, R), q.ops.select(q.matched, 1.0, T)
    keep_R = T > 2.0 / 3.0
    return q.ops.select(keep_R, R, 1.0 - T), q.ops.select(keep_R, 1.0 - R, T)


def _derivatives(q: _Shared) -> tuple[tuple[Any, Any, Any], tuple[Any, Any, Any]]:
    """Closed-form gradients of R_s and R_p wrt (c, eta, k); zero where W = 0 or m = 1."""
    ops, c, eta, k, s2, W = q.ops, q.c, q.eta, q.k, q.s2, q.W
    c2, s4 = c * c, s2 * s2
    regular = (W > 0.0) & ~q.matched
    W_safe = ops.select(regular, W, 1.0)
    E = (eta - k) * (eta + k)
    f = 4.0 * q.R_s * (q.A / W_safe)
    G = W * W * c2 + 2.0 * s2 * c2 * q.X - s2 * (W + s4)
    # With a + ib = conj(m) (A + iB), d/deta + i d/dk is
    #   h c (a + ib) (m² - 1)  for R_s,  and that times  (conj(m)² - 2s²) V / D_q²  for R_p.
    # Every factor is free of cancellation; multiplied out, the product is not.
    h = 4.0 / W_safe / q.D_s / q.D_s  # without c, or it may underflow
    a, b = eta * q.A + k * q.B, eta * q.B - k * q.A
    b = ops.select(a > b, 0.5 * q.Y * s2 / ops.select(a > b, a, 1.0), b)  # 2ab = Y s²
    m2_less_one = _squares_minus_one(ops, eta, 0.0, k, q.compensated)
    V = _squares_minus_one(ops, (c, eta), c, (c, k), q.compensated)
    third = E - 2.0 * s2
    # (m² - 1)(conj(m)² - 2s²) and (conj(m)² - 2s²) V; both have explicit imaginary parts
    first, first_i = m2_less_one * third + q.Y * q.Y, q.Y * (2.0 * c2 - 1.0)
    last, last_i = V * third + q.Y * q.Y * c2, -s2 * first_i
    s_eta, s_k = a * m2_less_one - b * q.Y, a * q.Y + b * m2_less_one
    p_eta = s_eta * last - s_k * last_i
    # the order of multiplication matters for the small one: see normal incidence with |m| << 1,
    # and grazing incidence with |m| >> 1
    p_k = ops.select(
        c2 > 0.5,
        s_eta * last_i + s_k * last,
        (a * first - b * first_i) * (q.Y * c2) + (a * first_i + b * first) * V,
    )
    of_s = (-f, h * s_eta * c, h * s_k * c)
    of_p = (
        f * (G / q.D_q / q.D_q),
        h * (p_eta / q.D_q / q.D_q) * c,
        h * (p_k / q.D_q / q.D_q) * c,
    )

    def masked(gradient: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        wrt_c, wrt_eta, wrt_k = (ops.select(regular, d, 0.0) for d in gradient)
        return wrt_c, wrt_eta, wrt_k

    return masked(of_s), masked(of_p)


def _refraction(q: _Shared, derivatives: bool) -> list[tuple[Any, Any]]:
    refracts = q.X > 0.0
    cos_t = q.ops.select(refracts, q.A, 0.0) / q.eta  # k = 0: A = sqrt(X)
    cos_t = q.ops.minimum(cos_t, 1.0)
    if not derivatives:
        return [(cos_t, None)]
    slope = q.ops.select(refracts, 1.0, 0.0) / (q.eta * q.ops.select(refracts, q.A, 1.0))
    return [(cos_t, (slope * q.c, slope * q.s2 / q.eta, 0.0 * slope))]


def _squares_minus_one(ops: Ops, x: Any, y: Any, less: Any, compensated: bool) -> Any:
    """x² + y² - 1 - less², where an argument (a, b) stands for the product a b.

    With lo = min, g = max - 1 it is (lo² + 2g) + g² - less²: where the terms cancel, at the
    critical angle and for m near 1, both sums are exact in this order (Sterbenz), and so is g.
    Squares of float32 are exact in float64; with `compensated` they, and products, carry their
    rounding errors. less² needs no such care: where it cancels too, the imaginary part of what
    this is the real part of is larger.
    """
    x, x_error = _product(ops, x, compensated)
    y, y_error = _product(ops, y, compensated)
    less, _ = _product(ops, less, False)
    low, g = ops.minimum(x, y), ops.maximum(x, y) - 1.0
    if not compensated:
        return (low * low + 2.0 * g) + g * g - less * less
    low_square, low_error = ops.two_product(low, low)
    g_square, g_error = ops.two_product(g, g)
    error = low_error + g_error
    for factor, rounding in ((x, x_error), (y, y_error)):
        if rounding is not None:
            error = error + 2.0 * factor * rounding
    return ((low_square + 2.0 * g) + g_square) + error - less * less


def _product(ops: Ops, value: Any, compensated: bool) -> tuple[Any, Any]:
    """A value, or the product that a pair stands for, and its rounding error or None."""
    if not isinstance(value, tuple):
        return value, None
    return ops.two_product(*value) if compensated else (value[0] * value[1], None)


def _norm(ops: Ops, x: Any, y: Any, scaled: bool) -> Any:
    """|x + iy|; unscaled where float64 holds squares of float32 values with room to spare."""
    return ops.hypot(x, y) if scaled else ops.sqrt(x * x + y * y)


# --- kinds of input ------------------------------------------------------------------------------


def _differentiable(formula: Any, arguments: tuple[Any, Any, Any], precision: str) -> list[Any]:
    """Run `formula` on checked arguments in the right precision; attach its derivatives."""
    choose("precision", precision, ("wide", "native"))
    ops = ops_for(*arguments)
    if isinstance(ops, DrJitOps):
        return _on_drjit(ops, formula, one_kind(*arguments), precision)
    return _on_numpy(formula, arguments, precision)


def _on_numpy(formula: Any, arguments: tuple[Any, Any, Any], precision: str) -> list[Any]:
    for name, value in zip(("cos_theta", "eta", "k"), arguments, strict=True):
        _check_scalar(name, value)
    given = real_arrays(cos_theta=arguments[0], eta=arguments[1], k=arguments[2])
    result = floating_type(*arguments)
    native_f32 = precision == "native" and result == np.float32
    work = np.dtype(np.float32 if native_f32 else np.float64)
    c, eta, k = (value.astype(work) for value in given)
    valid = np.isfinite(eta) & (eta > 0.0) & np.isfinite(k) & (k >= 0.0) & ~np.isnan(c)
    c = np.clip(c, 0.0, 1.0)
    eta, k = np.where(valid, eta, work.type(1.5)), np.where(valid, k, work.type(0))
    compensated = result.itemsize >= work.itemsize
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        shared = _shared(NumPyOps(work), c, eta, k, compensated)
        values = [value for value, _ in formula(shared, False)]
    values = [np.where(valid, value, np.nan).astype(result) for value in values]
    if all(value.ndim == 0 for value in given):
        plain = all(not isinstance(value, np.generic | np.ndarray) for value in arguments)
        return [float(value) if plain else value[()] for value in values]
    return values


def _check_scalar(name: str, value: Any) -> None:
    if np.ndim(value) != 0 or isinstance(value, bool) or not np.isreal(value):
        return
    number = float(value)
    good, accepted, advice = {
        "cos_theta": (
            0.0 <= number <= 1.0,
            "a cosine in [0, 1]",
            "Clamp it, or pass an array, in which cosines are clamped.",
        ),
        "eta": (number > 0.0, "eta > 0", "Divide the index by that of the incident medium."),
        "k": (
            number >= 0.0,
            "k >= 0",
            "Absorbing media have k > 0 in the convention eta + i k.",
        ),
    }[name]
    if not (np.isfinite(number) and good):
        raise input_error(f"{name}={number:g}", f"{accepted}, finite", advice)


def _on_drjit(ops: DrJitOps, formula: Any, arguments: tuple[Any, ...], precision: str) -> list[Any]:
    dr = drjit_module()
    assert dr is not None
    for name, value in zip(("cos_theta", "eta", "k"), arguments, strict=True):
        if not dr.is_array_v(value):
            _check_scalar(name, value)
        elif not dr.is_float_v(value):
            raise input_error(
                f"{name} of type {type(value).__name__}",
                "a floating-point Dr.Jit array",
                "Convert it first, e.g. mi.Float(value).",
            )
    double = any(dr.is_array_v(v) and dr.type_v(v) == dr.VarType.Float64 for v in arguments)
    widen = precision == "wide" and not double
    # one common type, so that a literal cannot pin the precision of an intermediate
    template = dr.detach(arguments[0] * 0.0 + arguments[1] * 0.0 + arguments[2] * 0.0)
    result = type(template)
    work = dr.float64_array_t(result) if widen else result
    c, eta, k = (dr.detach(result(value)) for value in arguments)
    # checked in the caller's type, which is the cheaper one
    valid = (eta > 0.0) & (eta < dr.inf) & (k >= 0.0) & (k < dr.inf) & ~dr.isnan(c)
    c = work(dr.clip(c, 0.0, 1.0))
    eta, k = work(dr.select(valid, eta, 1.5)), work(dr.select(valid, k, 0.0))
    attach = any(dr.is_array_v(value) and dr.grad_enabled(value) for value in arguments)
    results = []
    for value, gradient in formula(_shared(ops, c, eta, k, not widen), attach):
        value = dr.select(valid, result(value), dr.nan)
        if attach:
            # linear in the arguments with the closed-form slopes: right in both modes, any order
            # of evaluation, and no derivative of an intermediate can overflow
            tangent = result(0.0)
            for argument, slope in zip(arguments, gradient, strict=True):
                if dr.is_array_v(argument) and dr.grad_enabled(argument):
                    tangent = tangent + result(argument) * result(slope)
            value = dr.replace_grad(value, tangent)
        results.append(value)
    return results

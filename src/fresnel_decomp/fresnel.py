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
computed and the other one as its complement. `_equations` evaluates this.

Every function takes Python floats, NumPy arrays or Dr.Jit arrays of any backend, broadcasts, and
returns the same kind. Rule for bad input, here and in `parametrization`: a *scalar*
(NumPy's, and arrays without dimensions, included) outside its range raises `InputError`; in
*arrays*, cos_theta is clamped to [0, 1], and a NaN, an infinity, eta <= 0 or k < 0 gives NaN at
that entry. Every other entry gives a number in [0, 1]. What is no real number (complex numbers,
truth values, strings) and shapes that do not broadcast raise `InputError` in any case.

"wide" on float32 has no limits beyond those of the type. Where float64, or float32 with "native",
computes in its own type, |m|⁶ has to fit: there an eta or k beyond 2^160, or 2^20, counts as that,
and an eta below 2^-160, or 2^-20, as that.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from . import _equations
from ._arguments import floating_type, one_kind, plain_numbers, real_arrays, without_axes
from ._array import DrJitOps, NumPyOps, Ops, drjit_module, ops_for
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
        "wide" evaluates float32 input in float64; "native" stays in the input's type (float16: in
        float32), with error-compensated sums. The two agree for float64.

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
    return _evaluate(_equations.reflectance, (cos_theta, eta, k), precision)[0]


def dielectric(cos_theta: Any, eta: Any, *, precision: Precision = "wide") -> Any:
    """Unpolarised Fresnel reflectance of a dielectric; 1 beyond the critical angle if eta < 1.

    Parameters, return value and errors as for `conductor`, with k = 0; faster, since no complex
    number is left.

    Examples
    --------
    >>> from fresnel_decomp import dielectric
    >>> dielectric(0.1, 0.5)  # total internal reflection
    1.0
    """
    return _evaluate(_equations.dielectric, (cos_theta, eta), precision)[0]


def transmittance(cos_theta: Any, eta: Any, k: Any = 0.0, *, precision: Precision = "wide") -> Any:
    """1 - R, accurate where R is near 1 (strong conductors, grazing incidence).

    Parameters, return value and errors as for `conductor`.

    Examples
    --------
    >>> from fresnel_decomp import transmittance
    >>> round(transmittance(0.5, 1.5), 4)
    0.9108
    """
    return _evaluate(_equations.reflectance, (cos_theta, eta, k), precision)[1]


def polarized(
    cos_theta: Any, eta: Any, k: Any = 0.0, *, precision: Precision = "wide"
) -> tuple[Any, Any]:
    """(R_s, R_p): reflectances for light polarised perpendicular and parallel to the plane.

    Parameters and errors as for `conductor`.

    Examples
    --------
    >>> from fresnel_decomp import polarized
    >>> [round(r, 4) for r in polarized(0.5, 1.5)]  # near Brewster's angle
    [0.1766, 0.0018]
    """
    return reflectance_components(cos_theta, eta, k, precision=precision)[:2]


def reflectance_components(
    cos_theta: Any, eta: Any, k: Any = 0.0, *, precision: Precision = "wide"
) -> tuple[Any, Any, Any, Any]:
    """(R_s, R_p, T_s, T_p), each accurate on its own: T = 1 - R without its cancellation.

    Parameters and errors as for `conductor`.

    Examples
    --------
    >>> from fresnel_decomp import reflectance_components
    >>> [round(part, 4) for part in reflectance_components(0.5, 1.5)]
    [0.1766, 0.0018, 0.8234, 0.9982]
    """
    R_s, T_s, R_p, T_p = _evaluate(_equations.components, (cos_theta, eta, k), precision)
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

    Examples
    --------
    >>> from fresnel_decomp import refracted_cosine
    >>> round(refracted_cosine(0.5, 1.5), 4)
    0.8165
    """
    return _evaluate(_equations.refraction, (cos_theta, eta), precision)[0]


# --- kinds of input ------------------------------------------------------------------------------


NAMES = ("cos_theta", "eta", "k")
LIMIT = {"float32": 2.0**20, "float64": 2.0**160}
"""Largest index that is told from a larger one, by the type that has to hold its sixth power."""


def _evaluate(formula: Any, arguments: tuple[Any, ...], precision: str) -> list[Any]:
    """Run `formula` on checked arguments in the right precision; attach its derivatives."""
    choose("precision", precision, ("wide", "native"))
    ops = ops_for(*arguments)
    if isinstance(ops, DrJitOps):
        return _on_drjit(ops, formula, one_kind(*arguments), precision)
    return _on_numpy(formula, arguments, precision)


def _cleaned(
    ops: Ops, cos_theta: Any, indices: list[Any], largest: float | None
) -> tuple[Any, list[Any]]:
    """Arguments within their ranges; eta NaN where an index is not valid, and so every result.

    Written such that a NaN passes: a comparison with it is false. In kernels this is faster than
    `clip` and `minimum`, which care for signed zeros.
    """
    c = ops.select(cos_theta < 0.0, 0.0, cos_theta)
    c = ops.select(c > 1.0, 1.0, c)
    eta = indices[0]
    valid, index = eta > 0.0, eta
    for k in indices[1:]:
        valid, index = valid & (k >= 0.0), ops.select(eta > k, eta, k)
    valid = valid & (index < np.inf)
    if largest is not None:
        indices = [ops.select(value > largest, largest, value) for value in indices]
        indices[0] = ops.select(indices[0] < 1.0 / largest, 1.0 / largest, indices[0])
    return c, [ops.select(valid, indices[0], np.nan), *indices[1:]]


def _on_numpy(formula: Any, arguments: tuple[Any, ...], precision: str) -> list[Any]:
    given = real_arrays(**dict(zip(NAMES, arguments, strict=False)))
    for name, value in zip(NAMES, given, strict=False):
        if value.ndim == 0:
            _check_scalar(name, float(value))
    result = floating_type(*arguments)
    native = precision == "native" and result.itemsize <= 4
    work = np.dtype(np.float32 if native else np.float64)
    compensated = native or result == work
    ops = NumPyOps(work)
    with np.errstate(all="ignore"):
        c, *indices = (value.astype(work) for value in given)
        c, indices = _cleaned(ops, c, indices, LIMIT[work.name] if compensated else None)
        nothing = (False, False, False)
        values = [value for value, _ in formula(ops, c, *indices, compensated, nothing)]
        values = [np.asarray(value).astype(result) for value in values]
    plain = plain_numbers(*arguments)
    return [without_axes(value, plain) for value in values]


def _check_scalar(name: str, number: float) -> None:
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
    for name, value in zip(NAMES, arguments, strict=False):
        if not dr.is_array_v(value):
            _check_scalar(name, value)
        elif not dr.is_float_v(value) or dr.is_special_v(value):
            raise input_error(
                f"{name} of type {type(value).__name__}",
                "a floating-point Dr.Jit array of real numbers",
                "Convert it first, e.g. mi.Float(value); pass eta and k as two arrays.",
            )
    result = _common_type(dr, arguments)
    kind = dr.type_v(result)
    double = kind == dr.VarType.Float64
    compensated = double or precision == "native"
    if compensated:
        work = dr.float32_array_t(result) if kind == dr.VarType.Float16 else result
    else:
        work = dr.float64_array_t(result)
    # checked in the caller's type, which is the cheaper one
    checked = work if compensated else result
    c, *indices = (dr.detach(checked(result(value))) for value in arguments)
    largest = LIMIT["float64" if double else "float32"] if compensated else None
    c, indices = _cleaned(ops, c, indices, largest)
    wanted = [dr.is_array_v(value) and dr.grad_enabled(value) for value in arguments]
    wanted += [False] * (3 - len(wanted))
    results = []
    for value, slopes in formula(
        ops, work(c), *(work(index) for index in indices), compensated, tuple(wanted)
    ):
        value = result(value)
        if any(wanted):
            # linear in the arguments with the closed-form slopes: right in both modes, any order
            # of evaluation, and no derivative of an intermediate can overflow
            tangent = result(0.0)
            for argument, slope, want in zip(arguments, slopes, wanted, strict=False):
                if want and slope is not None:
                    tangent = dr.fma(result(argument), result(slope), tangent)
            value = dr.replace_grad(value, tangent)
        results.append(value)
    return results


def _common_type(dr: Any, arguments: tuple[Any, ...]) -> type:
    """The type of all together, so that a literal cannot pin the precision of an intermediate."""
    try:
        return type(dr.detach(sum(value * 0.0 for value in arguments)))
    except (RuntimeError, TypeError) as error:  # what Dr.Jit raises costs nothing where it does not
        arrays = [value for value in arguments if dr.is_array_v(value)]
        raise input_error(
            f"Dr.Jit arrays of types {', '.join(type(value).__name__ for value in arrays)} "
            f"and shapes {', '.join(str(dr.shape(value)) for value in arrays)}",
            "arrays of one backend whose shapes broadcast",
            "Give each array one entry, or as many as the others have.",
        ) from error

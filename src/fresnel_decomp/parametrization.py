"""Changes of variables between indices of refraction and the artists' parameters.

Every function takes Python floats, NumPy arrays or Dr.Jit arrays, broadcasts, and returns the same
kind. Scalars out of range raise `InputError`; array entries out of range give NaN.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ._arguments import floating_type, one_kind, plain_numbers, real_arrays, without_axes
from ._array import NumPyOps, is_drjit, ops_for
from ._check import input_error
from .fresnel import conductor

__all__ = ["F82_COSINE", "f0_from_ior", "f82_from_ior", "gulbrandsen_to_ior", "ior_to_gulbrandsen"]

F82_COSINE = 1.0 / 7.0
"""The cosine, at about 82 degrees, where F82 models meet the exact curve (Hoffman 2019)."""


def f0_from_ior(eta: Any, k: Any) -> Any:
    """Reflectance at normal incidence, ((eta - 1)² + k²) / ((eta + 1)² + k²), in [0, 1).

    Examples
    --------
    >>> from fresnel_decomp import f0_from_ior
    >>> round(f0_from_ior(1.5, 0.0), 6)
    0.04
    """
    return conductor(1.0, eta, k)


def f82_from_ior(eta: Any, k: Any) -> Any:
    """Exact reflectance at cos_theta = 1/7, in [0, 1].

    Examples
    --------
    >>> from fresnel_decomp import f82_from_ior
    >>> round(f82_from_ior(0.18, 3.4), 4)
    0.9542
    """
    return conductor(F82_COSINE, eta, k)


def gulbrandsen_to_ior(r: Any, g: Any) -> tuple[Any, Any]:
    """Index of refraction from reflectivity and edge tint.

    Parameters
    ----------
    r : (...) float in [0, 1)
        Reflectance at normal incidence.
    g : (...) float in [0, 1]
        Edge tint: 1 gives the least eta with that reflectance that has |m| >= 1, 0 a dielectric.

    Returns
    -------
    eta, k : (...) float
        Gulbrandsen 2014, "Artist Friendly Metallic Fresnel", Eqs. 3-6, rearranged so that nothing
        cancels: with rho = sqrt(r), q = (1 + rho)² / (1 - r),
        k = 2 rho / (1 + r) sqrt(g (1 + (1 - g) q²)). The published form gives NaN for g near 0.

    Raises
    ------
    InputError
        For scalars outside the ranges above.

    Examples
    --------
    >>> from fresnel_decomp import gulbrandsen_to_ior
    >>> eta, k = gulbrandsen_to_ior(0.04, 0.0)
    >>> round(eta, 6), k
    (1.5, 0.0)
    """
    _check_scalar("r", r, below_one=True)
    _check_scalar("g", g)
    ops = ops_for(r, g)
    r, g, plain = _prepared(ops, ("r", "g"), r, g)
    valid = (r >= 0.0) & (r < 1.0) & (g >= 0.0) & (g <= 1.0)
    r, g = ops.select(valid, r, 0.0), ops.select(valid, g, 0.0)
    rho = ops.sqrt(r)
    q = (1.0 + rho) * (1.0 + rho) / (1.0 - r)
    eta = g * (1.0 - r) / (1.0 + r) + (1.0 - g) * q
    k = 2.0 * rho / (1.0 + r) * ops.sqrt(g * (1.0 + (1.0 - g) * q * q))
    return without_axes(ops.select(valid, eta, np.nan), plain), without_axes(
        ops.select(valid, k, np.nan), plain
    )


def ior_to_gulbrandsen(eta: Any, k: Any) -> tuple[Any, Any]:
    """Reflectivity and edge tint of an index of refraction; the inverse of `gulbrandsen_to_ior`.

    Parameters
    ----------
    eta, k : (...) float, eta > 0, k >= 0

    Returns
    -------
    r : (...) float in [0, 1)
    g : (...) float >= 0
        Above 1 where |eta + i k| < 1: such indices have no counterpart in [0, 1]. For m = 1
        every g gives the same curve; 0 is returned. As r nears 1 the rounding of r costs eta its
        digits, about one for each digit of 1 - r.

    Raises
    ------
    InputError
        For scalars outside the ranges above.

    Examples
    --------
    >>> from fresnel_decomp import ior_to_gulbrandsen
    >>> [round(value, 4) for value in ior_to_gulbrandsen(0.18, 3.4)]
    [0.9444, 0.9978]
    """
    r = f0_from_ior(eta, k)  # checks the ranges
    ops = ops_for(eta, k)
    eta, k, plain = _prepared(ops, ("eta", "k"), eta, k)
    M, Y = eta * eta + k * k, 2.0 * eta * k
    U = (eta - 1.0) * (eta + 1.0) - k * k
    S = ops.sqrt(U * U + Y * Y)
    above = ops.select(U > 0.0, S + U, 1.0)
    S_less_U = ops.select(U > 0.0, Y * Y / above, S - U)
    matched = S == 0.0
    g = S_less_U * (M + 1.0) / (ops.select(matched, 1.0, S) * (S + M + 1.0))
    return r, without_axes(ops.select(matched, 0.0, g) + 0.0 * r, plain)


def _check_scalar(name: str, value: Any, below_one: bool = False) -> None:
    if is_drjit(value) or np.ndim(value) != 0:
        return
    number = float(value)
    if not (0.0 <= number <= 1.0) or (below_one and number == 1.0):
        raise input_error(
            f"{name}={number:g}",
            f"a number in [0, 1{')' if below_one else ']'}",
            "A reflectivity of 1 has no finite index of refraction; use a value just below it."
            if number == 1.0
            else "Reflectivity and edge tint are fractions.",
        )


def _prepared(ops: Any, names: tuple[str, str], a: Any, b: Any) -> tuple[Any, Any, bool]:
    """Arguments as arrays of one type; True if both were plain Python numbers."""
    if not isinstance(ops, NumPyOps):
        a, b = one_kind(a, b)
        return a + 0.0 * b, b + 0.0 * a, False
    plain = plain_numbers(a, b)
    result = floating_type(a, b)
    a, b = real_arrays(**dict(zip(names, (a, b), strict=True)))
    return a.astype(result), b.astype(result), plain

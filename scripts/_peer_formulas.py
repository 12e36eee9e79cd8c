"""Fresnel formulas in common use, as equations in our notation, to be compared with ours.

Each one is evaluated as its source evaluates it: same intermediate quantities, same clamps, same
special cases; no code was copied. c is the cosine of incidence, m = eta + i k, s² = 1 - c².
Everything takes and returns Dr.Jit arrays, so that Dr.Jit can differentiate it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import fresnel_decomp

Outputs = dict[str, Any]


@dataclass(frozen=True)
class Formula:
    """One formula in one precision.

    Attributes
    ----------
    name : str
    source : str
        Where it is from.
    single : bool
        float32 in and out, else float64.
    run : callable
        (c, eta, k) -> {"R": ...}, and "R_s", "R_p", "T", "T_s", "T_p" where it gives them.
    absorbing : bool
        False if it takes no k: such a formula is only asked about k = 0.
    numpy : bool
        Takes NumPy arrays instead of Dr.Jit arrays.
    """

    name: str
    source: str
    single: bool
    run: Callable[[Any, Any, Any], Outputs]
    absorbing: bool = True
    numpy: bool = False


# --- ours ----------------------------------------------------------------------------------------


def ours(precision: str) -> Callable[[Any, Any, Any], Outputs]:
    def run(c: Any, eta: Any, k: Any) -> Outputs:
        options: Any = {"precision": precision}
        R_s, R_p, T_s, T_p = fresnel_decomp.reflectance_components(c, eta, k, **options)
        return {
            "R": fresnel_decomp.conductor(c, eta, k, **options),
            "T": fresnel_decomp.transmittance(c, eta, k, **options),
            "R_s": R_s,
            "R_p": R_p,
            "T_s": T_s,
            "T_p": T_p,
        }

    return run


# --- Mitsuba 3, called ---------------------------------------------------------------------------


def mitsuba_conductor(c: Any, eta: Any, k: Any) -> Outputs:
    import mitsuba as mi

    return {"R": _each(lambda c, eta, k: mi.fresnel_conductor(c, mi.Complex2f(eta, k)), c, eta, k)}


def mitsuba_polarized(c: Any, eta: Any, k: Any) -> Outputs:
    import drjit as dr
    import mitsuba as mi

    def of(index: int) -> Any:
        return _each(
            lambda c, eta, k: dr.squared_norm(mi.fresnel_polarized(c, mi.Complex2f(eta, k))[index]),
            c,
            eta,
            k,
        )

    R_s, R_p = of(0), of(1)
    return {"R": 0.5 * (R_s + R_p), "R_s": R_s, "R_p": R_p}


def mitsuba_dielectric(c: Any, eta: Any, k: Any) -> Outputs:
    import mitsuba as mi

    return {"R": _each(lambda c, eta, k: mi.fresnel(c, eta)[0], c, eta, k)}


def _each(function: Callable[..., Any], *arguments: Any) -> Any:
    """Mitsuba's scalar variants take one number at a time, the others arrays."""
    import mitsuba as mi

    if not mi.variant().startswith("scalar"):
        return function(*arguments)
    kind = type(arguments[0])
    columns = (np.array(argument).tolist() for argument in arguments)
    return kind([function(*row) for row in zip(*columns, strict=True)])


# --- the published notebook of the decomposition --------------------------------------------------


def notebook(c: Any, eta: Any, k: Any) -> Outputs:
    """Belcour, Bati and Barla 2020, the module beside their notebook.

    c is raised to 1e-8. Where k = 0, with z = 1 - s²/eta² and t = sqrt(z), R_s = R_p = 1 if z < 0,
    else R_s = ((c - eta t)/(c + eta t))², R_p = ((t - eta c)/(t + eta c))². Where k > 0, the
    equations of `quotients` with a = 1 wherever the radicand is not positive.
    """
    import drjit as dr

    c = dr.maximum(c, 1e-8)
    s2 = 1.0 - c * c
    z = 1.0 - s2 / (eta * eta)
    t = dr.sqrt(dr.select(z < 0.0, 1.0, z))
    R_s = dr.square((c - eta * t) / (c + eta * t))
    R_p = dr.square((t - eta * c) / (t + eta * c))
    real = dr.select(z < 0.0, 1.0, 0.5 * (R_s + R_p))
    transparent = k == 0.0
    absorbing = quotients(
        c,
        eta,
        dr.select(transparent, 1.0, k),
        lambda radicand: dr.sqrt(dr.select(radicand > 0.0, radicand, 1.0)),
    )
    return {"R": dr.select(transparent, real, absorbing)}


def quotients(c: Any, eta: Any, k: Any, root: Callable[[Any], Any]) -> Any:
    """Möller, *Optics*, 1988; Lagarde, "Memo on Fresnel equations", 2013.

    With t0 = eta² - k² - s², W = sqrt(t0² + 4 eta² k²) and a = sqrt((W + t0)/2):
    R_s = (W + c² - 2ac)/(W + c² + 2ac), R_p = R_s (c²W + s⁴ - 2ac s²)/(c²W + s⁴ + 2ac s²).
    """
    import drjit as dr

    c2 = c * c
    s2 = 1.0 - c2
    eta2, k2 = eta * eta, k * k
    t0 = eta2 - k2 - s2
    W = dr.sqrt(t0 * t0 + 4.0 * eta2 * k2)
    t1, t2 = W + c2, 2.0 * root(0.5 * (W + t0)) * c
    R_s = (t1 - t2) / (t1 + t2)
    t3, t4 = c2 * W + s2 * s2, t2 * s2
    R_p = R_s * (t3 - t4) / (t3 + t4)
    return 0.5 * (R_s + R_p)


# --- MaterialX -----------------------------------------------------------------------------------


def materialx_conductor(c: Any, eta: Any, k: Any) -> Outputs:
    """MaterialX, conductor of its shader library: `quotients`, the radicand raised to 0."""
    import drjit as dr

    return {"R": quotients(c, eta, k, lambda radicand: dr.sqrt(dr.maximum(radicand, 0.0)))}


def materialx_dielectric(c: Any, eta: Any, k: Any) -> Outputs:
    """MaterialX, dielectric of its shader library; Cook and Torrance 1982.

    With g² = eta² + c² - 1: 1 if g² < 0, else
    ½ ((g - c)/(g + c))² (1 + ((c(g + c) - 1)/(c(g - c) + 1))²).
    """
    import drjit as dr

    g2 = eta * eta + c * c - 1.0
    g = dr.sqrt(dr.select(g2 < 0.0, 1.0, g2))
    first = dr.square((g - c) / (g + c))
    second = dr.square(((g + c) * c - 1.0) / ((g - c) * c + 1.0))
    return {"R": dr.select(g2 < 0.0, 1.0, 0.5 * first * (1.0 + second))}


# --- pbrt ----------------------------------------------------------------------------------------


def pbrt_dielectric(c: Any, eta: Any, k: Any) -> Outputs:
    """Pharr, Jakob and Humphreys, *Physically Based Rendering*, 4th ed., 9.3.4.

    z = s²/eta², 1 if z >= 1; c_t = sqrt(1 - z);
    R = (((eta c - c_t)/(eta c + c_t))² + ((c - eta c_t)/(c + eta c_t))²)/2.
    """
    import drjit as dr

    z = (1.0 - c * c) / (eta * eta)
    reflects_all = z >= 1.0
    c_t = dr.sqrt(dr.select(reflects_all, 1.0, 1.0 - z))
    R_p = dr.square((eta * c - c_t) / (eta * c + c_t))
    R_s = dr.square((c - eta * c_t) / (c + eta * c_t))
    return {"R": dr.select(reflects_all, 1.0, 0.5 * (R_p + R_s))}


def pbrt_conductor(c: Any, eta: Any, k: Any) -> Outputs:
    """The same book, 9.3.6: the same equations with complex m, c_t and amplitudes."""
    s2 = 1.0 - c * c
    m = (eta, k)
    z = _quotient((s2, 0.0 * s2), _product(m, m))
    c_t = _root((1.0 - z[0], -z[1]))
    mc = (eta * c, k * c)
    mc_t = _product(m, c_t)
    r_p = _quotient((mc[0] - c_t[0], mc[1] - c_t[1]), (mc[0] + c_t[0], mc[1] + c_t[1]))
    r_s = _quotient((c - mc_t[0], -mc_t[1]), (c + mc_t[0], mc_t[1]))
    R_s = r_s[0] * r_s[0] + r_s[1] * r_s[1]
    R_p = r_p[0] * r_p[0] + r_p[1] * r_p[1]
    return {"R": 0.5 * (R_p + R_s), "R_s": R_s, "R_p": R_p}


def _product(a: Any, b: Any) -> tuple[Any, Any]:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _quotient(a: Any, b: Any) -> tuple[Any, Any]:
    scale = 1.0 / (b[0] * b[0] + b[1] * b[1])
    return (
        scale * (a[0] * b[0] + a[1] * b[1]),
        scale * (a[1] * b[0] - a[0] * b[1]),
    )


def _root(z: Any) -> tuple[Any, Any]:
    """Principal root from t = sqrt((|z| + |Re z|)/2) and Im z/(2t); 0 where z = 0."""
    import drjit as dr

    n = dr.sqrt(z[0] * z[0] + z[1] * z[1])
    zero = n == 0.0
    t = dr.sqrt(dr.select(zero, 1.0, 0.5 * (n + dr.abs(z[0]))))
    u = 0.5 * z[1] / t
    right = z[0] >= 0.0
    real, imaginary = dr.select(right, t, dr.abs(u)), dr.select(right, u, dr.copysign(t, z[1]))
    return dr.select(zero, 0.0, real), dr.select(zero, 0.0, imaginary)


FORMULAS = (
    Formula("ours, wide", "this package, float64 inside", True, ours("wide")),
    Formula("ours, wide, NumPy", "the same on NumPy arrays", True, ours("wide"), numpy=True),
    Formula("ours, native", "this package, float32 inside", True, ours("native")),
    Formula("ours, float64", "this package", False, ours("wide")),
    Formula("Mitsuba conductor", "mitsuba.fresnel_conductor", True, mitsuba_conductor),
    Formula("Mitsuba polarized", "mitsuba.fresnel_polarized", True, mitsuba_polarized),
    Formula("Mitsuba dielectric", "mitsuba.fresnel", True, mitsuba_dielectric, absorbing=False),
    Formula("pbrt FrComplex", "pbrt-v4", True, pbrt_conductor),
    Formula("pbrt FrDielectric", "pbrt-v4", True, pbrt_dielectric, absorbing=False),
    Formula("MaterialX conductor", "MaterialX", True, materialx_conductor),
    Formula("MaterialX dielectric", "MaterialX", True, materialx_dielectric, absorbing=False),
    Formula("notebook", "Belcour et al. 2020", True, notebook),
    Formula("notebook, float64", "Belcour et al. 2020", False, notebook),
    Formula("pbrt FrComplex, float64", "pbrt-v4", False, pbrt_conductor),
)

r"""Microfacet terms that hold at their limits: GGX and Beckmann, isotropic, Smith's model.

Everything is built from the projected area of the visible normals (Heitz 2014, "Understanding the
Masking-Shadowing Function", Eq. 22 and 43),

    sigma(c) = c (1 + Lambda(c)),

because it is a sum of terms that are not negative and is finite where Lambda is not, at c = 0:

    GGX       sigma = (c + sqrt(c² + a² s²)) / 2
    Beckmann  sigma = c (1 + erf x)/2 + a s exp(-x²) / (2 sqrt(pi)),   x = c / (a s)

with s² = 1 - c² and the roughness a = alpha. Masking is G1 = c / sigma, and masking-shadowing

    separable   G2 = G1(i) G1(o)
    correlated  G2 = G1(o) c_i / (c_i + G1(o) (sigma_i - c_i))           (height-correlated)

Directions are triples (x, y, z) in a frame whose z axis is the surface normal; `alpha` is the
square of what artists call roughness: 0, or large enough that its square does not underflow (1e-18
in float32). Arguments are Python floats, NumPy arrays or Dr.Jit arrays. Formulas as in a shader:
nothing is checked or clamped but what is said.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Literal, TypeVar, cast

import numpy as np

from ._arguments import floating_type, one_kind, plain_numbers, without_axes
from ._array import Ops, is_drjit, ops_for
from ._check import choose
from ._distributions import SHAPES, Shape, named_shape
from ._vectors import Vector

__all__ = [
    "DISTRIBUTIONS",
    "SMITH",
    "half_vector",
    "masking",
    "masking_shadowing",
    "ndf",
    "projected_area",
    "reflect",
    "sample_visible_normal",
    "shadowing",
    "smith_lambda",
]

Distribution = Literal["ggx", "beckmann"]
Smith = Literal["separable", "correlated"]

SMITH = ("separable", "correlated")
"""How masking and shadowing combine: independently, as in Mitsuba and in the talk, or depending on
the height of the microfacet, as in Filament, Unity and three.js."""

DISTRIBUTIONS = tuple(SHAPES)
"""Names of the distributions."""

_Function = TypeVar("_Function", bound=Callable[..., Any])


def _same_kind(function: _Function) -> _Function:
    """Python floats for Python floats, and NumPy scalars for NumPy's."""

    @functools.wraps(function)
    def wrapped(*arguments: Any, **options: Any) -> Any:
        result = function(*arguments, **options)
        given = [v for a in arguments for v in (a if isinstance(a, tuple) else (a,))]
        return _without_axes(result, plain_numbers(*given))

    return cast(_Function, wrapped)


def _without_axes(result: Any, plain: bool) -> Any:
    if isinstance(result, tuple):
        return tuple(_without_axes(value, plain) for value in result)
    return without_axes(result, plain)


@_same_kind
def ndf(normal: Vector, alpha: Any, distribution: Distribution = "ggx") -> Any:
    """Density of microfacet normals per solid angle: its integral times the cosine is 1.

    Parameters
    ----------
    normal : triple of (...) float
        Unit vector. A triple and not a cosine, because near the normal the cosine has lost the
        angle: in float32 all slopes below 2e-4 have cosine 1.
    alpha : (...) float > 0
    distribution : {"ggx", "beckmann"}

    Returns
    -------
    (...) float >= 0; 0 below the horizon

    Examples
    --------
    >>> from fresnel_decomp.microfacet import ndf
    >>> round(ndf((0.0, 0.0, 1.0), 0.5), 6)  # 1 / (pi alpha²)
    1.27324
    """
    shape = named_shape(distribution)
    ops, (x, y, z, alpha) = _arguments(*normal, alpha)
    return ops.select(z > 0.0, shape.density(ops, x * x + y * y, z, alpha), 0.0)


@_same_kind
def projected_area(cos_theta: Any, alpha: Any, distribution: Distribution = "ggx") -> Any:
    """Area of the visible microfacets, seen from a direction, over that of the surface.

    Parameters
    ----------
    cos_theta : (...) float in [0, 1]
    alpha : (...) float >= 0
    distribution : {"ggx", "beckmann"}

    Returns
    -------
    (...) float in [cos_theta, 1); cos_theta at alpha = 0. Finite derivatives for alpha > 0.
    """
    shape = named_shape(distribution)
    ops, (cos_theta, alpha) = _arguments(cos_theta, alpha)
    return shape.projected_area(ops, cos_theta, alpha)


@_same_kind
def smith_lambda(cos_theta: Any, alpha: Any, distribution: Distribution = "ggx") -> Any:
    """Smith's Lambda: masked over visible area. Infinite at cos_theta = 0; see `projected_area`.

    Parameters
    ----------
    cos_theta : (...) float in (0, 1]
    alpha : (...) float >= 0
    """
    shape = named_shape(distribution)
    ops, (cos_theta, alpha) = _arguments(cos_theta, alpha)
    return shape.hidden_area(ops, cos_theta, alpha) / cos_theta


@_same_kind
def masking(cos_theta: Any, alpha: Any, distribution: Distribution = "ggx") -> Any:
    """Smith's G1, the visible share of microfacets that face a direction.

    Parameters
    ----------
    cos_theta : (...) float in [0, 1]
    alpha : (...) float >= 0

    Returns
    -------
    (...) float in [0, 1]; 0 at cos_theta = 0 unless alpha = 0, where it is 1

    Examples
    --------
    >>> from fresnel_decomp.microfacet import masking
    >>> masking(1.0, 0.5), masking(0.0, 0.5), masking(0.0, 0.0)
    (1.0, 0.0, 1.0)
    """
    shape = named_shape(distribution)
    ops, (cos_theta, alpha) = _arguments(cos_theta, alpha)
    area = shape.projected_area(ops, cos_theta, alpha)
    flat = area == 0.0
    return ops.select(flat, 1.0, cos_theta / ops.select(flat, 1.0, area))


@_same_kind
def masking_shadowing(
    cos_theta_i: Any,
    cos_theta_o: Any,
    alpha: Any,
    smith: Smith = "separable",
    distribution: Distribution = "ggx",
) -> Any:
    """G2, the share of microfacets that both directions see.

    Parameters
    ----------
    cos_theta_i, cos_theta_o : (...) float in [0, 1]
    alpha : (...) float >= 0
    smith : {"separable", "correlated"}
        See `SMITH`.

    Returns
    -------
    (...) float in [0, 1], symmetric in the directions

    Examples
    --------
    >>> from fresnel_decomp.microfacet import masking_shadowing
    >>> [round(masking_shadowing(0.2, 0.2, 0.5, smith), 4) for smith in SMITH]
    [0.3009, 0.378]
    """
    if choose("smith", smith, SMITH) == "separable":
        return masking(cos_theta_i, alpha, distribution) * masking(cos_theta_o, alpha, distribution)
    shape = named_shape(distribution)
    ops, (cos_theta_i, cos_theta_o, alpha) = _arguments(cos_theta_i, cos_theta_o, alpha)
    first = masking(cos_theta_o, alpha, distribution)
    return first * shadowing_ratio(ops, shape, "correlated", cos_theta_i, alpha, first)


@_same_kind
def shadowing(
    cos_theta_i: Any,
    cos_theta_o: Any,
    alpha: Any,
    smith: Smith = "separable",
    distribution: Distribution = "ggx",
) -> Any:
    """G2 / G1(o), the share of what `o` sees that `i` sees too; finite at cos_theta_o = 0.

    The weight of a sample of `sample_visible_normal`. Parameters as for `masking_shadowing`.

    Returns
    -------
    (...) float in [0, 1]
    """
    choose("smith", smith, SMITH)
    shape = named_shape(distribution)
    ops, (cos_theta_i, cos_theta_o, alpha) = _arguments(cos_theta_i, cos_theta_o, alpha)
    unmasked = masking(cos_theta_o, alpha, distribution)
    return shadowing_ratio(ops, shape, smith, cos_theta_i, alpha, unmasked)


@_same_kind
def half_vector(wi: Vector, wo: Vector) -> tuple[Vector, Any]:
    """The microfacet normal that reflects `wi` to `wo`, and the cosine between it and either.

    The cosine is half the length of wi + wo, which is right where a dot product is not: it is
    exactly 1 for retroreflection, wi = wo, and keeps its digits when both directions graze.

    Parameters
    ----------
    wi, wo : triples of (...) float, unit vectors

    Returns
    -------
    normal : triple of (...) float; (0, 0, 1) for opposite directions
    cos_theta : (...) float in [0, 1]
    """
    ops, values = _arguments(*wi, *wo)
    x, y, z = (a + b for a, b in zip(values[:3], values[3:], strict=True))
    square = x * x + y * y + z * z
    opposite = square == 0.0
    length = ops.sqrt(ops.select(opposite, 1.0, square))
    zero = ops.select(opposite, 0.0, 1.0) / length
    normal = (x * zero, y * zero, ops.select(opposite, 1.0, z / length))
    return normal, ops.minimum(ops.select(opposite, 0.0, 0.5 * length), 1.0)


@_same_kind
def reflect(wo: Vector, normal: Vector) -> Vector:
    """`wo` mirrored about a unit normal."""
    _, values = _arguments(*wo, *normal)
    w, h = values[:3], values[3:]
    twice = 2.0 * (w[0] * h[0] + w[1] * h[1] + w[2] * h[2])
    return twice * h[0] - w[0], twice * h[1] - w[1], twice * h[2] - w[2]


@_same_kind
def sample_visible_normal(
    wo: Vector, alpha: Any, u1: Any, u2: Any, distribution: Distribution = "ggx"
) -> Vector:
    """A microfacet normal, distributed as the area that `wo` sees of it.

    GGX by the spherical cap of Dupuy and Benyoub 2023, "Sampling Visible GGX Normals with Spherical
    Caps"; Beckmann by inverting the distribution of slopes in the plane of incidence, as in
    Jakob 2014, "An Improved Visible Normal Sampling Routine for the Beckmann Distribution".

    Parameters
    ----------
    wo : triple of (...) float, unit vector with z >= 0
    alpha : (...) float > 0
    u1, u2 : (...) float in [0, 1)
        Uniform random numbers.

    Returns
    -------
    triple of (...) float: a unit vector with positive cosine to `wo`. In float32, one GGX normal in
    ten million cancels to rounding errors, with u2 next to 1 and u1 next to 1/2, and may have any.
    """
    shape = named_shape(distribution)
    ops, (x, y, z, alpha, u1, u2) = _arguments(*wo, alpha, u1, u2)
    # the frame in which the surface has roughness 1
    x, y = alpha * x, alpha * y
    length = ops.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    x, y, z = shape.sample_unit(ops, x, y, z, u1, u2)
    x, y = alpha * x, alpha * y
    length = ops.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


def shadowing_ratio(
    ops: Ops, shape: Shape, smith: str, c_i: Any, alpha: Any, masking_o: Any
) -> Any:
    """`shadowing` for arrays of one kind and known G1(o)."""
    if smith == "separable":
        total = shape.projected_area(ops, c_i, alpha)
    else:
        total = c_i + masking_o * shape.hidden_area(ops, c_i, alpha)
    dark = total == 0.0
    lit = ops.select(dark & (alpha == 0.0), 1.0, c_i)
    return lit / ops.select(dark, 1.0, total)


def _arguments(*values: Any) -> tuple[Ops, tuple[Any, ...]]:
    """The operations for these values, and the values as arrays of one kind."""
    if is_drjit(*values):
        return ops_for(*values), one_kind(*values)
    dtype = floating_type(*values)
    return ops_for(), tuple(np.asarray(value, dtype)[()] for value in values)

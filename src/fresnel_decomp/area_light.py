r"""Light from rectangles and disks, reflected by rough surfaces in closed form.

The reflection of a source of uniform radiance L is L ∫ F f dw over the directions to it, with the
lobe f of a white surface. Three steps make it a formula:

1. *The lobe* becomes a linearly transformed cosine, b̄_0 D (`ltc`), whose integral over a rectangle
   or a disk is exact, clipped by both horizons (`irradiance`). Call it the share of the lobe that
   the light fills.
2. *The Fresnel term* is taken out of the integral. Averaged over the whole lobe it makes the
   amplitude F̄ = sum_i c_i b̄_i, one fetch from an `AlbedoTable`:

       Lo = L F̄ share.

3. A light does not fill the lobe evenly, and F grows towards grazing angles. For metals that is
   little; for dielectrics it is not. The light's mean direction through the lobe comes with the
   share, as the direction of the vector irradiance, and with it a representative half vector h:

       "plain"       Lo = L b̄_0 F(v·h) share
       "normalised"  Lo = L F̄ F(v·h) / F(v·h_all) share
       "blended"     Lo = L (share F̄ + (1 - share) b̄_0 F(v·h)) share

   "plain" is right for small lights, and so on the average over where they may be, since F̄ is the
   integral of F over the lobe. For a light all around it is not: F of the mean is not the mean of
   F. "normalised" is right there, with h_all for the light all around, and off by one factor
   everywhere else. "blended" is right at both ends.

What each step costs is measured in docs/area_lights.md. Sources are not occluded, and shine to one
side, or to both.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ._arguments import floating_type, one_kind
from ._array import Ops, is_drjit, ops_for
from ._check import choose, input_error
from ._vectors import Vector, as_triple, cross, dot, of_kind, perpendicular
from .irradiance import ellipse_irradiance, polygon_irradiance
from .ltc import Lobe, LobeTable
from .microfacet import half_vector
from .split_albedo import SplitAlbedo
from .table import AlbedoTable

__all__ = ["CORRECTIONS", "AreaLight", "AreaMaterial", "Lit", "lit_share", "shade_area_light"]

Correction = Literal["none", "plain", "normalised", "blended"]

CORRECTIONS = ("none", "plain", "normalised", "blended")
"""What is done about the Fresnel term at the light's half vector."""

_SHAPES = ("rectangle", "disk")
_NEEDED = {
    "none": (),
    "plain": ("fresnel", "white"),
    "normalised": ("fresnel",),
    "blended": ("fresnel", "white"),
}
_HEAD_ON = 1e-8  # squared sine of the view angle, below which lobes have no direction to be turned


@dataclass(frozen=True, eq=False)
class AreaLight:
    """A rectangle, a parallelogram, a disk or an ellipse of uniform radiance.

    Its points are centre + x u + y v: with |x|, |y| ≤ 1 for a rectangle, with x² + y² ≤ 1 for a
    disk, as Mitsuba's shapes of these names have them before `to_world`.

    Attributes
    ----------
    shape : {"rectangle", "disk"}
    centre, u, v : (3,) float, or three Dr.Jit arrays
    radiance : float, or three of them
        Linear sRGB.
    two_sided : bool
        Otherwise it shines where u × v points to.

    Raises
    ------
    InputError
        For other shapes, and for vectors without three components or, unless they are Dr.Jit's,
        that are not finite.

    Examples
    --------
    >>> ceiling = AreaLight("rectangle", [0.0, 2.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.5])
    >>> ceiling.normal  # down
    (0.0, -0.25, 0.0)
    """

    shape: Literal["rectangle", "disk"]
    centre: Any
    u: Any
    v: Any
    radiance: Any = 1.0
    two_sided: bool = False

    def __post_init__(self) -> None:
        choose("shape", self.shape, _SHAPES)
        for name in ("centre", "u", "v"):
            vector = as_triple(getattr(self, name), name)
            object.__setattr__(self, name, vector)
            if not is_drjit(*vector) and not all(np.isfinite(part).all() for part in vector):
                raise input_error(
                    f"{name}={[np.asarray(part).tolist() for part in vector]}",
                    "finite numbers",
                    "A light's vectors are those to its centre and along its two half axes.",
                )
        radiance = self.radiance
        if not is_drjit(radiance) and np.ndim(radiance) == 0:
            radiance = (radiance,) * 3
        elif not is_drjit(radiance) and not is_drjit(*radiance) and np.ndim(radiance) != 1:
            raise input_error(
                f"radiance of shape {np.shape(radiance)}",
                "a number, or three of them",
                "A light has one radiance all over; shade another light for another radiance.",
            )
        object.__setattr__(self, "radiance", as_triple(radiance, "radiance"))

    @property
    def normal(self) -> Vector:
        """u × v, of any length: where it shines to."""
        return cross(self.u, self.v)


@dataclass(frozen=True, eq=False)
class AreaMaterial:
    """What `shade_area_light` needs of a material.

    Attributes
    ----------
    albedo : callable (mu, alpha) to three channels
        F̄; for `AreaMaterial.from_table` sum_i c_i b̄_i.
    fresnel : callable (cos_theta) to three channels
        F, for corrections.
    white : callable (mu, alpha) to one number
        b̄_0, the albedo of a white surface, for the plain and the blended correction.
    """

    albedo: Callable[[Any, Any], Any]
    fresnel: Callable[[Any], Any] | None = None
    white: Callable[[Any, Any], Any] | None = None

    @classmethod
    def from_table(cls, table: AlbedoTable, coefficients: Any) -> AreaMaterial:
        """The decomposition: all three from a table whose first function is b_0 = 1.

        F is what the table has for a smooth surface, its row of alpha = 0.

        Parameters
        ----------
        table : AlbedoTable
            Of a `Basis`; separable or correlated as the lobes are.
        coefficients : (3, n) float, or three sequences of n Dr.Jit arrays

        Raises
        ------
        InputError
            If they are not for three channels with as many terms as the table has.

        Examples
        --------
        >>> from fresnel_decomp import AlbedoTable, load_basis
        >>> basis = load_basis()
        >>> table = AlbedoTable.bake(basis, size=16)
        >>> grey = AreaMaterial.from_table(table, [basis.coefficients(1.5, 0.0)] * 3)
        >>> bool((abs(grey.fresnel(1.0) - 0.04) < 1e-3).all())
        True
        """
        albedo = SplitAlbedo(table, coefficients)

        def fresnel(cos_theta: Any) -> Any:
            return albedo(cos_theta, 0.0)

        def white(mu: Any, alpha: Any) -> Any:
            found = table.lookup(mu, alpha)
            return found[0] if is_drjit(mu, alpha) else found[..., 0]

        return cls(albedo, fresnel, white)


class Lit(NamedTuple):
    """What a light does to a lobe."""

    share: Any
    """(...) float in [0, 1]: the part of the lobe that the light fills."""
    cos_half: Any
    """(...) float in [0, 1]: v·h of the mean direction to the light; any where share is 0."""
    cos_half_all: Any
    """v·h for light from everywhere."""
    mu: Any
    """n·v, clamped to [0, 1]."""
    above: Any
    """Whether the viewer is above the surface."""


def lit_share(
    light: AreaLight, lobes: LobeTable, position: Any, normal: Any, view: Any, alpha: Any
) -> Lit:
    """How much of the lobe of a surface point a light fills, and from where.

    Parameters
    ----------
    light : AreaLight
    lobes : LobeTable
    position, normal, view : (..., 3) float arrays, or three Dr.Jit or NumPy arrays in a tuple each
        Of the surface. The last two are unit vectors; view points to the viewer.
    alpha : (...) float in [0, 1]

    Returns
    -------
    Lit

    Raises
    ------
    InputError
        For vectors without three components, and NumPy arrays beside Dr.Jit's.
    """
    position, normal, view = (
        as_triple(value, name)
        for name, value in (("position", position), ("normal", normal), ("view", view))
    )
    numbers = one_kind(*position, *normal, *view, *light.centre, *light.u, *light.v, alpha)
    ops = ops_for(*numbers)
    if is_drjit(*numbers):
        kind = type(sum(0.0 * number for number in numbers if is_drjit(number)))
        numbers = tuple(of_kind(kind, number) for number in numbers)
    else:
        dtype = floating_type(*numbers)
        numbers = tuple(np.asarray(number, dtype)[()] for number in numbers)
    position, normal, view, centre, u, v = (numbers[i : i + 3] for i in range(0, 18, 3))
    alpha = numbers[18]
    mu = dot(normal, view)
    above = ~(mu <= 0.0)  # NaN passes
    mu = ops.select(mu < 0.0, 0.0, ops.select(mu > 1.0, 1.0, mu))
    frame = _frame(ops, normal, view)
    centre = tuple(c - p for c, p in zip(centre, position, strict=True))
    centre, u, v = (_into(frame, vector) for vector in (centre, u, v))
    lobe = lobes.lobe(mu, alpha)
    # counter-clockwise as the point sees it
    faces = dot(cross(u, v), centre) < 0.0
    turn = ops.select(faces, -1.0, 1.0)
    v = tuple(turn * c for c in v)
    share, direction = _through(ops, light.shape, lobe, centre, u, v)
    if not light.two_sided:
        share = ops.select(faces, share, 0.0)
    sine = ops.sqrt(ops.maximum((1.0 - mu) * (1.0 + mu), 1e-12))
    local_view = (sine, 0.0 * mu, mu)
    everywhere = lobe.horizon
    everywhere = _direction(ops, lobe, (everywhere[0], everywhere[1], everywhere[2] + 1.0))
    cos_half = _between(local_view, direction)
    return Lit(share, cos_half, _between(local_view, everywhere), mu, above)


def _through(
    ops: Ops, shape: str, lobe: Lobe, centre: Vector, u: Vector, v: Vector
) -> tuple[Any, Vector]:
    """The share of the lobe, and the mean direction, for what is turned the right way."""
    horizons = (lobe.horizon, (0.0 * centre[0], 0.0 * centre[0], 1.0 + 0.0 * centre[0]))
    centre, u, v = (lobe.to_cosine(vector) for vector in (centre, u, v))
    if shape == "disk":
        flow = ellipse_irradiance(centre, u, v, horizons)
    else:
        corners = [
            tuple(c + x * a + y * b for c, a, b in zip(centre, u, v, strict=True))
            for x, y in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
        ]
        flow = polygon_irradiance(corners, horizons)
    share = flow[2] / (math.pi * lobe.above)
    share = ops.select(share < 0.0, 0.0, ops.select(share > 1.0, 1.0, share))
    lit = share > 0.0
    safe = (
        ops.select(lit, flow[0], 0.0),
        ops.select(lit, flow[1], 0.0),
        ops.select(lit, flow[2], 1.0),
    )
    return share, _direction(ops, lobe, safe)


def _direction(ops: Ops, lobe: Lobe, flow: Vector) -> Vector:
    """A direction where the lobe is a cosine as one above the surface, of unit length."""
    x, y, z = lobe.from_cosine(flow)
    square = x * x + y * y + z * z
    some = square > 0.0
    scale = 1.0 / ops.sqrt(ops.select(some, square, 1.0))
    return x * scale, y * scale, ops.select(some, z * scale, 1.0)


def _between(view: Vector, direction: Vector) -> Any:
    return half_vector(view, direction)[1]


def _frame(ops: Ops, normal: Vector, view: Vector) -> tuple[Vector, Vector, Vector]:
    """Tangent, bitangent and normal; the view is in the plane of the first and the last."""
    mu = dot(normal, view)
    side = tuple(v - mu * n for v, n in zip(view, normal, strict=True))
    square = dot(side, side)
    tilted = square > _HEAD_ON
    other = perpendicular(ops, normal)
    square = ops.select(tilted, square, dot(other, other))
    scale = 1.0 / ops.sqrt(square)
    tangent = tuple(scale * ops.select(tilted, a, b) for a, b in zip(side, other, strict=True))
    return tangent, cross(normal, tangent), normal


def _into(frame: tuple[Vector, Vector, Vector], vector: Any) -> Vector:
    x, y, z = (dot(axis, vector) for axis in frame)
    return x, y, z


def shade_area_light(
    light: AreaLight,
    lobes: LobeTable,
    material: AreaMaterial,
    position: Any,
    normal: Any,
    view: Any,
    alpha: Any,
    correction: Correction = "none",
) -> Any:
    """Radiance that a surface reflects from a light to the viewer.

    Parameters
    ----------
    light : AreaLight
    lobes : LobeTable
        Such as `load_lobes()`.
    material : AreaMaterial
    position, normal, view : (..., 3) float arrays, or three Dr.Jit or NumPy arrays in a tuple each
        Of the surface. The last two are unit vectors; view points to the viewer.
    alpha : (...) float in [0, 1]
    correction : {"none", "plain", "normalised", "blended"}
        See the top of this module: without any, metals are off by a few percent, dielectrics by up
        to their own brightness.

    Returns
    -------
    (..., 3) float array, or a tuple of three Dr.Jit arrays if any argument is one: 0 where the
    viewer is below the surface. Differentiable in all numbers, the light's among them.

    Raises
    ------
    InputError
        For other corrections, ones that the material does not have the functions for, vectors
        without three components, and NumPy arrays beside Dr.Jit's.

    Examples
    --------
    >>> from fresnel_decomp import AlbedoTable, load_basis, load_material
    >>> from fresnel_decomp.ltc import load_lobes
    >>> basis = load_basis()
    >>> table = AlbedoTable.bake(basis, size=16)
    >>> gold = AreaMaterial.from_table(table, load_material("Au").rgb_coefficients(basis))
    >>> light = AreaLight("disk", [0.0, 0.0, 1.0], [0.0, 0.5, 0.0], [0.5, 0.0, 0.0], radiance=10.0)
    >>> shade_area_light(light, load_lobes(), gold, [0, 0, 0], [0, 0, 1], [0.6, 0, 0.8], 0.4).shape
    (3,)
    """
    choose("correction", correction, CORRECTIONS)
    needed = _NEEDED[correction]
    for name in needed:
        if getattr(material, name) is None:
            raise input_error(
                f"correction='{correction}' for a material without '{name}'",
                f"one with {' and '.join(needed)}",
                "AreaMaterial.from_table has them all.",
            )
    lit = lit_share(light, lobes, position, normal, view, alpha)
    fresnel: Any = material.fresnel
    white: Any = material.white
    if correction == "plain":
        factor = _scaled(fresnel(lit.cos_half), white(lit.mu, alpha))
    else:
        factor = material.albedo(lit.mu, alpha)
    if correction == "normalised":
        everywhere = fresnel(lit.cos_half_all)
        factor = _by_channel(_rescaled, factor, fresnel(lit.cos_half), everywhere)
    elif correction == "blended":
        small = _scaled(fresnel(lit.cos_half), white(lit.mu, alpha) * (1.0 - lit.share))
        factor = _by_channel(lambda a, b: a + b, _scaled(factor, lit.share), small)
    ops = ops_for(lit.share)
    amount = ops.select(lit.above, lit.share, 0.0 * lit.share)
    if isinstance(factor, tuple):
        return tuple(amount * f * c for f, c in zip(factor, light.radiance, strict=True))
    return np.asarray(amount)[..., None] * factor * np.array(light.radiance)


def _rescaled(albedo: Any, fresnel: Any, everywhere: Any) -> Any:
    """A channel that reflects nothing from everywhere reflects nothing."""
    ops = ops_for(albedo, fresnel, everywhere)
    some = everywhere != 0.0
    return ops.select(some, albedo * fresnel / ops.select(some, everywhere, 1.0), 0.0)


def _scaled(channels: Any, number: Any) -> Any:
    if isinstance(channels, tuple):
        return tuple(channel * number for channel in channels)
    return channels * np.asarray(number)[..., None]


def _by_channel(function: Callable[..., Any], *colours: Any) -> Any:
    if isinstance(colours[0], tuple):
        return tuple(function(*channels) for channels in zip(*colours, strict=True))
    return function(*colours)

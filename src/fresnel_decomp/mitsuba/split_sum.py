r"""Split-sum shading: a blurred environment times the directional albedo, per shading point.

Karis 2013, "Real Shading in Unreal Engine 4", replaces the reflection integral of environment
light by a product,

    Lo(v) ≈ L(R, alpha) Fbar(n·v, alpha),

R being v mirrored about n. `prefilter` makes L, and `split_albedo` Fbar, which is what the Fresnel
term is about.

`shade` is all there is at run time. It takes NumPy and Dr.Jit arrays and needs no renderer;
`visible_surface` and `render_split_sum` take what is seen from a Mitsuba scene.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._array import drjit_module, is_drjit
from .._check import choose, input_error, is_real, is_whole
from .._vectors import as_vectors, of_kind
from .prefilter import PrefilteredLight

if TYPE_CHECKING:
    from .light_texture import LightTexture

__all__ = [
    "SplitMaterial",
    "VisibleSurface",
    "render_split_sum",
    "shade",
    "visible_surface",
]


@dataclass(frozen=True, eq=False)
class SplitMaterial:
    """What `render_split_sum` needs of a material.

    Attributes
    ----------
    albedo : callable (mu, alpha) to three channels, such as a `SplitAlbedo`
    alpha : float in [0, 1], roughness of GGX

    Raises
    ------
    InputError
        For another roughness.
    """

    albedo: Callable[[Any, Any], Any]
    alpha: float

    def __post_init__(self) -> None:
        if not is_real(self.alpha, 0.0, 1.0):
            raise input_error(
                f"alpha={self.alpha!r}", "a number in [0, 1]", "It is the square of the perceptual."
            )


def shade(
    light: PrefilteredLight | LightTexture,
    albedo: Callable[[Any, Any], Any],
    normal: Any,
    view: Any,
    alpha: Any,
) -> Any:
    """Radiance towards the viewer by the split-sum.

    Parameters
    ----------
    light : PrefilteredLight, or LightTexture for Dr.Jit
    albedo : callable (mu, alpha) to three channels
    normal, view : (..., 3) float arrays, or three Dr.Jit arrays each, as `mi.Vector3f` has them
        Unit vectors; view points to the viewer. One of them may be three numbers beside a vector of
        Dr.Jit arrays.
    alpha : (...) float in [0, 1]
        Roughness; clamped.

    Returns
    -------
    (..., 3) float array, or a tuple of three Dr.Jit arrays if any argument is one: 0 where the
    viewer is below the surface, NaN where a vector or alpha is. Differentiable in the normal, the
    view, alpha and what the albedo depends on; in alpha also at 0, where the perceptual roughness
    has an infinite slope: there the derivative is that of the first 1e-8 of alpha.

    Raises
    ------
    InputError
        For vectors without three components, and for arrays of NumPy together with Dr.Jit's.
    """
    normal, view = as_vectors(alpha, normal=normal, view=view)
    if isinstance(normal, tuple):
        dr = drjit_module()
        assert dr is not None
        cosine = normal[0] * view[0] + normal[1] * view[1] + normal[2] * view[2]
        mirrored = [2.0 * cosine * n - v for n, v in zip(normal, view, strict=True)]
        alpha = of_kind(type(cosine), alpha)
        radiance = light.lookup(mirrored, alpha)
        # selected and not clipped: at the ends of [0, 1] derivatives pass
        mu = dr.select(cosine < 0.0, 0.0, dr.select(cosine > 1.0, 1.0, cosine))
        # not `cosine > 0`, which would be false for NaN
        return tuple(
            dr.select(cosine <= 0.0, 0.0, a * b)
            for a, b in zip(radiance, albedo(mu, alpha), strict=True)
        )
    cosine = np.sum(normal * view, axis=-1)
    mirrored = 2.0 * cosine[..., None] * normal - view
    product = light.lookup(mirrored, alpha) * albedo(np.clip(cosine, 0.0, 1.0), alpha)
    return np.where(cosine[..., None] <= 0.0, 0.0, product)


# --- what a scene shows --------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class VisibleSurface:
    """What the camera of a scene sees first, for every sample of every pixel.

    Samples of a pixel are neighbours. Arrays are Dr.Jit's in vectorised variants, else NumPy's,
    with (n, 3) for vectors.

    Attributes
    ----------
    size : (width, height)
    spp : int
    normal, view : vectors
        Shading normal, and direction to the camera.
    shape : integers
        Index into `names`, -1 where nothing is seen.
    names : tuple of str
        Of the shapes of the scene.
    position : vectors
        Of the surface; anything where nothing is seen.
    """

    size: tuple[int, int]
    spp: int
    normal: Any
    view: Any
    shape: Any
    names: tuple[str, ...]
    position: Any

    def coverage(self) -> np.ndarray:
        """(height, width) float64: the share of each pixel's samples that see a shape."""
        width, height = self.size
        seen = np.array(self.shape) >= 0
        return seen.reshape(height, width, self.spp).mean(axis=2)


def visible_surface(scene: Any, spp: int = 16, seed: int = 0) -> VisibleSurface:
    """Trace the camera rays of a scene, jittered on a grid in every pixel.

    Parameters
    ----------
    scene : mi.Scene
        Its first sensor is used.
    spp : int, a square number
    seed : int, ≥ 0

    Returns
    -------
    VisibleSurface

    Raises
    ------
    InputError
        For other numbers, and for a scene without a sensor.
    """
    import mitsuba as mi

    side = math.isqrt(spp) if is_whole(spp, 1) else 0
    if side == 0 or side * side != spp:
        raise input_error(f"spp={spp!r}", "a square number ≥ 1", "16 gives smooth edges.")
    if not is_whole(seed, 0):
        raise input_error(f"seed={seed!r}", "an integer ≥ 0", "Any will do.")
    sensors = scene.sensors()
    if not sensors:
        raise input_error(
            "a scene without a sensor",
            "a scene with one, the first of which is used",
            "Add a 'perspective' sensor with a film to its dictionary.",
        )
    sensor = sensors[0]
    width, height = (int(n) for n in sensor.film().crop_size())
    jitter = np.random.default_rng(seed).random((height, width, spp, 2))
    cell = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    inside = (cell + jitter) / side
    pixel = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)[:, :, None]
    position = ((pixel + inside) / [width, height]).reshape(-1, 2).astype(np.float32)
    shapes = scene.shapes()
    names = tuple(shape.id() for shape in shapes)
    trace = _trace_one_by_one if str(mi.variant()).startswith("scalar") else _trace
    normal, view, index, place = trace(scene, sensor, position, shapes)
    return VisibleSurface((width, height), spp, normal, view, index, names, place)


def _trace(scene: Any, sensor: Any, position: np.ndarray, shapes: Any) -> tuple[Any, ...]:
    import drjit as dr
    import mitsuba as mi

    film = mi.Point2f(*(mi.Float(np.ascontiguousarray(column)) for column in position.T))
    ray, _ = sensor.sample_ray(mi.Float(0.0), mi.Float(0.5), film, mi.Point2f(0.5))
    si = scene.ray_intersect(ray)
    index = dr.full(mi.Int32, -1, len(position))
    for i, shape in enumerate(shapes):
        seen = si.is_valid() & (si.shape == mi.ShapePtr(shape))
        index = dr.select(seen, i, index)
    normal, view, place = mi.Vector3f(si.sh_frame.n), -ray.d, mi.Vector3f(si.p)
    dr.eval(normal, view, index, place)
    return normal, view, index, place


def _trace_one_by_one(
    scene: Any, sensor: Any, position: np.ndarray, shapes: Any
) -> tuple[Any, ...]:
    import mitsuba as mi

    normal, view, place = np.zeros((3, len(position), 3))
    index = np.full(len(position), -1)
    for i, (x, y) in enumerate(position.tolist()):
        ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(x, y), mi.Point2f(0.5))
        si = scene.ray_intersect(ray)
        view[i] = -np.array(ray.d)
        if si.is_valid():
            normal[i], place[i] = np.array(si.sh_frame.n), np.array(si.p)
            index[i] = next((j for j, shape in enumerate(shapes) if shape == si.shape), -1)
    return normal, view, index, place


def render_split_sum(
    surface: VisibleSurface,
    light: PrefilteredLight,
    materials: SplitMaterial | Mapping[str, SplitMaterial],
    *,
    background: bool = True,
) -> Any:
    """A picture by the split-sum: light from the environment only, without shadows.

    Parameters
    ----------
    surface : VisibleSurface
        Trace it once and shade it as often as needed.
    light : PrefilteredLight
        Of the environment that lights the scene.
    materials : SplitMaterial, or mapping from names of shapes to them
        One for all shapes, or one for each.
    background : bool
        Show the environment where no shape is; else it is black.

    Returns
    -------
    (height, width, 3) mi.TensorXf
        Linear sRGB, pixels averaged by a box filter; differentiable as `shade` is.

    Raises
    ------
    InputError
        If a shape has no material.
    """
    named: list[tuple[Any, SplitMaterial]]
    if isinstance(materials, SplitMaterial):
        named = [(surface.shape >= 0, materials)]
    else:
        chosen = [choose("material for shape", n, materials) for n in surface.names]
        named = [(surface.shape == i, materials[name]) for i, name in enumerate(chosen)]
    vectorised = is_drjit(surface.normal)
    colour: Any = (0.0, 0.0, 0.0) if vectorised else np.zeros((len(surface.shape), 3))
    if background:
        away = -surface.view
        sky = light.lookup(away, type(away[0])(0.0) if vectorised else 0.0)
        colour = where(surface.shape < 0, sky, colour)
    for seen, material in named:
        lit = shade(light, material.albedo, surface.normal, surface.view, material.alpha)
        colour = where(seen, lit, colour)
    return averaged(surface, colour)


def averaged(surface: VisibleSurface, colour: Any) -> Any:
    """The picture of colours of all samples, as `render_split_sum` returns it."""
    import mitsuba as mi

    width, height = surface.size
    if not is_drjit(surface.normal):
        pixels = colour.reshape(height, width, surface.spp, 3).mean(axis=2)
        return mi.TensorXf(np.ascontiguousarray(pixels, np.float32))
    return _picture(colour, (height, width), surface.spp)


def where(mask: Any, first: Any, second: Any) -> Any:
    if not is_drjit(mask):
        return np.where(mask[:, None], first, second)
    dr = drjit_module()
    assert dr is not None
    return tuple(dr.select(mask, a, b) for a, b in zip(first, second, strict=True))


def _picture(colour: Any, shape: tuple[int, int], spp: int) -> Any:
    """Average the samples of each pixel, with gradients."""
    import drjit as dr
    import mitsuba as mi

    count = shape[0] * shape[1]
    values = dr.zeros(mi.Float, 3 * count)
    for c, channel in enumerate(colour):
        mean = dr.block_sum(channel + dr.zeros(mi.Float, count * spp), spp) / spp
        dr.scatter(values, mean, 3 * dr.arange(mi.UInt32, count) + c)
    return mi.TensorXf(values, (*shape, 3))

"""What the camera of a Mitsuba scene sees, to be shaded without it, and the picture of that."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._array import drjit_module, is_drjit
from .._check import input_error, is_whole

__all__ = ["VisibleSurface", "averaged", "visible_surface", "where"]


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


def averaged(surface: VisibleSurface, colour: Any) -> Any:
    """The picture of colours of all samples: (height, width, 3) mi.TensorXf, by a box filter."""
    import mitsuba as mi

    width, height = surface.size
    if not is_drjit(surface.normal):
        pixels = colour.reshape(height, width, surface.spp, 3).mean(axis=2)
        return mi.TensorXf(np.ascontiguousarray(pixels, np.float32))
    return _picture(colour, (height, width), surface.spp)


def where(mask: Any, first: Any, second: Any) -> Any:
    """The vectors `first` where the mask is set, `second` elsewhere; of either kind of array."""
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

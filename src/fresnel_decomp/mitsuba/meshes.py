"""Surfaces of revolution, made of nothing but numbers: shader ball, its collar, and a plinth."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["mesh", "plateau", "revolve", "smoothstep"]


def smoothstep(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rise from 0 to 1 over x in [0, 1] with two continuous derivatives."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 + x * (6.0 * x - 15.0))


def plateau(x: NDArray[np.float64], low: float, high: float, soft: float) -> NDArray[np.float64]:
    """1 for x in [low, high], 0 beyond, with edges `soft` wide centred on the two limits."""
    rise = smoothstep((x - low) / soft + 0.5)
    return rise * (1.0 - smoothstep((x - high) / soft + 0.5))


def revolve(
    radius: NDArray[np.float64], height: NDArray[np.float64], segments: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint32]]:
    """A closed surface of revolution about the y axis with smooth normals.

    Parameters
    ----------
    radius, height : (n,) float arrays
        Profile from the top pole to the bottom pole; only its two ends touch the axis (radius 0).
    segments : int
        Steps around the axis.

    Returns
    -------
    positions, normals : (2 + (n - 2) segments, 3) float arrays
    faces : (2 (n - 2) segments, 3) uint32 array
        Counter-clockwise seen from outside; every edge has exactly two faces, no seam.
    """
    turn = 2.0 * np.pi * np.arange(segments) / segments
    circle = np.stack([np.sin(turn), np.zeros(segments), np.cos(turn)], axis=1)
    up = np.array([0.0, 1.0, 0.0])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(radius), np.diff(height)))])
    slope_r, slope_y = np.gradient(radius, arc), np.gradient(height, arc)
    length = np.hypot(slope_r, slope_y)[1:-1, None, None]
    rings = radius[1:-1, None, None] * circle + height[1:-1, None, None] * up
    outward = (slope_r[1:-1, None, None] * up - slope_y[1:-1, None, None] * circle) / length
    positions = np.concatenate([[height[0] * up], rings.reshape(-1, 3), [height[-1] * up]])
    normals = np.concatenate([[up], outward.reshape(-1, 3), [-up]])

    count = len(radius) - 2
    here = np.arange(segments)
    there = (here + 1) % segments
    ring = 1 + segments * np.arange(count - 1)[:, None]
    a, b = ring + here, ring + there
    c, d = a + segments, b + segments
    last = 1 + segments * (count - 1)
    faces = np.concatenate(
        [
            np.stack([0 * here, 1 + here, 1 + there], axis=-1),
            np.stack([a, c, b], axis=-1).reshape(-1, 3),
            np.stack([b, c, d], axis=-1).reshape(-1, 3),
            np.stack([last + there, last + here, 0 * here + len(positions) - 1], axis=-1),
        ]
    )
    return positions, normals, faces.astype(np.uint32)


def _ball_profile(samples: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The shader ball: a unit sphere with a stepped-in cap, a groove and a flat foot."""
    # Uniform in t except that the steps, a few degrees wide, get four times the samples.
    fine = np.linspace(0.0, np.pi, 8192)
    degrees = np.degrees(fine)
    steps = sum(plateau(degrees, at - 5.0, at + 5.0, 2.0) for at in (34.0, 70.0, 79.0))
    density = np.cumsum(1.0 + 3.0 * np.clip(steps, 0.0, 1.0))
    t = np.interp(np.linspace(density[0], density[-1], samples), density, fine)
    t[0], t[-1] = 0.0, np.pi
    degrees = np.degrees(t)
    reach = (
        1.0 - 0.13 * plateau(degrees, -90.0, 34.0, 7.0) - 0.09 * plateau(degrees, 70.0, 79.0, 5.0)
    )
    radius, height = reach * np.sin(t), reach * np.cos(t)
    radius[0] = radius[-1] = 0.0
    return radius, height


def _rounded_profile(
    corners: list[tuple[float, float]], fillet: float, samples: int = 12
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A polyline from axis to axis whose inner corners are quadratic curves `fillet` long."""
    points = np.array(corners)
    t = np.linspace(0.0, 1.0, samples)[:, None]
    path = [points[:1]]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        start = corner + fillet * (before - corner) / np.linalg.norm(before - corner)
        end = corner + fillet * (after - corner) / np.linalg.norm(after - corner)
        path.append((1 - t) ** 2 * start + 2 * t * (1 - t) * corner + t**2 * end)
    path.append(points[-1:])
    radius, height = np.concatenate(path).T
    return radius, height


def _tilt(vectors: NDArray[np.float64], x: float, z: float) -> NDArray[np.float64]:
    """Rotate about the z axis and then about the x axis, by degrees."""
    cos_x, sin_x = np.cos(np.radians(x)), np.sin(np.radians(x))
    cos_z, sin_z = np.cos(np.radians(z)), np.sin(np.radians(z))
    about_z = np.array([[cos_z, -sin_z, 0.0], [sin_z, cos_z, 0.0], [0.0, 0.0, 1.0]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cos_x, -sin_x], [0.0, sin_x, cos_x]])
    return vectors @ (about_x @ about_z).T


@functools.lru_cache(maxsize=8)
def _geometry(name: str) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint32]]:
    """Positions, normals and faces of one of our meshes: 'plinth', 'collar' or 'ball'."""
    if name == "plinth":
        corners = [(0.0, 0.0), (1.9, 0.0), (1.9, -0.16), (0.0, -0.16)]
        return revolve(*_rounded_profile(corners, 0.06), segments=256)
    if name == "collar":
        corners = [(0.0, 0.15), (0.5, 0.15), (0.62, 0.15), (0.66, 0.0), (0.0, 0.0)]
        return revolve(*_rounded_profile(corners, 0.03), segments=192)
    positions, normals, faces = revolve(*_ball_profile(360), segments=384)
    positions, normals = _tilt(positions, 34.0, -22.0), _tilt(normals, 34.0, -22.0)
    return positions + np.array([0.0, 1.06, 0.0]), normals, faces


def mesh(name: str, bsdf: Any) -> Any:
    """Mesh `name` as a Mitsuba object of the active variant, with its BSDF (object or dict)."""
    import mitsuba as mi

    positions, normals, faces = _geometry(name)
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf) if isinstance(bsdf, dict) else bsdf
    made = mi.Mesh(name, len(positions), len(faces), has_vertex_normals=True, props=properties)
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = positions.astype(np.float32).ravel()
    parameters["vertex_normals"] = normals.astype(np.float32).ravel()
    parameters["faces"] = faces.ravel()
    parameters.update()
    return made

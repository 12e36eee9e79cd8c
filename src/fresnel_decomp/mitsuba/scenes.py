"""Scenes for `mi.load_dict`, made of nothing but numbers: a studio sphere and a shader ball.

Both stand on a neutral plinth in the same softbox studio (`studio_lights`). Two of its lights
exist for Fresnel's sake: seen from the camera they lie 28° to 62° off the viewing direction
*behind* the object, so they are mirrored where the angle of incidence is 59° to 76°, the range in
which the approximations of the Fresnel equations part ways.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import choose, input_error, is_whole

__all__ = [
    "SCENES",
    "camera",
    "film_size",
    "lit_object",
    "load_scene",
    "revolve",
    "shader_ball",
    "studio",
    "studio_lights",
]

_NEUTRAL = 0.42  # reflectance of the plinth: darker than paper, so that a metal stands out
_RUBBER = 0.06
_CAMERA = np.array([0.0, 2.05, 8.2])
_TARGET = np.array([0.0, 0.92, 0.0])


def _smoothstep(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rise from 0 to 1 over x in [0, 1] with two continuous derivatives."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 + x * (6.0 * x - 15.0))


def _plateau(x: NDArray[np.float64], low: float, high: float, soft: float) -> NDArray[np.float64]:
    """1 for x in [low, high], 0 beyond, with edges `soft` wide centred on the two limits."""
    rise = _smoothstep((x - low) / soft + 0.5)
    return rise * (1.0 - _smoothstep((x - high) / soft + 0.5))


@functools.lru_cache(maxsize=4)
def studio_lights(width: int = 1024) -> NDArray[np.float32]:
    """Radiance of the studio in every direction, as a latitude-longitude image.

    A grey backdrop that is brighter at the horizon, a key softbox above the camera's left
    shoulder, a low fill on its right and a horseshoe of light behind the object, just out of the
    picture. Radiance never exceeds 3, so paths that find a light by chance leave no fireflies.

    Parameters
    ----------
    width : int
        Columns of the image; it has half as many rows.

    Returns
    -------
    (width // 2, width, 3) float32 array
        Neutral radiance for Mitsuba's `envmap` emitter, y up. Read-only.
    """
    height = width // 2
    polar = (np.arange(height) + 0.5)[:, None] * np.pi / height
    turn = (np.arange(width) + 0.5)[None, :] * 2.0 * np.pi / width
    x, y, z = np.sin(turn) * np.sin(polar), np.cos(polar) + 0 * turn, -np.cos(turn) * np.sin(polar)

    def softbox(azimuth: float, elevation: float, wide: float, high: float) -> NDArray[np.float64]:
        """A rounded rectangle of light (degrees); azimuth 0 is behind the camera, > 0 right."""
        a, e = np.radians(azimuth), np.radians(elevation)
        forward = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
        right = np.array([np.cos(a), 0.0, -np.sin(a)])
        up = np.cross(forward, right)
        depth = x * forward[0] + y * forward[1] + z * forward[2]
        safe = np.where(depth > 0.05, depth, np.inf)
        u = (x * right[0] + z * right[2]) / safe / np.tan(np.radians(wide / 2))
        v = (x * up[0] + y * up[1] + z * up[2]) / safe / np.tan(np.radians(high / 2))
        radius = (u**8 + v**8) ** 0.125  # superellipse: a box with rounded corners
        return np.where(depth > 0.05, 1.0 - _smoothstep((radius - 0.94) / 0.12), 0.0)

    forward = (_TARGET - _CAMERA) / np.linalg.norm(_TARGET - _CAMERA)
    off_axis = np.degrees(
        np.arccos(np.clip(x * forward[0] + y * forward[1] + z * forward[2], -1, 1))
    )
    horseshoe = _plateau(off_axis, 28.0, 62.0, 3.0) * _smoothstep((y + 0.05) / 0.12)
    backdrop = 0.10 + 0.27 * np.exp(-(((y - 0.02) / 0.30) ** 2))
    boxes = 2.7 * softbox(-38.0, 50.0, 60.0, 44.0) + 1.1 * softbox(64.0, 22.0, 26.0, 64.0)
    radiance = backdrop * (1.0 - horseshoe) + 0.95 * horseshoe + boxes
    image = np.repeat(radiance[..., None], 3, axis=2).astype(np.float32)
    image.flags.writeable = False
    return image


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
    steps = sum(_plateau(degrees, at - 5.0, at + 5.0, 2.0) for at in (34.0, 70.0, 79.0))
    density = np.cumsum(1.0 + 3.0 * np.clip(steps, 0.0, 1.0))
    t = np.interp(np.linspace(density[0], density[-1], samples), density, fine)
    t[0], t[-1] = 0.0, np.pi
    degrees = np.degrees(t)
    reach = (
        1.0 - 0.13 * _plateau(degrees, -90.0, 34.0, 7.0) - 0.09 * _plateau(degrees, 70.0, 79.0, 5.0)
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


def _mesh(name: str, bsdf: Any) -> Any:
    """Mesh `name` as a Mitsuba object of the active variant, with its BSDF (object or dict)."""
    import mitsuba as mi

    positions, normals, faces = _geometry(name)
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf) if isinstance(bsdf, dict) else bsdf
    mesh = mi.Mesh(name, len(positions), len(faces), has_vertex_normals=True, props=properties)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = positions.astype(np.float32).ravel()
    parameters["vertex_normals"] = normals.astype(np.float32).ravel()
    parameters["faces"] = faces.ravel()
    parameters.update()
    return mesh


def _diffuse(reflectance: float) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": [reflectance] * 3}}


def film_size(size: int | tuple[int, int]) -> tuple[int, int]:
    """(width, height) of one or two numbers.

    Raises
    ------
    InputError
        If they are not integers from 1 on.
    """
    given = size if isinstance(size, tuple | list) else (size, size)
    if len(given) != 2 or not all(is_whole(pixels, 1) for pixels in given):
        raise input_error(f"size={size!r}", "one or two integers ≥ 1", "Use for example size=256.")
    return int(given[0]), int(given[1])


def camera(
    width: int,
    height: int,
    origin: list[float],
    target: list[float],
    fov: float,
    spp: int,
    rfilter: str,
) -> dict[str, Any]:
    """The dictionary of a sensor, with film and sampler; y is up, `fov` in degrees."""
    import mitsuba as mi

    return {
        "type": "perspective",
        "fov": fov,
        "fov_axis": "smaller",
        "to_world": mi.ScalarTransform4f().look_at(origin=origin, target=target, up=[0, 1, 0]),
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "pixel_format": "luminance" if "mono" in str(mi.variant()) else "rgb",
            "component_format": "float32",
            "rfilter": {"type": rfilter},
        },
        "sampler": {"type": "multijitter", "sample_count": spp},
    }


def _stage(
    size: int | tuple[int, int], spp: int, max_depth: int, rfilter: str, fov: float
) -> dict[str, Any]:
    """Everything but the object: lights, plinth, camera, film and integrator."""
    import mitsuba as mi

    width, height = film_size(size)
    lights = mi.Bitmap(np.array(studio_lights()), pixel_format=mi.Bitmap.PixelFormat.RGB)
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": max_depth, "rr_depth": max_depth + 1},
        "sensor": camera(width, height, _CAMERA.tolist(), _TARGET.tolist(), fov, spp, rfilter),
        "lights": {"type": "envmap", "bitmap": lights},
        "plinth": _mesh("plinth", _diffuse(_NEUTRAL)),
    }


def studio(
    bsdf: Any,
    size: int | tuple[int, int] = 256,
    *,
    spp: int = 64,
    max_depth: int = 6,
    rfilter: str = "box",
) -> dict[str, Any]:
    """A sphere of `bsdf` on a neutral plinth in the softbox studio, for `mi.load_dict`.

    Parameters
    ----------
    bsdf : dict or mi.BSDF
        Material of the sphere.
    size : int or (width, height)
        Pixels; the sphere fills the shorter side.
    spp : int
        Samples per pixel that the scene asks for; `mi.render(spp=...)` overrides it.
    max_depth : int
        Longest path. Russian roulette never starts: it would let the reflectance decide which
        paths go on, whereas here same-seed images differ by the Fresnel term alone.
    rfilter : str
        Reconstruction filter. With 'box' each sample belongs to one pixel and images are
        reproducible to the last bits; others sum neighbours in an order that the threads decide.

    Returns
    -------
    dict
        Holds objects of the active Mitsuba variant: build it anew after a change of variant.

    Examples
    --------
    >>> import mitsuba as mi
    >>> mi.set_variant("scalar_rgb")
    >>> scene = mi.load_dict(studio({"type": "roughconductor", "material": "Be"}, size=16))
    >>> scene.sensors()[0].film().size()
    [16, 16]
    """
    scene = _stage(size, spp, max_depth, rfilter, fov=18.5)
    scene["object"] = {"type": "sphere", "center": [0.0, 1.0, 0.0], "radius": 1.0, "bsdf": bsdf}
    return scene


def shader_ball(
    bsdf: Any,
    size: int | tuple[int, int] = 256,
    *,
    spp: int = 64,
    max_depth: int = 8,
    rfilter: str = "box",
) -> dict[str, Any]:
    """A shader ball of our own in the same studio: convex, concave and stepped in one object.

    A surface of revolution (a unit sphere with a stepped-in cap and a groove), tilted towards the
    camera, in a neutral collar. Parameters and result are those of `studio`.
    """
    scene = _stage(size, spp, max_depth, rfilter, fov=18.5)
    scene["collar"] = _mesh("collar", _diffuse(_RUBBER))
    scene["object"] = _mesh("ball", bsdf)
    return scene


def lit_object(
    bsdf: Any,
    light: Any,
    size: int | tuple[int, int] = 256,
    *,
    shape: str = "sphere",
    spp: int = 64,
    max_depth: int = 2,
    rfilter: str = "box",
    background: bool = True,
) -> dict[str, Any]:
    """A sphere or the shader ball, floating in an environment that is all its light.

    Parameters
    ----------
    bsdf : dict or mi.BSDF
    light : dict or mi.Emitter
        An environment, such as `Environment.emitter()` gives it.
    size : int or (width, height)
    shape : {"sphere", "shader-ball"}
    spp, rfilter
        As for `studio`.
    max_depth : int
        With 2 the object reflects nothing but the environment, as in split-sum shading; what hides
        behind itself is dark, where split-sum shading knows no shadows.
    background : bool
        Show the environment behind the object; else it is black.
    """
    width, height = film_size(size)
    choose("shape", shape, ("sphere", "shader-ball"))
    sphere = {"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 1.0, "bsdf": bsdf}
    centre = 0.0 if shape == "sphere" else 1.06
    origin = [0.0, centre + 0.7, 8.0]
    return {
        "type": "scene",
        "integrator": {
            "type": "path",
            "max_depth": max_depth,
            "rr_depth": max_depth + 1,
            "hide_emitters": not background,
        },
        "sensor": camera(width, height, origin, [0.0, centre, 0.0], 15.2, spp, rfilter),
        "light": light,
        "object": sphere if shape == "sphere" else _mesh("ball", bsdf),
    }


SCENES = {"studio": studio, "shader-ball": shader_ball}


def load_scene(name: str, bsdf: Any, size: int | tuple[int, int] = 256, **options: Any) -> Any:
    """The scene called `name` ('studio' or 'shader-ball'), loaded in the active variant."""
    import mitsuba as mi

    return mi.load_dict(SCENES[choose("scene", name, SCENES)](bsdf, size, **options))

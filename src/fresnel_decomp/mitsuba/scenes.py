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
from .meshes import mesh, plateau, smoothstep

__all__ = [
    "SCENES",
    "camera",
    "film_size",
    "lit_object",
    "load_scene",
    "shader_ball",
    "studio",
    "studio_lights",
]

_NEUTRAL = 0.42  # reflectance of the plinth: darker than paper, so that a metal stands out
_RUBBER = 0.06
_CAMERA = np.array([0.0, 2.05, 8.2])
_TARGET = np.array([0.0, 0.92, 0.0])


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
        return np.where(depth > 0.05, 1.0 - smoothstep((radius - 0.94) / 0.12), 0.0)

    forward = (_TARGET - _CAMERA) / np.linalg.norm(_TARGET - _CAMERA)
    off_axis = np.degrees(
        np.arccos(np.clip(x * forward[0] + y * forward[1] + z * forward[2], -1, 1))
    )
    horseshoe = plateau(off_axis, 28.0, 62.0, 3.0) * smoothstep((y + 0.05) / 0.12)
    backdrop = 0.10 + 0.27 * np.exp(-(((y - 0.02) / 0.30) ** 2))
    boxes = 2.7 * softbox(-38.0, 50.0, 60.0, 44.0) + 1.1 * softbox(64.0, 22.0, 26.0, 64.0)
    radiance = backdrop * (1.0 - horseshoe) + 0.95 * horseshoe + boxes
    image = np.repeat(radiance[..., None], 3, axis=2).astype(np.float32)
    image.flags.writeable = False
    return image


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
        "plinth": mesh("plinth", _diffuse(_NEUTRAL)),
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
    scene["collar"] = mesh("collar", _diffuse(_RUBBER))
    scene["object"] = mesh("ball", bsdf)
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
        "object": sphere if shape == "sphere" else mesh("ball", bsdf),
    }


SCENES = {"studio": studio, "shader-ball": shader_ball}


def load_scene(name: str, bsdf: Any, size: int | tuple[int, int] = 256, **options: Any) -> Any:
    """The scene called `name` ('studio' or 'shader-ball'), loaded in the active variant."""
    import mitsuba as mi

    return mi.load_dict(SCENES[choose("scene", name, SCENES)](bsdf, size, **options))

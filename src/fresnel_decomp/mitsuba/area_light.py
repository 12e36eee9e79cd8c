"""Area lights in Mitsuba: pictures by linearly transformed cosines, and scenes to path trace.

`render_area_light` shades what the camera of a scene sees by `fresnel_decomp.area_light`, as a
real-time renderer would, with Dr.Jit; `emitter` makes Mitsuba's shape of the same light, and
`lit_by_area` a scene of an object and nothing but that light, for the path tracer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._array import is_drjit
from .._check import choose, input_error, is_real
from ..area_light import CORRECTIONS, AreaLight, AreaMaterial, Correction, shade_area_light
from ..ltc import LobeTable
from .scenes import camera, film_size
from .visible_surface import VisibleSurface, averaged, where

__all__ = ["OBJECTS", "LitMaterial", "emitter", "lit_by_area", "render_area_light"]

OBJECTS = ("plane", "sphere")
"""Shapes of `lit_by_area`."""


@dataclass(frozen=True, eq=False)
class LitMaterial:
    """What `render_area_light` needs of a material.

    Attributes
    ----------
    material : AreaMaterial
    alpha : float in [0, 1], roughness of GGX
    correction : {"none", "plain", "normalised", "blended"}
        See `area_light`.

    Raises
    ------
    InputError
        For another roughness or correction.
    """

    material: AreaMaterial
    alpha: float
    correction: Correction = "none"

    def __post_init__(self) -> None:
        choose("correction", self.correction, CORRECTIONS)
        if not is_real(self.alpha, 0.0, 1.0):
            raise input_error(
                f"alpha={self.alpha!r}", "a number in [0, 1]", "It is the square of the perceptual."
            )


def emitter(light: AreaLight) -> dict[str, Any]:
    """The dictionary of Mitsuba's `rectangle` or `disk` with an `area` emitter.

    Parameters
    ----------
    light : AreaLight
        Of numbers. Mitsuba's area lights shine to one side.

    Raises
    ------
    InputError
        For a light that shines to both sides.

    Examples
    --------
    >>> import mitsuba as mi
    >>> mi.set_variant("scalar_rgb")
    >>> light = AreaLight("disk", [0, 2, 0], [1, 0, 0], [0, 0, 1], radiance=5.0)
    >>> bool(mi.load_dict(emitter(light)).is_emitter())
    True
    """
    import mitsuba as mi

    if light.two_sided:
        raise input_error(
            "a light that shines to both sides",
            "two_sided=False",
            "Put two of them back to back.",
        )
    centre, u, v = (np.array(vector, np.float64) for vector in (light.centre, light.u, light.v))
    normal = np.cross(u, v)
    matrix = np.eye(4)
    matrix[:3] = np.stack([u, v, normal / np.linalg.norm(normal), centre], axis=1)
    return {
        "type": light.shape,
        "to_world": mi.ScalarTransform4f(matrix),
        "bsdf": {"type": "diffuse", "reflectance": 0.0},
        "emitter": {
            "type": "area",
            "radiance": {"type": "rgb", "value": [float(c) for c in light.radiance]},
        },
    }


def lit_by_area(
    bsdf: Any,
    light: AreaLight,
    size: int | tuple[int, int] = 256,
    *,
    shape: str = "plane",
    spp: int = 64,
    rfilter: str = "box",
) -> dict[str, Any]:
    """An object in the light of one rectangle or disk and no other, for `mi.load_dict`.

    Parameters
    ----------
    bsdf : dict or mi.BSDF
    light : AreaLight
    size : int or (width, height)
    shape : {"plane", "sphere"}
        A floor at y = 0 seen from z > 0, or a sphere of radius 1 that stands on it.
    spp, rfilter
        As for `studio`.

    Returns
    -------
    dict
        Of shapes "object" and "light". Paths are of direct light only, as in the formulas.
    """
    width, height = film_size(size)
    choose("shape", shape, OBJECTS)
    import mitsuba as mi

    turn = mi.ScalarTransform4f().rotate([1, 0, 0], -90.0)
    if shape == "plane":
        thing = {"type": "rectangle", "to_world": turn.scale([20.0, 20.0, 1.0]), "bsdf": bsdf}
        view = ([0.0, 3.4, 5.0], [0.0, 0.35, 0.1], 32.0)
    else:
        thing = {"type": "sphere", "center": [0.0, 1.0, 0.0], "radius": 1.0, "bsdf": bsdf}
        view = ([0.0, 1.6, 6.0], [0.0, 1.0, 0.0], 21.0)
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2, "rr_depth": 3},
        "sensor": camera(width, height, *view, spp, rfilter),
        "light": emitter(light),
        "object": thing,
    }


def render_area_light(
    surface: VisibleSurface,
    light: AreaLight,
    lobes: LobeTable,
    materials: LitMaterial | Mapping[str, LitMaterial],
) -> Any:
    """A picture in the light of one rectangle or disk, without shadows.

    Parameters
    ----------
    surface : VisibleSurface
        Of a scene whose light, where it is to be seen, is the shape "light".
    light : AreaLight
    lobes : LobeTable
    materials : LitMaterial, or mapping from names of shapes to them
        One for all other shapes, or one for each.

    Returns
    -------
    (height, width, 3) mi.TensorXf
        Linear sRGB, pixels averaged by a box filter; black where nothing is; differentiable as
        `shade_area_light` is.

    Raises
    ------
    InputError
        If a shape has no material.
    """
    import mitsuba as mi

    vectorised = is_drjit(surface.normal)
    colour: Any = (0.0, 0.0, 0.0) if vectorised else np.zeros((len(surface.shape), 3))
    for i, name in enumerate(surface.names):
        if name == "light":
            front = light.normal
            facing = (
                sum(surface.view[c if vectorised else (..., c)] * front[c] for c in range(3)) > 0.0
            )
            lit = facing | light.two_sided
            glow: Any = tuple(mi.Float(c) for c in light.radiance)
            if not vectorised:
                glow = np.array(light.radiance)
            colour = where((surface.shape == i) & lit, glow, colour)
            continue
        if isinstance(materials, LitMaterial):
            chosen = materials
        else:
            chosen = materials[choose("material for shape", name, materials)]
        lit = shade_area_light(
            light,
            lobes,
            chosen.material,
            surface.position,
            surface.normal,
            surface.view,
            chosen.alpha,
            chosen.correction,
        )
        colour = where(surface.shape == i, lit, colour)
    return averaged(surface, colour)

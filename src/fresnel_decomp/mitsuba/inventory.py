"""What a scene has that reflects: conductors, other BSDFs with a Fresnel term, lights.

A scene is walked as it is loaded: shapes, their BSDFs, and the BSDFs nested in those, whether
written in place, referenced or inside a shape group that is instanced. What is defined but not used
by a shape does not count.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..colour import WAVELENGTH_NM
from ..microfacet import Distribution
from ..plan import LeftExact
from ..prediction import EVEN_SKY, Surface
from .environment import row_weights
from .ranges import UNKNOWN_ALPHA, value_range
from .scene_source import Source, load_source
from .tabulation import children, stored_values

__all__ = ["Inventory", "take_inventory"]

_CONDUCTORS = {"RoughConductor": "roughconductor", "SmoothConductor": "conductor"}
_NO_COUNTERPART = {
    "SmoothDielectric": "dielectric",
    "ThinDielectric": "thindielectric",
    "RoughDielectric": "roughdielectric",
    "SmoothPlastic": "plastic",
    "RoughPlastic": "roughplastic",
    "Principled": "principled",
    "PrincipledThin": "principledthin",
}


@dataclass(frozen=True, eq=False)
class Inventory:
    """What a scene has for a plan to work on.

    Attributes
    ----------
    surfaces : tuple of Surface
        Rough conductors, which `decomposed_conductor` can replace.
    left : tuple of LeftExact
        Other BSDFs with a Fresnel term, and conductors that a plan cannot take.
    lights : tuple of str
        Classes of the emitters in use.
    objects : tuple of mi.BSDF
        The loaded BSDFs of `surfaces`.
    """

    surfaces: tuple[Surface, ...]
    left: tuple[LeftExact, ...]
    lights: tuple[str, ...]
    objects: tuple[Any, ...] = field(repr=False)


def take_inventory(source: Source, contrast: float | None = None) -> Inventory:
    """What is in use in a scene.

    Parameters
    ----------
    source : path, dict or mi.Scene
    contrast : float >= 0, optional
        Of the light at its surfaces, see `prediction.Surface`. By default what the emitters have:
        that of an even sky, of the pixels of an environment map, or infinite.

    Raises
    ------
    InputError
        If no variant is set, or the scene cannot be loaded.
    """
    scene, _ = load_source(source)
    lights = list(scene.emitters())
    if contrast is None:
        contrast = max((_contrast(light) for light in lights), default=EVEN_SKY)
    surfaces: list[Surface] = []
    objects: list[Any] = []
    left: list[LeftExact] = []
    for path, bsdf in _walk(scene, "", []):
        kind = bsdf.class_name()
        name = bsdf.id() or path
        if kind in _CONDUCTORS:
            found = _conductor(name, bsdf, kind, contrast)
            if isinstance(found, Surface):
                surfaces.append(found)
                objects.append(bsdf)
            else:
                left.append(found)
        elif kind in _NO_COUNTERPART:
            left.append(_without_counterpart(name, bsdf, kind, contrast))
    classes = tuple(sorted({light.class_name() for light in lights}))
    return Inventory(tuple(surfaces), tuple(left), classes, tuple(objects))


def _walk(node: Any, path: str, seen: list[Any]) -> Iterator[tuple[str, Any]]:
    """All BSDFs that shapes below `node` use, each once, with the path to it."""
    for number, (name, child) in enumerate(children(node).items()):
        if not isinstance(child, mi.Object) or any(child is known for known in seen):
            continue
        if isinstance(node, mi.Scene) and isinstance(child, mi.BSDF):
            continue  # defined, but not by that alone in use
        seen.append(child)
        if name.startswith("object_"):  # without an id: an address
            name = f"{child.class_name().lower()}-{number}"
        where = f"{path}.{name}" if path else name
        if isinstance(child, mi.BSDF):
            yield where, child
        yield from _walk(child, where, seen)


def _conductor(name: str, bsdf: Any, kind: str, contrast: float) -> Surface | LeftExact:
    parts = children(bsdf)
    plugin = _CONDUCTORS[kind]
    textures = [parts["eta"], parts["k"]]
    if not all(texture.class_name().endswith("Spectrum") for texture in textures):
        gain = "a table of coefficients, one per texel, which decomposed_conductor makes of eta, k"
        return LeftExact(name, plugin, "its index is textured", gain)
    eta, k = (_spectrum(texture) for texture in textures)
    eta, k = np.broadcast_arrays(eta, k)
    if not (np.all(eta > 0.0) and np.all(k >= 0.0)):
        why = "its index is not positive: a mirror, or a gap in the data"
        return LeftExact(name, plugin, why, "nothing: it has no curve to represent")
    wavelengths = WAVELENGTH_NM if mi.is_spectral and len(eta) > 1 else None
    if plugin == "conductor":
        smooth = Surface(name, eta, k, None, contrast, wavelength_nm=wavelengths)
        why = "it is perfectly smooth, and decomposed_conductor is not"
        return LeftExact(name, plugin, why, surface=smooth)
    alpha = _roughness([parts[key] for key in ("alpha", "alpha_u", "alpha_v") if key in parts])
    if alpha[0] <= 0.0:
        return LeftExact(name, plugin, "its roughness is 0 somewhere", "nothing: use alpha > 0")
    ggx = re.search(r"distribution = ggx", str(bsdf), re.I)  # shown nowhere else
    lobe: Distribution = "ggx" if ggx else "beckmann"
    return Surface(name, eta, k, alpha, contrast, lobe, wavelengths)


def _without_counterpart(name: str, bsdf: Any, kind: str, contrast: float) -> LeftExact:
    plugin = _NO_COUNTERPART[kind]
    why = "no counterpart with another Fresnel term"
    params = mi.traverse(bsdf)
    if "eta" not in params:
        return LeftExact(name, plugin, why, "unknown: its Fresnel term is one of its own")
    eta = float(np.ravel(np.array(dr.detach(params["eta"]), float))[0])
    if eta < 1.0:
        gain = "nothing: no linear basis follows total internal reflection"
        return LeftExact(name, plugin, f"{why}, and eta < 1 reflects totally", gain)
    alpha = None
    if "alpha" in params:
        values = np.ravel(np.array(dr.detach(params["alpha"]), float))
        alpha = (float(values.min()), float(values.max()))
    elif "alpha.value" in params:
        alpha = _roughness([children(bsdf)["alpha"]])
    surface = Surface(name, [eta], [0.0], alpha, contrast)
    inside = " (from inside, eta < 1 stays exact)" if "ielectric" in kind else ""
    return LeftExact(name, plugin, why + inside, surface=surface)


def _contrast(light: Any) -> float:
    """Variance of what a light sends from all around, relative to its squared mean."""
    kind = light.class_name()
    if kind == "ConstantBackgroundEmitter":
        return EVEN_SKY  # not 0: objects hide a part of it
    if kind != "EnvironmentMapEmitter":
        return np.inf  # may be as small as a point, or has a sun
    # one column on either side is that of the other
    texels = np.array(mi.traverse(light)["data"], np.float64)[:, 1:-1]
    grey = _power(texels) if mi.is_spectral else texels[..., :3].mean(axis=-1)
    area = np.broadcast_to(row_weights(len(grey))[:, None], grey.shape)
    mean = np.average(grey, weights=area)
    if mean <= 0.0:
        return EVEN_SKY
    return EVEN_SKY + float(np.average((grey / mean - 1.0) ** 2, weights=area))


def _power(texels: np.ndarray) -> np.ndarray:
    """Mean over the visible wavelengths of what spectral variants keep of an environment map.

    That is a scale, and the coefficients of a spectrum in [0, 1] (Jakob and Hanika 2019), which
    are infinite for black and white.
    """
    a, b, c, scale = np.moveaxis(texels, -1, 0)
    wavelengths = np.linspace(400.0, 700.0, 31)
    values = (0.5 + 0.5 * np.sin(np.arctan((a * w + b) * w + c)) for w in wavelengths)
    return np.asarray(scale * sum(values) / len(wavelengths))


def _spectrum(texture: Any) -> np.ndarray:
    return np.array(stored_values(texture)[0], np.float64).ravel()


def _roughness(textures: Sequence[Any]) -> tuple[float, float]:
    ranges = [value_range(texture) for texture in textures]
    if any(found is None for found in ranges):
        return UNKNOWN_ALPHA
    return min(found[0] for found in ranges if found), max(found[1] for found in ranges if found)

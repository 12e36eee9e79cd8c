r"""Split-sum shading: a blurred environment times the directional albedo, per shading point.

Karis 2013, "Real Shading in Unreal Engine 4", replaces the reflection integral of environment
light by a product,

    Lo(v) ≈ L(R, alpha) Fbar(n·v, alpha),

R being v mirrored about n. `prefilter` makes L, and `split_albedo` Fbar, which is what the Fresnel
term is about.

`shade` is all there is at run time. It takes NumPy and Dr.Jit arrays and needs no renderer;
`render_split_sum` shades what a scene shows, a `VisibleSurface`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._array import drjit_module, is_drjit
from .._check import choose, input_error, is_real
from .._vectors import as_vectors, of_kind
from .prefilter import PrefilteredLight
from .visible_surface import VisibleSurface, averaged, where

if TYPE_CHECKING:
    from .light_texture import LightTexture

__all__ = [
    "SplitMaterial",
    "render_split_sum",
    "shade",
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

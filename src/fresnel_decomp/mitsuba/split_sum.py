r"""Split-sum shading: a blurred environment times the directional albedo, per shading point.

Karis 2013, "Real Shading in Unreal Engine 4", replaces the reflection integral of environment
light by a product,

    Lo(v) ≈ L(R, alpha) Fbar(n·v, alpha),

R being v mirrored about n. `prefilter` makes L. Fbar is what the Fresnel term is about:

- `SplitAlbedo(table, coefficients)`: a table's functions, weighed by the material's coefficients.
  With an `AlbedoTable` of four terms this is the decomposition;
- `schlick_albedo`, `f82_albedo`: the same with the functions of Schlick's curve, F0 A + B, and one
  more for F82;
- `compensated_albedo`: with the light that has bounced several times, from the same fetch;
- `integrated_albedo`: any curve integrated as it is, which is the reference of the first two.

`shade` is all there is at run time. It takes NumPy and Dr.Jit arrays and needs no renderer;
`visible_surface` and `render_split_sum` take what is seen from a Mitsuba scene.
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .._array import drjit_module, is_drjit
from .._check import choose, input_error, is_real, is_whole
from .._schlick import bend_factor
from ..albedo import directional_albedo
from ..energy import EnergyTable, missing, scaling
from ..microfacet import Smith
from ..table import AlbedoTable
from ..table_layout import Layout
from .environment import as_vectors, of_kind
from .prefilter import PrefilteredLight

if TYPE_CHECKING:
    from .light_texture import LightTexture

__all__ = [
    "SplitAlbedo",
    "SplitMaterial",
    "VisibleSurface",
    "compensated_albedo",
    "f82_albedo",
    "integrated_albedo",
    "render_split_sum",
    "schlick_albedo",
    "schlick_table",
    "shade",
    "visible_surface",
]

_COSINES = 1025  # of integrated albedos, uniform in sqrt(mu): interpolation errs by some 1e-6


@dataclass(frozen=True, eq=False)
class SplitAlbedo:
    """Directional albedo of a material in three channels, sum_j c_j bbar_j(mu, alpha), unclamped.

    Attributes
    ----------
    table : AlbedoTable
    coefficients : (3, terms) float, or three sequences of `terms` Dr.Jit arrays
        By channel, as `Basis.coefficients` and `Material.rgb_coefficients` return them.

    Raises
    ------
    InputError
        If they are not for three channels with as many terms as the table has.

    Examples
    --------
    >>> from fresnel_decomp import AlbedoTable, load_basis
    >>> basis = load_basis()
    >>> table = AlbedoTable.bake(basis, size=16)
    >>> gold = SplitAlbedo(table, basis.coefficients([0.13, 0.43, 1.38], [3.9, 2.5, 1.9]))
    >>> gold(0.5, 0.3).shape
    (3,)
    """

    table: AlbedoTable
    coefficients: Any

    def __post_init__(self) -> None:
        rows = list(self.coefficients)
        lengths = sorted({len(row) if hasattr(row, "__len__") else 1 for row in rows})
        if len(rows) != 3 or lengths != [self.table.terms]:
            raise input_error(
                f"coefficients of {len(rows)} channels with {', '.join(map(str, lengths))} terms",
                f"3 channels with {self.table.terms} terms, as the table has",
                "Make both from one basis; repeat a grey material three times.",
            )

    def __call__(self, mu: Any, alpha: Any) -> Any:
        """(..., 3) float array, or a tuple of three Dr.Jit arrays.

        Parameters
        ----------
        mu, alpha : (...) float
            As for `AlbedoTable.lookup`: clamped to [0, 1], NaN gives NaN.

        Raises
        ------
        InputError
            For Dr.Jit coefficients if neither mu nor alpha is a Dr.Jit array.
        """
        functions = self.table.lookup(mu, alpha)
        if not is_drjit(mu, alpha):
            if any(is_drjit(c) for row in self.coefficients for c in row):
                raise input_error(
                    "Dr.Jit coefficients together with mu and alpha of NumPy",
                    "mu or alpha as a Dr.Jit array",
                    "Convert it first, e.g. mi.Float(mu).",
                )
            return functions @ np.asarray(self.coefficients, functions.dtype).T
        kind = type(functions[0])
        return tuple(
            sum(
                (of_kind(kind, c) * b for c, b in zip(row[1:], functions[1:], strict=True)),
                of_kind(kind, row[0]) * functions[0],
            )
            for row in self.coefficients
        )


def _schlick_functions(cos_theta: np.ndarray) -> np.ndarray:
    x = 1.0 - cos_theta
    return np.stack([1.0 - x**5, x**5, -cos_theta * x**6], axis=-1)


@functools.lru_cache(maxsize=4, typed=True)  # 64 and 64.0 are not the same argument
def schlick_table(size: int = 64, smith: Smith = "separable") -> AlbedoTable:
    """Karis's table of A and B, with a third function for F82.

    Schlick's curve with its correction is F0 (1 - (1 - c)^5) + (1 - c)^5 - a c (1 - c)^6, linear
    in (F0, 1, a), so its albedo is F0 A + B + a C.

    Parameters
    ----------
    size : int or (width, height)
    smith : {"separable", "correlated"}

    Returns
    -------
    AlbedoTable
        Of three terms: A, B and C. The last four are kept.

    Raises
    ------
    InputError
        For other sizes and conventions.

    Examples
    --------
    >>> schlick_table(16).values.shape
    (16, 16, 3)
    """
    return AlbedoTable.bake(_schlick_functions, size, smith)


def schlick_albedo(f0: ArrayLike, table: AlbedoTable | None = None) -> SplitAlbedo:
    """Albedo of Schlick's curve, F0 A + B (Karis 2013).

    Parameters
    ----------
    f0 : (3,) float, or one for all channels
        Reflectances at normal incidence.
    table : AlbedoTable, optional
        Of `schlick_table`; the default one if none is given.

    Returns
    -------
    SplitAlbedo

    Raises
    ------
    InputError
        For other shapes, values that are not finite, and tables of other than three terms.

    Examples
    --------
    >>> gold = schlick_albedo([1.0, 0.78, 0.34])
    >>> gold(1.0, 0.0).round(2).tolist()
    [1.0, 0.78, 0.34]
    """
    return f82_albedo(f0, None, table)


def f82_albedo(
    f0: ArrayLike, f82: ArrayLike | None, table: AlbedoTable | None = None
) -> SplitAlbedo:
    """Albedo of Schlick's curve bent through a given reflectance at cos = 1/7 (Hoffman 2019).

    Parameters
    ----------
    f0, f82 : (3,) float
        Reflectances at normal incidence and at cos = 1/7; None for Schlick's curve as it is.
    table : AlbedoTable, optional
        Of `schlick_table`; the default one if none is given.

    Returns
    -------
    SplitAlbedo

    Raises
    ------
    InputError
        For other shapes, values that are not finite, and tables of other than three terms.
    """
    f0 = _three("f0", f0)
    bend = np.zeros(3) if f82 is None else bend_factor(f0, _three("f82", f82))
    return SplitAlbedo(table or schlick_table(), np.stack([f0, np.ones(3), bend], axis=-1))


def _three(name: str, value: ArrayLike) -> np.ndarray:
    array = np.asarray(value)
    if array.dtype.kind not in "fiu" or array.shape not in ((), (1,), (3,)):
        given = f"{name}: {array.dtype} array of shape {array.shape}"
    elif not np.isfinite(array).all():
        given = f"{name}={array.tolist()}"
    else:
        return np.broadcast_to(array.astype(np.float64), 3)
    raise input_error(
        given, "three finite numbers, or one", "Reflectances of linear red, green and blue."
    )


@dataclass(frozen=True, eq=False)
class CompensatedAlbedo:
    """Directional albedo with multiple scattering; made by `compensated_albedo`."""

    energy: EnergyTable
    coefficients: Any

    def __call__(self, mu: Any, alpha: Any) -> Any:
        """(..., 3) float array, or a tuple of three Dr.Jit arrays; see `SplitAlbedo`."""
        single = SplitAlbedo(self.energy.table, self.coefficients)
        functions = single.table.lookup(mu, alpha)
        plain = single(mu, alpha)
        if not is_drjit(mu, alpha):
            rows = np.asarray(self.coefficients, np.float64)
            alphas = np.asarray(alpha)[..., None]
            factor = self.energy.factor(rows, np.broadcast_to(alphas, (*alphas.shape[:-1], 3)))
            return plain * scaling(functions[..., :1], factor).astype(plain.dtype)
        kind = type(functions[0])
        factors = (
            self.energy.factor([of_kind(kind, c) for c in row], alpha) for row in self.coefficients
        )
        share = missing(functions[0]) / functions[0]
        return tuple(f * (1.0 + k * share) for f, k in zip(plain, factors, strict=True))


def compensated_albedo(energy: EnergyTable, coefficients: Any) -> CompensatedAlbedo:
    """Albedo of a material, scaled by 1 + K (1 - E) / E: what `energy` puts back.

    The plugin with `energy_compensation` has this albedo, with either kind of compensation. K is
    the same for all pixels of a surface of one roughness and colour.

    Parameters
    ----------
    energy : EnergyTable
    coefficients : (3, terms) float, or three sequences of `terms` Dr.Jit arrays
        As for `SplitAlbedo`.

    Raises
    ------
    InputError
        As `SplitAlbedo` does.

    Examples
    --------
    >>> from fresnel_decomp import AlbedoTable, load_basis
    >>> from fresnel_decomp.energy import EnergyTable
    >>> basis = load_basis()
    >>> energy = EnergyTable.of(AlbedoTable.bake(basis, size=16), basis)
    >>> white = compensated_albedo(energy, [[1.0, 0.0, 0.0, 0.0]] * 3)
    >>> white(0.5, 0.6).round(6).tolist()
    [1.0, 1.0, 1.0]
    """
    SplitAlbedo(energy.table, coefficients)  # checks them
    return CompensatedAlbedo(energy, coefficients)


def integrated_albedo(
    curve: Callable[[Any], Any],
    alpha: float,
    smith: Smith = "separable",
    *,
    cosines: int = _COSINES,
) -> SplitAlbedo:
    """Albedo of any curve at one roughness, by `directional_albedo` at 1,025 cosines.

    Parameters
    ----------
    curve : callable from (..., 1) cosines to (..., 3) reflectances
        Such as `Exact(eta, k)` with (3,) indices.
    alpha : float ≥ 0
        The result is for this roughness, whatever it is called with.
    smith : {"separable", "correlated"}
    cosines : int ≥ 2
        Between them the albedo is interpolated; 65 are enough for a preview, and quick.

    Returns
    -------
    SplitAlbedo

    Raises
    ------
    InputError
        For other roughnesses, conventions and numbers of cosines.
    """
    if not is_real(alpha, 0.0, sys.float_info.max):
        raise input_error(
            f"alpha={alpha!r}", "a finite number ≥ 0", "It is the square of the perceptual."
        )
    layout = Layout(cosines, 2)
    root = np.linspace(0.0, 1.0, layout.width)
    values = directional_albedo(
        lambda cos_theta: curve(cos_theta[..., None]), root * root, float(alpha), smith=smith
    )
    table = AlbedoTable(np.stack([values, values]), layout, smith)  # both rows alike
    return SplitAlbedo(table, np.eye(3))


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

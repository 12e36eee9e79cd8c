r"""The light term of the split-sum: an environment blurred by GGX, one map per roughness.

Karis 2013, "Real Shading in Unreal Engine 4", takes the light out of the reflection integral at
N = V = R. There GGX's normals have the density D(n·h) (n·h) / (4 v·h) = D / 4 per solid angle of
light, so that with the usual weight n·l

    L(R) = ∫ Le(l) K(R·l) dl / ∫ K(R·l) dl,    K(cos g) = D(cos g/2) max(cos g, 0)

depends on the angle g to R alone: a convolution on the sphere. It is computed as such, on the grid
of the map: along parallels by Fourier transforms, over parallels by summation. There is no noise
and no choice of samples, and in the limit of a fine grid it is the integral itself: the kernel is
analytic up to the horizon, where it ends at 0, so sums over a grid finer than its width converge
fast. Where the kernel is narrower than a texel, the grid is refined and the map interpolated.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._array import drjit_constant, drjit_module, is_drjit
from .._check import input_error, is_real, is_whole
from .._vectors import as_vector, as_vectors
from ..table_layout import Layout
from .environment import Environment, fetch, row_weights

__all__ = ["PrefilteredLight", "prefilter", "split_light"]

LEVELS = 25
"""Maps by default: perceptual roughness 0, 1/24, ..., 1."""

_FINENESS = 8.0  # texels per alpha in a blurred map: interpolation errs below 1/500 of a peak
_PRECISION = 3.0  # nodes of the sum per alpha: between texels the map is not 0 but interpolated
_LARGEST = 1024  # columns of a refined grid: what is narrower, the result cannot show
_SMALLEST = 16
_BLOCK = 16  # parallels at once: matrix products instead of sums, in bounded memory


@dataclass(frozen=True, eq=False)
class PrefilteredLight:
    """An environment and its blurred maps.

    Attributes
    ----------
    name : str
    levels : tuple of (M_i, N_i, 3) float32 arrays
        In the layout of `environment`; level i has perceptual roughness i / (len(levels) - 1), and
        the first is the environment itself.
    """

    name: str
    levels: tuple[NDArray[np.float32], ...]

    @property
    def alphas(self) -> NDArray[np.float64]:
        """(L,) float64: roughness of each level."""
        return np.linspace(0.0, 1.0, len(self.levels)) ** 2

    def lookup(self, direction: Any, alpha: Any) -> Any:
        """Blurred radiance around a direction: bilinear in two levels, linear between them.

        Parameters
        ----------
        direction : (..., 3) float array, or three Dr.Jit arrays, as `mi.Vector3f` has them
            The mirror direction, unit length.
        alpha : (...) float in [0, 1]
            Roughness; clamped. Between levels it counts by its square root, as in `Layout`.

        Returns
        -------
        (..., 3) float array, or a tuple of three Dr.Jit arrays if an argument is one; NaN where the
        direction or alpha is. Differentiable in both, in alpha also at 0 and 1.

        Raises
        ------
        InputError
            For directions without three components, and for arrays of NumPy together with Dr.Jit's.
        """
        (direction,) = as_vectors(alpha, direction=direction)
        if isinstance(direction, tuple):
            return self._lookup_drjit(direction, alpha)
        data, layout = self._packed
        position = self._position(np.asarray(alpha))
        lower = np.minimum(np.nan_to_num(position).astype(np.int64), len(self.levels) - 2)
        t = (position - lower)[..., None]
        xyz = np.moveaxis(direction, -1, 0)
        smooth, rough = (
            np.stack(fetch(data, *(column[level] for column in layout), *xyz), axis=-1)
            for level in (lower, lower + 1)
        )
        return smooth + t * (rough - smooth)

    def _position(self, alpha: Any) -> Any:
        """Fractional level of alpha, on the axis that tables have too."""
        return Layout(2, len(self.levels)).texel(0.0, alpha)[1]

    @functools.cached_property
    def _packed(self) -> tuple[NDArray[np.float32], tuple[NDArray[np.int64], ...]]:
        """All levels in one array; first texel, height and width of each."""
        heights = np.array([len(level) for level in self.levels])
        widths = np.array([level.shape[1] for level in self.levels])
        offsets = np.cumsum(heights * widths) - heights * widths
        return np.concatenate([level.ravel() for level in self.levels]), (offsets, heights, widths)

    @functools.cached_property
    def _on_device(self) -> dict[Any, Any]:
        return {}

    def _lookup_drjit(self, direction: Any, alpha: Any) -> Any:
        dr = drjit_module()
        assert dr is not None
        kind = type(direction[0])
        index = dr.int32_array_t(kind)
        if kind not in self._on_device:
            data, layout = self._packed
            self._on_device[kind] = (
                drjit_constant(kind, data),
                [drjit_constant(index, c) for c in layout],
            )
        texels, tables = self._on_device[kind]
        position = self._position(alpha if is_drjit(alpha) else kind(float(alpha)))
        known = dr.select(dr.isnan(position), 0.0, dr.detach(position))
        lower = dr.minimum(index(known), len(self.levels) - 2)
        t = position - kind(lower)
        smooth, rough = (
            fetch(texels, *(dr.gather(index, table, level) for table in tables), *direction)
            for level in (lower, lower + 1)
        )
        return tuple(a + t * (b - a) for a, b in zip(smooth, rough, strict=True))


def prefilter(
    environment: Environment,
    levels: int = LEVELS,
    progress: Callable[[float], None] | None = None,
) -> PrefilteredLight:
    """Blur an environment for all roughnesses.

    Parameters
    ----------
    environment : Environment
        512 columns are enough for shading; wider ones take minutes.
    levels : int, 2 to 4096
        Maps, the environment itself included; uniform in perceptual roughness.
    progress : callable, optional
        Called with the fraction done after each level.

    Returns
    -------
    PrefilteredLight

    Raises
    ------
    InputError
        For another number of levels.

    Examples
    --------
    >>> from fresnel_decomp.mitsuba.skies import city
    >>> light = prefilter(city(32), levels=3)
    >>> [level.shape for level in light.levels]
    [(16, 32, 3), (16, 32, 3), (16, 32, 3)]
    """
    if not is_whole(levels, 2, 4096):
        raise input_error(
            f"levels={levels!r}", "an integer from 2 to 4096", f"{LEVELS} are the default."
        )
    maps = [environment.radiance]
    for i in range(1, levels):
        alpha = (i / (levels - 1)) ** 2
        width, wanted = environment.width, max(2.0 * math.pi * _FINENESS / alpha, _SMALLEST)
        while width % 4 == 0 and width // 2 >= wanted:
            width //= 2
        maps.append(blurred(environment, alpha, width))
        if progress is not None:
            progress(i / (levels - 1))
    return PrefilteredLight(environment.name, tuple(maps))


def blurred(
    environment: Environment, alpha: float, width: int | None = None
) -> NDArray[np.float32]:
    """(width // 2, width, 3) float32: the environment convolved with the kernel of one roughness.

    Parameters
    ----------
    environment : Environment
    alpha : float in (0, 1]
    width : int
        Columns of the result, an even divisor of the environment's, by default all of them.

    Raises
    ------
    InputError
        For other roughnesses and widths.
    """
    from scipy.fft import dct

    if not is_real(alpha, 0.0, 1.0) or alpha == 0.0:
        raise input_error(f"alpha={alpha!r}", "a number in (0, 1]", "At 0 the map is as it is.")
    width = environment.width if width is None else width
    if not is_whole(width, 4) or width % 2 or environment.width % width:
        raise input_error(
            f"width={width!r}",
            f"an even divisor of {environment.width}, at least 4",
            "The environment's own width always works.",
        )
    spacing = 2.0 * math.pi / environment.width
    refine = min(math.ceil(_PRECISION * spacing / alpha), max(1, _LARGEST // environment.width))
    fine = _refined(environment.radiance.astype(np.float64), refine)
    rows, columns, _ = fine.shape
    weights = row_weights(rows)
    order = np.arange(columns // 2 + 1)
    # from the first column of the environment to that of the result
    shift = np.exp(1j * order * np.pi * (1.0 / width - 1.0 / environment.width))
    spectrum = np.fft.rfft(fine * weights[:, None, None], axis=1) * shift[:, None]
    spectrum = np.ascontiguousarray(np.moveaxis(spectrum, 1, 0)).view(np.float64)

    sine_turn = np.sin(np.pi * order / columns) ** 2
    polar = np.linspace(0.0, np.pi, rows)
    height = width // 2
    result = np.empty((height, width, 3))
    for first in range(0, (height + 1) // 2, _BLOCK):
        targets = np.arange(first, min(first + _BLOCK, (height + 1) // 2))
        factors = np.empty((len(order), len(targets), rows))
        for i, row in enumerate(targets):
            angle = np.pi * row / (height - 1)
            # sin² of half the angle between the two directions: no cancellation near 0
            sine = np.sin(0.5 * (polar - angle))[:, None] ** 2
            sine = sine + (np.sin(polar) * np.sin(angle))[:, None] * sine_turn
            factors[:, i] = dct(_kernel(sine, alpha), type=1, axis=1).T  # even in the turn
        # the opposite parallel sees the same kernel upside down
        for rows_done, kernels in (
            (targets, factors),
            (height - 1 - targets, factors[:, :, ::-1]),
        ):
            products = np.matmul(kernels, spectrum).view(np.complex128)
            products /= (kernels[0] @ weights)[:, None]
            result[rows_done] = _evaluated(np.moveaxis(products, 0, 1), columns, width)
    return np.maximum(result, 0.0).astype(np.float32)


def _kernel(sine: NDArray[np.float64], alpha: float) -> NDArray[np.float64]:
    """D(h) n·l up to a factor, from sin² of the angle between the normal and the half vector."""
    cos_light = np.maximum(1.0 - 2.0 * sine, 0.0)
    return cos_light / (alpha * alpha * (1.0 - sine) + sine) ** 2


def _refined(radiance: NDArray[np.float64], factor: int) -> NDArray[np.float64]:
    """The map on a grid `factor` times as fine that has the texels among its nodes."""
    if factor == 1:
        return radiance
    t = (np.arange(factor) / factor)[:, None]
    following = np.roll(radiance, -1, axis=1)
    wide = radiance[:, :, None] + t * (following - radiance)[:, :, None]
    wide = wide.reshape(len(radiance), -1, 3)
    tall = wide[:-1, None] + t[:, None] * (wide[1:] - wide[:-1])[:, None]
    return np.concatenate([tall.reshape(-1, wide.shape[1], 3), wide[-1:]])


def _evaluated(half: NDArray[np.complex128], columns: int, width: int) -> NDArray[np.float64]:
    """Trigonometric polynomials at `width` points, a divisor of the `columns` that they had.

    half is (rows, columns // 2 + 1, 3), the half spectrum; the result (rows, width, 3).
    """
    if width == columns:
        return np.fft.irfft(half, columns, axis=1)
    negative = np.conj(half[:, 1 : columns - half.shape[1] + 1][:, ::-1])
    full = np.concatenate([half, negative], axis=1)
    # waves that agree at the points add up
    folded = full.reshape(len(half), -1, width, 3).sum(axis=1)
    return np.fft.ifft(folded, axis=1).real * (width / columns)


def split_light(
    environment: Environment, direction: Sequence[float], alpha: float, samples: int = 2**18
) -> NDArray[np.float64]:
    """The same light term for one direction by quasi-Monte Carlo.

    An estimator that has nothing in common with `prefilter`, to compare with: Sobol points become
    GGX normals about the direction, mirrored light is weighted by its cosine (Karis 2013).

    Parameters
    ----------
    environment : Environment
    direction : (3,) float
        The mirror direction, of any length but 0.
    alpha : float in [0, 1]
    samples : int, ≥ 1
        Powers of 2 are best.

    Returns
    -------
    (3,) float64 array

    Raises
    ------
    InputError
        For what is no direction, and for other roughnesses and numbers of samples.

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp.mitsuba.environment import Environment
    >>> uniform = Environment(np.full((4, 8, 3), 0.5))
    >>> split_light(uniform, [0, 1, 0], alpha=0.3, samples=256).round(6).tolist()
    [0.5, 0.5, 0.5]
    """
    from scipy.stats import qmc

    towards = as_vector(direction)
    if isinstance(towards, tuple) or towards.shape != (3,) or not 0.0 < towards @ towards < np.inf:
        raise input_error(
            f"direction={' '.join(repr(direction).split())}",
            "three finite numbers, not all 0",
            "One direction at a time.",
        )
    if not is_real(alpha, 0.0, 1.0):
        raise input_error(f"alpha={alpha!r}", "a number in [0, 1]", "GGX's roughness.")
    if not is_whole(samples, 1):
        raise input_error(f"samples={samples!r}", "an integer ≥ 1", "2**18 is the default.")
    points = qmc.Sobol(2, scramble=True, rng=0).random(samples)
    forward = np.asarray(direction, np.float64)
    forward = forward / np.linalg.norm(forward)
    side = np.cross(forward, [0.0, 0.0, 1.0] if abs(forward[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    slope = alpha * np.sqrt(points[:, 0] / (1.0 - points[:, 0]))
    half = 2.0 * np.arctan(slope)
    turn = 2.0 * np.pi * points[:, 1]
    light = np.cos(half)[:, None] * forward + np.sin(half)[:, None] * (
        np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * np.cross(forward, side)
    )
    weight = np.maximum(np.cos(half), 0.0)
    return (weight[:, None] * environment.lookup(light)).sum(axis=0) / weight.sum()

"""A sphere by the split-sum, in milliseconds: what a slider can move.

Where light comes from and which way the surface faces do not change with the material. Both are
looked up once, so that another metal costs one product per pixel, and another roughness one more
lookup of the light.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import input_error, is_real, is_whole
from .prefilter import PrefilteredLight, prefilter
from .skies import city

__all__ = ["SpherePreview"]

_SIDE = 2  # samples along each side of a pixel


def _city() -> PrefilteredLight:
    return prefilter(city(128), levels=13)


@dataclass(frozen=True, eq=False)
class SpherePreview:
    """A sphere seen from far away, in a light that is blurred once.

    Attributes
    ----------
    size : int
        Pixels along each side of the picture.
    light : PrefilteredLight
        By default a small `skies.city`, which takes half a second to make.
    background : float
        Radiance around the sphere; 1 is the white of a page.

    Raises
    ------
    InputError
        For other sizes than integers from 2 on.

    Examples
    --------
    >>> from fresnel_decomp import AlbedoTable, load_basis
    >>> from fresnel_decomp.split_albedo import SplitAlbedo
    >>> basis = load_basis()
    >>> table = AlbedoTable.bake(basis, size=16)
    >>> sphere = SpherePreview(32)
    >>> gold = SplitAlbedo(table, basis.coefficients([0.13, 0.43, 1.38], [3.9, 2.5, 1.9]))
    >>> sphere(gold, alpha=0.2).shape
    (32, 32, 3)
    """

    size: int = 96
    light: PrefilteredLight = field(default_factory=_city)
    background: float = 1.0
    _lit: dict[float, NDArray[np.float64]] = field(default_factory=dict, init=False, repr=False)
    _inside: NDArray[np.bool_] = field(init=False, repr=False)
    _mu: NDArray[np.float64] = field(init=False, repr=False)
    _mirrored: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not is_whole(self.size, 2):
            raise input_error(f"size={self.size!r}", "an integer ≥ 2", "96 is quick.")
        across = (np.arange(_SIDE * self.size) + 0.5) / (_SIDE * self.size) * 2.0 - 1.0
        x, y = np.meshgrid(across, -across)
        inside = np.hypot(x, y) < 1.0
        x, y = x[inside], y[inside]
        mu = np.sqrt(1.0 - x * x - y * y)
        mirrored = np.stack([2.0 * mu * x, 2.0 * mu * y, 2.0 * mu * mu - 1.0], axis=-1)
        for name, value in (("_inside", inside), ("_mu", mu), ("_mirrored", mirrored)):
            object.__setattr__(self, name, value)

    def __call__(self, albedo: Callable[[Any, Any], Any], alpha: float) -> NDArray[np.float32]:
        """The picture of a material.

        Parameters
        ----------
        albedo : callable (mu, alpha) to (..., 3)
            Such as a `split_albedo.SplitAlbedo`.
        alpha : float in [0, 1]

        Returns
        -------
        (size, size, 3) float32, linear sRGB

        Raises
        ------
        InputError
            For another roughness.
        """
        if not is_real(alpha, 0.0, 1.0):
            raise input_error(
                f"alpha={alpha!r}", "a number in [0, 1]", "It is the square of the perceptual."
            )
        side = len(self._inside)
        fine = np.full((side, side, 3), float(self.background))
        fine[self._inside] = self._light(float(alpha)) * albedo(self._mu, float(alpha))
        pixels = fine.reshape(self.size, _SIDE, self.size, _SIDE, 3).mean(axis=(1, 3))
        return pixels.astype(np.float32)

    def _light(self, alpha: float) -> NDArray[np.float64]:
        if alpha not in self._lit:
            self._lit.clear()  # of the last roughness only
            self._lit[alpha] = self.light.lookup(self._mirrored, alpha)
        return self._lit[alpha]

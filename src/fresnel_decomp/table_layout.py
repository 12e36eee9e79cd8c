"""Which view angle and roughness each texel of a table stands for, and where to look them up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from ._array import Ops, ops_for
from ._check import choose, input_error, is_whole

__all__ = ["ADDRESSING", "ALPHA_AXES", "MU_AXES", "Layout"]


class _Axis(NamedTuple):
    """A coordinate in [0, 1] of a quantity in [0, 1], and back."""

    forward: Callable[[Ops, Any], Any]
    inverse: Callable[[np.ndarray], np.ndarray]


_LEAST = 1e-8


def _root(ops: Ops, x: Any) -> Any:
    # linear below _LEAST, since no gradient survives the infinite slope at 0; 2e-5 of a texel off
    steep = x < _LEAST
    safe = ops.select(steep, 1.0, x)
    return ops.select(steep, x * _LEAST**-0.5, ops.sqrt(safe))


def _elevation(ops: Ops, mu: Any) -> Any:
    # 1 - 2 theta / pi; by the complement, whose slope is infinite at 1, linear from there
    rest = 1.0 - mu
    steep = rest < _LEAST
    angle = ops.arccos(ops.select(steep, 0.0, mu))
    return 1.0 - (2.0 / np.pi) * ops.select(steep, rest * (2.0 / _LEAST) ** 0.5, angle)


MU_AXES = {
    "sqrt_mu": _Axis(_root, lambda x: x * x),
    "mu": _Axis(lambda ops, mu: mu, lambda x: x),
    "theta": _Axis(_elevation, lambda x: np.sin(0.5 * np.pi * x)),
}
"""Horizontal axes, 0 at grazing and 1 at normal incidence: the root of the cosine, the cosine, and
1 - 2 theta / pi."""

ALPHA_AXES = {
    "perceptual_roughness": _Axis(_root, lambda y: y * y),
    "alpha": _Axis(lambda ops, alpha: alpha, lambda y: y),
}
"""Vertical axes, from smooth to rough; perceptual roughness is the root of alpha."""

ADDRESSING = ("centres", "edges")
"""Where 0 and 1 lie: on the centres of the outer texels, or on the edges of the texture."""


@dataclass(frozen=True)
class Layout:
    """Which view angle and roughness a texel stands for.

    Attributes
    ----------
    width, height : int, 2 to 4096
        Texels along mu and along alpha.
    mu_axis : one of `MU_AXES`
    alpha_axis : one of `ALPHA_AXES`
    addressing : {"centres", "edges"}
        With "centres" texel i of n stands for i / (n - 1), with "edges" for (i + 1/2) / n, and
        lookups nearer to the edge are clamped.

    Raises
    ------
    InputError
        For sizes out of range, and unknown axes or addressing.

    Examples
    --------
    >>> from fresnel_decomp.table_layout import Layout
    >>> Layout(5, 5).mu.tolist()
    [0.0, 0.0625, 0.25, 0.5625, 1.0]
    """

    width: int = 64
    height: int = 64
    mu_axis: str = "sqrt_mu"
    alpha_axis: str = "perceptual_roughness"
    addressing: Literal["centres", "edges"] = "centres"

    def __post_init__(self) -> None:
        choose("mu_axis", self.mu_axis, MU_AXES)
        choose("alpha_axis", self.alpha_axis, ALPHA_AXES)
        choose("addressing", self.addressing, ADDRESSING)
        given = f"a table of {self.width} x {self.height} texels"
        for name in ("width", "height"):
            size = getattr(self, name)
            if not is_whole(size, 2, 4096):
                raise input_error(
                    given,
                    "whole numbers from 2 to 4096",
                    "64 x 64 is enough; see the documentation, Preintegration.",
                )
            object.__setattr__(self, name, int(size))

    @property
    def mu(self) -> np.ndarray:
        """(width,) cosines of the columns."""
        return MU_AXES[self.mu_axis].inverse(self._centres(self.width))

    @property
    def alpha(self) -> np.ndarray:
        """(height,) roughnesses of the rows."""
        return ALPHA_AXES[self.alpha_axis].inverse(self._centres(self.height))

    def _centres(self, size: int) -> np.ndarray:
        if self.addressing == "centres":
            return np.linspace(0.0, 1.0, size)
        return (np.arange(size) + 0.5) / size

    def texel(self, mu: Any, alpha: Any) -> tuple[Any, Any]:
        """Fractional column and row of mu and alpha: whole numbers at the centres of texels.

        Both are clamped to [0, 1] before, and the results to the centres of the outer texels.
        """
        return (
            self._position(mu, MU_AXES[self.mu_axis], self.width),
            self._position(alpha, ALPHA_AXES[self.alpha_axis], self.height),
        )

    def _position(self, value: Any, axis: _Axis, size: int) -> Any:
        if isinstance(value, int | float):
            return float(self._position(np.asarray(value, np.float64), axis, size))
        ops = ops_for(value)
        # selected and not clipped: at the ends of [0, 1] derivatives pass
        inside = ops.select(value < 0.0, 0.0, ops.select(value > 1.0, 1.0, value))
        coordinate = axis.forward(ops, inside)
        if self.addressing == "centres":
            return ops.select(coordinate > 1.0, 1.0, coordinate) * float(size - 1)
        position = coordinate * float(size) - 0.5
        last = float(size - 1)
        return ops.select(position < 0.0, 0.0, ops.select(position > last, last, position))

    def texture_coordinates(self, mu: Any, alpha: Any) -> tuple[Any, Any]:
        """(u, v) in [0, 1] for a bilinear texture lookup with clamped addressing."""
        column, row = self.texel(mu, alpha)
        return (column + 0.5) / float(self.width), (row + 0.5) / float(self.height)

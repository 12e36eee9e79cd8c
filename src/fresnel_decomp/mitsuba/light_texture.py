"""The light term of the split-sum in Mitsuba, as one texture: a single fetch for all roughnesses.

`PrefilteredLight` keeps every blurred map in the size that it needs, which takes many reads to
interpolate. Here all maps have one size and are the layers of a three-dimensional texture, so that
a texture unit interpolates across and between them at once, as it does the mipmap of a game engine.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from .._check import input_error, is_whole
from ..table_layout import Layout
from .environment import map_angles, texel_directions
from .prefilter import PrefilteredLight
from .variants import active_variant

__all__ = ["LightTexture"]


class LightTexture:
    """A prefiltered light in one `mi.Texture3f` of the active variant.

    Parameters
    ----------
    light : PrefilteredLight
    width : int, optional
        Columns of every layer, even, at least 4; by default as many as the sharpest map has. Maps
        of another size are interpolated, those of this size are taken as they are.
    use_accel : bool
        Fetch with the texture units of a GPU. They interpolate with 8 bits of fraction, which costs
        up to 1/512 of the difference between neighbouring texels along each of the three axes; off
        by default.

    Attributes
    ----------
    light : PrefilteredLight
        The layers: what `lookup` returns, up to rounding, this light's own `lookup` returns too.

    Raises
    ------
    InputError
        If no variant is set, and for another width.

    Examples
    --------
    >>> import mitsuba as mi
    >>> mi.set_variant("scalar_rgb")
    >>> from fresnel_decomp.mitsuba.skies import city
    >>> from fresnel_decomp.mitsuba.light_texture import LightTexture
    >>> from fresnel_decomp.mitsuba.prefilter import prefilter
    >>> light = LightTexture(prefilter(city(32), levels=3))
    >>> len(light.lookup([0.0, 1.0, 0.0], 0.5))
    3
    """

    def __init__(
        self, light: PrefilteredLight, width: int | None = None, use_accel: bool = False
    ) -> None:
        active_variant()
        width = light.levels[0].shape[1] if width is None else width
        if not is_whole(width, 4) or width % 2:
            raise input_error(
                f"width={width!r}", "an even integer ≥ 4", "256 is enough for most lights."
            )
        self.light = PrefilteredLight(light.name, tuple(_layers(light, width)))
        layers = np.stack(self.light.levels)
        # one more column on either side, which is that of the other: the map has no left edge
        layers = np.concatenate([layers[:, :, -1:], layers, layers[:, :, :1]], axis=2)
        padded = np.pad(layers, ((0, 0), (0, 0), (0, 0), (0, 1)))
        self._levels, self._height, self._width = len(layers), layers.shape[1], width
        self._texture = mi.Texture3f(
            mi.TensorXf(np.ascontiguousarray(padded)),
            use_accel=use_accel,
            filter_mode=dr.FilterMode.Linear,
            wrap_mode=dr.WrapMode.Clamp,
        )

    def lookup(self, direction: Any, alpha: Any, active: Any = True) -> tuple[Any, Any, Any]:
        """Blurred radiance around a direction, as `PrefilteredLight.lookup` gives it.

        Parameters
        ----------
        direction : mi.Vector3f, or three mi.Float
            The mirror direction, unit length.
        alpha : mi.Float
            Roughness, clamped to [0, 1].
        active : mi.Bool

        Returns
        -------
        tuple of three mi.Float: red, green and blue
        """
        x, y, z = (mi.Float(part) for part in direction)
        turn, polar = map_angles(x, y, z)
        u = (turn - dr.floor(turn)) * self._width + 1.0
        v = polar * (self._height - 1.0) + 0.5
        _, w = Layout(2, self._levels).texture_coordinates(0.0, mi.Float(alpha))
        position = mi.Point3f(u / (self._width + 2.0), v / float(self._height), w)
        red, green, blue, _ = self._texture.eval(position, active)
        return red, green, blue


def _layers(light: PrefilteredLight, width: int) -> list[np.ndarray]:
    """The maps of a light with so many columns each."""
    directions = texel_directions(width)
    return [
        level if level.shape[1] == width else light.lookup(directions, alpha).astype(np.float32)
        for level, alpha in zip(light.levels, light.alphas.tolist(), strict=True)
    ]

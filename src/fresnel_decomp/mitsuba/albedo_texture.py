"""The preintegrated table in Mitsuba: as textures of Dr.Jit, and as a scene's `bitmap` textures."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..table import AlbedoTable
from .variants import active_variant

__all__ = ["AlbedoTexture", "bitmap_textures"]


class AlbedoTexture:
    """An albedo table in one or two `mi.Texture2f` of the active variant.

    They have four channels, or two where the table has no more.

    Parameters
    ----------
    table : AlbedoTable
    use_accel : bool
        Fetch with the texture units of a GPU. They interpolate with 8 bits of fraction, which costs
        up to 1/512 of the difference between neighbouring texels; off by default.

    Raises
    ------
    InputError
        If no variant is set.

    Examples
    --------
    >>> import mitsuba as mi
    >>> mi.set_variant("scalar_rgb")
    >>> from fresnel_decomp import AlbedoTable, load_basis
    >>> from fresnel_decomp.mitsuba.albedo_texture import AlbedoTexture
    >>> table = AlbedoTable.bake(load_basis(), size=16)
    >>> len(AlbedoTexture(table).lookup(0.5, 0.2))
    4
    """

    def __init__(self, table: AlbedoTable, use_accel: bool = False) -> None:
        active_variant()
        self.table = table
        self.textures = [
            mi.Texture2f(
                mi.TensorXf(np.ascontiguousarray(texture[..., : 2 if table.terms <= 2 else 4])),
                use_accel=use_accel,
                filter_mode=dr.FilterMode.Linear,
                wrap_mode=dr.WrapMode.Clamp,
            )
            for texture in table.textures()
        ]

    def lookup(self, mu: Any, alpha: Any, active: Any = True) -> tuple[Any, ...]:
        """Albedos of the basis functions, as `AlbedoTable.lookup` gives them.

        Parameters
        ----------
        mu, alpha : mi.Float
            Clamped to [0, 1].
        active : mi.Bool

        Returns
        -------
        tuple of mi.Float, one per term
        """
        u, v = self.table.layout.texture_coordinates(mi.Float(mu), mi.Float(alpha))
        uv = mi.Point2f(u, v)
        channels = [value for texture in self.textures for value in texture.eval(uv, active)]
        return tuple(channels[: self.table.terms])


def bitmap_textures(table: AlbedoTable) -> list[dict[str, Any]]:
    """The table as plugin dictionaries of `bitmap` textures, for scenes and integrators.

    A `bitmap` hands out three channels and drops the fourth, so it takes one texture per three
    terms. The coordinates are those of `Layout.texture_coordinates`; use `eval_3`.

    Returns
    -------
    list of dict for `mi.load_dict`
    """
    padded = np.pad(table.values, ((0, 0), (0, 0), (0, -table.terms % 3)))
    return [
        {
            "type": "bitmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(part), mi.Bitmap.PixelFormat.RGB),
            "raw": True,  # no colours: no conversion, in spectral variants either
            "filter_type": "bilinear",
            "wrap_mode": "clamp",
        }
        for part in np.split(padded, padded.shape[2] // 3, axis=2)
    ]

"""A diffuse base under a specular lobe that conserves energy and is reciprocal.

What the lobe does not reflect enters the base and, as far as the base does not absorb it, leaves
again: with E(mu) the directional albedo of the lobe and E_avg its cosine-weighted average, the base
of albedo rho is

    rho / pi (1 - E(mu_i)) (1 - E(mu_o)) / (1 - E_avg)

(Kelemen and Szirmay-Kalos 2001). Lobe and base together reflect E + rho (1 - E): all of it for
rho = 1. E comes from the preintegrated table of the Fresnel term's own functions, so a diffuse base
costs two fetches and one of the average, whatever the material. A lobe that is compensated for
multiple scattering has another albedo; given that one, the same holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from ..microfacet import Distribution
from ..table import AlbedoTable
from .albedo_texture import AlbedoTexture

__all__ = ["LobeAlbedo", "cosine_average", "coupling", "total"]

_LEAST_AVERAGE = 1e-4
"""Of 1 - E_avg: lobes that reflect everything have no base to be seen."""

_baked: dict[tuple[str, str], AlbedoTable] = {}


def cosine_average(table: AlbedoTable) -> np.ndarray:
    """(height, terms): 2 ∫ bbar_i(mu) mu dmu of the table as it is interpolated.

    Exact, so that the average fits the directional albedos that a shader finds, not the true ones.
    """
    columns = np.sqrt(table.layout.mu)  # between which the interpolation is linear in the root
    nodes, weights = np.polynomial.legendre.leggauss(3)
    low, high = columns[:-1, None], columns[1:, None]
    root = (0.5 * (low + high) + 0.5 * (high - low) * nodes).ravel()
    measure = (0.5 * (high - low) * weights).ravel() * 4.0 * root**3  # 2 mu dmu
    values = table.lookup((root * root)[None], table.layout.alpha[:, None])
    return np.einsum("amt,m->at", values, measure)


class LobeAlbedo:
    """Directional and average albedos of GGX or Beckmann lobes, by functions of the Fresnel term.

    Parameters
    ----------
    functions : callable
        Takes (m,) cosines and returns one column of values for each function.
    key : str
        Tells one set of functions from others: each is integrated once in a process.
    distribution : {"ggx", "beckmann"}
    """

    def __init__(self, functions: Any, key: str, distribution: Distribution) -> None:
        table = _baked.get((key, distribution))
        if table is None:
            table = AlbedoTable.bake(functions, distribution=distribution)
            _baked[key, distribution] = table
        self._directional = AlbedoTexture(table)
        self._average = mi.Texture1f(
            mi.TensorXf(cosine_average(table).astype(np.float32)),
            use_accel=False,
            wrap_mode=dr.WrapMode.Clamp,
        )

    @property
    def textures(self) -> list[Any]:
        """What lookups read: an attribute of the plugin, for functions that Dr.Jit freezes."""
        return [*self._directional.textures, self._average]

    def directional(self, mu: Any, alpha: Any, active: Any = True) -> tuple[Any, ...]:
        """Albedos of the functions seen at cosine `mu`."""
        return self._directional.lookup(mu, alpha, active)

    def average(self, alpha: Any, active: Any = True) -> tuple[Any, ...]:
        """Their cosine-weighted averages."""
        _, v = self._directional.table.layout.texture_coordinates(mi.Float(1.0), mi.Float(alpha))
        return tuple(self._average.eval(mi.Float(v), active))


def total(weights: Sequence[Any], albedos: Sequence[Any]) -> Any:
    """Albedo of a Fresnel term: the sum over its functions, per channel."""
    result = weights[0] * albedos[0]
    for weight, albedo in zip(weights[1:], albedos[1:], strict=True):
        result = dr.fma(weight, mi.UnpolarizedSpectrum(albedo), result)
    return mi.UnpolarizedSpectrum(result)


def coupling(albedo_i: Any, albedo_o: Any, average: Any) -> Any:
    """(1 - E(mu_i)) (1 - E(mu_o)) / (1 - E_avg), the factor on a Lambertian base."""
    entering = dr.maximum(1.0 - albedo_i, 0.0) * dr.maximum(1.0 - albedo_o, 0.0)
    return entering / dr.maximum(1.0 - average, _LEAST_AVERAGE)

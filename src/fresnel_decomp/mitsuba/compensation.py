"""Energy compensation of the plugin: the formulas of `energy` at a shading point.

A plugin has one of these, which completes what single scattering gives:

- `Uncompensated`: leaves it as it is;
- `Scaling`: multiplies it by 1 + K (1 - E) / E of the view direction. Directions are sampled as
  before. Not symmetric in the directions;
- `Lobe`: adds the lobe of Kulla and Conty, in the colour of `energy`. Sampled with the probability
  1 - E, by the cosine; densities are those of the mixture. So the Fresnel term has no influence on
  sampling here either.
"""

from __future__ import annotations

import functools
import math
from typing import Any, ClassVar, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from .._check import choose, input_error
from ..energy import EnergyTable, gain, lobe, missing, scaling
from ..energy import weighted as weighted_sum
from ..microfacet import Distribution, Smith
from ..table import AlbedoTable
from .albedo_texture import AlbedoTexture

__all__ = ["Lobe", "Scaling", "Uncompensated", "chosen_compensation", "raised"]

_LEAST_COSINE = 1e-12
"""The squared tangent of a lower direction, and its derivatives, would leave float32."""


def raised(direction: Any) -> Any:
    """The direction, or one just above the horizon instead of one on or below it.

    What is computed from it is finite, with finite derivatives, also where it is discarded.
    """
    return mi.Vector3f(direction.x, direction.y, dr.maximum(direction.z, _LEAST_COSINE))


def chosen_compensation(props: Any, plugin: Any) -> Uncompensated:
    """What the properties `energy_compensation` and `compensation` ask for.

    Raises
    ------
    InputError
        For an unknown kind, and for a kind without `energy_compensation`.
    """
    wanted = bool(props.get("energy_compensation", False))
    kind = str(props.get("compensation", "lobe"))
    choose("compensation", kind, ("lobe", "scaling"))
    if "compensation" in props and not wanted:
        raise input_error(
            f"compensation='{kind}' without energy_compensation",
            "with energy_compensation = true",
            "Remove it, or switch energy_compensation on.",
        )
    if not wanted:
        return Uncompensated()
    return Lobe(plugin) if kind == "lobe" else Scaling(plugin)


class Uncompensated:
    """Single scattering as it is, and what all kinds have in common."""

    name: ClassVar[str] = "none"
    has_lobe: ClassVar[bool] = False

    def update(self, plugin: Any) -> None:
        """Follow a change of the roughness."""

    def complete(self, plugin: Any, si: Any, wi: Any, wo: Any, value: Any, active: Any) -> Any:
        """BSDF times cosine, given that of single scattering; `wi` is where the viewer is."""
        return value

    def mixed(self, plugin: Any, si: Any, wi: Any, wo: Any, density: Any, active: Any) -> Any:
        """Density of sampling `wo`, given that of single scattering."""
        return density

    def sample(
        self, plugin: Any, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any
    ) -> tuple[Any, Any]:
        """What `mi.BSDF.sample` returns, where `has_lobe`."""
        raise NotImplementedError


class _Averages(NamedTuple):
    """What does not depend on directions, at a shading point."""

    coefficients: Any  # of the functions in the table
    loss: Any  # L
    gain: Any  # G
    factor: Any  # K


class _Compensated(Uncompensated):
    """With a table of the functions that the Fresnel term is made of."""

    def __init__(self, plugin: Any) -> None:
        ggx = plugin.distribution == mi.MicrofacetType.GGX
        self.energy = _energy_table(
            plugin.term.functions, "ggx" if ggx else "beckmann", plugin.smith
        )
        self.albedos, self.losses = map(AlbedoTexture, (self.energy.table, self.energy.losses))

    def functions(self, plugin: Any, si: Any, w: Any, active: Any) -> tuple[Any, ...]:
        """E, bbar_1, ... seen from `w`."""
        alpha = plugin.alpha_u.eval_1(si, active)
        return self.albedos.lookup(mi.Frame3f.cos_theta(w), alpha, active)

    def loss_rows(self, plugin: Any, si: Any, active: Any) -> tuple[Any, ...]:
        """L, lambda_1, ..."""
        return self.losses.lookup(0.0, plugin.alpha_u.eval_1(si, active), active)

    def averages(self, plugin: Any, si: Any, active: Any) -> _Averages:
        coefficients = plugin.term.coefficients(*plugin.lookup.evaluate(si, active))
        average = weighted_sum(coefficients, [float(b) for b in self.energy.averages])
        loss, *ratios = self.loss_rows(plugin, si, active)
        strength = gain(average, loss)
        last = weighted_sum(coefficients, [1.0, *ratios])
        return _Averages(coefficients, loss, strength, strength * last)


class Scaling(_Compensated):
    """1 + K (1 - E) / E times single scattering."""

    name: ClassVar[str] = "scaling"

    def complete(self, plugin: Any, si: Any, wi: Any, wo: Any, value: Any, active: Any) -> Any:
        white = self.functions(plugin, si, wi, active)[0]
        factor = mi.UnpolarizedSpectrum(scaling(white, self.averages(plugin, si, active).factor))
        return value * factor  # a number for each wavelength, also of a Mueller matrix


class Lobe(_Compensated):
    """Single scattering, and F_1(i) F_1(o) G (1 - E_i)(1 - E_o) / (pi L)."""

    name: ClassVar[str] = "lobe"
    has_lobe: ClassVar[bool] = True

    def complete(self, plugin: Any, si: Any, wi: Any, wo: Any, value: Any, active: Any) -> Any:
        average = self.averages(plugin, si, active)
        sides = [self.functions(plugin, si, w, active) for w in (wi, wo)]
        shape = lobe(*(missing(functions[0]) for functions in sides), average.loss)
        ends = [weighted_sum(average.coefficients, functions) / functions[0] for functions in sides]
        added = mi.UnpolarizedSpectrum(ends[0] * ends[1] * average.gain)
        added *= shape * mi.Frame3f.cos_theta(wo)
        if plugin.specular_reflectance is not None:
            added *= plugin.specular_reflectance.eval(si, active)
        if mi.is_polarized:  # whatever was polarised has met many microfacets
            added = mi.mueller.depolarizer(added)
        return value + dr.select(active, added, dr.zeros(mi.Spectrum))

    def mixed(self, plugin: Any, si: Any, wi: Any, wo: Any, density: Any, active: Any) -> Any:
        chance = self._chance(plugin, si, wi, active)
        diffuse = mi.Frame3f.cos_theta(wo) * (1.0 / math.pi)
        return dr.select(active, density + chance * (diffuse - density), 0.0)

    def _chance(self, plugin: Any, si: Any, wi: Any, active: Any) -> Any:
        """Probability of sampling the lobe: its share of what a perfect reflector reflects."""
        return missing(self.functions(plugin, si, wi, active)[0])

    def sample(
        self, plugin: Any, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any
    ) -> tuple[Any, Any]:
        bs, wi = dr.zeros(mi.BSDFSample3f), raised(si.wi)
        diffuse = sample1 < self._chance(plugin, si, wi, active)
        m, _ = plugin._microfacets(si, active).sample(wi, sample2)
        scattered = mi.warp.square_to_cosine_hemisphere(sample2)
        wo = dr.select(diffuse, scattered, mi.reflect(wi, m))
        # also not where m is NaN, as it can be for random numbers that are exactly 0
        active &= mi.Frame3f.cos_theta(wo) > 0.0
        bs.wo = dr.select(active, wo, mi.Vector3f(0.0))
        bs.eta = 1.0
        bs.sampled_component = 0
        bs.sampled_type = +mi.BSDFFlags.GlossyReflection
        wo = raised(wo)
        m = dr.select(diffuse, dr.normalize(wo + wi), m)
        value, density = plugin.value_and_density(ctx, si, wi, wo, m, active)
        active &= density > 0.0
        bs.pdf = dr.select(active, density, 0.0)
        weight = value / dr.select(active, density, 1.0)
        return bs, dr.select(active, weight, dr.zeros(mi.Spectrum))


@functools.lru_cache(maxsize=16)
def _energy_table(functions: Any, distribution: Distribution, smith: Smith) -> EnergyTable:
    table = AlbedoTable.bake(functions, smith=smith, distribution=distribution)
    return EnergyTable.of(table, functions)

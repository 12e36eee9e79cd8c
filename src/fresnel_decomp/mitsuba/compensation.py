"""Energy compensation of the plugin: the formulas of `energy` at a shading point.

A plugin has one of these, which completes what single scattering gives:

- `Uncompensated`: leaves it as it is;
- `Scaling`: multiplies it by 1 + K (1 - E) / E of the view direction. Directions are sampled as
  before. Not symmetric in the directions;
- `Lobe`: adds the lobe of Kulla and Conty, in the colour of `energy`. Sampled with the probability
  1 - E; densities are those of the mixture. So the Fresnel term has no influence on sampling here
  either.

Smooth surfaces lose light at grazing angles only, where sampling by the cosine would hit rarely,
with weights in the thousands. So the square q of the cosine has the density s² (1 + s²) / (q + s²)²
on [0, 1]; with s by distribution and roughness no weight exceeds 10 for alpha >= .01.
"""

from __future__ import annotations

import functools
import math
from typing import Any, ClassVar, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from .._check import choose, input_error
from .._coefficients import weighted_sum
from ..anisotropy import AnisotropicGrid
from ..energy import EnergyTable, gain, lobe, missing
from ..microfacet import Distribution, Smith
from .albedo_texture import AlbedoTexture
from .microfacet_lobe import raised
from .ranges import UNKNOWN_ALPHA, refuse_recording, value_range

__all__ = ["Lobe", "Scaling", "Uncompensated", "chosen_compensation"]


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


class _Isotropic:
    """Looks up a table by the one roughness of the plugin."""

    def __init__(self, energy: EnergyTable) -> None:
        self.albedos, self.losses = map(AlbedoTexture, (energy.table, energy.losses))

    def update(self, plugin: Any) -> None:
        pass

    def functions(self, plugin: Any, si: Any, w: Any, active: Any) -> tuple[Any, ...]:
        alpha = plugin.alpha_u.eval_1(si, active)
        # also where inactive: a masked fetch gives E = 0, by which is divided
        return self.albedos.lookup(mi.Frame3f.cos_theta(w), alpha)

    def loss_rows(self, plugin: Any, si: Any, active: Any) -> tuple[Any, ...]:
        return self.losses.lookup(0.0, plugin.alpha_u.eval_1(si, active))


class _Anisotropic:
    """Looks up a grid over the range of both roughnesses, which is baked when they are set."""

    def __init__(self, functions: Any, distribution: Distribution, smith: Smith) -> None:
        self.made_of = (functions, distribution, smith)
        self.ranges: Any = None

    def update(self, plugin: Any) -> None:
        refuse_recording(
            "new alpha_u and alpha_v with energy compensation",
            "updates outside of it, or one alpha",
        )
        textures = (plugin.alpha_u, plugin.alpha_v)
        ranges = [value_range(texture) or UNKNOWN_ALPHA for texture in textures]
        if ranges == self.ranges:
            return
        self.ranges, self.grid = ranges, _grid(*self.made_of, *ranges)
        n_u, n_v, azimuths, elevations, terms = self.grid.values.shape
        # azimuths of one alpha_v after the other: a texture has three dimensions at most
        volume = self.grid.values.reshape(n_u, n_v * azimuths, elevations, terms)
        modes = {"use_accel": False, "wrap_mode": dr.WrapMode.Clamp}
        self.albedos = mi.Texture3f(mi.TensorXf(np.ascontiguousarray(volume)), **modes)
        losses = self.grid.losses.transpose(1, 0, 2)  # u along x
        self.losses = mi.Texture2f(mi.TensorXf(np.ascontiguousarray(losses)), **modes)

    def _position(self, alpha: Any, ends: tuple[float, float], count: int) -> Any:
        """Between the first node, 0, and the last, count - 1."""
        scale = (count - 1) / (ends[1] - ends[0])
        root = dr.sqrt(dr.maximum(alpha, ends[0] * ends[0]))
        return dr.minimum((root - ends[0]) * scale, count - 1.0)

    def _positions(self, plugin: Any, si: Any, active: Any) -> tuple[Any, Any]:
        n_u, n_v = self.grid.values.shape[:2]
        return (
            self._position(plugin.alpha_u.eval_1(si, active), self.grid.root_u, n_u),
            self._position(plugin.alpha_v.eval_1(si, active), self.grid.root_v, n_v),
        )

    def functions(self, plugin: Any, si: Any, w: Any, active: Any) -> tuple[Any, ...]:
        n_u, n_v, azimuths, elevations, _ = self.grid.values.shape
        u, v = self._positions(plugin, si, active)
        steep = w.x * w.x + w.y * w.y < 1e-20  # no azimuth, and none is needed
        phi = dr.atan2(dr.abs(w.y), dr.select(steep, 1.0, dr.abs(w.x)))
        column = dr.sqrt(dr.clip(w.z, 0.0, 1.0)) * (elevations - 1.0)
        row = phi * ((azimuths - 1.0) / (0.5 * math.pi))
        row = dr.minimum(row, azimuths - 1.0)
        block = mi.Float(dr.minimum(mi.UInt32(dr.detach(v)), n_v - 2))

        def fetch(block: Any) -> list[Any]:
            point = mi.Point3f(
                (column + 0.5) / elevations,
                (block * azimuths + row + 0.5) / (n_v * azimuths),
                (u + 0.5) / n_u,
            )
            return list(self.albedos.eval(point))

        near, far = fetch(block), fetch(block + 1.0)
        part = v - block
        return tuple(dr.fma(b - a, part, a) for a, b in zip(near, far, strict=True))

    def loss_rows(self, plugin: Any, si: Any, active: Any) -> tuple[Any, ...]:
        n_u, n_v = self.grid.values.shape[:2]
        u, v = self._positions(plugin, si, active)
        return tuple(self.losses.eval(mi.Point2f((u + 0.5) / n_u, (v + 0.5) / n_v)))


class _Compensated(Uncompensated):
    """With a table of the functions that the Fresnel term is made of."""

    def __init__(self, plugin: Any) -> None:
        # not `term.functions` of a basis: other plugins have the same closed form, and its tables
        on_basis = plugin.fresnel in ("exact", "decomposition")
        functions = plugin.basis.closed_form if on_basis else plugin.term.functions
        made_of: Any = (functions, plugin.distribution, plugin.smith)
        self.energy = _energy_table(*made_of)
        isotropic = plugin.alpha_u is plugin.alpha_v
        self.tables: Any = _Isotropic(self.energy) if isotropic else _Anisotropic(*made_of)

    def update(self, plugin: Any) -> None:
        self.tables.update(plugin)

    def coefficients(self, plugin: Any, si: Any, active: Any) -> Any:
        """Of the functions in the table; the exact term is projected onto the basis."""
        values = plugin.lookup.evaluate(si, active)
        if plugin.fresnel != "exact":
            return plugin.term.weights(*values)
        basis = plugin.basis
        f0, *nodes = (plugin.term(float(np.cos(t)), *values) for t in (0.0, *basis.nodes))
        return basis.coefficients_from_reflectance(f0, nodes)

    def averages(self, plugin: Any, si: Any, active: Any) -> _Averages:
        coefficients = self.coefficients(plugin, si, active)
        average = weighted_sum(coefficients, [float(b) for b in self.energy.averages])
        loss, *ratios = self.tables.loss_rows(plugin, si, active)
        strength = gain(average, loss)
        last = weighted_sum(coefficients, [1.0, *ratios])
        return _Averages(coefficients, loss, strength, strength * last)


class Scaling(_Compensated):
    """1 + K (1 - E) / E times single scattering."""

    name: ClassVar[str] = "scaling"

    def complete(self, plugin: Any, si: Any, wi: Any, wo: Any, value: Any, active: Any) -> Any:
        white = self.tables.functions(plugin, si, wi, active)[0]
        # in scalar variants numbers are Python's, also after `energy`, which makes NumPy's of them
        share = mi.Float(missing(white)) / white
        factor = mi.UnpolarizedSpectrum(1.0 + self.averages(plugin, si, active).factor * share)
        if not mi.is_polarized:
            return value * factor
        for i in range(4):  # a factor for each wavelength, of every entry of a Mueller matrix
            for j in range(4):
                value[i, j] = value[i, j] * factor
        return value


class Lobe(_Compensated):
    """Single scattering, and F_1(i) F_1(o) G (1 - E_i)(1 - E_o) / (pi L)."""

    name: ClassVar[str] = "lobe"
    has_lobe: ClassVar[bool] = True

    def complete(self, plugin: Any, si: Any, wi: Any, wo: Any, value: Any, active: Any) -> Any:
        average = self.averages(plugin, si, active)
        sides = [self.tables.functions(plugin, si, w, active) for w in (wi, wo)]
        near, far = (missing(functions[0]) for functions in sides)
        shape = mi.Float(lobe(near, far, average.loss))
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
        cos, s2 = mi.Frame3f.cos_theta(wo), _spread(plugin, si, active)
        total = dr.fma(cos, cos, s2)
        scattered = cos * (1.0 / math.pi) * (s2 / total) * ((1.0 + s2) / total)
        return dr.select(active, density + chance * (scattered - density), 0.0)

    def _chance(self, plugin: Any, si: Any, wi: Any, active: Any) -> Any:
        """Probability of sampling the lobe: its share of what a perfect reflector reflects."""
        return mi.Float(missing(self.tables.functions(plugin, si, wi, active)[0]))

    def sample(
        self, plugin: Any, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any
    ) -> tuple[Any, Any]:
        bs, wi = dr.zeros(mi.BSDFSample3f), raised(si.wi)
        lobe_chosen = sample1 < self._chance(plugin, si, wi, active)
        m, _ = plugin.microfacets(si, active).sample(wi, sample2)
        s2 = _spread(plugin, si, active)
        square = sample2.x * s2 / (1.0 + s2 - sample2.x)
        sin_phi, cos_phi = dr.sincos(2.0 * math.pi * sample2.y)
        sin = dr.sqrt(dr.maximum(1.0 - square, 0.0))
        scattered = mi.Vector3f(sin * cos_phi, sin * sin_phi, dr.sqrt(square))
        wo = dr.select(lobe_chosen, scattered, mi.reflect(wi, m))
        # also not where m is NaN, as it can be for random numbers that are exactly 0
        active &= mi.Frame3f.cos_theta(wo) > 0.0
        bs.wo = dr.select(active, wo, mi.Vector3f(0.0))
        bs.eta = 1.0
        bs.sampled_component = 0
        bs.sampled_type = +mi.BSDFFlags.GlossyReflection
        wo = raised(wo)
        m = dr.select(lobe_chosen, dr.normalize(wo + wi), m)
        value, density = plugin.value_and_density(ctx, si, wi, wo, m, active)
        active &= density > 0.0
        bs.pdf = dr.select(active, density, 0.0)
        weight = value / dr.select(active, density, 1.0)
        return bs, dr.select(active, weight, dr.zeros(mi.Spectrum))


def _spread(plugin: Any, si: Any, active: Any) -> Any:
    """s² of the density of directions in the lobe: near the one of least variance."""
    alpha = plugin.alpha_u.eval_1(si, active)
    if plugin.alpha_u is not plugin.alpha_v:
        alpha = 0.5 * (alpha + plugin.alpha_v.eval_1(si, active))
    alpha = dr.detach(dr.maximum(alpha, 1e-6))  # also where inactive; any will do
    if plugin.distribution == "ggx":
        return alpha * (2.5 + 15.0 * alpha)
    square = alpha * alpha
    return square * (3.2 + 20.0 * square)


@functools.lru_cache(maxsize=16)
def _energy_table(functions: Any, distribution: Distribution, smith: Smith) -> EnergyTable:
    return EnergyTable.bake(functions, smith=smith, distribution=distribution)


@functools.lru_cache(maxsize=16)
def _grid(
    functions: Any, distribution: Distribution, smith: Smith, range_u: Any, range_v: Any
) -> AnisotropicGrid:
    return AnisotropicGrid.bake(functions, range_u, range_v, smith=smith, distribution=distribution)

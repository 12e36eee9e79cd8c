"""The BSDF plugin `decomposed_principled`: base colour, metallic, roughness, and a Fresnel term.

A surface is a mixture, by `metallic`, of two others: a rough metal, and a dielectric over a diffuse
base that receives what the dielectric does not reflect (`coupled_diffuse`). Both have the lobe of
`decomposed_conductor` at one roughness, so the mixture has it too, with the mixture of both Fresnel
terms: of their coefficients, in which all but the exact one are linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from .._check import input_error
from ..basis import load_basis
from ..metallic import dielectric_eta
from ..representations import DIELECTRIC_F0
from .coupled_diffuse import LobeAlbedo, coupling, total
from .fresnel_terms import Decomposition, Lossless, Material
from .microfacet_lobe import mueller, raised, weight_and_density
from .plugin import FresnelPlugin, derived
from .principled_metal import Metal, edge_parameters
from .ranges import check_range, refuse_recording
from .tabulation import tabulate

__all__ = ["LEAST_ALPHA", "LEAST_ROOT", "DecomposedPrincipled", "plugin_class"]

LEAST_ALPHA = 1e-3
"""What stands for a smoother surface, of roughness below 0.0316, as float32 asks for."""

_LEAST_ALBEDO = 1e-4
"""Of the lobe, when directions are chosen: it keeps a share of them."""

LEAST_ROOT = 1e-3
"""Square root of F0 below which the fit of the exact term's albedo fades out."""

_LEAST_SHARE = 0.02
"""Of the diffuse base: what the lobe's albedo counts for at least, when directions are chosen."""


class DecomposedPrincipled(FresnelPlugin):
    """Base colour, metallic and roughness, with a choice of Fresnel term.

    Mitsuba sees a class with these methods that derives from `mi.BSDF` of one variant; it is made
    by `plugin_class`. The surface reflects on its front side; `twosided` gives it another.

    Parameters
    ----------
    base_color : spectrum or texture in [0, 1]
        Albedo of the diffuse base, and reflectance of the metal at normal incidence (default 0.5).
        Both are mixed by `metallic`, so that F0 = (1 - metallic) dielectric_f0 + metallic
        base_color.
    metallic : float or texture in [0, 1]
        Share of metal (default 0). Between 0 and 1 reflectances are mixed, not parameters.
    roughness : float or texture in [0, 1]
        Perceptual roughness: alpha = roughness², at least 0.001 (default 0.5).
    dielectric_f0, or eta : float, spectrum or texture in [0, 1), or >= 1
        Reflectance of the dielectric at normal incidence (default 0.04), or its index of refraction
        relative to the outside.
    edge_color : spectrum or texture in [0, 1]
        Reflectance of the metal at cos = 1/7, about 82°. By default that which metals of this base
        colour usually have, see `fresnel_decomp.metallic`. Instead of it, one of:
    edge_color_1, edge_color_2, ... : spectrum or texture in [0, 1]
        Reflectance of the metal at the `terms - 2` nodes of the basis.
    edge_tint : float, spectrum or texture in [0, 1]
        Gulbrandsen's g, which together with the base colour gives an index of refraction.
    fresnel : {"decomposition", "exact", "schlick", "f82"}
        Fresnel term (default "decomposition"). "exact" takes no edge colours, since they do not
        determine an index; without `edge_tint` it takes 0.5. "schlick" ignores the edge.
    recipe, terms : str, int
        The basis, see `load_basis` (default "talk", 4); `recipe` may be the path of a file.
    distribution : {"ggx", "beckmann"}
        Distribution of microfacet normals (default "ggx").
    sample_visible : bool
        Sample visible normals only (default true).

    Notes
    -----
    Textures are looked up and then mapped to coefficients, so they may be of any kind; that of the
    dielectric is mapped when it is set, texel by texel. Images of roughness and metallic need
    `raw: true`, or Mitsuba takes them for colours in sRGB.

    A dielectric and its base reflect E + base_color (1 - E), where the lobe reflects E: all light
    if the base is white, up to the interpolation of the table and, with "exact", a fit of six
    terms. Light that microfacets of a *metal* would scatter more than once is lost, as in
    `roughconductor`.

    Nothing is clamped. Fits leave [0, 1] by their error, also where the index of the dielectric is
    nearly that of the outside, and metals do where the edge colour is one that no metal of this
    base colour has: an edge of 1 on a black metal reflects up to 1.2.

    In polarised variants the base and the fitted terms depolarise.

    Examples
    --------
    >>> import mitsuba as mi
    >>> mi.set_variant("scalar_rgb")
    >>> from fresnel_decomp.mitsuba import register
    >>> register()
    >>> copper = {"type": "rgb", "value": [0.955, 0.638, 0.538]}
    >>> bsdf = mi.load_dict(
    ...     {"type": "decomposed_principled", "base_color": copper, "metallic": 1.0,
    ...      "roughness": 0.3}
    ... )
    """

    def __init__(self, props: Any) -> None:
        mi.BSDF.__init__(self, props)
        self._set_fresnel(props, distribution="ggx")
        self._set_textures(props)
        self._set_albedo()
        self._set_flags()
        self._check(self.textures)
        self._project()

    # --- parameters ------------------------------------------------------------------------------

    def _set_textures(self, props: Any) -> None:
        self.textures = {
            "base_color": props.get_texture("base_color", 0.5),
            "metallic": props.get_texture("metallic", 0.0),
            "roughness": props.get_texture("roughness", 0.5),
        }
        if "eta" in props and "dielectric_f0" in props:
            raise input_error(
                "both eta and dielectric_f0", "one of them, or none", "Each follows from the other."
            )
        self.dielectric = "eta" if "eta" in props else "dielectric_f0"
        unbounded = self.dielectric == "eta"
        self.textures[self.dielectric] = (
            props.get_unbounded_texture("eta")
            if unbounded
            else props.get_texture("dielectric_f0", DIELECTRIC_F0)
        )
        given = list(props.keys())
        self.edge, self.edges = edge_parameters(given, self.basis.terms, self.fresnel)
        self.textures |= {name: props.get_texture(name) for name in self.edges}

    def _set_albedo(self) -> None:
        """The table of the Fresnel term's functions, for the base and the choice of directions."""
        self.coating = self.term
        if self.fresnel == "exact":  # as near to it as shipped bases come
            shipped = not self.recipe.endswith(".json")
            self.coating = Decomposition(load_basis(self.recipe, 6) if shipped else self.basis)
        key = self.fresnel
        if isinstance(self.coating, Decomposition):
            key = f"{self.coating.basis.provenance.get('sha256')} {self.coating.basis.terms}"
        self.albedo = LobeAlbedo(self.coating.functions, key, self.distribution)
        self.albedo_textures = self.albedo.textures

    def _set_flags(self) -> None:
        front = mi.BSDFFlags.FrontSide
        self.m_components = [
            mi.BSDFFlags.GlossyReflection | front,
            mi.BSDFFlags.DiffuseReflection | front,
        ]
        self.m_flags = self.m_components[0] | self.m_components[1]

    def _check(self, names: Any) -> None:
        for name in names:
            like = "edge_color" if name.startswith("edge_color") else None
            check_range(name, self.textures[name], like="dielectric eta" if name == "eta" else like)

    def _project(self) -> None:
        """Compute what the Fresnel term stores of the dielectric."""

        def project(value: Any) -> Any:
            eta = value if self.dielectric == "eta" else dielectric_eta(value)
            material = Material("indices", (eta, 0.0 * eta), self.basis)
            stored = list(self.term.project(material))
            if self.fresnel == "exact":
                # an index of 1 reflects nothing, and its fit is off by 0.1 at grazing angles
                there = dr.minimum((eta - 1.0) / (eta + 1.0) / LEAST_ROOT, 1.0)
                stored += [there * c for c in self.coating.basis.coefficients(*material.values)]
            return stored

        refuse_recording(f"a new {self.dielectric}", "updates outside of it")
        self._keep(tabulate({self.dielectric: self.textures[self.dielectric]}, project))

    def traverse(self, cb: Any) -> None:
        smooth = mi.ParamFlags.Differentiable
        for name, texture in self.textures.items():
            shaping = mi.ParamFlags.Discontinuous if name == "roughness" else smooth
            cb.put(name, texture, smooth | shaping)
        self._show_tables(cb)

    def parameters_changed(self, keys: Any = ()) -> None:
        changed = [name for name in self.textures if not keys or name in keys]
        self._check(changed)
        if self.dielectric in changed:
            self._project()

    # --- shading ---------------------------------------------------------------------------------

    def _at(self, ctx: Any, si: Any, wi: Any, active: Any) -> _Point:
        """What the textures say at a shading point, and how directions are chosen there."""
        base = self.textures["base_color"].eval(si, active)
        metallic = self.textures["metallic"].eval_1(si, active)
        roughness = self.textures["roughness"].eval_1(si, active)
        alpha = dr.maximum(roughness * roughness, LEAST_ALPHA)
        stored: Sequence[Any] = self.lookup.evaluate(si, active)
        edges = [self.textures[name].eval(si, active) for name in self.edges]
        metal = self.term.project(Metal(self.edge, base, edges, self.basis))
        albedos = self.albedo.directional(mi.Frame3f.cos_theta(wi), alpha, active)
        if self.fresnel == "exact":
            parts = [(1.0 - metallic, Lossless(), stored[:2]), (metallic, self.term, metal)]
            coating: Sequence[Any] = stored[2:]
            usual = total((base, 1.0 - base), albedos[:2])
            reflected = dr.lerp(total(coating, albedos), usual, metallic)
        else:
            # exact at both ends, so that there a pure material is found to the last bit
            mixed = [
                dr.fma(b, metallic, a * (1.0 - metallic))
                for a, b in zip(stored, metal, strict=True)
            ]
            parts = [(None, self.term, mixed)]
            coating = self.term.weights(*stored)
            reflected = total(self.term.weights(*mixed), albedos)
        reflected_first = total(coating, albedos)
        specular, diffuse = _enabled(ctx)
        body = _mean(base * dr.maximum(1.0 - reflected_first, 0.0)) * (1.0 - metallic)
        # fits may be negative; a lobe that is there and hardly ever drawn would make fireflies
        least = dr.fma(_LEAST_SHARE, body, _LEAST_ALBEDO)
        lobe = dr.maximum(_mean(dr.abs(reflected)), least)
        chance = dr.select(body > 0.0, lobe / (lobe + body), 1.0)
        if not diffuse:
            chance = mi.Float(1.0)
        elif not specular:
            chance = mi.Float(0.0)
        return _Point(base, metallic, alpha, parts, coating, reflected_first, chance)

    def _reflect(self, ctx: Any, wi: Any, wo: Any, m: Any, weight: Any, at: _Point) -> Any:
        """Fresnel term at microfacet normal `m`, times the unpolarised `weight`."""
        weight, result = mi.UnpolarizedSpectrum(weight), dr.zeros(mi.Spectrum)
        for share, term, values in at.parts:
            part = weight if share is None else weight * share
            if mi.is_polarized and self.fresnel == "exact":
                result += mueller(ctx, wi, wo, m, part, *values)
            elif mi.is_polarized:
                result += mi.mueller.depolarizer(term(dr.dot(wi, m), *values) * part)
            else:
                result += term(dr.dot(wi, m), *values) * part
        return result

    def _base(self, wo: Any, at: _Point, active: Any) -> Any:
        """The diffuse base under the dielectric, times the cosine."""
        cos_o = mi.Frame3f.cos_theta(wo)
        leaving = total(at.coating, self.albedo.directional(cos_o, at.alpha, active))
        average = total(at.coating, self.albedo.average(at.alpha, active))
        factor = coupling(at.albedo, leaving, average) * ((1.0 - at.metallic) * dr.inv_pi * cos_o)
        value = at.base * factor
        return mi.mueller.depolarizer(value) if mi.is_polarized else value

    def _evaluate(
        self, ctx: Any, si: Any, wi: Any, wo: Any, at: _Point, active: Any
    ) -> tuple[Any, Any]:
        """Value and density for directions above the horizon."""
        specular, diffuse = _enabled(ctx)
        value, density = dr.zeros(mi.Spectrum), mi.Float(0.0)
        if specular:
            m = dr.normalize(wo + wi)
            distr = self._lobe(at.alpha, at.alpha)
            d, weight, chosen = weight_and_density(distr, wi, wo, m, self.sample_visible)
            lit = active & (d != 0.0)
            value += dr.select(
                lit, self._reflect(ctx, wi, wo, m, weight, at), dr.zeros(mi.Spectrum)
            )
            density += dr.select(lit, at.chance * chosen, 0.0)
        if diffuse:
            value += dr.select(active, self._base(wo, at, active), dr.zeros(mi.Spectrum))
            flat = mi.warp.square_to_cosine_hemisphere_pdf(wo)
            density += dr.select(active, (1.0 - at.chance) * flat, 0.0)
        return value, density

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
        active &= (mi.Frame3f.cos_theta(si.wi) > 0.0) & (mi.Frame3f.cos_theta(wo) > 0.0)
        if active is False or not any(_enabled(ctx)):
            return dr.zeros(mi.Spectrum), mi.Float(0.0)
        wi, wo = raised(si.wi), raised(wo)
        return self._evaluate(ctx, si, wi, wo, self._at(ctx, si, wi, active), active)

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.eval_pdf(ctx, si, wo, active)[0]

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.eval_pdf(ctx, si, wo, active)[1]

    def sample(
        self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True
    ) -> tuple[Any, Any]:
        bs = dr.zeros(mi.BSDFSample3f)
        active &= mi.Frame3f.cos_theta(si.wi) > 0.0
        if active is False or not any(_enabled(ctx)):
            return bs, dr.zeros(mi.Spectrum)
        wi = raised(si.wi)
        at = self._at(ctx, si, wi, active)
        by_lobe = sample1 < at.chance
        m, _ = self._lobe(at.alpha, at.alpha).sample(wi, sample2)
        wo = dr.select(by_lobe, mi.reflect(wi, m), mi.warp.square_to_cosine_hemisphere(sample2))
        # also not where m is NaN, as it can be for random numbers that are exactly 0
        active &= mi.Frame3f.cos_theta(wo) > 0.0
        wo = dr.select(active, wo, mi.Vector3f(0.0, 0.0, 1.0))
        value, density = self._evaluate(ctx, si, wi, raised(wo), at, active)
        active &= density > 0.0
        bs.wo = dr.select(active, wo, mi.Vector3f(0.0))
        bs.pdf = dr.select(active, density, 0.0)
        bs.eta = 1.0
        bs.sampled_component = dr.select(by_lobe, mi.UInt32(0), mi.UInt32(1))
        bs.sampled_type = dr.select(
            by_lobe,
            mi.UInt32(+mi.BSDFFlags.GlossyReflection),
            mi.UInt32(+mi.BSDFFlags.DiffuseReflection),
        )
        weight = value / dr.select(active, density, 1.0)
        return bs, dr.select(active, weight, dr.zeros(mi.Spectrum))

    def to_string(self) -> str:
        return self._described(self.textures)


class _Point(NamedTuple):
    """A shading point."""

    base: Any
    metallic: Any
    alpha: Any
    parts: list[tuple[Any, Any, Sequence[Any]]]
    """Share (none: the whole), Fresnel term and its stored values of what is added up."""
    coating: Sequence[Any]
    """Weights of the dielectric's functions."""
    albedo: Any
    """Of the dielectric, seen from `wi`."""
    chance: Any
    """Of choosing the lobe."""


def plugin_class() -> type:
    """The plugin class for the active variant."""
    return derived(DecomposedPrincipled)


def _enabled(ctx: Any) -> tuple[bool, bool]:
    """Whether the lobe and the diffuse base are wanted."""
    flags = mi.BSDFFlags
    return (
        ctx.is_enabled(flags.GlossyReflection, 0),
        ctx.is_enabled(flags.DiffuseReflection, 1),
    )


def _mean(spectrum: Any) -> Any:
    return dr.mean(mi.UnpolarizedSpectrum(spectrum))

"""The BSDF plugin `decomposed_conductor`: Mitsuba's rough conductor with a choice of Fresnel term.

Microfacet model of Walter et al. 2007 with Smith shadowing (uncorrelated) and, by default,
sampling of visible normals (Heitz and d'Eon 2014), in the same order of operations as the built-in
`roughconductor`: with `fresnel: exact` the two render bit-identical images in LLVM variants.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from .._check import choose, input_error
from ..microfacet import SMITH
from .compensation import chosen_compensation
from .conductor_material import material_textures
from .fresnel_terms import Material
from .microfacet_lobe import correlated, mueller, raised, weight_and_density
from .plugin import FresnelPlugin, derived
from .ranges import check_range, refuse_recording
from .tabulation import direct, tabulate

__all__ = ["DecomposedConductor", "plugin_class"]


class DecomposedConductor(FresnelPlugin):
    """Rough conductor with the exact Fresnel term, the decomposition, Schlick or F82.

    Mitsuba sees a class with these methods that derives from `mi.BSDF` of one variant; it is made
    by `plugin_class`.

    Parameters
    ----------
    material : str
        Name of a material of Mitsuba's, with the meaning it has for `roughconductor` ("none" is a
        perfect mirror), or an alias such as "gold", in any case. With `illuminant`, anything that
        `load_material` takes, integrated over its spectrum. Instead of it, exactly one of these
        sets:
    eta, k : float, spectrum or texture
        Relative complex index of refraction.
    r, g : float, spectrum or texture in [0, 1) and [0, 1]
        Reflectivity and edge tint (Gulbrandsen 2014).
    f0, f1, f2, ... : float, spectrum or texture
        Reflectance at normal incidence and at the `terms - 2` nodes of the basis.
    c0, c1, c2, ... : float, spectrum or texture
        The `terms` coefficients. They may be negative or exceed 1; nothing is clamped.
    illuminant : str
        For `material`: a light, such as "D65", under which the reflectance is integrated over the
        spectrum in RGB and monochromatic variants, once, at 0° and at the nodes. So colours are
        those that a spectral rendering in this light has, which one index per channel misses. Not
        for "exact" there. Spectral variants take the spectra themselves.
    allow_partial, allow_broken : bool
        With `illuminant`: accept data that do not cover 400–700 nm, or are broken, as the options
        of `load_material` of the same names do (default false).
    fresnel : {"decomposition", "exact", "schlick", "f82"}
        Fresnel term (default "decomposition"). "exact" needs `material`, (eta, k) or (r, g).
    recipe, terms : str, int
        The basis, see `load_basis` (default "talk", 4); `recipe` may be the path of a file.
    distribution : {"beckmann", "ggx"}
        Distribution of microfacet normals (default "beckmann", as for `roughconductor`).
    alpha, or alpha_u and alpha_v : float or texture > 0
        Roughness, along both or each of the tangents (default 0.1).
    smith : {"separable", "correlated"}
        Shadowing. The default is "separable", as in `roughconductor`, and with
        `energy_compensation` "correlated": separable shadowing loses light that no surface loses,
        which cannot be put back in the right colour.
    energy_compensation : bool
        Put back what single scattering loses (default false), with a table and the formulas of
        `energy`. See there and `compensation`. Mind that it changes the default of `smith`.
    compensation : {"lobe", "scaling"}
        With `energy_compensation`: by a second, diffuse lobe, symmetric in the directions
        (default), or by scaling the first one, as real-time shading does.
    sample_visible : bool
        Sample visible normals only (default true).
    specular_reflectance : float, spectrum or texture
        Factor on the result (default 1).

    Notes
    -----
    All but the exact term are linear in what is stored, and evaluated without clamping: a fit may
    leave [0, 1] by its error. Where eta and k (or r and g) are given, reflectances and coefficients
    are computed when these are set or updated, one per texel and per nanometre, with gradients, and
    *they* are interpolated; `mi.traverse` shows them as `table_0`, ..., to be read only. The exact
    term interpolates eta and k themselves. In polarised variants the fitted terms depolarise, since
    they describe unpolarised reflectance only.

    Values are finite for all directions and random numbers, and so are derivatives, except those of
    a *sampled direction* with respect to roughness where a random number is exactly 0 or next to 1:
    there Mitsuba's samplers have none. (`prb` does not differentiate samples.)

    Examples
    --------
    >>> import mitsuba as mi
    >>> mi.set_variant("scalar_rgb")
    >>> from fresnel_decomp.mitsuba import register
    >>> register()
    >>> bsdf = mi.load_dict({"type": "decomposed_conductor", "material": "Au", "alpha": 0.2})
    """

    def __init__(self, props: Any) -> None:
        mi.BSDF.__init__(self, props)
        self._set_fresnel(props, distribution="beckmann")
        likely = "correlated" if props.get("energy_compensation", False) else "separable"
        self.smith = choose("smith", str(props.get("smith", likely)), SMITH)
        factor = "specular_reflectance"
        self.specular_reflectance = props.get_texture(factor) if factor in props else None
        self._set_roughness(props)
        self.kind, self.parameters = material_textures(props, self.fresnel, self.basis)
        self._project()
        self.compensation = chosen_compensation(props, self)
        self._check_shaping()

    def _set_roughness(self, props: Any) -> None:
        given = [name for name in ("alpha", "alpha_u", "alpha_v") if name in props]
        if given not in ([], ["alpha"], ["alpha_u", "alpha_v"]):
            raise input_error(
                f"roughness is given by {' and '.join(given)}",
                "alpha, or alpha_u and alpha_v, or none of them",
                "alpha stands for alpha_u = alpha_v.",
            )
        if "alpha_u" in given:
            self.alpha_u = props.get_texture("alpha_u")
            self.alpha_v = props.get_texture("alpha_v")
        else:
            self.alpha_u = self.alpha_v = props.get_texture("alpha", 0.1)
        flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
        if self.alpha_u is not self.alpha_v:
            flags = flags | mi.BSDFFlags.Anisotropic
        self.m_flags = flags
        self.m_components = [flags]

    def _project(self) -> None:
        """Compute what the Fresnel term stores from the current parameters."""

        def project(*values: Any) -> Any:
            results = self.term.project(Material(self.kind, values, self.basis))
            if not all(dr.all(dr.isfinite(result)) for result in results):
                raise input_error(
                    f"{' and '.join(self.parameters)} have no finite reflectance somewhere",
                    "finite values; eta > 0, k >= 0, r in [0, 1), g in [0, 1]",
                    "Check the textures and spectra of the conductor.",
                )
            return results

        for name, texture in self.parameters.items():
            # eta is 0 for mirrors and in gaps of measured data, which Mitsuba's exact term takes
            check_range(name, texture, zero=(self.fresnel, self.kind) == ("exact", "material"))
        needed_as_given = {"exact": ("material", "indices"), "decomposition": ("coefficients",)}
        if self.kind in needed_as_given.get(self.fresnel, ()):
            self._keep(direct(tuple(self.parameters.values())))
            return
        refuse_recording(
            f"new {' and '.join(self.parameters)} for fresnel='{self.fresnel}'",
            "updates outside of it; in it, eta and k of the exact term, or coefficients",
        )
        self._keep(tabulate(self.parameters, project))

    def _check_shaping(self) -> None:
        if self.alpha_u is self.alpha_v:
            check_range("alpha", self.alpha_u)
        else:
            check_range("alpha_u", self.alpha_u)
            check_range("alpha_v", self.alpha_v)
        if self.specular_reflectance is not None:
            check_range("specular_reflectance", self.specular_reflectance)
        self.compensation.update(self)

    def traverse(self, cb: Any) -> None:
        smooth = mi.ParamFlags.Differentiable
        if self.specular_reflectance is not None:
            cb.put("specular_reflectance", self.specular_reflectance, smooth)
        shaping = mi.ParamFlags.Differentiable | mi.ParamFlags.Discontinuous
        if self.alpha_u is self.alpha_v:
            cb.put("alpha", self.alpha_u, shaping)
        else:
            cb.put("alpha_u", self.alpha_u, shaping)
            cb.put("alpha_v", self.alpha_v, shaping)
        for name, texture in self.parameters.items():
            cb.put(name, texture, smooth)
        self._show_tables(cb)

    def parameters_changed(self, keys: Any = ()) -> None:
        if not keys or any(key in self.parameters for key in keys):
            self._project()
        if not keys or any(key not in self.parameters for key in keys):
            self._check_shaping()

    def microfacets(self, si: Any, active: Any) -> Any:
        """The distribution of normals at a shading point."""
        return self._lobe(self.alpha_u.eval_1(si, active), self.alpha_v.eval_1(si, active))

    def _reflect(
        self, ctx: Any, si: Any, wi: Any, wo: Any, m: Any, weight: Any, active: Any
    ) -> Any:
        """Fresnel term at microfacet normal `m`, times the unpolarised `weight`."""
        values = self.lookup.evaluate(si, active)
        weight = mi.UnpolarizedSpectrum(weight)
        if self.specular_reflectance is not None:
            weight = weight * self.specular_reflectance.eval(si, active)
        if mi.is_polarized and self.fresnel == "exact":
            result = mueller(ctx, wi, wo, m, weight, *values)
        else:
            result = self.term(dr.dot(wi, m), *values) * weight
            if mi.is_polarized:
                result = mi.mueller.depolarizer(result)
        return dr.select(active, result, dr.zeros(mi.Spectrum))

    def sample(
        self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True
    ) -> tuple[Any, Any]:
        bs = dr.zeros(mi.BSDFSample3f)
        active &= mi.Frame3f.cos_theta(si.wi) > 0.0
        if not ctx.is_enabled(mi.BSDFFlags.GlossyReflection) or active is False:
            return bs, dr.zeros(mi.Spectrum)
        if self.compensation.has_lobe:
            return self.compensation.sample(self, ctx, si, sample1, sample2, active)
        wi = raised(si.wi)
        cos_i = mi.Frame3f.cos_theta(wi)
        distr = self.microfacets(si, active)
        m, pdf = distr.sample(wi, sample2)
        wo = mi.reflect(wi, m)
        bs.eta = 1.0
        bs.sampled_component = 0
        bs.sampled_type = +mi.BSDFFlags.GlossyReflection
        # also not where m is NaN, as it can be for random numbers that are exactly 0
        active &= (pdf != 0.0) & (mi.Frame3f.cos_theta(wo) > 0.0)
        bs.wo = dr.select(active, wo, mi.Vector3f(0.0))
        if self.sample_visible:
            weight = distr.smith_g1(wo, m)
            if self.smith == "correlated":
                weight = correlated(1.0, distr.smith_g1(wi, m), weight)
        else:
            weight = self._shadowing(distr, wi, wo, m) * dr.dot(wi, m)
            weight /= cos_i * mi.Frame3f.cos_theta(m)
        bs.pdf = dr.select(active, pdf / (4.0 * dr.dot(wo, m)), 0.0)
        value = self._reflect(ctx, si, wi, wo, m, weight, active)
        return bs, self.compensation.complete(self, si, wi, wo, value, active)

    def _shadowing(self, distr: Any, wi: Any, wo: Any, m: Any) -> Any:
        if self.smith == "separable":
            return distr.G(wi, wo, m)
        g_i, g_o = distr.smith_g1(wi, m), distr.smith_g1(wo, m)
        return correlated(g_i, g_i, g_o)

    def _both_sides(self, ctx: Any, si: Any, wo: Any, active: Any) -> tuple[Any, Any, Any, Any]:
        """Both directions, half vector, and where they agree on the side of the surface."""
        active &= (mi.Frame3f.cos_theta(si.wi) > 0.0) & (mi.Frame3f.cos_theta(wo) > 0.0)
        active &= ctx.is_enabled(mi.BSDFFlags.GlossyReflection)
        wi, wo = raised(si.wi), raised(wo)
        return wi, wo, dr.normalize(wo + wi), active

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        wi, wo, m, active = self._both_sides(ctx, si, wo, active)
        if active is False:
            return dr.zeros(mi.Spectrum)
        distr, both = self.microfacets(si, active), active
        d = distr.eval(m)
        active = active & (d != 0.0)  # not in place: it is `both` too
        weight = d * self._shadowing(distr, wi, wo, m) / (4.0 * mi.Frame3f.cos_theta(wi))
        value = self._reflect(ctx, si, wi, wo, m, weight, active)
        return self.compensation.complete(self, si, wi, wo, value, both)

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        wi, wo, m, active = self._both_sides(ctx, si, wo, active)
        both = active
        active = active & (dr.dot(wi, m) > 0.0) & (dr.dot(wo, m) > 0.0)
        if active is False:
            return self.compensation.mixed(self, si, wi, wo, mi.Float(0.0), both)
        distr = self.microfacets(si, active)
        if self.sample_visible:
            density = distr.eval(m) * distr.smith_g1(wi, m) / (4.0 * mi.Frame3f.cos_theta(wi))
        else:
            density = distr.pdf(wi, m) / (4.0 * dr.dot(wo, m))
        density = dr.select(active, density, 0.0)
        return self.compensation.mixed(self, si, wi, wo, density, both)

    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
        wi, wo, m, active = self._both_sides(ctx, si, wo, active)
        return self.value_and_density(ctx, si, wi, wo, m, active)

    def value_and_density(
        self, ctx: Any, si: Any, wi: Any, wo: Any, m: Any, active: Any
    ) -> tuple[Any, Any]:
        """`eval_pdf` for a known half vector `m`."""
        both = active
        active = active & (dr.dot(wi, m) > 0.0) & (dr.dot(wo, m) > 0.0)
        if active is False:
            value = self.compensation.complete(self, si, wi, wo, dr.zeros(mi.Spectrum), both)
            return value, self.compensation.mixed(self, si, wi, wo, mi.Float(0.0), both)
        distr = self.microfacets(si, active)
        d, weight, density = weight_and_density(distr, wi, wo, m, self.sample_visible, self.smith)
        active &= d != 0.0
        value = self._reflect(ctx, si, wi, wo, m, weight, active)
        value = self.compensation.complete(self, si, wi, wo, value, both)
        density = dr.select(active, density, 0.0)
        return value, self.compensation.mixed(self, si, wi, wo, density, both)

    def to_string(self) -> str:
        items: dict[str, Any] = {"smith": self.smith, "energy_compensation": self.compensation.name}
        items |= {"alpha_u": self.alpha_u, "alpha_v": self.alpha_v}
        if self.specular_reflectance is not None:
            items["specular_reflectance"] = self.specular_reflectance
        return self._described(items | self.parameters)


def plugin_class() -> type:
    """The plugin class for the active variant."""
    return derived(DecomposedConductor)

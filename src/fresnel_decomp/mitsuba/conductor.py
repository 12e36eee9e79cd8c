"""The BSDF plugin `decomposed_conductor`: Mitsuba's rough conductor with a choice of Fresnel term.

Microfacet model of Walter et al. 2007 with Smith shadowing (uncorrelated) and, by default,
sampling of visible normals (Heitz and d'Eon 2014), in the same order of operations as the built-in
`roughconductor`: with `fresnel: exact` the two render bit-identical images in LLVM variants.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from .._check import choose, input_error
from .._data_sets import data_set_files, find_data_set
from ..basis import Basis, load_basis
from ..colour import WAVELENGTH_NM, luminance_weights, rgb_weights
from ..fresnel import conductor
from ..material import Material as Spectrum
from ..microfacet import SMITH
from ..parametrization import F82_COSINE
from ..spectra import load_material
from .compensation import chosen_compensation
from .fresnel_terms import F82, Decomposition, Exact, Material, Schlick, parameter_set
from .microfacet_lobe import correlated, derived, mueller, raised, weight_and_density
from .ranges import check_range, recording
from .tabulation import children, direct, tabulate

__all__ = ["DecomposedConductor", "plugin_class"]

_log = logging.getLogger(__name__)

_PERMISSIONS = ("allow_partial", "allow_broken")


class DecomposedConductor:
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
        fresnel = str(props.get("fresnel", "decomposition"))
        choose("fresnel", fresnel, ("decomposition", "exact", "schlick", "f82"))
        distribution = str(props.get("distribution", "beckmann")).lower()
        choose("distribution", distribution, ("beckmann", "ggx"))
        types = mi.MicrofacetType
        self.distribution = types.GGX if distribution == "ggx" else types.Beckmann
        self.sample_visible = bool(props.get("sample_visible", True))
        likely = "correlated" if props.get("energy_compensation", False) else "separable"
        self.smith = choose("smith", str(props.get("smith", likely)), SMITH)
        factor = "specular_reflectance"
        self.specular_reflectance = props.get_texture(factor) if factor in props else None
        self._set_roughness(props)
        self._set_material(props, fresnel)
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

    def _set_material(self, props: Any, fresnel: str) -> None:
        recipe, terms = str(props.get("recipe", "talk")), int(props.get("terms", 0)) or None
        if recipe.endswith(".json"):  # relative to the scene file
            recipe = str(mi.file_resolver().resolve(recipe))
        basis = load_basis(recipe, terms)
        terms = basis.terms
        kind, names = parameter_set(list(props.keys()), terms)
        if fresnel == "exact" and kind in ("nodes", "coefficients"):
            raise input_error(
                f"fresnel='exact' with {', '.join(names)}",
                "material, eta + k or r + g",
                "Reflectances and coefficients do not determine an index of refraction.",
            )
        preset = str(props["material"]) if kind == "material" else ""
        integrated = "illuminant" in props
        unused = [name for name in _PERMISSIONS if name in props and not integrated]
        if unused:
            raise input_error(
                f"{' and '.join(unused)} without illuminant",
                "with material and illuminant",
                "Without illuminant data are taken as they are; remove it.",
            )
        if integrated and preset:
            illuminant = str(props["illuminant"])
            partial, broken = (bool(props.get(name, False)) for name in _PERMISSIONS)
            data = load_material(preset, allow_partial=partial, allow_broken=broken)
            kind, values = _integrated(data, illuminant, fresnel, lambda: basis)
            for name, value in values.items():
                props[name] = value
            self.parameters = {name: props.get_unbounded_texture(name) for name in values}
        elif integrated:
            raise input_error(
                f"illuminant with {', '.join(names)}",
                "illuminant with material",
                "Only measured spectra are integrated.",
            )
        elif preset.casefold() == "none" and fresnel != "exact":
            kind = "coefficients"
            self.parameters = {f"c{i}": _uniform(float(i == 0)) for i in range(terms)}
        elif preset:
            self.parameters = _preset(preset)
        else:
            self.parameters = {name: _texture(props, name) for name in names}
        self.fresnel, self.kind = fresnel, kind
        self.basis = lambda: basis
        make: dict[str, Any] = {"exact": Exact, "schlick": Schlick, "f82": F82}
        self.term = make[fresnel]() if fresnel in make else Decomposition(basis)
        self.tables: list[Any] = []
        self._project()

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
            self.lookup = direct(tuple(self.parameters.values()))
        elif recording():  # going on would end the process
            raise input_error(
                f"new {' and '.join(self.parameters)} for fresnel='{self.fresnel}' in a recorded "
                "function (dr.freeze) or a symbolic loop",
                "updates outside of it; in it, eta and k of the exact term, or coefficients",
                "Call params.update() before it.",
            )
        else:
            self.lookup = tabulate(self.parameters, project)
        self.tables = self.tables or [type(table)(table) for table in self.lookup.tables]
        for kept, table in zip(self.tables, self.lookup.tables, strict=True):
            mi.set_property(kept, table)  # in place: `SceneParameters` hold on to them

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
        for i, table in enumerate(self.tables):  # as inputs of `mi.render`, see `Lookup`
            cb.put(f"table_{i}", table, mi.ParamFlags.ReadOnly)

    def parameters_changed(self, keys: Any = ()) -> None:
        if not keys or any(key in self.parameters for key in keys):
            self._project()
        if not keys or any(key not in self.parameters for key in keys):
            self._check_shaping()

    def _microfacets(self, si: Any, active: Any) -> Any:
        alpha_u, alpha_v = self.alpha_u.eval_1(si, active), self.alpha_v.eval_1(si, active)
        return mi.MicrofacetDistribution(self.distribution, alpha_u, alpha_v, self.sample_visible)

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
        distr = self._microfacets(si, active)
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
        distr, both = self._microfacets(si, active), active
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
        distr = self._microfacets(si, active)
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
        distr = self._microfacets(si, active)
        d, weight, density = weight_and_density(distr, wi, wo, m, self.sample_visible, self.smith)
        active &= d != 0.0
        value = self._reflect(ctx, si, wi, wo, m, weight, active)
        value = self.compensation.complete(self, si, wi, wo, value, both)
        density = dr.select(active, density, 0.0)
        return value, self.compensation.mixed(self, si, wi, wo, density, both)

    def to_string(self) -> str:
        name = "ggx" if self.distribution == mi.MicrofacetType.GGX else "beckmann"
        items: dict[str, Any] = {"fresnel": self.fresnel}
        if isinstance(self.term, Decomposition):
            items |= {"recipe": self.term.basis.recipe, "terms": self.term.basis.terms}
        items |= {"distribution": name, "sample_visible": self.sample_visible}
        items |= {"smith": self.smith, "energy_compensation": self.compensation.name}
        items |= {"alpha_u": self.alpha_u, "alpha_v": self.alpha_v}
        if self.specular_reflectance is not None:
            items["specular_reflectance"] = self.specular_reflectance
        items |= self.parameters
        lines = [f"  {key} = {value}".replace("\n", "\n  ") for key, value in items.items()]
        return "DecomposedConductor[\n" + ",\n".join(lines) + "\n]"


def plugin_class() -> type:
    """The plugin class for the active variant."""
    return derived(DecomposedConductor)


def _preset(name: str) -> dict[str, Any]:
    """The textures that the built-in plugin makes of `material`: taken from one of its kind."""
    indices: dict[str, Any] = {"material": "none"}
    if name.casefold() != "none":
        indices["material"] = data_set = find_data_set(name, "'none'")
        for flag in load_material(data_set, allow_partial=True, allow_broken=True).flags:
            if flag.startswith("broken"):
                _log.warning("Mitsuba's material '%s' is %s", data_set, flag)
        eta, k = (str(path) for path in data_set_files(data_set))
        if mi.is_spectral and not any(mi.spectrum_from_file(k)[1]):
            # Mitsuba has no spectra that are 0 everywhere
            indices = {"eta": {"type": "spectrum", "filename": eta}, "k": 0.0}
    found = children(mi.load_dict({"type": "roughconductor", **indices}))
    return {"eta": found["eta"], "k": found["k"]}


def _integrated(
    material: Spectrum, illuminant: str, fresnel: str, basis: Callable[[], Basis]
) -> tuple[str, dict[str, Any]]:
    """Kind and values of the parameters that stand for a whole spectrum."""
    weights = rgb_weights(illuminant)  # refuses unknown lights in every variant
    if mi.is_spectral:
        eta, k = material.at(WAVELENGTH_NM)
        return "material", {"eta": _spectrum(eta), "k": _spectrum(k)}
    if fresnel == "exact":
        raise input_error(
            f"fresnel='exact' with an illuminant in {mi.variant()}",
            "'decomposition', 'schlick' or 'f82', or a spectral variant",
            "An integrated spectrum has no index of refraction.",
        )
    if mi.is_monochromatic:
        weights = luminance_weights(illuminant)[None]

    def reflectance(cos_theta: float) -> NDArray[np.float64]:
        return weights @ conductor(cos_theta, *material.at(WAVELENGTH_NM))

    f0 = reflectance(1.0)
    if fresnel == "decomposition":
        nodes = np.stack([reflectance(float(np.cos(t))) for t in basis().nodes], axis=-1)
        values = basis().coefficients_from_reflectance(f0, nodes).T
        return "coefficients", {f"c{i}": _colour(value) for i, value in enumerate(values)}
    return "f82", {"f0": _colour(f0), "f82": _colour(reflectance(F82_COSINE))}


def _colour(channels: NDArray[np.float64]) -> Any:
    """A property: a number where there is one channel; of any sign."""
    return float(channels[0]) if channels.size == 1 else mi.ScalarColor3f(channels.tolist())


def _spectrum(values: NDArray[np.float64]) -> Any:
    """A spectrum on the grid of `colour`, as Mitsuba's object."""
    if not values.any():  # Mitsuba has no spectra that are 0 everywhere
        return 0.0
    return mi.load_dict(
        {
            "type": "regular",
            "wavelength_min": float(WAVELENGTH_NM[0]),
            "wavelength_max": float(WAVELENGTH_NM[-1]),
            "values": ", ".join(f"{value:.9g}" for value in values),
        }
    )


def _uniform(value: float) -> Any:
    return mi.load_dict({"type": "uniform", "value": value})


def _texture(props: Any, name: str) -> Any:
    if mi.is_spectral and props.type(name) == mi.Properties.Type.Color and min(props[name]) < 0.0:
        raise input_error(
            f"{name}={list(props[name])} in {mi.variant()}",
            "colours >= 0, numbers of any sign",
            "A colour is upsampled to a spectrum there, which loses its sign; "
            "use an RGB variant, or give eta and k.",
        )
    return props.get_unbounded_texture(name)

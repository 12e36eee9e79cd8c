"""What the properties of `decomposed_conductor` say of its material, as textures."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from .._check import input_error
from .._data_sets import data_set_files, find_data_set
from ..basis import Basis
from ..colour import WAVELENGTH_NM, luminance_weights, rgb_weights
from ..fresnel import conductor
from ..material import Material as Spectrum
from ..parametrization import F82_COSINE
from ..spectra import load_material
from .tabulation import children

__all__ = ["material_textures", "parameter_set"]

_log = logging.getLogger(__name__)

_PERMISSIONS = ("allow_partial", "allow_broken")


def parameter_set(given: Sequence[str], terms: int) -> tuple[str, tuple[str, ...]]:
    """The one complete set of material parameters among property names.

    Parameters
    ----------
    given : sequence of str
        Names of the plugin's properties.
    terms : int
        Terms of the basis, which decide how many node colours or coefficients there are.

    Returns
    -------
    (kind, names), where kind is "material", "indices", "gulbrandsen", "nodes" or "coefficients".

    Raises
    ------
    InputError
        If there is none, more than one, or an incomplete one.
    """
    sets = {
        "material": ("material",),
        "indices": ("eta", "k"),
        "gulbrandsen": ("r", "g"),
        "nodes": tuple(f"f{i}" for i in range(terms - 1)),
        "coefficients": tuple(f"c{i}" for i in range(terms)),
    }
    found = [kind for kind, names in sets.items() if any(name in given for name in names)]
    if len(found) == 1 and all(name in given for name in sets[found[0]]):
        return found[0], sets[found[0]]
    present = [name for names in sets.values() for name in names if name in given]
    raise input_error(
        f"the conductor is given by {', '.join(present) or 'nothing'}",
        "exactly one of " + " | ".join(" + ".join(names) for names in sets.values()),
        "f0, f1, ... are reflectances at normal incidence and the nodes of the basis, "
        "c0, c1, ... its coefficients.",
    )


def material_textures(props: Any, fresnel: str, basis: Basis) -> tuple[str, dict[str, Any]]:
    """The kind of a material, as `fresnel_terms.Material` has it, and its parameters by name.

    Raises
    ------
    InputError
        If the properties do not determine one, or one that the Fresnel term can take.
    """
    kind, names = parameter_set(list(props.keys()), basis.terms)
    if fresnel == "exact" and kind in ("nodes", "coefficients"):
        raise input_error(
            f"fresnel='exact' with {', '.join(names)}",
            "material, eta + k or r + g",
            "Reflectances and coefficients do not determine an index of refraction.",
        )
    integrated = "illuminant" in props
    unused = [name for name in _PERMISSIONS if name in props and not integrated]
    if unused:
        raise input_error(
            f"{' and '.join(unused)} without illuminant",
            "with material and illuminant",
            "Without illuminant data are taken as they are; remove it.",
        )
    if kind != "material":
        if integrated:
            raise input_error(
                f"illuminant with {', '.join(names)}",
                "illuminant with material",
                "Only measured spectra are integrated.",
            )
        return kind, {name: _texture(props, name) for name in names}
    preset = str(props["material"])
    if integrated:
        illuminant = str(props["illuminant"])
        partial, broken = (bool(props.get(name, False)) for name in _PERMISSIONS)
        data = load_material(preset, allow_partial=partial, allow_broken=broken)
        kind, values = _integrated(data, illuminant, fresnel, basis)
        for name, value in values.items():
            props[name] = value
        return kind, {name: props.get_unbounded_texture(name) for name in values}
    if preset.casefold() == "none" and fresnel != "exact":
        return "coefficients", {f"c{i}": _uniform(float(i == 0)) for i in range(basis.terms)}
    return kind, _preset(preset)


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
    material: Spectrum, illuminant: str, fresnel: str, basis: Basis
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
        nodes = np.stack([reflectance(float(np.cos(t))) for t in basis.nodes], axis=-1)
        values = basis.coefficients_from_reflectance(f0, nodes).T
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

"""What `colour_report.py` compares: RGB curves of a material by every model, and their errors."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fresnel_decomp import (
    F82,
    RECIPES,
    Curve,
    Lazanyi,
    Material,
    Schlick,
    accuracy,
    conductor,
    convert,
    delta_e_2000,
    directional_albedo,
    gamut_excess,
    load_basis,
    load_material,
)
from fresnel_decomp.colour import WAVELENGTH_NM, rgb_weights
from fresnel_decomp.parametrization import F82_COSINE

Array = NDArray[np.float64]

DEGREES = np.arange(91.0)
STEEP = DEGREES <= 85.0
ALPHAS = (0.08, 0.3, 0.6)
VIEWS = np.arange(0.0, 86.0, 5.0)
"""Angles of view of the albedo, in degrees."""

GRID = np.linspace(0.0, 1.0, 257) ** 2
"""Cosines between which curves are linear for the albedo: dense at grazing incidence."""

COSINES = np.concatenate([np.clip(np.cos(np.radians(DEGREES)), 0.0, 1.0), GRID])

MITSUBA = "RGB n, k as Mitsuba"
BALANCED = "RGB n, k, white-balanced"
FITTED = "coefficients of RGB n, k"
BEST = "best fit"


def spectral(recipe: str) -> str:
    return f"spectral coefficients, {recipe}"


def model_names() -> list[str]:
    first = [MITSUBA, BALANCED, "Schlick", "F82", "Gulbrandsen", FITTED]
    return [*first, *map(spectral, RECIPES), BEST]


def curves(material: Material, illuminant: str, exact: Array) -> dict[str, Array]:
    """(m, 3) reflectance at `COSINES` by every model; `exact` is the integrated spectrum there."""
    cosine = COSINES[:, None]
    basis = load_basis()
    curve = Curve(lambda c: material.rgb_reflectance(c, illuminant))
    balanced = material.rgb_indices(illuminant)
    ends = material.rgb_reflectance(np.array([1.0, F82_COSINE]), illuminant)
    angles = slice(0, len(DEGREES))
    functions = basis(COSINES)
    result = {
        MITSUBA: conductor(cosine, *mitsuba_indices(material)),
        BALANCED: conductor(cosine, *balanced),
        "Schlick": Schlick(ends[0])(cosine),
        "F82": F82(*ends)(cosine),
        "Gulbrandsen": convert(curve, "gulbrandsen", no_counterpart="nearest").value(cosine),
        FITTED: functions @ basis.coefficients(*balanced, poor_fit="keep").T,
    }
    for recipe in RECIPES:
        own = load_basis(recipe)
        coefficients = material.rgb_coefficients(own, illuminant)
        result[spectral(recipe)] = own(COSINES) @ coefficients.T
    result[BEST] = functions @ basis.fit(COSINES[angles], exact[angles].T).T
    return result


def mitsuba_indices(material: Material) -> tuple[Array, Array]:
    """One index per channel as Mitsuba's `material` makes it in RGB: equal-energy, not balanced."""
    weights = _equal_energy()
    eta, k = (np.maximum(weights @ values, 0.0) for values in material.at(WAVELENGTH_NM))
    return np.maximum(eta, 1e-3), k


@functools.cache
def _equal_energy() -> Array:
    """RGB of a spectrum under equal energy, whose white is (1.205, .948, .909) in sRGB."""
    import colour

    space = colour.RGB_COLOURSPACES["sRGB"]
    matrix = colour.normalised_primary_matrix(space.primaries, space.whitepoint)
    white = np.linalg.solve(matrix, colour.xy_to_XYZ(np.array([1.0, 1.0]) / 3.0))
    return rgb_weights("E") * white[:, None]


@functools.cache
def albedo_operator() -> Array:
    """(alphas, views, grid): directional albedo of a curve that is linear between `GRID`."""
    mu = np.cos(np.radians(VIEWS))

    def hats(cos_theta: Array) -> Array:
        """(..., grid) weights of linear interpolation."""
        c = np.clip(cos_theta, 0.0, 1.0)
        left = np.clip(np.searchsorted(GRID, c, side="right") - 1, 0, len(GRID) - 2)
        t = ((c - GRID[left]) / (GRID[left + 1] - GRID[left]))[..., None]
        at = np.arange(len(GRID))
        return (at == left[..., None]) * (1.0 - t) + (at == left[..., None] + 1) * t

    return np.array([[directional_albedo(hats, m, alpha) for m in mu] for alpha in ALPHAS])


@dataclass(frozen=True)
class Row:
    """Colour differences of one model for one material in one light, over 0° to 90°."""

    material: str
    illuminant: str
    model: str
    mean: float
    p95: float
    max: float
    at_degrees: float
    max_to_85: float
    below: float
    """Least channel of the model, where it is below 0."""
    above: float
    """Most that a channel of the model is above 1."""
    albedo: tuple[float, ...]
    """Mean over the views, for each of `ALPHAS`."""
    albedo_max: tuple[float, ...]


def rows(material: Material, illuminants: Sequence[str], name: str = "") -> list[dict[str, Any]]:
    """`Row` of every model in every light, as JSON takes it."""
    spectrum = conductor(COSINES[:, None], *material.at(WAVELENGTH_NM))
    operator, n = albedo_operator(), len(DEGREES)
    result = []
    for illuminant in illuminants:
        exact = spectrum @ rgb_weights(illuminant).T
        albedo = operator @ exact[n:]
        for model, curve in curves(material, illuminant, exact).items():
            difference = delta_e_2000(curve[:n], exact[:n])
            rough = delta_e_2000(operator @ curve[n:], albedo)
            excess = gamut_excess(curve[:n])
            row = Row(
                material=name or material.name,
                illuminant=illuminant,
                model=model,
                mean=float(difference.mean()),
                p95=float(np.percentile(difference, 95.0)),
                max=float(difference.max()),
                at_degrees=float(DEGREES[difference.argmax()]),
                max_to_85=float(difference[STEEP].max()),
                below=float(min(excess.min(), 0.0)),
                above=float(max(excess.max(), 0.0)),
                albedo=tuple(rough.mean(axis=1).tolist()),
                albedo_max=tuple(rough.max(axis=1).tolist()),
            )
            result.append(asdict(row))
    return result


def colour_errors(names: Sequence[str], terms: Sequence[int] = (3, 4, 5, 6)) -> dict[str, str]:
    """Mean and largest ΔE00 over all materials and angles in D65, by model.

    Models, named as in `accuracy_table`, store the integrated spectrum: Schlick its F0, F82 also
    the value at cos = 1/7, Lazanyi its F0 and the correction of the white-balanced index, bases
    their coefficients.
    """
    n = len(DEGREES)
    cosine = COSINES[:n, None]
    materials = [load_material(name) for name in names]
    exact = [material.rgb_reflectance(COSINES[:n]) for material in materials]
    ends = [m.rgb_reflectance(np.array([1.0, F82_COSINE])) for m in materials]
    bent = [Lazanyi.from_ior(*material.rgb_indices()) for material in materials]
    fits = {
        "Schlick": [Schlick(f0)(cosine) for f0, _ in ends],
        "Lazanyi": [
            Lazanyi(f0, own.a, own.exponent)(cosine)
            for (f0, _), own in zip(ends, bent, strict=True)
        ],
        "F82": [F82(*pair)(cosine) for pair in ends],
    }
    for recipe in RECIPES:
        for count in terms:
            basis = load_basis(recipe, count)
            functions = basis(COSINES[:n])
            fits[f"{recipe}, {count} terms"] = [
                functions @ material.rgb_coefficients(basis).T for material in materials
            ]
    errors = {name: accuracy.colour_errors(fit, exact) for name, fit in fits.items()}
    return {name: f"{error.mean:.3f} / {error.max:.2f}" for name, error in errors.items()}

"""What an approximate reflectance is off by on a surface, and what evaluating it costs.

The predicted error of a surface is the largest over the angle of view. A smooth surface, or one
that a point light illuminates, shows its reflectance at single angles, so this is the largest error
of the curve. Light from everywhere is averaged over the lobe of normals, and so is the error. If d
is the error at an angle, weighted by what the lobe reflects from there, and L the light, then what
is seen is the mean of d and its covariance with L over the mean of L, so that by Cauchy and Schwarz

    |∫ w L d| / ∫ w L  <=  |mean of d| + sqrt(v) (standard deviation of d),

v being the variance of the light over the lobe relative to its squared mean: the *contrast*. Rough
surfaces under an even sky need less than smooth ones. Views are those with cosines from .1 on, 99 %
of what one sees of a sphere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ._check import choose, input_error
from .albedo import directional_albedo
from .basis import Basis
from .colour import WAVELENGTH_NM, delta_e_2000, rgb_weights
from .curves import CurveSet, error_cosines
from .fresnel import conductor

__all__ = [
    "EVEN_SKY",
    "EXACT_OPERATIONS",
    "METRICS",
    "Metric",
    "Surface",
    "differences",
    "operations",
    "predicted_error",
]

Metric = Literal["reflectance", "delta-e"]
METRICS = ("reflectance", "delta-e")

EXACT_OPERATIONS = 34
"""Operations of `mi.fresnel_conductor` per channel, as counted in its kernel."""

EVEN_SKY = 0.25
"""Contrast of an even light of which black objects hide a fifth: .2 / (1 - .2)."""

_LOBE_COSINES = np.linspace(0.1**0.5, 1.0, 15) ** 2  # of the view, dense at grazing angles


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface whose reflectance is given by an index of refraction.

    Attributes
    ----------
    name : str
    eta, k : (n,) float, eta > 0, k >= 0
        One for each channel that is evaluated, or for each of `wavelength_nm`.
    alpha : (float, float) or None
        Least and greatest roughness, > 0 and usually <= 1; None for a smooth surface.
    contrast : float >= 0
        Variance of the light relative to its squared mean; infinite for point, spot and directional
        lights. The default is that of an even sky of which black objects hide a fifth.
    distribution : {"ggx", "beckmann"}
    wavelength_nm : (n,) float or None
        Where eta and k belong to wavelengths and not to channels.

    Raises
    ------
    InputError
        For other shapes and ranges than these.
    """

    name: str
    eta: Any
    k: Any
    alpha: tuple[float, float] | None = None
    contrast: float = EVEN_SKY
    distribution: Literal["ggx", "beckmann"] = "ggx"
    wavelength_nm: np.ndarray | None = None

    def __post_init__(self) -> None:
        curves = CurveSet(self.name, np.ravel(self.eta), np.ravel(self.k))
        object.__setattr__(self, "eta", curves.eta)
        object.__setattr__(self, "k", curves.k)
        choose("distribution", self.distribution, ("ggx", "beckmann"))
        if self.alpha is not None and not 0.0 < self.alpha[0] <= self.alpha[1]:
            raise input_error(
                f"alpha={self.alpha} of '{self.name}'",
                "(least, greatest) > 0, or None",
                "Smooth surfaces have None.",
            )
        if not self.contrast >= 0.0:
            raise input_error(
                f"contrast={self.contrast} of '{self.name}'",
                "a number >= 0, or infinity",
                "Leave it out for an even light.",
            )
        if self.wavelength_nm is not None:
            wavelength = np.asarray(self.wavelength_nm, np.float64)
            if wavelength.shape != curves.eta.shape or not (np.diff(wavelength) > 0.0).all():
                raise input_error(
                    f"wavelength_nm of shape {wavelength.shape} of '{self.name}'",
                    f"{len(curves)} ascending wavelengths, one for each index",
                    "Sort them, or leave them out where eta and k belong to channels.",
                )
            object.__setattr__(self, "wavelength_nm", wavelength)

    @property
    def averaged(self) -> bool:
        """Whether light comes from everywhere, so that an engine shades it with averages."""
        return self.alpha is not None and bool(np.isfinite(self.contrast))

    def to_rgb(self, reflectance: np.ndarray) -> np.ndarray:
        """(..., 3) linear sRGB of reflectances (..., n), under D65 where they are spectra."""
        if self.wavelength_nm is None:
            if len(self.eta) not in (1, 3):
                raise input_error(
                    f"{len(self.eta)} channels of '{self.name}' as colours",
                    "1 or 3, or wavelength_nm",
                    "Use the metric 'reflectance'.",
                )
            return np.broadcast_to(reflectance, (*reflectance.shape[:-1], 3))
        weights = rgb_weights("D65")
        spectra = np.stack(
            [
                np.interp(WAVELENGTH_NM, self.wavelength_nm, row)
                for row in reflectance.reshape(-1, reflectance.shape[-1])
            ]
        )
        return (spectra @ weights.T).reshape(*reflectance.shape[:-1], 3)


def operations(model: str, channels: int, basis: Basis | None = None) -> int:
    """Floating-point operations of one evaluation, a fused multiply-add counting as one.

    Parameters
    ----------
    model : {"schlick", "f82", "decomposition", "exact"}
    channels : int
        Share the cosine and, in the decomposition, the functions.
    basis : Basis
        For "decomposition".

    Raises
    ------
    InputError
        For an unknown model, and a decomposition without a basis.
    """
    choose("model", model, ("schlick", "f82", "decomposition", "exact"))
    if model == "schlick":
        return 4 + 2 * channels
    if model == "f82":
        return 6 + 4 * channels
    if model == "exact":
        return EXACT_OPERATIONS * channels
    if basis is None:
        raise input_error("a decomposition without a basis", "a Basis", "Pass load_basis(...).")
    form = basis.closed_form
    # Horner's rule: one operation per degree; a leading zero in b_2, b_3, ... is the same
    horner = len(form.denominator) - 1 + form.numerators.size - len(form.numerators)
    return 2 + horner + len(form.numerators) * (1 + channels)


def predicted_error(
    surface: Surface, fit: Callable[[np.ndarray], np.ndarray], metric: Metric = "reflectance"
) -> float:
    """The largest error over the angle of view, as this module's text defines it.

    Parameters
    ----------
    surface : Surface
    fit : callable
        From cosines (..., 1) to reflectances (..., n), one for each index of the surface.
    metric : {"reflectance", "delta-e"}
        See `differences`.

    Raises
    ------
    InputError
        For an unknown metric.

    Examples
    --------
    >>> from fresnel_decomp import Schlick
    >>> from fresnel_decomp.prediction import Surface, predicted_error
    >>> glass = Surface("glass", [1.5], [0.0])
    >>> round(predicted_error(glass, Schlick(0.04)), 3)
    0.036
    """
    choose("metric", metric, METRICS)

    def difference(cos_theta: np.ndarray) -> np.ndarray:
        cos_theta = np.asarray(cos_theta)[..., None]
        exact = conductor(cos_theta, surface.eta, surface.k)
        return differences(surface, exact, fit(cos_theta), metric)

    largest = float(np.abs(difference(error_cosines()[0])).max())
    if not surface.averaged:
        return largest
    assert surface.alpha is not None
    low, high = surface.alpha
    alphas = np.unique([low, np.sqrt(low * high), high])
    return min(largest, max(_seen(surface, difference, alpha) for alpha in alphas))


def differences(
    surface: Surface, exact: np.ndarray, fitted: np.ndarray, metric: Metric
) -> np.ndarray:
    """By how much reflectances (..., n) differ, in units of a metric.

    Returns
    -------
    (..., n) fitted - exact for "reflectance"; (..., 1) CIEDE2000 for "delta-e", of colours that are
    clipped to what a screen can show.
    """
    if metric == "reflectance":
        return np.asarray(fitted - exact)
    colours = [np.clip(surface.to_rgb(F), 0.0, 1.0) for F in (exact, fitted)]
    return np.asarray(delta_e_2000(*colours))[..., None]


def _seen(surface: Surface, difference: Callable[[np.ndarray], np.ndarray], alpha: float) -> float:
    """The error of a rough surface in light of its contrast, the largest over view and channels."""

    def moments(cos_theta: np.ndarray) -> np.ndarray:
        d = difference(cos_theta)
        return np.concatenate([np.ones_like(d[..., :1]), d, d * d], axis=-1)

    averages = directional_albedo(moments, _LOBE_COSINES, alpha, distribution=surface.distribution)
    mean, square = np.split(averages[..., 1:] / averages[..., :1], 2, axis=-1)
    deviation = np.sqrt(np.maximum(square - mean * mean, 0.0))
    return float((np.abs(mean) + np.sqrt(surface.contrast) * deviation).max())

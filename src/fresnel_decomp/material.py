"""A material: its complex index of refraction over wavelength, and what that is in RGB.

Between samples eta and k are linear unless asked otherwise; beyond the ends they are constant.
`spectra` finds and reads them.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._check import choose, input_error
from .colour import WAVELENGTH_NM, Illuminant, rgb_weights
from .fresnel import conductor

if TYPE_CHECKING:
    from .basis import Basis

__all__ = ["INTERPOLATIONS", "Material"]

Array = NDArray[np.float64]

INTERPOLATIONS = ("linear", "pchip", "cubic")
"""Between samples: straight lines, monotone cubics (Fritsch and Butland 1984), or a cubic spline
(not-a-knot), which is smooth and may overshoot."""


@dataclass(frozen=True, eq=False)
class Material:
    """A complex index of refraction, sampled over wavelength.

    Parameters
    ----------
    name : str
    wavelength_nm : (n,) float > 0
        Strictly increasing, in nm.
    eta, k : (n,) float
        eta > 0 and k >= 0: the index is eta + i k, relative to vacuum.
    source : str
        Where the data come from.
    aliases : tuple of str
        Other names that `load_material` knows.
    flags : tuple of str
        What is wrong with the data: "partial: ..." or "broken: ..."; empty if usable.
    reference : str
        Who published them, as the source says; empty if it does not.
    interpolation : {"linear", "pchip", "cubic"}
        Between samples; see `INTERPOLATIONS`.

    Raises
    ------
    InputError
        For other shapes and ranges than these, and for a cubic spline that leaves eta > 0, k >= 0
        between samples.

    Examples
    --------
    >>> from fresnel_decomp import load_material
    >>> eta, k = load_material("gold").at(550.0)
    >>> print(f"{eta:.3f} + {k:.3f}i")
    0.350 + 2.714i
    """

    name: str
    wavelength_nm: Array
    eta: Array
    k: Array
    source: str
    aliases: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()
    reference: str = ""
    interpolation: str = "linear"

    def __post_init__(self) -> None:
        for column in ("wavelength_nm", "eta", "k"):
            values = np.array(getattr(self, column), dtype=np.float64)
            values.flags.writeable = False
            object.__setattr__(self, column, values)
        _check_spectrum(self.name, self.wavelength_nm, self.eta, self.k)
        choose("interpolation", self.interpolation, INTERPOLATIONS)
        if self.interpolation == "cubic":
            eta, k = self.at(WAVELENGTH_NM)
            if eta.min() <= 0.0 or k.min() < 0.0:
                raise input_error(
                    f"the cubic spline of {self.name!r} falls to eta = {eta.min():g}, "
                    f"k = {k.min():g}",
                    "one that stays at eta > 0 and k >= 0",
                    "Use interpolation='pchip', which does not overshoot.",
                )

    @property
    def range_nm(self) -> tuple[float, float]:
        """First and last sampled wavelength, in nm."""
        return float(self.wavelength_nm[0]), float(self.wavelength_nm[-1])

    def at(self, wavelength_nm: ArrayLike) -> tuple[Any, Any]:
        """The index at given wavelengths, by `interpolation`, constant beyond the ends.

        Parameters
        ----------
        wavelength_nm : (...) float

        Returns
        -------
        eta, k : (...) float
            Relative to vacuum.

        Examples
        --------
        >>> from fresnel_decomp import load_material
        >>> eta, k = load_material("Au").at([400.0, 700.0])
        >>> eta.round(2)
        array([1.66, 0.16])
        """
        at = np.asarray(wavelength_nm, dtype=np.float64)
        if self.interpolation == "linear" or self.wavelength_nm.size < 3:
            return np.interp(at, self.wavelength_nm, self.eta), np.interp(
                at, self.wavelength_nm, self.k
            )
        from scipy.interpolate import CubicSpline, PchipInterpolator

        method = PchipInterpolator if self.interpolation == "pchip" else CubicSpline
        inside = np.clip(at, *self.range_nm)
        eta, k = (method(self.wavelength_nm, values)(inside) for values in (self.eta, self.k))
        return eta, k

    def rgb_reflectance(
        self, cos_theta: ArrayLike, illuminant: Illuminant = "D65", **convention: str
    ) -> Array:
        """Linear RGB of the exact reflectance, integrated over the spectrum.

        Parameters
        ----------
        cos_theta : (...) float in [0, 1]
            Clamped to that range.
        illuminant : str or (wavelength_nm, power)
        **convention : str
            `observer`, `colourspace` and `adaptation`; all four as in `rgb_weights`.

        Returns
        -------
        (..., 3) float
            A perfect reflector is (1, 1, 1); a saturated metal may leave [0, 1].

        Raises
        ------
        InputError
            As `fresnel.conductor` and `rgb_weights` do.

        Examples
        --------
        >>> from fresnel_decomp import load_material
        >>> load_material("Au").rgb_reflectance(1.0).round(3)
        array([1.022, 0.782, 0.343])
        """
        weights = rgb_weights(illuminant, **convention)
        cosine = np.asarray(cos_theta, dtype=np.float64)[..., None]
        return conductor(cosine, *self.at(WAVELENGTH_NM)) @ weights.T

    def rgb_coefficients(
        self, basis: Basis, illuminant: Illuminant = "D65", **convention: str
    ) -> Array:
        """Coefficients (3, terms) of the spectrally integrated reflectance in `basis`.

        Integration and projection are linear and commute, so the whole spectrum is projected by
        its RGB reflectance at 0° and at the nodes. The coefficients may leave [0, 1]: never clamp
        them.

        Parameters
        ----------
        basis : Basis
        illuminant : str or (wavelength_nm, power)
        **convention : str
            Both as for `rgb_reflectance`.

        Returns
        -------
        (3, terms) float
            One row for each channel.

        Raises
        ------
        InputError
            As `rgb_reflectance` does.

        Examples
        --------
        >>> from fresnel_decomp import load_basis, load_material
        >>> load_material("Au").rgb_coefficients(load_basis()).shape
        (3, 4)
        """
        cos_theta = np.cos(np.array([0.0, *basis.nodes]))
        f = self.rgb_reflectance(cos_theta, illuminant, **convention)
        return basis.coefficients_from_reflectance(f[0], f[1:].T)

    def rgb_indices(self, illuminant: Illuminant = "D65", **convention: str) -> tuple[Array, Array]:
        """One index per channel, (eta (3,), k (3,)): what engines feed into the equations.

        The white-normalised average of eta and k. The weights have negative lobes; where they
        drive a channel out of range, eta becomes its smallest sample and k becomes 0, and a
        warning is logged if that changes anything by more than 1e-3.

        Parameters
        ----------
        illuminant : str or (wavelength_nm, power)
        **convention : str
            Both as for `rgb_reflectance`.

        Returns
        -------
        eta, k : (3,) float
            eta > 0 and k >= 0, relative to vacuum.

        Raises
        ------
        InputError
            As `rgb_weights` does.

        Examples
        --------
        >>> from fresnel_decomp import load_material
        >>> eta, k = load_material("Au").rgb_indices()
        >>> eta.round(3)
        array([0.08 , 0.405, 1.561])
        """
        weights = rgb_weights(illuminant, **convention)
        raw_eta, raw_k = (weights @ values for values in self.at(WAVELENGTH_NM))
        eta, k = np.where(raw_eta > 0.0, raw_eta, self.eta.min()), np.maximum(raw_k, 0.0)
        if max(np.abs(eta - raw_eta).max(), np.abs(k - raw_k).max()) > 1e-3:
            logging.getLogger(__name__).warning(
                "%s: RGB indices eta=%s, k=%s moved into eta > 0, k >= 0", self.name, raw_eta, raw_k
            )
        return eta, k


def _check_spectrum(name: str, wavelength_nm: Array, eta: Array, k: Array) -> None:
    if wavelength_nm.ndim != 1 or not (wavelength_nm.shape == eta.shape == k.shape != (0,)):
        raise input_error(
            f"{name!r} has wavelength_nm, eta, k of shapes "
            f"{wavelength_nm.shape}, {eta.shape}, {k.shape}",
            "three arrays of the same shape (n,), n >= 1",
            "Interpolate eta and k to one grid first.",
        )
    rising = np.diff(wavelength_nm, prepend=0.0) > 0.0
    for symbol, values, valid, accepted, advice in (
        ("wavelength_nm", wavelength_nm, rising, "strictly increasing values > 0", "Sort them."),
        ("eta", eta, eta > 0.0, "eta > 0", "Remove gaps that are marked by other values."),
        ("k", k, k >= 0.0, "k >= 0", "Negate k if your data follow the convention eta - i k."),
    ):
        wrong = np.flatnonzero(~(valid & np.isfinite(values)))
        if wrong.size:
            at = wrong[0]
            raise input_error(
                f"{name!r} has {symbol} = {values[at]:g} at sample {at} ({wavelength_nm[at]:g} nm)",
                f"{accepted}, finite",
                advice,
            )

"""Light, eye and display: spectra to linear RGB by one weight matrix, and colour differences.

RGB = W F(λ) with W of shape (3, N) on the 1 nm grid `WAVELENGTH_NM`. Each row of W sums to one, so
that a perfect reflector is white, (1, 1, 1), under every illuminant. Where the white of the light
is not that of the space, this takes a chromatic adaptation: a von Kries scaling, by default per
channel of the linear RGB space itself ("rgb"). That is what a renderer multiplies with: W F times
the RGB of the light is the RGB of the reflected light, exactly. "bradford", "cat02" and "cat16"
scale in sharpened cone responses instead: how the surface looks to an eye adapted to the light.
Values outside [0, 1] are colours that the space cannot hold (gold's red) and are kept;
`gamut_excess` reports them.

Tables come from colour-science: observers at 1 nm, illuminants interpolated linearly from 5 nm and
held constant beyond their ends (CIE 015:2018, section 7), spaces by their primaries and white
point at full precision (not the rounded matrices of their standards). It takes seconds to import,
so the first call that needs it imports it.
"""

from __future__ import annotations

import reprlib
import warnings
from collections.abc import Collection, Mapping
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._check import choose, input_error

__all__ = [
    "ADAPTATIONS",
    "ILLUMINANTS",
    "OBSERVERS",
    "RGB_SPACES",
    "WAVELENGTH_NM",
    "Illuminant",
    "delta_e_2000",
    "gamut_excess",
    "linear_to_srgb",
    "luminance_weights",
    "rgb_weights",
    "srgb_hex",
]

Illuminant = str | tuple[ArrayLike, ArrayLike]
"""A name of colour-science, or (wavelength_nm, power) of any scale."""

WAVELENGTH_NM = np.arange(360.0, 831.0)
WAVELENGTH_NM.flags.writeable = False

ILLUMINANTS = ("D65", "D50", "A", "E")
ADAPTATIONS = {"rgb": "", "bradford": "Bradford", "cat02": "CAT02", "cat16": "CAT16"}
"""Chromatic adaptations: by name, the transform of colour-science that it scales in."""

OBSERVERS = ("cie_2_1931", "cie_10_1964")
RGB_SPACES = {
    "sRGB": "sRGB",
    "Rec.709": "ITU-R BT.709",
    "Rec.2020": "ITU-R BT.2020",
    "ACEScg": "ACEScg",
    "Display P3": "Display P3",
}


def rgb_weights(
    illuminant: Illuminant = "D65",
    observer: str = "cie_2_1931",
    colourspace: str = "sRGB",
    adaptation: str = "rgb",
) -> NDArray[np.float64]:
    """The matrix W that turns a reflectance spectrum into white-normalised linear RGB.

    Parameters
    ----------
    illuminant : str or (wavelength_nm, power)
        "D65", "D50", "A", "E" or another name of colour-science; or two arrays of the same shape
        (n,), wavelengths in nm increasing and covering 400–700, power >= 0 and of any scale,
        linear in between and constant beyond the ends.
    observer : {"cie_2_1931", "cie_10_1964"}
        CIE 1931 2° or CIE 1964 10° colour-matching functions.
    colourspace : str
        "sRGB", "Rec.709", "Rec.2020", "ACEScg", "Display P3" or another name of colour-science.
        Only its primaries and white point matter: the result is linear.
    adaptation : {"rgb", "bradford", "cat02", "cat16"}
        From the white of the illuminant to that of the space; see the module. For D65 and sRGB
        the two whites nearly agree and so do all choices, to 1e-4.

    Returns
    -------
    (3, 471) float
        Rows r, g, b over `WAVELENGTH_NM`, each with sum 1; some entries are negative.

    Raises
    ------
    InputError
        For an unknown name, an invalid user spectrum, or an illuminant whose white has a channel
        <= 0 in `colourspace` (no reflectance can be expressed relative to it).

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp.colour import WAVELENGTH_NM, rgb_weights
    >>> np.round(rgb_weights("A") @ np.full(WAVELENGTH_NM.size, 0.5), 12)
    array([0.5, 0.5, 0.5])
    """
    power = _power(illuminant)
    matching = _matching_functions(choose("observer", observer, OBSERVERS))
    method = ADAPTATIONS[choose("adaptation", adaptation, ADAPTATIONS)]
    xyz = matching * power
    if method:
        xyz = _adapted(xyz / xyz[1].sum(), method, colourspace)
    weights = np.linalg.solve(_rgb_to_xyz(colourspace), xyz)
    white = weights.sum(axis=1, keepdims=True)
    if white.min() <= 0.0:
        raise input_error(
            f"an illuminant with a white of RGB ({', '.join(f'{x:.3g}' for x in white[:, 0])})",
            f"one whose white is inside the gamut of {colourspace}",
            "Choose a wider space, e.g. colourspace='Rec.2020'.",
        )
    return weights / white


def luminance_weights(
    illuminant: Illuminant = "D65", observer: str = "cie_2_1931"
) -> NDArray[np.float64]:
    """The weights (471,) over `WAVELENGTH_NM` that turn a reflectance into relative luminance.

    Parameters and errors as for `rgb_weights`; the sum is 1.

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp.colour import luminance_weights
    >>> round(float(luminance_weights("A") @ np.full(471, 0.5)), 12)
    0.5
    """
    power = _power(illuminant)
    weights = _matching_functions(choose("observer", observer, OBSERVERS))[1] * power
    return weights / weights.sum()


def delta_e_2000(
    rgb_a: ArrayLike, rgb_b: ArrayLike, colourspace: str = "sRGB"
) -> NDArray[np.float64]:
    """CIEDE2000 colour difference of linear RGB values, adapted to the white (1, 1, 1).

    Parameters
    ----------
    rgb_a, rgb_b : (..., 3) float
        Linear values on the 0–1 scale of `rgb_weights`; they broadcast. Negative ones and those
        above one are compared as they are, without clipping.
    colourspace : str
        The space of both, as for `rgb_weights`.

    Returns
    -------
    (...) float
        ΔE00 with k_L = k_C = k_H = 1 (ISO/CIE 11664-6); 1 is about a just noticeable difference.

    Raises
    ------
    InputError
        If the last axis is not 3, or the space is unknown.

    Examples
    --------
    >>> from fresnel_decomp.colour import delta_e_2000
    >>> round(float(delta_e_2000([0.5, 0.5, 0.5], [0.51, 0.5, 0.5])), 2)
    0.89
    """
    colour = _colour()
    to_xyz = _rgb_to_xyz(colourspace)
    white = _space(colourspace).whitepoint
    with colour.domain_range_scale("Reference"):  # XYZ of white has Y = 1, Lab has L* = 100
        lab_a, lab_b = (
            colour.XYZ_to_Lab(_triples(rgb) @ to_xyz.T, white) for rgb in (rgb_a, rgb_b)
        )
        return colour.delta_E(lab_a, lab_b, method="CIE 2000")


def gamut_excess(rgb: ArrayLike) -> NDArray[np.float64]:
    """How far linear values (any shape) are outside [0, 1]: below 0 negative, above 1 positive.

    Nothing here clips; this tells what a display will.

    Examples
    --------
    >>> from fresnel_decomp.colour import gamut_excess
    >>> gamut_excess([1.022, 0.782, -0.01]).round(3)
    array([ 0.022,  0.   , -0.01 ])
    """
    values = np.asarray(rgb, dtype=np.float64)
    return values - np.clip(values, 0.0, 1.0)


def linear_to_srgb(rgb: ArrayLike) -> NDArray[np.float64]:
    """Encode linear values (any shape) for display, clipped to [0, 1] (IEC 61966-2-1).

    Examples
    --------
    >>> from fresnel_decomp.colour import linear_to_srgb
    >>> linear_to_srgb([-0.1, 0.002, 2.0])
    array([0.     , 0.02584, 1.     ])
    """
    linear = np.clip(np.asarray(rgb, dtype=np.float64), 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def srgb_hex(rgb: ArrayLike) -> str:
    """The sRGB colour of one linear triple (3,) as text, clipped to [0, 1].

    Examples
    --------
    >>> from fresnel_decomp.colour import srgb_hex
    >>> srgb_hex([1.022, 0.782, 0.344])
    '#ffe59e'
    """
    red, green, blue = np.rint(255.0 * linear_to_srgb(_triples(rgb))).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"


# --- tables --------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def _colour() -> ModuleType:
    """colour-science without the side effects of its import.

    It warns about absent optional packages and turns on NumPy's legacy printing for everyone.
    """
    with warnings.catch_warnings(), np.printoptions():
        warnings.simplefilter("ignore")
        import colour
    return colour


def _entry(kind: str, name: str, table: Mapping[str, Any], common: Collection[str]) -> Any:
    """`table[name]`; the error for an unknown name lists the `common` ones."""
    return table[name if name in table else choose(kind, name, common)]


def _power(illuminant: Illuminant) -> NDArray[np.float64]:
    """(471,) power of a light over `WAVELENGTH_NM`, of any scale."""
    if isinstance(illuminant, str):
        spectrum = _entry("illuminant", illuminant, _colour().SDS_ILLUMINANTS, ILLUMINANTS)
        return np.interp(WAVELENGTH_NM, spectrum.wavelengths, spectrum.values)
    try:
        wavelength, value = (np.asarray(x, dtype=np.float64) for x in illuminant)
    except (TypeError, ValueError):  # no pair, or no numbers
        raise input_error(
            f"an illuminant {reprlib.repr(illuminant)}",
            f"{', '.join(map(repr, ILLUMINANTS))} or another name of colour-science, or two arrays "
            "of numbers",
            "Give a spectrum as (wavelength_nm, power).",
        ) from None
    valid = (
        wavelength.ndim == 1
        and wavelength.shape == value.shape
        and wavelength.size > 1
        and bool(np.isfinite([wavelength, value]).all() and (np.diff(wavelength) > 0.0).all())
        and bool((value >= 0.0).all() and value.any())
    )
    if not valid:
        raise input_error(
            f"an illuminant of shapes {wavelength.shape} and {value.shape} that is no spectrum",
            "(wavelength_nm, power): two finite arrays (n,), wavelengths increasing, power >= 0",
            "Sort by wavelength and remove repeated or negative samples.",
        )
    if wavelength[0] > 400.0 or wavelength[-1] < 700.0:
        raise input_error(
            f"an illuminant over {wavelength[0]:g}–{wavelength[-1]:g} nm",
            "one that covers 400–700 nm",
            "Extend it with its own values, or with zeros for a line or a narrow band.",
        )
    return np.interp(WAVELENGTH_NM, wavelength, value)


@lru_cache
def _matching_functions(observer: str) -> NDArray[np.float64]:
    """(3, 471) colour-matching functions; colour-science tabulates them on our very grid."""
    table = _colour().MSDS_CMFS[observer]
    return np.array([np.interp(WAVELENGTH_NM, table.wavelengths, row) for row in table.values.T])


def _adapted(xyz: NDArray[np.float64], method: str, colourspace: str) -> NDArray[np.float64]:
    """XYZ weights (3, n) of a light, its white scaled to that of the space in cone responses."""
    cones = np.asarray(_colour().CHROMATIC_ADAPTATION_TRANSFORMS[method])
    target = cones @ _rgb_to_xyz(colourspace).sum(axis=1)
    scale = target / (cones @ xyz.sum(axis=1))
    return np.linalg.solve(cones, scale[:, None] * (cones @ xyz))


def _space(colourspace: str) -> Any:
    name = RGB_SPACES.get(colourspace, colourspace)
    return _entry("colourspace", name, _colour().RGB_COLOURSPACES, RGB_SPACES)


@lru_cache
def _rgb_to_xyz(colourspace: str) -> NDArray[np.float64]:
    """(3, 3), by the primaries and white point of the space; maps (1, 1, 1) to Y = 1."""
    space = _space(colourspace)
    return _colour().normalised_primary_matrix(space.primaries, space.whitepoint)


def _triples(rgb: ArrayLike) -> NDArray[np.float64]:
    values = np.asarray(rgb, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] != 3:
        raise input_error(
            f"RGB values of shape {values.shape}", "shape (..., 3)", "Put the channels last."
        )
    return values

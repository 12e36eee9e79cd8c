"""The data sets of refractive indices in the installed Mitsuba package, by name and alias.

They are read where they lie: nothing is copied, and Mitsuba is found without importing it.
"""

from __future__ import annotations

import difflib
import importlib.util
from functools import lru_cache
from pathlib import Path

from ._check import input_error

__all__ = ["ALIASES", "data_set_files", "data_sets", "find_data_set"]

ALIASES = {
    "a-C": ("amorphous carbon",),
    "Ag": ("silver",),
    "Al": ("aluminium", "aluminum"),
    "AlAs": ("aluminium arsenide", "aluminum arsenide"),
    "AlSb": ("aluminium antimonide", "aluminum antimonide"),
    "Au": ("gold",),
    "Be": ("beryllium",),
    "Cr": ("chromium", "chrome"),
    "CsI": ("caesium iodide", "cesium iodide"),
    "Cu": ("copper",),
    "Cu2O": ("cuprous oxide",),
    "CuO": ("cupric oxide",),
    "d-C": ("diamond",),
    "Hg": ("mercury",),
    "HgTe": ("mercury telluride",),
    "Ir": ("iridium",),
    "K": ("potassium",),
    "Li": ("lithium",),
    "MgO": ("magnesium oxide",),
    "Mo": ("molybdenum",),
    "Na_palik": ("Na", "sodium"),
    "Nb": ("niobium",),
    "Ni_palik": ("Ni", "nickel"),
    "Rh": ("rhodium",),
    "Se": ("selenium",),
    "SiC": ("silicon carbide",),
    "SnTe": ("tin telluride",),
    "Ta": ("tantalum",),
    "Te": ("tellurium",),
    "ThF4": ("thorium fluoride",),
    "TiC": ("titanium carbide",),
    "TiN": ("titanium nitride",),
    "TiO2": ("titanium dioxide", "rutile"),
    "V_palik": ("V", "vanadium"),
    "VC": ("vanadium carbide",),
    "VN": ("vanadium nitride",),
    "W": ("tungsten", "wolfram"),
}


@lru_cache(maxsize=1)
def data_sets() -> tuple[str, ...]:
    """All names, sorted."""
    names = (path.name.removesuffix(".eta.spd") for path in _folder().glob("*.eta.spd"))
    return tuple(sorted(names, key=lambda name: (name.casefold(), name)))


def data_set_files(name: str) -> tuple[Path, Path]:
    """The files of eta and of k."""
    return _folder() / f"{name}.eta.spd", _folder() / f"{name}.k.spd"


def find_data_set(name: str, others: str = "a .spd or .csv file") -> str:
    """The data set of this name or alias, in any case; the error names the nearest ones.

    `others` is what the caller accepts beside names.
    """
    known = {
        key.casefold(): data_set
        for data_set in data_sets()
        for key in (data_set, *ALIASES.get(data_set, ()))
    }
    if name.casefold() in known:
        return known[name.casefold()]
    matches = difflib.get_close_matches(name.casefold(), known, n=3, cutoff=0.5)
    near = dict.fromkeys(known[match] for match in matches)
    raise input_error(
        f"material {name!r} is unknown",
        f"a name or alias that `fresnel-decomp materials` lists, or {others}",
        f"Did you mean {' or '.join(map(repr, near))}?" if near else "Choose one of these.",
    )


@lru_cache(maxsize=1)
def _folder() -> Path:
    spec = importlib.util.find_spec("mitsuba")
    folder = Path(spec.origin).parent / "data" / "ior" if spec and spec.origin else None
    if folder is None or not folder.is_dir():
        raise input_error(
            "no measured materials are installed",
            "a Mitsuba 3.9 package, which brings them, or a file of your own",
            "Install it with: pip install 'mitsuba>=3.9.1,<3.10'",
        )
    return folder

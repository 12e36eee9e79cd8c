"""What columns of a benchmark are called, and how numbers of it are written."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from .pareto import two_digits
from .run import KINDS, Row

__all__ = [
    "BUILT_IN",
    "COSTS",
    "ERRORS",
    "LIMITS",
    "ROUGH",
    "count",
    "error_text",
    "listed",
    "pair",
    "ratio",
    "short",
    "span",
]

_CHOSEN = ("compute", "streaming", "bsdf", "render")
COSTS = {f"{kind}_ratio": KINDS[kind] for kind in _CHOSEN}
COSTS |= {"bytes": "bytes", "operations": "operations and loads"}
"""Columns of costs that fronts are drawn for, and what they are called."""

ERRORS = {
    "worst_max": "largest error, all four sets",
    "d_max": "largest error, measured materials",
    "d_rmse": "RMSE, measured materials",
    "d_albedo_mean": "mean error of the albedo, measured materials",
    "delta_e_mean": "mean ΔE00, measured materials",
}
"""Errors that fronts are drawn for; sets are those of `accuracy.SETS`, measured materials set d."""

_BUDGETS = (0.25, 0.5, 0.75, 1.0, 1.5)
LIMITS = {
    "compute_ratio": _BUDGETS,
    "streaming_ratio": _BUDGETS,
    "bsdf_ratio": (0.6, 0.7, 0.8, 1.0),
    "render_ratio": (0.95, 1.0, 1.05, 1.1),
    "bytes": (16, 64, 128, 256, 1024),
    "operations": (10, 25, 50, 75, 100),
}
"""Budgets of each kind of cost that tables are made for."""

BUILT_IN = "mi.fresnel_conductor"  # candidates.BASE, which only loads where Mitsuba has a variant

ROUGH = 0.5
"""Share of a ratio that its spread may be before the ratio is marked."""


def ratio(row: Row, kind: str, missing: str = "–") -> str:
    """A time and its spread; † where it says little more than an order of magnitude."""
    value = row.get(f"{kind}_ratio")
    if value is None:
        return missing
    spread = row[f"{kind}_spread"]
    mark = " †" if spread > ROUGH * value else ""
    return f"{value:.2f} ± {spread:.2f}{mark}"


def pair(row: Row, first: str, second: str, digits: int = 4) -> str:
    """Two errors."""
    one, two = row.get(first), row.get(second)
    if one is None or two is None:
        return "–"
    return f"{short(one, digits)} / {short(two, digits)}"


def short(value: float, digits: int = 4) -> str:
    """So many decimals, or a power of ten for what they cannot show."""
    return f"{value:.{digits}f}" if value >= 0.5 * 10.0**-digits else f"{value:.0e}"


def error_text(value: float) -> str:
    """An error as fronts count it: with two digits.

    Examples
    --------
    >>> error_text(0.01394), error_text(0.1), error_text(1.07e-5)
    ('0.014', '0.10', '1.1e-05')
    """
    value = two_digits(value)
    return f"{value:#.2g}".rstrip(".") if value >= 1e-4 else f"{value:.1e}"


def count(value: int | None) -> str:
    """A number of operations; a dash where they cannot be counted."""
    return "–" if value is None else str(value)


def span(values: Iterable[float | None], digits: int = 2) -> str:
    """The least and the greatest."""
    known = [f"{value:.{digits}f}" for value in values if value is not None]
    if not known:
        return "–"
    low, high = min(known, key=float), max(known, key=float)
    return low if low == high else f"{low}–{high}"


def listed(names: Sequence[str]) -> str:
    """Names of models, which have commas in them, as a list."""
    plain = [name.replace(", ", " with ") if "terms" in name else name for name in names]
    return plain[0] if len(plain) == 1 else f"{'; '.join(plain[:-1])} and {plain[-1]}"

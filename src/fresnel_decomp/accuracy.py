"""How far models are from the exact equations: reflectance, directional albedo, and colour.

The sets are those of `curves`: a (dielectrics), cp (Gulbrandsen's parameters), d (every measured
material that ships with Mitsuba), low (low-index conductors). The largest error is over all of
`curves.error_cosines`, which is dense at grazing incidence; mean and RMSE are over 2,049 cosines,
uniform on [0, 1], and all curves of the set. The albedo is that of a rough surface (GGX, separable
Smith), at views whose cosine is in [0, 1] and alpha in [.08, 1].
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._coefficients import TERMS
from .basis import Basis, load_basis
from .colour import delta_e_2000
from .curves import SETS, CurveSet, error_cosines
from .material import Material
from .models import F82, Lazanyi, Schlick
from .recipes import RECIPES
from .regression import albedo_operator
from .spectra import list_materials, load_material

__all__ = [
    "COLOUR_DEGREES",
    "RECIPE_ORDER",
    "SETS",
    "TERMS",
    "ColourErrors",
    "Errors",
    "colour_errors",
    "decomposition",
    "fits",
    "measure",
    "usable_materials",
]

RECIPE_ORDER = ("notebook", *(recipe for recipe in RECIPES if recipe != "notebook"))
COLOUR_DEGREES = np.arange(91.0)
"""Angles at which colours are compared."""

Array = NDArray[np.float64]
Fit = Callable[[Array, Array], Array]
"""From (n,) eta and k to (n, m) reflectances at given (m,) cosines."""

_CHUNK = 128  # curves at a time: 4 MB for each array


@dataclass(frozen=True)
class Errors:
    """Absolute errors of one model on one set of curves."""

    max: float
    p99: float
    """Over curves, of the largest error of each."""
    mean: float
    rmse: float
    worst_eta: float
    worst_k: float
    worst_degrees: float
    albedo_max: float
    """Of the directional albedo."""
    albedo_p99: float
    albedo_mean: float
    albedo_rmse: float


@dataclass(frozen=True)
class ColourErrors:
    """CIEDE2000 under D65, over all materials and angles."""

    max: float
    p99: float
    mean: float
    rmse: float


def fits(cos_theta: Array) -> dict[str, Fit]:
    """For each model, a function from (n,) indices to (n, m) reflectances at (m,) cosines."""
    return {
        "Schlick": lambda eta, k: Schlick.from_ior(eta[:, None], k[:, None])(cos_theta),
        "Lazanyi": lambda eta, k: Lazanyi.from_ior(eta[:, None], k[:, None])(cos_theta),
        "F82": lambda eta, k: F82.from_ior(eta[:, None], k[:, None])(cos_theta),
        **{
            f"{recipe}, {terms} terms": decomposition(load_basis(recipe, terms), cos_theta)
            for recipe in RECIPE_ORDER
            for terms in TERMS
        },
    }


def decomposition(basis: Basis, cos_theta: Array) -> Fit:
    """As in `fits`, for one basis."""
    functions = basis(cos_theta).T
    return lambda eta, k: basis.coefficients(eta, k, poor_fit="keep") @ functions


def measure(
    curve_set: CurveSet,
    advance: Callable[[int], object] = lambda count: None,
    only: Iterable[str] | None = None,
    models: Callable[[Array], dict[str, Fit]] = fits,
    exact: Callable[[CurveSet, Array], Array] = CurveSet.reflectance,
    chunk: int = _CHUNK,
) -> dict[str, Errors]:
    """Errors of every model on a set of curves, a few curves at a time.

    Parameters
    ----------
    curve_set : CurveSet
    advance : callable
        Told the number of curves that were finished.
    only : names of `models`, default all of them
    models : callable
        From (m,) cosines to a `Fit` for each model, by name.
    exact : callable
        From a set and (m,) cosines to (n, m) exact reflectances.
    chunk : int
        Curves at a time.

    Examples
    --------
    >>> from fresnel_decomp import curves
    >>> from fresnel_decomp.accuracy import measure
    >>> found = measure(curves.dielectrics(), only=["Schlick", "talk, 4 terms"])
    >>> {name: round(errors.max, 3) for name, errors in found.items()}
    {'Schlick': 0.55, 'talk, 4 terms': 0.087}
    """
    cos_theta, uniform = error_cosines()
    functions = models(cos_theta)
    functions = {name: functions[name] for name in (only or functions)}
    points, operator, weights = albedo_operator()
    at_points = models(points)
    largest = {name: np.zeros(len(curve_set)) for name in functions}
    place = {name: np.zeros(len(curve_set), int) for name in functions}
    sums = {name: np.zeros(2) for name in functions}
    albedo = {name: np.zeros(2) for name in functions}
    albedo_largest = {name: np.zeros(len(curve_set)) for name in functions}
    for start in range(0, len(curve_set), chunk):
        rows = slice(start, min(start + chunk, len(curve_set)))
        eta, k = curve_set.eta[rows], curve_set.k[rows]
        truth, truth_at_points = (exact(curve_set.take(rows), c) for c in (cos_theta, points))
        for name, fit in functions.items():
            error = fit(eta, k)
            np.abs(np.subtract(error, truth, out=error), out=error)
            place[name][rows] = at = error.argmax(axis=1)
            largest[name][rows] = error[np.arange(len(at)), at]
            first = error[:, : len(uniform)]
            sums[name] += first.sum(), np.einsum("ij,ij->", first, first)
            error = np.abs((at_points[name](eta, k) - truth_at_points) @ operator.T)
            albedo_largest[name][rows] = error.max(axis=1)
            albedo[name] += (error @ weights).sum(), (error**2 @ weights).sum()
        advance(len(eta))
    results = {}
    for name in functions:
        mean, square = sums[name] / (len(curve_set) * len(uniform))
        albedo_mean, albedo_square = albedo[name] / len(curve_set)
        worst = int(largest[name].argmax())
        results[name] = Errors(
            max=float(largest[name][worst]),
            p99=float(np.percentile(largest[name], 99)),
            mean=float(mean),
            rmse=float(np.sqrt(square)),
            worst_eta=float(curve_set.eta[worst]),
            worst_k=float(curve_set.k[worst]),
            worst_degrees=float(np.degrees(np.arccos(cos_theta[place[name][worst]]))),
            albedo_max=float(albedo_largest[name].max()),
            albedo_p99=float(np.percentile(albedo_largest[name], 99)),
            albedo_mean=float(albedo_mean),
            albedo_rmse=float(np.sqrt(albedo_square)),
        )
    return results


def usable_materials() -> list[Material]:
    """The distinct measured materials whose spectra cover the visible."""
    return [
        load_material(row.name) for row in list_materials() if row.usable and not row.duplicate_of
    ]


def colour_errors(fit: Sequence[Array], exact: Sequence[Array]) -> ColourErrors:
    """Differences of colours in linear sRGB, one (angles, 3) array for each material."""
    error = delta_e_2000(np.stack(fit), np.stack(exact))
    return ColourErrors(
        max=float(error.max()),
        p99=float(np.percentile(error, 99)),
        mean=float(error.mean()),
        rmse=float(np.sqrt((error**2).mean())),
    )

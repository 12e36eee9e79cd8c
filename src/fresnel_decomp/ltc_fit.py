r"""Fits linearly transformed cosines to reflection lobes of GGX.

For each view angle and roughness, the four numbers of a `Lobe` are those that minimise

    ∫ (f - D)² / (f + D) dw,

f being the lobe of a white surface over its own integral. This measure lies between the squared
error, which sees little but the peak, and the absolute one.

The integral is a sum over two sets of directions, mirrored at visible normals and spread from the
mirror direction over the hemisphere, weighted by the sum of their densities (balance heuristic):
the first resolves the peak, the second what D may have where f has nothing. Directions are those of
a fixed lattice, so the fit is deterministic. Columns of a table are fitted from rough to smooth,
each from the one before; columns know nothing of one another.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ._check import choose, input_error, is_whole
from .ltc import LEAST_ALPHA, Lobe
from .microfacet import (
    SMITH,
    Smith,
    half_vector,
    ndf,
    projected_area,
    reflect,
    sample_visible_normal,
    shadowing,
)

__all__ = ["MEASURE", "NODES", "TIE", "Fit", "Samples", "fit_column", "fit_lobe", "lobe_samples"]

NODES = 2048
"""Directions of either set, over half of the hemisphere: lobes are symmetric."""

MEASURE = "integral of (f - D)² / (f + D)"
"""What is minimised, in words."""

_NEAR_NORMAL = 0.97
"""Cosine of 14°, whose n1 and n2 are those of normal incidence, where they do not matter."""

TIE = 0.1
"""Weight of the distance from the start: what the lobe does not determine stays as it is beside."""

_PLASTIC = 1.32471795724474602596  # of the lattice: its powers are badly approximable together


class Samples(NamedTuple):
    """Directions, the lobe there, and the weights of a sum over them."""

    direction: NDArray[np.float64]
    """(3, n), with y > 0; the weights count the mirrored ones."""
    lobe: NDArray[np.float64]
    """f, the BRDF of a white surface times the cosine of the light, of integral 1."""
    weight: NDArray[np.float64]
    albedo: float
    """The integral before."""


class Fit(NamedTuple):
    """What was found for a view angle and roughness."""

    residual: tuple[float, float, float, float]
    """n0 ... n3 of the `Lobe`."""
    distance: float
    """Half the integral of |f - D|: the share of the light that goes the wrong way."""
    converged: bool


def lobe_samples(
    mu: float, alpha: float, smith: Smith = "separable", count: int = NODES
) -> Samples:
    """The lobe of GGX for a view angle, where it matters.

    Parameters
    ----------
    mu : float in [0, 1]
    alpha : float in [1e-4, 1]
    smith : {"separable", "correlated"}
    count : int
        Directions of either set.

    Returns
    -------
    Samples

    Examples
    --------
    >>> samples = lobe_samples(0.6, 0.3)
    >>> bool(abs(samples.weight @ samples.lobe - 1.0) < 1e-12)
    True
    """
    view = (math.sqrt((1.0 - mu) * (1.0 + mu)), 0.0, mu)
    i = np.arange(count) + 0.5
    u, v = i / count, (i / _PLASTIC) % 1.0
    mirrored = reflect(view, sample_visible_normal(view, alpha, 0.5 * v, u))
    # away from the mirror direction by u³ in elevation and v³ in azimuth
    z, azimuth = u**3, np.pi * v**3
    radius = np.sqrt((1.0 - z) * (1.0 + z))
    spread = (-radius * np.cos(azimuth), radius * np.sin(azimuth), z)
    direction = np.concatenate([np.stack(mirrored), np.stack(spread)], axis=1)
    direction = direction[:, direction[2] > 0.0]
    x, y, z = direction
    normal, _ = half_vector((x, y, z), tuple(np.full(len(x), c) for c in view))  # type: ignore[arg-type]
    density = ndf(normal, alpha) / (4.0 * projected_area(mu, alpha))
    lobe = density * shadowing(z, mu, alpha, smith)
    azimuth = np.arctan2(y, -x)
    beside = 1.0 / (18.0 * np.cbrt(np.pi) * np.cbrt(z * azimuth) ** 2)
    weight = 1.0 / (count * (density + beside))
    albedo = float(weight @ lobe)
    return Samples(direction, lobe / albedo, weight, albedo)


def fit_lobe(
    mu: float,
    alpha: float,
    smith: Smith = "separable",
    start: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 1.0),
    count: int = NODES,
) -> Fit:
    """Fit the lobe of one view angle and roughness.

    At normal incidence the lobe is isotropic, and so is its fit: n0 = 1 there, and n1 and n2, which
    do not matter, continue those of other angles.

    Parameters
    ----------
    mu, alpha, smith, count
        As for `lobe_samples`.
    start : four float
        n0 ... n3 of something near.

    Returns
    -------
    Fit

    Examples
    --------
    >>> fit_lobe(1.0, 0.01).residual[0], round(fit_lobe(1.0, 0.01).residual[3], 2)
    (1.0, 1.0)
    """
    from scipy.optimize import least_squares

    if mu == 1.0:
        beside = fit_lobe(_NEAR_NORMAL, alpha, smith, start, count).residual
        start = (1.0, *beside[1:])
    free = [3] if mu == 1.0 else [0, 1, 2, 3]
    samples = lobe_samples(mu, alpha, smith, count)
    x, y, z = samples.direction
    root = np.sqrt(samples.weight)

    def residual(unknown: NDArray[np.float64]) -> tuple[float, float, float, float]:
        n = np.array(start)
        n[free] = unknown
        return float(n[0]), float(n[1]), float(n[2]), float(n[3])

    def density(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        lobe = Lobe.from_residual(np.float64(mu), np.float64(alpha), residual(unknown))
        # where a matrix turns directions inside out, it has no lobe
        return np.nan_to_num(np.maximum(lobe.density((x, y, z)), 0.0))

    def distance(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        d = density(unknown)
        misfit = root * (samples.lobe - d) / np.sqrt(samples.lobe + d + 1e-300)
        return np.append(misfit, TIE * (unknown - first))

    first = np.array(start)[free]
    with np.errstate(divide="ignore", invalid="ignore"):  # singular matrices on the way
        found = least_squares(distance, first, method="lm", xtol=1e-7, ftol=1e-9, max_nfev=500)
    error = 0.5 * float(samples.weight @ np.abs(samples.lobe - density(found.x)))
    return Fit(residual(found.x), error, bool(found.success))


def fit_column(
    mu: float,
    alphas: NDArray[np.float64],
    smith: Smith = "separable",
    count: int = NODES,
    report: Callable[[int], None] | None = None,
) -> list[Fit]:
    """Fit the lobes of one view angle, from rough to smooth.

    Parameters
    ----------
    mu : float in [0, 1]
    alphas : (n,) float
        Ascending; what is below `LEAST_ALPHA` is fitted there.
    smith, count
        As for `lobe_samples`.
    report : callable, optional
        Told the number of fits that are done.

    Raises
    ------
    InputError
        For unknown conventions, and roughnesses that do not ascend in [0, 1].
    """
    choose("smith", smith, SMITH)
    alphas = np.asarray(alphas, np.float64)
    if (
        alphas.ndim != 1
        or not (np.diff(alphas) > 0.0).all()
        or not 0.0 <= alphas[0] <= alphas[-1] <= 1.0
    ):
        raise input_error("alphas", "ascending numbers in [0, 1]", "Layout().alpha has them.")
    if not is_whole(count, 16):
        raise input_error(f"count={count!r}", "an integer ≥ 16", f"{NODES} are enough.")
    fits: list[Fit] = []
    start = (float(mu), -1.0, 0.57, 0.57 * float(mu))
    for i, alpha in enumerate(np.maximum(alphas[::-1], LEAST_ALPHA)):
        fit = fit_lobe(float(mu), float(alpha), smith, start, count)
        start = fit.residual
        fits.append(fit)
        if report is not None:
            report(i + 1)
    return fits[::-1]

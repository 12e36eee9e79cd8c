"""Directional albedo by sampling: estimators that share nothing with the rule of `albedo`.

Both average F(wo·h) G2 / G1(wo) over visible normals h, pseudo-random or a scrambled Sobol'
sequence. They are what the rule is tested against, and what a bake would otherwise use.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ._arguments import numpy_arguments
from ._check import input_error, is_whole
from .albedo import ROUGHEST, Fresnel
from .microfacet import Distribution, Smith, reflect, sample_visible_normal, shadowing

__all__ = ["Estimate", "monte_carlo_albedo", "quasi_monte_carlo_albedo"]

_BLOCK = 1 << 16  # samples times views in memory at once


class Estimate(NamedTuple):
    """A mean and its standard deviation: arrays of shape (...) or (..., n)."""

    value: np.ndarray
    standard_error: np.ndarray


def monte_carlo_albedo(
    f: Fresnel,
    mu: Any,
    alpha: Any,
    samples: int,
    *,
    smith: Smith = "separable",
    distribution: Distribution = "ggx",
    seed: int = 0,
) -> Estimate:
    """Mean over pseudo-random visible normals, the same random numbers for every view.

    Parameters
    ----------
    f, smith, distribution
        As for `directional_albedo`, NumPy only.
    mu : (...) float in [0, 1]
    alpha : (...) float in (0, ROUGHEST]
    samples : int >= 2
    seed : int

    Returns
    -------
    Estimate

    Raises
    ------
    InputError
        For mu or alpha out of range, that are not real, do not broadcast or are Dr.Jit arrays; for
        too few samples; for unknown options.

    Examples
    --------
    >>> from fresnel_decomp.albedo_estimates import monte_carlo_albedo
    >>> white = monte_carlo_albedo(lambda cos_theta: 1.0 + 0.0 * cos_theta, 1.0, 1.0, 10_000)
    >>> bool(abs(white.value - (1.0 - np.log(2.0))) < 4.0 * white.standard_error)
    True
    """
    if not is_whole(samples, 2):
        raise input_error(
            f"samples={samples!r}", "a whole number, at least 2", "One has no standard error."
        )
    points = np.random.default_rng(seed).random((samples, 2))
    count, total, squares = _sums(f, mu, alpha, points, smith, distribution)
    mean = total / count
    variance = np.maximum(squares / count - mean * mean, 0.0)
    return Estimate(mean, np.sqrt(variance / (count - 1)))


def quasi_monte_carlo_albedo(
    f: Fresnel,
    mu: Any,
    alpha: Any,
    samples: int,
    *,
    smith: Smith = "separable",
    distribution: Distribution = "ggx",
    seed: int = 0,
    replicates: int = 8,
) -> Estimate:
    """Mean over a Sobol' sequence, in several independent scramblings of equal length.

    Parameters
    ----------
    f, mu, alpha, smith, distribution, seed
        As for `monte_carlo_albedo`.
    samples : int
        In each replicate; a power of two is best.
    replicates : int >= 1
        The standard error is taken from their spread; NaN for a single one.

    Returns
    -------
    Estimate

    Raises
    ------
    InputError
        As `monte_carlo_albedo` does, and for less than one replicate.
    """
    from scipy.stats import qmc

    if not (is_whole(samples, 1) and is_whole(replicates, 1)):
        raise input_error(
            f"samples={samples!r}, replicates={replicates!r}",
            "whole numbers, at least 1 of each",
            "Try 4096 and 8.",
        )
    samples = int(samples)
    means = []
    for generator in np.random.default_rng(seed).spawn(replicates):
        sequence = qmc.Sobol(2, scramble=True, seed=generator)
        points = sequence.random(samples) if samples & (samples - 1) else None
        if points is None:
            points = sequence.random_base2(samples.bit_length() - 1)
        count, total, _ = _sums(f, mu, alpha, points, smith, distribution)
        means.append(total / count)
    values = np.array(means)
    spread = values.std(axis=0, ddof=1) if replicates > 1 else np.full(values.shape[1:], np.nan)
    return Estimate(values.mean(axis=0)[()], (spread / np.sqrt(replicates))[()])


def _sums(
    f: Fresnel, mu: Any, alpha: Any, points: np.ndarray, smith: Smith, distribution: Distribution
) -> tuple[int, Any, Any]:
    """Number, sum and sum of squares of the samples."""
    mu, alpha = numpy_arguments(mu=mu, alpha=alpha)
    mu, alpha = np.broadcast_arrays(np.asarray(mu, np.float64), np.asarray(alpha, np.float64))
    if not (np.all((mu >= 0.0) & (mu <= 1.0)) and np.all((alpha > 0.0) & (alpha <= ROUGHEST))):
        raise input_error(
            "mu or alpha out of range",
            f"mu in [0, 1], alpha in (0, {ROUGHEST:g}]",
            "At alpha = 0 it is f(mu).",
        )
    wo = (np.sqrt((1.0 - mu) * (1.0 + mu)), np.zeros_like(mu), mu)
    total: Any = 0.0
    squares: Any = 0.0
    block = max(1, _BLOCK // max(mu.size, 1))
    for start in range(0, len(points), block):
        u1, u2 = points[start : start + block].T.reshape(2, -1, *(1,) * mu.ndim)
        normal = sample_visible_normal(wo, alpha, u1, u2, distribution)
        cos_d = sum(a * b for a, b in zip(wo, normal, strict=True))
        cos_i = reflect(wo, normal)[2]
        weight = shadowing(np.clip(cos_i, 0.0, 1.0), mu, alpha, smith, distribution)
        weight = np.where(cos_i > 0.0, weight, 0.0)
        values = np.asarray(f(np.clip(cos_d, 0.0, 1.0)))
        values = (weight[..., None] if values.ndim > weight.ndim else weight) * values
        total = total + values.sum(axis=0)
        squares = squares + (values * values).sum(axis=0)
    return len(points), total, squares

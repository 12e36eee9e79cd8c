r"""Albedo of a rough metal with all its bounces, by a random walk over the microfacets.

Heitz, Hanika, d'Eon and Dachsbacher 2016, "Multiple-Scattering Microfacet BSDFs with the Smith
Model": light that a microfacet throws at another one is reflected again, until it leaves. The
surface is that of Smith's model, in which heights and slopes are independent. What leaves does not
depend on the distribution of heights, so a height is represented by its rank c, the share of the
surface that lies lower. Along a ray of direction w from rank c, the ranks that it passes without a
hit are distributed as

    P(nothing up to rank c') = (c / c')^Lambda(w),   and it leaves for c' = 1,

with Lambda(w) = (-1 ± sqrt(1 + alpha² tan²)) / 2, which is at most -1 for rays that descend. At a
hit, the normal is one of those that the ray sees (`microfacet.sample_visible_normal`, which takes
directions from below the horizon too), and the weight is multiplied by F of the angle to it.

This is the reference for `energy`, and shares with it the visible normals of GGX alone. The first
bounce is shadowed as in the height-correlated Smith model, which has the same assumptions; the
separable one, in Mitsuba's conductors, does not follow from any surface.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ._check import input_error, is_real, is_whole
from .albedo import Fresnel
from .microfacet import sample_visible_normal

__all__ = ["Walk", "random_walk_albedo"]

_BLOCK = 1 << 15  # paths at a time, which fit the caches


class Walk(NamedTuple):
    """What leaves the surface, as a share of what arrives.

    albedo : () or (n,) float64
        After any number of bounces.
    standard_error : () or (n,) float64
        Of it.
    by_bounce : (bounces,) or (bounces, n) float64
        Share that leaves after 1, 2, ... bounces.
    unfinished : float
        Share of paths that were cut off: their light is missing.
    """

    albedo: np.ndarray
    standard_error: np.ndarray
    by_bounce: np.ndarray
    unfinished: float


def random_walk_albedo(
    f: Fresnel, mu: float, alpha: float, samples: int = 1 << 17, *, seed: int = 0, bounces: int = 64
) -> Walk:
    """Directional albedo of GGX with multiple scattering.

    Parameters
    ----------
    f : callable
        Reflectance from (m,) cosines to (m,) or (m, n) values: n materials or channels share the
        paths, on which F has no influence.
    mu : float in [0, 1]
        Cosine of the view direction.
    alpha : float in (0, 1]
    samples : int >= 2
        Paths.
    seed : int >= 0
    bounces : int >= 1
        After which paths are cut off. Seen from above at alpha = 1, a path has 2.3 on average; the
        longest of half a million has 12.

    Returns
    -------
    Walk

    Raises
    ------
    InputError
        For numbers out of range.

    Examples
    --------
    >>> from fresnel_decomp.random_walk import random_walk_albedo
    >>> white = random_walk_albedo(lambda cos_theta: 1.0 + 0.0 * cos_theta, 0.5, 0.6, 1000)
    >>> float(white.albedo), white.unfinished  # nothing is lost
    (1.0, 0.0)
    """
    _check(mu, alpha, samples, seed, bounces)
    samples, bounces = int(samples), int(bounces)
    random = np.random.default_rng(seed)
    first: Any = 0.0
    second: Any = 0.0
    by_bounce: Any = 0.0
    lost = 0
    for start in range(0, samples, _BLOCK):
        count = min(_BLOCK, samples - start)
        leaving, order, cut = _walk(f, float(mu), float(alpha), count, bounces, random)
        first, second = first + leaving.sum(axis=0), second + (leaving * leaving).sum(axis=0)
        sums = np.zeros((bounces + 1, *leaving.shape[1:]))
        np.add.at(sums, order, leaving)
        by_bounce, lost = by_bounce + sums[1:], lost + cut
    mean = first / samples
    variance = np.maximum(second / samples - mean * mean, 0.0) * samples / (samples - 1)
    return Walk(mean, np.sqrt(variance / samples), by_bounce / samples, lost / samples)


def _check(mu: Any, alpha: Any, samples: Any, seed: Any, bounces: Any) -> None:
    if not (is_real(mu, 0.0, 1.0) and is_real(alpha, 1e-6, 1.0)):
        raise input_error(
            f"mu={mu!r}, alpha={alpha!r}",
            "mu in [0, 1] and alpha in [1e-6, 1]",
            "One view and one roughness at a time; without roughness nothing bounces twice.",
        )
    for name, value, least in (("samples", samples, 2), ("bounces", bounces, 1), ("seed", seed, 0)):
        if not is_whole(value, least):
            raise input_error(f"{name}={value!r}", f"a whole number >= {least}", "Try the default.")


def _walk(
    f: Fresnel, mu: float, alpha: float, count: int, bounces: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, int]:
    """Weights of paths when they leave, after how many bounces, and how many were cut off."""
    # directions of travel, opposed to those that the model is written in; the first one descends
    w = np.array([[-np.sqrt((1.0 - mu) * (1.0 + mu))], [0.0], [-mu]]) + np.zeros(count)
    log_rank, inside = np.zeros(count), np.arange(count)
    order = np.zeros(count, np.intp)
    weight: Any = None
    throughput: Any = 1.0
    for bounce in range(bounces + 1):
        # 1 - U in (0, 1], and in logarithms: for a nearly horizontal ray ranks change at once
        step = np.log1p(-random.random(len(inside)))
        log_rank = log_rank - step / signed_lambda(w[2], alpha)
        leaves = log_rank >= 0.0
        if bounce:
            weight[inside[leaves]] = throughput[leaves]
            order[inside[leaves]] = bounce
            stays = ~leaves
            throughput = throughput[stays]
        else:
            stays = np.ones(count, bool)  # all come from outside
        inside, log_rank, w = inside[stays], log_rank[stays], w[:, stays]
        if bounce == bounces or not len(inside):
            break
        u = random.random((2, len(inside)))
        normal = np.stack(sample_visible_normal((-w[0], -w[1], -w[2]), alpha, u[0], u[1]))
        cosine = np.clip(-(w * normal).sum(axis=0), 0.0, 1.0)
        w = w + 2.0 * cosine * normal
        w /= np.sqrt((w * w).sum(axis=0))  # rounding errors of many bounces would add up
        values = np.asarray(f(cosine), np.float64)
        throughput = throughput * (values if values.ndim else np.full(len(inside), values))
        if weight is None:
            weight = np.zeros((count, *throughput.shape[1:]))
    return weight, order, len(inside)


def signed_lambda(cos_theta: np.ndarray, alpha: float) -> np.ndarray:
    """Lambda of GGX for directions above and below the horizon: Lambda(-w) = -1 - Lambda(w)."""
    square = np.maximum(cos_theta * cos_theta, 1e-200)
    tangent = alpha * alpha * (1.0 - cos_theta) * (1.0 + cos_theta) / square
    root = np.sqrt(1.0 + tangent)
    # (root - 1)/2 without its cancellation; straight up it is 0, and a ray leaves at once
    above = np.maximum(0.5 * tangent / (1.0 + root), 1e-200)
    return np.where(cos_theta >= 0.0, above, -1.0 - above)

"""Roughness, in which images are not linear: searched for, then solved with everything else."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from ...inverse_fit import Solution, least_squares
from .images import RANGES, Images, derived_seed
from .linear import LinearFit, Unknowns, linearise, require_visible, solve, solve_twice
from .observed import Observed

__all__ = ["refine_roughness", "search_roughness", "solve_jointly"]

Array = NDArray[np.float64]

_GRID = 8  # roughnesses that are looked at first, each 2.1 times the last


def search_roughness(
    images: Images,
    observed: Observed,
    *,
    spp: int,
    seed: int,
    unknowns: Unknowns,
    alpha: float,
    record: Any = None,
) -> tuple[float, int]:
    """The roughness whose best linear fit is best: a search in log alpha with the same samples.

    Returns
    -------
    alpha : float
    turns : int
        How many roughnesses were tried.
    """
    half = max(1, spp // 2)
    tried: dict[float, float] = {}

    def misfit(log_alpha: float) -> float:
        if log_alpha not in tried:
            a = float(np.exp(log_alpha))
            model = linearise(images, a, half, seed, unknowns)
            require_visible(model)
            channels = solve(model, observed, unknowns)
            tried[log_alpha] = float(sum(s.misfit for s in channels))
            if record is not None and tried[log_alpha] == min(tried.values()):
                record(np.stack([s.x for s in channels], axis=1), a)
        return tried[log_alpha]

    low, high = np.log(RANGES["alpha"])
    grid = sorted(
        {*np.linspace(low, high, _GRID).tolist(), float(np.clip(np.log(alpha), low, high))}
    )
    values = [misfit(x) for x in grid]
    i = int(np.argmin(values))
    left, right = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
    scipy.optimize.minimize_scalar(
        misfit, bounds=(left, right), method="bounded", options={"xatol": 0.02, "maxiter": 12}
    )
    return float(np.exp(min(tried, key=lambda x: tried[x]))), len(tried)


def refine_roughness(
    images: Images,
    observed: Observed,
    alpha: float,
    *,
    spp: int,
    seed: int,
    unknowns: Unknowns,
    turns: int,
    record: Any = None,
) -> tuple[float, float, LinearFit]:
    """Gauss-Newton in roughness and everything else together.

    Returns
    -------
    alpha, its standard error, and the linear fit at this alpha
    """
    half = max(1, spp // 2)
    x: Array | None = None
    error, converged = np.inf, False
    for turn in range(1, turns + 1):
        at = x if images.depth > 2 else None
        model = linearise(images, alpha, half, seed, unknowns, at)
        require_visible(model)
        channels, x = solve_twice(model, observed, unknowns)
        if record is not None:
            record(x, alpha)
        c = unknowns.coefficients(x)
        shared = np.stack(
            [images.roughness_derivative(c, alpha, half, derived_seed(seed, h)) for h in (0, 1)]
        )
        joint = solve_jointly(
            model.columns, model.offset, shared, observed, model.visible,
            np.append(x.T.ravel(), 0.0), unknowns.limits,
        )  # fmt: skip
        step, error = float(joint.x[-1]), float(joint.standard_errors[-1])
        # with interreflection, the point of linearisation must be the solution too
        moved = np.inf if at is None else np.abs(x - at)
        at_rest = images.depth <= 2 or np.all(moved < 0.1 * _errors(channels) + 1e-3)
        fit = LinearFit(x, _with_shared(channels, joint, len(x)), model, turn, np.nan, True)
        if at_rest and abs(step) < max(0.1 * error, 1e-4 * alpha):
            converged = True
            break
        if turn < turns:
            alpha = float(
                np.clip(alpha + np.clip(step, -0.3 * alpha, 0.4 * alpha), *RANGES["alpha"])
            )
    return alpha, error, replace(fit, converged=converged)


def _errors(channels: list[Solution]) -> Array:
    return np.stack([s.standard_errors for s in channels], axis=1)


def _with_shared(channels: list[Solution], joint: Solution, n: int) -> list[Solution]:
    """The channels' solutions, with covariances that know that roughness is uncertain."""
    found = []
    for i, s in enumerate(channels):
        part = slice(i * n, (i + 1) * n)
        found.append(replace(s, covariance=joint.covariance[part, part]))
    return found


def solve_jointly(
    columns: Array,
    offset: Array,
    shared: Array,
    observed: Observed,
    visible: Array,
    start: Array,
    inequalities: tuple[Array, Array] | None = None,
) -> Solution:
    """All channels at once, with one parameter that they share.

    Parameters
    ----------
    columns, offset : (2, m, 3, n), (2, m, 3) float
    shared : (2, m, 3) float
        Derivative by the shared parameter.
    observed : Observed
    visible : (m,) bool
    start : (3 n + 1,) float
        Channel by channel, the shared one last.
    inequalities : (G, h), optional
        Of one channel.
    """
    n = columns.shape[-1]
    m = int(np.count_nonzero(visible))
    J = np.zeros((2, 3, m, 3 * n + 1))
    for i in range(3):
        J[:, i, :, i * n : (i + 1) * n] = columns[:, visible, i]
        J[:, i, :, -1] = shared[:, visible, i]
    flat = [np.moveaxis(part[..., visible, :], -1, -2) for part in (offset, observed.values)]
    weight = observed.weight[visible].T.ravel()
    limits = None
    if inequalities is not None:
        G, h = inequalities
        limits = np.hstack([np.kron(np.eye(3), G), np.zeros((3 * len(h), 1))]), np.tile(h, 3)
    return least_squares(
        J.reshape(2, 3 * m, -1), flat[0].reshape(2, -1), flat[1].ravel(), weight, start, limits
    )

"""The linear solve, and the search for roughness around it.

Light that meets the conductor once carries its reflectance once: images are linear in coefficients
and in node colours. So `terms` renderings describe all images there can be, and least squares does
the rest. Light that meets it more often makes a polynomial; then the images are linearised anew
where the last solution was, until it stays where it is (Gauss-Newton, which is Newton's fixed-point
iteration here). Whether that is needed is not guessed but seen: the image of the solution is
rendered with the same samples and compared with the prediction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from .._check import input_error
from ..basis import Basis
from ..fresnel import conductor
from ..inverse_fit import (
    CurveFit,
    Solution,
    curve_limits,
    fit_curve_parameters,
    least_squares,
    nearest_feasible,
    node_map,
)
from .inverse_images import Images, Observed, derived_seed

__all__ = [
    "LinearFit",
    "Linearised",
    "calibrate",
    "fit_channels",
    "linearise",
    "refine_roughness",
    "search_roughness",
    "solve",
    "solve_images",
    "solve_jointly",
]

Array = NDArray[np.float64]

NONLINEAR = 2e-3
"""Relative difference of prediction and image, RMS, from which images are linearised again."""

_STEP = 0.05  # of coefficients, where images are not linear


@dataclass(frozen=True, eq=False)
class Linearised:
    """Images near one point: offset + columns x, twice, with independent samples.

    Attributes
    ----------
    offset : (2, m, 3) float
    columns : (2, m, 3, n) float
        Channels do not mix.
    """

    offset: Array
    columns: Array

    def predict(self, x: Array) -> Array:
        """(2, m, 3) for x of shape (n, 3)."""
        return self.offset + np.einsum("hmcn,nc->hmc", self.columns, x)

    @property
    def visible(self) -> Array:
        """(m,) bool: pixels to which the conductor contributes."""
        return np.asarray(np.any(self.columns != 0.0, axis=(0, 2, 3)))


@dataclass(frozen=True, eq=False)
class LinearFit:
    """What the linear solve found: a `Solution` for each channel.

    Attributes
    ----------
    x : (n, 3) float
    channels : list of Solution
    model : Linearised
    iterations : int
    change : float
        How far the image of the solution is from its prediction, relative, RMS.
    converged : bool
    """

    x: Array
    channels: list[Solution]
    model: Linearised
    iterations: int
    change: float
    converged: bool


def linearise(
    images: Images, alpha: float, spp: int, seed: int, nodes: bool, at: Array | None = None
) -> Linearised:
    """Render the basis.

    Parameters
    ----------
    images : Images
        Of kind "coefficients".
    alpha, spp, seed
        `spp` are for each of the two halves.
    nodes : bool
        Whether x are reflectances at 0° and the nodes instead of coefficients.
    at : (n, 3) float, optional
        Where to linearise; without it, between black, white, and white with one more function.
    """
    terms = images.basis.terms
    a, M = node_map(images.basis) if nodes else (np.zeros(terms), np.eye(terms))
    offsets, columns = [], []
    for half in (0, 1):
        own = derived_seed(seed, half)
        if at is None:
            black = images.render(np.zeros((terms, 3)), alpha, spp, own)
            white = images.render(_white(terms), alpha, spp, own)
            # beside white, as scalar variants drop negative samples
            hot = [white - black] + [
                images.render(_white(terms, i), alpha, spp, own) - white for i in range(1, terms)
            ]
            B = np.stack(hot, axis=-1)
            offset = black + B @ a
        else:
            c = a[:, None] + M @ at
            B = images.derivative(c, alpha, spp, own, np.full(terms, _STEP))
            offset = images.render(c, alpha, spp, own) - np.einsum("mcn,nc->mc", B @ M, at)
        offsets.append(offset)
        columns.append(B @ M)
    return Linearised(np.stack(offsets), np.stack(columns))


def _white(terms: int, hot: int = 0) -> Array:
    """Coefficients (terms, 3) of F = 1, or of 1 + b_hot."""
    c = np.zeros((terms, 3))
    c[[0, hot]] = 1.0
    return c


def solve(
    model: Linearised,
    observed: Observed,
    start: Array,
    inequalities: tuple[Array, Array] | None,
) -> list[Solution]:
    """Constrained least squares, channel by channel."""
    weight = np.where(model.visible[:, None], observed.weight, 0.0)
    found = []
    for i in range(3):
        columns = model.columns[:, :, i]
        found.append(
            least_squares(
                columns,
                model.offset[:, :, i],
                observed.values[:, i],
                weight[:, i],
                start[:, i],
                inequalities,
            )
        )
    return found


def solve_images(
    images: Images,
    observed: Observed,
    alpha: float,
    *,
    spp: int,
    seed: int,
    nodes: bool,
    bounds: tuple[float, float] | None,
    start: Array,
    iterations: int,
    record: Any = None,
) -> LinearFit:
    """Linearise and solve until the image of the solution is the one predicted."""
    limits = None if bounds is None else curve_limits(images.basis, bounds, nodes)
    a, M = node_map(images.basis) if nodes else (np.zeros(images.basis.terms), None)
    half = max(1, spp // 2)
    at: Array | None = None
    change, converged = np.inf, False
    turn = 0
    while turn < iterations and not converged:
        turn += 1
        model = linearise(images, alpha, half, seed, nodes, at)
        _require_visible(model)
        channels, x = solve_twice(model, observed, start, limits)
        if record is not None:
            record(x, alpha)
        # the test of linearity: the same samples, so what differs is not noise
        c = x if M is None else a[:, None] + M @ x
        inside = model.visible
        seen = images.render(c, alpha, half, derived_seed(seed, 0))[inside]
        difference = seen - model.predict(x)[0][inside]
        change = float(np.sqrt(np.mean(difference**2) / max(float(np.mean(seen**2)), 1e-30)))
        converged, at = change < NONLINEAR, x
    return LinearFit(x, channels, model, turn, change, converged)


def solve_twice(
    model: Linearised, observed: Observed, start: Array, limits: tuple[Array, Array] | None
) -> tuple[list[Solution], Array]:
    """Solve, see how noisy the images are, weigh them so, and solve again."""
    for last in (False, True):
        channels = solve(model, observed, start, limits)
        x = np.stack([s.x for s in channels], axis=1)
        if not last:
            both = model.predict(x)
            observed.weigh(both[0] - both[1], observed.values - both.mean(axis=0))
    return channels, x


def fit_channels(
    x: Array, channels: list[Solution], kind: str, basis: Basis, start: Array | None = None
) -> list[CurveFit]:
    """(eta, k) or (r, g) of each channel from its node colours x (n, 3)."""
    return [
        fit_curve_parameters(
            x[:, i], s.normal, s.covariance, kind, basis, None if start is None else start[:, i]
        )
        for i, s in enumerate(channels)
    ]


def calibrate(
    exact: Images,
    fit: LinearFit,
    observed: Observed,
    alpha: float,
    *,
    spp: int,
    seed: int,
    limits: tuple[Array, Array] | None,
    turns: int = 2,
) -> Array:
    """Correct node colours for what the basis cannot express.

    Least squares spreads the basis's misfit over the angles that an image shows, so that node
    colours are not quite the reflectances at the nodes. How far off they are is seen where the
    answer is known: the exact conductor nearest to them is rendered, with the same samples, and
    recovered in the same way ("indirect inference", Gourieroux, Monfort and Renault 1993).

    Returns
    -------
    (n, 3) float
    """
    basis = exact.basis
    cosines = np.cos([0.0, *basis.nodes])[:, None]
    half = max(1, spp // 2)
    x = fit.x
    free = np.stack([s.unconstrained for s in fit.channels], axis=1)
    weight = np.where(fit.model.visible[:, None], observed.weight, 0.0)
    for _ in range(turns):
        indices = np.stack(
            [f.values for f in fit_channels(x, fit.channels, "indices", basis)], axis=1
        )
        truth = conductor(cosines, indices[0], indices[1])
        seen = np.stack([exact.render(indices, alpha, half, derived_seed(seed, h)) for h in (0, 1)])
        found = np.stack(
            [
                least_squares(
                    fit.model.columns[:, :, i],
                    fit.model.offset[:, :, i] - seen[:, :, i],
                    np.zeros(len(weight)),
                    weight[:, i],
                    truth[:, i],
                ).x
                for i in range(3)
            ],
            axis=1,
        )
        x = free - (found - truth)
        if limits is not None:
            for i, s in enumerate(fit.channels):
                if np.any(limits[0] @ x[:, i] < limits[1] - 1e-12):
                    x[:, i] = nearest_feasible(s.root, x[:, i], *limits)
    return x


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


def refine_roughness(
    images: Images,
    observed: Observed,
    alpha: float,
    *,
    spp: int,
    seed: int,
    nodes: bool,
    bounds: tuple[float, float] | None,
    start: Array,
    span: tuple[float, float],
    turns: int,
    record: Any = None,
) -> tuple[float, float, LinearFit]:
    """Gauss-Newton in roughness and everything else together.

    Returns
    -------
    alpha, its standard error, and the linear fit at this alpha
    """
    limits = None if bounds is None else curve_limits(images.basis, bounds, nodes)
    a, M = node_map(images.basis) if nodes else (np.zeros(images.basis.terms), None)
    half = max(1, spp // 2)
    x: Array | None = None
    error, converged = np.inf, False
    for turn in range(1, turns + 1):
        at = x if images.depth > 2 else None
        model = linearise(images, alpha, half, seed, nodes, at)
        _require_visible(model)
        channels, x = solve_twice(model, observed, start, limits)
        if record is not None:
            record(x, alpha)
        c = x if M is None else a[:, None] + M @ x
        shared = np.stack(
            [images.roughness_derivative(c, alpha, half, derived_seed(seed, h)) for h in (0, 1)]
        )
        joint = solve_jointly(
            model.columns, model.offset, shared, observed, model.visible,
            np.append(x.T.ravel(), 0.0), limits,
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
            alpha = float(np.clip(alpha + np.clip(step, -0.3 * alpha, 0.4 * alpha), *span))
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


def _require_visible(model: Linearised) -> None:
    if not np.any(model.columns):
        raise input_error(
            "images to which the conductor contributes nothing",
            "scenes that show it, lit",
            "Look at a rendering of the scene.",
        )


def search_roughness(
    images: Images,
    observed: Observed,
    *,
    spp: int,
    seed: int,
    nodes: bool,
    bounds: tuple[float, float] | None,
    start: Array,
    alpha: float,
    span: tuple[float, float],
    record: Any = None,
) -> tuple[float, int]:
    """The roughness whose best linear fit is best: a search in log alpha with the same samples.

    Returns
    -------
    alpha : float
    turns : int
        How many roughnesses were tried.
    """
    limits = None if bounds is None else curve_limits(images.basis, bounds, nodes)
    half = max(1, spp // 2)
    tried: dict[float, float] = {}

    def misfit(log_alpha: float) -> float:
        if log_alpha not in tried:
            a = float(np.exp(log_alpha))
            model = linearise(images, a, half, seed, nodes)
            _require_visible(model)
            channels = solve(model, observed, start, limits)
            tried[log_alpha] = float(sum(s.misfit for s in channels))
            if record is not None:
                record(np.stack([s.x for s in channels], axis=1), a)
        return tried[log_alpha]

    low, high = np.log(span)
    grid = sorted({*np.linspace(low, high, 6).tolist(), float(np.clip(np.log(alpha), low, high))})
    values = [misfit(x) for x in grid]
    i = int(np.argmin(values))
    left, right = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
    scipy.optimize.minimize_scalar(
        misfit, bounds=(left, right), method="bounded", options={"xatol": 0.02, "maxiter": 12}
    )
    return float(np.exp(min(tried, key=lambda x: tried[x]))), len(tried)

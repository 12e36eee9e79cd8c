"""The linear solve, and the search for roughness around it.

Light that meets the conductor once carries its reflectance once: images are linear in coefficients
and in node colours. So `terms` renderings describe all images there can be, and least squares does
the rest. Light that meets it more often makes a polynomial; then the images are linearised anew
where the last solution was, until it stays where it is (Gauss-Newton, which is Newton's fixed-point
iteration here). Whether that is needed is not guessed but seen: the image of the solution is
rendered with the same samples and compared with the prediction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._check import input_error
from ...basis import Basis
from ...inverse_curves import curve_limits, node_map
from ...inverse_fit import Solution, least_squares
from .images import Images, derived_seed
from .observed import Observed

__all__ = [
    "LinearFit",
    "Linearised",
    "Unknowns",
    "linearise",
    "require_visible",
    "solve",
    "solve_images",
    "solve_twice",
]

Array = NDArray[np.float64]

NONLINEAR = 2e-3
"""Relative difference of prediction and image, RMS, from which images are linearised again."""

_STEP = 0.05  # of coefficients, where images are not linear


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What is solved for: coefficients, or reflectances at 0° and at the nodes.

    Attributes
    ----------
    start : (n, 3) float
        What the images say nothing about stays there.
    limits : (G, h) or None
        G x >= h keeps curves within their bounds.
    offset, matrix : (terms,), (terms, n) float
        Coefficients are offset + matrix x.
    """

    start: Array
    limits: tuple[Array, Array] | None
    offset: Array
    matrix: Array

    @classmethod
    def of(
        cls, basis: Basis, nodes: bool, bounds: tuple[float, float] | None, start: Array
    ) -> Unknowns:
        """Node colours or else coefficients of a basis, within bounds of its curves."""
        limits = None if bounds is None else curve_limits(basis, bounds, nodes)
        terms = basis.terms
        offset, matrix = node_map(basis) if nodes else (np.zeros(terms), np.eye(terms))
        return cls(start, limits, offset, matrix)

    def coefficients(self, x: Array) -> Array:
        """(terms, 3) for x of shape (n, 3)."""
        return self.offset[:, None] + self.matrix @ x


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
    images: Images,
    alpha: float,
    spp: int,
    seed: int,
    unknowns: Unknowns,
    at: Array | None = None,
) -> Linearised:
    """Render the basis.

    Parameters
    ----------
    images : Images
        Of kind "coefficients".
    alpha, spp, seed
        `spp` are for each of the two halves.
    unknowns : Unknowns
    at : (n, 3) float, optional
        Where to linearise; without it, between black, white, and white with one more function.
    """
    terms, M = images.basis.terms, unknowns.matrix
    offsets, columns = [], []
    for half in (0, 1):
        own = derived_seed(seed, half)
        if at is None:
            black = images.render(np.zeros((terms, 3)), alpha, spp, own)
            white = images.render(_white(terms), alpha, spp, own)
            # beside white, as scalar variants warn of negative samples
            hot = [white - black] + [
                images.render(_white(terms, i), alpha, spp, own) - white for i in range(1, terms)
            ]
            B = np.stack(hot, axis=-1)
            offset = black + B @ unknowns.offset
        else:
            c = unknowns.coefficients(at)
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


def solve(model: Linearised, observed: Observed, unknowns: Unknowns) -> list[Solution]:
    """Constrained least squares, channel by channel."""
    weight = np.where(model.visible[:, None], observed.weight, 0.0)
    return [
        least_squares(
            model.columns[:, :, i],
            model.offset[:, :, i],
            observed.values[:, i],
            weight[:, i],
            unknowns.start[:, i],
            unknowns.limits,
        )
        for i in range(3)
    ]


def solve_images(
    images: Images,
    observed: Observed,
    alpha: float,
    *,
    spp: int,
    seed: int,
    unknowns: Unknowns,
    iterations: int,
    record: Any = None,
) -> LinearFit:
    """Linearise and solve until the image of the solution is the one predicted."""
    half = max(1, spp // 2)
    at: Array | None = None
    change, converged = np.inf, False
    turn = 0
    while turn < iterations and not converged:
        turn += 1
        model = linearise(images, alpha, half, seed, unknowns, at)
        require_visible(model)
        channels, x = solve_twice(model, observed, unknowns)
        if record is not None:
            record(x, alpha)
        # the test of linearity: the same samples, so what differs is not noise
        inside = model.visible
        seen = images.render(unknowns.coefficients(x), alpha, half, derived_seed(seed, 0))[inside]
        difference = seen - model.predict(x)[0][inside]
        change = float(np.sqrt(np.mean(difference**2) / max(float(np.mean(seen**2)), 1e-30)))
        converged, at = change < NONLINEAR, x
    return LinearFit(x, channels, model, turn, change, converged)


def solve_twice(
    model: Linearised, observed: Observed, unknowns: Unknowns
) -> tuple[list[Solution], Array]:
    """Solve, see how noisy the images are, weigh them so, and solve again."""
    for last in (False, True):
        channels = solve(model, observed, unknowns)
        x = np.stack([s.x for s in channels], axis=1)
        if not last:
            both = model.predict(x)
            observed.weigh(both[0] - both[1], observed.values - both.mean(axis=0))
    return channels, x


def require_visible(model: Linearised) -> None:
    """Refuse scenes in which the conductor makes no difference."""
    if not np.any(model.columns):
        raise input_error(
            "images to which the conductor contributes nothing",
            "scenes that show it, lit",
            "Look at a rendering of the scene.",
        )

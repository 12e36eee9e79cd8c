"""Node colours freed of what the basis cannot express, and the indices that they lead to."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...basis import Basis
from ...fresnel import conductor
from ...inverse_curves import CurveFit, fit_curve_parameters
from ...inverse_fit import Solution, least_squares, nearest_feasible
from .images import Images, derived_seed
from .linear import LinearFit
from .observed import Observed

__all__ = ["calibrate", "fit_channels"]

Array = NDArray[np.float64]


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

"""Directional albedo with an estimate of its error, for curves that are not smooth.

The rule of `albedo` converges exponentially where F is smooth. Reflectance that has a kink, as that
of a dielectric seen from inside has at the critical angle, slows it down: the default nodes then
err by up to 0.02. Here they are doubled until the result stops moving.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ._arguments import numpy_arguments
from ._check import input_error
from .albedo import (
    MOST_NODES,
    QUADRATURE,
    Fresnel,
    Quadrature,
    directional_albedo,
)
from .microfacet import Distribution, Smith

__all__ = ["Refined", "refined_albedo"]


class Refined(NamedTuple):
    """An albedo, (...) or (..., n), with its estimated error and the nodes it took."""

    value: Any
    error: Any
    quadrature: Quadrature


def refined_albedo(
    f: Fresnel,
    mu: Any,
    alpha: Any,
    *,
    tolerance: float = 1e-4,
    smith: Smith = "separable",
    distribution: Distribution = "ggx",
) -> Refined:
    """Directional albedo by the rule of `directional_albedo` with as many nodes as it takes.

    Nodes are doubled in both directions, for all views together. The error is taken to be the
    larger of the last two changes, since at a kink a single one can be small by chance. With the
    most nodes, 512 by 384, it is still up to 0.003 for dielectrics seen from inside, of which the
    larger part is caution. Compare it with the tolerance, which need not be reached.

    Parameters
    ----------
    f, mu, alpha, smith, distribution
        As for `directional_albedo`, NumPy only.
    tolerance : float > 0
        Absolute.

    Returns
    -------
    Refined

    Raises
    ------
    InputError
        As `directional_albedo` does, for Dr.Jit arrays, and for a tolerance that is not a positive
        number.

    Examples
    --------
    >>> from fresnel_decomp import dielectric
    >>> from fresnel_decomp.albedo_refined import refined_albedo
    >>> inside = refined_albedo(lambda cos_theta: dielectric(cos_theta, 0.7), 0.7, 0.02)
    >>> print(f"{inside.value:.4f}, {inside.error < 1e-3}, {inside.quadrature.azimuth} azimuths")
    0.9113, True, 512 azimuths
    """
    mu, alpha = numpy_arguments(mu=mu, alpha=alpha)
    if not (isinstance(tolerance, int | float | np.number) and 0.0 < tolerance < math.inf):
        raise input_error(f"tolerance={tolerance!r}", "a positive number", "1e-4, for instance.")
    options: dict[str, Any] = {"smith": smith, "distribution": distribution}
    value, before = None, math.inf
    quadrature = QUADRATURE
    while True:
        finer = directional_albedo(f, mu, alpha, **options, quadrature=quadrature)
        change = np.abs(finer - value) if value is not None else math.inf
        error, value, before = np.maximum(change, before), finer, change
        last = 2 * max(quadrature) > MOST_NODES
        if last or np.nanmax(error, initial=0.0) <= tolerance:
            return Refined(value, error, quadrature)
        quadrature = Quadrature(2 * quadrature.azimuth, 2 * quadrature.slope)

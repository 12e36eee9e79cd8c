"""The rule behind `albedo`: nodes in azimuth and slope, and what is reflected at each.

Names and changes of variables are explained there. Written for arrays of one kind.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np

from ._array import Ops
from ._distributions import Shape
from .microfacet import shadowing_ratio

__all__ = [
    "TWO_PANELS",
    "Nodes",
    "View",
    "at_azimuth",
    "reflected",
    "rule_nodes",
    "seen_from",
    "unit_gauss",
]

TWO_PANELS = 24
"""Nodes in azimuth from which there is one rule on either side of pi/2."""


class Nodes(NamedTuple):
    """Gauss nodes and weights: u in [-1, 1] for the azimuth, w in [0, 1] for the slope."""

    width: float  # that the change of variable in azimuth resolves
    u: np.ndarray
    u_weight: np.ndarray
    w: np.ndarray
    w_weight: np.ndarray


@functools.cache
def unit_gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    x, weight = np.polynomial.legendre.leggauss(count)
    return 0.5 * (x + 1.0), 0.5 * weight


@functools.cache
def rule_nodes(azimuth: int, slope: int) -> Nodes:
    if azimuth < TWO_PANELS:
        u, u_weight = unit_gauss(azimuth)
        return Nodes(0.025, 2.0 * u - 1.0, 2.0 * u_weight, *unit_gauss(slope))
    half, weight = unit_gauss(azimuth // 2)
    u, u_weight = np.append(-half[::-1], half), np.append(weight[::-1], weight)
    return Nodes(0.1, u, u_weight, *unit_gauss(slope))


class View(NamedTuple):
    """What depends on the view and the roughness alone."""

    mu: Any
    alpha: Any
    sine: Any
    area: Any  # sigma(mu)
    masking: Any  # G1(mu)
    width: Any  # of the change of variable in azimuth
    stretch: Any
    edge: Any  # of that in the slope


def seen_from(ops: Ops, shape: Shape, mu: Any, alpha: Any, least_width: float, tiny: float) -> View:
    # Added, not clamped: derivatives pass. At mu = 0 the limit is meant, and at mu = 1 sine has an
    # infinite derivative, of which F depends on the even part only.
    mu = mu + 1e-18
    sine = ops.sqrt((1.0 - mu) * (1.0 + mu) + tiny)
    plain_mu, plain_alpha = ops.detach(mu), ops.detach(alpha)
    width = ops.maximum(plain_mu, least_width)
    stretch = ops.arcsinh(0.5 * math.pi / width)
    edge = ops.maximum(2.0 * plain_alpha, 1e-4)
    area = shape.projected_area(ops, mu, alpha)
    return View(mu, alpha, sine, area, mu / area, width, stretch, edge)


def at_azimuth(ops: Ops, shape: Shape, view: View, u: Any, weight: Any) -> tuple[Any, ...]:
    """(alpha q, weight, range of slopes) at a node, q = s cos phi."""
    wave = ops.sinh(view.stretch * u)
    q = -view.sine * ops.sin(view.width * wave)  # phi = pi/2 + width sinh(stretch u)
    weight = weight * (2.0 * view.width * view.stretch / view.area) * ops.sqrt(1.0 + wave * wave)
    p = ops.abs(q) + ops.sqrt(q * q + view.mu * view.mu)
    forward = u < 0.0
    numerator = ops.select(forward, p, view.mu)
    denominator = view.alpha * ops.select(forward, view.mu, p)
    limits = shape.slope_range(ops, numerator, denominator, view.edge)
    return view.alpha * q, weight, limits


def reflected(
    ops: Ops, shape: Shape, smith: str, view: View, azimuth: tuple[Any, ...], w: Any
) -> tuple[Any, Any]:
    """(wo·h, weight) at a node; the sum over nodes of weight times F is the albedo."""
    alpha_q, azimuth_weight, limits = azimuth
    across, along, weight = shape.slope_node(ops, limits, w)
    # h is (alpha across (cos phi, sin phi), along) / length
    visible = alpha_q * across + view.mu * along
    tilted = view.alpha * across
    inverse = 1.0 / ops.sqrt(tilted * tilted + along * along)
    cos_d = ops.minimum(ops.maximum(visible * inverse, 0.0), 1.0)
    cos_i = 2.0 * cos_d * (along * inverse) - view.mu
    cos_i = ops.minimum(ops.maximum(cos_i, 1e-15), 1.0)  # what is divided by must not underflow
    seen = shadowing_ratio(ops, shape, smith, cos_i, view.alpha, view.masking)
    return cos_d, seen * visible * (weight * azimuth_weight)

"""The edge tint from reflectances: Gulbrandsen's g of the curve through a given value at 82°."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._arguments import without_axes
from ._array import detached, drjit_module, is_drjit, is_recording
from ._check import input_error
from .fresnel import conductor
from .parametrization import F82_COSINE, gulbrandsen_to_ior

__all__ = ["TOLERANCE", "edge_tint"]

TOLERANCE = 1e-6
"""How far out of its range a parameter may be for a rounding error."""


def edge_tint(r: Any, f82: Any) -> tuple[Any, Any]:
    """g for which the exact curve of reflectivity r passes `f82`; where there is none."""
    if is_recording():
        raise input_error(
            "a conversion to (r, g) or (eta, k) while Dr.Jit records",
            "one outside of symbolic loops and recorded functions",
            "Convert before.",
        )
    r_value, target = (np.asarray(detached(x), np.float64) for x in (r, f82))
    r_value, target = np.broadcast_arrays(r_value, target)
    low, high = np.zeros(r_value.shape), np.ones(r_value.shape)
    ends = [_reflectance_at_82(r_value, g) for g in (low, high)]
    for _ in range(60):  # bisection: the reflectance rises with g, and very unevenly
        middle = 0.5 * (low + high)
        below = _reflectance_at_82(r_value, middle) < target
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    g = np.where(target <= ends[0], 0.0, np.where(target >= ends[1], 1.0, 0.5 * (low + high)))
    g = np.where(np.isnan(target), np.nan, g)
    beyond = (target < ends[0] - TOLERANCE) | (target > ends[1] + TOLERANCE)
    if not is_drjit(r, f82):
        return without_axes(g, True), beyond[()]
    return _attached(r, f82, g), beyond


def _attached(r: Any, f82: Any, g: np.ndarray) -> Any:
    """The solution as a Dr.Jit array with the derivatives of the implicit function."""
    dr = drjit_module()
    assert dr is not None
    array = type(r + f82)
    r_value = np.broadcast_to(np.asarray(detached(r), np.float64), g.shape)
    h = 1e-6
    a, b = np.maximum(g - h, 0.0), np.minimum(g + h, 1.0)
    slope = (_reflectance_at_82(r_value, b) - _reflectance_at_82(r_value, a)) / (b - a)
    free = (g > 0.0) & (g < 1.0) & (slope > 0.0)
    inverse = array(np.where(free, 1.0 / np.where(free, slope, 1.0), 0.0))
    solution = array(g)
    missing = f82 - conductor(F82_COSINE, *gulbrandsen_to_ior(r, solution))
    # a step of Newton's that is zero in value
    return solution + inverse * (missing - dr.detach(missing))


def _reflectance_at_82(r: np.ndarray, g: np.ndarray) -> np.ndarray:
    return np.asarray(conductor(F82_COSINE, *gulbrandsen_to_ior(np.asarray(r), np.asarray(g))))

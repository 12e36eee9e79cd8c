"""Schlick's curve and its bent form, written once for arrays, Python floats and shaders."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._arguments import one_kind
from ._array import multiply_add
from .parametrization import F82_COSINE

__all__ = ["bend_factor", "bent_schlick", "schlick", "schlick_functions"]


def schlick(f0: Any, cos_theta: Any) -> Any:
    """F0 + (1 - F0)(1 - cos)^5 (Schlick 1994, Eq. 15)."""
    f0, cos_theta = one_kind(f0, cos_theta)
    x = 1.0 - cos_theta
    x2 = x * x
    return multiply_add(1.0 - f0, x2 * x2 * x, f0)


def schlick_functions(cos_theta: np.ndarray) -> np.ndarray:
    """1 and (1 - cos)^5, of which the curve is a sum with weights F0 and 1 - F0."""
    return np.stack([np.ones_like(cos_theta), (1.0 - cos_theta) ** 5], axis=-1)


def bent_schlick(f0: Any, a: Any, cos_theta: Any) -> Any:
    """Schlick's curve less a cos (1 - cos)^6, which is greatest at cos = 1/7 (Hoffman 2019)."""
    f0, a, cos_theta = one_kind(f0, a, cos_theta)
    x = 1.0 - cos_theta
    x2 = x * x
    return multiply_add(-a, cos_theta * (x2 * x2 * x) * x, schlick(f0, cos_theta))


def bend_factor(f0: Any, f82: Any) -> Any:
    """The `a` that puts the bent curve through `f82` at cos = 1/7."""
    peak = F82_COSINE * (1.0 - F82_COSINE) ** 6
    return (schlick(f0, F82_COSINE) - f82) * (1.0 / peak)

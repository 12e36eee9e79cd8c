"""One small vocabulary of array operations for Python floats, NumPy and Dr.Jit.

The formulas of this package are written once, against the `Ops` that `ops_for(...)` returns for
their arguments. Python floats run as zero-dimensional NumPy arrays. Nothing here imports Dr.Jit:
an argument can only be a Dr.Jit array if the caller has imported it already.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np

from ._check import input_error

__all__ = ["DrJitOps", "NumPyOps", "Ops", "drjit_module", "is_drjit", "ops_for", "polynomial"]


def drjit_module() -> ModuleType | None:
    """The `drjit` module if the caller has imported it, else None."""
    return sys.modules.get("drjit")


def is_drjit(*values: Any) -> bool:
    """True if any of `values` is a Dr.Jit array of any backend."""
    dr = drjit_module()
    return dr is not None and any(dr.is_array_v(value) for value in values)


class Ops:
    """What the formulas need beyond arithmetic and comparison."""

    sqrt: Callable[..., Any]
    abs: Callable[..., Any]
    hypot: Callable[..., Any]
    minimum: Callable[..., Any]
    maximum: Callable[..., Any]
    select: Callable[..., Any]

    def two_product(self, a: Any, b: Any) -> tuple[Any, Any]:
        """(p, e) with p = fl(a b) and p + e = a b exactly."""
        raise NotImplementedError


class NumPyOps(Ops):
    """Operations on NumPy arrays and scalars of one floating-point type."""

    def __init__(self, dtype: Any = np.float64) -> None:
        self.dtype = np.dtype(dtype)
        self.sqrt, self.abs, self.hypot = np.sqrt, np.abs, np.hypot
        self.minimum, self.maximum, self.select = np.minimum, np.maximum, np.where

    def two_product(self, a: Any, b: Any) -> tuple[Any, Any]:
        # NumPy has no fused multiply-add
        p = a * b
        if self.dtype == np.float32:
            wide = np.multiply(a, b, dtype=np.float64)  # 24 + 24 bits fit 53
            return p, np.asarray(wide - p, np.float32)
        a_hi, b_hi = _veltkamp(a), _veltkamp(b)
        a_lo, b_lo = a - a_hi, b - b_hi
        return p, ((a_hi * b_hi - p) + a_hi * b_lo + a_lo * b_hi) + a_lo * b_lo


def _veltkamp(x: Any) -> Any:
    """The upper 26 bits of a float64 (Veltkamp's splitting)."""
    scaled = 134217729.0 * x  # 2^27 + 1
    return scaled - (scaled - x)


class DrJitOps(Ops):
    """The same operations on Dr.Jit arrays (scalar, LLVM, CUDA) of any shape."""

    def __init__(self) -> None:
        dr = drjit_module()
        assert dr is not None
        self.dr = dr
        self.sqrt, self.abs, self.hypot = dr.sqrt, dr.abs, dr.hypot
        self.minimum, self.maximum, self.select = dr.minimum, dr.maximum, dr.select

    def two_product(self, a: Any, b: Any) -> tuple[Any, Any]:
        p = a * b
        return p, self.dr.fma(a, b, -p)


def ops_for(*values: Any) -> Ops:
    """The operations that fit `values`: Dr.Jit if any of them is a Dr.Jit array, else NumPy.

    Raises
    ------
    InputError
        If Dr.Jit arrays are mixed with NumPy arrays of one or more dimensions.
    """
    if not is_drjit(*values):
        return NumPyOps()
    for value in values:
        if isinstance(value, np.ndarray) and value.ndim:
            raise input_error(
                "a NumPy array together with a Dr.Jit array",
                "arrays of one kind, and Python floats",
                f"Convert first, e.g. mi.Float(array); the array has shape {value.shape}.",
            )
    return DrJitOps()


def polynomial(coefficients: Any, x: Any) -> Any:
    """Horner's rule; `coefficients` ascending, plain floats. Works on any kind of array."""
    result = (
        float(coefficients[-1]) + 0.0 * x if len(coefficients) == 1 else float(coefficients[-1])
    )
    for coefficient in coefficients[-2::-1]:
        result = result * x + float(coefficient)
    return result

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

__all__ = [
    "DrJitOps",
    "NumPyOps",
    "Ops",
    "detached",
    "drjit_constant",
    "drjit_module",
    "is_drjit",
    "is_recording",
    "multiply_add",
    "ops_for",
    "polynomial",
    "read_only",
]


def drjit_module() -> ModuleType | None:
    """The `drjit` module if the caller has imported it, else None."""
    return sys.modules.get("drjit")


def is_drjit(*values: Any) -> bool:
    """True if any of `values` is a Dr.Jit array of any backend."""
    dr = drjit_module()
    return dr is not None and any(dr.is_array_v(value) for value in values)


def is_recording() -> bool:
    """Whether Dr.Jit records a loop, a call or a function: there may be no values to look at."""
    dr = drjit_module()
    return dr is not None and any(
        dr.flag(flag) for flag in (dr.JitFlag.SymbolicScope, dr.JitFlag.FreezingScope)
    )


def detached(value: Any) -> Any:
    """The values of a Dr.Jit array in NumPy; anything else as it is."""
    dr = drjit_module()
    return np.array(dr.detach(value)) if dr is not None and is_drjit(value) else value


class Ops:
    """What the formulas need beyond arithmetic and comparison."""

    sqrt: Callable[..., Any]
    abs: Callable[..., Any]
    minimum: Callable[..., Any]
    maximum: Callable[..., Any]
    select: Callable[..., Any]
    sin: Callable[..., Any]
    cos: Callable[..., Any]
    exp: Callable[..., Any]
    log: Callable[..., Any]
    erf: Callable[..., Any]
    erfinv: Callable[..., Any]
    arccos: Callable[..., Any]
    arctan2: Callable[..., Any]
    sinh: Callable[..., Any]
    arcsinh: Callable[..., Any]  # of x >= 0

    def sincos(self, x: Any) -> tuple[Any, Any]:
        """Both at once, which Dr.Jit computes at little more than the cost of one."""
        return self.sin(x), self.cos(x)

    def detach(self, value: Any) -> Any:
        """`value` without its gradient."""
        return value

    def fma(self, a: Any, b: Any, c: Any) -> Any:
        """a b + c with one rounding, or exactly where that can be represented."""
        raise NotImplementedError

    def multiply_add(self, a: Any, b: Any, c: Any) -> Any:
        """a b + c, whichever way is fast."""
        raise NotImplementedError

    def one_minus_square(self, x: Any) -> Any:
        """1 - x², accurate for x near 1."""
        raise NotImplementedError

    def where_negative(self, x: Any, a: Any, b: Any) -> Any:
        """a where x < 0, b elsewhere; either for a NaN or a negative zero."""
        raise NotImplementedError


class NumPyOps(Ops):
    """Operations on NumPy arrays and scalars of one floating-point type."""

    def __init__(self, dtype: Any = np.float64) -> None:
        self.dtype = np.dtype(dtype)
        self.sqrt, self.abs = np.sqrt, np.abs
        self.minimum, self.maximum, self.select = np.minimum, np.maximum, np.where
        self.sin, self.cos, self.exp, self.log = np.sin, np.cos, np.exp, np.log
        self.arccos, self.arctan2 = np.arccos, np.arctan2
        self.sinh, self.arcsinh = np.sinh, np.arcsinh
        self.erf, self.erfinv = _from_scipy("erf"), _from_scipy("erfinv")

    def fma(self, a: Any, b: Any, c: Any) -> Any:
        # NumPy has none. Error-free product and sum instead; the result may be off by a unit in the
        # last place where it is not exact.
        if self.dtype == np.float32:  # 24 + 24 bits fit 53
            wide = np.multiply(a, b, dtype=np.float64)
            return np.asarray(wide + np.asarray(c, np.float64), np.float32)
        product = a * b
        a_hi, b_hi = _veltkamp(a), _veltkamp(b)
        a_lo, b_lo = a - a_hi, b - b_hi
        product_error = ((a_hi * b_hi - product) + a_hi * b_lo + a_lo * b_hi) + a_lo * b_lo
        total = product + c
        part = total - product
        total_error = (product - (total - part)) + (c - part)
        return total + (total_error + product_error)

    def multiply_add(self, a: Any, b: Any, c: Any) -> Any:
        return a * b + c

    def one_minus_square(self, x: Any) -> Any:
        return (1.0 - x) * (1.0 + x)

    def where_negative(self, x: Any, a: Any, b: Any) -> Any:
        return np.where(x < 0.0, a, b)


def _from_scipy(name: str) -> Callable[..., Any]:
    """A function of `scipy.special`, which is imported when it is first called."""

    def function(x: Any) -> Any:
        from scipy import special

        return getattr(special, name)(x)

    return function


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
        self.sqrt, self.abs = dr.sqrt, dr.abs
        self.minimum, self.maximum, self.select = dr.minimum, dr.maximum, dr.select
        self.sin, self.cos, self.exp, self.log = dr.sin, dr.cos, dr.exp, dr.log
        self.erf, self.erfinv = dr.erf, dr.erfinv
        self.arccos, self.arctan2 = dr.acos, dr.atan2
        self.sinh, self.arcsinh = self._sinh, self._arcsinh

    # `dr.sinh` and `dr.asinh` fail for scalar arrays; these are right to a rounding of 1

    def _sinh(self, x: Any) -> Any:
        grown = self.dr.exp(x)
        return 0.5 * (grown - 1.0 / grown)

    def _arcsinh(self, x: Any) -> Any:
        return self.dr.log(x + self.dr.sqrt(self.dr.fma(x, x, 1.0)))

    def sincos(self, x: Any) -> tuple[Any, Any]:
        return self.dr.sincos(x)

    def detach(self, value: Any) -> Any:
        return self.dr.detach(value)

    def fma(self, a: Any, b: Any, c: Any) -> Any:
        return self.dr.fma(a, b, c)

    def multiply_add(self, a: Any, b: Any, c: Any) -> Any:
        return self.dr.fma(a, b, c)

    def one_minus_square(self, x: Any) -> Any:
        return self.dr.fma(-x, x, 1.0)

    def where_negative(self, x: Any, a: Any, b: Any) -> Any:
        # the sign bit is the mask: nothing to compare
        dr = self.dr
        bits = dr.int64_array_t(x) if dr.type_v(x) == dr.VarType.Float64 else dr.int32_array_t(x)
        return dr.select(dr.reinterpret_array(bits, x) < 0, a, b)


def ops_for(*values: Any) -> Ops:
    """The operations that fit `values`: Dr.Jit if any of them is a Dr.Jit array, else NumPy."""
    return DrJitOps() if is_drjit(*values) else NumPyOps()


def read_only(array: Any) -> np.ndarray:
    """A float64 copy that cannot be written to."""
    copy = np.array(array, np.float64)
    copy.flags.writeable = False
    return copy


def drjit_constant(kind: Any, values: Any) -> Any:
    """Numbers as a flat Dr.Jit array of type `kind`, in memory of Dr.Jit.

    NumPy's memory, mapped, would have kernels compiled anew by accidental alignment.
    """
    dr = drjit_module()
    assert dr is not None
    flat = np.asarray(values).ravel()
    flat = flat.astype(np.float64) if flat.dtype.kind == "f" else flat
    if not dr.is_jit_v(kind):
        return kind(flat.tolist())
    copy = kind(flat) + dr.opaque(kind, 0)
    dr.eval(copy)
    return copy


def multiply_add(a: Any, b: Any, c: Any) -> Any:
    """a b + c, fused for Dr.Jit arrays: one instruction instead of two."""
    if is_drjit(a, b, c):
        dr = drjit_module()
        assert dr is not None
        return dr.fma(a, b, c)
    return a * b + c


def polynomial(coefficients: Any, x: Any) -> Any:
    """Horner's rule; `coefficients` ascending, plain floats. Works on any kind of array."""
    result = 0.0 * x + float(coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        result = multiply_add(result, x, float(coefficient)) if coefficient else result * x
    return result

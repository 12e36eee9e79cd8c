"""One small vocabulary of array operations for Python floats, NumPy and Dr.Jit.

The formulas of this package are written once, against the `Ops` that `ops_for(...)` returns for
their arguments. Python floats run as zero-dimensional NumPy arrays. Nothing here imports Dr.Jit:
an argument can only be a Dr.Jit array if the caller has imported it already.
"""

from __future__ import annotations

import reprlib
import sys
from collections.abc import Callable, Iterable
from types import ModuleType
from typing import Any

import numpy as np

from ._check import input_error

__all__ = [
    "DrJitOps",
    "NumPyOps",
    "Ops",
    "check_indices",
    "detached",
    "drjit_constant",
    "drjit_module",
    "floating_type",
    "is_drjit",
    "is_recording",
    "multiply_add",
    "numpy_arguments",
    "one_kind",
    "ops_for",
    "plain_numbers",
    "polynomial",
    "read_only",
    "real_arguments",
    "real_arrays",
    "without_axes",
]

REAL = "fiu"
"""Kinds of NumPy types that are real numbers."""


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


def one_kind(*values: Any) -> tuple[Any, ...]:
    """`values` such that arithmetic on them gives Dr.Jit arrays if any of them is one.

    NumPy scalars beside a Dr.Jit array become Python floats: as left operands they would turn it
    into a NumPy array, without a word and without its gradient.

    Raises
    ------
    InputError
        If Dr.Jit arrays are mixed with NumPy arrays of one or more dimensions, with lists, or with
        what is not a real number.
    """
    dr = drjit_module()
    if dr is None or not is_drjit(*values):
        return values
    return tuple(value if dr.is_array_v(value) else _beside_drjit(value) for value in values)


def _beside_drjit(value: Any) -> float:
    """A scalar as a Python float."""
    if type(value) is float:  # the usual case, without a detour through NumPy
        return value
    array = _as_array(value)
    if array.ndim:
        raise input_error(
            "a NumPy array together with a Dr.Jit array",
            "arrays of one kind, and Python floats",
            f"Convert first, e.g. mi.Float(array); the array has shape {array.shape}.",
        )
    if array.dtype.kind not in REAL:
        raise input_error(
            f"{reprlib.repr(value)} of type {type(value).__name__} together with a Dr.Jit array",
            "real numbers",
            "Pass eta and k as two of them.",
        )
    return float(array)


def _as_array(value: Any) -> np.ndarray:
    """A NumPy array; one of objects where lists are not all of one length."""
    try:
        return np.asarray(value)
    except ValueError:
        return np.array(None)


def real_arrays(**named: Any) -> list[np.ndarray]:
    """The arguments as NumPy arrays.

    Raises
    ------
    InputError
        If they are not real numbers (truth values are not), or do not broadcast.
    """
    arrays = [_as_array(value) for value in named.values()]
    if any(array.dtype.kind not in REAL for array in arrays):
        raise input_error(
            f"{_joined(named)} of types {', '.join(str(array.dtype) for array in arrays)}",
            "real numbers",
            "Give the two parts of a complex one apart, eta and k.",
        )
    try:
        np.broadcast_shapes(*(array.shape for array in arrays))
    except ValueError:
        raise input_error(
            f"{_joined(named)} of shapes {', '.join(str(array.shape) for array in arrays)}",
            "shapes that broadcast",
            "Add axes, e.g. eta[:, None], for every combination.",
        ) from None
    return arrays


def _joined(names: Iterable[str]) -> str:
    *some, last = names
    return f"{', '.join(some)} and {last}" if some else last


def real_arguments(**named: Any) -> tuple[Any, ...]:
    """The arguments as `one_kind` returns them, once they are known to fit together.

    Raises
    ------
    InputError
        If they are not real numbers, or their shapes, or sizes of Dr.Jit arrays, do not broadcast;
        and as `one_kind` does.
    """
    real_arrays(**{name: value for name, value in named.items() if not is_drjit(value)})
    dr, sizes = drjit_module(), set()
    for name, value in named.items():
        if dr is None or not is_drjit(value):
            continue
        if not dr.is_arithmetic_v(value) or dr.is_complex_v(value):
            raise input_error(
                f"{name} of type {type(value).__name__}",
                "real numbers",
                "Pass a float, a NumPy array or a Dr.Jit array.",
            )
        if dr.depth_v(value) == 1 and not dr.is_tensor_v(value):
            sizes.add(dr.width(value))
    if len(sizes - {1}) > 1:
        raise input_error(
            f"{_joined(named)} of sizes {', '.join(map(str, sorted(sizes)))}",
            "Dr.Jit arrays of one size, or of size 1",
            "dr.meshgrid gives every combination.",
        )
    return one_kind(*named.values())


def numpy_arguments(**named: Any) -> tuple[Any, ...]:
    """`real_arguments` where Dr.Jit arrays are refused."""
    if is_drjit(*named.values()):
        raise input_error(
            "a Dr.Jit array", "NumPy arrays and Python floats", "Pass np.array(alpha) and the like."
        )
    return real_arguments(**named)


def plain_numbers(*values: Any) -> bool:
    """Whether none of `values` is of NumPy: then a result without axes is to be a Python float."""
    return not any(isinstance(value, np.generic | np.ndarray) for value in values)


def without_axes(result: Any, plain: bool) -> Any:
    """A NumPy result; without axes as a Python float if `plain`, else as a NumPy scalar."""
    if not isinstance(result, np.generic | np.ndarray) or result.ndim:
        return result
    return float(result) if plain else np.asarray(result)[()]


def check_indices(eta: np.ndarray, k: np.ndarray, place: str = "index") -> None:
    """Refuse indices of refraction but finite eta > 0 and k >= 0; the error names the first.

    Raises
    ------
    InputError
        If there are others.
    """
    bad = ~(np.isfinite(eta) & (eta > 0.0) & np.isfinite(k) & (k >= 0.0))
    if not np.any(bad):
        return
    at = tuple(np.argwhere(bad)[0].tolist())
    pair = [float(np.broadcast_to(value, bad.shape)[at]) for value in (eta, k)]
    where = f" at {place} {at[0] if len(at) == 1 else at}" if at else ""
    raise input_error(
        f"eta={pair[0]:g}, k={pair[1]:g}{where}",
        "finite eta > 0 and k >= 0",
        "Absorbing media have k > 0 in the convention eta + i k.",
    )


def floating_type(*values: Any) -> np.dtype:
    """The common type of the NumPy floats among `values`; float64 where there is none."""
    typed = [value.dtype for value in values if isinstance(value, np.ndarray | np.generic)]
    typed = [dtype for dtype in typed if dtype.kind == "f"]
    return np.result_type(*typed) if typed else np.dtype(np.float64)


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

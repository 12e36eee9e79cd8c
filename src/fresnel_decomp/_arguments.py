"""Arguments of public functions: real numbers that fit together, and results of their kind."""

from __future__ import annotations

import reprlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from ._array import drjit_module, is_drjit
from ._check import input_error

__all__ = [
    "check_indices",
    "floating_type",
    "numpy_arguments",
    "one_kind",
    "plain_numbers",
    "real_arguments",
    "real_arrays",
    "without_axes",
]

REAL = "fiu"
"""Kinds of NumPy types that are real numbers."""


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


def plain_numbers(*values: Any) -> bool:
    """Whether none of `values` is of NumPy: then a result without axes is to be a Python float."""
    return not any(isinstance(value, np.generic | np.ndarray) for value in values)


def without_axes(result: Any, plain: bool) -> Any:
    """A NumPy result; without axes as a Python float if `plain`, else as a NumPy scalar."""
    if not isinstance(result, np.generic | np.ndarray) or result.ndim:
        return result
    return float(result) if plain else np.asarray(result)[()]

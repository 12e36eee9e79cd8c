"""Directions and colours as three components, and their algebra, for NumPy and Dr.Jit alike."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._arguments import one_kind
from ._array import Ops, drjit_module, is_drjit
from ._check import InputError, input_error

__all__ = [
    "Vector",
    "angle_times_normal",
    "as_triple",
    "as_vector",
    "as_vectors",
    "cross",
    "dot",
    "of_kind",
    "perpendicular",
    "scaled",
    "select_vector",
    "unit",
    "vector_sum",
]

Vector = tuple[Any, Any, Any]
"""Three components, each a number or an array."""


def as_vector(value: Any, name: str = "direction") -> Any:
    """A tuple of three Dr.Jit arrays, if `value` consists of them, else a NumPy array (..., 3).

    Vectors of Mitsuba's scalar variants consist of Python floats. Numbers beside Dr.Jit arrays
    become arrays as well.

    Raises
    ------
    InputError
        For other numbers of components, tensors, and NumPy arrays beside Dr.Jit arrays.
    """
    dr = drjit_module()
    if is_drjit(value) and dr is not None and dr.is_tensor_v(value):
        raise _no_vector(f"{name}: a tensor of shape {tuple(value.shape)}")
    if is_drjit(value) or (isinstance(value, tuple | list) and is_drjit(*value)):
        components = [value[i] for i in range(len(value))]
        if is_drjit(*components):
            assert dr is not None
            if len(components) != 3:
                raise _no_vector(f"{name} of {len(components)} Dr.Jit arrays")
            arrays = [c for c in components if is_drjit(c)]
            if not all(dr.depth_v(c) == 1 and dr.is_float_v(c) for c in arrays):
                raise _no_vector(f"{name} of {', '.join(type(c).__name__ for c in arrays)}")
            kind = type(sum(0.0 * c for c in arrays))
            return tuple(of_kind(kind, c) for c in one_kind(*components))
    array = np.asarray(value)
    if array.dtype.kind not in "fiu" or array.ndim == 0 or array.shape[-1] != 3:
        raise _no_vector(f"{name}: {array.dtype} array of shape {array.shape}")
    return array


def _no_vector(given: str) -> InputError:
    return input_error(
        given,
        "a real array (..., 3), or three Dr.Jit arrays such as mi.Vector3f has",
        "Components are on the last axis of NumPy arrays; np.stack([x, y, z], axis=-1) joins them.",
    )


def as_triple(value: Any, name: str = "direction") -> Vector:
    """Three components, each a number or an array; three NumPy arrays in a tuple as they are.

    Raises
    ------
    InputError
        As `as_vector`.
    """
    if (
        isinstance(value, tuple)
        and len(value) == 3
        and all(isinstance(part, np.ndarray) and part.ndim for part in value)
    ):
        return value
    vector = as_vector(value, name)
    if not isinstance(vector, tuple):
        vector = vector.tolist() if vector.ndim == 1 else np.moveaxis(vector, -1, 0)
    x, y, z = vector
    return x, y, z


def as_vectors(*beside: Any, **named: Any) -> list[Any]:
    """Vectors as `as_vector` returns them, all of one kind: that of Dr.Jit if any argument is.

    Parameters
    ----------
    *beside
        Numbers that are used together with them.
    **named
        Vectors; three numbers fit to Dr.Jit arrays, NumPy arrays of many vectors do not.

    Raises
    ------
    InputError
        For what is no vector, and for arrays of NumPy together with Dr.Jit's.
    """
    vectors = {name: as_vector(value, name) for name, value in named.items()}
    arrays = [v for v in vectors.values() if isinstance(v, tuple)]
    if not arrays and not is_drjit(*beside):
        return list(vectors.values())
    for name, vector in vectors.items():
        if not isinstance(vector, tuple) and vector.ndim != 1:
            raise input_error(
                f"{name}: a NumPy array of shape {vector.shape} together with Dr.Jit arrays",
                "arrays of one kind, and three numbers",
                f"Convert first, e.g. mi.Vector3f({name}.T).",
            )
    one_kind(*beside, *(array for vector in arrays for array in vector))
    parts = [value for value in beside if is_drjit(value)] + [v[0] for v in arrays]
    kind = type(sum(0.0 * part for part in parts))
    return [tuple(of_kind(kind, c) for c in vector) for vector in vectors.values()]


def of_kind(kind: Any, value: Any) -> Any:
    """A number as a Dr.Jit array, and no part of the kernel: the next one needs no new kernel."""
    if is_drjit(value):
        return value
    dr = drjit_module()
    assert dr is not None
    return dr.opaque(kind, float(value)) if dr.is_jit_v(kind) else kind(float(value))


# --- algebra --------------------------------------------------------------------------------------


def dot(a: Vector, b: Vector) -> Any:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def scaled(a: Vector, factor: Any) -> Vector:
    return a[0] * factor, a[1] * factor, a[2] * factor


def vector_sum(*vectors: Vector) -> Vector:
    x, y, z = (sum(parts[1:], parts[0]) for parts in zip(*vectors, strict=True))
    return x, y, z


def select_vector(ops: Ops, mask: Any, a: Vector, b: Vector) -> Vector:
    x, y, z = (ops.select(mask, p, q) for p, q in zip(a, b, strict=True))
    return x, y, z


def unit(ops: Ops, a: Vector) -> Vector:
    """A vector over its length; 0 if it has none."""
    square = dot(a, a)
    some = square > 0.0
    return scaled(a, 1.0 / ops.sqrt(ops.select(some, square, 1.0)))


def perpendicular(ops: Ops, a: Vector) -> Vector:
    """Any vector at right angles to a unit vector, at least half as long."""
    x, y, z = a
    flat = ops.abs(x) > 0.7
    return ops.select(flat, -z, 0.0), ops.select(flat, 0.0, z), ops.select(flat, x, -y)


def angle_times_normal(ops: Ops, a: Vector, b: Vector) -> Vector:
    """The angle between two vectors times the normal of their plane."""
    normal = cross(a, b)
    square = dot(normal, normal)
    proper = square > 0.0
    length = ops.sqrt(ops.select(proper, square, 1.0))
    angle = ops.arctan2(length, ops.select(proper, dot(a, b), 1.0))
    return scaled(normal, ops.select(proper, angle / length, 0.0))

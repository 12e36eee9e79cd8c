"""Curves tabulated over sqrt(cos_theta), for loops that evaluate them a million times.

A basis costs hundreds of operations where it is extracted functions and not a closed form. Linear
interpolation over the root of the cosine, which spreads grazing angles, errs by 2e-6 and costs two
fetches. `basis_table.BasisTable` holds what a *texture* is to hold, in the same way: of any size
and storage, without b_0 = 1, with clamped cosines and its error measured. `FastCurves` is for the
inner loop of an integral: any callable, one size, float64, nothing clamped, packets of numbers.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._array import drjit_constant, drjit_module, is_drjit
from ._check import input_error

__all__ = ["FastCurves", "Packets", "packets"]

INTERVALS = 4096


@dataclass(frozen=True, eq=False)
class FastCurves:
    """A tabulated basis: from cosines to (..., terms) values, or for Dr.Jit to a tuple of arrays.

    Cosines must be in [0, 1]. As in `BasisTable`, derivatives wrt them are slopes of chords in the
    cosine, which are finite at 0. Where a second derivative matters there is none: the slope of a
    directional albedo at mu = 1 needs the functions themselves.

    Attributes
    ----------
    samples : (n + 1, m) float
        Values of m functions at cosines (i / n)².
    """

    samples: np.ndarray
    device: Packets | None = None  # values and steps, in memory of Dr.Jit

    @classmethod
    def of(cls, basis: Any) -> FastCurves:
        """Tabulate a callable from (m,) cosines to (m, terms) values.

        Raises
        ------
        InputError
            If it returns something of another shape, or values that are not real and finite.
        """
        root = np.linspace(0.0, 1.0, INTERVALS + 1)
        given = np.asarray(basis(root * root))
        if given.dtype.kind not in "fiub" or not np.isfinite(given).all():
            raise input_error(
                f"a basis with values of type {given.dtype}"
                + (", some not finite" if given.dtype.kind == "f" else ""),
                "real, finite values at all cosines in [0, 1]",
                "Plot the functions first; a square root may need a clamped argument.",
            )
        samples = given.astype(np.float64)
        if samples.ndim != 2 or len(samples) != len(root):
            raise input_error(
                f"a basis with values of shape {samples.shape} at {len(root)} cosines",
                "a callable from (m,) cosines to (m, terms) values",
                "Stack the functions: np.stack([...], axis=-1).",
            )
        return cls(samples)

    def on(self, kind: Any) -> FastCurves:
        """The same for arguments of a Dr.Jit type."""
        rows = np.concatenate([self.samples[:-1], np.diff(self.samples, axis=0)], axis=1)
        return FastCurves(self.samples, packets(kind, rows))

    def __call__(self, cos_theta: Any) -> Any:
        last = len(self.samples) - 1
        if not is_drjit(cos_theta):
            cos_theta = np.asarray(cos_theta)
            position = np.sqrt(cos_theta) * last
            index = np.minimum(position.astype(np.intp), last - 1)
            fraction = (position - index)[..., None]
            low = self.samples[index]
            return low + fraction * (self.samples[index + 1] - low)
        if self.device is None:
            raise input_error(
                f"cosines of type {type(cos_theta).__name__}",
                "NumPy arrays, unless the curves are in memory of Dr.Jit",
                "Take curves.on(type(cos_theta)).",
            )
        dr = drjit_module()
        assert dr is not None
        position = dr.sqrt(dr.detach(cos_theta)) * float(last)
        index = dr.minimum(dr.uint32_array_t(type(position))(position), last - 1)
        fraction = position - type(position)(index)
        row = self.device.gather(index)
        terms = self.samples.shape[1]
        steps = row[terms:]
        values = [dr.fma(step, fraction, low) for low, step in zip(row[:terms], steps, strict=True)]
        if dr.grad_enabled(cos_theta):
            # an interval is (2 i + 1) / n² wide in the cosine
            scale = float(last * last) / (2.0 * type(position)(index) + 1.0)
            values = [
                dr.replace_grad(value, step * scale * cos_theta)
                for value, step in zip(values, steps, strict=True)
            ]
        return tuple(values)


@dataclass(frozen=True, eq=False)
class Packets:
    """Rows of numbers in memory of Dr.Jit, read four at a time where it can."""

    kind: Any
    width: int
    stride: int
    data: Any
    packet: Any  # an array type of four components, or None

    def gather(self, index: Any) -> list[Any]:
        """The `width` numbers of row `index`, as arrays."""
        dr = drjit_module()
        assert dr is not None
        if self.packet is None:
            first = index * self.stride
            return [dr.gather(self.kind, self.data, first + i) for i in range(self.width)]
        quarter = index * (self.stride // 4)
        values: list[Any] = []
        for i in range(self.stride // 4):
            values.extend(dr.gather(self.packet, self.data, quarter + i))
        return values[: self.width]


def packets(kind: Any, rows: np.ndarray) -> Packets:
    """(n, width) numbers for arguments of a Dr.Jit type."""
    dr = drjit_module()
    assert dr is not None
    width = rows.shape[1]
    packet = None
    if dr.is_jit_v(kind):
        double = dr.type_v(kind) == dr.VarType.Float64
        name = "Array4f64" if double else "Array4f"
        packet = getattr(importlib.import_module(kind.__module__), name)
        rows = np.pad(rows, ((0, 0), (0, -width % 4)))
    return Packets(kind, width, rows.shape[1], drjit_constant(kind, rows), packet)

"""Basis functions as a one-dimensional table: what a texture unit interpolates.

Samples lie equidistantly in a *warp* x of the cosine, 0 and 1 on the first and the last of them,
and values between them are linear in x. Curves bend at grazing incidence, so x = sqrt(cos_theta)
saves samples: the published functions need a quarter of those that x = cos_theta takes. The cube
root saves no more, and its first intervals are so short that rounded samples have no slope; the
angle needs more than the cosine.

The derivative of a warped interpolant is infinite at cos_theta = 0, that of the functions is not.
What is attached to Dr.Jit arrays is therefore the slope of the chord of each interval *in the
cosine*: finite everywhere, and as accurate as a table of this size allows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ._arguments import one_kind
from ._array import drjit_constant, drjit_module, is_drjit, read_only
from ._check import choose, input_error
from ._coefficients import check_terms, weighted_sum

__all__ = ["WARPS", "BasisTable", "Warp", "tabulate_basis"]

Warp = Literal["cos", "sqrt"]

WARPS = ("cos", "sqrt")
"""x = cos_theta, or its square root."""


@dataclass(frozen=True, eq=False)
class BasisTable:
    """A basis b_1, b_2, ... as samples with linear interpolation.

    Attributes
    ----------
    samples : (n, terms - 1) float64
        Rounded to what `storage` holds.
    warp : {"cos", "sqrt"}
        Where samples lie: equidistantly in the cosine or in its square root.
    storage : {"float32", "float16"}
    error : float
        Largest absolute distance to the tabulated functions on [0, 1], over all functions.
    """

    samples: np.ndarray
    warp: Warp
    storage: Literal["float32", "float16"]
    error: float
    _on_device: dict[type, Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "samples", read_only(self.samples))

    @property
    def terms(self) -> int:
        """Number of basis functions, b_0 = 1 included."""
        return self.samples.shape[1] + 1

    @property
    def nbytes(self) -> int:
        """Bytes of the samples as stored."""
        return self.samples.size * np.dtype(self.storage).itemsize

    def __call__(self, cos_theta: Any) -> Any:
        """(..., terms) values for NumPy input; a tuple of `terms` arrays for Dr.Jit input.

        Cosines outside [0, 1] are clamped, as a texture clamps its coordinates; NaN stays NaN.
        """
        if is_drjit(cos_theta):
            return self._drjit(cos_theta)
        cos_theta = np.asarray(cos_theta)
        kind = cos_theta.dtype if cos_theta.dtype.kind == "f" else np.dtype(np.float64)
        c = np.clip(cos_theta.astype(kind), 0.0, 1.0)
        x = _warped(np, c, self.warp) * kind.type(len(self.samples) - 1)
        index = np.clip(np.nan_to_num(x).astype(np.intp), 0, len(self.samples) - 2)
        fraction = (x - index).astype(kind)[..., None]
        low, high = (self.samples[index + i].astype(kind) for i in (0, 1))
        values = (1 - fraction) * low + fraction * high
        return np.concatenate([np.ones_like(fraction), values], axis=-1)

    def evaluate(self, coefficients: Any, cos_theta: Any) -> Any:
        """Sum of c_i b_i.

        Parameters
        ----------
        coefficients : (..., terms) array, or for Dr.Jit a sequence of `terms` arrays
        cos_theta : (...) float in [0, 1], clamped

        Raises
        ------
        InputError
            If there are not `terms` coefficients, or shapes do not broadcast.
        """
        coefficients = check_terms(coefficients, cos_theta, self.terms)
        if not is_drjit(cos_theta, *coefficients):
            return (coefficients * self(cos_theta)).sum(axis=-1)
        cos_theta, *coefficients = one_kind(cos_theta, *coefficients)
        functions = self(cos_theta)
        if not is_drjit(cos_theta):
            functions = [float(value) for value in functions]
        # the first is 1: not multiplied with
        return weighted_sum(coefficients, (1.0, *functions[1:]))

    def _drjit(self, cos_theta: Any) -> tuple[Any, ...]:
        dr = drjit_module()
        assert dr is not None
        if dr.depth_v(cos_theta) > 1:  # a colour, say: each component on its own
            rows = [self._drjit(component) for component in cos_theta]
            return tuple(type(cos_theta)(list(column)) for column in zip(*rows, strict=True))
        kind, steps = type(cos_theta), len(self.samples) - 1
        table = self._table_for(kind)
        c = dr.detach(dr.clip(cos_theta, 0.0, 1.0))
        x = _warped(dr, c, self.warp) * float(steps)
        index = dr.minimum(dr.uint32_array_t(kind)(x), steps - 1)
        fraction = dr.select(dr.isnan(cos_theta), dr.nan, x - kind(index))  # clip drops a NaN
        # the chord's end points in the cosine
        ends = [_unwarped(kind(index + i) * (1.0 / steps), self.warp) for i in (0, 1)]
        inverse = 1.0 / (ends[1] - ends[0])
        values = []
        for i in range(self.terms - 1):
            at = index * (self.terms - 1) + i
            low, high = (kind(dr.gather(type(table), table, at + j)) for j in (0, self.terms - 1))
            value = dr.fma(fraction, high - low, low)
            if dr.grad_enabled(cos_theta):
                value = dr.replace_grad(value, (high - low) * inverse * cos_theta)
            values.append(value)
        return (1.0 + 0.0 * kind(index), *values)

    def _table_for(self, kind: type) -> Any:
        """The samples as a flat Dr.Jit array that goes with `kind`, uploaded once."""
        dr = drjit_module()
        assert dr is not None
        single = dr.float32_array_t(kind) if dr.type_v(kind) != dr.VarType.Float64 else kind
        stored: Any = dr.detached_t(
            dr.float16_array_t(kind) if self.storage == "float16" else single
        )
        if stored not in self._on_device:
            self._on_device[stored] = drjit_constant(stored, self.samples)
        return self._on_device[stored]


def tabulate_basis(
    functions: Callable[[np.ndarray], np.ndarray],
    size: int,
    warp: Warp = "sqrt",
    storage: Literal["float32", "float16"] = "float32",
) -> BasisTable:
    """Sample basis functions; `Basis.table` is the usual way to it.

    Parameters
    ----------
    functions : callable from (m,) cosines to (m, terms - 1) values b_1, b_2, ...
    size : int >= 2
        Samples of each function.
    warp, storage
        See `BasisTable`.

    Raises
    ------
    InputError
        For a size below 2, or an unknown warp or storage.
    """
    choose("warp", warp, WARPS)
    choose("storage", storage, ("float32", "float16"))
    if size < 2:
        raise input_error(f"size={size}", "at least 2 samples", "About 330 in 'sqrt' reach 1e-4.")
    at = _unwarped(np.linspace(0.0, 1.0, size), warp)
    samples = functions(at).astype(storage).astype(np.float64)
    table = BasisTable(samples, warp, storage, np.nan)
    # within every interval, and often enough for tables of a few samples
    parts = max(4, 1024 // size)
    inner = np.arange((size - 1) * parts + 1) / ((size - 1) * parts)
    check = _unwarped(inner, warp)
    error = float(np.abs(table(check)[:, 1:] - functions(check)).max())
    return BasisTable(samples, warp, storage, error)


def _warped(ops: Any, cos_theta: Any, warp: Warp) -> Any:
    """x in [0, 1] of a cosine in [0, 1]."""
    return cos_theta if warp == "cos" else ops.sqrt(cos_theta)


def _unwarped(x: Any, warp: Warp) -> Any:
    return x if warp == "cos" else x * x

"""Errors of Fresnel formulas, in value and in derivative, against exact answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

# not Dr.Jit or Mitsuba: `main` has to choose an LLVM first
from _hard_cases import (
    GRADIENTS,
    REGIONS,
    VALUES,
    Points,
    generate,
    join,
    read,
)
from _peer_formulas import Formula

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Result:
    """One formula on one region, or on all of them (`region` "all")."""

    formula: str
    region: str
    points: int
    worst_ulp: float
    """Of R, in units in the last place of the exact value; over finite values, as the next."""
    worst_absolute: float
    worst_at: tuple[float, float, float]
    """cos_theta, eta, k of the largest absolute error."""
    not_finite: int
    outside: int
    """Values below 0 or above 1."""
    gradients: int
    """Partial derivatives that were compared; 0 where there is no automatic differentiation."""
    gradients_off: int
    component_ulp: dict[str, float]
    """The same for every other output that the formula has."""

    @property
    def gradient_share(self) -> float | None:
        return self.gradients_off / self.gradients if self.gradients else None


# --- measuring -----------------------------------------------------------------------------------


def collect(
    regions: Sequence[str],
    count: int,
    table: Path | None,
    advance: Callable[[int], object] = lambda n: None,
) -> Points:
    """Half `count` float32 and half float64 points of each region, and the rows of `table`."""
    made = [
        generate(region, single, count // 2, advance=advance)
        for region in regions
        for single in (True, False)
    ]
    return join(*made, *([read(table, regions)] if table else []))


def measure(formula: Formula, points: Points, variant: str) -> list[Result]:
    """A result for all regions together, and one for each; none where nothing can be asked."""
    points = points.where(_askable(formula, points))
    if not len(points):
        return []
    outputs, gradients = _evaluate(formula, points, variant)
    dtype = np.dtype(np.float32 if formula.single else np.float64)
    seen = {
        name: np.ones(len(points), bool) if formula.numpy else _normal(points.exact[name][0], dtype)
        for name in (*VALUES, *GRADIENTS)
    }
    errors = {name: _errors(value, points.exact[name], dtype) for name, value in outputs.items()}
    off, compared = _gradients_off(gradients, points, seen, dtype)
    if not formula.absorbing:
        off[2] = compared[2] = False  # no k to differentiate by

    def result(region: str, mask: NDArray[np.bool_]) -> Result:
        R, mask_R = outputs["R"], mask & seen["R"]
        absolute, ulp = errors["R"]
        finite = mask_R & np.isfinite(R)
        worst = int(np.argmax(np.where(finite, absolute, -1.0)))
        return Result(
            formula=formula.name,
            region=region,
            points=int(mask_R.sum()),
            worst_ulp=float(np.max(ulp[finite], initial=0.0)),
            worst_absolute=float(np.max(absolute[finite], initial=0.0)),
            worst_at=tuple(map(float, points.inputs[:, worst])),
            not_finite=int((~np.isfinite(R) & mask_R).sum()),
            outside=int((((R < 0.0) | (R > 1.0)) & finite).sum()),
            gradients=int(compared[:, mask].sum()),
            gradients_off=int(off[:, mask].sum()),
            component_ulp={
                name: float(np.nanmax(errors[name][1][mask & seen[name]], initial=0.0))
                for name in outputs
                if name != "R"
            },
        )

    present = [region for region in REGIONS if (points.region == region).any()]
    return [
        result("all", np.ones(len(points), bool)),
        *(result(region, points.region == region) for region in present),
    ]


def _askable(formula: Formula, points: Points) -> NDArray[np.bool_]:
    mask = points.single.copy() if formula.single else np.ones(len(points), bool)
    if not formula.absorbing:
        mask &= points.inputs[2] == 0.0
    if not formula.numpy:
        dtype = np.dtype(np.float32 if formula.single else np.float64)
        mask &= _normal(points.inputs, dtype).all(axis=0)
    return mask


def _normal(values: Array, dtype: np.dtype[Any]) -> NDArray[np.bool_]:
    """Not denormal in that type."""
    return (values == 0.0) | (np.abs(values) >= np.finfo(dtype).tiny) | np.isnan(values)


def _evaluate(
    formula: Formula, points: Points, variant: str
) -> tuple[dict[str, Array], Array | None]:
    """Outputs, and dR/d(cos_theta, eta, k) or None."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(variant)
    arguments: list[Any]
    if formula.numpy:
        arguments = list(points.inputs.astype(np.float32 if formula.single else np.float64))
        return {n: np.asarray(v, float) for n, v in formula.run(*arguments).items()}, None
    if variant.startswith("scalar"):
        import drjit.scalar

        kind = drjit.scalar.ArrayXf if formula.single else drjit.scalar.ArrayXf64
        arguments = [kind(row) for row in points.inputs]
        return {n: np.array(v, float) for n, v in formula.run(*arguments).items()}, None
    kind = dr.float32_array_t(mi.Float) if formula.single else dr.float64_array_t(mi.Float)
    arguments = [kind(row) for row in points.inputs]
    dr.make_opaque(arguments)  # literals would be folded at compile time, in another precision
    outputs = {n: np.array(v, float) for n, v in formula.run(*arguments).items()}
    dr.enable_grad(arguments)
    dr.backward(formula.run(*arguments)["R"])
    return outputs, np.stack([np.array(dr.grad(argument), float) for argument in arguments])


def _errors(value: Array, exact: Array, dtype: np.dtype[Any]) -> tuple[Array, Array]:
    """Absolute errors, and the same in units in the last place of the exact value."""
    high, low = exact
    error = np.abs((value - high) - low)
    unit = np.spacing(np.abs(high).astype(dtype)).astype(float)
    return error, np.where((high == 0.0) & (error > 0.0), np.inf, error / np.maximum(unit, 1e-300))


def _gradients_off(
    gradients: Array | None,
    points: Points,
    seen: dict[str, NDArray[np.bool_]],
    dtype: np.dtype[Any],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(3, n) masks: off by more than 1 %, and compared at all."""
    if gradients is None:
        return np.zeros((3, len(points)), bool), np.zeros((3, len(points)), bool)
    exact = np.stack([points.exact[name][0] for name in GRADIENTS])
    compared = np.abs(exact) <= np.finfo(dtype).max  # False for NaN, too
    compared &= np.stack([seen[name] for name in GRADIENTS])
    with np.errstate(invalid="ignore"):
        allowed = np.where(exact == 0.0, 1e-6, 0.01 * np.abs(exact))
        right = np.abs(gradients - exact) <= allowed  # False for NaN
    return compared & ~right, compared

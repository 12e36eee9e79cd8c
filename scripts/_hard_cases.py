"""Hostile arguments of the Fresnel equations, region by region, with their exact answers.

The answers come from complex amplitudes in `DIGITS` decimal digits (mpmath), from which nothing is
lost to cancellation: with w = sqrt(m² - 1 + c²),

    r_s = (c - w)/(c + w),   r_p = (m² c - w)/(m² c + w),   R = (|r_s|² + |r_p|²)/2,

dw/dc = c/w, dw/dm = m/w, and dR = Re(conj(r_s) dr_s + conj(r_p) dr_p) with dm = 1 for eta and
dm = i for k. None of this is shared with `fresnel_decomp.fresnel`.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fresnel_decomp._check import input_error

DIGITS = 120
VALUES = ("R", "R_s", "R_p", "T", "T_s", "T_p")
GRADIENTS = ("dR_dcos", "dR_deta", "dR_dk")

Array = NDArray[np.float64]

REGIONS = {
    "dielectric": "dielectrics from both sides, any angle",
    "metal": "metals, any angle",
    "normal": "cosines at and next to 1",
    "grazing": "cosines from 1e-2 down to the smallest denormal",
    "brewster": "Brewster's angle and the numbers beside it, k = 0",
    "brewster_absorbing": "the same with a little absorption",
    "critical": "the critical angle and the numbers beside it, k = 0",
    "critical_absorbing": "the same with a little absorption",
    "TIR": "total internal reflection, k = 0",
    "TIR_absorbing": "the same with a little absorption",
    "matched": "eta at and next to 1, k = 0",
    "matched_absorbing": "the same with a little absorption",
    "weak_absorption": "k far below eta, any angle",
    "strong_conductor": "k from 20 to 1000",
    "extreme_eta": "eta from 1e-3 to .03 and from 30 to 1000",
}
"""Name and meaning."""

_MERGED = {
    "near_normal": "normal",
    "normal_incidence": "normal",
    "dielectric_inside": "dielectric",
    "conductor": "metal",
    "matched_exact": "matched",
    "matched_near": "matched",
}


@dataclass(frozen=True)
class Points:
    """Arguments and exact answers, one entry per point.

    Attributes
    ----------
    region : (n,) str, of `REGIONS`
    single : (n,) bool
        Whether the arguments are exact in float32.
    inputs : (3, n) float64
        cos_theta, eta, k.
    exact : dict of (2, n) float64
        `VALUES` and `GRADIENTS` as unevaluated sums of two float64; NaN where not known, infinite
        where the derivative is. At k = 0, dR_dk is the limit from k > 0.
    """

    region: NDArray[np.str_]
    single: NDArray[np.bool_]
    inputs: Array
    exact: dict[str, Array]

    def __len__(self) -> int:
        return len(self.region)

    def where(self, mask: NDArray[np.bool_]) -> Points:
        return Points(
            self.region[mask],
            self.single[mask],
            self.inputs[:, mask],
            {name: column[:, mask] for name, column in self.exact.items()},
        )


def join(*parts: Points) -> Points:
    return Points(
        np.concatenate([p.region for p in parts]),
        np.concatenate([p.single for p in parts]),
        np.concatenate([p.inputs for p in parts], axis=1),
        {
            name: np.concatenate([p.exact[name] for p in parts], axis=1)
            for name in (*VALUES, *GRADIENTS)
        },
    )


# --- exact answers -------------------------------------------------------------------------------


def exact(cos_theta: float, eta: float, k: float = 0.0, digits: int = DIGITS) -> dict[str, Any]:
    """`VALUES` and `GRADIENTS` as mpmath numbers; None for a derivative that does not exist."""
    mp = mpmath()
    with mp.workdps(digits):
        c, m = mp.mpf(float(cos_theta)), mp.mpc(float(eta), float(k))
        if m == 1:
            zero, one = mp.mpf(0), mp.mpf(1)
            values = dict(zip(VALUES, (zero, zero, zero, one, one, one), strict=True))
            return values | dict.fromkeys(GRADIENTS, zero)
        m2 = m * m
        # (m - 1)(m + 1) + c² keeps a c of 1e-300 beside m = 1
        w = mp.sqrt((m - 1) * (m + 1) + c * c)
        factors = {"s": mp.mpc(1), "p": m2}
        r = {p: (f * c - w) / (f * c + w) for p, f in factors.items()}
        result = {}
        for p, f in factors.items():
            result[f"R_{p}"] = abs(r[p]) ** 2
            result[f"T_{p}"] = 4 * c * mp.re(mp.conj(f) * w) / abs(f * c + w) ** 2
        result["R"] = (result["R_s"] + result["R_p"]) / 2
        result["T"] = (result["T_s"] + result["T_p"]) / 2
        if w == 0:
            return result | dict.fromkeys(GRADIENTS)
        # d((f c - w)/(f c + w)) = 2 (w d(f c) - f c dw)/(f c + w)²
        changes = {"dR_dcos": (1, 0), "dR_deta": (0, mp.mpc(1)), "dR_dk": (0, mp.mpc(0, 1))}
        for name, (dc, dm) in changes.items():
            dw = (c * dc + m * dm) / w
            total = mp.mpf(0)
            for p, f in factors.items():
                dfc = f * dc + (2 * m * dm * c if p == "p" else 0)
                dr = 2 * (w * dfc - f * c * dw) / (f * c + w) ** 2
                total += mp.re(mp.conj(r[p]) * dr)
            result[name] = total
        if k == 0.0:  # real amplitudes or |r| = 1: exactly zero, but for rounding
            if mp.re(w) == 0:  # total internal reflection
                result |= dict.fromkeys(("R", "R_s", "R_p"), mp.mpf(1))
                result |= dict.fromkeys(("T", "T_s", "T_p", "dR_dcos", "dR_deta"), mp.mpf(0))
            else:
                result["dR_dk"] = mp.mpf(0)
        if c == 1:  # even in the angle
            result["dR_dcos"] = mp.mpf(0)
        return result


def mpmath() -> Any:
    """The module, or an `InputError` that says where it is."""
    try:
        import mpmath as module
    except ImportError:
        raise input_error(
            "a Python without mpmath",
            "one with the packages of the tests",
            "Run `make test` once, then .venv/bin/python scripts/stability.py",
        ) from None
    return module


def two_doubles(value: Any) -> tuple[float, float]:
    """A number of any precision as a sum of two float64; (NaN, 0) for None."""
    if value is None:
        return float("nan"), 0.0
    high = float(value)
    return high, float(value - mpmath().mpf(high)) if np.isfinite(high) else 0.0


# --- points of our own ---------------------------------------------------------------------------


def generate(
    region: str,
    single: bool,
    count: int,
    seed: int = 0,
    advance: Callable[[int], object] = lambda n: None,
) -> Points:
    """`count` points of one region, representable in float32 (`single`) or float64."""
    rng = np.random.default_rng([seed, list(REGIONS).index(region), int(single)])
    inputs = _arguments(region, np.float32 if single else np.float64, count, rng)
    answers = []
    for row in inputs.T:
        answers.append(exact(*row))
        advance(1)
    columns = {}
    with mpmath().workdps(DIGITS):
        for name in (*VALUES, *GRADIENTS):
            columns[name] = np.array([two_doubles(answer[name]) for answer in answers]).T
    return Points(np.full(count, region), np.full(count, single), inputs, columns)


def _arguments(region: str, kind: Any, n: int, rng: np.random.Generator) -> Array:
    """(3, n) arguments, exact in the type `kind`."""
    limits = np.finfo(kind)

    def uniform(low: float, high: float) -> Array:
        return rng.uniform(low, high, n)

    def powers(low: float, high: float) -> Array:
        return 10.0 ** rng.uniform(low, high, n)

    def either(first: Array, second: Array) -> Array:
        return np.where(rng.random(n) < 0.5, first, second)

    def beside(x: Any) -> Array:
        """`x` rounded to the type, moved by no, a few, or many units in the last place."""
        x = np.asarray(x, kind)
        steps = rng.choice([0, 1, -1, 2, -2, 3, -3, 8, -8, 100, -100, 10_000, -10_000], n)
        return np.asarray(x + steps * np.spacing(x), np.float64)

    tiny_k = powers(-9.0, -3.0) if kind == np.float32 else powers(-17.0, -3.0)
    zero = np.zeros(n)
    below_one = either(uniform(0.01, 1.0), 1.0 - powers(-4.0, -1.0))
    cos_theta, eta, k = uniform(0.0, 1.0), uniform(1.01, 3.0), zero
    if region == "dielectric":
        eta = either(eta, 1.0 / eta)
    elif region == "metal":
        eta, k = powers(-1.3, 0.8), powers(-0.3, 0.9)
    elif region == "normal":
        cos_theta = np.minimum(beside(np.ones(n)), 1.0)
        eta, k = powers(-1.5, 1.0), either(zero, powers(-4.0, 1.0))
    elif region == "grazing":
        cos_theta = powers(np.log10(float(limits.smallest_subnormal)), -2.0)
        eta, k = either(powers(-1.5, 1.0), 1.0 + powers(-4.0, 0.0)), either(zero, powers(-4.0, 1.0))
    elif region.startswith("brewster"):
        eta = powers(-2.0, 2.0).astype(kind)
        cos_theta = np.minimum(beside(_rounded(eta, "brewster")), 1.0)
    elif region.startswith("critical"):
        eta = below_one.astype(kind)
        cos_theta = np.clip(beside(_rounded(eta, "critical")), 0.0, 1.0)
    elif region.startswith("TIR"):
        eta = below_one.astype(kind)
        # from the critical angle towards grazing
        cos_theta = _rounded(eta, "critical") * either(uniform(0.0, 0.999), powers(-6.0, -0.1))
    elif region.startswith("matched"):
        unit = float(limits.eps)
        eta = 1.0 + rng.choice([-1.0, 1.0], n) * powers(np.log10(unit), -2.0)
        eta = np.where(rng.random(n) < 0.1, 1.0, eta)
        cos_theta = either(uniform(0.0, 1.0), powers(-8.0, 0.0))
        tiny_k = powers(np.log10(unit) - 1.0, -2.0)
    elif region == "weak_absorption":
        eta, k = uniform(0.05, 3.0), tiny_k
    elif region == "strong_conductor":
        eta, k = powers(-3.0, 1.0), powers(np.log10(20.0), 3.0)
        cos_theta = either(cos_theta, powers(-7.0, 0.0))
    elif region == "extreme_eta":
        eta, k = either(powers(-3.0, -1.5), powers(1.5, 3.0)), either(zero, powers(-4.0, 1.0))
        cos_theta = either(cos_theta, powers(-4.0, 0.0))
    if region.endswith("_absorbing"):
        k = tiny_k
    return np.stack([cos_theta, eta, k]).astype(kind).astype(np.float64)


def _rounded(eta: Array, angle: str) -> Array:
    """The cosine of an angle that belongs to `eta` < 1 or any `eta`, to the last place."""
    mp = mpmath()
    with mp.workdps(50):
        squares = (mp.mpf(float(e)) ** 2 for e in eta)
        if angle == "critical":
            return np.array([float(mp.sqrt(1 - e)) for e in squares])
        return np.array([float(1 / mp.sqrt(1 + e)) for e in squares])


# --- points of a table ---------------------------------------------------------------------------


def read(path: Path, regions: Iterable[str] = REGIONS) -> Points:
    """The rows of a table of hard cases, its regions renamed to ours.

    Columns: region, precision ("f32" or "f64"), `VALUES` and `GRADIENTS` in decimal (empty: no such
    derivative), and cos_theta_hex, eta_hex, k_hex.
    """
    mp = mpmath()
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    missing = {"region", "precision", "cos_theta_hex", "eta_hex", "k_hex", *VALUES, *GRADIENTS}
    missing -= set(rows[0] if rows else ())
    if missing:
        raise input_error(
            f"'{path}' without {', '.join(sorted(missing))}",
            "a table of hard cases",
            "Leave --hard-cases out to use the points that this script makes.",
        )
    names = ("cos_theta_hex", "eta_hex", "k_hex")
    inputs = np.array([[float.fromhex(row[name]) for row in rows] for name in names])
    region = np.array([_region(row["region"], x) for row, x in zip(rows, inputs.T, strict=True)])
    with mp.workdps(DIGITS):
        columns = {
            name: np.array(
                [two_doubles(mp.mpf(row[name]) if row[name] else None) for row in rows]
            ).T
            for name in (*VALUES, *GRADIENTS)
        }
    single = np.array([row["precision"] == "f32" for row in rows])
    return Points(region, single, inputs, columns).where(np.isin(region, list(regions)))


def _region(name: str, inputs: Array) -> str:
    if name == "matched_or_grazing":
        if abs(inputs[1] - 1.0) < 1e-3:
            return "matched_absorbing" if inputs[2] > 0.0 else "matched"
        return "grazing"
    return "metal" if name.startswith("metal") else _MERGED.get(name, name)

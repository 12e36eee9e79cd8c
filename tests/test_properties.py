"""Properties of the exact equations over their whole domain, in kernels, against mpmath.

The points come from the generator of `scripts/stability.py`: fifteen regions, each with its own
way to be hostile, in float32 and float64; hypothesis chooses regions and seeds.
"""

from __future__ import annotations

import functools
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backends import float_type
from fresnel_decomp import (
    conductor,
    dielectric,
    polarized,
    reflectance_components,
    refracted_cosine,
    transmittance,
)
from tolerances import GRADIENT, NATIVE_P_FLOOR, NATIVE_P_ULP, NATIVE_ULP, WIDE_ULP

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))
import _hard_cases as hard

property_test = functools.partial(settings, derandomize=True, deadline=None, database=None)
regions = st.sampled_from(list(hard.REGIONS))
seeds = st.integers(0, 2**32 - 1)
BATCH = 24
DTYPES = {"float32": np.float32, "float64": np.float64}


def normal(values, dtype):
    """What Dr.Jit's threads do not flush."""
    magnitude, limits = np.abs(values), np.finfo(dtype)
    return (magnitude == 0.0) | ((magnitude >= limits.tiny) & (magnitude <= limits.max))


def hostile(region, seed, dtype):
    """Points of a region that fit the type, without denormal arguments."""
    points = hard.generate(region, dtype == "float32", BATCH, seed)
    return points.where(normal(points.inputs, dtype).all(axis=0))


def opaque(Float, rows):
    """One array per row; neither literals nor folded."""
    import drjit as dr

    arrays = [Float(np.ascontiguousarray(row)) for row in rows]
    dr.make_opaque(arrays)
    return arrays


def evaluate(arguments, precision):
    R_s, R_p, T_s, T_p = reflectance_components(*arguments, precision=precision)
    return {
        "R": conductor(*arguments, precision=precision),
        "T": transmittance(*arguments, precision=precision),
        "R_s": R_s,
        "R_p": R_p,
        "T_s": T_s,
        "T_p": T_p,
    }


def gradient(function, arguments):
    """Of the sum of the results, wrt each argument, in backward mode."""
    import drjit as dr

    dr.enable_grad(arguments)
    dr.backward(function(*arguments))
    return [np.array(dr.grad(argument), np.float64) for argument in arguments]


# --- against high precision ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dtype", "precision"), [("float32", "wide"), ("float32", "native"), ("float64", "wide")]
)
@property_test(max_examples=60)
@given(region=regions, seed=seeds)
def test_values(dtype, precision, region, seed):
    points = hostile(region, seed, dtype)
    values = evaluate(opaque(float_type("llvm", dtype), points.inputs), precision)
    values = {name: np.array(value) for name, value in values.items()}
    for name, value in values.items():
        assert value.dtype == dtype
        assert ((value >= 0.0) & (value <= 1.0)).all()  # False for NaN
        high, low = points.exact[name]
        error = np.abs((value.astype(np.float64) - high) - low)
        ulp = error / np.spacing(np.abs(high).astype(dtype)).astype(np.float64)
        limit = NATIVE_ULP
        checked = normal(high, dtype)
        if (dtype, precision) == ("float32", "wide"):
            limit = WIDE_ULP
        elif name == "R_p":
            limit = NATIVE_P_ULP
            checked &= high > NATIVE_P_FLOOR
            assert error[~checked].max(initial=0.0) <= 1e-14
        assert ulp[checked].max(initial=0.0) <= limit, name
    for R, T in (("R", "T"), ("R_s", "T_s"), ("R_p", "T_p")):
        total = values[R].astype(np.longdouble) + values[T]
        assert np.abs(total - 1.0).max() <= np.finfo(dtype).eps


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@property_test(max_examples=60)
@given(region=regions, seed=seeds)
def test_gradients(dtype, region, seed):
    points = hostile(region, seed, dtype)
    found = gradient(conductor, opaque(float_type("llvm", dtype), points.inputs))
    for name, value in zip(hard.GRADIENTS, found, strict=True):
        exact = points.exact[name][0]
        with np.errstate(invalid="ignore"):
            checked = normal(exact, dtype)  # False where there is none
            error = np.abs(value - exact)[checked]
        assert (error <= GRADIENT[dtype] * np.abs(exact[checked])).all(), name
        assert np.isfinite(value[checked]).all()


@property_test(max_examples=40)
@given(region=regions, seed=seeds)
def test_both_modes_of_differentiation_agree(region, seed):
    import drjit as dr

    Float = float_type("llvm", "float32")
    points = hostile(region, seed, "float32")
    backward = gradient(transmittance, opaque(Float, points.inputs))
    for i in range(3):
        arguments = opaque(Float, points.inputs)
        dr.enable_grad(arguments[i])
        T = transmittance(*arguments)
        dr.forward(arguments[i])
        np.testing.assert_array_equal(np.array(dr.grad(T), np.float64), backward[i])


# --- physics -------------------------------------------------------------------------------------


@property_test(max_examples=80)
@given(
    st.floats(-3.0, 3.0).map(lambda e: 10.0**e),
    st.one_of(st.just(0.0), st.floats(-9.0, 3.0).map(lambda e: 10.0**e)),
    st.one_of(st.floats(0.0, 1.0), st.just(None)),
)
def test_s_reflectance_falls_with_the_cosine_from_number_to_number(eta, k, cos_theta):
    """Between neighbouring float32, not only on a grid: correct rounding keeps the order."""
    eta, k = np.float32(eta), np.float32(k)
    if cos_theta is None:  # the critical angle, Brewster's for eta > 1
        index = min(float(eta), 1.0 / float(eta))
        cos_theta = np.sqrt((1.0 - index) * (1.0 + index))
    centre = np.float32(cos_theta)
    steps = np.arange(-200, 201) * np.spacing(centre)
    cosines = np.unique(np.clip(centre + steps, 0.0, 1.0).astype(np.float32))
    R_s, _, T_s, _ = reflectance_components(cosines, eta, k)
    # errors of .51 ulp can swap two values that are closer than .02 ulp
    assert (np.diff(R_s) <= 0.0).mean() > 0.99
    assert (np.diff(R_s) <= np.spacing(R_s[1:])).all()
    assert (np.diff(T_s) >= -np.spacing(T_s[1:])).all()


@property_test(max_examples=60)
@given(seeds)
def test_reciprocity_of_both_polarisations(seed):
    """R(eta, theta_i) = R(1/eta, theta_t), as well as rounding 1/eta and cos theta_t allows."""
    rng = np.random.default_rng(seed)
    near_one = 1.0 + 10.0 ** rng.uniform(-12.0, 0.0, BATCH)
    eta = np.where(rng.random(BATCH) < 0.5, near_one, 10.0 ** rng.uniform(0.01, 2.0, BATCH))
    cos_theta = np.where(
        rng.random(BATCH) < 0.5, rng.random(BATCH), 10.0 ** rng.uniform(-6.0, 0.0, BATCH)
    )
    inside, inverse = refracted_cosine(cos_theta, eta), 1.0 / eta
    Float = float_type("llvm", "float64")
    for i in range(2):
        outward = polarized(inside, inverse)[i]
        inward = polarized(cos_theta, eta)[i]

        def component(c, n, i=i):
            return polarized(c, n)[i]

        # neither argument is known better than to half a unit, nor is the refracted cosine
        # (which follows 1/eta) less sensitive than the reflectance
        slopes = gradient(component, opaque(Float, [inside, inverse]))
        moved = 4e-16 * (np.abs(inside * slopes[0]) + np.abs(inverse * slopes[1]))
        assert (np.abs(outward - inward) <= 2.0 * moved + 4e-15 * inward + 1e-300).all()


@property_test(max_examples=80)
@given(st.floats(0.001, 2.0), st.booleans())
def test_p_reflectance_turns_at_brewsters_angle(decades, inverted):
    """0 there, falling before and rising after it."""
    eta = 10.0 ** (-decades if inverted else decades)
    brewster = 1.0 / np.hypot(1.0, eta)
    reach = 1e-3
    if eta < 1.0:  # stay on this side of the critical angle
        critical = np.sqrt((1.0 - eta) * (1.0 + eta))
        reach = min(reach, 0.5 * (1.0 - critical / brewster))
    offsets = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    cosines = np.minimum(brewster * (1.0 + reach * offsets), 1.0)
    _, R_p = polarized(cosines, eta)
    assert R_p[2] <= 1e-6 * max(R_p[1], R_p[3])
    assert R_p[0] > R_p[1] > R_p[2] < R_p[3]
    assert R_p[4] >= R_p[3]
    slopes = gradient(
        lambda c, n: polarized(c, n)[1],
        opaque(float_type("llvm", "float64"), [cosines, np.full(5, eta)]),
    )[0]
    assert (slopes[:2] < 0.0).all()
    assert slopes[3] > 0.0


@property_test(max_examples=60)
@given(st.sampled_from(["dielectric", "TIR", "grazing", "brewster", "normal"]), seeds)
def test_small_absorption_starts_with_the_one_sided_derivative(region, seed):
    """(R(k) - R(0))/k -> dR/dk at k = 0, and R(k) -> the dielectric."""
    points = hostile(region, seed, "float32")
    cos_theta, eta, _ = points.inputs
    # away from the critical angle and from m = 1, where k is not small beside what it is added to
    room = np.abs(eta**2 + cos_theta**2 - 1.0) * np.minimum(1.0, np.abs(eta - 1.0))
    regular = (room > 1e-3) & (cos_theta > 1e-6)
    cos_theta, eta = cos_theta[regular], eta[regular]
    if not cos_theta.size:
        return
    k = 1e-7 * np.minimum(1.0, eta)
    T, T_0 = (transmittance(cos_theta, eta, absorption) for absorption in (k, 0.0 * k))
    np.testing.assert_allclose(conductor(cos_theta, eta, 0.0 * k), dielectric(cos_theta, eta))
    arguments = opaque(float_type("llvm", "float64"), [cos_theta, eta, 0.0 * k])
    slope = gradient(conductor, arguments)[2]
    # the next term is of the order of (k/room)²; T's own rounding is 1e-15 T
    tolerance = 1e-3 * k * np.abs(slope) + 10.0 * (k / room[regular]) ** 2 + 1e-14 * T_0
    assert (np.abs((T_0 - T) - k * slope) <= tolerance).all()
    transparent = T_0 > 0.0
    assert (slope[transparent] == 0.0).all()
    assert (slope[~transparent] < 0.0).all()  # what is absorbed is missing from R = 1

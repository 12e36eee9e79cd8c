"""The exact equations: textbook and high-precision oracles, physics, kinds of input, bad input."""

from __future__ import annotations

import functools
import importlib

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import fresnel_decomp
from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import (
    InputError,
    conductor,
    dielectric,
    polarized,
    reflectance_components,
    refracted_cosine,
    transmittance,
)
from fresnel_decomp._array import drjit_constant
from oracles import high_precision, high_precision_gradient, mp_ulps, textbook
from tolerances import GRADIENT, NATIVE_P_FLOOR, NATIVE_P_ULP, NATIVE_ULP, WIDE_ULP

# --- values ------------------------------------------------------------------------------------


def benign_points():
    rng = np.random.default_rng(7)
    return rng.uniform(0.05, 0.95, 500), rng.uniform(0.2, 4.0, 500), rng.uniform(0.3, 5.0, 500)


def test_textbook_formula():
    cos_theta, eta, k = benign_points()
    for absorption in (k, 0.0 * k):
        lossless = absorption[0] == 0.0
        index = eta + 1.01 if lossless else eta
        R_s, R_p = textbook(cos_theta, index, absorption)
        ours = polarized(cos_theta, index, absorption)
        np.testing.assert_allclose(ours[0], R_s, rtol=1e-12, atol=0.0)
        np.testing.assert_allclose(ours[1], R_p, rtol=1e-12, atol=1e-16)
        R = conductor(cos_theta, index, absorption)
        np.testing.assert_allclose(R, (R_s + R_p) / 2.0, rtol=1e-12, atol=0.0)
        T = transmittance(cos_theta, index, absorption)
        np.testing.assert_allclose(T, 1.0 - (R_s + R_p) / 2.0, rtol=0.0, atol=1e-15)
        if lossless:
            # evaluated without complex numbers, so equal up to the rounding of both
            np.testing.assert_allclose(dielectric(cos_theta, index), R, rtol=4e-15, atol=0.0)


def test_closed_values():
    assert conductor(1.0, 1.5, 0.0) == pytest.approx(0.04, rel=1e-15)
    assert conductor(1.0, 1.0, 2.0) == pytest.approx(0.5, rel=1e-15)
    assert conductor(0.0, 1.5, 0.0) == 1.0
    assert conductor(0.3, 1.0, 0.0) == 0.0
    assert conductor(0.0, 1.0, 0.0) == 0.0  # nothing there: no reflection at any angle
    assert transmittance(0.0, 1.0, 0.0) == 1.0
    assert dielectric(0.1, 0.5) == 1.0
    # 45 degrees: R_p = R_s² for every index
    R_s, R_p = polarized(np.sqrt(0.5), np.array([0.9, 1.5, 0.2]), np.array([0.0, 0.0, 3.0]))
    np.testing.assert_allclose(R_p, R_s**2, rtol=1e-14)


@pytest.mark.parametrize("precision", ["wide", "native"])
def test_components_average_to_the_whole(precision):
    cos_theta, eta, k = (v.astype(np.float32) for v in benign_points())
    R_s, R_p, T_s, T_p = reflectance_components(cos_theta, eta, k, precision=precision)
    R = conductor(cos_theta, eta, k, precision=precision)
    T = transmittance(cos_theta, eta, k, precision=precision)
    np.testing.assert_allclose(R, (R_s + R_p) / 2, rtol=2e-6)
    np.testing.assert_allclose(T, (T_s + T_p) / 2, rtol=2e-6)


# float32 numbers over their whole range, and the neighbourhood of every special place
cosines = st.one_of(
    st.floats(0.0, 1.0, width=32),
    st.floats(-30.0, -1.0).map(lambda e: 2.0**e),
    st.floats(-24.0, -1.0).map(lambda e: 1.0 - 2.0**e),
)
indices = st.one_of(
    st.floats(0.0009765625, 1024.0, width=32),
    st.floats(-20.0, 20.0).map(lambda e: 2.0**e),
    st.floats(-24.0, -2.0).map(lambda e: 1.0 + 2.0**e),
    st.floats(-24.0, -2.0).map(lambda e: 1.0 - 2.0**e),
)
absorptions = st.one_of(
    st.just(0.0), st.floats(0.0, 1024.0, width=32), st.floats(-40.0, 20.0).map(lambda e: 2.0**e)
)
property_test = functools.partial(settings, derandomize=True, deadline=None, database=None)


@st.composite
def points(draw):
    """(cos_theta, eta, k), half of them next to Brewster's or the critical angle."""
    cos_theta, eta, k = draw(cosines), draw(indices), draw(absorptions)
    place = draw(st.sampled_from(["anywhere", "anywhere", "brewster", "critical"]))
    if place == "brewster":
        cos_theta = 1.0 / np.sqrt(1.0 + eta * eta)
    elif place == "critical" and eta < 1.0:
        cos_theta = np.sqrt(1.0 - eta * eta)
    if place != "anywhere":
        cos_theta *= 1.0 + draw(st.integers(-3, 3)) * 2.0**-24
    return tuple(np.float32(v) for v in (min(cos_theta, 1.0), eta, k))


def check_point(arguments, precision, dtype):
    arguments = tuple(dtype(v) for v in arguments)
    R_s, R_p, T_s, T_p = high_precision(*arguments)
    exact = {"R_s": R_s, "R_p": R_p, "T_s": T_s, "T_p": T_p}
    exact |= {"R": (R_s + R_p) / 2, "T": (T_s + T_p) / 2}
    values = dict(zip(exact, reflectance_components(*arguments, precision=precision), strict=False))
    values["R"] = conductor(*arguments, precision=precision)
    values["T"] = transmittance(*arguments, precision=precision)
    for name, value in values.items():
        assert type(value) is dtype
        assert 0.0 <= value <= 1.0
        if precision == "wide" and dtype is np.float32:
            limit = WIDE_ULP
        elif name == "R_p":
            if exact[name] < NATIVE_P_FLOOR:
                assert abs(value - float(exact[name])) < 1e-14
                continue
            limit = NATIVE_P_ULP
        else:
            limit = NATIVE_ULP
        assert mp_ulps(value, exact[name]) <= limit, name
    for R, T in (("R", "T"), ("R_s", "T_s"), ("R_p", "T_p")):
        total = np.longdouble(values[R]) + np.longdouble(values[T])
        assert abs(total - 1.0) <= np.finfo(dtype).eps


@property_test(max_examples=400)
@given(points())
def test_wide_is_correctly_rounded(point):
    check_point(point, "wide", np.float32)


@property_test(max_examples=250)
@given(points(), st.sampled_from([np.float32, np.float64]))
def test_native_is_good_to_ten_ulp(point, dtype):
    check_point(point, "native", dtype)


@property_test(max_examples=200)
@given(
    *(
        st.floats(width=32, min_value=low, allow_infinity=False, allow_nan=False)
        for low in (0.0, 1.0000000031710769e-30, 0.0)
    )
)
def test_wide_holds_over_the_whole_range_of_float32(cos_theta, eta, k):
    check_point((min(cos_theta, 1.0), eta, k), "wide", np.float32)


@property_test(max_examples=60)
@given(
    st.floats(0.02, 0.98),
    st.floats(0.1, 5.0),
    st.floats(0.01, 5.0),
)
def test_gradients_of_components(cos_theta, eta, k):
    import drjit as dr

    Float = float_type("llvm", "float64")
    expected = high_precision_gradient(cos_theta, eta, k)
    for i in range(3):
        arguments = [Float(v) for v in (cos_theta, eta, k)]
        dr.enable_grad(arguments[i])
        components = reflectance_components(*arguments)
        dr.forward(arguments[i])
        found = [float(dr.grad(v)[0]) for v in components]
        for j in range(2):
            scale = 1e-13 * np.abs(expected[j]).max()
            assert found[j] == pytest.approx(expected[j][i], rel=1e-10, abs=scale)
            assert found[j + 2] == -found[j]


# --- physics -----------------------------------------------------------------------------------


@property_test(max_examples=150)
@given(st.floats(0.001, 1.0), st.floats(1.0001, 10.0))
def test_reciprocity(cos_theta, eta):
    """R(eta, theta_i) = R(1/eta, theta_t), and Snell's law leads back."""
    inside = refracted_cosine(cos_theta, eta)
    back = refracted_cosine(inside, 1.0 / eta)
    # rounding of `inside` moves the way back by the slope of Snell's law
    tolerance = 4e-16 * (1.0 + eta * eta * inside / cos_theta)
    assert back == pytest.approx(cos_theta, rel=0.0, abs=tolerance * max(1.0, 1.0 / cos_theta))
    slope = eta * eta * inside / cos_theta
    assert dielectric(inside, 1.0 / eta) == pytest.approx(
        dielectric(cos_theta, eta), rel=1e-14 * (1.0 + slope + 1.0 / (eta - 1.0)), abs=1e-15
    )


def test_snell():
    theta = np.linspace(0.0, np.pi / 2, 200)[:-1]
    for eta in (0.4, 0.9999, 1.0, 1.0001, 1.5, 4.0):
        cos_t = refracted_cosine(np.cos(theta), eta)
        sine = np.sin(theta) / eta
        refracted = sine < 1.0
        np.testing.assert_allclose(
            np.sqrt(1.0 - cos_t[refracted] ** 2), sine[refracted], rtol=1e-9, atol=1e-8
        )
        assert (cos_t[~refracted] == 0.0).all()
        assert (dielectric(np.cos(theta), eta)[~refracted] == 1.0).all()
    np.testing.assert_array_equal(
        refracted_cosine(np.linspace(0.0, 1.0, 9), 1.0), np.linspace(0.0, 1.0, 9)
    )


@pytest.mark.parametrize("eta", [0.02, 0.5, 0.999, 1.001, 1.5, 50.0])
def test_brewster(eta):
    """R_p vanishes at tan(theta) = eta, and R_s is there ((1 - eta²)/(1 + eta²))²."""
    R_s, R_p = polarized(1.0 / np.hypot(1.0, eta), eta)
    # the rounding of the cosine, through its slope, squared
    assert R_p < (2e-16 * max(eta, 1.0 / eta) ** 4) ** 2 + 1e-30
    assert R_s == pytest.approx(((1.0 - eta**2) / (1.0 + eta**2)) ** 2, rel=1e-12)


@pytest.mark.parametrize("eta", [0.1, 0.7, 0.99])
def test_total_internal_reflection_begins_at_the_critical_angle(eta):
    critical = np.sqrt((1.0 - eta) * (1.0 + eta))
    below, above = critical * (1.0 - 1e-12), critical * (1.0 + 1e-9)
    assert dielectric(below, eta) == 1.0
    assert refracted_cosine(below, eta) == 0.0
    assert 0.9 < dielectric(above, eta) < 1.0
    # next to it, 1 - R grows like the square root of the distance
    distance = np.array([1e-10, 1e-12])
    T = transmittance(critical * (1.0 + distance), eta)
    assert T[0] / T[1] == pytest.approx(10.0, rel=5e-3)


def test_vanishing_absorption_meets_the_dielectric():
    cos_theta = np.linspace(0.0, 1.0, 101)
    for eta in (0.5, 1.0, 1.5):
        for k, tolerance in ((1e-300, 0.0), (1e-20, 1e-9), (1e-12, 1e-5)):
            R = conductor(cos_theta, eta, k)
            np.testing.assert_allclose(R[1:], dielectric(cos_theta[1:], eta), atol=tolerance)


@property_test(max_examples=100)
@given(st.floats(0.01, 20.0), st.floats(0.0, 20.0))
def test_s_polarised_reflectance_rises_with_the_angle(eta, k):
    R_s, _, T_s, _ = reflectance_components(np.linspace(0.0, 1.0, 300), eta, k)
    assert (np.diff(R_s) <= 4e-16).all()
    assert (np.diff(T_s) >= -4e-16).all()


def test_polarisations_agree_at_both_ends():
    eta, k = np.array([0.2, 1.5, 0.5]), np.array([3.0, 0.0, 1e-3])
    for cos_theta in (0.0, 1.0):
        R_s, R_p, T_s, T_p = reflectance_components(cos_theta, eta, k)
        np.testing.assert_allclose(R_s, R_p, rtol=1e-14)
        np.testing.assert_allclose(T_s, T_p, rtol=1e-14)


# --- kinds of input ----------------------------------------------------------------------------


def calls():
    return {
        "conductor": lambda c, e, k, **o: [conductor(c, e, k, **o)],
        "dielectric": lambda c, e, k, **o: [dielectric(c, e, **o)],
        "transmittance": lambda c, e, k, **o: [transmittance(c, e, k, **o)],
        "polarized": polarized,
        "components": reflectance_components,
        "refracted_cosine": lambda c, e, k, **o: [refracted_cosine(c, e, **o)],
    }


NAMES = ("cos_theta", "eta", "k")


@pytest.mark.parametrize("call", calls().values(), ids=calls().keys())
@pytest.mark.parametrize("precision", ["wide", "native"])
def test_numpy_kinds(call, precision):
    def kinds(*arguments):
        return {
            (type(v), np.asarray(v).dtype, np.shape(v))
            for v in call(*arguments, precision=precision)
        }

    single, double = np.dtype(np.float32), np.dtype(np.float64)
    assert kinds(0.5, 1.5, 0.0) == kinds(1, 2, 0) == {(float, double, ())}
    assert kinds(np.float32(0.5), 1.5, 0.0) == {(np.float32, single, ())}
    assert kinds(0.5, np.float32(1.5), np.float32(0.0)) == {(np.float32, single, ())}
    assert kinds(np.float64(0.5), 1.5, 0.0) == {(np.float64, double, ())}
    assert kinds(np.array(0.5, np.float32), 1.5, 0.0) == {(np.float32, single, ())}
    assert kinds(np.zeros((4, 1), np.float32), np.full(3, 1.5, np.float32), 0.0) == {
        (np.ndarray, single, (4, 3))
    }
    assert kinds(np.zeros(3, np.float32), np.full(3, 1.5), 0.0) == {(np.ndarray, double, (3,))}
    assert kinds([0.5, 0.6], 1.5, 0.0) == {(np.ndarray, double, (2,))}
    assert kinds(np.array([0, 1]), 2, 0) == {(np.ndarray, double, (2,))}
    assert kinds(np.array([0, 1]), np.float32(2), 0) == {(np.ndarray, single, (2,))}
    assert kinds(np.zeros(2, np.float16), np.float16(2), 0.0) == {
        (np.ndarray, np.dtype(np.float16), (2,))
    }
    assert kinds(np.zeros((0, 3)), 1.5, 0.0) == {(np.ndarray, double, (0, 3))}


def test_arrays_equal_scalars():
    cos_theta, eta, k = benign_points()
    together = conductor(cos_theta, eta, k)
    one_by_one = [conductor(*map(float, p)) for p in zip(cos_theta, eta, k, strict=True)]
    np.testing.assert_array_equal(together, one_by_one)
    table = conductor(cos_theta, eta[:5, None], k[:5, None])
    np.testing.assert_array_equal(table[3], conductor(cos_theta, eta[3], k[3]))


def test_arguments_are_left_alone():
    arguments = [np.array([-1.0, 0.5]), np.array([1.5, -1.0]), np.array([0.0, 1.0])]
    before = [a.copy() for a in arguments]
    conductor(*arguments)
    for a, b in zip(arguments, before, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("call", calls().values(), ids=calls().keys())
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_drjit_equals_numpy(backend, dtype, call):
    Float = float_type(backend, dtype)
    cos_theta, eta, k = (v.astype(dtype) for v in benign_points())
    expected = call(cos_theta, eta, k)
    found = call(Float(cos_theta), Float(eta), Float(k))
    for a, b in zip(found, expected, strict=True):
        assert type(a) is Float
        np.testing.assert_allclose(
            np.array(a), b, rtol=4e-15 if dtype == "float64" else 1e-7, atol=1e-16
        )


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_drjit_kinds(backend):
    import drjit as dr

    module = pytest.importorskip(f"drjit.{backend}.ad")
    Float, Double = float_type(backend), float_type(backend, "float64")
    F = Float([0.5, 0.6])
    for arguments in (
        (F, 1.5, 0.0),
        (0.5, Float([1.5, 2.0]), 0.0),
        (0.5, 1.5, Float([0.0, 1.0])),
        (np.float64(0.5), Float([1.5, 2.0]), np.float32(0.0)),
        (np.array(0.5), Float([1.5, 2.0]), 0),
        (F, Float(1.5), Float(0.0)),
    ):
        R = conductor(*arguments)
        assert type(R) is Float
        plain = [np.array(v) if dr.is_array_v(v) else float(v) for v in arguments]
        np.testing.assert_allclose(np.array(R), conductor(*plain), rtol=3e-7)
    assert type(conductor(F, Double(1.5), 0.0)) is Double
    assert type(conductor(module.Float16([0.5]), 1.5, 0.0)) is module.Float16
    colour = conductor(F, module.Array3f(1.0, 2.0, 3.0), module.Array3f(0.0, 1.0, 2.0))
    assert type(colour) is module.Array3f
    assert dr.shape(colour) == (3, 2)
    tensor = conductor(
        module.TensorXf(np.array([[0.5, 0.6]], np.float32)),
        module.TensorXf(np.array([[1.5], [1.6], [1.7]], np.float32)),
        0.0,
    )
    assert type(tensor) is module.TensorXf
    assert tensor.shape == (3, 2)
    expected = conductor(np.array([0.5, 0.6]), np.array([[1.5], [1.6], [1.7]]), 0.0)
    np.testing.assert_allclose(np.array(tensor), expected, rtol=2e-7)


def test_mitsuba_variants(variant):
    """The variant's own Float and Color3f, which in scalar variants are Python's and an array."""
    import mitsuba as mi

    expected = conductor(0.5, np.array([0.2, 0.9, 1.5]), np.array([3.5, 2.5, 1.9]))
    colour = conductor(mi.Float(0.5), mi.Color3f(0.2, 0.9, 1.5), mi.Color3f(3.5, 2.5, 1.9))
    assert type(colour) is mi.Color3f
    np.testing.assert_allclose(np.array(colour).ravel(), expected, rtol=2e-7)
    R = conductor(mi.Float(0.5), mi.Float(0.2), mi.Float(3.5))
    assert type(R) is mi.Float
    np.testing.assert_allclose(np.array(R).ravel(), expected[:1], rtol=2e-7)


# --- recording: loops, freezing, derivatives ----------------------------------------------------


@pytest.mark.parametrize("mode", ["forward", "backward"])
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_inside_a_symbolic_loop(backend, mode):
    import drjit as dr

    Float = float_type(backend)
    module = pytest.importorskip(f"drjit.{backend}.ad")
    eta = Float([1.5, 0.2, 0.5])
    k = Float([0.0, 3.0, 0.0])
    dr.enable_grad(eta)
    _, total = dr.while_loop(
        state=(module.UInt32(0), Float(0.0)),
        cond=lambda i, total: i < 3,
        body=lambda i, total: (i + 1, total + conductor(0.25 * Float(i + 1), eta, k)),
        mode="symbolic",
        max_iterations=-1,
        labels=("i", "total"),
    )
    if mode == "forward":
        dr.forward(eta)
        gradient = np.array(dr.grad(total))
    else:
        dr.backward(total)
        gradient = np.array(dr.grad(eta))
    expected_value, expected_gradient = 0.0, 0.0
    for i in range(3):
        x = Float([1.5, 0.2, 0.5])
        dr.enable_grad(x)
        R = conductor(0.25 * (i + 1), x, Float([0.0, 3.0, 0.0]))
        dr.forward(x)
        expected_value += np.array(R)
        expected_gradient += np.array(dr.grad(R))
    np.testing.assert_allclose(np.array(total), expected_value, rtol=3e-7)
    np.testing.assert_allclose(gradient, expected_gradient, rtol=1e-6)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_frozen_functions_replay(backend):
    import drjit as dr

    Float = float_type(backend)
    frozen = dr.freeze(lambda c, eta, k: conductor(c, eta, k))
    for shift in range(4):
        cos_theta, eta = np.array([0.1, 0.7]), np.array([1.5, 0.3]) + shift
        k = np.array([0.0, 2.0])
        # in memory of Dr.Jit: NumPy's, mapped, is recorded anew where its alignment differs
        R = frozen(*(drjit_constant(Float, value) for value in (cos_theta, eta, k)))
        np.testing.assert_allclose(np.array(R), conductor(cos_theta, eta, k), rtol=3e-6)
    assert frozen.n_recordings <= 2  # the second without the literals of the first


@pytest.mark.parametrize("precision", ["wide", "native"])
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_derivatives_of_frozen_functions(backend, precision):
    import drjit as dr

    Float = float_type(backend)

    @dr.freeze
    def slopes(*arguments):
        dr.enable_grad(*arguments)
        dr.backward(conductor(*arguments, precision=precision))
        return [dr.grad(argument) for argument in arguments]

    for shift in (0.0, 0.1, 0.2, 0.3):
        point = np.array([0.3 + shift, 0.7]), np.array([1.5, 0.3]) + shift, np.array([0.0, 2.0])
        found = np.array([np.array(s) for s in slopes(*(Float(v) for v in point))])
        exact = [np.mean(high_precision_gradient(*(float(v[i]) for v in point)), 0) for i in (0, 1)]
        np.testing.assert_allclose(found.T, exact, rtol=5e-6, atol=1e-30)


@pytest.mark.parametrize("mode", ["forward", "backward"])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_dielectric_has_the_derivatives_of_a_conductor_without_absorption(backend, dtype, mode):
    import drjit as dr

    Float = float_type(backend, dtype)
    rng = np.random.default_rng(5)
    cos_theta, eta = rng.uniform(0.01, 1.0, 400), 10.0 ** rng.uniform(-1.5, 1.5, 400)
    eta[:10], cos_theta[10:20] = 1.0, 1.0
    points = [v.astype(dtype) for v in (cos_theta, eta)]
    for function, reference in ((dielectric, conductor), (_dielectric_T, transmittance)):
        for i in range(2):
            slopes = []
            for f, extra in ((function, ()), (reference, (0.0,))):
                arguments = [Float(v) for v in points]
                dr.enable_grad(arguments[i])
                value = f(*arguments, *extra)
                if mode == "forward":
                    dr.forward(arguments[i])
                    slopes.append(np.array(dr.grad(value)))
                else:
                    dr.backward(value)
                    slopes.append(np.array(dr.grad(arguments[i])))
            tolerance = GRADIENT[dtype]
            np.testing.assert_allclose(*slopes, rtol=tolerance, atol=1e-4 * tolerance)


def _dielectric_T(cos_theta, eta):
    return 1.0 - dielectric(cos_theta, eta)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_both_modes_agree_in_the_type_of_the_input(backend):
    import drjit as dr

    Float = float_type(backend)
    points = [v.astype(np.float32) for v in benign_points()]
    for function in (conductor, lambda *a, **o: reflectance_components(*a, **o)[3]):
        arguments = [Float(v) for v in points]
        dr.enable_grad(arguments)
        dr.backward(function(*arguments, precision="native"))
        backward = [np.array(dr.grad(a)) for a in arguments]
        for i in range(3):
            arguments = [Float(v) for v in points]
            dr.enable_grad(arguments[i])
            value = function(*arguments, precision="native")
            dr.forward(arguments[i])
            np.testing.assert_array_equal(np.array(dr.grad(value)), backward[i])


@pytest.mark.parametrize("backend", BACKENDS)
def test_half_precision(backend):
    """Computed in float32 or float64, whichever is asked for, and rounded to float16 at the end."""
    Half = importlib.import_module(float_type(backend).__module__)
    Half = getattr(Half, "ArrayXf16" if backend == "scalar" else "Float16")
    cos_theta, eta, k = (v.astype(np.float16) for v in benign_points())
    exact = conductor(*(v.astype(np.float64) for v in (cos_theta, eta, k)))
    for precision in ("wide", "native"):
        R = conductor(Half(cos_theta), Half(eta), Half(k), precision=precision)
        assert type(R) is Half
        for value in (np.array(R), conductor(cos_theta, eta, k, precision=precision)):
            assert value.dtype == np.float16
            assert (np.abs(value - exact) <= 0.51 * np.spacing(exact.astype(np.float16))).all()


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_derivatives_only_where_asked(backend):
    """A detached argument gets none; two attached ones get both; nesting obeys the chain rule."""
    import drjit as dr

    Float = float_type(backend, "float64")
    eta, k, x = Float(0.5), Float(2.0), Float(0.25)
    dr.enable_grad(k, x)
    R = conductor(dr.sqrt(x), eta, k)  # cos = .5, dcos/dx = 1
    assert not dr.grad_enabled(conductor(0.5, eta, 2.0))
    dr.backward(R)
    expected = np.mean(high_precision_gradient(0.5, 0.5, 2.0), axis=0)
    assert dr.grad(eta)[0] == 0.0
    assert float(dr.grad(x)[0]) == pytest.approx(expected[0], rel=1e-13)
    assert float(dr.grad(k)[0]) == pytest.approx(expected[2], rel=1e-13)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_refracted_cosine_gradients(backend):
    import drjit as dr

    Float = float_type(backend, "float64")
    for c, n, expected in (
        (0.5, 1.5, None),
        (0.9, 0.5, None),
        (0.1, 0.5, (0.0, 0.0)),  # beyond the critical angle
        (1.0, 1.5, None),
    ):
        if expected is None:  # cos_t² = 1 - (1 - c²)/n²
            cos_t = np.sqrt(1.0 - (1.0 - c * c) / (n * n))
            expected = (c / (n * n * cos_t), (1.0 - c * c) / (n**3 * cos_t))
        for i in range(2):
            arguments = [Float(c), Float(n)]
            dr.make_opaque(arguments)
            dr.enable_grad(arguments[i])
            dr.backward(refracted_cosine(*arguments))
            assert float(dr.grad(arguments[i])[0]) == pytest.approx(expected[i], rel=1e-13)


# --- bad input ----------------------------------------------------------------------------------

BAD_COSINES = np.array([-0.1, 1.1, np.inf, -np.inf, np.nan])
BAD_INDICES = [
    (np.nan, 0.0),
    (0.0, 1.0),
    (-1.0, 0.0),
    (np.inf, 0.0),
    (1.5, -1e-9),
    (1.5, np.inf),
    (1.5, np.nan),
]


WITHOUT_K = {"dielectric", "refracted_cosine"}
FUNCTIONS = pytest.mark.parametrize("name", calls())
EVERYWHERE = pytest.mark.parametrize("backend", ["numpy", *BACKENDS])


def array_type(backend, dtype="float32"):
    """What makes an array of that backend."""
    if backend == "numpy":
        return lambda values: np.array(values, dtype)
    return float_type(backend, dtype)


@FUNCTIONS
@EVERYWHERE
def test_bad_cosines_in_arrays(backend, name):
    Array, call = array_type(backend), calls()[name]
    found = call(Array(BAD_COSINES), 1.5, 0.0)
    clamped = call(Array([0.0, 1.0, 1.0, 0.0, 0.5]), 1.5, 0.0)
    for value, expected in zip(found, clamped, strict=True):
        value, expected = np.array(value), np.array(expected)
        np.testing.assert_array_equal(value[:4], expected[:4])
        assert np.isnan(value[4])


@FUNCTIONS
@pytest.mark.parametrize("precision", ["wide", "native"])
@EVERYWHERE
def test_bad_indices_in_arrays(backend, precision, name):
    Array, call = array_type(backend), calls()[name]
    eta, k = np.array([*BAD_INDICES, (1.5, 0.0)]).T
    bad = [True] * len(BAD_INDICES) + [False]
    if name in WITHOUT_K:  # nothing to object to in it
        bad = [not (0.0 < value < np.inf) for value in eta]
        assert bad == [True] * 4 + [False] * 4
    for value in call(Array([0.5] * len(eta)), Array(eta), Array(k), precision=precision):
        np.testing.assert_array_equal(np.isnan(np.array(value)), bad)


@pytest.mark.parametrize("scalar", [float, np.float32, np.array])
@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ((-0.1, 1.5, 0.0), "cos_theta=-0.1"),
        ((1.1, 1.5, 0.0), "cos_theta=1.1"),
        ((np.nan, 1.5, 0.0), "cos_theta=nan"),
        ((0.5, 0.0, 0.0), "eta=0"),
        ((0.5, -1.5, 0.0), "eta=-1.5"),
        ((0.5, np.inf, 0.0), "eta=inf"),
        ((0.5, 1.5, -1.0), "k=-1"),
        ((0.5, 1.5, np.inf), "k=inf"),
    ],
)
def test_bad_scalars(arguments, name, scalar):
    for call in (conductor, transmittance, polarized, reflectance_components):
        with pytest.raises(InputError, match=rf"^{name}; accepted: .+\. [A-Z].+\.$"):
            call(*(scalar(v) for v in arguments))
    if "k" not in name:
        for call in (dielectric, refracted_cosine):
            with pytest.raises(InputError, match=f"^{name};"):
                call(*(scalar(v) for v in arguments[:2]))


NO_NUMBERS = {
    "complex": 1.5 + 0.0j,
    "complex, NumPy": np.complex64(1.5),
    "truth": True,
    "truth, NumPy": np.bool_(True),
    "string": "1.5",
    "bytes": b"1.5",
    "nothing": None,
    "too large": 10**400,
    "ragged": [[1.5], [1.5, 1.6]],
}


@FUNCTIONS
@EVERYWHERE
@pytest.mark.parametrize("kind", NO_NUMBERS)
def test_what_is_no_real_number(kind, backend, name):
    """In the place of each argument, beside scalars and beside arrays."""
    call, wrong, Array = calls()[name], NO_NUMBERS[kind], array_type(backend)
    for place in range(2 if name in WITHOUT_K else 3):
        for others in ([0.5, 1.5, 0.0], [Array([v, v]) for v in (0.5, 1.5, 0.0)]):
            arguments = [*others[:place], wrong, *others[place + 1 :]]
            with pytest.raises(InputError, match=r"; accepted: real numbers\. [A-Z].+\.$"):
                call(*arguments)


@FUNCTIONS
@pytest.mark.parametrize("dtype", ["complex64", "bool", "U1", "object"])
def test_arrays_of_what_is_no_real_number(dtype, name):
    for place in range(2 if name in WITHOUT_K else 3):
        arguments = [0.5, 1.5, 0.0]
        arguments[place] = np.ones(3).astype(dtype)
        with pytest.raises(InputError, match=r"types .*; accepted: real numbers\. [A-Z].+\.$"):
            calls()[name](*arguments)


@FUNCTIONS
@EVERYWHERE
def test_shapes_that_do_not_broadcast(backend, name):
    Array, call = array_type(backend), calls()[name]
    with pytest.raises(InputError, match=r"shapes \(3,\), \(2,\).*; accepted: .*broadcast"):
        call(Array([0.5, 0.6, 0.7]), Array([1.5, 1.6]), 0.0)
    if name not in WITHOUT_K:
        with pytest.raises(InputError, match=r"shapes .*; accepted: .*broadcast"):
            call(0.5, Array([0.5, 0.6, 0.7]), Array([1.5, 1.6]))


def test_unknown_precision():
    with pytest.raises(InputError, match="precision='double' is unknown"):
        conductor(0.5, 1.5, 0.0, precision="double")


@pytest.mark.parametrize("backend", BACKENDS)
def test_bad_mixtures(backend):
    Float = float_type(backend)
    for other in (np.array([1.5]), [1.5, 1.6]):
        with pytest.raises(InputError, match=r"together with a Dr.Jit array"):
            conductor(Float(0.5), other, 0.0)
    with pytest.raises(InputError, match="eta=-1;"):
        conductor(Float(0.5), -1.0, 0.0)


@FUNCTIONS
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_drjit_arrays_of_what_is_no_real_number(backend, name):
    module = importlib.import_module(float_type(backend).__module__)
    wrong = [module.Int(1), module.UInt64(1), module.Bool(True), module.Array3i(1, 2, 3)]
    wrong += [module.Complex2f(1.5, 0.1), module.Quaternion4f(1.5), module.Matrix3f(1.5)]
    wrong += [module.TensorXi(np.ones((2, 2), np.int32))]
    for value in wrong:
        for place in range(2 if name in WITHOUT_K else 3):
            arguments = [0.5, 1.5, 0.0]
            arguments[place] = value
            message = rf"{NAMES[place]} of type {type(value).__name__}; accepted: a floating-point"
            with pytest.raises(InputError, match=message):
                calls()[name](*arguments)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_nested_drjit_arrays_that_do_not_broadcast(backend):
    module = importlib.import_module(float_type(backend).__module__)
    three, two = module.Float([0.5, 0.6, 0.7]), module.Float([1.5, 1.6])
    tensor = module.TensorXf(np.full((2, 3), 1.5, np.float32))
    for cos_theta, eta in (
        (three, module.Array3f(two, 1.0, 2.0)),
        (module.Array3f(0.5), module.Array2f(1.5)),
        (tensor, module.TensorXf(np.full((2, 2), 1.5, np.float32))),
    ):
        with pytest.raises(InputError, match="arrays of one backend whose shapes broadcast"):
            conductor(cos_theta, eta, 0.0)


TYPES = [("float32", "wide"), ("float32", "native"), ("float64", "wide")]
DECADES = {"float32": 37, "float64": 300}


def wide_range(dtype):
    """Random points over all magnitudes, special places included."""
    rng = np.random.default_rng(11)
    n = 20000
    decades = DECADES[dtype]
    cos_theta = 10.0 ** rng.uniform(-decades, 0, n)
    cos_theta[::3] = 1.0 - 10.0 ** rng.uniform(-16, 0, len(cos_theta[::3]))
    cos_theta[::7], cos_theta[::11] = 1.0, 0.0
    eta, k = 10.0 ** rng.uniform(-decades, decades, (2, n))
    eta[::17] = 1.0 + 10.0 ** rng.uniform(-16, 0, len(eta[::17]))
    eta[::13], k[::5] = 1.0, 0.0
    half = n // 2  # of ordinary magnitude
    eta[half:], k[half:] = (v[half:] ** (3.0 / decades) for v in (eta, k))
    return [v.astype(dtype) for v in (cos_theta, eta, k)]


@pytest.mark.parametrize(("dtype", "precision"), TYPES)
@pytest.mark.parametrize("backend", ["numpy", *BACKENDS])
def test_never_nan_nor_out_of_range(backend, dtype, precision):
    arguments = wide_range(dtype)
    if backend != "numpy":
        arguments = [float_type(backend, dtype)(v) for v in arguments]
    components = reflectance_components(*arguments, precision=precision)
    whole = conductor(*arguments, precision=precision)
    cos_t = refracted_cosine(*arguments[:2], precision=precision)
    other = transmittance(*arguments, precision=precision)
    lossless = dielectric(*arguments[:2], precision=precision)
    values = [np.array(v) for v in (*components, whole, other, cos_t, lossless)]
    for value in values:
        assert ((value >= 0.0) & (value <= 1.0)).all()
    R_s, R_p, T_s, T_p, R, T = values[:6]
    for reflected, transmitted in ((R_s, T_s), (R_p, T_p), (R, T)):
        total = reflected.astype(np.longdouble) + transmitted
        assert np.abs(total - 1.0).max() <= np.finfo(dtype).eps


@pytest.mark.parametrize(("dtype", "precision"), TYPES)
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_derivatives_are_never_nan(backend, dtype, precision):
    import drjit as dr

    Float = float_type(backend, dtype)
    points = wide_range(dtype)
    for i in range(3):
        arguments = [Float(v) for v in points]
        dr.enable_grad(arguments[i])
        R = conductor(*arguments, precision=precision)
        R_s, R_p, *_ = reflectance_components(*arguments, precision=precision)
        lossless = dielectric(*arguments[:2], precision=precision)
        dr.forward(arguments[i])
        for value in (R, R_s, R_p, lossless):
            assert not np.isnan(np.array(dr.grad(value))).any()


@pytest.mark.parametrize("backend", ["numpy", *BACKENDS])
def test_beyond_the_range_an_index_counts_as_its_end(backend):
    """A number in [0, 1] all the same."""

    def both(precision, dtype, eta, k):
        arguments = np.array([0.5, 1.0, 0.25], dtype), eta, k
        if backend != "numpy":
            arguments = float_type(backend, dtype)(arguments[0]), eta, k
        functions = conductor, transmittance
        return [np.array(f(*arguments, precision=precision)) for f in functions]

    for precision, dtype, limit in (("native", "float32", 2.0**20), ("wide", "float64", 2.0**160)):
        for huge in (2.0 * limit, float(np.finfo(dtype).max)):
            for point in ((huge, 0.0), (1.5, huge), (huge, huge), (0.5 / huge, 0.0)):
                end = [min(max(v, 1.0 / limit), limit) if v else v for v in point]
                found, expected = both(precision, dtype, *point), both(precision, dtype, *end)
                np.testing.assert_array_equal(found, expected)
                assert (found[0] > 0.9999).all()
                assert ((found[1] >= 0.0) & (found[1] < 1e-4)).all()
    found = transmittance(np.array([0.5]), 1e48, 0.0)
    assert found == pytest.approx(5e-48, rel=1e-12)
    assert transmittance(np.float32([0.5]), np.float32(1e38), 0.0) == pytest.approx(5e-38, rel=2e-7)


def test_package_exports_the_same_functions():
    from fresnel_decomp import fresnel

    for name in fresnel.__all__:
        assert getattr(fresnel_decomp, name) is getattr(fresnel, name)


def test_assumptions_of_the_strategies():
    """The composite strategy reaches both special angles and both sides of eta = 1."""
    seen = set()

    @property_test(max_examples=200)
    @given(points())
    def collect(point):
        assume(point[0] > 0.0)
        c, eta, k = map(float, point)
        seen.add(("below" if eta < 1.0 else "above", k == 0.0))
        if abs(c * np.sqrt(1.0 + eta * eta) - 1.0) < 1e-6:
            seen.add("brewster")
        if eta < 1.0 and abs(c * c - 1.0 + eta * eta) < 1e-6:
            seen.add("critical")

    collect()
    assert {"brewster", "critical"} < seen
    assert {("below", True), ("below", False), ("above", True), ("above", False)} < seen

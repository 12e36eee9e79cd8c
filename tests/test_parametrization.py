"""Reflectivity and edge tint, and reflectances at normal incidence and at 82 degrees."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import (
    InputError,
    f0_from_ior,
    f82_from_ior,
    gulbrandsen_to_ior,
    ior_to_gulbrandsen,
)
from oracles import central_difference, textbook

EPS = {"float32": 2.0**-23, "float64": 2.0**-52}


def published(r, g):
    """Gulbrandsen 2014, Eqs. 3-6, as printed."""
    n_min = (1.0 - r) / (1.0 + r)
    n_max = (1.0 + np.sqrt(r)) / (1.0 - np.sqrt(r))
    n = g * n_min + (1.0 - g) * n_max
    return n, np.sqrt((r * (n + 1.0) ** 2 - (n - 1.0) ** 2) / (1.0 - r))


def grid(dtype="float64"):
    r, g = np.meshgrid(np.linspace(0.01, 0.97, 49), np.linspace(0.0, 1.0, 41), indexing="ij")
    return r.astype(dtype), g.astype(dtype)


def test_published_equations():
    r, g = grid()
    r, g = r[:, 1:], g[:, 1:]  # at g = 0 the published k is the root of a rounding error
    n, k = published(r, g)
    ours = gulbrandsen_to_ior(r, g)
    np.testing.assert_allclose(ours[0], n, rtol=1e-13)
    np.testing.assert_allclose(ours[1], k, rtol=1e-11)


def test_meaning_of_the_parameters():
    r, g = grid()
    eta, k = gulbrandsen_to_ior(r, g)
    R_s, R_p = textbook(1.0, eta, k)
    np.testing.assert_allclose((R_s + R_p) / 2.0, r, rtol=1e-12)
    assert (k[:, 0] == 0.0).all()  # g = 0: a dielectric
    np.testing.assert_allclose(np.hypot(eta[:, -1], k[:, -1]), 1.0, rtol=1e-14)  # g = 1: |m| = 1
    np.testing.assert_array_equal(
        np.stack(gulbrandsen_to_ior(0.0, np.linspace(0, 1, 5))), [[1.0] * 5, [0.0] * 5]
    )
    assert np.hypot(eta, k).min() > 1.0 - 1e-14


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_round_trip(dtype):
    r, g = grid(dtype)
    eta, k = gulbrandsen_to_ior(r, g)
    r2, g2 = ior_to_gulbrandsen(eta, k)
    assert {a.dtype.name for a in (eta, k, r2, g2)} == {dtype}
    # r = |m - 1|² / |m + 1|²: a relative error of eta becomes one of r up to 1 / sqrt(r) as large
    assert (np.abs(r2 - r) <= (4.0 * r + 2.0 * np.sqrt(r)) * EPS[dtype]).all()
    # a relative error of eta becomes one of g of q times its size, q = (1 + rho)² / (1 - r) < 70
    np.testing.assert_allclose(g2, g, rtol=0.0, atol=30.0 * EPS[dtype])


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_round_trip_of_indices(dtype):
    """(eta, k) -> (r, g) -> (eta, k), with the documented loss as r nears 1."""
    eta, k = np.meshgrid(np.geomspace(0.05, 30.0, 60), np.geomspace(1e-6, 100.0, 60))
    keep = np.hypot(eta, k) >= 1.0001
    eta, k = eta[keep].astype(dtype), k[keep].astype(dtype)
    r, g = ior_to_gulbrandsen(eta, k)
    assert ((g >= 0.0) & (g <= 1.0)).all()
    eta2, k2 = gulbrandsen_to_ior(r, g)
    # r is rounded to eps, which is eps/(1 - r) of 1 - r; g near 1 likewise holds 1 - g
    r64, g64 = ior_to_gulbrandsen(eta.astype(np.float64), k.astype(np.float64))
    q = (1.0 + np.sqrt(r64)) ** 2 / (1.0 - r64)
    loss = EPS[dtype] * (1.0 / (1.0 - r64) + q / eta)
    assert (np.abs(eta2 / eta - 1.0) / loss).max() < 8.0
    # k ~ sqrt(1 + (1 - g) q²), whose relative slope wrt g is q² / (1 + (1 - g) q²)
    loss_k = EPS[dtype] * (1.0 / (1.0 - r64) + q**2 / (1.0 + (1.0 - g64) * q**2))
    assert (np.abs(k2 / k - 1.0) / loss_k).max() < 8.0


def test_loss_near_a_perfect_mirror_is_as_documented():
    """One digit of eta for each digit of 1 - r."""
    for exponent in (1, 2, 3, 4, 5):
        r = np.float32(1.0 - 10.0**-exponent)
        eta, k = gulbrandsen_to_ior(r, np.float32(0.5))
        exact_eta, exact_k = gulbrandsen_to_ior(1.0 - 10.0**-exponent, 0.5)
        lost = max(abs(eta / exact_eta - 1.0), abs(k / exact_k - 1.0))
        assert 1e-10 < lost < 1.2e-7 * 10.0**exponent


property_test = settings(max_examples=300, derandomize=True, deadline=None, database=None)


@property_test
@given(
    st.floats(0.0, 1.0, exclude_max=True, width=32),
    st.floats(0.0, 1.0, width=32, allow_subnormal=False),
)
@example(0.5, 1.1754943508222875e-38)
@example(0.9999999403953552, 0.0)
@example(1.401298464324817e-45, 1.0)
def test_whole_domain_is_finite_and_accurate_in_float32(r, g):
    eta, k = gulbrandsen_to_ior(np.float32(r), np.float32(g))
    exact_eta, exact_k = gulbrandsen_to_ior(r, g)
    assert np.isfinite([eta, k]).all()
    assert eta > 0.0
    assert k >= 0.0
    assert eta == pytest.approx(exact_eta, rel=2e-6)
    assert k == pytest.approx(exact_k, rel=2e-6, abs=1e-38)


def test_the_published_form_fails_where_ours_does_not():
    """g -> 0: why the rearrangement exists."""
    rng = np.random.default_rng(3)
    r = rng.uniform(0.01, 0.99, 2000).astype(np.float32)
    g = (10.0 ** rng.uniform(-12, -7, 2000)).astype(np.float32)
    with np.errstate(invalid="ignore"):
        assert np.isnan(published(r, g)[1]).mean() > 0.05
    assert np.isfinite(gulbrandsen_to_ior(r, g)).all()


def test_limits_of_the_inverse():
    assert ior_to_gulbrandsen(1.0, 0.0) == (0.0, 0.0)
    assert ior_to_gulbrandsen(1.5, 0.0) == (pytest.approx(0.04), 0.0)
    r, g = ior_to_gulbrandsen(1.5, 1e-9)
    assert 0.0 < g < 1e-16
    assert ior_to_gulbrandsen(0.6, 0.8)[1] == pytest.approx(1.0, rel=1e-15)  # |m| = 1
    assert ior_to_gulbrandsen(0.3, 0.5)[1] > 1.0  # |m| < 1 has no counterpart
    eta, k = np.array([0.3, 0.9]), np.array([0.5, 0.1])
    r, g = ior_to_gulbrandsen(eta, k)
    assert (g > 1.0).all()
    np.testing.assert_allclose(r, f0_from_ior(eta, k), rtol=1e-15)


def test_reflectances():
    eta, k = np.array([0.2, 1.5, 1.0]), np.array([3.0, 0.0, 2.0])
    expected = ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)
    np.testing.assert_allclose(f0_from_ior(eta, k), expected, rtol=1e-14)
    np.testing.assert_allclose(
        f82_from_ior(eta, k), np.mean(textbook(1.0 / 7.0, eta, k), axis=0), rtol=1e-13
    )


def test_kinds():
    for function, a, b in (
        (gulbrandsen_to_ior, 0.5, 0.25),
        (ior_to_gulbrandsen, 1.5, 2.0),
    ):
        assert [type(v) for v in function(a, b)] == [float, float]
        assert [type(v) for v in function(np.float32(a), b)] == [np.float32] * 2
        assert [type(v) for v in function(np.float64(a), b)] == [np.float64] * 2
        for result in function(np.full((2, 1), a, np.float32), np.full(3, b, np.float32)):
            assert (result.dtype, result.shape) == (np.float32, (2, 3))
        for result in function([a, a], b):
            assert (result.dtype, result.shape) == (np.float64, (2,))
        for result in function(np.full(2, a, np.float32), np.full(2, b)):
            assert result.dtype == np.float64
    assert gulbrandsen_to_ior(0, 1) == (1.0, 0.0)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_drjit_equals_numpy(backend, dtype):
    Float = float_type(backend, dtype)
    r, g = (v.ravel() for v in grid(dtype))
    eta, k = gulbrandsen_to_ior(r, g)
    found = gulbrandsen_to_ior(Float(r), Float(g))
    assert [type(v) for v in found] == [Float, Float]
    for a, b in zip(found, (eta, k), strict=True):
        np.testing.assert_allclose(np.array(a), b, rtol=8.0 * EPS[dtype])
    found = ior_to_gulbrandsen(Float(eta), Float(k))
    assert [type(v) for v in found] == [Float, Float]
    for a, b in zip(found, ior_to_gulbrandsen(eta, k), strict=True):
        np.testing.assert_allclose(np.array(a), b, rtol=50.0 * EPS[dtype], atol=1e-30)
    mixed = gulbrandsen_to_ior(np.float64(0.5), Float(g))
    assert type(mixed[0]) is Float


@pytest.mark.parametrize("mode", ["forward", "backward"])
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradients(backend, mode):
    import drjit as dr

    Float = float_type(backend, "float64")
    r, g = np.array([0.05, 0.5, 0.9, 0.3]), np.array([0.2, 0.5, 0.9, 0.999])
    eta, k = gulbrandsen_to_ior(r, g)
    for function, arguments in ((gulbrandsen_to_ior, (r, g)), (ior_to_gulbrandsen, (eta, k))):
        for i in range(2):
            for j in range(2):

                def along(x, function=function, arguments=arguments, i=i, j=j):
                    return function(*arguments[:i], x, *arguments[i + 1 :])[j]

                expected = central_difference(along, arguments[i], 1e-4 * arguments[i])
                jit = [Float(a) for a in arguments]
                dr.enable_grad(jit[i])
                result = function(*jit)[j]
                if mode == "forward":
                    dr.forward(jit[i])
                    found = np.array(dr.grad(result))
                else:
                    dr.backward(result)
                    found = np.array(dr.grad(jit[i]))
                np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


def test_bad_input():
    with pytest.raises(InputError, match=r"r=1; accepted: a number in \[0, 1\)\. A reflectivity"):
        gulbrandsen_to_ior(1.0, 0.5)
    for r, g, name in ((-0.1, 0.5, "r=-0.1"), (0.5, 1.5, "g=1.5"), (np.nan, 0.5, "r=nan")):
        with pytest.raises(InputError, match=rf"^{name}; accepted: a number in .*\. .*fractions\."):
            gulbrandsen_to_ior(r, g)
    for eta, k in ((0.0, 1.0), (1.5, -1.0), (np.nan, 0.0)):
        with pytest.raises(InputError, match="accepted"):
            ior_to_gulbrandsen(eta, k)
    with pytest.raises(InputError, match="r and g of shapes"):
        gulbrandsen_to_ior(np.zeros(2), np.zeros(3))
    with pytest.raises(InputError, match="real numbers"):
        gulbrandsen_to_ior(np.zeros(2, complex), np.zeros(2))
    r = np.array([0.5, 1.0, -0.1, np.nan, 0.5, 0.5])
    g = np.array([0.5, 0.5, 0.5, 0.5, 1.1, np.nan])
    for value in gulbrandsen_to_ior(r, g):
        np.testing.assert_array_equal(np.isnan(value), [False] + [True] * 5)
    for value in ior_to_gulbrandsen(np.array([1.5, 0.0, np.nan]), np.array([1.0, 1.0, 1.0])):
        np.testing.assert_array_equal(np.isnan(value), [False, True, True])


@pytest.mark.parametrize("backend", BACKENDS)
def test_bad_drjit_entries(backend):
    Float = float_type(backend)
    for value in gulbrandsen_to_ior(Float([0.5, 1.0, -0.1, np.nan]), Float(0.5)):
        np.testing.assert_array_equal(np.isnan(np.array(value)), [False, True, True, True])
    with pytest.raises(InputError, match=r"together with a Dr.Jit array"):
        gulbrandsen_to_ior(Float(0.5), np.array([0.5]))
    with pytest.raises(InputError, match="g=2;"):
        gulbrandsen_to_ior(Float(0.5), 2.0)

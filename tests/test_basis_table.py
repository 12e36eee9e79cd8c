"""Tabulated basis functions: errors, limits, NumPy, Dr.Jit and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import BasisTable, InputError, load_basis
from fresnel_decomp.basis_table import WARPS

DENSE = np.concatenate([np.linspace(0.0, 1.0, 20001), np.geomspace(1e-9, 1.0, 5001)])
STORAGES = ["float32", "float16"]


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("warp", WARPS)
def test_error_is_what_it_says(warp, storage):
    basis = load_basis()
    for size in (2, 33, 256):
        table = basis.table(size, warp, storage)
        error = np.abs(table(DENSE) - basis(DENSE)).max()
        assert error <= 1.02 * table.error + 1e-7
        assert error >= 0.9 * table.error
        assert table.nbytes == size * 3 * {"float32": 4, "float16": 2}[storage]
        ends = table(np.array([0.0, 1.0]))
        np.testing.assert_allclose(ends, [[1, 1, 0, 0], [1, 0, 0, 0]], atol=1e-12)  # as the series


@pytest.mark.parametrize("terms", [3, 4, 5, 6])
def test_error_falls_with_the_square_of_the_step(terms):
    basis = load_basis("talk", terms)
    for warp in WARPS:
        coarse, fine = (basis.table(size, warp).error for size in (129, 257))
        assert 3.0 < coarse / fine < 5.0


def test_warps_save_samples():
    """How many samples reach 1e-4: what the module claims."""
    basis = load_basis("notebook")
    sizes = {}
    for warp in WARPS:
        sizes[warp] = next(n for n in range(250, 2001, 25) if basis.table(n, warp).error <= 1e-4)
    assert sizes["sqrt"] < 0.3 * sizes["cos"]


def test_clamping_and_nan():
    table = load_basis().table(64)
    values = table(np.array([-0.5, 0.0, 1.0, 1.5, np.inf, -np.inf, np.nan]))
    np.testing.assert_array_equal(values[[0, 5]], values[[1, 1]])
    np.testing.assert_array_equal(values[[3, 4]], values[[2, 2]])
    assert np.isnan(values[6, 1:]).all()
    assert table(np.zeros((3, 2))).shape == (3, 2, 4)


def test_evaluate_is_the_sum():
    basis = load_basis()
    table, c = basis.table(512), basis.coefficients([0.2, 1.5], [3.9, 0.0])
    cos_theta = np.linspace(0.0, 1.0, 11)
    F = table.evaluate(c[:, None], cos_theta)
    np.testing.assert_allclose(F, (c[:, None] * table(cos_theta)).sum(axis=-1), atol=1e-15)
    np.testing.assert_allclose(F, basis.evaluate(c[:, None], cos_theta), atol=1e-4)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("warp", WARPS)
@pytest.mark.parametrize("backend", BACKENDS)
def test_drjit_equals_numpy(backend, warp, storage, dtype):
    Float = float_type(backend, dtype)
    table = load_basis().table(128, warp, storage)
    cos_theta = np.append(np.linspace(-0.1, 1.1, 61), [0.0, 1e-30, 1.0, 1e-7, np.nan]).astype(dtype)
    expected = table(cos_theta)
    assert expected.dtype == dtype
    found = table(Float(cos_theta))
    assert [type(f) for f in found] == [Float] * 4
    for a, b in zip(found, expected.T, strict=True):
        np.testing.assert_allclose(np.array(a), b, atol=3e-6 if dtype == "float32" else 1e-12)
    F = table.evaluate([Float(0.5), Float(0.5), Float(-0.1), Float(0.1)], Float(cos_theta))
    np.testing.assert_allclose(
        np.array(F), expected @ np.array([0.5, 0.5, -0.1, 0.1]), atol=3e-6, equal_nan=True
    )


@pytest.mark.parametrize("mode", ["forward", "backward"])
@pytest.mark.parametrize("warp", WARPS)
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_derivatives(backend, warp, mode):
    """Those of the functions, to the accuracy of the table, finite at cos = 0 in every warp."""
    import drjit as dr

    Float = float_type(backend, "float64")
    basis = load_basis()
    table = basis.table(2048, warp)
    cos_theta = np.array([0.0, 1e-9, 0.01, 0.3, 0.9, 1.0])
    step = 1e-5
    inside = np.clip(cos_theta, step, 1.0 - step)
    expected = (basis(inside + step) - basis(inside - step)) / (2.0 * step)
    for i in range(1, 4):
        x = Float(cos_theta)
        dr.enable_grad(x)
        value = table(x)[i]
        if mode == "forward":
            dr.forward(x)
            found = np.array(dr.grad(value))
        else:
            dr.backward(value)
            found = np.array(dr.grad(x))
        np.testing.assert_allclose(found, expected[:, i], atol=0.03, rtol=0.03)


def test_colours(variant):
    import mitsuba as mi

    if variant.startswith("scalar"):
        pytest.skip("a colour of plain floats is not an array of arrays")
    table = load_basis().table(128)
    colour = mi.Color3f([0.1, 0.2], [0.5, 0.6], [0.9, 1.0])
    found = table(colour)
    assert type(found[2]) is mi.Color3f
    np.testing.assert_allclose(np.array(found[2]), table(np.array(colour))[..., 2], atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1,), "size=1"),
        ((64, "log"), "warp='log' is unknown"),
        ((64, "cos", "float8"), "storage='float8' is unknown"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(InputError, match=message):
        load_basis().table(*arguments)
    with pytest.raises(InputError, match="shape"):
        load_basis().table(64).evaluate(np.zeros(3), 0.5)


def test_a_table_cannot_be_changed():
    table = load_basis().table(64)
    assert isinstance(table, BasisTable)
    with pytest.raises(ValueError, match="read-only"):
        table.samples[0, 0] = 1.0

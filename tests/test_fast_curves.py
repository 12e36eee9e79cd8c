"""Tabulated curves of inner loops: values, slopes, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import InputError, directional_albedo, load_basis
from fresnel_decomp.fast_curves import FastCurves

BASIS = load_basis()
COSINES = np.concatenate([[0.0, 1e-12, 1e-8, 1e-4], np.linspace(0.01, 1.0, 500)])


def test_values():
    """Of six functions the sixth errs most, by 1.0e-6 in the middle of intervals (talk)."""
    basis = load_basis("talk", 6)
    curves = FastCurves.of(basis)
    cosines = np.linspace(0.0, 1.0, 8 * 4096 + 1) ** 2
    error = np.abs(curves(cosines) - basis(cosines)).max()
    assert 1e-7 < error <= 1.2e-6
    assert curves(0.3).shape == (6,)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_drjit_agrees(backend, precision):
    kind = float_type(backend, precision)
    curves = FastCurves.of(BASIS).on(kind)
    result = np.stack([np.array(v) for v in curves(kind(COSINES.tolist()))], axis=-1)
    # float32 rounds the position among 4096 intervals, and slopes are up to 10 in the root
    tolerance = 1e-6 if precision == "float32" else 1e-12
    np.testing.assert_allclose(result, FastCurves.of(BASIS)(COSINES), atol=tolerance)
    np.testing.assert_array_equal(curves(COSINES), FastCurves.of(BASIS)(COSINES))  # NumPy as before


@pytest.mark.parametrize("backend", AD_BACKENDS)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_slopes(backend, precision):
    """Finite at 0, and those of the functions: forward and backward."""
    import drjit as dr

    kind = float_type(backend, precision)
    curves = FastCurves.of(BASIS).on(kind)
    cosines = np.array([0.0, 1e-10, 0.005, 0.2, 0.7, 0.99])
    h = 1e-6
    low, high = np.maximum(cosines - h, 0.0), cosines + h
    expected = (BASIS(high) - BASIS(low)) / (high - low)[:, None]
    for i in range(4):
        c = kind(cosines)
        dr.enable_grad(c)
        dr.backward(curves(c)[i])
        backward = np.array(c.grad)
        c = kind(cosines)
        dr.enable_grad(c)
        dr.set_grad(c, 1.0)
        forward = np.array(dr.forward_to(curves(c)[i]))
        np.testing.assert_allclose(forward, backward, rtol=1e-6)
        np.testing.assert_allclose(backward, expected[:, i], rtol=5e-3, atol=5e-3)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_albedo_of_them_has_gradients(backend):
    """In a recorded loop too; not at mu = 1, where they depend on curvature: chords have none."""
    import drjit as dr

    kind = float_type(backend, "float64")
    curves = FastCurves.of(BASIS).on(kind)
    gradients = []
    for f in (curves, BASIS):
        mu = kind([0.0, 0.1, 0.7, 0.99])
        dr.enable_grad(mu)
        dr.backward(directional_albedo(f, mu, 0.3)[2])
        gradients.append(np.array(mu.grad))
    np.testing.assert_allclose(*gradients, atol=2e-3)


@pytest.mark.parametrize("backend", BACKENDS)
def test_refuses_drjit_without_memory_there(backend):
    kind = float_type(backend)
    with pytest.raises(InputError, match=r"curves\.on\("):
        FastCurves.of(BASIS)(kind([0.5]))

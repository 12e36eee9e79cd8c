"""Rational closed forms: accuracy, poles, ends, float32, Dr.Jit."""

from __future__ import annotations

import numpy as np
import pytest

from backends import BACKENDS, float_type
from fresnel_decomp import ClosedForm, InputError, load_basis
from fresnel_decomp.closed_form import fit_closed_form
from fresnel_decomp.recipes import RECIPES

SHIPPED = [(recipe, terms) for recipe in RECIPES for terms in (3, 4, 5, 6)]
DENSE = np.concatenate([np.linspace(0.0, 1.0, 20001), np.geomspace(1e-9, 1.0, 5001)])


@pytest.mark.parametrize(("recipe", "terms"), SHIPPED)
def test_shipped_forms(recipe, terms):
    basis = load_basis(recipe, terms)
    form = basis.closed_form
    assert form.terms == terms
    error = np.abs(form(DENSE) - basis(DENSE)).max()
    assert error <= 2e-4
    # and it says so; a regression is its closed form, to rounding and the length of the series
    assert error == pytest.approx(form.error, rel=0.02, abs=1e-11)
    # Q > 0: no real root on [0, 1], and 1 at 0
    roots = np.polynomial.Polynomial(form.denominator).roots()
    real = roots[np.abs(roots.imag) < 1e-9].real
    assert not np.any((real > -1e-3) & (real < 1.0 + 1e-3))
    assert np.polynomial.Polynomial(form.denominator)(DENSE).min() > 0.5
    ends = form(np.array([0.0, 1.0]))
    np.testing.assert_array_equal(ends, [[1, 1, *[0] * (terms - 2)], [1, *[0] * (terms - 1)]])


@pytest.mark.parametrize(("recipe", "terms"), SHIPPED)
def test_float32(recipe, terms):
    """What shaders evaluate: rounding stays far below the fit's own error."""
    form = load_basis(recipe, terms).closed_form
    cos_theta = DENSE.astype(np.float32)
    single = form(cos_theta)
    assert single.dtype == np.float32
    assert np.abs(single - form(cos_theta.astype(np.float64))).max() <= 5e-6
    c = np.array([0.9, 0.1, -0.2, 0.15, 0.05, -0.02][:terms])
    single = form.evaluate(c.astype(np.float32), cos_theta)
    assert single.dtype == np.float32
    assert np.abs(single - form.evaluate(c, cos_theta.astype(np.float64))).max() <= 2e-6


def test_evaluate_is_the_sum():
    form = load_basis().closed_form
    c = np.random.default_rng(1).normal(size=(3, 1, 4))
    cos_theta = np.linspace(0.0, 1.0, 17)
    expected = (c * form(cos_theta)).sum(axis=-1)
    assert expected.shape == (3, 17)
    np.testing.assert_allclose(form.evaluate(c, cos_theta), expected, atol=1e-14)
    assert form.evaluate([0.04, 0.96, 0.0, 0.0], 1.0) == 0.04
    assert form.evaluate([0.04, 0.96, 0.5, 0.5], 0.0) == 1.0


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_drjit_equals_numpy(backend, dtype):
    Float = float_type(backend, dtype)
    form = load_basis("notebook", 5).closed_form
    cos_theta = np.linspace(0.0, 1.0, 101).astype(dtype)
    tolerance = 1e-5 if dtype == "float32" else 1e-13
    functions = form(Float(cos_theta))
    assert [type(f) for f in functions] == [Float] * 5
    for found, expected in zip(functions, form(cos_theta).T, strict=True):
        np.testing.assert_allclose(np.array(found), expected, atol=tolerance)
    c = np.array([0.3, 0.7, 0.1, -0.1, 0.05])
    expected = form.evaluate(c, cos_theta)
    for coefficients in (c, c.tolist(), [Float(v) for v in c]):
        found = form.evaluate(coefficients, Float(cos_theta))
        assert type(found) is Float
        np.testing.assert_allclose(np.array(found), expected, atol=tolerance)


def test_a_rational_is_recovered():
    def functions(c):
        q = (1.0 + c / 0.3) * (1.0 + 0.5 * c + 2.0 * c * c)
        numerators = [1.0 + 0.2 * c, 3.0 * c, -2.0 * c + c * c]
        return np.stack([(1.0 - c) * n / q for n in numerators], axis=-1)

    form = fit_closed_form(functions, tolerance=1e-6)
    assert len(form.denominator) <= 4
    np.testing.assert_allclose(form(DENSE)[:, 1:], functions(DENSE), atol=1.01e-6)
    assert form.error <= 1e-6


def test_tolerance_buys_a_cheaper_form():
    basis = load_basis()

    def functions(c):
        return basis(c)[:, 1:]

    loose = fit_closed_form(functions, tolerance=2e-3)
    assert loose.numerators.size < basis.closed_form.numerators.size
    assert np.abs(loose(DENSE) - basis(DENSE)).max() <= 2.05e-3


@pytest.mark.slow
def test_no_smooth_form():
    def kinked(c):
        return np.stack([1.0 - c, np.minimum(c, 1.0 - c)], axis=-1)

    with pytest.raises(InputError, match=r"no rational form within 0\.0001.*accepted: .*smooth"):
        fit_closed_form(kinked)


def test_a_form_is_three_arrays():
    form = ClosedForm(np.array([[1.0]]), np.array([1.0]), 0.0)
    np.testing.assert_allclose(form(np.array([0.0, 0.25, 1.0])), [[1, 1], [1, 0.75], [1, 0]])
    assert form(0.25).tolist() == [1.0, 0.75]

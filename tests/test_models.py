"""Every model of Fresnel reflectance: formulas, limits, errors, kinds of input."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import (
    F82,
    Decomposition,
    Exact,
    Gulbrandsen,
    InputError,
    Lazanyi,
    Schlick,
    conductor,
    curves,
    f0_from_ior,
    load_basis,
    model_from_ior,
)
from fresnel_decomp.models import MODELS
from oracles import textbook

ETA, K = np.array([1.5, 0.2, 2.4, 0.9]), np.array([0.0, 3.4, 0.5, 2.0])
COSINES = np.linspace(0.0, 1.0, 101)


def exact(cos_theta, eta, k):
    return np.mean(textbook(cos_theta, eta, k), axis=0)


# --- formulas ----------------------------------------------------------------------------------


def test_schlick():
    assert Schlick(0.04)(1.0) == 0.04
    assert Schlick(0.04)(0.0) == 1.0
    assert Schlick(0.04)(0.5) == pytest.approx(0.04 + 0.96 / 32)
    np.testing.assert_allclose(Schlick.from_ior(ETA, K).f0, exact(1.0, ETA, K), rtol=1e-14)
    # Lazanyi and Szirmay-Kalos write their base form with eta and k
    x5 = (1.0 - COSINES) ** 5
    for eta, k in zip(ETA, K, strict=True):
        theirs = ((eta - 1) ** 2 + 4 * eta * x5 + k**2) / ((eta + 1) ** 2 + k**2)
        np.testing.assert_allclose(Schlick.from_ior(eta, k)(COSINES), theirs, atol=1e-15)
        np.testing.assert_allclose(Lazanyi(f0_from_ior(eta, k))(COSINES), theirs, atol=1e-15)


def test_f82():
    model = F82.from_ior(ETA, K)
    np.testing.assert_allclose(model(1.0 / 7.0), exact(1.0 / 7.0, ETA, K), rtol=1e-14)
    np.testing.assert_allclose(model(1.0), exact(1.0, ETA, K), rtol=1e-14)
    np.testing.assert_array_equal(model(0.0), 1.0)
    again = F82.from_tint(model.f0, model.tint)
    np.testing.assert_allclose(again.f82, model.f82, rtol=1e-15)
    np.testing.assert_array_equal(F82.from_tint(0.3, 1.0)(COSINES), Schlick(0.3)(COSINES))
    # as OpenPBR states it: the tint scales Schlick's value at 82 degrees
    f0, tint = 0.7, 0.4
    schlick82 = f0 + (1 - f0) * (6 / 7) ** 5
    b = (schlick82 - tint * schlick82) / ((1 / 7) * (6 / 7) ** 6)
    expected = f0 + (1 - f0) * (1 - COSINES) ** 5 - b * COSINES * (1 - COSINES) ** 6
    np.testing.assert_allclose(F82.from_tint(f0, tint)(COSINES), expected, atol=1e-15)


def test_lazanyi_corrects_where_schlick_errs_most():
    fine = np.linspace(0.0, 0.5, 4097)
    for eta, k in zip(ETA, K, strict=True):
        model = Lazanyi.from_ior(eta, k)
        schlick = Schlick.from_ior(eta, k)(fine) - exact(fine, eta, k)
        worst = fine[np.argmax(np.abs(schlick))]
        correction = Schlick.from_ior(eta, k)(fine) - model(fine)
        assert fine[np.argmax(np.abs(correction))] == pytest.approx(worst, abs=1e-3)
        assert 1.0 / (model.exponent + 1.0) == pytest.approx(worst, abs=1e-3)
        peak = np.argmin(np.abs(fine - 1.0 / (model.exponent + 1.0)))
        assert correction[peak] == pytest.approx(schlick[peak], abs=1e-5)
        assert np.abs(model(fine) - exact(fine, eta, k)).max() < 0.6 * np.abs(schlick).max()
        cos, a, e = 0.3, model.a, model.exponent
        formula = Schlick(model.f0)(cos) - a * cos * (1 - cos) ** e
        assert model(cos) == pytest.approx(formula, rel=1e-14)


def test_lazanyi_of_nothing():
    model = Lazanyi.from_ior(1.0, 0.0)
    assert np.isfinite(model(COSINES)).all()
    assert (model(1.0), model(0.0)) == (0.0, 1.0)


def test_gulbrandsen():
    model = Gulbrandsen.from_ior(ETA, K)
    np.testing.assert_allclose(model(COSINES[:, None]), exact(COSINES[:, None], ETA, K), rtol=1e-11)
    np.testing.assert_allclose(Gulbrandsen(0.25, 0.5)(1.0), 0.25, rtol=1e-14)
    # |m| < 1 has no counterpart: F0 is kept, and the edge tint is the largest there is
    low = Gulbrandsen.from_ior(0.3, 0.5)
    assert low.g == 1.0
    assert low(1.0) == pytest.approx(exact(1.0, 0.3, 0.5), rel=1e-12)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gulbrandsen_gradient_at_the_dielectric(backend):
    """dR/dg is finite as g -> 0, where k grows like its square root."""
    import drjit as dr

    Float = float_type(backend, "float64")
    r, cos_theta, h = 0.3, 0.2, 1e-6
    plain = [float(Gulbrandsen(r, g)(cos_theta)) for g in (0.0, h, 2.0 * h)]
    expected = (4.0 * plain[1] - 3.0 * plain[0] - plain[2]) / (2.0 * h)
    for start in (1e-18, 1e-12):
        g = Float(start)
        dr.enable_grad(g)
        dr.backward(Gulbrandsen(r, g)(cos_theta))
        assert float(dr.grad(g)[0]) == pytest.approx(expected, rel=1e-5)


def test_exact():
    model = Exact.from_ior(ETA, K)
    np.testing.assert_array_equal(model(0.3), conductor(0.3, ETA, K))
    native = Exact(np.float32(0.2), np.float32(3.4), precision="native")(np.float32(0.3))
    assert native == conductor(
        np.float32(0.3), np.float32(0.2), np.float32(3.4), precision="native"
    )
    assert Exact(1.5)(1.0) == pytest.approx(0.04)


def test_decomposition():
    basis = load_basis("notebook", 5)
    model = Decomposition.from_ior(ETA, K, basis)
    assert model.basis is basis
    np.testing.assert_array_equal(model.coefficients, basis.coefficients(ETA, K))
    F = model(COSINES[:, None])
    assert F.shape == (101, 4)
    np.testing.assert_allclose(F, basis(COSINES) @ model.coefficients.T, atol=1e-14)
    assert Decomposition.from_ior(1.5, 0.0).basis is load_basis()


# --- errors on the reference sets ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("make_set", "expected"),
    [
        (
            curves.dielectrics,
            {Schlick: (0.550, 0.046), F82: (0.250, 0.018), Lazanyi: (0.119, 0.011)},
        ),
        (curves.gulbrandsen_grid, {Schlick: (0.315, 0.073), F82: (0.140, 0.025)}),
        pytest.param(
            curves.measured_metals,
            {Schlick: (0.338, 0.066), F82: (0.110, 0.012)},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_errors_on_reference_sets(make_set, expected):
    """Maximum, and RMSE over the uniform cosines and all curves."""
    members = make_set()
    everywhere, uniform = curves.error_cosines()
    largest, squares = dict.fromkeys(expected, 0.0), dict.fromkeys(expected, 0.0)
    for start in range(0, len(members), 400):
        eta, k = (v[start : start + 400, None] for v in (members.eta, members.k))
        reference = conductor(everywhere, eta, k)
        for model in expected:
            error = np.abs(model.from_ior(eta, k)(everywhere) - reference)
            largest[model] = max(largest[model], float(error.max()))
            squares[model] += float((error[:, : len(uniform)] ** 2).mean(axis=1).sum())
    for model, (maximum, rmse) in expected.items():
        assert round(largest[model], 3) == maximum
        assert round(np.sqrt(squares[model] / len(members)), 3) == rmse


# --- total internal reflection ------------------------------------------------------------------


def test_poor_fits_are_refused_or_kept():
    with pytest.raises(InputError, match=r"total internal reflection.*poor_fit='substitute'"):
        Decomposition.from_ior(0.7, 0.0)
    assert Decomposition.from_ior(0.7, 0.0, poor_fit="keep").substitute is None
    with pytest.raises(InputError, match="poor_fit='none' is unknown"):
        Decomposition.from_ior(0.7, 0.0, poor_fit="none")


@pytest.mark.parametrize("recipe", ["talk", "notebook"])
def test_substitution_by_reciprocity(recipe):
    """R(eta, theta) = R(1/eta, theta_t): the error is that of 1/eta, at another angle."""
    basis = load_basis(recipe)
    for eta in (0.4, 0.7, 0.95):
        model = Decomposition.from_ior(eta, 0.0, basis, poor_fit="substitute")
        F = model(COSINES)
        critical = np.sqrt(1.0 - eta**2)
        assert (F[critical >= COSINES] == 1.0).all()
        bound = float(basis.error(1.0 / eta, 0.0).max) + 1e-9
        assert np.abs(F - exact(COSINES, eta, 0.0)).max() <= bound
        assert np.abs(F - exact(COSINES, eta, 0.0)).max() < 0.1
        assert model(1.0) == pytest.approx(exact(1.0, eta, 0.0), abs=1e-6)


def test_substitution_by_the_exact_equations():
    eta, k = np.array([0.7, 0.3, 0.5, 1.5]), np.array([1e-4, 0.02, 0.0, 0.0])
    model = Decomposition.from_ior(eta, k, poor_fit="substitute")
    F = model(COSINES[:, None])
    assert F.shape == (101, 4)
    np.testing.assert_array_equal(F[:, :2], conductor(COSINES[:, None], eta[:2], k[:2]))
    np.testing.assert_allclose(F[:, 3], Decomposition.from_ior(1.5, 0.0)(COSINES), rtol=1e-14)
    single = Decomposition.from_ior(0.5, 0.0, poor_fit="substitute")(COSINES)
    np.testing.assert_allclose(F[:, 2], single, rtol=1e-14)
    assert isinstance(Decomposition.from_ior(0.5, 0.0, poor_fit="substitute")(0.9), float)
    # nothing to substitute
    assert Decomposition.from_ior(ETA, K, poor_fit="substitute").substitute is None


@pytest.mark.parametrize("backend", BACKENDS)
def test_substitution_is_for_numpy(backend):
    Float = float_type(backend)
    with pytest.raises(InputError, match=r"substitute' with Dr.Jit arrays.*Use Exact"):
        Decomposition.from_ior(Float(0.5), 0.0, poor_fit="substitute")
    model = Decomposition.from_ior(0.5, 0.0, poor_fit="substitute")
    with pytest.raises(InputError, match=r"Dr.Jit cosines.*Use Exact"):
        model(Float(0.5))


# --- the interface ------------------------------------------------------------------------------


def test_clamping_is_opt_in():
    eta, k, cos_theta = 1.01, 0.0, np.linspace(0.0, 1.0, 2001)
    free = Decomposition.from_ior(eta, k)
    clamped = Decomposition.from_ior(eta, k, clamp=True)
    F, exact = free(cos_theta), conductor(cos_theta, eta, k)
    assert F.min() < -1e-3  # or there would be nothing to clamp
    np.testing.assert_array_equal(clamped(cos_theta), np.clip(F, 0.0, 1.0))
    assert (np.abs(clamped(cos_theta) - exact) <= np.abs(F - exact)).all()
    assert type(clamped(0.2)) is float
    assert clamped(float(cos_theta[F.argmin()])) == 0.0
    above = Decomposition(np.array([1.022, -0.022, -0.026, -0.013]), load_basis(), clamp=True)
    assert above(1.0) == 1.0
    assert np.isnan(Decomposition(np.full(4, np.nan), load_basis(), clamp=True)(0.5))
    substituted = Decomposition.from_ior(0.6, 0.0, poor_fit="substitute", clamp=True)
    assert np.all(substituted(cos_theta) <= 1.0)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_clamping_stops_derivatives_where_it_clamps(backend):
    import drjit as dr

    Float = float_type(backend, "float64")
    cos_theta = np.linspace(0.0, 1.0, 201)
    found = []
    for clamp in (False, True):
        c = [Float(v) for v in load_basis().coefficients(1.01, 0.0)]
        dr.enable_grad(c[2])
        F = Decomposition(c, load_basis(), clamp=clamp)(Float(cos_theta))
        dr.forward(c[2])
        found.append((np.array(F), np.array(dr.grad(F))))
    (F, free), (clamped, stopped) = found
    np.testing.assert_array_equal(clamped, np.clip(F, 0.0, 1.0))
    inside = (F >= 0.0) & (F <= 1.0)
    assert 0 < inside.sum() < len(F)
    np.testing.assert_array_equal(stopped, np.where(inside, free, 0.0))


@pytest.mark.parametrize("name", MODELS)
def test_one_interface(name):
    model = model_from_ior(name, ETA, K)
    assert model.name == name
    assert dataclasses.is_dataclass(model)
    with pytest.raises(dataclasses.FrozenInstanceError):
        model.name = "x"
    F = model(COSINES[:, None])
    assert F.shape == (101, 4)
    np.testing.assert_allclose(F[0], 1.0, atol=1e-6)
    np.testing.assert_allclose(F[-1], exact(1.0, ETA, K), atol=1e-6)
    assert np.abs(F - exact(COSINES[:, None], ETA, K)).max() < {"schlick": 0.2, "f82": 0.1}.get(
        name, 0.05
    )
    for cos_theta in (0, 0.5, 1.0):
        assert type(model_from_ior(name, 1.5, 0.0)(cos_theta)) is float
    assert model_from_ior(name, ETA[0], K[0])(COSINES[5:6]).shape == (1,)
    for eta, k in ((-1.0, 0.0), (1.5, -1.0), (np.nan, 0.0)):
        with pytest.raises(InputError):
            model_from_ior(name, eta, k)(0.5)


def test_unknown_model():
    with pytest.raises(InputError, match=r"model='shlick' is unknown.*Did you mean 'schlick'"):
        model_from_ior("shlick", 1.5, 0.0)
    basis = load_basis("notebook")
    assert model_from_ior("decomposition", 1.5, 0.0, basis).basis is basis


@pytest.mark.parametrize("name", [n for n in MODELS if n != "decomposition"])
def test_float32_stays_float32(name):
    cos_theta = np.linspace(0.0, 1.0, 5, dtype=np.float32)
    assert model_from_ior(name, 1.5, 0.0)(cos_theta).dtype == np.float32


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_drjit_kinds(backend, dtype, name):
    """Dr.Jit cosines, parameters or both give Dr.Jit arrays, equal to NumPy's."""
    Float = float_type(backend, dtype)
    tolerance = 1e-5 if dtype == "float32" else 1e-12
    cos_theta = np.array([0.0, 0.1, 0.7, 1.0], dtype)
    plain = model_from_ior(name, 0.2, 3.4)
    expected = plain(cos_theta)
    F = plain(Float(cos_theta))
    assert type(F) is Float
    np.testing.assert_allclose(np.array(F), expected, atol=tolerance)
    if name == "lazanyi":
        with pytest.raises(InputError, match=r"Lazanyi.from_ior with Dr.Jit arrays"):
            model_from_ior(name, Float(0.2), Float(3.4))
        return
    jit = model_from_ior(name, Float(0.2), Float(3.4))
    for cosine, reference in ((Float(cos_theta), expected), (0.1, expected[1:2])):
        F = jit(cosine)
        assert type(F) is Float
        np.testing.assert_allclose(np.array(F), reference, atol=tolerance)
    with pytest.raises(InputError, match=r"together with a Dr.Jit array"):
        jit(cos_theta)
    with pytest.raises(InputError, match=r"together with a Dr.Jit array"):
        model_from_ior(name, ETA, K)(Float(cos_theta))


@pytest.mark.parametrize("backend", BACKENDS)
def test_numpy_scalars_do_not_turn_drjit_arrays_into_numpy(backend):
    Float = float_type(backend)
    f0, f82 = np.float64(0.9), np.float32(0.85)
    for model in (
        Schlick(f0),
        F82(f0, f82),
        Lazanyi(f0, np.float64(0.3), np.float64(6.0)),
        Gulbrandsen(f0, f82),
        Exact(np.float64(0.2), np.array(3.4)),
        Decomposition(np.array([f0, 1.0 - f0, 0.1, 0.1]), load_basis()),
    ):
        assert type(model(Float([0.1, 0.7]))) is Float


def test_colours(variant):
    import mitsuba as mi

    eta, k = [0.2, 0.9, 1.5], [3.5, 2.5, 1.9]
    for name in MODELS:
        expected = np.array(model_from_ior(name, np.array(eta), np.array(k))(0.3))
        if name == "lazanyi":
            continue
        F = model_from_ior(name, mi.Color3f(eta), mi.Color3f(k))(mi.Float(0.3))
        assert type(F) is mi.Color3f
        np.testing.assert_allclose(np.array(F).ravel(), expected, atol=1e-5)


@pytest.mark.parametrize(("eta", "k"), [(0.999, 0.0), (0.99, 0.0), (0.97, 0.005), (0.9, 0.001)])
def test_substitutes_near_a_matched_index(eta, k):
    model = Decomposition.from_ior(eta, k, poor_fit="substitute")
    cos_theta = np.linspace(0.0, 1.0, 501)
    assert np.abs(model(cos_theta) - conductor(cos_theta, eta, k)).max() < 0.12

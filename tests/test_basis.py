"""Bases: what ships, coefficients, errors on all sets, poor fits, least squares, Dr.Jit."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse.linalg

import fresnel_decomp.basis as basis_module
from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import (
    Basis,
    CurveSet,
    InputError,
    conductor,
    curves,
    extract_basis,
    gulbrandsen_to_ior,
    load_basis,
)
from fresnel_decomp.curves import talk_training_set
from fresnel_decomp.recipes import RECIPES, SVD_RECIPES
from fresnel_decomp.singular_vectors import extract
from oracles import central_difference, textbook

SHIPPED = [(recipe, terms) for recipe in RECIPES for terms in (3, 4, 5, 6)]
BY_SVD = [(recipe, terms) for recipe, terms in SHIPPED if recipe in SVD_RECIPES]
ETA = np.array([1.5, 0.2, 2.4, 1.33, 0.9, 4.0])
K = np.array([0.0, 3.4, 0.5, 1e-4, 2.0, 6.0])


@pytest.fixture(scope="module")
def extractions():
    return {
        name: extract(recipe.training(), 6, recipe.rule, recipe.nodes, recipe.grid)
        for name, recipe in SVD_RECIPES.items()
    }


# --- what ships ------------------------------------------------------------------------------


@pytest.mark.parametrize("recipe", SVD_RECIPES)
def test_reference_basis(recipe, reference):
    table = np.loadtxt(reference / f"{recipe}_basis.csv", delimiter=",", skiprows=1)
    functions = load_basis(recipe)(table[:, 0])
    np.testing.assert_array_equal(functions[:, 0], 1.0)
    np.testing.assert_allclose(functions[:, 1:], table[:, 1:], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("recipe", SVD_RECIPES)
def test_reference_coefficients(recipe, reference):
    table = np.loadtxt(reference / f"{recipe}_coefficients.csv", delimiter=",", skiprows=1)
    assert len(table) == 15
    found = load_basis(recipe).coefficients(table[:, 0], table[:, 1], poor_fit="keep")
    np.testing.assert_allclose(found, table[:, 2:], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(("recipe", "terms"), BY_SVD)
def test_shipped_equals_a_rebuild(extractions, recipe, terms):
    basis, extraction = load_basis(recipe, terms), extractions[recipe]
    cos_theta = np.concatenate([np.linspace(0.0, 1.0, 1501), np.geomspace(1e-7, 0.1, 200)])
    rebuilt = extraction.functions(cos_theta)[:, : terms - 1]
    np.testing.assert_allclose(basis(cos_theta)[:, 1:], rebuilt, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(basis.nodes, extraction.nodes[: terms - 2], rtol=0.0, atol=1e-9)
    assert np.abs(basis.closed_form(cos_theta)[:, 1:] - rebuilt).max() <= 2e-4
    assert basis.provenance["training_sha256"] == extraction.training.sha256


@pytest.mark.slow
@pytest.mark.parametrize(("recipe", "terms"), SHIPPED)
def test_shipped_equals_the_whole_extraction(recipe, terms):
    shipped, rebuilt = load_basis(recipe, terms), extract_basis(recipe, terms)
    cos_theta = np.linspace(0.0, 1.0, 501)
    np.testing.assert_allclose(rebuilt(cos_theta), shipped(cos_theta), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(
        rebuilt.closed_form(cos_theta), shipped.closed_form(cos_theta), rtol=0.0, atol=2e-4
    )
    changing = {"versions", "sha256"}
    assert {k: v for k, v in rebuilt.provenance.items() if k not in changing} == {
        k: v for k, v in shipped.provenance.items() if k not in changing
    }


@pytest.mark.parametrize(("recipe", "terms"), SHIPPED)
def test_provenance(recipe, terms):
    basis = load_basis(recipe, terms)
    assert (basis.recipe, basis.terms) == (recipe, terms)
    expected = {"recipe": recipe, "terms": terms, "training_set": "a, cp, d, low"}
    expected["training_curves"] = 19593
    if recipe in SVD_RECIPES:
        expected["training_set"] = recipe
        expected["training_curves"] = {"talk": 999, "notebook": 1000}[recipe]
    assert expected.items() <= basis.provenance.items()
    assert {"fresnel_decomp", "numpy"} <= basis.provenance["versions"].keys()
    rounded = np.round(basis.series, 12).astype("<f8").tobytes()
    assert basis.provenance["sha256"] == hashlib.sha256(rounded).hexdigest()


@pytest.mark.parametrize(("recipe", "terms"), SHIPPED)
def test_ends(recipe, terms):
    functions = load_basis(recipe, terms)(np.array([0.0, 1.0]))
    expected = [[1, 1, *[0] * (terms - 2)], [1, *[0] * (terms - 1)]]
    np.testing.assert_array_equal(functions[:, 0], 1.0)
    # the notebook's b_2 and b_3 themselves end at 5e-7, for its row with n = 1e-5
    np.testing.assert_allclose(functions, expected, atol=2e-6 if recipe == "notebook" else 1e-11)


def test_conditioning():
    assert load_basis("notebook").condition == pytest.approx(1.51, abs=0.01)
    assert load_basis("talk").condition == pytest.approx(2.06, abs=0.01)
    for recipe, terms in SHIPPED:
        basis = load_basis(recipe, terms)
        matrix = basis(np.cos(basis.nodes))[:, 2:]
        values = np.linalg.svd(matrix, compute_uv=False)
        assert basis.condition == pytest.approx(values[0] / values[-1])
        assert basis.condition < 6.0


def test_loading_runs_no_svd(monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("an SVD was run")

    basis_module._load.cache_clear()
    monkeypatch.setattr(scipy.sparse.linalg, "svds", refuse)
    monkeypatch.setattr(np.linalg, "svd", refuse)
    for solver in ("least_squares", "linprog", "nnls"):
        monkeypatch.setattr(scipy.optimize, solver, refuse)
    for recipe, terms in SHIPPED:
        load_basis(recipe, terms).coefficients(1.5, 0.5)
    with pytest.raises(AssertionError, match="an SVD was run"):
        extract_basis("talk")
    assert load_basis() is load_basis("talk", 4)


def test_json_round_trip():
    basis = load_basis("notebook", 5)
    again = Basis.from_json(json.loads(json.dumps(basis.to_json(), allow_nan=False)))
    cos_theta = np.linspace(0.0, 1.0, 40)
    np.testing.assert_array_equal(again(cos_theta), basis(cos_theta))
    np.testing.assert_array_equal(again.closed_form(cos_theta), basis.closed_form(cos_theta))
    np.testing.assert_array_equal(again.nodes, basis.nodes)
    assert (again.recipe, again.provenance) == (basis.recipe, basis.provenance)
    assert again.closed_form.error == basis.closed_form.error


def test_parts_that_do_not_belong_together():
    whole = load_basis().to_json()
    for name, wrong in (
        ("nodes", whole["nodes"][:1]),
        ("nodes", [1.2, 1.6]),
        ("nodes", [1.2, float("nan")]),
        ("series", whole["series"][:2]),
        ("series", [[float("inf")] * 4] * 3),
        ("closed_form", load_basis(terms=5).to_json()["closed_form"]),
    ):
        with pytest.raises(InputError, match=r"accepted: .*(as many terms|finite series)"):
            Basis.from_json({**whole, name: wrong})


def test_files(tmp_path):
    path = tmp_path / "mine.json"
    load_basis(terms=5).save(path)
    assert load_basis(path).terms == load_basis(str(path), 5).terms == 5
    with pytest.raises(InputError, match=r"terms=4.*accepted: 5, which the file has"):
        load_basis(path, 4)
    for text in ("", "{}", "[]", json.dumps({**load_basis().to_json(), "nodes": [1.2]})):
        path.write_text(text)
        with pytest.raises(InputError, match="cannot load a basis from"):
            load_basis(path)
    with pytest.raises(InputError, match=r"ending in \.json"):
        load_basis().save(tmp_path / "mine.txt")


# --- a user's own training set ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("rule", "terms"), [(rule, terms) for rule in ("deflation", "joint") for terms in (3, 4, 5, 6)]
)
def test_own_training_set(rule, terms):
    rng = np.random.default_rng(2)
    own = CurveSet("mine", rng.uniform(1.2, 2.5, 60), rng.uniform(0.0, 3.0, 60))
    basis = extract_basis(own, terms, rule=rule, grid=300)
    assert (basis.recipe, basis.terms, len(basis.nodes)) == ("custom", terms, terms - 2)
    assert basis.provenance["training_sha256"] == own.sha256
    assert basis.provenance["rule"] == rule
    fit = basis.error(own.eta, own.k)
    assert fit.rmse.max() < {3: 0.03, 4: 0.02, 5: 0.01, 6: 0.005}[terms]
    extraction = extract(own, terms, rule, grid=300)
    cos_theta = np.linspace(0.0, 1.0, 200)
    np.testing.assert_allclose(basis(cos_theta)[:, 1:], extraction.functions(cos_theta), atol=1e-10)


def test_curves_with_kinks_are_refused():
    """Total internal reflection: Chebyshev series converge too slowly."""
    eta = np.linspace(0.5, 0.95, 20)
    with pytest.raises(InputError, match=r"have kinks .*0\.02.*total internal reflection"):
        extract_basis(CurveSet("inside", eta, np.zeros(20)), 3)
    near = CurveSet("near", 1.0 + np.geomspace(1e-9, 1e-2, 20), np.zeros(20))
    basis, cos_theta = extract_basis(near, 3), np.linspace(0.0, 1.0, 999)
    found = extract(near, 3).functions(cos_theta)
    np.testing.assert_allclose(basis(cos_theta)[:, 1:], found, atol=1e-5)


def test_closed_form_of_an_own_basis_is_fitted_on_first_use(monkeypatch):
    own = CurveSet("mine", np.linspace(1.3, 2.5, 30), np.linspace(0.0, 1.0, 30))
    basis = extract_basis(own, 3, grid=200)
    assert basis.shipped_form is None
    cos_theta = np.linspace(0.0, 1.0, 3001) ** 2
    assert np.abs(basis.closed_form(cos_theta) - basis(cos_theta)).max() <= 1.02e-4
    again = Basis.from_json(basis.to_json())
    monkeypatch.setattr(basis_module, "fit_closed_form", None)  # both have theirs now
    assert basis.closed_form.error == again.closed_form.error <= 1e-4


# --- evaluation --------------------------------------------------------------------------------


def test_shapes_and_clamping():
    basis = load_basis()
    assert basis(0.5).shape == (4,)
    assert basis(np.zeros((2, 3))).shape == (2, 3, 4)
    assert basis(np.zeros((2, 3), np.float32)).dtype == np.float64
    np.testing.assert_array_equal(basis([-0.5, 1.5]), basis([0.0, 1.0]))
    c = basis.coefficients(ETA[:, None], K[:, None])
    assert c.shape == (6, 1, 4)
    F = basis.evaluate(c, np.linspace(0.0, 1.0, 9))
    assert F.shape == (6, 9)
    np.testing.assert_allclose(F[2, 3], c[2, 0] @ basis(0.375), rtol=1e-14)


def test_series_against_chebyshev():
    basis = load_basis("notebook", 6)
    cos_theta = np.linspace(0.0, 1.0, 300)
    for j, row in enumerate(basis.series):
        expected = np.polynomial.chebyshev.chebval(2.0 * cos_theta - 1.0, row)
        np.testing.assert_allclose(basis(cos_theta)[:, j + 1], expected, atol=1e-13)


@pytest.mark.parametrize(("recipe", "terms"), SHIPPED)
def test_fit_passes_through_the_nodes(recipe, terms):
    basis = load_basis(recipe, terms)
    c = basis.coefficients(ETA[:, None], K[:, None])
    cos_theta = np.cos([0.0, *basis.nodes])
    F = basis.evaluate(c, cos_theta)
    exact = np.mean(textbook(cos_theta, ETA[:, None], K[:, None]), axis=0)
    np.testing.assert_allclose(F[:, 1:], exact[:, 1:], atol=1e-13)
    np.testing.assert_allclose(F[:, 0], exact[:, 0], atol=1e-6 if recipe == "notebook" else 2e-13)
    np.testing.assert_allclose(c[:, 0, 0], exact[:, 0], atol=1e-14)
    np.testing.assert_array_equal(c[..., 1], 1.0 - c[..., 0])


def test_coefficients_from_reflectance():
    basis = load_basis()
    at_nodes = conductor(np.cos(basis.nodes), ETA[:, None], K[:, None])
    f0 = conductor(1.0, ETA, K)
    np.testing.assert_array_equal(
        basis.coefficients_from_reflectance(f0, at_nodes), basis.coefficients(ETA, K)
    )
    # affine: the average curve has the average coefficients, in and out of gamut
    weights = np.array([0.7, -0.3, 0.2, 0.5, -0.4, 0.3])
    assert weights.sum() == pytest.approx(1.0)
    mixed = basis.coefficients_from_reflectance(weights @ f0, weights @ at_nodes)
    np.testing.assert_allclose(mixed, weights @ basis.coefficients(ETA, K), rtol=0.0, atol=1e-15)
    # one F0 for many node colours, and the reverse
    assert basis.coefficients_from_reflectance(0.04, np.full((5, 2), 0.1)).shape == (5, 4)
    assert basis.coefficients_from_reflectance(np.full(3, 0.04), [0.1, 0.2]).shape == (3, 4)
    for nodes in ([0.1], [0.1, 0.2, 0.3], 0.1, np.zeros((2, 3))):
        with pytest.raises(InputError, match=r"node reflectances; accepted: 2, at \[1.45, 1.31\]"):
            basis.coefficients_from_reflectance(0.04, nodes)


def test_continuity_at_matched_indices():
    """eta -> 1 and r -> 0: the curve tends to 0 everywhere but at grazing incidence."""
    for recipe, terms in SHIPPED:
        basis = load_basis(recipe, terms)
        limit = basis.coefficients(1.0, 0.0)
        assert limit[:2].tolist() == [0.0, 1.0]
        for distance in (1e-3, 1e-6, 1e-9, 1e-12):
            bound = 60.0 * distance**2 + 1e-15  # R grows like distance² / cos⁴
            for eta in (1.0 + distance, 1.0 - distance):
                c = basis.coefficients(eta, 0.0)
                assert np.abs(c[:2] - limit[:2]).max() < distance**2
                assert np.abs(c - limit).max() < 100.0 * bound / min(np.cos(basis.nodes)) ** 4
            r = distance**2
            for g in (0.0, 0.5, 1.0):
                c = basis.coefficients(*gulbrandsen_to_ior(r, g))
                assert c[0] == pytest.approx(r, rel=1e-3)
                assert c[1] == pytest.approx(1.0 - r, abs=1e-15)


# --- errors on the reference sets ---------------------------------------------------------------

SETS = {
    "a": curves.dielectrics,
    "cp": curves.gulbrandsen_grid,
    "low": curves.low_index_corner,
    "d": curves.measured_metals,
}
SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("recipe", "name", "maximum", "rmse"),
    [
        ("notebook", "a", 0.1200, 0.0025),
        ("notebook", "cp", 0.1001, 0.0033),
        ("notebook", "low", 0.054, 0.0054),
        ("talk", "a", 0.0868, 0.0021),
        ("talk", "cp", 0.0906, 0.0032),
        ("talk", "low", 0.099, 0.0095),
        pytest.param("notebook", "d", 0.0375, 0.0025, marks=SLOW),
        pytest.param("talk", "d", 0.0281, 0.0019, marks=SLOW),
    ],
)
def test_errors_on_reference_sets(recipe, name, maximum, rmse):
    members = SETS[name]()
    error = load_basis(recipe).error(members.eta, members.k)
    digits = 3 if name == "low" else 4
    assert round(error.max.max(), digits) == maximum
    assert round(np.sqrt((error.rmse**2).mean()), 4) == rmse
    assert not load_basis(recipe).poor_fit(members.eta, members.k).any()


def test_error_is_what_it_says():
    basis = load_basis()
    everywhere, uniform = curves.error_cosines()
    error = basis.error(ETA[:4].reshape(2, 2), K[:4].reshape(2, 2))
    assert [v.shape for v in error] == [(2, 2)] * 3
    c = basis.coefficients(1.33, 1e-4)
    difference = np.abs(basis(everywhere) @ c - np.mean(textbook(everywhere, 1.33, 1e-4), axis=0))
    assert error.max[1, 1] == pytest.approx(difference.max(), rel=1e-9)
    on_uniform = difference[: len(uniform)]
    assert error.mean[1, 1] == pytest.approx(on_uniform.mean(), rel=1e-9)
    assert error.rmse[1, 1] == pytest.approx(np.sqrt((on_uniform**2).mean()), rel=1e-9)
    assert basis.error(1.5, 0.0).max.shape == ()
    assert basis.error(np.zeros((0, 3)), 0.0).rmse.shape == (0, 3)
    # more curves than fit one pass
    many = basis.error(np.full(1100, 1.5), 0.0)
    np.testing.assert_allclose(many.max, basis.error(1.5, 0.0).max, rtol=1e-12)


def test_more_terms_fit_better():
    eta = np.linspace(1.2, 3.0, 40)
    for recipe in RECIPES:
        rmse = [
            np.sqrt((load_basis(recipe, terms).error(eta, 0.0).rmse ** 2).mean())
            for terms in (3, 4, 5, 6)
        ]
        assert (np.diff(rmse) < 0.0).all()


# --- poor fits ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("eta", "k", "error"), [(0.7, 1e-4, 0.62), (0.7, 0.0, 0.6), (0.5, 0.0, 0.85), (0.1, 0.05, 0.25)]
)
def test_poor_fits_are_refused(eta, k, error):
    basis = load_basis("notebook")
    assert basis.poor_fit(eta, k)
    with pytest.raises(
        InputError,
        match=rf"eta={eta:g}, k={k:g}: total internal reflection.*"
        r"accepted: .*\. Use the exact equations",
    ):
        basis.coefficients(eta, k)
    with pytest.raises(InputError, match=r"eta=.*error 0\.\d\d"):
        basis.coefficients(np.array([1.5, eta]), np.array([0.0, k]))
    kept = basis.coefficients(eta, k, poor_fit="keep")
    assert kept.shape == (4,)
    assert np.isfinite(kept).all()
    assert basis.error(eta, k).max == pytest.approx(error, abs=0.12)
    if (eta, k) == (0.7, 1e-4):
        assert basis.error(eta, k).max == pytest.approx(0.62, abs=0.005)


def test_where_fits_are_poor():
    basis = load_basis()
    assert load_basis("notebook").error(0.7, 0.05).max == pytest.approx(0.15, abs=0.01)
    assert load_basis("notebook").poor_fit(0.7, 0.05)
    assert basis.poor_fit(0.7, 0.05)  # .29 with this one
    assert basis.poor_fit(0.99, 0.0)
    assert basis.poor_fit(0.97, 0.005)  # a small RMSE, but .26 at one angle
    assert not basis.poor_fit(0.999, 0.0)  # nearly matched: as weak as 1.001, and continuous
    assert basis.poor_fit(0.999, 0.0, below=1.0)
    assert not basis.poor_fit(1.0001, 0.0, below=1.0)
    grid = basis.poor_fit(np.array([[0.5], [1.5]]), np.array([0.0, 0.01, 1.0]))
    np.testing.assert_array_equal(grid, [[True, True, False], [False, False, False]])
    assert basis.poor_fit(0.5, 0.0).shape == ()


@pytest.mark.parametrize("backend", BACKENDS)
def test_poor_fits_are_refused_in_drjit(backend):
    Float = float_type(backend)
    basis = load_basis()
    with pytest.raises(InputError, match=r"eta=0.7.*total internal reflection"):
        basis.coefficients(Float([1.5, 0.7]), 0.0)
    kept = basis.coefficients(Float([1.5, 0.7]), 0.0, poor_fit="keep")
    expected = basis.coefficients(np.array([1.5, 0.7]), 0.0, poor_fit="keep").T
    for a, b in zip(kept, expected, strict=True):
        np.testing.assert_allclose(np.array(a), b, atol=1e-5)


def test_bad_input():
    basis = load_basis()
    for eta, k in ((0.0, 1.0), (-1.0, 0.0), (np.nan, 0.0), (1.5, -1.0), (1.5, np.inf)):
        with pytest.raises(InputError, match=r"^eta=.*; accepted: finite eta > 0 and k >= 0\. "):
            basis.coefficients(eta, k)
        with pytest.raises(InputError, match=r"at index \(1, 0\);"):
            basis.coefficients(np.array([[1.5], [eta]]), np.array([[0.0], [k]]))
        with pytest.raises(InputError, match="finite eta > 0"):
            basis.poor_fit(eta, k)
    with pytest.raises(InputError, match=r"f_nodes of shapes \(3,\) and \(2, 2\)"):
        basis.coefficients_from_reflectance(np.zeros(3), np.zeros((2, 2)))
    for samples in ((np.full(9, np.nan), np.ones(9)), (np.linspace(0, 1, 9), np.full(9, np.inf))):
        with pytest.raises(InputError, match="samples that are not finite"):
            basis.fit(*samples)
    with pytest.raises(InputError, match=r"eta and k of shapes \(3,\), \(2,\)"):
        basis.coefficients(np.ones(3), np.ones(2))
    with pytest.raises(InputError, match="complex128"):
        basis.coefficients(np.array([1.5 + 0.1j]), 0.0)
    with pytest.raises(InputError, match="poor_fit='ignore' is unknown"):
        basis.coefficients(1.5, 0.0, poor_fit="ignore")
    with pytest.raises(InputError, match=r"recipe='talks' is unknown.*Did you mean 'talk'"):
        load_basis("talks")
    for terms in (2, 7, True, "4"):
        with pytest.raises(InputError, match=f"terms={terms!r}; accepted: 3, 4, 5 or 6"):
            load_basis("talk", terms)
    with pytest.raises(InputError, match="recipe='mine' is unknown"):
        extract_basis("mine")


# --- least squares -----------------------------------------------------------------------------


def test_fit_recovers_what_is_in_the_basis():
    basis = load_basis()
    c = np.array([[0.04, 0.96, 0.2, -0.1], [1.02, -0.02, 0.0, 0.3]])
    cos_theta = np.linspace(0.05, 1.0, 23)
    np.testing.assert_allclose(
        basis.fit(cos_theta, basis.evaluate(c[:, None], cos_theta)), c, atol=1e-12
    )
    assert basis.fit(cos_theta, basis(cos_theta)[:, 1]) == pytest.approx([0, 1, 0, 0], abs=1e-12)


def test_fit_minimises():
    basis = load_basis()
    cos_theta = np.linspace(0.0, 1.0, 101)
    F = conductor(cos_theta, ETA[:, None], K[:, None])
    c = basis.fit(cos_theta, F)
    np.testing.assert_allclose(c[:, 0] + c[:, 1], 1.0, atol=1e-15)
    functions = basis(cos_theta)
    residual = c @ functions.T - F
    # orthogonal to every direction that keeps c_0 + c_1
    directions = np.stack([1.0 - functions[:, 1], functions[:, 2], functions[:, 3]])
    assert np.abs(residual @ directions.T).max() < 1e-12
    by_nodes = basis.coefficients(ETA, K) @ functions.T - F
    assert ((residual**2).sum(axis=1) < (by_nodes**2).sum(axis=1)).all()
    # shapes: (..., m)
    assert basis.fit(cos_theta, F.reshape(2, 3, -1)).shape == (2, 3, 4)
    assert basis.fit(cos_theta, F[0]).shape == (4,)


def test_fit_refuses():
    basis = load_basis()
    with pytest.raises(InputError, match="2 samples; accepted: at least 3"):
        basis.fit([0.1, 0.9], [0.1, 0.2])
    with pytest.raises(InputError, match=r"shape \(3,\), reflectances of shape \(4,\)"):
        basis.fit([0.1, 0.5, 0.9], np.zeros(4))
    with pytest.raises(InputError, match="reflectances of shape"):
        basis.fit(np.zeros((3, 1)), np.zeros((3, 1)))


# --- Dr.Jit ------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_drjit_equals_numpy(backend, dtype):
    Float = float_type(backend, dtype)
    tolerance = 5e-6 if dtype == "float32" else 1e-13
    for recipe, terms in (("talk", 3), ("talk", 4), ("notebook", 6)):
        basis = load_basis(recipe, terms)
        cos_theta = np.linspace(-0.1, 1.1, 60).astype(dtype)
        functions = basis(Float(cos_theta))
        assert [type(f) for f in functions] == [Float] * terms
        for a, b in zip(functions, basis(cos_theta).T, strict=True):
            np.testing.assert_allclose(np.array(a), b, atol=tolerance)
        eta, k = ETA.astype(dtype), K.astype(dtype)
        expected = basis.coefficients(eta, k)
        found = basis.coefficients(Float(eta), Float(k))
        assert [type(c) for c in found] == [Float] * terms
        for a, b in zip(found, expected.T, strict=True):
            np.testing.assert_allclose(np.array(a), b, atol=tolerance)
        # any mixture of kinds, as long as arrays are of one
        half = basis.evaluate(expected, 0.5)
        for coefficients, cosine in (
            (found, 0.5),
            (found, Float(0.5)),
            (found, np.float64(0.5)),
        ):
            F = basis.evaluate(coefficients, cosine)
            assert type(F) is Float
            np.testing.assert_allclose(np.array(F), half, atol=tolerance)
        F = basis.evaluate(expected[1], Float(np.array([0.5, 0.25], dtype)))
        assert type(F) is Float
        np.testing.assert_allclose(
            np.array(F), basis.evaluate(expected[1], np.array([0.5, 0.25])), atol=tolerance
        )
        with pytest.raises(InputError, match=r"together with a Dr.Jit array"):
            basis.evaluate(expected, Float(0.5))
        with pytest.raises(InputError, match="1 node reflectances"):
            load_basis().coefficients_from_reflectance(Float(0.04), [Float(0.1)])


@pytest.mark.parametrize("mode", ["forward", "backward"])
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradients(backend, mode):
    """Of every coefficient and of the curve, wrt eta, k and cos_theta."""
    import drjit as dr

    Float = float_type(backend, "float64")
    basis = load_basis()
    eta, k, cos_theta = ETA[[1, 2, 4, 5]], K[[1, 2, 4, 5]], np.array([0.9, 0.3, 0.1, 0.02])

    def outputs(cos_theta, eta, k):
        c = basis.coefficients(eta, k)
        if isinstance(eta, np.ndarray):
            return (
                *c.T,
                basis.evaluate(c, cos_theta),
                np.diagonal(basis.closed_form.evaluate(c[:, None], cos_theta)),
            )
        return (*c, basis.evaluate(c, cos_theta), basis.closed_form.evaluate(c, cos_theta))

    arguments = [cos_theta, eta, k]
    for i in range(3):
        for j in range(6):
            if i == 0 and j < 4:
                continue

            def along(x, i=i, j=j):
                return outputs(*arguments[:i], x, *arguments[i + 1 :])[j]

            expected = central_difference(along, arguments[i], 1e-3 * arguments[i])
            jit = [Float(a) for a in arguments]
            dr.enable_grad(jit[i])
            result = outputs(*jit)[j]
            if mode == "forward":
                dr.forward(jit[i])
                found = np.array(dr.grad(result))
            else:
                dr.backward(result)
                found = np.array(dr.grad(jit[i]))
            np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradients_at_the_ends(backend):
    """Of the functions: one-sided slopes, none beyond; a NaN stays one."""
    import drjit as dr

    basis = load_basis()
    at = np.array([0.0, 1.0, -0.5, 1.5, np.nan])
    cos_theta = float_type(backend, "float64")(at)
    dr.enable_grad(cos_theta)
    functions = basis(cos_theta)[1:]
    step = 1e-6
    low, high = ((basis(c + step)[1:] - basis(c)[1:]) / step for c in (0.0, 1.0 - step))
    dr.set_grad(cos_theta, 1.0)
    dr.enqueue(dr.ADMode.Forward, cos_theta)
    dr.traverse(dr.ADMode.Forward)
    for j, function in enumerate(functions):
        found = np.array(dr.grad(function))
        np.testing.assert_allclose(found[:4], [low[j], high[j], 0.0, 0.0], atol=1e-3)
        assert np.isnan(np.array(dr.detach(function))[4])


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradient_from_reflectance(backend):
    """Affine: the gradient is the constant matrix of the projection."""
    import drjit as dr

    Float = float_type(backend, "float64")
    basis = load_basis()
    values = np.array([0.04, 0.3, 0.1])
    for i in range(3):
        unit = np.eye(3)[i]
        expected = basis.coefficients_from_reflectance(
            values[0] + unit[0], values[1:] + unit[1:]
        ) - basis.coefficients_from_reflectance(values[0], values[1:])
        jit = [Float(v) for v in values]
        dr.enable_grad(jit[i])
        c = [v * 1.0 for v in basis.coefficients_from_reflectance(jit[0], jit[1:])]
        dr.forward(jit[i])
        found = [float(dr.grad(v)[0]) for v in c]
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_recording(backend):
    """Inside a symbolic loop and a frozen function."""
    import drjit as dr

    Float = float_type(backend)
    UInt32 = dr.uint32_array_t(Float)
    basis = load_basis()
    eta, k = Float([1.5, 0.2]), Float([0.0, 3.0])
    expected = basis.evaluate(basis.coefficients([1.5, 0.2], [0.0, 3.0]), 0.25)
    _, total = dr.while_loop(
        state=(UInt32(0), Float(0.0)),
        cond=lambda i, total: i < 3,
        body=lambda i, total: (i + 1, total + basis.evaluate(basis.coefficients(eta, k), 0.25)),
        mode="symbolic",
        labels=("i", "total"),
    )
    np.testing.assert_allclose(np.array(total), 3.0 * expected, rtol=1e-5)
    frozen = dr.freeze(lambda eta, k: basis.closed_form.evaluate(basis.coefficients(eta, k), 0.25))
    for _ in range(3):
        np.testing.assert_allclose(np.array(frozen(eta, k)), expected, atol=1e-4)


def test_colours(variant):
    """Colours of a Mitsuba variant, channel by channel."""
    import mitsuba as mi

    basis = load_basis()
    eta, k = [0.2, 0.9, 1.5], [3.5, 2.5, 1.9]
    c = basis.coefficients(mi.Color3f(eta), mi.Color3f(k))
    assert [type(v) for v in c] == [mi.Color3f] * 4
    expected = basis.coefficients(eta, k)
    np.testing.assert_allclose(
        np.stack([np.array(v).ravel() for v in c], axis=-1), expected, atol=3e-6
    )
    F = basis.evaluate(c, mi.Float(0.25))
    assert type(F) is mi.Color3f
    np.testing.assert_allclose(np.array(F).ravel(), basis.evaluate(expected, 0.25), atol=3e-6)
    with pytest.raises(InputError, match="total internal reflection"):
        basis.coefficients(mi.Color3f(0.2, 0.5, 1.5), mi.Color3f(3.5, 0.0, 1.9))


def test_a_shared_basis_cannot_be_changed():
    basis = load_basis()
    for array in (
        basis.nodes,
        basis.series,
        basis.closed_form.numerators,
        basis.closed_form.denominator,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(TypeError):
        basis.provenance["recipe"] = "mine"


@pytest.mark.parametrize("evaluate", ["evaluate", "closed form"])
def test_wrong_numbers_of_coefficients(evaluate):
    basis = load_basis()
    function = basis.evaluate if evaluate == "evaluate" else basis.closed_form.evaluate
    for coefficients in (1.0, np.ones(1), np.ones(3), np.ones((4, 3))):
        with pytest.raises(InputError, match=r"\(\.\.\., 4\).*4 terms"):
            function(coefficients, 0.5)
    with pytest.raises(InputError, match=r"coefficients\[:, None\]"):
        function(np.ones((3, 4)), np.linspace(0, 1, 5))
    assert function(np.ones((3, 1, 4)), np.linspace(0, 1, 5)).shape == (3, 5)


def test_options_beside_a_recipe_are_refused():
    with pytest.raises(InputError, match="of your own"):
        extract_basis("talk", nodes=(1.0, 1.2))
    with pytest.raises(InputError, match=r"ndarray.*CurveSet"):
        extract_basis(np.ones((10, 10)))
    with pytest.raises(InputError, match="grid=3"):
        extract_basis(talk_training_set(), grid=3)

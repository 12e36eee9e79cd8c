"""The iterative SVD: references, rules for signs and nodes, errors."""

from __future__ import annotations

import time

import numpy as np
import pytest
import scipy.sparse.linalg

from fresnel_decomp import CurveSet, InputError, extract_basis
from fresnel_decomp.curves import talk_training_set
from fresnel_decomp.recipes import SVD_RECIPES
from fresnel_decomp.singular_vectors import extract

PUBLISHED_NODES = {
    "talk": (1.45, 1.31),
    "notebook": (np.arccos(128 / 999), np.arccos(432 / 999)),
}


@pytest.fixture(scope="module")
def extractions():
    """Both recipes with six terms; their first functions are those with fewer terms."""
    return {
        name: extract(recipe.training(), 6, recipe.rule, recipe.nodes, recipe.grid)
        for name, recipe in SVD_RECIPES.items()
    }


@pytest.fixture(scope="module")
def small():
    """Forty curves: dielectrics and metals."""
    rng = np.random.default_rng(5)
    return CurveSet("small", rng.uniform(1.1, 3.0, 40), rng.uniform(0.0, 4.0, 40))


@pytest.mark.parametrize("recipe", SVD_RECIPES)
def test_reference_basis(extractions, recipe, reference):
    table = np.loadtxt(reference / f"{recipe}_basis.csv", delimiter=",", skiprows=1)
    functions = extractions[recipe].functions(table[:, 0])[:, :3]
    np.testing.assert_allclose(functions, table[:, 1:], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("recipe", SVD_RECIPES)
def test_nodes(extractions, recipe):
    nodes = extractions[recipe].nodes
    assert nodes[:2] == pytest.approx(PUBLISHED_NODES[recipe], abs=1e-9)
    assert len(nodes) == 4
    assert ((nodes > 0.0) & (nodes < np.pi / 2)).all()
    assert np.diff(np.sort(nodes)).min() > 0.02


@pytest.mark.parametrize("recipe", SVD_RECIPES)
def test_four_terms_on_their_own(extractions, recipe):
    chosen = SVD_RECIPES[recipe]
    four = extract(chosen.training(), 4, chosen.rule, chosen.nodes, chosen.grid)
    cos_theta = np.linspace(0.0, 1.0, 333)
    np.testing.assert_array_equal(four.nodes, extractions[recipe].nodes[:2])
    np.testing.assert_allclose(
        four.functions(cos_theta), extractions[recipe].functions(cos_theta)[:, :3], atol=1e-10
    )


@pytest.mark.parametrize("recipe", SVD_RECIPES)
def test_ends_peaks_and_signs(extractions, recipe):
    ends = extractions[recipe].functions(np.array([0.0, 1.0]))
    np.testing.assert_allclose(ends, [[1, 0, 0, 0, 0], [0, 0, 0, 0, 0]], atol=1e-6)
    functions = extractions[recipe].functions(np.linspace(0.0, 1.0, 1000))
    largest = functions[np.argmax(np.abs(functions), axis=0), range(5)]
    np.testing.assert_allclose(largest, 1.0, atol=1e-9)


def test_talk_nodes_make_a_triangular_system(extractions):
    """Each function vanishes at the nodes of those before it."""
    extraction = extractions["talk"]
    at_nodes = extraction.functions(np.cos(extraction.nodes))[:, 1:]
    assert np.abs(np.triu(at_nodes, 1)).max() < 1e-12
    assert np.abs(np.diag(at_nodes)).min() > 0.5


@pytest.mark.parametrize("rule", ["deflation", "joint"])
def test_sign_of_the_svd_changes_nothing(small, rule, monkeypatch):
    cos_theta = np.linspace(0.0, 1.0, 77)
    before = extract(small, 5, rule)
    original = scipy.sparse.linalg.svds
    flips = []

    def flipped(matrix, k, **options):
        left, values, right = original(matrix, k=k, **options)
        signs = np.where(np.arange(k) % 2 == 0, -1.0, 1.0)
        flips.append(k)
        return left * signs, values, right * signs[:, None]

    monkeypatch.setattr(scipy.sparse.linalg, "svds", flipped)
    after = extract(small, 5, rule)
    assert flips == ([1, 1, 1, 1] if rule == "deflation" else [1, 3])
    np.testing.assert_array_equal(after.nodes, before.nodes)
    np.testing.assert_array_equal(after.functions(cos_theta), before.functions(cos_theta))


@pytest.mark.parametrize("rule", ["deflation", "joint"])
def test_against_dense_svd(small, rule):
    """The definition, by complete SVDs of the curves on the grid."""
    grid = np.linspace(0.0, 1.0, 300)
    F = small.reflectance(grid)
    F0 = F[:, -1:]
    rescaled = (F - F0) / (1.0 - F0)

    def leading(matrix, count):
        right = np.linalg.svd(matrix, full_matrices=False)[2][:count]
        return right / right[np.arange(count), np.argmax(np.abs(right), axis=1), None]

    expected = [leading(rescaled, 1)[0]]
    ours = extract(small, 5, rule, grid=300)
    if rule == "joint":
        expected += list(leading(rescaled - expected[0], 3))
    else:
        residual = F - F0 - (1.0 - F0) * expected[0]
        for node in ours.nodes:
            expected.append(leading(residual, 1)[0])
            column = np.argmin(np.abs(grid - np.cos(node)))
            assert np.abs(grid[column] - np.cos(node)) < 1e-12
            assert column == np.argmax(np.abs(expected[-1]))
            fitted = residual[:, column] / expected[-1][column]
            residual = residual - fitted[:, None] * expected[-1]
    np.testing.assert_allclose(ours.functions(grid), np.stack(expected, axis=1), atol=1e-8)


@pytest.mark.parametrize("rule", ["deflation", "joint"])
def test_given_nodes_come_first(small, rule):
    free = extract(small, 5, rule)
    fixed = extract(small, 5, rule, nodes=(1.2345, 0.9))
    assert fixed.nodes[:2].tolist() == [1.2345, 0.9]
    assert len(fixed.nodes) == 3
    assert extract(small, 3, rule, nodes=(1.2345, 0.9)).nodes.tolist() == [1.2345]
    cos_theta = np.linspace(0.0, 1.0, 50)
    if rule == "joint":  # the nodes do not shape the functions
        np.testing.assert_allclose(
            fixed.functions(cos_theta), free.functions(cos_theta), atol=1e-13
        )
    else:
        assert np.abs(fixed.functions(np.cos([1.2345]))[0, 2:]).max() < 1e-12


def test_joint_nodes_follow_the_rule_of_the_notebook(extractions):
    grid = np.linspace(0.0, 1.0, 1000)
    functions = extractions["notebook"].functions(grid)
    first = np.argmax(functions[:, 1])
    second = max(
        np.argmax(functions[:, 2]), np.argmin(functions[:, 2]), key=lambda i: abs(i - first)
    )
    assert np.cos(extractions["notebook"].nodes[:2]) == pytest.approx(grid[[first, second]])


def test_extraction_is_deterministic(small):
    once, again = extract(small, 4), extract(small, 4)
    np.testing.assert_array_equal(once.weights, again.weights)
    np.testing.assert_array_equal(once.nodes, again.nodes)


def test_extraction_of_a_thousand_curves_takes_under_a_second():
    training = talk_training_set()

    def seconds():
        start = time.thread_time()  # this thread's: other work on the machine does not count
        extract(training, 4, nodes=(1.45, 1.31))
        return time.thread_time() - start

    assert min(seconds() for _ in range(3)) < 1.0


def test_bad_input(small):
    for terms in (2, 7, 4.5, "4"):
        with pytest.raises(InputError, match=r"terms=.*; accepted: 3, 4, 5 or 6\. "):
            extract(small, terms)
    for nodes in ((0.0,), (np.pi / 2,), (-0.1,), (np.nan,), (1.2, 1.2)):
        with pytest.raises(InputError, match=r"nodes \[.*different angles in \(0, pi/2\)"):
            extract(small, 4, nodes=nodes)
    with pytest.raises(InputError, match=r"rule='jointly' is unknown.*Did you mean 'joint'"):
        extract(small, 4, "jointly")
    with pytest.raises(InputError, match="3 training curves for 4 terms"):
        extract(CurveSet("x", small.eta[:3], small.k[:3]), 4)


def test_the_best_mirrors_have_curves_too():
    """However extreme an index, its transmittance is above 0, and so is what it is divided by."""
    extreme = CurveSet("x", [5e-324, 1e300, 1.0], [0.0, 1e300, 1e308])
    assert np.all(extreme.t0 > 0.0)
    assert np.all(np.isfinite(extreme.rescaled(np.linspace(0.0, 1.0, 5))))


@pytest.mark.parametrize("rule", ["deflation", "joint"])
@pytest.mark.parametrize("different", [1, 2])
def test_too_similar_curves(rule, different):
    eta = np.resize([1.5, 1.8], 10) if different == 2 else np.full(10, 1.5)
    with pytest.raises(InputError, match="combinations of fewer functions than terms"):
        extract(CurveSet("x", eta, np.zeros(10)), 4, rule)


@pytest.mark.parametrize("rule", ["deflation", "joint"])
def test_metals_that_dip_deeply(rule):
    """(F - F0) / (1 - F0) of aluminium goes below -.5, but b_1 is 1 at grazing incidence."""
    metals = CurveSet("bright", np.linspace(0.8, 1.6, 9), np.linspace(9.0, 6.0, 9))
    assert metals.rescaled(np.linspace(0.0, 1.0, 200)).min() < -0.5
    basis = extract_basis(metals, 3, rule=rule)
    ends = basis(np.array([0.0, 1.0]))
    np.testing.assert_allclose(ends, [[1.0, 1.0, 0.0], [1.0, 0.0, 0.0]], atol=1e-9)
    assert basis.error(metals.eta, metals.k).max.max() < 0.004
    if rule == "deflation":  # one of them is enough: a fit takes seconds
        assert basis.closed_form.error <= 1e-4

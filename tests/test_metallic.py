"""From base colours to curves of metals: what is exact by construction, and how near metals are."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

from backends import float_type
from fresnel_decomp import InputError, dielectric, load_basis, load_material
from fresnel_decomp.metallic import (
    default_edge_colour,
    dielectric_eta,
    fit_metal_edge,
    load_metal_edge,
    metal_coefficients,
    metal_reflectance,
)
from fresnel_decomp.parametrization import F82_COSINE

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def script():
    """The script as a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        yield importlib.import_module("metal_edge")


def test_curves_pass_through_both_colours() -> None:
    rng = np.random.default_rng(0)
    base, edge = rng.uniform(size=(2, 50))
    np.testing.assert_allclose(metal_reflectance(base, edge, 1.0), base, atol=1e-12)
    np.testing.assert_allclose(metal_reflectance(base, edge, F82_COSINE), edge, atol=1e-9)
    np.testing.assert_allclose(metal_reflectance(base, edge, 0.0), 1.0, atol=1e-12)
    for cos_theta in (0.0, 0.1, 0.5, 1.0):
        assert metal_reflectance(1.0, 1.0, cos_theta) == 1.0


def test_usual_edges_are_brighter_for_brighter_metals() -> None:
    """Also where none was fitted: from Schlick's edge of a black one to that of a mirror."""
    base = np.linspace(0.0, 1.0, 201)
    edge = default_edge_colour(base)
    assert edge[0] == pytest.approx((6.0 / 7.0) ** 5)
    assert edge[-1] == 1.0
    assert np.all(np.diff(edge) > 0.0)


def test_coefficients_are_those_of_the_node_reflectances() -> None:
    basis = load_basis("balanced", 5)
    base, edge = np.array([0.9, 0.5, 0.2]), np.array([0.92, 0.6, 0.4])
    c = metal_coefficients(base, edge, basis)
    for cos_theta in (1.0, *np.cos(basis.nodes)):
        expected = metal_reflectance(base, edge, cos_theta)
        np.testing.assert_allclose(basis.evaluate(c, cos_theta), expected, atol=1e-10)


@pytest.mark.parametrize("backend", ["scalar", "llvm"])
def test_drjit_agrees_with_numpy(backend: str) -> None:
    kind, basis = float_type(backend), load_basis()
    base, edge = [0.0, 0.3, 1.0], [0.2, 0.5, 1.0]
    got = np.array([np.array(c) for c in metal_coefficients(kind(base), kind(edge), basis)])
    np.testing.assert_allclose(got.T, metal_coefficients(base, edge, basis), atol=1e-6)
    usual = np.array(default_edge_colour(kind(base)))
    np.testing.assert_allclose(usual, default_edge_colour(np.array(base)), atol=1e-6)
    eta = np.array(dielectric_eta(kind([0.0, 0.04, 0.5])))
    np.testing.assert_allclose(eta, dielectric_eta(np.array([0.0, 0.04, 0.5])), rtol=1e-6)


def test_dielectrics_keep_their_reflectance() -> None:
    f0 = np.array([0.0, 1e-9, 0.02, 0.04, 0.08, 0.5, 0.99])
    np.testing.assert_allclose(dielectric(1.0, dielectric_eta(f0)), f0, rtol=1e-9, atol=1e-12)
    assert dielectric_eta(0.04) == pytest.approx(1.5, rel=1e-12)
    assert np.isnan(dielectric_eta(np.nan))


def test_derivative_of_the_index_is_finite_at_zero() -> None:
    import drjit as dr

    f0 = float_type("llvm")([0.0, 0.04])
    dr.enable_grad(f0)
    dr.backward(dr.sum(dielectric_eta(f0)))
    slope = np.array(dr.grad(f0))
    assert slope[0] == 0.0
    root = 0.2
    assert slope[1] == pytest.approx(1.0 / (root * (1.0 - root) ** 2), rel=1e-5)


def test_numbers_are_those_of_the_script(script) -> None:
    fitted, shipped = script.fit(script.METALS), load_metal_edge()
    for name in ("cos_theta", "u", "v", "q", "s"):
        np.testing.assert_allclose(getattr(shipped, name), getattr(fitted, name), atol=2e-6)


@pytest.mark.parametrize("name", ["Cu", "Au", "Al", "TiN"])
def test_metals_from_two_colours(name: str) -> None:
    """Of gold's red, which leaves the gamut, too."""
    material, cosines = load_material(name), np.linspace(0.0, 1.0, 101)
    base, edge = (material.rgb_reflectance(c) for c in (1.0, F82_COSINE))
    basis = load_basis()
    curve = basis.evaluate(metal_coefficients(base, edge, basis), cosines[:, None])
    error = curve - material.rgb_reflectance(cosines)
    assert np.sqrt(np.mean(error**2)) < 0.01
    assert np.abs(error).max() < 0.02


@pytest.mark.slow
def test_comparison_is_on_the_page(script) -> None:
    results = script.compare()
    best = min((n for n in results if script.WAYS[n][0] == "base colour"),
               key=lambda n: results[n]["rmse"])  # fmt: skip
    assert best == "usual edge, 4 terms"
    assert results["4 terms through both"]["rmse"] < results["F82"]["rmse"]
    page = (ROOT / "docs" / "principled.md").read_text(encoding="utf-8")
    for text in (script.table(results), script.range_table(), script.colour_table()):
        for line in text.splitlines():
            assert line in page


def test_bad_input() -> None:
    curves = np.ones((3, 4))
    with pytest.raises(InputError, match="1/7 among them"):
        fit_metal_edge([0.0, 0.5, 1.0], curves)
    with pytest.raises(InputError, match=r"\(3, curves\)"):
        fit_metal_edge([0.0, F82_COSINE, 1.0], curves[:, :1])
    with pytest.raises(InputError, match="not finite"):
        fit_metal_edge([0.0, F82_COSINE, 1.0], np.nan * curves)

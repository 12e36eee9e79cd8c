"""Plans: what is predicted, what is chosen, and what is left alone."""

from __future__ import annotations

import numpy as np
import pytest

from fresnel_decomp import (
    AlbedoTable,
    InputError,
    Schlick,
    conductor,
    directional_albedo,
    load_basis,
)
from fresnel_decomp.plan import LeftExact, plan_surfaces
from fresnel_decomp.prediction import Surface, differences, operations, predicted_error

GOLD = ([0.14, 0.37, 1.44], [3.98, 2.38, 1.60])
ALUMINIUM = ([1.66, 0.88, 0.52], [9.22, 6.27, 4.84])
GLASS = ([1.5], [0.0])


def test_smooth_surfaces_show_the_largest_error():
    eta, k = GOLD
    fit = Schlick.from_ior(np.array(eta), np.array(k))
    cos_theta = np.linspace(0.0, 1.0, 20001)[:, None]
    largest = np.abs(fit(cos_theta) - conductor(cos_theta, np.array(eta), np.array(k))).max()
    for surface in (Surface("gold", eta, k), Surface("gold", eta, k, (0.3, 0.3), np.inf)):
        assert predicted_error(surface, fit) == pytest.approx(largest, abs=1e-5)


def test_rough_surfaces_show_an_average():
    """No light of the assumed contrast makes a larger error than predicted."""
    eta, k = (np.array(v) for v in GOLD)
    fit = Schlick.from_ior(eta, k)
    largest = predicted_error(Surface("gold", eta, k), fit)
    for alpha in (0.05, 0.3, 0.8):
        surface = Surface("gold", eta, k, (alpha, alpha))
        predicted = predicted_error(surface, fit)
        assert predicted <= largest

        def error(c):
            return fit(c[..., None]) - conductor(c[..., None], eta, k)

        for mu in (0.11, 0.3, 0.9):
            # an even light over the whole lobe, and one over an uneven part of it
            white = directional_albedo(np.ones_like, mu, alpha)
            even = directional_albedo(error, mu, alpha)
            assert np.abs(even / white).max() <= predicted
            for edge in np.linspace(0.2, 0.95, 8):
                for sign in (-1.0, 1.0):

                    def lit(c, edge=edge, sign=sign):
                        return 1.0 * (sign * (c - edge) > 0.0)

                    share = directional_albedo(lit, mu, alpha) / white
                    if share < 1.0 / (1.0 + surface.contrast):
                        continue  # more contrast than assumed
                    seen = directional_albedo(lambda c: error(c) * lit(c)[..., None], mu, alpha)
                    assert np.abs(seen / (share * white)).max() <= 1.001 * predicted


def test_more_contrast_predicts_more():
    eta, k = (np.array(v) for v in GOLD)
    fit = Schlick.from_ior(eta, k)
    errors = [
        predicted_error(Surface("gold", eta, k, (0.2, 0.4), contrast), fit)
        for contrast in (0.0, 0.1, 10.0, np.inf)
    ]
    assert np.all(np.diff(errors) >= 0.0)
    assert errors[0] < errors[1] < errors[2]
    assert errors[2] == errors[3]  # never more than the largest error of the curve


def test_colour_differences():
    eta, k = (np.array(v) for v in GOLD)
    fit = Schlick.from_ior(eta, k)
    surface = Surface("gold", eta, k)
    assert 1.0 < predicted_error(surface, fit, "delta-e") < 10.0
    assert predicted_error(surface, lambda c: conductor(c, eta, k), "delta-e") == 0.0
    # one wavelength each: a grey spectrum has the colour difference of the grey
    wavelengths = np.linspace(360.0, 830.0, 48)
    spectral = Surface("glass", np.full(48, 1.5), np.zeros(48), wavelength_nm=wavelengths)
    grey = Surface("glass", [1.5] * 3, [0.0] * 3)
    expected = predicted_error(grey, Schlick(0.04), "delta-e")
    assert predicted_error(
        spectral, lambda c: Schlick(np.full(48, 0.04))(c), "delta-e"
    ) == pytest.approx(expected, abs=0.02)


def test_tighter_bounds_cost_more():
    surfaces = [Surface("gold", *GOLD), Surface("aluminium", *ALUMINIUM), Surface("glass", *GLASS)]
    costs = []
    for bound in (0.2, 0.03, 0.01, 0.003):
        plan = plan_surfaces(surfaces, bound, own_basis=False)
        assert [choice.surface for choice in plan.choices] == surfaces
        assert all(choice.error <= bound for choice in plan.choices)
        costs.append((sum(c.model == "exact" for c in plan.choices), plan.operations))
        for choice in plan.choices:
            if choice.model == "decomposition":
                assert plan.basis is not None
                expected = plan.basis.coefficients(choice.surface.eta, choice.surface.k)
                np.testing.assert_array_equal(choice.coefficients, expected)
                assert choice.operations == operations(
                    "decomposition", len(choice.surface.eta), plan.basis
                )
    assert costs == sorted(costs)
    loose = plan_surfaces(surfaces, 0.2, own_basis=False)
    assert [choice.model for choice in loose.choices] == ["schlick"] * 3
    assert loose.basis is None
    assert loose.tables == ()
    assert loose.nbytes == 4 * 7  # a number for each channel


def test_nothing_is_left_out_for_the_cheapest():
    """Brute force over all shipped bases finds no cheaper one that keeps the bound."""
    from fresnel_decomp.recipes import RECIPES

    surface, bound = Surface("gold", *GOLD), 0.004
    plan = plan_surfaces([surface], bound, own_basis=False)
    cheapest = []
    for recipe in RECIPES:
        for terms in (3, 4, 5, 6):
            basis = load_basis(recipe, terms)
            c = basis.coefficients(surface.eta, surface.k, poor_fit="keep")
            error = predicted_error(surface, lambda x, b=basis, c=c: b.closed_form.evaluate(c, x))
            if error <= bound:
                cheapest.append(operations("decomposition", 3, basis))
    assert plan.choices[0].operations == min(cheapest)


@pytest.mark.slow
def test_a_basis_of_its_own_needs_fewer_terms():
    surfaces = [Surface("gold", *GOLD)]
    shipped = plan_surfaces(surfaces, 0.01, own_basis=False)
    own = plan_surfaces(surfaces, 0.01)
    assert own.operations <= shipped.operations
    assert own.basis is not None
    if own.basis.recipe == "custom":
        assert own.choices[0].numbers < shipped.choices[0].numbers


def test_total_reflection_stays_exact():
    surfaces = [Surface("water from below", [1.0 / 1.333], [0.0]), Surface("gold", *GOLD)]
    plan = plan_surfaces(surfaces, 0.01, own_basis=False)
    assert plan.choices[0].model == "exact"
    assert "total internal reflection" in plan.choices[0].why
    assert plan.choices[1].model == "decomposition"


def test_image_based_light_gets_a_table():
    rough = Surface("gold", *GOLD, (0.2, 0.4))
    plan = plan_surfaces([rough], 0.002, own_basis=False)
    (table,) = plan.tables
    assert table.enough
    assert table.error <= 2e-4
    assert table.nbytes == 2 * (4 if table.channels <= 4 else 8) * table.size**2
    smooth = plan_surfaces([Surface("gold", *GOLD)], 0.002, own_basis=False)
    assert smooth.tables == ()


@pytest.mark.parametrize("metric", ["reflectance", "delta-e"])
def test_tables_are_for_the_distribution_and_in_the_metric(metric):
    surfaces = [
        Surface("gold", *GOLD, (0.5, 0.5), distribution="beckmann"),
        Surface("brass", [0.5, 0.6, 1.2], [3.0, 2.6, 1.8], (0.3, 0.3)),
    ]
    bound = {"reflectance": 0.004, "delta-e": 0.5}[metric]
    plan = plan_surfaces(surfaces, bound, metric, own_basis=False)
    assert [table.distribution for table in plan.tables] == ["beckmann", "ggx"]
    mu = np.linspace(0.1, 1.0, 7) ** 2
    for choice, table in zip(plan.choices, plan.tables, strict=True):
        surface = choice.surface
        baked = AlbedoTable.bake(plan.basis, table.size, distribution=surface.distribution)
        c, alpha = choice.coefficients, surface.alpha[0]
        exact = directional_albedo(plan.basis, mu, alpha, distribution=surface.distribution)
        pair = [functions @ c.T for functions in (exact, baked.lookup(mu, alpha))]
        # the same views are among those of the plan: equal but for rounding
        largest = np.abs(differences(surface, *pair, metric)).max()
        assert largest <= table.error * (1.0 + 1e-9)
        assert table.enough == (table.error <= 0.1 * bound)


def test_a_table_that_is_not_enough_says_so():
    plan = plan_surfaces([Surface("gold", *GOLD, (1e-3, 1.0))], 3e-4, own_basis=False)
    if plan.tables:
        (table,) = plan.tables
        assert not table.enough
        assert table.size == 128


def test_one_channel_takes_what_is_cheapest():
    """Six terms cost more than the exact equations there, but can be averaged."""
    eta, k = [1.66], [9.22]
    smooth = plan_surfaces([Surface("mirror", eta, k)], 0.002, own_basis=False)
    assert smooth.choices[0].model == "exact"
    rough = plan_surfaces([Surface("satin", eta, k, (0.2, 0.2))], 0.002, own_basis=False)
    assert rough.choices[0].model == "decomposition"


def test_no_surface_nothing_to_carry():
    left = LeftExact("window", "dielectric", "no counterpart", surface=Surface("window", *GLASS))
    plan = plan_surfaces([], 0.01, left=[left])
    assert plan.choices == ()
    assert plan.basis is None
    assert plan.nbytes == plan.operations == 0
    assert "terms" in plan.left[0].gain


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((0.0,), {}, "max_error=0"),
        ((float("nan"),), {}, "max_error=nan"),
        ((0.1, "psnr"), {}, "metric='psnr' is unknown"),
        ((0.1,), {"recipes": ["tlak"]}, "recipe='tlak' is unknown"),
    ],
)
def test_bad_input(arguments, options, message):
    with pytest.raises(InputError, match=message):
        plan_surfaces([], *arguments, **options)
    with pytest.raises(InputError, match="alpha="):
        Surface("x", [1.5], [0.0], (0.0, 0.1))
    with pytest.raises(InputError, match="contrast="):
        Surface("x", [1.5], [0.0], None, -1.0)
    with pytest.raises(InputError, match="eta=-1"):
        Surface("x", [-1.0], [0.0])
    for wavelength in ([500.0], [500.0, 400.0], [400.0, float("nan")]):
        with pytest.raises(InputError, match="2 ascending wavelengths"):
            Surface("x", [1.5, 1.4], [0.0, 0.0], wavelength_nm=wavelength)
    with pytest.raises(InputError, match="2 channels"):
        predicted_error(Surface("x", [1.5, 1.4], [0.0, 0.0]), Schlick(0.04), "delta-e")
    with pytest.raises(InputError, match="without a basis"):
        operations("decomposition", 3)

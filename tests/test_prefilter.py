"""Blurred environments against closed forms, quadrature and quasi-Monte Carlo."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp._check import InputError
from fresnel_decomp.mitsuba.environment import Environment, texel_directions
from fresnel_decomp.mitsuba.prefilter import blurred, prefilter, split_light
from fresnel_decomp.mitsuba.skies import city
from test_environment import random_directions, random_map


def lobe_average(alpha: float) -> float:
    """Mean cosine of mirrored light at normal incidence, weighed as Karis does.

    GGX from its slopes, p = tan of the normal's angle in units of alpha: an independent formula.
    """

    def density(p: float) -> float:
        return 2.0 * p / (1.0 + p * p) ** 2

    def cosine(p: float) -> float:
        return np.cos(2.0 * np.arctan(alpha * p))

    end = 1.0 / alpha  # light at the horizon
    top = quad(lambda p: density(p) * cosine(p) ** 2, 0.0, end, limit=200)[0]
    return top / quad(lambda p: density(p) * cosine(p), 0.0, end, limit=200)[0]


@pytest.mark.parametrize("alpha", [1.0, 0.6, 0.3, 0.08])
def test_first_harmonics_are_scaled(alpha: float) -> None:
    """A convolution scales 1 + n·a to 1 + lambda n·a (Funk and Hecke)."""
    axis = np.array([0.3, -0.5, 0.4])
    harmonic = texel_directions(256) @ axis
    light = Environment(np.repeat(1.0 + harmonic[..., None], 3, axis=2))
    found = blurred(light, alpha)[..., 1] - 1.0
    # the map is interpolated linearly between texels 1/40 apart: relative error 1e-4
    np.testing.assert_allclose(found, lobe_average(alpha) * harmonic, atol=2e-4)


@pytest.mark.parametrize("alpha", [0.002, 0.05, 1.0])
def test_uniform_light_stays_uniform(alpha: float) -> None:
    light = Environment(np.full((32, 64, 3), 0.7))
    for width in (64, 32, 16):
        np.testing.assert_allclose(blurred(light, alpha, width), 0.7, rtol=1e-6)


@pytest.mark.parametrize("alpha", [0.1, 0.5])
def test_city_against_quasi_monte_carlo(alpha: float) -> None:
    light = city(64)
    texels = texel_directions(64)[3:29:5, ::16].reshape(-1, 3)
    found = blurred(light, alpha)[3:29:5, ::16].reshape(-1, 3)
    expected = np.array([split_light(light, d, alpha, 2**15) for d in texels])
    # 2^15 points find the sun of the city to a few thousandths
    np.testing.assert_allclose(found, expected, rtol=0.01, atol=0.002)


def test_narrow_kernels_leave_smooth_maps_alone() -> None:
    harmonic = 1.0 + 0.5 * texel_directions(64)
    light = Environment(harmonic)
    np.testing.assert_allclose(blurred(light, 1e-3), light.radiance, atol=1e-4)


def test_fewer_columns_are_the_same_function() -> None:
    light = city(64)
    fine = blurred(light, 0.6)
    coarse = Environment(blurred(light, 0.6, 32))
    # sampled where the coarse grid has its texels; the fine one is interpolated there
    found, expected = coarse.radiance, Environment(fine).lookup(texel_directions(32))
    np.testing.assert_allclose(found, expected, rtol=0.01)


def test_turned_light_gives_turned_maps() -> None:
    light = random_map(32)
    turned = blurred(light.turned(5), 0.2)
    np.testing.assert_allclose(turned, np.roll(blurred(light, 0.2), 5, axis=1), rtol=1e-5)


def test_upside_down() -> None:
    light = random_map(32)
    mirrored = blurred(Environment(light.radiance[::-1]), 0.2)
    np.testing.assert_allclose(mirrored, blurred(light, 0.2)[::-1], rtol=1e-5)


def test_poles_have_one_value() -> None:
    found = blurred(city(64), 0.1)
    for row in (0, -1):
        np.testing.assert_allclose(found[row], np.tile(found[row, 0], (64, 1)), rtol=1e-5)


def test_levels_and_what_is_between() -> None:
    light = city(64)
    levels = prefilter(light, levels=5)
    np.testing.assert_allclose(levels.alphas, [0, 1 / 16, 1 / 4, 9 / 16, 1])
    directions = random_directions(60).astype(np.float64)
    np.testing.assert_allclose(
        levels.lookup(directions, 0.0), light.lookup(directions), rtol=1e-6
    )  # a mirror
    for level, alpha in zip(levels.levels, levels.alphas, strict=True):
        expected = Environment(level).lookup(directions)
        np.testing.assert_allclose(levels.lookup(directions, alpha), expected, rtol=1e-5)
    middle = levels.lookup(directions, 0.625**2)
    ends = levels.lookup(directions, 0.25) + levels.lookup(directions, 9 / 16)
    np.testing.assert_allclose(middle, 0.5 * ends, rtol=1e-5)
    # clamped
    np.testing.assert_allclose(levels.lookup(directions, 1.7), levels.lookup(directions, 1.0))
    assert levels.lookup(directions[0], 0.3).shape == (3,)


@pytest.mark.parametrize("backend", BACKENDS)
def test_lookup_with_drjit(backend: str) -> None:
    kind = float_type(backend)
    levels = prefilter(city(32), levels=4)
    directions = random_directions(50)
    alpha = np.linspace(0.0, 1.0, 50, dtype=np.float32)
    vector = [kind(np.ascontiguousarray(c)) for c in directions.T]
    expected = levels.lookup(directions, alpha)
    found = np.stack([np.array(c) for c in levels.lookup(vector, kind(alpha))], axis=-1)
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4)  # at the edge of the sun
    one = np.stack([np.array(c) for c in levels.lookup(vector, 0.3)], axis=-1)
    np.testing.assert_allclose(one, levels.lookup(directions, 0.3), rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_derivative_in_roughness(backend: str) -> None:
    import drjit as dr

    kind = float_type(backend, "float64")
    levels = prefilter(city(32), levels=4)
    directions = random_directions(20).astype(np.float64)
    vector = [kind(np.ascontiguousarray(c)) for c in directions.T]
    alpha = dr.full(kind, 0.3, 20)
    dr.enable_grad(alpha)
    dr.backward(dr.sum(levels.lookup(vector, alpha)[1]))
    step = 1e-6
    difference = levels.lookup(directions, 0.3 + step) - levels.lookup(directions, 0.3 - step)
    np.testing.assert_allclose(np.array(dr.grad(alpha)), difference[:, 1] / (2 * step), rtol=1e-6)


def test_progress_is_told() -> None:
    steps: list[float] = []
    prefilter(city(16), levels=5, progress=steps.append)
    assert steps == [0.25, 0.5, 0.75, 1.0]


@pytest.mark.parametrize("alpha", [0.0, -0.1, 1.1, np.nan, "rough", None])
def test_roughness_that_is_refused(alpha: float) -> None:
    with pytest.raises(InputError, match="alpha"):
        blurred(city(16), alpha)


def test_sizes_that_are_refused() -> None:
    with pytest.raises(InputError, match="width=12; accepted: an even divisor of 16"):
        blurred(city(16), 0.5, 12)
    with pytest.raises(InputError, match=r"width=8\.0; accepted"):
        blurred(city(16), 0.5, 8.0)  # type: ignore[arg-type]
    for levels in (1, 2.5, 3.0, "3", 5000):
        with pytest.raises(InputError, match=r"levels=.*; accepted: an integer from 2 to 4096"):
            prefilter(city(16), levels)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"direction": [0.0, 0.0, 0.0]}, "direction=.*not all 0"),
        ({"direction": [0.0, np.nan, 0.0]}, "direction=.*not all 0"),
        ({"direction": np.ones((2, 3))}, "direction=.*One direction at a time"),
        ({"direction": [0.0, 1.0]}, r"direction: .* shape \(2,\); accepted"),
        ({"alpha": np.nan}, "alpha=nan; accepted"),
        ({"alpha": 2.0}, r"alpha=2\.0; accepted"),
        ({"samples": 0}, "samples=0; accepted: an integer"),
        ({"samples": 8.0}, r"samples=8\.0; accepted: an integer"),
    ],
)
def test_estimates_that_are_refused(change: dict[str, Any], message: str) -> None:
    good: dict[str, Any] = {"direction": [0.0, 1.0, 0.0], "alpha": 0.3, "samples": 8}
    with pytest.raises(InputError, match=message):
        split_light(city(16), **{**good, **change})


@pytest.mark.parametrize("backend", AD_BACKENDS)
@pytest.mark.parametrize(("alpha", "step"), [(0.0, 1e-10), (1e-9, 1e-10), (1e-4, 1e-7)])
def test_derivative_where_the_axis_is_steep(backend: str, alpha: float, step: float) -> None:
    import drjit as dr

    kind = float_type(backend, "float64")
    levels = prefilter(city(32), levels=4)
    directions = random_directions(20).astype(np.float64)
    vector = [kind(np.ascontiguousarray(c)) for c in directions.T]
    roughness = dr.full(kind, alpha, 20)
    dr.enable_grad(roughness)
    dr.backward(dr.sum(levels.lookup(vector, roughness)[1]))
    ends = (levels.lookup(directions, a)[:, 1] for a in (alpha + step, alpha))
    slope = np.subtract(*ends) / step
    assert np.abs(slope).max() > 1.0  # the light's part is not lost
    # the root has a curvature: a step of 1e-3 of alpha errs by a quarter of that
    np.testing.assert_allclose(np.array(dr.grad(roughness)), slope, rtol=1e-3, atol=1e-4)


def test_what_is_no_number_gives_none() -> None:
    levels = prefilter(city(16), levels=3)
    good = [0.0, 0.6, 0.8]
    assert np.isnan(levels.lookup(good, np.nan)).all()
    for i in range(3):
        bad = np.array([good, good])
        bad[0, i] = np.nan
        for found in (levels.lookup(bad, [0.3, 0.3]), city(16).lookup(bad)):
            assert np.isnan(found[0]).all()
            assert np.isfinite(found[1]).all()
    assert np.isnan(levels.lookup([0.0, 0.0, 0.0], 0.3)).all()
    assert np.isnan(levels.lookup([0.0, np.inf, 0.0], 0.3)).all()
    for pole in (1.0, -1.0):
        assert np.isfinite(levels.lookup([0.0, pole, 0.0], 0.3)).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_is_no_number_gives_none_with_drjit(backend: str) -> None:
    kind = float_type(backend)
    levels = prefilter(city(16), levels=3)
    good = [kind(0.0), kind(0.6), kind(0.8)]
    assert all(np.isnan(np.array(c)).all() for c in levels.lookup(good, kind(np.nan)))
    assert all(np.isfinite(np.array(c)).all() for c in levels.lookup(good, 0.3))
    for i in range(3):
        bad = [kind(np.nan) if i == j else c for j, c in enumerate(good)]
        for found in (levels.lookup(bad, 0.3), city(16).lookup(bad)):
            assert all(np.isnan(np.array(c)).all() for c in found)


def test_directions_that_are_refused() -> None:
    levels = prefilter(city(16), levels=2)
    for bad in ([1.0, 2.0], np.ones((3, 2)), "up", 1.0, [1j, 0.0, 0.0]):
        with pytest.raises(InputError, match=r"direction.*accepted: a real array \(\.\.\., 3\)"):
            levels.lookup(bad, 0.3)


def test_drjit_directions_that_are_refused() -> None:
    kind = float_type("llvm")
    levels = prefilter(city(16), levels=2)
    with pytest.raises(InputError, match=r"direction of 2 Dr\.Jit arrays; accepted"):
        levels.lookup([kind(0.0), kind(1.0)], 0.3)
    import drjit as dr

    with pytest.raises(InputError, match="direction of Int, Int, Int; accepted"):
        levels.lookup([dr.int32_array_t(kind)(1)] * 3, 0.3)
    with pytest.raises(InputError, match=r"tensor of shape \(2, 3\); accepted"):
        levels.lookup(dr.tensor_t(kind)(np.ones((2, 3), np.float32)), 0.3)
    with pytest.raises(InputError, match=r"a NumPy array together with a Dr\.Jit array"):
        levels.lookup([kind(0.0), kind(1.0), kind(0.0)], np.ones(2))

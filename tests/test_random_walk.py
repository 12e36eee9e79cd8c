"""The random walk: conservation, its first two bounces by other means, its statistics."""

from __future__ import annotations

import numpy as np
import pytest

from fresnel_decomp import InputError, conductor, directional_albedo
from fresnel_decomp.microfacet import ndf, projected_area
from fresnel_decomp.random_walk import random_walk_albedo, signed_lambda

CASES = [(0.05, 0.1), (0.3, 0.3), (0.9, 0.6), (0.5, 1.0), (1.0, 1.0)]


def metals(cos_theta):
    """A perfect mirror, gold in blue and beryllium."""
    c = np.asarray(cos_theta)[..., None]
    return np.concatenate([1.0 + 0.0 * c, conductor(c, [1.38, 3.2], [1.92, 3.0])], axis=-1)


@pytest.mark.parametrize(("mu", "alpha"), CASES)
def test_nothing_is_lost(mu, alpha):
    walk = random_walk_albedo(lambda c: 1.0 + 0.0 * c, mu, alpha, 20_000)
    assert walk.unfinished == 0.0
    assert walk.albedo == pytest.approx(1.0, abs=1e-12)
    assert walk.by_bounce.sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(("mu", "alpha"), CASES)
def test_first_bounce_is_the_correlated_albedo(mu, alpha):
    """By Gauss quadrature. The separable model is another one: at (.05, 1) by .26."""
    n = 100_000
    walk = random_walk_albedo(metals, mu, alpha, n)
    expected = directional_albedo(metals, mu, alpha, smith="correlated")
    error = np.sqrt(expected * (1.0 - expected) / n)  # at most that of a coin
    assert np.all(np.abs(walk.by_bounce[0] - expected) < 4.5 * error)
    if alpha == 1.0:
        separable = directional_albedo(metals, mu, alpha)
        assert walk.by_bounce[0, 0] - separable[0] > 10.0 * error[0] or mu == 1.0


def test_second_bounce_by_uniform_sampling():
    """The same integral with nothing sampled in proportion: ranks, both directions uniformly.

    Of light that leaves after two bounces, with the phase function F D_w(h) / (4 w·h) written out.
    Normals that w sees have the density D_w(h) = w·h D(h) / sigma(w).
    """
    mu, alpha, n = 0.6, 0.7, 1_000_000
    random = np.random.default_rng(3)

    def sphere(lowest):
        z = random.uniform(lowest, 1.0, n)
        phi = random.uniform(0.0, 2.0 * np.pi, n)
        r = np.sqrt(1.0 - z * z)
        return np.stack([r * np.cos(phi), r * np.sin(phi), z])

    def sigma(z):  # projected area also from below: sigma(-z) = sigma(z) - z
        area = projected_area(np.abs(z), alpha)
        return np.where(z >= 0.0, area, area - np.abs(z))

    def phase(back, out):
        """Of a ray that came along -back and goes on along out."""
        h = back + out
        h /= np.sqrt((h * h).sum(axis=0))
        cosine = np.clip((back * h).sum(axis=0), 0.0, 1.0)
        density = ndf(tuple(h), alpha) / (4.0 * sigma(back[2]))
        return density[:, None] * metals(cosine)

    view = np.array([[0.8], [0.0], [mu]]) + np.zeros(n)
    first, last = sphere(-1.0), sphere(0.0)
    lambdas = [signed_lambda(w, alpha) for w in (np.full(n, -mu), first[2], last[2])]
    # rank of the first hit: density (1 + Lambda) c^Lambda; of the second, from c1 to c2
    c1 = random.random(n) ** (1.0 / -lambdas[0])
    escape = np.where(first[2] > 0.0, c1 ** np.abs(lambdas[1]), 0.0)
    u = escape + (1.0 - escape) * random.random(n)  # the survival (c1 / c2)^Lambda at the hit
    c2 = c1 * u ** (-1.0 / lambdas[1])
    leave = (1.0 - escape) * c2 ** lambdas[2]
    terms = phase(view, first) * phase(-first, last) * leave[:, None] * (4.0 * np.pi * 2.0 * np.pi)
    expected, error = terms.mean(axis=0), terms.std(axis=0) / np.sqrt(n)
    walk = random_walk_albedo(metals, mu, alpha, 200_000, seed=1)
    assert np.all(error < 0.01 * expected)
    spread = np.hypot(error, np.sqrt(walk.by_bounce[1] / 200_000))
    assert np.all(np.abs(walk.by_bounce[1] - expected) < 4.5 * spread)


def test_signed_lambda():
    z = np.linspace(0.01, 1.0, 50)
    above = signed_lambda(z, 0.4)
    np.testing.assert_allclose(above, projected_area(z, 0.4) / z - 1.0, atol=1e-12)
    np.testing.assert_allclose(signed_lambda(-z, 0.4), -1.0 - above)
    assert np.isfinite(signed_lambda(np.array([0.0, -0.0, 1.0, -1.0]), 0.4)).all()


def test_statistics():
    """Standard errors are those of repeated runs; a seed repeats a run; channels share paths."""
    runs = [random_walk_albedo(metals, 0.3, 0.8, 2000, seed=seed) for seed in range(40)]
    spread = np.std([run.albedo for run in runs], axis=0, ddof=1)
    stated = np.mean([run.standard_error for run in runs], axis=0)
    assert spread[0] < 1e-12
    np.testing.assert_allclose(spread[1:] / stated[1:], 1.0, atol=0.45)  # chi² of 39, 99.99 %
    again = random_walk_albedo(metals, 0.3, 0.8, 2000, seed=7)
    np.testing.assert_array_equal(again.albedo, runs[7].albedo)
    alone = random_walk_albedo(lambda c: metals(c)[..., 1], 0.3, 0.8, 2000, seed=7)
    assert alone.albedo == pytest.approx(runs[7].albedo[1], rel=1e-12)


def test_blocks_and_cuts():
    walk = random_walk_albedo(lambda c: 0.9 + 0.0 * c, 0.4, 1.0, 70_000, bounces=1)
    assert walk.by_bounce.shape == (1,)
    white = directional_albedo(lambda c: 1.0 + 0.0 * c, 0.4, 1.0, smith="correlated")
    assert walk.unfinished == pytest.approx(1.0 - white, abs=0.01)
    assert walk.albedo == pytest.approx(0.9 * (1.0 - walk.unfinished))


@pytest.mark.parametrize("mu", [0.0, 1e-9, 1.0])
@pytest.mark.parametrize("alpha", [1e-6, 1e-3, 1.0])
def test_limits(mu, alpha):
    walk = random_walk_albedo(metals, mu, alpha, 4000)
    assert np.all(np.isfinite(walk.albedo))
    assert walk.albedo[0] == pytest.approx(1.0)
    if alpha == 1e-6 and mu in (0.0, 1.0):
        np.testing.assert_allclose(walk.albedo, metals(np.array([mu]))[0], atol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mu": 1.5}, "mu in"),
        ({"mu": np.array([0.1, 0.2])}, "One view"),
        ({"alpha": 0.0}, "alpha in"),
        ({"samples": 1}, "samples=1"),
        ({"bounces": 0.5}, "bounces=0.5"),
        ({"seed": -1}, "seed=-1"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(InputError, match=message):
        random_walk_albedo(metals, **({"mu": 0.5, "alpha": 0.5} | arguments))

"""Least squares with noise on both sides: bias, bounds, standard errors."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize

from fresnel_decomp import InputError
from fresnel_decomp.inverse_fit import least_squares, nearest_feasible

X = np.array([0.8, -0.3])


def noisy(seed: int, m: int = 2000, spread: float = 0.4) -> tuple:
    """Columns rendered twice, each with as much noise as signal, and data of uneven noise."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(m, 2))
    deviation = rng.uniform(0.02, 0.3, m)
    twice = J + spread * rng.normal(size=(2, m, 2))
    return twice, np.zeros((2, m)), J @ X + deviation * rng.normal(size=m)


def test_noise_of_the_derivative_does_not_bias() -> None:
    found = np.array([least_squares(*noisy(s), np.ones(2000), np.zeros(2)).x for s in range(200)])
    mean_error = np.abs(found.mean(axis=0) - X)
    assert np.all(mean_error < 4.0 * found.std(axis=0) / np.sqrt(200.0))
    # plain least squares, with the mean of both renderings, is off by 1 / (1 + .4²/2)
    J, _, y = noisy(0)
    plain = np.linalg.lstsq(J.mean(axis=0), y, rcond=None)[0]
    assert abs(plain[0] - X[0]) > 0.04


def test_standard_errors_are_the_scatter() -> None:
    runs = [least_squares(*noisy(s), np.full(2000, 7.0), np.zeros(2)) for s in range(200)]
    z = np.array([(r.x - X) / r.standard_errors for r in runs])
    # the standard deviation of 400 z values is known to 3.5 %; four times that
    assert z.std() == pytest.approx(1.0, abs=0.14)


def test_what_data_do_not_tell_stays_and_has_no_standard_error() -> None:
    J = np.stack([np.ones(50), np.linspace(0, 1, 50), np.zeros(50)], axis=1)
    J[:, 2] = J[:, 1]  # only their sum is known
    result = least_squares([J, J], np.zeros((2, 50)), 2.0 + J[:, 1], np.ones(50), np.zeros(3))
    assert result.x == pytest.approx([2.0, 0.5, 0.5])
    assert np.isfinite(result.standard_errors[0])
    assert np.all(np.isinf(result.standard_errors[1:]))


def test_bounds_by_another_solver() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        root, x = rng.normal(size=(3, 3)), rng.normal(size=3)
        G = rng.normal(size=(12, 3))
        h = G @ rng.normal(size=3) - rng.uniform(0.0, 0.3, 12)  # feasible
        found = nearest_feasible(root, x, G, h)
        assert np.all(G @ found >= h - 1e-8)
        other = scipy.optimize.minimize(
            lambda p, root=root, x=x: np.sum((root @ (p - x)) ** 2),
            found + 0.1,
            constraints=[{"type": "ineq", "fun": lambda p, G=G, h=h: G @ p - h}],
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 500},
        )
        assert np.sum((root @ (found - x)) ** 2) <= other.fun * (1.0 + 1e-5) + 1e-9


def test_contradicting_bounds() -> None:
    with pytest.raises(InputError, match="contradict"):
        nearest_feasible(np.eye(1), [0.0], [[1.0], [-1.0]], [1.0, 1.0])


def test_too_few_data() -> None:
    J = np.ones((2, 1, 2))
    with pytest.raises(InputError, match="1 data for 2 unknowns"):
        least_squares(J, np.zeros((2, 1)), np.ones(1), np.ones(1), np.zeros(2))


@pytest.mark.parametrize("wrong", range(5))
def test_data_must_be_finite(wrong: int) -> None:
    given = [np.ones((2, 5, 1)), np.zeros((2, 5)), np.ones(5), np.ones(5), np.zeros(1)]
    given[wrong].flat[0] = np.nan
    with pytest.raises(InputError, match="data that are not finite"):
        least_squares(*given)
    given[wrong].flat[0] = 1.0
    given[3] = -np.ones(5)
    with pytest.raises(InputError, match="a weight of -1"):
        least_squares(*given)


@pytest.mark.parametrize("wrong", [2, 3])
def test_shapes_must_fit(wrong: int) -> None:
    """Each of target and weight by itself."""
    given = [np.ones((2, 5, 1)), np.zeros((2, 5)), np.ones(5), np.ones(5), np.zeros(1)]
    given[wrong] = np.ones(4)
    with pytest.raises(InputError, match=r"arrays of shapes .*\(4,\)"):
        least_squares(*given)

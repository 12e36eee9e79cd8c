"""Coefficients: how many, whether they fit, and their sum, for every kind of array."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from backends import BACKENDS, float_type
from fresnel_decomp import InputError
from fresnel_decomp._coefficients import check_count, check_terms, evaluated, weighted_sum


def functions(x: Any, y: Any) -> Any:
    """1, x and x y: an array, or for Dr.Jit a tuple."""
    if isinstance(x, np.ndarray | float) and isinstance(y, np.ndarray | float):
        return np.stack(np.broadcast_arrays(1.0 + 0.0 * x, x, x * y), axis=-1)
    return 1.0 + 0.0 * x, x, x * y


def test_counts() -> None:
    assert [check_count(terms) for terms in (3, np.int64(4), 6)] == [3, 4, 6]
    for wrong in (2, 7, 4.0, True, "4", None):
        with pytest.raises(InputError, match="accepted: 3, 4, 5 or 6"):
            check_count(wrong)


@pytest.mark.parametrize("backend", BACKENDS)
def test_sums_are_those_of_numpy(backend: str) -> None:
    """Whichever of coefficients and arguments are of Dr.Jit, and with NumPy's scalars beside."""
    kind = float_type(backend, "float64")
    c, x, y = [0.25, 0.5, -2.0], np.array([0.1, 0.2, 0.3]), 0.75
    expected = evaluated(functions, np.array(c), x, np.asarray(y))
    np.testing.assert_array_equal(expected, c[0] + c[1] * x + c[2] * x * y)
    calls = {
        "arguments": (c, kind(x), y),
        "one argument and NumPy's scalars": (list(np.array(c)), kind(x), np.float64(y)),
        "coefficients": ([kind([value] * 3) for value in c], 0.2, y),
    }
    for name, (coefficients, *at) in calls.items():
        wanted = expected[1] if name == "coefficients" else expected
        found = np.array(evaluated(functions, coefficients, *at))
        np.testing.assert_allclose(found, wanted, rtol=1e-15, err_msg=name)


def test_a_sum_over_the_last_axis() -> None:
    c = np.arange(12.0).reshape(4, 3)
    np.testing.assert_array_equal(weighted_sum(c, (1.0, 2.0, 3.0)), c @ [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(weighted_sum(list(c.T), (1.0, 2.0, 3.0)), c @ [1.0, 2.0, 3.0])


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_does_not_fit(backend: str) -> None:
    kind = float_type(backend)
    assert check_terms([1, 2, 3], 0.5, 3).tolist() == [1, 2, 3]
    for wrong in ([1.0, 2.0], np.ones((3, 2)), [kind(1.0)] * 2, kind([1.0, 2.0])):
        with pytest.raises(InputError, match="The basis has 3 terms"):
            check_terms(wrong, 0.5, 3)
    with pytest.raises(InputError, match="leading axes"):
        check_terms(np.ones((2, 3)), np.ones(4), 3)
    with pytest.raises(InputError, match=r"together with a Dr\.Jit array"):
        check_terms([kind(1.0)] * 3, np.ones(2), 3)

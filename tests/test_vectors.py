"""Three components, whatever holds them, and what is made of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from backends import BACKENDS, float_type
from fresnel_decomp import InputError
from fresnel_decomp._array import ops_for
from fresnel_decomp._vectors import as_triple, cross, dot, perpendicular, unit


def test_triples() -> None:
    assert as_triple([1, 2.5, 3]) == (1.0, 2.5, 3.0)
    assert all(type(part) is float for part in as_triple(np.float32([1, 2, 3])))
    many = np.arange(12.0).reshape(4, 3)
    np.testing.assert_array_equal(as_triple(many), many.T)
    rows = tuple(np.arange(15.0).reshape(3, 5))
    assert as_triple(rows) is rows


@pytest.mark.parametrize("backend", BACKENDS)
def test_triples_of_drjit(backend: str) -> None:
    kind = float_type(backend)
    found = as_triple((kind([1.0, 2.0]), 3.0, np.float64(4.0)))
    assert all(type(part) is kind for part in found)
    assert [float(part[0]) for part in found] == [1.0, 3.0, 4.0]


@pytest.mark.parametrize("wrong", [1.0, [1.0, 2.0], np.ones((3, 2)), "xyz", [1j, 0, 0], None])
def test_what_is_no_triple(wrong: Any) -> None:
    with pytest.raises(InputError, match=r"radiance: .*accepted: a real array \(\.\.\., 3\)"):
        as_triple(wrong, "radiance")


def test_perpendicular_and_unit() -> None:
    directions = np.random.default_rng(3).normal(size=(3, 1000))
    directions[:, :3] = np.eye(3)
    a = unit(ops_for(), tuple(directions))
    b = perpendicular(ops_for(), a)
    np.testing.assert_allclose(dot(a, a), 1.0, rtol=1e-15)
    np.testing.assert_allclose(dot(a, b), 0.0, atol=1e-15)
    assert np.sqrt(dot(b, b)).min() >= 0.5
    np.testing.assert_allclose(dot(cross(a, b), cross(a, b)), dot(b, b), rtol=1e-12)
    assert unit(ops_for(), (np.zeros(1),) * 3)[2].tolist() == [0.0]

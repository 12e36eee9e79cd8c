"""The quick sphere against the split-sum that it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fresnel_decomp import AlbedoTable, InputError, load_basis
from fresnel_decomp.mitsuba.prefilter import PrefilteredLight, prefilter
from fresnel_decomp.mitsuba.preview import SpherePreview
from fresnel_decomp.mitsuba.skies import city
from fresnel_decomp.mitsuba.split_sum import shade
from fresnel_decomp.split_albedo import SplitAlbedo

SIZE = 24


@pytest.fixture(scope="module")
def light() -> PrefilteredLight:
    return prefilter(city(32), levels=5)


@pytest.fixture(scope="module")
def gold() -> SplitAlbedo:
    basis = load_basis()
    indices = [0.13, 0.43, 1.38], [3.9, 2.5, 1.9]
    return SplitAlbedo(AlbedoTable.bake(basis, size=16), basis.coefficients(*indices))


def test_is_the_split_sum(light: PrefilteredLight, gold: SplitAlbedo):
    """Against `shade` with normals of its own; the four samples of a pixel averaged."""
    image = SpherePreview(SIZE, light)(gold, 0.3)
    for row, column in ((12, 12), (5, 9), (15, 20)):
        samples = []
        for dy in (0.25, 0.75):
            for dx in (0.25, 0.75):
                x, y = 2.0 * (column + dx) / SIZE - 1.0, 1.0 - 2.0 * (row + dy) / SIZE
                normal = [x, y, np.sqrt(1.0 - x * x - y * y)]
                samples.append(shade(light, gold, normal, [0.0, 0.0, 1.0], 0.3))
        np.testing.assert_allclose(image[row, column], np.mean(samples, axis=0), rtol=1e-5)


def test_around_it_is_the_background(light: PrefilteredLight, gold: SplitAlbedo):
    image = SpherePreview(SIZE, light, background=0.25)(gold, 0.3)
    assert np.all(image[[0, 0, -1, -1], [0, -1, 0, -1]] == 0.25)


def test_roughness_may_change_and_come_back(light: PrefilteredLight, gold: SplitAlbedo):
    sphere = SpherePreview(SIZE, light)
    first, other, again = (sphere(gold, alpha) for alpha in (0.1, 0.6, 0.1))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_default_light(gold: SplitAlbedo):
    image = SpherePreview(8)(gold, 0.2)
    assert image.shape == (8, 8, 3)
    assert np.all(np.isfinite(image))
    assert image[4, 4].max() > 0.0


@pytest.mark.parametrize("size", [1, 0, -3, 8.0, "8", None])
def test_sizes(light: PrefilteredLight, size: Any):
    with pytest.raises(InputError, match="an integer ≥ 2"):
        SpherePreview(size, light)


@pytest.mark.parametrize("alpha", [-0.1, 1.1, np.nan, "0.1"])
def test_roughnesses(light: PrefilteredLight, gold: SplitAlbedo, alpha: Any):
    with pytest.raises(InputError, match=r"a number in \[0, 1\]"):
        SpherePreview(SIZE, light)(gold, alpha)

"""Materials however they are given, and the errors that a report states for them."""

from __future__ import annotations

import numpy as np
import pytest

from fresnel_decomp import InputError, conductor, load_basis
from fresnel_decomp.report.curves import curve_errors
from fresnel_decomp.subjects import from_gulbrandsen, from_indices, from_material


def test_measured_material_has_white_balanced_indices():
    subject = from_material("copper")
    assert subject.name == "Cu"
    assert subject.material is not None
    f0 = conductor(1.0, subject.eta, subject.k)
    assert f0[0] > f0[1] > f0[2]  # copper is red


def test_indices_of_one_or_three_numbers():
    grey = from_indices([1.5], [0.0])
    assert grey.grey
    np.testing.assert_array_equal(grey.eta, [1.5, 1.5, 1.5])
    triple = from_indices([0.2, 0.92, 1.1], [3.9, 2.45, 2.14])
    assert not triple.grey
    assert triple.label == "η = (0.2, 0.92, 1.1), k = (3.9, 2.45, 2.14)"


def test_edge_tint_of_the_talk():
    subject = from_gulbrandsen([0.44], [0.0, 1.0, 0.0])
    np.testing.assert_allclose(conductor(1.0, subject.eta, subject.k), 0.44, rtol=1e-12)
    assert subject.k[0] == 0.0 < subject.k[1]


def test_names_are_usable_in_file_names():
    subjects = [from_indices([0.2, 1, 2], [1e-5]), from_gulbrandsen([0.5], [0.25])]
    for subject in subjects:
        assert not set(subject.name) & set("/\\ :*?\"<>|'")
    assert subjects[0].name != subjects[1].name


@pytest.mark.parametrize(
    ("make", "first", "second"),
    [
        (from_indices, [1.0, 2.0], [1.0]),
        (from_indices, [0.0], [1.0]),
        (from_indices, [1.0], [-1.0]),
        (from_indices, [float("inf")], [1.0]),
        (from_gulbrandsen, [1.0], [0.0]),
        (from_gulbrandsen, [0.5], [-0.1]),
        (from_gulbrandsen, [], [0.5]),
    ],
)
def test_bad_numbers(make, first, second):
    with pytest.raises(InputError, match="accepted"):
        make(first, second)


def test_curve_errors_agree_with_the_basis():
    subject, basis = from_material("Be"), load_basis()
    error = curve_errors(subject, basis)["decomposition"]
    channels = basis.error(subject.eta, subject.k)
    assert error.max == pytest.approx(channels.max.max(), rel=1e-9)
    assert error.mean == pytest.approx(channels.mean.mean(), rel=1e-9)
    assert error.rmse == pytest.approx(np.sqrt((channels.rmse**2).mean()), rel=1e-9)
    assert 0.0 < error.delta_e_mean < error.delta_e_max

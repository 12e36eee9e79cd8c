"""Training sets and reference sets."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from fresnel_decomp import CurveSet, InputError, conductor, curves
from oracles import textbook


def test_notebook_training_set():
    """As the notebook makes it: a loop over r, with its formulas."""
    indices = [(1.1, 0.0)]
    for i in range(1, 1000):
        r = i / 1000
        if r <= 0.01:
            reflectivity = (r / 0.01) / (1 - 1e-5) + 1e-5
            n = (1 - reflectivity) / (1 + reflectivity)  # edge tint 1
            k = np.sqrt((reflectivity * (n + 1) ** 2 - (n - 1) ** 2) / (1 - reflectivity))
            indices.append((abs(n), k))
        else:
            indices.append((1.01 + 1.99 * (r - 0.01) / 0.99, 0.0))
    expected = np.array(indices).T
    ours = curves.notebook_training_set()
    assert len(ours) == 1000
    np.testing.assert_allclose([ours.eta, ours.k], expected, rtol=1e-9)
    assert ours.eta[10] == pytest.approx(1e-5, rel=1e-4)  # the row with r > 1
    talk = curves.talk_training_set()
    np.testing.assert_array_equal(talk.eta, np.delete(ours.eta, 10))
    np.testing.assert_array_equal(talk.k, np.delete(ours.k, 10))
    assert talk.sha256 != ours.sha256


def test_reference_sets():
    a, cp, low = curves.dielectrics(), curves.gulbrandsen_grid(), curves.low_index_corner()
    assert [len(s) for s in (a, cp, low)] == [400, 3027, 320]
    assert (a.eta.min(), a.eta.max(), a.k.max()) == (1.01, 3.0, 0.0)
    assert cp.eta.max() <= 6.0
    f0 = conductor(1.0, cp.eta, cp.k)
    np.testing.assert_allclose(f0 * 64 - 0.5, np.round(f0 * 64 - 0.5), atol=1e-9)
    assert (low.eta.min(), low.eta.max(), low.k.min(), low.k.max()) == (0.05, 1.0, 0.5, 8.0)


def test_measured_metals():
    """15,846 curves: the gap of AlAs, and what would be interpolated into it, is left out."""
    metals = curves.measured_metals()
    assert len(metals) == 15846
    assert metals.eta.min() > 0.0
    assert metals.k.min() >= 0.0


def test_rescaled_curves():
    ours = CurveSet("x", [1.5, 0.2, 1.0 + 1e-9], [0.0, 3.0, 0.0])
    cos_theta = np.linspace(0.0, 1.0, 11)
    F = ours.reflectance(cos_theta)
    np.testing.assert_allclose(
        F[:2],
        np.mean(textbook(cos_theta, ours.eta[:2, None], ours.k[:2, None]), axis=0),
        rtol=1e-13,
    )
    rescaled = ours.rescaled(cos_theta)
    np.testing.assert_allclose(rescaled[:2], ((F - F[:, -1:]) / (1 - F[:, -1:]))[:2], atol=1e-14)
    np.testing.assert_array_equal(rescaled[:, 0], 1.0)
    np.testing.assert_array_equal(rescaled[:, -1], 0.0)
    np.testing.assert_allclose(ours.t0[:, 0], 1.0 - F[:, -1], atol=1e-15)


def test_identity_of_a_set():
    ours = CurveSet("x", [1.5, 0.25], [0.0, 3.0])
    data = np.array([1.5, 0.25, 0.0, 3.0], "<f8").tobytes()
    assert ours.sha256 == hashlib.sha256(data).hexdigest()
    assert CurveSet("y", np.array([1.5, 0.25]), np.array([0, 3])).sha256 == ours.sha256
    assert CurveSet("x", [1.5, 0.25], [0.0, 3.0 + 1e-15]).sha256 != ours.sha256


def test_bad_sets():
    with pytest.raises(InputError, match=r"shapes \(2,\) and \(3,\); accepted: .*\. Flatten"):
        CurveSet("x", [1.5, 1.6], [0.0, 0.0, 0.0])
    with pytest.raises(InputError, match=r"shapes \(1, 2\)"):
        CurveSet("x", [[1.5, 1.6]], [[0.0, 0.0]])
    for eta, k in ((-1.0, 0.0), (1.5, -1.0), (np.nan, 0.0), (1.5, np.inf)):
        with pytest.raises(InputError, match="at curve 1; accepted: finite eta > 0"):
            CurveSet("x", [1.5, eta], [0.0, k])


def test_error_cosines():
    everywhere, uniform = curves.error_cosines()
    assert (len(everywhere), len(uniform)) == (4150, 2049)
    np.testing.assert_array_equal(everywhere[:2049], uniform)
    np.testing.assert_allclose(np.diff(uniform), 1 / 2048, rtol=1e-12)
    assert (everywhere.min(), everywhere.max()) == (0.0, 1.0)
    assert np.sort(everywhere)[2] == pytest.approx(1e-6)

"""Curves within bounds, and indices from node colours."""

from __future__ import annotations

import numpy as np
import pytest

from fresnel_decomp import InputError, conductor, load_basis
from fresnel_decomp.inverse_curves import curve_limits, fit_curve_parameters, node_map
from fresnel_decomp.inverse_fit import nearest_feasible


def test_curves_keep_their_bounds() -> None:
    basis = load_basis()
    G, h = curve_limits(basis, (0.0, 1.0), True)
    x = nearest_feasible(np.eye(3), [0.95, 1.2, 0.7], G, h)
    a, M = node_map(basis)
    F = basis.evaluate(a + M @ x, np.sin(np.radians(np.linspace(90.0, 0.0, 91))))
    assert F.max() == pytest.approx(1.0, abs=1e-9)
    assert F.min() >= -1e-9


@pytest.mark.parametrize("kind", ["indices", "gulbrandsen"])
@pytest.mark.parametrize(("eta", "k"), [(0.18, 3.4), (3.4, 3.2), (1.5, 0.2), (1.37, 1.8)])
def test_indices_from_node_colours(kind: str, eta: float, k: float) -> None:
    basis = load_basis()
    cosines = np.cos([0.0, *basis.nodes])
    x = conductor(cosines, eta, k)
    fit = fit_curve_parameters(x, np.eye(3), 1e-8 * np.eye(3), kind, basis)
    if kind == "indices":
        assert fit.values == pytest.approx([eta, k], rel=1e-3)
        # to first order, an error of F moves the parameters by what the covariance says
        moved = fit_curve_parameters(
            x + np.array([1e-4, 0, 0]), np.eye(3), np.eye(3), kind, basis
        ).values
        assert np.all(np.abs(moved - fit.values) < 2.0 * np.sqrt(np.diag(fit.covariance)) + 1e-6)
    assert fit.misfit < 1e-12


def test_unknown_kind() -> None:
    with pytest.raises(InputError, match="Did you mean 'indices'"):
        fit_curve_parameters(np.full(3, 0.5), np.eye(3), np.eye(3), "indicse", load_basis())

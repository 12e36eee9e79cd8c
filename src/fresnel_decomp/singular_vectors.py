r"""Bases by singular vectors: the talk's iterative SVD, and the notebook's variant.

With F the (n, m) matrix of training curves on a grid uniform in cosine, both rules start from

    b_0 = 1,   b_1 = first right singular vector of (F - F0) / (1 - F0), over its value at grazing
                     incidence, where all these curves are 1 (and most have their maximum).

*deflation* (the talk's Eq. 6): from the residual F - F0 - (1 - F0) b_1 take the first right
singular vector b_2, fix its scale, fit every row's coefficient at one node, subtract, repeat.
Later vectors are made to vanish at earlier nodes by construction, so the node system is triangular.

*joint*: subtract b_1 from the rescaled curves and take all further vectors from one SVD.

A singular vector is a linear combination of training curves, so off the grid a basis function is
that same combination of exact curves evaluated there. Signs and scales of the others are fixed by
one rule: each function is divided by its value of largest magnitude on the grid, so that it peaks
at +1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ._check import choose, input_error
from ._coefficients import check_count
from .curves import CurveSet

__all__ = ["SIGN_RULE", "Extraction", "Rule", "extract"]

SIGN_RULE = "each function is divided by its value of largest magnitude on the grid: it peaks at +1"

Rule = Literal["deflation", "joint"]

NEGLIGIBLE = 1e-10
"""Magnitude of residuals that are taken for rounding errors."""


@dataclass(frozen=True, eq=False)
class Extraction:
    """Basis functions as linear combinations of training curves.

    Attributes
    ----------
    training : CurveSet
    nodes : (terms - 2,) interior nodes in radians
    weights : (terms - 1, n) weights of the curves' residuals, see `functions`
    fitted : (terms - 2, n) coefficients c_2... of each training curve that were subtracted before
        the next function was taken (zeros for the joint rule)
    rescaled : whether b_2... combine rescaled curves (joint) or reflectances (deflation)
    """

    training: CurveSet
    nodes: np.ndarray
    weights: np.ndarray
    fitted: np.ndarray
    rescaled: bool

    def functions(self, cos_theta: np.ndarray) -> np.ndarray:
        """(m, terms - 1): b_1, b_2, ... at any (m,) cosines, exactly as extracted."""
        residual = self.training.rescaled(cos_theta)
        functions = [self.weights[0] @ residual]
        residual -= functions[0]
        if not self.rescaled:
            residual *= self.training.t0
        for weights, fitted in zip(self.weights[1:], self.fitted, strict=True):
            functions.append(weights @ residual)
            residual -= fitted[:, None] * functions[-1]
        return np.stack(functions, axis=-1)


def extract(
    training: CurveSet,
    terms: int,
    rule: Rule = "deflation",
    nodes: Sequence[float] = (),
    grid: int = 1000,
) -> Extraction:
    """Extract `terms` basis functions (b_0 = 1 included) from a set of curves.

    Parameters
    ----------
    training : CurveSet of n curves
    terms : int in 3..6
    rule : "deflation" or "joint"
    nodes : up to terms - 2 floats in (0, pi/2)
        Interior nodes; the rest are chosen. By deflation: where the new function peaks. Jointly:
        the first at the maximum of b_2; the second at b_3's maximum or minimum, whichever is
        farther on the grid from the first; later ones where the new function differs most from
        its interpolant at the nodes so far (Barrault et al. 2004), which conditions the system.
    grid : number of cosines, uniform on [0, 1]

    Raises
    ------
    InputError
        For too few or too similar curves, terms outside 3..6, or nodes outside (0, pi/2) or
        repeated.
    """
    choose("rule", rule, ("deflation", "joint"))
    terms = check_count(terms)
    nodes = [float(node) for node in nodes][: terms - 2]
    if not all(0.0 < node < np.pi / 2 for node in nodes) or len(set(nodes)) < len(nodes):
        raise input_error(
            f"nodes {nodes}",
            "different angles in (0, pi/2), in radians",
            "0 and pi/2 are always used.",
        )
    if len(training) < terms:
        raise input_error(
            f"{len(training)} training curves for {terms} terms",
            "at least as many curves as terms",
            "Add materials to the training set.",
        )
    if grid < 4 * terms:
        raise input_error(
            f"grid={grid}", f"at least {4 * terms} cosines for {terms} terms", "1,000 are usual."
        )
    # given nodes ride along as extra columns that the SVD does not see
    cos_theta = np.append(np.linspace(0.0, 1.0, grid), np.cos(nodes))
    residual = training.rescaled(cos_theta)
    weights = _leading(residual[:, :grid], 1)
    # where metals dip below F0 deeply, b_1 has its largest magnitude there
    weights = weights / (weights @ residual[:, :1])
    residual = residual - weights[0] @ residual
    if rule == "joint":
        weights = np.concatenate([weights, _leading(residual[:, :grid], terms - 2)])
        chosen = nodes + _joint_nodes(weights[1:] @ residual[:, :grid], cos_theta, nodes)
        fitted = np.zeros((terms - 2, len(training)))
        return Extraction(training, np.array(chosen), weights, fitted, rescaled=True)

    residual = residual * training.t0
    chosen, fitted_rows = list(nodes), []
    for i in range(terms - 2):
        new = _leading(residual[:, :grid], 1)
        function = new[0] @ residual
        if i < len(nodes):
            column = grid + i
        else:
            column = int(np.argmax(np.abs(function[:grid])))
            chosen.append(float(np.arccos(cos_theta[column])))
        fitted_rows.append(residual[:, column] / function[column])
        residual = residual - fitted_rows[-1][:, None] * function
        weights = np.concatenate([weights, new])
    return Extraction(training, np.array(chosen), weights, np.array(fitted_rows), rescaled=False)


def _leading(matrix: np.ndarray, count: int) -> np.ndarray:
    """(count, n) weights w such that w @ matrix are the leading right singular vectors, peaking +1.

    ARPACK with a fixed start: only these vectors are computed, and the result is deterministic.
    """
    from scipy.sparse.linalg import svds

    if np.abs(matrix).max() > NEGLIGIBLE:
        left, _, _ = svds(matrix, k=count, v0=np.ones(min(matrix.shape)), tol=0.0)
        left = left.T[::-1]  # svds sorts ascending
        functions = left @ matrix
        peaks = functions[np.arange(count), np.argmax(np.abs(functions), axis=1)]
        if np.abs(peaks).min() > NEGLIGIBLE:
            return left / peaks[:, None]
    raise input_error(
        "a training set whose curves are combinations of fewer functions than terms",
        "curves that differ from each other",
        "Ask for fewer terms, or add different materials.",
    )


def _joint_nodes(
    functions: np.ndarray, cos_theta: np.ndarray, nodes: Sequence[float]
) -> list[float]:
    """Nodes for the functions after the given `nodes`, by the notebook's rule (see `extract`)."""
    columns = [int(np.argmin(np.abs(cos_theta[: functions.shape[1]] - np.cos(n)))) for n in nodes]
    for i in range(len(nodes), len(functions)):
        function = functions[i]
        if i == 0:
            columns.append(int(np.argmax(function)))
        elif i == 1:
            extremes = [int(np.argmax(function)), int(np.argmin(function))]
            columns.append(max(extremes, key=lambda extreme: abs(extreme - columns[0])))
        else:
            weights = np.linalg.solve(functions[:i, columns].T, function[columns])
            columns.append(int(np.argmax(np.abs(function - weights @ functions[:i]))))
    return [float(np.arccos(cos_theta[column])) for column in columns[len(nodes) :]]

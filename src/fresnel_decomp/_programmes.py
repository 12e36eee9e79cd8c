"""The linear and the quadratic programme behind `regression`, solved by cutting planes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from .closed_form import ClosedForm
from .fresnel import transmittance

if TYPE_CHECKING:
    from .curves import CurveSet
    from .regression import Design, Training

__all__ = ["Problem", "transmittances"]


class Functions(NamedTuple):
    """l_j = fixed_j + Σ_p X_jp free_p at some cosines."""

    fixed: np.ndarray  # (terms - 1, m)
    free: np.ndarray  # (r, m)


class Problem:
    """One design on one training: the error is linear in X, a (terms - 1, r) matrix."""

    def __init__(self, training: Training, design: Design, weights: Mapping[str, float]) -> None:
        self.training, self.design = training, design
        self.cosines = np.append(1.0, np.cos(design.nodes))
        n, m = design.degrees
        self.rank = n - len(design.nodes) - 1
        self.denominator = Polynomial([1.0, 1.0 / design.pole]) ** m
        self.chosen: set[tuple[str, int, int]] = set()
        self.at_nodes = {
            name: transmittances(s, self.cosines) for name, s in training.bounded.items()
        }
        self.everywhere = self.evaluate(training.cos_theta)
        self._quadratic(weights)

    def evaluate(self, cos_theta: np.ndarray) -> Functions:
        """All that l_j are made of."""
        q = self.denominator(cos_theta)
        ends = np.append(0.0, self.cosines)
        factors = cos_theta - ends[:, None]
        fixed = []
        for j in range(1, len(ends)):
            others = np.arange(len(ends)) != j
            lagrange = (factors[others] / (ends[j] - ends[others, None])).prod(axis=0)
            fixed.append(lagrange * (self.denominator(ends[j]) / q))
        polynomials = np.polynomial.chebyshev.chebvander(2.0 * cos_theta - 1.0, self.rank - 1).T
        return Functions(np.array(fixed), polynomials * (factors.prod(axis=0) / q))

    def _quadratic(self, weights: Mapping[str, float]) -> None:
        """Mean square = constant + |Z - Z_0|², with X = A^-T Z B^-1."""
        training = self.training
        fixed = training.observe(lambda c: self.evaluate(c).fixed, self.everywhere.fixed)
        free = training.observe(lambda c: self.evaluate(c).free, self.everywhere.free)
        gram = np.zeros((len(fixed),) * 2)
        cross = np.zeros_like(fixed)
        square = 0.0
        for name, weight in weights.items():
            seen, nodes = training.seen[name], self.at_nodes[name]
            if training.fitted is not training.bounded:
                nodes = transmittances(training.fitted[name], self.cosines)
            scaled = nodes.T * (weight / len(seen))
            gram += scaled @ nodes
            cross += scaled @ seen
            error = seen - nodes @ fixed
            square += (
                weight / len(seen) * float(np.einsum("im,im->m", error, error) @ training.weights)
            )
        right = ((cross - gram @ fixed) * training.weights) @ free.T
        a = np.linalg.cholesky(gram)
        b = np.linalg.cholesky((free * training.weights) @ free.T)
        self.a_inverse, self.b_inverse = np.linalg.inv(a), np.linalg.inv(b)
        self.centre = self.a_inverse @ right @ self.b_inverse.T
        self.constant = square - float((self.centre**2).sum())
        self.gram = gram

    def mean_square(self, z: np.ndarray) -> float:
        """The objective at Z."""
        return self.constant + float(((z - self.centre) ** 2).sum())

    def cardinal(self, z: np.ndarray) -> np.ndarray:
        """(terms - 1, angles): l_j for Z."""
        return self.everywhere.fixed + self.x(z) @ self.everywhere.free

    def x(self, z: np.ndarray) -> np.ndarray:
        return self.a_inverse.T @ z @ self.b_inverse

    def largest(self, name: str, z: np.ndarray) -> float:
        """Largest error on a set."""
        error = self.training.t_bounded[name] - self.at_nodes[name] @ self.cardinal(z)
        return float(np.abs(error).max())

    # --- constraints ---

    def violations(
        self, z: np.ndarray, bounds: Mapping[str, float], above: float
    ) -> tuple[float, set[tuple[str, int, int]]]:
        """Largest error in units of the bounds; the peaks above `above`, over angles."""
        cardinal, largest, found = self.cardinal(z), 0.0, set()
        columns = np.arange(cardinal.shape[1])
        for name, bound in bounds.items():
            error = self.training.t_bounded[name] - self.at_nodes[name] @ cardinal
            for rows in (error.argmax(axis=0), error.argmin(axis=0)):
                size = np.abs(error[rows, columns]) / bound
                largest = max(largest, float(size.max()))
                beside = np.pad(size, 1)
                peaks = (size > above) & (size >= beside[:-2]) & (size >= beside[2:])
                found |= {(name, int(rows[m]), int(m)) for m in np.flatnonzero(peaks)}
        return largest, found

    def rows(self, bounds: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """(rows, h): the error of the chosen curves at the chosen angles is h - rows @ vec(Z)."""
        rows, rest = [], []
        for name, bound in bounds.items():
            pairs = sorted((i, m) for n, i, m in self.chosen if n == name)
            if not pairs:
                continue
            i, m = np.array(pairs).T
            nodes = self.at_nodes[name][i]
            left = nodes @ self.a_inverse.T / bound
            right = self.everywhere.free[:, m].T @ self.b_inverse.T
            rows.append((left[:, :, None] * right[:, None, :]).reshape(len(i), -1))
            fixed = np.einsum("ij,ji->i", nodes, self.everywhere.fixed[:, m])
            rest.append((self.training.t_bounded[name][i, m] - fixed) / bound)
        return np.concatenate(rows), np.concatenate(rest)

    def least_maximum(
        self, bounds: Mapping[str, float], tolerance: float = 1e-4
    ) -> tuple[float, np.ndarray]:
        """(t, Z): the least t such that |error| <= t times the bounds, by cutting planes."""
        from scipy.optimize import linprog

        z, lower, best = self.centre, 0.0, (np.inf, self.centre)
        for _ in range(60):
            upper, found = self.violations(z, bounds, lower * (1.0 + tolerance / 2.0))
            best = min(best, (upper, z), key=lambda pair: pair[0])
            if best[0] <= lower * (1.0 + tolerance) or found <= self.chosen:
                break
            self.chosen |= found
            rows, rest = self.rows(bounds)
            one = -np.ones((len(rows), 1))
            result = linprog(
                np.append(np.zeros(z.size), 1.0),
                A_ub=np.block([[-rows, one], [rows, one]]),
                b_ub=np.concatenate([-rest, rest]),
                bounds=[(None, None)] * z.size + [(0.0, None)],
                method="highs",
            )
            z, lower = result.x[:-1].reshape(z.shape), float(result.x[-1])
        return best

    def least_squares(
        self, bounds: Mapping[str, float], tolerance: float = 1e-6
    ) -> tuple[np.ndarray, float]:
        """(Z, largest error in units of the bounds): least squares within them, cutting planes.

        In Z it is the point nearest to the centre that fulfils linear inequalities, which is
        solved by non-negative least squares (Lawson and Hanson 1974, chapter 23).
        """
        from scipy.optimize import nnls

        z, reached = self.centre, np.inf
        for _ in range(60):
            reached, found = self.violations(z, bounds, 1.0 + tolerance / 2.0)
            if reached <= 1.0 + tolerance or found <= self.chosen:
                break
            self.chosen |= found
            rows, rest = self.rows(bounds)
            inside = rest - rows @ self.centre.ravel()
            # |inside - rows @ step| <= 1: (rows, -rows) @ step >= (inside, -inside) - 1
            matrix = np.vstack([np.hstack([rows.T, -rows.T]), np.append(inside, -inside) - 1.0])
            scale = np.linalg.norm(matrix, axis=0)
            target = np.append(np.zeros(z.size), 1.0)
            try:
                multipliers = nnls(matrix / scale, target, maxiter=20 * matrix.shape[1])[0]
            except RuntimeError:
                return z, reached
            residual = matrix / scale @ multipliers - target
            if abs(residual[-1]) < 1e-11:  # the inequalities contradict each other
                return z, reached
            z = self.centre - (residual[:-1] / residual[-1]).reshape(z.shape)
        return z, reached

    # --- what comes out ---

    def closed_form(self, z: np.ndarray) -> ClosedForm:
        """The basis with its scale and signs."""
        x = self.x(z)
        c = Polynomial([0.0, 1.0])
        product = math.prod(c - node for node in self.cosines[1:])
        # without the factor 1 - c, which all but l_0 have
        numerators = []
        for j, row in enumerate(x):
            free = c * product * Chebyshev(row, domain=[0.0, 1.0]).convert(kind=Polynomial)
            if j:
                others = np.delete(self.cosines[1:], j - 1)
                at = self.cosines[j]
                lagrange = c * math.prod((c - o) / (at - o) for o in others)
                lagrange = lagrange / (at * (1.0 - at))
                numerators.append(lagrange * self.denominator(at) - free)
            else:
                lagrange = c * product / product(1.0)
                first = self.denominator - lagrange * self.denominator(1.0) - (c - 1.0) * free
        slopes = self.gram[0, 1:] / self.gram[0, 0]
        first = first // (1.0 - c) - sum(s * p for s, p in zip(slopes, numerators, strict=True))
        grid = np.linspace(0.0, 1.0, 1000)
        scaled = []
        for numerator in numerators:
            values = (1.0 - grid) * numerator(grid) / self.denominator(grid)
            scaled.append(numerator / values[np.argmax(np.abs(values))])
        rows = np.zeros((len(x), max(self.design.degrees[0], 1)))
        for row, polynomial in zip(rows, (first, *scaled), strict=True):
            row[: len(polynomial.coef)] = polynomial.coef
        rows[0, 0], rows[1:, 0] = 1.0, 0.0  # ends are exact
        return ClosedForm(rows, self.denominator.coef, 0.0)


def transmittances(members: CurveSet, cos_theta: np.ndarray) -> np.ndarray:
    """(n, m) 1 - F of all curves."""
    return transmittance(cos_theta, members.eta[:, None], members.k[:, None])

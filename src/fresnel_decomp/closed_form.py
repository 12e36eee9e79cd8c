r"""Basis functions in closed form: rationals in cos_theta with one shared denominator.

    b_j(c) = (1 - c) N_j(c) / Q(c),   N_1(0) = Q(0) = 1,   N_j(0) = 0 for j >= 2,   Q > 0 on [0, 1]

so the ends are exact (b_1 from 1 at grazing to 0 at normal incidence, the others 0 at both) and a
sum over the basis costs one division. The poles start from a set-valued AAA approximation
(Nakatsukasa, Sète and Trefethen 2018), which finds them near the branch points that the index of
refraction puts at cos_theta = ±i sqrt(n² - 1); they are then refined by variable projection with
Lawson's weights towards the least maximum error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._arguments import one_kind
from ._array import is_drjit, multiply_add, polynomial, read_only
from ._check import input_error
from ._coefficients import check_terms

__all__ = ["ClosedForm", "fit_closed_form"]


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """A basis b_1, b_2, ... as rationals with a shared, positive denominator.

    Attributes
    ----------
    numerators : (terms - 1, n) float
        Ascending coefficients of N_j; the factor (1 - cos_theta) is not included.
    denominator : (m + 1,) float
        Ascending coefficients of Q, the first of them 1.
    error : float
        Largest absolute distance to the extracted basis on [0, 1], over all functions.

    Examples
    --------
    >>> from fresnel_decomp import load_basis
    >>> form = load_basis().closed_form
    >>> form.terms, form.error < 1e-4
    (4, True)
    >>> form(0.2).shape
    (4,)
    """

    numerators: np.ndarray
    denominator: np.ndarray
    error: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "numerators", read_only(self.numerators))
        object.__setattr__(self, "denominator", read_only(self.denominator))

    @property
    def terms(self) -> int:
        """Number of basis functions, b_0 = 1 included."""
        return len(self.numerators) + 1

    def __call__(self, cos_theta: Any) -> Any:
        """(..., terms) values for NumPy input; a tuple of `terms` arrays for Dr.Jit input.

        As in a shader, cosines outside [0, 1] are not clamped.
        """
        if not is_drjit(cos_theta):
            cos_theta = np.asarray(cos_theta)
        scale = (1.0 - cos_theta) / polynomial(self.denominator, cos_theta)
        functions = [scale * polynomial(row, cos_theta) for row in self.numerators]
        values = (1.0 + 0.0 * cos_theta, *functions)
        return values if is_drjit(cos_theta) else np.stack(values, axis=-1)

    def evaluate(self, coefficients: Any, cos_theta: Any) -> Any:
        """Sum of c_i b_i with a single division: what a shader runs.

        Parameters
        ----------
        coefficients : (..., terms) array, or for Dr.Jit a sequence of `terms` arrays
        cos_theta : (...) float in [0, 1], not clamped

        Raises
        ------
        InputError
            If there are not `terms` coefficients, or shapes do not broadcast.
        """
        coefficients = check_terms(coefficients, cos_theta, self.terms)
        if is_drjit(cos_theta, *coefficients):
            cos_theta, *coefficients = one_kind(cos_theta, *coefficients)
        else:
            coefficients, cos_theta = np.moveaxis(coefficients, -1, 0), np.asarray(cos_theta)
        scale = (1.0 - cos_theta) / polynomial(self.denominator, cos_theta)
        total = coefficients[0]
        for coefficient, row in zip(coefficients[1:], self.numerators, strict=True):
            # the basis first, which all channels of a colour share
            total = multiply_add(coefficient, scale * polynomial(row, cos_theta), total)
        return total


def fit_closed_form(
    functions: Callable[[np.ndarray], np.ndarray], tolerance: float = 1e-4
) -> ClosedForm:
    """The cheapest rational form, in multiply-adds, within `tolerance` of given functions.

    Parameters
    ----------
    functions : callable from (m,) cosines to (m, terms - 1) values b_1, b_2, ...
    tolerance : float

    Returns
    -------
    ClosedForm

    Raises
    ------
    InputError
        If no form of degree up to 12 is good enough.
    """
    cos_theta = np.linspace(0.0, 1.0, 500) ** 2  # dense at grazing angles, where curves bend
    values = functions(cos_theta)
    check = np.linspace(0.0, 1.0, 1501) ** 2
    exact = functions(check)
    degrees = [(m, m + extra) for m in range(2, 13) for extra in (0, 1)]
    degrees.sort(key=lambda degree: degree[0] + degree[1] * values.shape[1])
    best = np.inf
    for m, n in degrees:
        candidate = _fit(cos_theta, values, m, n, tolerance)
        if candidate is None:
            continue
        error = float(np.abs(candidate(check)[:, 1:] - exact).max())
        best = min(best, error)
        if error <= tolerance and polynomial(candidate.denominator, check).min() > 0.0:
            return ClosedForm(candidate.numerators, candidate.denominator, error)
    raise input_error(
        f"no rational form within {tolerance:g} (best error {best:.2g})",
        "functions that are smooth on [0, 1]",
        "Loosen the tolerance, or train on curves with n farther from 1.",
    )


def _fit(
    cos_theta: np.ndarray, values: np.ndarray, m: int, n: int, tolerance: float
) -> ClosedForm | None:
    """Near-minimax rational of denominator degree m and total numerator degree n, or None."""
    from scipy.optimize import least_squares

    poles, aaa_error = _aaa(cos_theta, values, m)
    start = _factors(poles)
    if start is None or aaa_error > 100.0 * tolerance:  # Lawson gains a factor of 2 to 30
        return None
    parameters, pairs = start
    weights = np.ones_like(values)
    best_error, best = np.inf, None

    def residuals(parameters: np.ndarray) -> np.ndarray:
        denominator = _denominator(parameters, pairs)(cos_theta)
        if not np.all(np.isfinite(denominator)) or denominator.min() <= 0.0:
            return np.full(values.size, 1e3)
        _, error = _numerators(cos_theta, values, denominator, n, weights)
        return (error * np.sqrt(weights)).ravel()

    for iteration in range(30):
        parameters = least_squares(
            residuals, parameters, max_nfev=60 if iteration == 0 else 6, x_scale="jac"
        ).x
        polynomial_q = _denominator(parameters, pairs)
        numerators, error = _numerators(cos_theta, values, polynomial_q(cos_theta), n, weights)
        magnitude = np.abs(error)
        if magnitude.max() < best_error:
            best_error = magnitude.max()
            best = ClosedForm(numerators, polynomial_q.coef, best_error)
        if best_error < tolerance / 2.0 or (iteration >= 5 and best_error > 5.0 * tolerance):
            break
        weights = weights * (magnitude / magnitude.max() + 1e-3)  # Lawson: weigh the peaks
        weights /= weights.mean()
    return best


def _numerators(
    cos_theta: np.ndarray, values: np.ndarray, denominator: np.ndarray, n: int, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Least-squares N_j (degree n - 1, ascending) for a given denominator, and the errors."""
    free = np.polynomial.chebyshev.chebvander(2.0 * cos_theta - 1.0, n - 2)
    free *= (cos_theta * (1.0 - cos_theta) / denominator)[:, None]
    to_powers = np.polynomial.Polynomial([-1.0, 2.0])
    rows, errors = [], []
    for j, (target, weight) in enumerate(zip(values.T, weights.T, strict=True)):
        fixed = (1.0 - cos_theta) / denominator if j == 0 else 0.0
        # normal equations: small, and well conditioned in scaled Chebyshev polynomials unless
        # a denominator on its way to the optimum is extreme
        weighted = free.T * weight
        gram = weighted @ free
        scale = np.sqrt(np.diag(gram))
        right = weighted @ (target - fixed) / scale
        scaled = gram / np.outer(scale, scale)
        solution = np.linalg.lstsq(scaled, right, rcond=None)[0] / scale
        in_powers = np.polynomial.Chebyshev(solution)(to_powers).coef
        padded = np.pad(in_powers, (0, n - 1 - len(in_powers)))
        rows.append(np.append(1.0 if j == 0 else 0.0, padded))
        errors.append(free @ solution + fixed - target)
    return np.array(rows), np.stack(errors, axis=1)


def _denominator(parameters: np.ndarray, pairs: int) -> np.polynomial.Polynomial:
    """Q with Q(0) = 1 from quadratic factors (p, q): 1 + (p c + c²)/q, and linear ones 1 + t c."""
    q = np.polynomial.Polynomial([1.0])
    for p, constant in parameters[: 2 * pairs].reshape(-1, 2):
        q = q * np.polynomial.Polynomial([1.0, p / constant, 1.0 / constant])
    for slope in parameters[2 * pairs :]:
        q = q * np.polynomial.Polynomial([1.0, slope])
    return q


def _factors(poles: np.ndarray) -> tuple[np.ndarray, int] | None:
    """Parameters of `_denominator` for these poles and the number of pairs; None if unusable."""
    upper = poles[poles.imag > 1e-9]
    real = np.sort(poles[np.abs(poles.imag) <= 1e-9].real)
    if np.any((real >= 0.0) & (real <= 1.0)) or 2 * len(upper) + len(real) != len(poles):
        return None
    quadratics = np.stack([-2.0 * upper.real, np.abs(upper) ** 2], axis=1)
    return np.concatenate([quadratics.ravel(), -1.0 / real]), len(upper)


def _aaa(points: np.ndarray, values: np.ndarray, degree: int) -> tuple[np.ndarray, float]:
    """Poles and error of the set-valued AAA approximation of this degree to `values`."""
    from scipy.linalg import eigvals

    support: list[int] = []
    approximation = np.broadcast_to(values.mean(axis=0), values.shape)
    weights = np.ones(1)
    for _ in range(degree + 1):
        error = np.abs(approximation - values).max(axis=1)
        error[support] = -1.0
        support.append(int(np.argmax(error)))
        others = np.setdiff1d(np.arange(len(points)), support)
        cauchy = 1.0 / (points[others, None] - points[support])
        loewner = [
            (values[others, j, None] - values[support, j]) * cauchy for j in range(values.shape[1])
        ]
        weights = np.linalg.svd(np.concatenate(loewner), full_matrices=False)[2][-1]
        approximation = values.copy()
        approximation[others] = (cauchy @ (weights[:, None] * values[support])) / (
            cauchy @ weights
        )[:, None]
    size = len(support) + 1
    arrow, mass = np.zeros((size, size)), np.eye(size)
    arrow[0, 1:], arrow[1:, 0] = weights, 1.0
    arrow[1:, 1:] = np.diag(points[support])
    mass[0, 0] = 0.0
    poles = eigvals(arrow, mass)
    error = float(np.abs(approximation - values).max())
    return poles[np.isfinite(poles) & (np.abs(poles) < 1e6)], error

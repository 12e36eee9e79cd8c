"""What models must answer, from formulas as they were published and in plain NumPy.

Nothing here shares code with what kernels evaluate, except the extracted basis functions and, for
Lazanyi, the fit of two parameters. Benchmarks compare with these before they time anything; for
benign arguments only.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..basis import Basis
from ..models import Lazanyi

__all__ = ["decomposition", "exact", "f82", "gulbrandsen", "lazanyi", "schlick", "tabulated"]

Array = NDArray[np.float64]


def exact(cos_theta: Array, eta: Array, k: Array) -> Array:
    """Fresnel's equations as textbooks have them, in complex128; arguments broadcast."""
    m2 = (eta + 1j * k) ** 2
    root = np.sqrt(m2 - (1.0 - cos_theta**2))
    s = (cos_theta - root) / (cos_theta + root)
    p = (m2 * cos_theta - root) / (m2 * cos_theta + root)
    return (np.abs(s) ** 2 + np.abs(p) ** 2) / 2.0


def _f0(eta: Array, k: Array) -> Array:
    return ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)


def schlick(cos_theta: Array, eta: Array, k: Array) -> Array:
    """Schlick 1994, Eq. 15."""
    f0 = _f0(eta, k)
    return f0 + (1.0 - f0) * (1.0 - cos_theta) ** 5


def f82(cos_theta: Array, eta: Array, k: Array) -> Array:
    """Hoffman 2019: the factor of the correction from the exact value at cos = 1/7."""
    at = np.array(1.0 / 7.0)
    a = (schlick(at, eta, k) - exact(at, eta, k)) / (at * (1.0 - at) ** 6)
    return schlick(cos_theta, eta, k) - a * cos_theta * (1.0 - cos_theta) ** 6


def lazanyi(cos_theta: Array, eta: Array, k: Array) -> Array:
    """Lazanyi and Szirmay-Kalos 2005, with the parameters of `Lazanyi.from_ior`."""
    fit = Lazanyi.from_ior(eta, k)
    correction = fit.a * cos_theta * (1.0 - cos_theta) ** fit.exponent
    return schlick(cos_theta, eta, k) - correction


def gulbrandsen(cos_theta: Array, eta: Array, k: Array) -> Array:
    """Gulbrandsen 2014, Eqs. 3-6 as published, there and back, with the edge tint at most 1."""
    r = _f0(eta, k)
    least, most = (1.0 - r) / (1.0 + r), (1.0 + np.sqrt(r)) / (1.0 - np.sqrt(r))
    g = np.minimum((most - eta) / (most - least), 1.0)
    n = g * least + (1.0 - g) * most
    square = (r * (n + 1.0) ** 2 - (n - 1.0) ** 2) / (1.0 - r)
    return exact(cos_theta, n, np.sqrt(np.maximum(square, 0.0)))


def decomposition(basis: Basis, cos_theta: Array, eta: Array, k: Array) -> tuple[Array, Array]:
    """(n, m) sums of the extracted functions for (n,) indices, and (n, 1) sums of |c_1|, |c_2|, ...

    The coefficients solve the equations that define them: exact at both ends and at the nodes.
    """
    coefficients = _coefficients(basis, eta, k)
    return coefficients @ basis(cos_theta).T, _sizes(coefficients)


def tabulated(
    basis: Basis,
    size: int,
    storage: Literal["float32", "float16"],
    cos_theta: Array,
    eta: Array,
    k: Array,
) -> tuple[Array, Array]:
    """As `decomposition`, with functions interpolated in the square root of the cosine."""
    grid = np.linspace(0.0, 1.0, size)
    samples = basis(grid * grid).astype(storage).astype(np.float64)
    functions = [np.interp(np.sqrt(cos_theta), grid, column) for column in samples.T]
    coefficients = _coefficients(basis, eta, k)
    return coefficients @ np.array(functions), _sizes(coefficients)


def _coefficients(basis: Basis, eta: Array, k: Array) -> Array:
    cosines = np.array([1.0, 0.0, *np.cos(basis.nodes)])
    curves = exact(cosines, eta[:, None], k[:, None])
    return np.linalg.solve(basis(cosines), curves.T).T


def _sizes(coefficients: Array) -> Array:
    return np.asarray(np.abs(coefficients[:, 1:]).sum(axis=1, keepdims=True))

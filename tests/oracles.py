"""Independent references: Fresnel's equations as textbooks have them, and measures of error."""

from __future__ import annotations

import mpmath as mp
import numpy as np


def textbook(cos_theta, eta, k=0.0):
    """(R_s, R_p) in complex128, from r_s and r_p as they stand; for benign arguments."""
    cos_theta, eta, k = (np.asarray(v, np.float64) for v in (cos_theta, eta, k))
    m2 = (eta + 1j * k) ** 2
    root = np.sqrt(m2 - (1.0 - cos_theta**2))
    r_s = (cos_theta - root) / (cos_theta + root)
    r_p = (m2 * cos_theta - root) / (m2 * cos_theta + root)
    return np.abs(r_s) ** 2, np.abs(r_p) ** 2


def high_precision(cos_theta, eta, k=0.0, digits=200):
    """(R_s, R_p, T_s, T_p) as mpmath numbers, for floats of any magnitude."""
    with mp.workdps(digits):
        c, m2 = mp.mpf(float(cos_theta)), mp.mpc(float(eta), float(k)) ** 2
        root = mp.sqrt(m2 - (1 - c * c))
        if m2 == 1:
            return mp.mpf(0), mp.mpf(0), mp.mpf(1), mp.mpf(1)
        R_s = abs((c - root) / (c + root)) ** 2
        R_p = abs((m2 * c - root) / (m2 * c + root)) ** 2
        T_s = 4 * c * root.real / abs(c + root) ** 2
        T_p = 4 * c * (mp.conj(m2) * root).real / abs(m2 * c + root) ** 2
        assert abs(R_s + T_s - 1) + abs(R_p + T_p - 1) < mp.mpf(10) ** (20 - digits)
        return R_s, R_p, T_s, T_p


def high_precision_gradient(cos_theta, eta, k, digits=60):
    """Gradients wrt (cos_theta, eta, k) of (R_s, R_p), by differences at `digits` digits."""

    def component(i):
        def function(c, e, kk):
            m2 = mp.mpc(e, kk) ** 2
            root = mp.sqrt(m2 - (1 - c * c))
            factor = [1, m2][i]
            return abs((factor * c - root) / (factor * c + root)) ** 2

        return function

    point = [mp.mpf(float(v)) for v in (cos_theta, eta, k)]
    with mp.workdps(digits):
        return [
            [
                float(mp.diff(component(i), point, tuple(int(j == axis) for j in range(3))))
                for axis in range(3)
            ]
            for i in range(2)
        ]


def ulps(value, exact):
    """Errors of `value` (float32 or float64) in units in the last place of `exact` (float64)."""
    value, exact = np.asarray(value), np.asarray(exact, np.float64)
    spacing = np.spacing(np.abs(exact).astype(value.dtype)).astype(np.float64)
    return np.abs(value.astype(np.float64) - exact) / spacing


def mp_ulps(value, exact):
    """The same for one value against an mpmath number."""
    spacing = np.spacing(value.dtype.type(abs(float(exact))))
    with mp.workdps(60):
        return float(abs(mp.mpf(float(value)) - exact) / mp.mpf(float(spacing)))


def central_difference(function, x, step):
    """Fourth-order central difference of a NumPy function."""
    near = function(x + step) - function(x - step)
    far = function(x + 2.0 * step) - function(x - 2.0 * step)
    return (8.0 * near - far) / (12.0 * step)

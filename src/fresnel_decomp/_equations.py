r"""The Fresnel equations without cancellation, values and derivatives, for any kind of array.

`fresnel` has the formulas and the public functions; here they are in the order in which they are
evaluated. Two things decide that order. Accuracy: nothing is subtracted but what is X, Re(m² - 1)
and Re V, which carry the rounding errors of their squares. Speed: in the kernels of Dr.Jit the
number of operations decides, and a few square roots and quotients are no dearer than others; what
depends on the index alone stands apart, so that a compiler takes it out of a loop over angles.
docs/speed.md counts them.

No mask protects a quotient. D_s can vanish for m = 1 only: then W is made 1, which leaves R = 0
exactly, and T = 1 - R. Where W = 0 the quotient is not the one that is selected.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ._array import Ops

__all__ = ["components", "dielectric", "reflectance", "refraction"]

SQRT2, SQRT_HALF = 2.0**0.5, 0.5**0.5

Slopes = tuple[Any, Any, Any]
"""Partial derivatives wrt cos_theta, eta and k; None where not wanted."""
Wanted = tuple[bool, bool, bool]


class _Shared(NamedTuple):
    """What values and derivatives have in common; names as in the documentation of `fresnel`."""

    ops: Ops
    compensated: bool
    c: Any
    eta: Any
    k: Any
    c2: Any
    s2: Any
    s4: Any
    Xm: Any  # Re(m² - 1)
    norm: Any  # |m² - 1|²
    X: Any
    Y: Any
    Y2: Any  # Y²
    W: Any
    t: Any  # sqrt(W + |X|)
    A: Any  # sqrt(2) A
    Ac: Any  # 2 A c
    D_s: Any
    D_q: Any
    N: Any


def _shared(ops: Ops, c: Any, eta: Any, k: Any, compensated: bool) -> _Shared:
    # of the index alone
    k2 = k * k
    high, low = _one_minus_square(ops, eta, compensated)
    # where k² hides `low`, Y hides both: k² < eta² there
    low = low + k2
    Xm = -(high + low)
    Y = (eta + eta) * k
    Y2 = Y * Y
    norm = ops.multiply_add(Xm, Xm, Y2)  # |m² - 1|²
    c2 = c * c
    s2 = ops.one_minus_square(c) if compensated else 1.0 - c2
    X = _square_less(ops, c, c2, high, low, compensated)
    W = ops.sqrt(ops.multiply_add(X, X, ops.select(norm == 0.0, 1.0, Y2)))
    t = ops.sqrt(W + ops.abs(X))
    A = ops.where_negative(X, Y / t, t)
    Ac = A * (c * SQRT2)
    s4 = s2 * s2
    N = ops.multiply_add(W, c2, s4)
    D_s, D_q = (W + c2) + Ac, ops.multiply_add(Ac, s2, N)
    return _Shared(
        ops, compensated, c, eta, k, c2, s2, s4, Xm, norm, X, Y, Y2, W, t, A, Ac, D_s, D_q, N
    )


def reflectance(
    ops: Ops, c: Any, eta: Any, k: Any, compensated: bool, wanted: Wanted
) -> list[tuple[Any, Slopes]]:
    """[(R, its slopes), (T, its slopes)]."""
    q = _shared(ops, c, eta, k, compensated)
    both = 1.0 / (q.D_s * q.D_q)
    R = (q.norm * both) * (q.N * both * q.D_q)
    rest = q.D_q + (q.W + q.s2)
    R, T = _complements(ops, R, q.Ac * both * rest)
    if compensated:
        T = _small(ops, T, SQRT2 * q.A * both * rest, c)
    slopes = _reflectance_slopes(q, wanted)
    return [(R, slopes), (T, _negative(slopes))]


def components(
    ops: Ops, c: Any, eta: Any, k: Any, compensated: bool, wanted: Wanted
) -> list[tuple[Any, Slopes]]:
    """R_s, T_s, R_p, T_p, each with its slopes."""
    q = _shared(ops, c, eta, k, compensated)
    real_V = _real_V(q)
    imag_V = q.Y * q.c2
    R_s, T_s = q.norm / (q.D_s * q.D_s), (q.Ac + q.Ac) / q.D_s
    square = ops.multiply_add(real_V, real_V, imag_V * imag_V)
    R_p = R_s * (square / q.D_q / q.D_q)
    T_p = T_s * ((q.W + q.s2) / q.D_q)
    R_s, T_s = _complements(ops, R_s, T_s)
    R_p, T_p = _complements(ops, R_p, T_p)
    if compensated:
        T_over_c = 2.0 * SQRT2 * q.A / q.D_s
        T_s = _small(ops, T_s, T_over_c, c)
        T_p = _small(ops, T_p, T_over_c * ((q.W + q.s2) / q.D_q), c)
    of_s, of_p = _component_slopes(q, real_V, wanted)
    values = (R_s, T_s, R_p, T_p)
    slopes = (of_s, _negative(of_s), of_p, _negative(of_p))
    return list(zip(values, slopes, strict=True))


def _complements(ops: Ops, R: Any, T: Any) -> tuple[Any, Any]:
    """(R, T) with R + T = 1: the smaller as computed. For m = 1 that is R = 0."""
    keep_R = R <= T
    return ops.select(keep_R, R, 1.0 - T), ops.select(keep_R, 1.0 - R, T)


def _small(ops: Ops, T: Any, T_over_c: Any, c: Any) -> Any:
    """T at grazing incidence, where c times anything may underflow before T does."""
    return ops.select(T < 1e-20, T_over_c * c, T)


def _real_V(q: _Shared) -> Any:
    """Re V = (c eta)² + c² - 1 - (c k)²; near Brewster's angle nothing else is left of R_p.

    With lo = min and g = max - 1 of c eta and c it is (lo² + 2g) + g² - ..., whose sums are exact
    where the terms cancel (Sterbenz), as is g. Compensated even in float64 for float32 arguments.
    """
    ops = q.ops
    product = q.c * q.eta
    product_error = ops.fma(q.c, q.eta, -product)
    low, g = ops.minimum(product, q.c), ops.maximum(product, q.c) - 1.0
    square = low * low
    error = ops.fma(low, low, -square) + 2.0 * product * product_error
    ck = q.c * q.k
    return (ops.fma(g, g, square + 2.0 * g) + error) - ck * ck


# --- derivatives ---------------------------------------------------------------------------------
#
# With a + ib = conj(m) (A + iB) and u = 1/D_q²,
#
#     dR_s/deta + i dR_s/dk = h c (a + ib) (m² - 1),       h = 4 / (W D_s²),
#     dR_p/deta + i dR_p/dk = h c (a + ib) (m² - 1) (conj(m)² - 2s²) V u.
#
# Multiplied out as it stands the second one is lost to cancellation, for |m| >> 1 at grazing
# incidence and for |m| << 1 at normal incidence. Its factors but a + ib and u have the product
#
#     Q = (Xm (X - s²) + Y²) Re V + Y² c² (s² - c²)  +  i Y (c² (W² - s² (2X + 3s²)) + s²),
#
# whose imaginary part keeps Y as a factor. Re V = c² X - s⁴.


class _IndexSlopes(NamedTuple):
    """Factors of the derivatives wrt eta and k."""

    c: Any
    scale: Any  # h / (2 sqrt(2)), or twice that
    a: Any  # sqrt(2) a
    b: Any
    Q_real: Any
    Q_imag_over_Y: Any

    def times(self, ops: Ops, real: Any, imaginary: Any) -> tuple[Any, Any]:
        """c scale (a + ib) (real + i imaginary); c last, or the rest of it may underflow."""
        return (
            self.scale * ops.multiply_add(self.a, real, -(self.b * imaginary)) * self.c,
            self.scale * ops.multiply_add(self.a, imaginary, self.b * real) * self.c,
        )


def _index_slopes(q: _Shared, real_V: Any, over_D_s2_W: Any) -> _IndexSlopes:
    ops, c2, s2, X = q.ops, q.c2, q.s2, q.X
    B = ops.where_negative(X, q.t, q.Y / q.t)
    a = ops.multiply_add(q.eta, q.A, q.k * B)
    # 2ab = Y s²: the difference has no digits left at normal incidence, the quotient none for a = 0
    b = ops.where_negative(X, ops.multiply_add(q.eta, B, -(q.k * q.A)), q.Y * s2 / a)
    real = ops.multiply_add(q.Xm, X - s2, q.Y2)
    imaginary = ops.multiply_add(-s2, ops.multiply_add(s2, 3.0, X + X), q.W * q.W)
    return _IndexSlopes(
        q.c,
        over_D_s2_W,
        a,
        b,
        ops.multiply_add(real, real_V, q.Y2 * (c2 * (s2 - c2))),
        ops.multiply_add(c2, imaginary, s2),
    )


def _reflectance_slopes(q: _Shared, wanted: Wanted) -> Slopes:
    if not any(wanted):
        return None, None, None
    ops, c2, s2, X, W, N = q.ops, q.c2, q.s2, q.X, q.W, q.N
    u = 1.0 / (q.D_q * q.D_q)
    denominator = q.D_s * q.D_s * W
    over_D_s2_W = SQRT2 / denominator
    wrt_c = wrt_eta = wrt_k = None
    if wanted[0]:
        # dR_s/dc = -4 R_s A/W and dR_p/dc cancel at normal incidence; their sum has the factor s²
        bracket = c2 * ops.multiply_add(X + X, c2, W * W)
        rest = ops.multiply_add(W, ops.multiply_add(c2, 4.0, 1.0), q.s4)
        bracket = ops.multiply_add(-s2, rest, bracket)
        bracket = ops.multiply_add(-N, ops.multiply_add(q.Ac, 2.0, 1.0), bracket)
        wrt_c = (q.norm * q.A) * over_D_s2_W * ((s2 * u) * bracket)
    if wanted[1] or wanted[2]:
        f = _index_slopes(q, ops.multiply_add(c2, X, -q.s4), over_D_s2_W)
        real = ops.multiply_add(f.Q_real, u, q.Xm)
        wrt_eta, wrt_k = f.times(ops, real, q.Y * ops.multiply_add(f.Q_imag_over_Y, u, 1.0))
    return _where_positive(ops, denominator, (wrt_c, wrt_eta, wrt_k), wanted)


def _component_slopes(q: _Shared, real_V: Any, wanted: Wanted) -> tuple[Slopes, Slopes]:
    of_s: list[Any] = [None, None, None]
    of_p: list[Any] = [None, None, None]
    ops, c2, s2, W = q.ops, q.c2, q.s2, q.W
    denominator = q.D_s * q.D_s * W
    if any(wanted):
        u = 1.0 / (q.D_q * q.D_q)
        over_D_s2_W = 2.0 * SQRT2 / denominator
        G = W * W * c2 + 2.0 * s2 * c2 * q.X - s2 * (W + q.s4)
        minus_f = -(q.norm * q.A) * over_D_s2_W
        f = _index_slopes(q, real_V, over_D_s2_W)
        of_s = [minus_f, *f.times(ops, q.Xm, q.Y)]
        of_p = [-minus_f * (G * u), *f.times(ops, f.Q_real * u, f.Q_imag_over_Y * u * q.Y)]
    return (
        _where_positive(ops, denominator, of_s, wanted),
        _where_positive(ops, denominator, of_p, wanted),
    )


def _where_positive(ops: Ops, denominator: Any, slopes: Any, wanted: Wanted) -> Slopes:
    """0 where W = 0, and where a bad argument has made everything NaN."""
    regular = denominator > 0.0
    wrt_c, wrt_eta, wrt_k = (
        ops.select(regular, slope, 0.0) if want else None
        for slope, want in zip(slopes, wanted, strict=True)
    )
    return wrt_c, wrt_eta, wrt_k


def _negative(slopes: Slopes) -> Slopes:
    wrt_c, wrt_eta, wrt_k = (None if slope is None else -slope for slope in slopes)
    return wrt_c, wrt_eta, wrt_k


# --- dielectrics ---------------------------------------------------------------------------------


class _Dielectric(NamedTuple):
    """As `_Shared`, for k = 0."""

    c: Any
    eta: Any
    c2: Any
    s2: Any
    Xm: Any  # eta² - 1
    X: Any
    t: Any  # sqrt(X), 0 beyond the critical angle
    D_s: Any
    D_q: Any


def dielectric(
    ops: Ops, c: Any, eta: Any, compensated: bool, wanted: Wanted
) -> list[tuple[Any, Slopes]]:
    """[(R, slopes), (T, slopes)] for k = 0, where one square root is left: A = t, B = 0, or A = 0.

    R_s = (Xm/D_s)², T_s = 4 c t/D_s, D_q = (c t + s²)²; and with a = 1 - N/D_q = 2 c t s²/D_q, at
    most 1/2, R = R_s (1 - a) and T = T_s (1 - a) + a.
    """
    high, low = _one_minus_square(ops, eta, compensated)
    Xm = -(high + low)
    # for m = 1, X is made c² + 1: R = 0 whatever it is, and nothing is divided by 0
    low = ops.select(Xm == 0.0, -1.0, low)
    c2 = c * c
    s2 = ops.one_minus_square(c) if compensated else 1.0 - c2
    X = _square_less(ops, c, c2, high, low, compensated)
    t = ops.sqrt(ops.select(X < 0.0, 0.0, X))
    ct = c * t
    two_ct = ct + ct
    root_D_q = ct + s2
    D_s, D_q = (ops.abs(X) + c2) + two_ct, root_D_q * root_D_q
    over_D_s, a = 1.0 / D_s, two_ct * s2 / D_q
    half_T_s, root_half_R_s = two_ct * over_D_s, Xm * SQRT_HALF * over_D_s
    twice = ops.multiply_add(a, -2.0, 2.0)  # 2 N/D_q: from 1 to 2, so nothing is lost
    half_R_s = root_half_R_s * root_half_R_s
    R, T = _complements(ops, half_R_s * twice, ops.multiply_add(half_T_s, twice, a))
    if compensated:
        T_over_c = 2.0 * t * ops.multiply_add(over_D_s, twice, s2 / D_q)
        T = _small(ops, T, T_over_c, c)
    q = _Dielectric(c, eta, c2, s2, Xm, X, t, D_s, D_q)
    slopes = _dielectric_slopes(ops, q, wanted)
    return [(R, slopes), (T, _negative(slopes))]


def _dielectric_slopes(ops: Ops, q: _Dielectric, wanted: Wanted) -> Slopes:
    """Zero at and beyond the critical angle, and for m = 1."""
    if not any(wanted):
        return None, None, None
    c2, s2, X = q.c2, q.s2, q.X
    s4, two_ct = s2 * s2, q.c * (q.t + q.t)
    u = 1.0 / (q.D_q * q.D_q)
    over_D_s2_t = 2.0 / (q.D_s * q.D_s * q.t)
    wrt_c = wrt_eta = None
    if wanted[0]:
        N = ops.multiply_add(X, c2, s4)
        bracket = c2 * ops.multiply_add(X + X, c2, X * X)
        rest = ops.multiply_add(X, ops.multiply_add(c2, 4.0, 1.0), s4)
        bracket = ops.multiply_add(-s2, rest, bracket)
        bracket = ops.multiply_add(-N, ops.multiply_add(two_ct, 2.0, 1.0), bracket)
        wrt_c = (q.Xm * q.Xm) * over_D_s2_t * ((s2 * u) * bracket)
        wrt_c = ops.select(X > 0.0, wrt_c, 0.0)
    if wanted[1]:
        real_V = ops.multiply_add(c2, X, -s4)
        factor = ops.multiply_add((X - s2) * u, real_V, 1.0)
        wrt_eta = over_D_s2_t * (q.Xm * q.eta) * factor * q.c
        wrt_eta = ops.select(X > 0.0, wrt_eta, 0.0)
    return wrt_c, wrt_eta, None


def refraction(
    ops: Ops, c: Any, eta: Any, compensated: bool, wanted: Wanted
) -> list[tuple[Any, Slopes]]:
    """[(cosine of the refracted angle, its slopes)]: t / eta."""
    high, low = _one_minus_square(ops, eta, compensated)
    X = _square_less(ops, c, c * c, high, low, compensated)
    t = ops.sqrt(ops.select(X < 0.0, 0.0, X))
    cos_t = t / eta
    cos_t = ops.select(cos_t > 1.0, 1.0, cos_t)
    if not any(wanted):
        return [(cos_t, (None, None, None))]
    s2 = ops.one_minus_square(c) if compensated else 1.0 - c * c
    slope = ops.select(X > 0.0, 1.0 / (eta * t), 0.0)
    return [(cos_t, (slope * c, slope * (s2 / eta), None))]


def _one_minus_square(ops: Ops, x: Any, compensated: bool) -> tuple[Any, Any]:
    """(high, low) with high = 1 - x² rounded; their sum is exact for x <= 1.

    In float64 the square of a float32 is exact, and `low` is what 1 - x² loses; else the square has
    an error of its own. Beyond 1 nothing cancels and `low` does not matter.
    """
    if not compensated:
        square = x * x
        high = 1.0 - square
        return high, (1.0 - high) - square
    high = ops.fma(-x, x, 1.0)
    rest = 1.0 - high
    return high, ops.fma(-x, x, rest) + ((1.0 - rest) - high)


def _square_less(ops: Ops, c: Any, c2: Any, high: Any, low: Any, compensated: bool) -> Any:
    """c² - (high + low). Where these cancel, every sum is exact but the last one."""
    X = c2 - high
    if compensated:
        X = X + ops.fma(c, c, -c2)
    return X - low

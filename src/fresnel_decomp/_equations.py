r"""The Fresnel equations without cancellation, values and derivatives, for any kind of array.

`fresnel` has the formulas and the public functions; here they are in the order in which they are
evaluated. Two things decide that order. Accuracy: nothing is subtracted but X, Xm = Re(m² - 1) and
Re V, and these carry the rounding errors of their squares. Speed: in the kernels of Dr.Jit every
operation counts about the same, square roots and quotients included, so there is one of each where
two would do, and what depends on the index alone stands apart (a compiler takes it out of a loop
over angles).

A "half" in a name means a factor 1/2 that would otherwise be an operation. No mask protects a
quotient: for m = 1, the only index for which D_s can vanish, W is made 1, which leaves R = 0 exactly
and T = 1 - R; where W = 0 the quotient is not the one that is selected.
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
    Xm: Any  # Re(m² - 1)
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
    half_T_s: Any
    half_R_s: Any
    a: Any  # 2 A c s² / D_q = 1 - N/D_q, at most 1/2


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
    A = ops.select(X < 0.0, Y / t, t)
    Ac = A * (c * SQRT2)
    Acs2 = Ac * s2
    N = ops.multiply_add(W, c2, s2 * s2)
    D_s, D_q = (W + c2) + Ac, N + Acs2
    if compensated:
        half_T_s, a = Ac / D_s, Acs2 / D_q
        half_R_s = 0.5 * norm / (D_s * D_s)
    else:  # in float64 quotients are dear; the other type could not hold D_s D_q of large indices
        both = 1.0 / (D_s * D_q)
        over_D_s = D_q * both
        half_T_s, a = Ac * over_D_s, Acs2 * (D_s * both)
        half_R_s = 0.5 * norm * over_D_s * over_D_s
    return _Shared(
        ops, compensated, c, eta, k, c2, s2, Xm, X, Y, Y2, W, t, A, Ac, D_s, D_q, N,
        half_T_s, half_R_s, a,
    )  # fmt: skip


def reflectance(
    ops: Ops, c: Any, eta: Any, k: Any, compensated: bool, wanted: Wanted
) -> list[tuple[Any, Slopes]]:
    """[(R, its slopes), (T, its slopes)]."""
    q = _shared(ops, c, eta, k, compensated)
    twice = ops.multiply_add(q.a, -2.0, 2.0)  # 2 N/D_q: from 1 to 2, so nothing is lost
    T = ops.multiply_add(q.half_T_s, twice, q.a)
    R, T = _complements(ops, q.half_R_s * twice, T)
    if compensated:
        T_over_c = SQRT2 * ops.multiply_add(q.A / q.D_s, twice, q.A * q.s2 / q.D_q)
        T = _small(ops, T, T_over_c, c)
    slopes = _reflectance_slopes(q, wanted)
    return [(R, slopes), (T, _negative(slopes))]


def components(
    ops: Ops, c: Any, eta: Any, k: Any, compensated: bool, wanted: Wanted
) -> list[tuple[Any, Slopes]]:
    """R_s, T_s, R_p, T_p, each with its slopes."""
    q = _shared(ops, c, eta, k, compensated)
    real_V = _real_V(q)
    imag_V = q.Y * q.c2
    R_s, T_s = q.half_R_s + q.half_R_s, q.half_T_s + q.half_T_s
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
# incidence and for |m| << 1 at normal incidence. Its factors other than a + ib have the product
#
#     Q = ((E - 1)(E - 2s²) + Y²) Re V - Y² c² (c² - s²)  +  i Y (c² |m|⁴ - 4 c² s² E + s²)
#
# with E = eta² - k², whose imaginary part keeps Y as a factor.


class _IndexSlopes(NamedTuple):
    """Factors of the derivatives wrt eta and k."""

    scale: Any  # h c / (2 sqrt(2))
    a: Any  # sqrt(2) a
    b: Any
    Q_real: Any  # both times u
    Q_imag: Any


def _index_slopes(q: _Shared, E: Any, real_V: Any, u: Any) -> _IndexSlopes:
    ops, c2, s2 = q.ops, q.c2, q.s2
    Y_over_t = q.Y / q.t
    B = ops.select(q.X < 0.0, q.t, Y_over_t)
    a = ops.multiply_add(q.eta, q.A, q.k * B)
    # 2ab = Y s²: the difference has no digits left at normal incidence, the quotient none for a = 0
    b = ops.select(q.X < 0.0, ops.multiply_add(q.eta, B, -(q.k * q.A)), q.Y * s2 / a)
    M2 = ops.multiply_add(E, E, q.Y2)
    imaginary = ops.multiply_add(c2 * s2, -4.0 * E, ops.multiply_add(c2, M2, s2))
    real = ops.multiply_add(q.Xm, ops.multiply_add(s2, -2.0, E), q.Y2)
    # each product times u at once, so that large indices do not overflow
    Q_real = ops.multiply_add(real * u, real_V, (q.Y2 * u) * (c2 * (s2 - c2)))
    Q_imag = q.Y * (imaginary * u)
    scale = (q.c * SQRT2) / (q.D_s * q.D_s) * (1.0 / q.W)
    return _IndexSlopes(scale, a, b, Q_real, Q_imag)


def _reflectance_slopes(q: _Shared, wanted: Wanted) -> Slopes:
    if not any(wanted):
        return None, None, None
    ops, c2, s2, X, W, N = q.ops, q.c2, q.s2, q.X, q.W, q.N
    u = 1.0 / (q.D_q * q.D_q)
    wrt_c = wrt_eta = wrt_k = None
    if wanted[0]:
        # dR_s/dc = -4 R_s A/W and dR_p/dc cancel at normal incidence; their sum has the factor s²
        bracket = c2 * ops.multiply_add(X + X, c2, W * W)
        rest = ops.multiply_add(W, ops.multiply_add(c2, 4.0, 1.0), s2 * s2)
        bracket = ops.multiply_add(-s2, rest, bracket)
        bracket = ops.multiply_add(-N, ops.multiply_add(q.Ac, 2.0, 1.0), bracket)
        wrt_c = ((2.0 * SQRT2 * q.half_R_s) * q.A) * (1.0 / W) * ((s2 * u) * bracket)
    if wanted[1] or wanted[2]:
        E = _E(q)
        # next to Brewster's angle c² E - s² is what is left of s², or, if E is small, of X
        real_V = ops.select(
            ops.abs(E) < 1.0, ops.multiply_add(-s2, E, X), ops.multiply_add(c2, E, -s2)
        )
        f = _index_slopes(q, E, real_V, u)
        real, imaginary = q.Xm + f.Q_real, q.Y + f.Q_imag
        wrt_eta = f.scale * ops.multiply_add(f.a, real, -(f.b * imaginary))
        wrt_k = f.scale * ops.multiply_add(f.a, imaginary, f.b * real)
    return _where_regular(q, (wrt_c, wrt_eta, wrt_k), wanted)


def _E(q: _Shared) -> Any:
    """Re m²"""
    return (q.eta - q.k) * (q.eta + q.k)


def _component_slopes(q: _Shared, real_V: Any, wanted: Wanted) -> tuple[Slopes, Slopes]:
    of_s: list[Any] = [None, None, None]
    of_p: list[Any] = [None, None, None]
    if not any(wanted):
        return tuple(of_s), tuple(of_p)
    ops, c2, s2, W = q.ops, q.c2, q.s2, q.W
    u = 1.0 / (q.D_q * q.D_q)
    if wanted[0]:
        G = W * W * c2 + 2.0 * s2 * c2 * q.X - s2 * (W + s2 * s2)
        f_c = q.half_R_s * (4.0 * SQRT2 * q.A / W)
        of_s[0], of_p[0] = -f_c, f_c * (G * u)
    if wanted[1] or wanted[2]:
        f = _index_slopes(q, _E(q), real_V, u)
        scale = f.scale + f.scale
        for slopes, real, imaginary in ((of_s, q.Xm, q.Y), (of_p, f.Q_real, f.Q_imag)):
            slopes[1] = scale * ops.multiply_add(f.a, real, -(f.b * imaginary))
            slopes[2] = scale * ops.multiply_add(f.a, imaginary, f.b * real)
    return _where_regular(q, of_s, wanted), _where_regular(q, of_p, wanted)


def _where_regular(q: _Shared, slopes: Any, wanted: Wanted) -> Slopes:
    """0 where W = 0, and where a bad argument has made it NaN."""
    regular = q.W > 0.0
    wrt_c, wrt_eta, wrt_k = (
        q.ops.select(regular, slope, 0.0) if want else None
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
    half_R_s: Any


def dielectric(
    ops: Ops, c: Any, eta: Any, compensated: bool, wanted: Wanted
) -> list[tuple[Any, Slopes]]:
    """[(R, slopes), (T, slopes)] for k = 0, where one square root is left: A = t, B = 0, or A = 0.

    R_s = (Xm/D_s)², T_s = 4 c t/D_s, D_q = (c t + s²)².
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
    if compensated:
        half_T_s, a = two_ct / D_s, two_ct * s2 / D_q
        root_half_R_s = Xm * SQRT_HALF / D_s
    else:
        both = 1.0 / (D_s * D_q)
        over_D_s = D_q * both
        half_T_s, a = two_ct * over_D_s, two_ct * s2 * (D_s * both)
        root_half_R_s = Xm * SQRT_HALF * over_D_s
    twice = ops.multiply_add(a, -2.0, 2.0)
    half_R_s = root_half_R_s * root_half_R_s
    R, T = _complements(ops, half_R_s * twice, ops.multiply_add(half_T_s, twice, a))
    if compensated:
        T_over_c = 2.0 * ops.multiply_add(t / D_s, twice, t * s2 / D_q)
        T = _small(ops, T, T_over_c, c)
    q = _Dielectric(c, eta, c2, s2, Xm, X, t, D_s, D_q, half_R_s)
    slopes = _dielectric_slopes(ops, q, wanted)
    return [(R, slopes), (T, _negative(slopes))]


def _dielectric_slopes(ops: Ops, q: _Dielectric, wanted: Wanted) -> Slopes:
    """Zero at and beyond the critical angle, and for m = 1."""
    if not any(wanted):
        return None, None, None
    c2, s2, X = q.c2, q.s2, q.X
    u = 1.0 / (q.D_q * q.D_q)
    wrt_c = wrt_eta = None
    if wanted[0]:
        s4 = s2 * s2
        bracket = X * ops.multiply_add(s2, -6.0, X + 2.0)
        bracket = ops.multiply_add(c2, bracket, -(ops.multiply_add(s4, s2, s4) + X))
        N = ops.multiply_add(X, c2, s4)
        bracket = ops.multiply_add(q.c * q.t, -4.0 * N, bracket)
        wrt_c = ops.select(X > 0.0, q.half_R_s * (4.0 / q.t) * (s2 * u * bracket), 0.0)
    if wanted[1]:
        E = q.eta * q.eta
        V = ops.select(E < 1.0, ops.multiply_add(-s2, E, X), ops.multiply_add(c2, E, -s2))
        factor = ops.multiply_add(ops.multiply_add(s2, -2.0, E) * u, V, 1.0)
        scale = (q.c + q.c) / (q.D_s * q.D_s) / q.t
        wrt_eta = ops.select(X > 0.0, scale * (q.Xm * q.eta) * factor, 0.0)
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

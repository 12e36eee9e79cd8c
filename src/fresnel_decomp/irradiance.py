r"""Vector irradiance of polygons and ellipses, clipped by planes, in closed form.

The vector irradiance of a source of unit radiance, seen from the origin, is

    Phi = ∫ w dw = 1/2 ∮ r × dr / |r|²

over the directions w to it and along its border r, counter-clockwise as the origin sees it
(Lambert 1760; Arvo 1994, "The Irradiance Jacobian for Partially Occluded Polyhedral Sources").
Phi·n / pi is the form factor of a surface with normal n, if all of the source is above it: so
sources are clipped first, by any number of planes through the origin for polygons and by two for
ellipses.

- Along a straight edge from a to b the integral is half the angle between them times the normal of
  their plane. Clipped polygons are kept as lists of edges, in any order: a convex polygon leaves a
  half-space at one point and enters it at one, and the edge between these two closes it.
- An ellipse is the border of an elliptic cone. In the frame of its axes, r = (a cos s, b sin s, 1),
  both r × dr and |r|² are simple, and the integral over an arc is elementary: arctan for two
  components, artanh for the third. Over a whole ellipse it is along the axis,
  pi a b / sqrt((1 + a²)(1 + b²)) (Heitz and Hill 2017, "Real-Time Line- and Area-Light Shading").
  The axes are those of U Uᵀ + V Vᵀ - C Cᵀ for r = C + U cos t + V sin t, the inverse of the cone's
  quadric.

Formulas as in a shader, for Python floats, NumPy and Dr.Jit arrays; vectors are triples. Ellipses
are computed in float64, since the quadric squares what it is made of.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ._array import DrJitOps, Ops, drjit_module, is_drjit, ops_for
from ._vectors import Vector

__all__ = ["cross", "dot", "ellipse_irradiance", "polygon_irradiance"]

Edge = tuple[Vector, Vector]


def dot(a: Vector, b: Vector) -> Any:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def _scaled(a: Vector, factor: Any) -> Vector:
    return a[0] * factor, a[1] * factor, a[2] * factor


def _sum(*vectors: Vector) -> Vector:
    x, y, z = (sum(parts[1:], parts[0]) for parts in zip(*vectors, strict=True))
    return x, y, z


def _select(ops: Ops, mask: Any, a: Vector, b: Vector) -> Vector:
    x, y, z = (ops.select(mask, p, q) for p, q in zip(a, b, strict=True))
    return x, y, z


# --- polygons ------------------------------------------------------------------------------------


def polygon_irradiance(vertices: Sequence[Vector], planes: Sequence[Vector] = ()) -> Vector:
    """Vector irradiance of a convex polygon, or of what is above all planes of it.

    Parameters
    ----------
    vertices : sequence of triples of (...) float
        Counter-clockwise as seen from the origin; clockwise the result is negative.
    planes : sequence of triples of (...) float
        Normals, of any length; what has a negative product with any of them is cut off.

    Returns
    -------
    triple of (...) float
        At most pi long. Derivatives are finite; an edge through the origin has none.

    Examples
    --------
    A square of side 2 at distance 1 fills one side of a cube around the origin:

    >>> square = [(-1.0, -1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, 1.0), (-1.0, 1.0, 1.0)]
    >>> round(float(-polygon_irradiance(square[::-1])[2]), 4)
    1.7408
    """
    ops = ops_for(*(c for v in vertices for c in v), *(c for p in planes for c in p))
    if not isinstance(ops, DrJitOps):  # masks of Python's have another ~
        vertices, planes = (
            [(np.asarray(x)[()], np.asarray(y)[()], np.asarray(z)[()]) for x, y, z in vectors]
            for vectors in (vertices, planes)
        )
    edges: list[Edge] = list(zip(vertices, [*vertices[1:], vertices[0]], strict=True))
    for plane in planes:
        edges = _clipped(ops, edges, plane)
    return _scaled(_sum(*(_edge_integral(ops, a, b) for a, b in edges)), 0.5)


def _clipped(ops: Ops, edges: list[Edge], plane: Vector) -> list[Edge]:
    """Edges of a convex polygon above a plane: one more, of length 0 where nothing is cut."""
    x, y, z = plane
    zero = (0.0 * x, 0.0 * y, 0.0 * z)
    leave = enter = zero
    kept = []
    for a, b in edges:
        height_a, height_b = dot(plane, a), dot(plane, b)
        above_a, above_b = height_a > 0.0, height_b > 0.0
        leaves, enters = above_a & ~above_b, above_b & ~above_a
        crosses = leaves | enters
        fall = height_a - height_b
        t = ops.select(crosses, height_a, 0.0) / ops.select(crosses, fall, 1.0)
        point = _sum(_scaled(a, 1.0 - t), _scaled(b, t))
        kept.append(
            (
                _select(ops, above_a, a, _select(ops, enters, point, zero)),
                _select(ops, above_b, b, _select(ops, leaves, point, zero)),
            )
        )
        leave, enter = _select(ops, leaves, point, leave), _select(ops, enters, point, enter)
    return [*kept, (leave, enter)]


def _edge_integral(ops: Ops, a: Vector, b: Vector) -> Vector:
    """The angle between two vectors times the normal of their plane."""
    normal = cross(a, b)
    square = dot(normal, normal)
    proper = square > 0.0
    length = ops.sqrt(ops.select(proper, square, 1.0))
    angle = ops.arctan2(length, ops.select(proper, dot(a, b), 1.0))
    return _scaled(normal, ops.select(proper, angle / length, 0.0))


# --- ellipses ------------------------------------------------------------------------------------

_ROUND = 1e-12
"""Squared axes that differ by less than this share of their sum are those of a circle."""


def ellipse_irradiance(
    centre: Vector, u: Vector, v: Vector, planes: Sequence[Vector] = ()
) -> Vector:
    """Vector irradiance of an ellipse, or of what is above both planes of it.

    Parameters
    ----------
    centre, u, v : triples of (...) float
        Its points are centre + x u + y v with x² + y² ≤ 1. Counter-clockwise as seen from the
        origin, that is, with a positive determinant (u, v, centre); where that is not positive,
        the result is 0.
    planes : up to two triples of (...) float
        As for `polygon_irradiance`.

    Returns
    -------
    triple of (...) float, of the arguments' precision; computed in float64

    Examples
    --------
    A disk that is seen under 45° all around has half the irradiance of a hemisphere:

    >>> disk = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    >>> round(float(ellipse_irradiance(*disk)[2]) / math.pi, 4)
    0.5
    """
    if len(planes) > 2:
        raise ValueError("an ellipse is clipped by two planes at most")
    given = [centre, u, v, *planes]
    narrow, (centre, u, v, *planes) = _wide(given)
    ops = ops_for(*centre, *u, *v)
    cone = _Cone(ops, centre, u, v)
    total = cone.whole()
    if planes:
        arcs = [_Arc.above(ops, plane, centre, u, v) for plane in planes]
        part = _clipped_ellipse(ops, cone, arcs)
        cut = arcs[0].cut
        for arc in arcs[1:]:
            cut = cut | arc.cut
        total = _select(ops, cut, part, total)
    x, y, z = (narrow(component) for component in total)
    return x, y, z


def _wide(vectors: Sequence[Vector]) -> tuple[Any, list[Vector]]:
    """The way back, and the vectors in float64."""
    components = [c for vector in vectors for c in vector]
    if is_drjit(*components):
        dr = drjit_module()
        assert dr is not None
        kind = type(sum(0.0 * c for c in components))
        double = dr.float64_array_t(kind)
        wide = [tuple(double(kind(c)) for c in vector) for vector in vectors]
        return kind, wide
    dtype = np.result_type(*(np.asarray(c).dtype for c in components), np.float32)
    wide = [tuple(np.asarray(c, np.float64) for c in vector) for vector in vectors]
    return (lambda value: np.asarray(value, dtype)[()]), wide


class _Cone:
    """The elliptic cone of an ellipse: its axis, and where the border is on it."""

    def __init__(self, ops: Ops, centre: Vector, u: Vector, v: Vector) -> None:
        self.ops, self.centre, self.u, self.v = ops, centre, u, v
        volume = dot(cross(u, v), centre)
        self.faces = volume > 0.0
        volume = ops.select(self.faces, volume, 1.0)
        # without a cone, any that is one
        self.centre, self.u, self.v = (
            _select(ops, self.faces, vector, _scaled(_sum(vector, vector), 0.0))
            for vector in (centre, u, v)
        )
        unit = ops.select(self.faces, 0.0, 1.0)
        self.u = (self.u[0] + unit, self.u[1], self.u[2])
        self.v = (self.v[0], self.v[1] + unit, self.v[2])
        self.centre = (self.centre[0], self.centre[1], self.centre[2] + unit)
        self.volume = volume
        self._solve()

    def _solve(self) -> None:
        """The negative eigenvalue of U Uᵀ + V Vᵀ - C Cᵀ, and its eigenvector."""
        ops, c, u, v = self.ops, self.centre, self.u, self.v
        trace = dot(u, u) + dot(v, v) - dot(c, c)
        uv, uc, vc = cross(u, v), cross(u, c), cross(v, c)
        minors = dot(uv, uv) - dot(uc, uc) - dot(vc, vc)
        negative = self.volume * self.volume  # minus the determinant
        root = ops.detach(self._least_root(trace, minors))
        # Newton's steps on x³ - trace x² + minors x + negative; the last one has the derivative
        for step in range(4):
            value = ((root - trace) * root + minors) * root + negative
            slope = (3.0 * root - 2.0 * trace) * root + minors
            if step < 3:
                value, slope = ops.detach(value), ops.detach(slope)
            good = slope > 0.0
            root = root - ops.select(good, value, 0.0) / ops.select(good, slope, 1.0)
        depth = -root
        some = depth > 0.0
        self.depth = ops.select(some, depth, 1.0)
        slope = (3.0 * root - 2.0 * trace) * root + minors  # (w1 + depth) (w2 + depth)
        self.slope = ops.select(some & (slope > 0.0), slope, 1.0)
        rows = [
            tuple(
                u[i] * u[j] + v[i] * v[j] - c[i] * c[j] + (self.depth if i == j else 0.0)
                for j in range(3)
            )
            for i in range(3)
        ]
        # the adjugate is the axis times itself, up to a factor
        axis = _sum(
            _scaled(cross(rows[1], rows[2]), c[0]),
            _scaled(cross(rows[2], rows[0]), c[1]),
            _scaled(cross(rows[0], rows[1]), c[2]),
        )
        self.axis = _unit(ops, axis)

    def _least_root(self, trace: Any, minors: Any) -> Any:
        """The negative root, by the trigonometric formula."""
        ops = self.ops
        mean = trace / 3.0
        p = mean * mean - minors / 3.0
        p = ops.select(p > 0.0, p, 1e-300)
        root_p = ops.sqrt(p)
        q = 0.5 * (2.0 * mean * mean * mean - mean * minors - self.volume * self.volume)
        ratio = q / (p * root_p)
        ratio = ops.select(ratio > 1.0, 1.0, ops.select(ratio < -1.0, -1.0, ratio))
        angle = ops.arccos(ops.detach(ratio)) / 3.0
        return mean + 2.0 * root_p * ops.cos(angle + 2.0 * math.pi / 3.0)

    def whole(self) -> Vector:
        """Vector irradiance of the whole ellipse."""
        ops = self.ops
        # a b = volume / depth^1.5 and (1 + a²)(1 + b²) = slope / depth²
        size = math.pi * self.volume / ops.sqrt(self.depth * self.slope)
        return _scaled(self.axis, ops.select(self.faces, size, 0.0))

    def diagonalise(self) -> None:
        """The other two axes, the longer one first, and half the openings along them."""
        ops, axis = self.ops, self.axis
        side = _unit(ops, _perpendicular(ops, axis))
        other = cross(axis, side)
        parts = [[dot(w, f) for f in (side, other)] for w in (self.u, self.v, self.centre)]
        (u1, u2), (v1, v2), (c1, c2) = parts
        s11 = (u1 * u1 + v1 * v1 - c1 * c1) / self.depth
        s22 = (u2 * u2 + v2 * v2 - c2 * c2) / self.depth
        s12 = (u1 * u2 + v1 * v2 - c1 * c2) / self.depth
        mean, half = 0.5 * (s11 + s22), 0.5 * (s11 - s22)
        square = half * half + s12 * s12
        oval = square > (_ROUND * mean) * (_ROUND * mean)
        radius = ops.select(oval, ops.sqrt(ops.select(oval, square, 1.0)), 0.0)
        half, s12 = ops.select(oval, half, 1.0), ops.select(oval, s12, 0.0)
        turn = 0.5 * ops.arctan2(s12, half)
        cosine, sine = ops.cos(turn), ops.sin(turn)
        self.long = _sum(_scaled(side, cosine), _scaled(other, sine))
        self.short = _sum(_scaled(other, cosine), _scaled(side, -sine))
        self.a2 = mean + radius
        self.b2 = self.volume * self.volume / (self.depth * self.depth * self.depth) / self.a2
        self.m = ops.select(oval, self.a2 - self.b2, 0.0)
        self.m = ops.select(self.m > 0.0, self.m, 0.0)

    def point(self, x: Any, y: Any) -> Vector:
        return _sum(self.centre, _scaled(self.u, x), _scaled(self.v, y))

    def arc(self, t0: Any, t1: Any) -> Vector:
        """The integral over the border from t0 to t1 ≥ t0; 0 where t1 ≤ t0."""
        ops = self.ops
        a, b = ops.sqrt(self.a2), ops.sqrt(self.b2)
        p, q = 1.0 + self.a2, 1.0 + self.b2
        root_p, root_q, root_m = ops.sqrt(p), ops.sqrt(q), ops.sqrt(self.m + 1e-300)
        ends = []
        for t in (t0, t1):
            r = self.point(ops.cos(t), ops.sin(t))
            x, y = dot(r, self.long) / a, dot(r, self.short) / b
            length = ops.sqrt(x * x + y * y)
            x, y = x / length, y / length  # cos s, sin s
            along = -0.5 * b * _artanh_over(ops, root_m * y / root_p, y) / p
            across = 0.5 * a * _arctan_over(ops, root_m * x / root_q, x) / q
            ends.append((along, across, ops.arctan2(root_q * y, root_p * x)))
        (x0, y0, angle0), (x1, y1, angle1) = ends
        turn = angle1 - angle0
        turn = ops.select(turn < 0.0, turn + 2.0 * math.pi, turn)
        # rounding may take a short arc for a whole turn, and the other way round
        span = t1 - t0
        turn = ops.select((turn > 6.0) & (span < 1e-3), 0.0 * turn, turn)
        whole = (turn < 0.1) & (span > 2.0 * math.pi - 1e-3)
        turn = ops.select(whole, turn + 2.0 * math.pi, turn)
        around = 0.5 * a * b / (root_p * root_q) * turn
        total = _sum(
            _scaled(self.long, x1 - x0), _scaled(self.short, y1 - y0), _scaled(self.axis, around)
        )
        some = self.faces & (span > 0.0)
        x, y, z = (ops.select(some, component, 0.0) for component in total)
        return x, y, z


def _unit(ops: Ops, a: Vector) -> Vector:
    square = dot(a, a)
    some = square > 0.0
    return _scaled(a, 1.0 / ops.sqrt(ops.select(some, square, 1.0)))


def _perpendicular(ops: Ops, a: Vector) -> Vector:
    """Any vector at right angles to a unit vector, at least half as long."""
    x, y, z = a
    flat = ops.abs(x) > 0.7
    return _select(ops, flat, (-z, 0.0 * y, x), (0.0 * x, z, -y))


def _artanh_over(ops: Ops, x: Any, y: Any) -> Any:
    """y artanh(x) / x for |x| < 1, with the limit y at 0."""
    small = ops.abs(x) < 1e-3
    square = x * x
    safe = ops.select(small, 0.5, x)
    bent = 0.5 * ops.log((1.0 + safe) / (1.0 - safe)) / safe
    return y * ops.select(small, 1.0 + square * (1.0 / 3.0 + square * 0.2), bent)


def _arctan_over(ops: Ops, x: Any, y: Any) -> Any:
    """y arctan(x) / x, with the limit y at 0."""
    small = ops.abs(x) < 1e-3
    square = x * x
    safe = ops.select(small, 1.0, x)
    bent = ops.arctan2(safe, 1.0 + 0.0 * safe) / safe
    return y * ops.select(small, 1.0 - square * (1.0 / 3.0 - square * 0.2), bent)


class _Arc:
    """What one plane leaves of the border of an ellipse: |t - middle| < half."""

    def __init__(self, ops: Ops, middle: Any, half: Any, cosine: Any, sine: Any, cut: Any) -> None:
        self.middle, self.half, self.cosine, self.sine, self.cut = middle, half, cosine, sine, cut
        self.ops = ops

    @classmethod
    def above(cls, ops: Ops, plane: Vector, centre: Vector, u: Vector, v: Vector) -> _Arc:
        height, gx, gy = dot(plane, centre), dot(plane, u), dot(plane, v)
        square = gx * gx + gy * gy
        tilted = square > 0.0
        gx = ops.select(tilted, gx, 1.0)
        slope = ops.sqrt(ops.select(tilted, square, 1.0))
        ratio = -height / slope
        # a plane that is parallel to the ellipse, or that misses it
        all_in, all_out = ratio <= -1.0, ratio >= 1.0
        all_in = all_in | (~tilted & (height > 0.0))
        all_out = all_out | (~tilted & (height <= 0.0))
        crossed = ~(all_in | all_out)
        ratio = ops.select(crossed, ratio, 0.0)
        half = ops.select(crossed, ops.arccos(ratio), ops.select(all_in, math.pi, 0.0 * ratio))
        sine = ops.select(crossed, ops.sqrt((1.0 - ratio) * (1.0 + ratio)), 0.0 * ratio)
        cosine = ops.select(crossed, ratio, ops.select(all_in, -1.0 + 0.0 * ratio, 1.0))
        return cls(ops, ops.arctan2(gy, gx), half, cosine, sine, ~all_in)

    def chord(self, other: _Arc | None) -> tuple[Any, Any, Any, Any]:
        """x, y of both ends of the chord, as far as the other plane leaves it."""
        ops = self.ops
        cos_t, sin_t = ops.cos(self.middle), ops.sin(self.middle)
        start, stop = self.sine, -self.sine
        if other is not None:
            # other's height along the chord, over its slope: product with its direction less ratio
            cos_o, sin_o = ops.cos(other.middle), ops.sin(other.middle)
            along = cos_o * cos_t + sin_o * sin_t
            across = sin_o * cos_t - cos_o * sin_t
            offset = self.cosine * along - other.cosine
            crossing = ops.abs(across) > 1e-14
            at = -offset / ops.select(crossing, across, 1.0)
            low = ops.select(crossing & (across > 0.0), at, -2.0 + 0.0 * at)
            high = ops.select(crossing & ~(across > 0.0), at, 2.0 + 0.0 * at)
            nothing = ~crossing & (offset < 0.0)
            start, stop = ops.minimum(start, high), ops.maximum(stop, low)
            empty = nothing | (start < stop) | (other.half <= 0.0)
            free = other.half >= math.pi  # not cut: the whole chord
            empty = empty & ~free
            start = ops.select(free, self.sine, start)
            stop = ops.select(free, -self.sine, stop)
            start, stop = ops.select(empty, 0.0, start), ops.select(empty, 0.0, stop)
        return (
            self.cosine * cos_t - start * sin_t,
            self.cosine * sin_t + start * cos_t,
            self.cosine * cos_t - stop * sin_t,
            self.cosine * sin_t + stop * cos_t,
        )


def _clipped_ellipse(ops: Ops, cone: _Cone, arcs: list[_Arc]) -> Vector:
    """Arcs that are above all planes, and the chords between them."""
    cone.diagonalise()
    first, second = arcs[0], arcs[1] if len(arcs) == 2 else None
    parts = []
    if second is None:
        parts.append(cone.arc(first.middle - first.half, first.middle + first.half))
    else:
        offset = second.middle - first.middle
        offset = ops.select(offset > math.pi, offset - 2.0 * math.pi, offset)
        offset = ops.select(offset <= -math.pi, offset + 2.0 * math.pi, offset)
        around = ops.select(offset >= 0.0, -2.0 * math.pi, 2.0 * math.pi)
        for shift in (0.0, around):  # what both leave may be in two pieces
            low = ops.maximum(-first.half, offset + shift - second.half)
            high = ops.minimum(first.half, offset + shift + second.half)
            parts.append(cone.arc(first.middle + low, first.middle + high))
    for arc, other in ((first, second), (second, first)):
        if arc is not None:
            x0, y0, x1, y1 = arc.chord(other)
            edge = _edge_integral(ops, cone.point(x0, y0), cone.point(x1, y1))
            half = _scaled(edge, 0.5)
            some = cone.faces & (arc.half > 0.0) & (arc.half < math.pi)
            parts.append(_select(ops, some, half, _scaled(half, 0.0)))
    return _sum(*parts)

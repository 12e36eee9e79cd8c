"""The elliptic cone of an ellipse, and the arcs that planes leave of its border.

Formulas as `irradiance` explains them, in float64.
"""

from __future__ import annotations

import math
from typing import Any

from ._array import Ops
from ._vectors import (
    Vector,
    angle_times_normal,
    cross,
    dot,
    perpendicular,
    scaled,
    select_vector,
    unit,
    vector_sum,
)

__all__ = ["Arc", "Cone", "clipped_ellipse"]

_ROUND = 1e-12
"""Squared axes that differ by less than this share of their sum are those of a circle."""


class Cone:
    """The elliptic cone of an ellipse: its axis, and where the border is on it."""

    def __init__(self, ops: Ops, centre: Vector, u: Vector, v: Vector) -> None:
        self.ops, self.centre, self.u, self.v = ops, centre, u, v
        volume = dot(cross(u, v), centre)
        self.faces = volume > 0.0
        volume = ops.select(self.faces, volume, 1.0)
        # without a cone, any that is one
        self.centre, self.u, self.v = (
            select_vector(ops, self.faces, vector, scaled(vector_sum(vector, vector), 0.0))
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
        axis = vector_sum(
            scaled(cross(rows[1], rows[2]), c[0]),
            scaled(cross(rows[2], rows[0]), c[1]),
            scaled(cross(rows[0], rows[1]), c[2]),
        )
        self.axis = unit(ops, axis)

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
        return scaled(self.axis, ops.select(self.faces, size, 0.0))

    def diagonalise(self) -> None:
        """The other two axes, the longer one first, and half the openings along them."""
        ops, axis = self.ops, self.axis
        side = unit(ops, perpendicular(ops, axis))
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
        self.long = vector_sum(scaled(side, cosine), scaled(other, sine))
        self.short = vector_sum(scaled(other, cosine), scaled(side, -sine))
        self.a2 = mean + radius
        self.b2 = self.volume * self.volume / (self.depth * self.depth * self.depth) / self.a2
        self.m = ops.select(oval, self.a2 - self.b2, 0.0)
        self.m = ops.select(self.m > 0.0, self.m, 0.0)

    def point(self, x: Any, y: Any) -> Vector:
        return vector_sum(self.centre, scaled(self.u, x), scaled(self.v, y))

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
        total = vector_sum(
            scaled(self.long, x1 - x0), scaled(self.short, y1 - y0), scaled(self.axis, around)
        )
        some = self.faces & (span > 0.0)
        x, y, z = (ops.select(some, component, 0.0) for component in total)
        return x, y, z


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


class Arc:
    """What one plane leaves of the border of an ellipse: |t - middle| < half."""

    def __init__(self, ops: Ops, middle: Any, half: Any, cosine: Any, sine: Any, cut: Any) -> None:
        self.middle, self.half, self.cosine, self.sine, self.cut = middle, half, cosine, sine, cut
        self.ops = ops

    @classmethod
    def above(cls, ops: Ops, plane: Vector, centre: Vector, u: Vector, v: Vector) -> Arc:
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

    def chord(self, other: Arc | None) -> tuple[Any, Any, Any, Any]:
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


def clipped_ellipse(ops: Ops, cone: Cone, arcs: list[Arc]) -> Vector:
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
            edge = angle_times_normal(ops, cone.point(x0, y0), cone.point(x1, y1))
            half = scaled(edge, 0.5)
            some = cone.faces & (arc.half > 0.0) & (arc.half < math.pi)
            parts.append(select_vector(ops, some, half, scaled(half, 0.0)))
    return vector_sum(*parts)

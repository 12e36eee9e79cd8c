"""GGX and Beckmann: all that tells one distribution of microfacet normals from another.

Formulas as `microfacet` explains them, for arrays of one kind: each takes the operations for them.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

from ._array import Ops
from ._check import choose
from ._vectors import Vector

__all__ = ["SHAPES", "Shape", "named_shape"]


class Shape(Protocol):
    """What `microfacet` and the rule of `albedo` need of a distribution."""

    def density(self, ops: Ops, sine_square: Any, cos: Any, alpha: Any) -> Any:
        """Density of normals per solid angle, for cos > 0."""
        ...

    def projected_area(self, ops: Ops, c: Any, alpha: Any) -> Any:
        """sigma = c (1 + Lambda)."""
        ...

    def hidden_area(self, ops: Ops, c: Any, alpha: Any) -> Any:
        """sigma - c = c Lambda."""
        ...

    def slope_range(self, ops: Ops, numerator: Any, denominator: Any, edge: Any) -> tuple[Any, ...]:
        """What `slope_node` needs of slopes t <= numerator/denominator.

        `edge` is the scale on which F may vary near the last angle.
        """
        ...

    def slope_node(self, ops: Ops, limits: tuple[Any, ...], w: Any) -> tuple[Any, Any, Any]:
        """(a, b, weight) of the slope t = a/b at w in [0, 1]; the weight is P(t) t dt/dw over b."""
        ...

    def sample_unit(self, ops: Ops, x: Any, y: Any, z: Any, u1: Any, u2: Any) -> Vector:
        """A visible normal at roughness 1, of any length."""
        ...


class _GGX:
    def density(self, ops: Ops, sine_square: Any, cos: Any, alpha: Any) -> Any:
        # alpha² / (pi (sin² + alpha² cos²)²), divided by alpha before anything is squared
        inverse = 1.0 / (sine_square / alpha + alpha * cos * cos)
        return inverse * inverse * (1.0 / math.pi)

    def projected_area(self, ops: Ops, c: Any, alpha: Any) -> Any:
        return 0.5 * (c + self._stretched(ops, c, alpha))

    def hidden_area(self, ops: Ops, c: Any, alpha: Any) -> Any:
        # (length - c)/2 without its cancellation
        total = self._stretched(ops, c, alpha) + c
        tangent = alpha * alpha * ((1.0 - c) * (1.0 + c))
        return 0.5 * tangent / ops.select(total > 0.0, total, 1.0)

    def _stretched(self, ops: Ops, c: Any, alpha: Any) -> Any:
        """Length of the direction in the frame in which the surface has roughness 1."""
        square = alpha * alpha * ((1.0 - c) * (1.0 + c)) + c * c
        some = square > 0.0  # safe before the root, for the sake of its derivative
        return ops.select(some, ops.sqrt(ops.select(some, square, 1.0)), 0.0)

    # t = tan(theta) and theta = theta* - scale sinh(rate (1 - w))²: dense near the last angle, and
    # by complements of angles, which are small there
    def slope_range(self, ops: Ops, numerator: Any, denominator: Any, edge: Any) -> tuple[Any, ...]:
        last = ops.arctan2(denominator, numerator)
        span = 0.5 * math.pi - last
        root = ops.sqrt(ops.maximum(ops.detach(span) / edge, 1e-12))
        return last, span / (root * root), ops.arcsinh(root)

    def slope_node(self, ops: Ops, limits: tuple[Any, ...], w: Any) -> tuple[Any, Any, Any]:
        last, scale, rate = limits
        grown = ops.exp(rate * (1.0 - w))
        shrunk = 1.0 / grown
        wave = 0.5 * (grown - shrunk)
        complement = last + scale * wave * wave
        along, across = ops.sincos(complement)
        step = scale * rate * wave * (grown + shrunk)
        return across, along, step * across * (1.0 / math.pi)

    def sample_unit(self, ops: Ops, x: Any, y: Any, z: Any, u1: Any, u2: Any) -> Vector:
        # a direction, uniform on the cap above -z, plus the view direction
        phi = 2.0 * math.pi * u1
        up = (1.0 - u2) * (1.0 + z)
        cap = up - z
        radius = ops.sqrt(ops.maximum((1.0 - cap) * (1.0 + cap), 0.0))
        return radius * ops.cos(phi) + x, radius * ops.sin(phi) + y, ops.maximum(up, 1e-30)


class _Beckmann:
    def density(self, ops: Ops, sine_square: Any, cos: Any, alpha: Any) -> Any:
        # beyond slopes of 10 alpha it is below 1e-43, and its parts overflow
        reach = 10.0 * alpha * cos
        near = sine_square < reach * reach
        cos, sine_square = ops.select(near, cos, 1.0), ops.select(near, sine_square, 0.0)
        slope_square = sine_square / (alpha * cos) / (alpha * cos)
        inverse = 1.0 / (alpha * cos * cos)
        return ops.select(near, ops.exp(-slope_square) * inverse * inverse / math.pi, 0.0)

    def projected_area(self, ops: Ops, c: Any, alpha: Any) -> Any:
        return c + self.hidden_area(ops, c, alpha)  # and so never below c

    def hidden_area(self, ops: Ops, c: Any, alpha: Any) -> Any:
        few, ratio, spread = self._spread(ops, c, alpha)
        tail = ops.exp(-ratio * ratio) / (2.0 * math.sqrt(math.pi))
        hidden = spread * tail - 0.5 * c * (1.0 - ops.erf(ratio))
        return ops.select(few, ops.maximum(hidden, 0.0), 0.0)

    def _spread(self, ops: Ops, c: Any, alpha: Any) -> tuple[Any, Any, Any]:
        """Whether anything is masked; if so, c / (alpha s) and alpha s."""
        square = alpha * alpha * ops.maximum((1.0 - c) * (1.0 + c), 0.0)
        few = c * c < 64.0 * square  # beyond, less than 1e-29 of the surface is
        spread = ops.sqrt(ops.select(few, square, 1.0))
        return few, c / spread, spread

    def slope_range(self, ops: Ops, numerator: Any, denominator: Any, edge: Any) -> tuple[Any, ...]:
        farthest = 4.2  # beyond it are 2e-8 of all slopes
        return (numerator / ops.maximum(denominator, numerator / farthest),)

    def slope_node(self, ops: Ops, limits: tuple[Any, ...], w: Any) -> tuple[Any, Any, Any]:
        (last,) = limits
        t = last * w
        return t, 1.0, ops.exp(-t * t) * t * last * (1.0 / math.pi)

    def sample_unit(self, ops: Ops, x: Any, y: Any, z: Any, u1: Any, u2: Any) -> Vector:
        sine = ops.sqrt(x * x + y * y)
        steep = sine > 1e-6 * z
        # slopes s in the plane of incidence, s >= -a: density (z + s sine) exp(-s²). Its integral,
        # as a function of e = erf(s), is convex; Newton's steps, halved brackets where they leave
        a = ops.select(steep, ops.minimum(z / ops.select(steep, sine, 1.0), 4.0), 4.0)
        half = 0.5 * math.sqrt(math.pi)
        least = -ops.erf(a)
        offset = half * z * ops.erf(a) + 0.5 * sine * ops.exp(-a * a)
        target = u1 * (offset + half * z)
        # erfinv is infinite at -1 and 1: of either tail, 5e-8 are cut off
        farthest = 1.0 - 1e-7
        least = ops.maximum(least, -farthest)
        low, high = least, farthest + 0.0 * least
        e = least + (high - least) * u1
        for _ in range(16):
            s = ops.erfinv(e)
            value = half * z * e - 0.5 * sine * ops.exp(-s * s) + offset - target
            low, high = ops.select(value < 0.0, e, low), ops.select(value < 0.0, high, e)
            slope = half * (z + sine * s)
            step = e - value / ops.select(slope > 0.0, slope, 1.0)
            inside = (slope > 0.0) & (step >= low) & (step <= high)
            e = ops.select(inside, step, 0.5 * (low + high))
        s = ops.erfinv(e)
        across = ops.erfinv(ops.maximum(ops.minimum(2.0 * u2 - 1.0, farthest), -farthest))
        along_x = ops.select(steep, x / ops.select(steep, sine, 1.0), 1.0)
        along_y = ops.select(steep, y / ops.select(steep, sine, 1.0), 0.0)
        return s * along_x - across * along_y, s * along_y + across * along_x, 1.0 + 0.0 * s


SHAPES: dict[str, Shape] = {"ggx": _GGX(), "beckmann": _Beckmann()}


def named_shape(distribution: str) -> Shape:
    """The one called `distribution`; an error for any other name."""
    return SHAPES[choose("distribution", distribution, SHAPES)]

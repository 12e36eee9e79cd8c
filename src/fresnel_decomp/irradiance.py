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

from collections.abc import Sequence
from typing import Any

import numpy as np

from ._array import DrJitOps, Ops, drjit_module, is_drjit, ops_for
from ._check import input_error
from ._ellipse import Arc, Cone, clipped_ellipse
from ._vectors import Vector, angle_times_normal, dot, scaled, select_vector, vector_sum

__all__ = ["ellipse_irradiance", "polygon_irradiance"]

Edge = tuple[Vector, Vector]


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
    return scaled(vector_sum(*(angle_times_normal(ops, a, b) for a, b in edges)), 0.5)


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
        point = vector_sum(scaled(a, 1.0 - t), scaled(b, t))
        kept.append(
            (
                select_vector(ops, above_a, a, select_vector(ops, enters, point, zero)),
                select_vector(ops, above_b, b, select_vector(ops, leaves, point, zero)),
            )
        )
        leave, enter = (
            select_vector(ops, leaves, point, leave),
            select_vector(ops, enters, point, enter),
        )
    return [*kept, (leave, enter)]


# --- ellipses -------------------------------------------------------------------------------------


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

    Raises
    ------
    InputError
        For more than two planes.

    Examples
    --------
    A disk that is seen under 45° all around has half the irradiance of a hemisphere:

    >>> import math
    >>> disk = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    >>> round(float(ellipse_irradiance(*disk)[2]) / math.pi, 4)
    0.5
    """
    if len(planes) > 2:
        raise input_error(f"{len(planes)} planes", "two at most", "Polygons take any number.")
    given = [centre, u, v, *planes]
    narrow, (centre, u, v, *planes) = _wide(given)
    ops = ops_for(*centre, *u, *v)
    cone = Cone(ops, centre, u, v)
    total = cone.whole()
    if planes:
        arcs = [Arc.above(ops, plane, centre, u, v) for plane in planes]
        part = clipped_ellipse(ops, cone, arcs)
        cut = arcs[0].cut
        for arc in arcs[1:]:
            cut = cut | arc.cut
        total = select_vector(ops, cut, part, total)
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

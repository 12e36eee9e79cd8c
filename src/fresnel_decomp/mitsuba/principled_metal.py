"""The metal of `decomposed_principled`: what its base colour and its edge say of reflectance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from .._check import input_error
from ..basis import Basis
from ..converters import LARGEST_R
from ..fresnel import conductor
from ..metallic import default_edge_colour, metal_coefficients, metal_reflectance
from ..parametrization import F82_COSINE, gulbrandsen_to_ior
from .fresnel_terms import Material
from .variants import unpolarized

__all__ = ["DEFAULT_EDGE_TINT", "Metal", "edge_parameters"]

DEFAULT_EDGE_TINT = 0.5
"""For the exact term without edge: of all constants the one that is nearest to measured metals."""

_LEAST_TINT = 1e-6
"""Below it k, the square root of something like g, has a slope that float32 cannot hold."""


def edge_parameters(given: Sequence[str], terms: int, fresnel: str) -> tuple[str, tuple[str, ...]]:
    """Kind and names of the edge parameters among property names."""
    nodes = tuple(f"edge_color_{i + 1}" for i in range(terms - 2))
    sets = {"color": ("edge_color",), "nodes": nodes, "tint": ("edge_tint",)}
    found = [kind for kind, names in sets.items() if any(name in given for name in names)]
    if not found:
        return "usual", ()
    present = [name for names in sets.values() for name in names if name in given]
    if len(found) > 1 or len(present) != len(sets[found[0]]):
        raise input_error(
            f"the edge of the metal is given by {', '.join(present)}",
            "nothing, or one of " + " | ".join(" + ".join(names) for names in sets.values()),
            "edge_color is the reflectance at cos = 1/7, edge_color_1, ... are those at the nodes "
            "of the basis.",
        )
    if fresnel == "exact" and found != ["tint"]:
        raise input_error(
            f"fresnel='exact' with {', '.join(present)}",
            "edge_tint, or nothing",
            "Reflectances do not determine an index of refraction.",
        )
    return found[0], sets[found[0]]


class Metal(Material):
    """The metal at a shading point.

    Parameters
    ----------
    kind : {"usual", "color", "nodes", "tint"}
        As `edge_parameters` returns it.
    base : mi.UnpolarizedSpectrum
        Reflectance at normal incidence.
    edges : list of mi.UnpolarizedSpectrum
        Values of the edge parameters.
    basis : Basis
    """

    def __init__(self, kind: str, base: Any, edges: list[Any], basis: Basis) -> None:
        super().__init__(kind, (base, *edges), basis)
        self.base, self.edges = base, edges

    def indices(self) -> Sequence[Any]:
        tint = self.edges[0] if self.kind == "tint" else mi.UnpolarizedSpectrum(DEFAULT_EDGE_TINT)
        pairs = [
            gulbrandsen_to_ior(_inside(r, 1e-8, LARGEST_R), _inside(g, _LEAST_TINT, 1.0))
            for r, g in zip(self.base, tint, strict=True)
        ]
        return tuple(unpolarized(values) for values in zip(*pairs, strict=True))

    def reflectance(self, cos_theta: float) -> Any:
        if cos_theta == 1.0:
            return self.base
        if self.kind == "tint":
            return unpolarized(
                [
                    conductor(cos_theta, *index, precision="native")
                    for index in zip(*self.indices(), strict=True)
                ]
            )
        if self.kind == "nodes":
            return self.basis.evaluate(self.coefficients(), cos_theta)
        edge = self.edges[0] if self.edges else default_edge_colour(self.base)
        return edge if cos_theta == F82_COSINE else metal_reflectance(self.base, edge, cos_theta)

    def coefficients(self) -> Sequence[Any]:
        if self.kind == "nodes":
            return self.basis.coefficients_from_reflectance(self.base, self.edges)
        if self.kind == "tint":
            nodes = [self.reflectance(float(np.cos(node))) for node in self.basis.nodes]
            return self.basis.coefficients_from_reflectance(self.base, nodes)
        edge = self.edges[0] if self.edges else default_edge_colour(self.base)
        return metal_coefficients(self.base, edge, self.basis)


def _inside(value: Any, low: float, high: float) -> Any:
    """`dr.clip` that is differentiated as if it were not there: at its ends, from within."""
    return dr.replace_grad(dr.clip(value, low, high), value)

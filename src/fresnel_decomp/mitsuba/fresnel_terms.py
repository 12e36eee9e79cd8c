"""What a conductor is made of, and which Fresnel term is made from it.

A `Material` holds one set of parameters that determines reflectance, and its kind says which:
"indices" (eta, k), "gulbrandsen" (r, g), "nodes" (f0, f1, ...), "coefficients" (c0, c1, ...). A
*term* (`Exact`, `Lossless`, `Schlick`, `F82`, `Decomposition`) says which numbers it needs of a
material (`project`, done once, on flat arrays) and evaluates them at a shading point (calling it,
per channel).

All terms but the exact ones are sums of few `functions` of the cosine, times the `weights` that
follow from the numbers: what can be integrated ahead of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import mitsuba as mi
import numpy as np

from .._schlick import bend_factor, bent_schlick, schlick, schlick_functions
from ..fresnel import conductor, dielectric
from ..parametrization import F82_COSINE, gulbrandsen_to_ior
from .variants import unpolarized

if TYPE_CHECKING:
    from ..basis import Basis

__all__ = [
    "F82",
    "FRESNEL_TERMS",
    "Decomposition",
    "Exact",
    "Lossless",
    "Material",
    "Schlick",
    "fresnel_term",
]

FRESNEL_TERMS = ("decomposition", "exact", "schlick", "f82")
"""Their names, as plugins take them."""


class Material:
    """Values of one parameter set, as indices, coefficients or reflectances.

    Parameters
    ----------
    kind : str
        As `conductor_material.parameter_set` returns it; "material" stands for eta and k. Besides,
        "f82": reflectances at normal incidence and at cos = 1/7.
    values : sequence of flat Dr.Jit arrays
        One per parameter.
    basis : Basis
    """

    def __init__(self, kind: str, values: Sequence[Any], basis: Basis) -> None:
        self.kind, self.values, self.basis = kind, values, basis

    def indices(self) -> Sequence[Any]:
        return gulbrandsen_to_ior(*self.values) if self.kind == "gulbrandsen" else self.values

    def coefficients(self) -> Sequence[Any]:
        if self.kind == "coefficients":
            return self.values
        if self.kind == "nodes":
            return self.basis.coefficients_from_reflectance(self.values[0], self.values[1:])
        return self.basis.coefficients(*self.indices())

    def reflectance(self, cos_theta: float) -> Any:
        if self.kind == "f82":
            return bent_schlick(self.values[0], bend_factor(*self.values), cos_theta)
        if self.kind in ("coefficients", "nodes"):
            return self.basis.evaluate(self.coefficients(), cos_theta)
        return conductor(cos_theta, *self.indices())


class Exact:
    """Mitsuba's own exact Fresnel equations, as in the built-in `roughconductor`."""

    @staticmethod
    def project(material: Material) -> Sequence[Any]:
        return material.indices()

    def __call__(self, cos_theta: Any, eta: Any, k: Any) -> Any:
        channels = zip(eta, k, strict=True)
        values = [mi.fresnel_conductor(cos_theta, mi.Complex2f(*index)) for index in channels]
        return unpolarized(values)


class Lossless(Exact):
    """Our own equations for k = 0: right, with their derivatives, down to eta = 1."""

    def __call__(self, cos_theta: Any, eta: Any, k: Any) -> Any:
        values = [dielectric(cos_theta, channel, precision="native") for channel in eta]
        return unpolarized(values)


class Schlick:
    """F0 + (1 - F0)(1 - cos)^5 with the exact F0 (Schlick 1994, eq. 15)."""

    @staticmethod
    def project(material: Material) -> Sequence[Any]:
        return (material.reflectance(1.0),)

    def __call__(self, cos_theta: Any, f0: Any) -> Any:
        return schlick(f0, cos_theta)

    functions = staticmethod(schlick_functions)

    @staticmethod
    def weights(f0: Any) -> tuple[Any, ...]:
        return f0, 1.0 - f0


class F82:
    """Schlick's curve less a cos (1 - cos)^6, exact at cos = 1/7 (Hoffman 2019)."""

    @staticmethod
    def project(material: Material) -> Sequence[Any]:
        f0 = material.reflectance(1.0)
        return f0, bend_factor(f0, material.reflectance(F82_COSINE))

    def __call__(self, cos_theta: Any, f0: Any, a: Any) -> Any:
        return bent_schlick(f0, a, cos_theta)

    @staticmethod
    def functions(cos_theta: np.ndarray) -> np.ndarray:
        bend = cos_theta * (1.0 - cos_theta) ** 6
        return np.concatenate([schlick_functions(cos_theta), bend[..., None]], axis=-1)

    @staticmethod
    def weights(f0: Any, a: Any) -> tuple[Any, ...]:
        return f0, 1.0 - f0, -a


class Decomposition:
    """Sum of c_i b_i(cos), with `basis.closed_form`: one division, shared by all channels."""

    @staticmethod
    def project(material: Material) -> Sequence[Any]:
        return material.coefficients()

    def __init__(self, basis: Basis) -> None:
        self.basis = basis

    def __call__(self, cos_theta: Any, *coefficients: Any) -> Any:
        return self.basis.closed_form.evaluate(coefficients, cos_theta)

    def functions(self, cos_theta: np.ndarray) -> np.ndarray:
        return self.basis.closed_form(cos_theta)

    @staticmethod
    def weights(*coefficients: Any) -> tuple[Any, ...]:
        return coefficients


def fresnel_term(name: str, basis: Basis) -> Any:
    """The term that is called `name` in `FRESNEL_TERMS`."""
    if name == "decomposition":
        return Decomposition(basis)
    return {"exact": Exact, "schlick": Schlick, "f82": F82}[name]()

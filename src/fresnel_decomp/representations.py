"""Further models of reflectance that artists and engines store, beside those of `models`.

Each is a frozen dataclass of its parameters that can be called with a cosine, per channel; see
`converters.convert` for ways from each to each other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ._arguments import one_kind
from ._array import is_drjit
from ._check import input_error
from ._schlick import schlick
from .basis import Basis
from .parametrization import gulbrandsen_to_ior

__all__ = [
    "DEFAULT_BETA",
    "DIELECTRIC_F0",
    "Curve",
    "LinearTint",
    "MetallicBase",
    "NodeColours",
]

DEFAULT_BETA = 0.75
"""Without edge tint, as in the authors' notebook: near Schlick's curve for bright metals."""

DIELECTRIC_F0 = 0.04
"""Reflectance at metallic = 0 (Burley 2012; glTF 2.0)."""


@dataclass(frozen=True, eq=False)
class NodeColours:
    """Reflectances at normal incidence and at the nodes of a basis: colours that one can see.

    Attributes
    ----------
    f0 : (...) float
    f_nodes : (..., terms - 2) float, or for Dr.Jit a sequence of terms - 2 arrays
    basis : Basis

    Examples
    --------
    >>> from fresnel_decomp import NodeColours, load_basis
    >>> metal = NodeColours(f0=0.9, f_nodes=[0.91, 0.92], basis=load_basis())
    >>> round(float(metal(1.0)), 4)
    0.9
    """

    name: ClassVar[str] = "nodes"
    f0: Any
    f_nodes: Any
    basis: Basis

    @property
    def coefficients(self) -> Any:
        """(..., terms) float, or a tuple of Dr.Jit arrays."""
        return self.basis.coefficients_from_reflectance(self.f0, self.f_nodes)

    def __call__(self, cos_theta: Any) -> Any:
        return self.basis.evaluate(self.coefficients, cos_theta)


@dataclass(frozen=True, eq=False)
class LinearTint:
    """Reflectivity and a linear edge tint: the coefficients between those for g = 0 and g = 1.

    The re-parametrization of Gulbrandsen's edge tint in the notebook of Belcour, Bati and Barla
    2020: c(r, beta) = (1 - beta) c(r, g=0) + beta c(r, g=1). Equal steps of beta are equal steps
    of reflectance, whereas nearly all of the change with g happens next to g = 1.

    Attributes
    ----------
    r : (...) float in [0, 1)
    beta : (...) float, in [0, 1] for a curve between the two
    basis : Basis

    Examples
    --------
    >>> from fresnel_decomp import load_basis
    >>> from fresnel_decomp.representations import LinearTint
    >>> [round(float(LinearTint(0.6, beta, load_basis())(0.2)), 3) for beta in (0.0, 0.5, 1.0)]
    [0.472, 0.673, 0.874]
    """

    name: ClassVar[str] = "linear_tint"
    r: Any
    beta: Any
    basis: Basis

    @property
    def coefficients(self) -> Any:
        """(..., terms) float, or a tuple of Dr.Jit arrays."""
        ends = tint_ends(self.r, self.basis)
        if is_drjit(self.r, self.beta):
            beta, *flat = one_kind(self.beta, *ends[0], *ends[1])
            pairs = zip(flat[: self.basis.terms], flat[self.basis.terms :], strict=True)
            return tuple(a + beta * (b - a) for a, b in pairs)
        beta = np.asarray(self.beta, np.float64)[..., None]
        return ends[0] + beta * (ends[1] - ends[0])

    def __call__(self, cos_theta: Any) -> Any:
        return self.basis.evaluate(self.coefficients, cos_theta)


def tint_ends(r: Any, basis: Basis) -> tuple[Any, Any]:
    """Coefficients for g = 0 and g = 1."""
    untinted, tinted = (
        basis.coefficients(*gulbrandsen_to_ior(r, g), poor_fit="keep") for g in (0.0, 1.0)
    )
    return untinted, tinted


@dataclass(frozen=True, eq=False)
class MetallicBase:
    """Base colour and metallic as engines take them: F0 between 0.04 and the colour, then Schlick.

    Attributes
    ----------
    base_colour : (...) float in [0, 1]
    metallic : (...) float in [0, 1]

    Raises
    ------
    InputError
        For values outside of these ranges. Dr.Jit arrays are not looked at: that would evaluate
        them.

    Examples
    --------
    >>> from fresnel_decomp import MetallicBase
    >>> round(MetallicBase(base_colour=0.9, metallic=0.5).f0, 4)
    0.47
    """

    name: ClassVar[str] = "metallic_base"
    base_colour: Any
    metallic: Any = 1.0

    def __post_init__(self) -> None:
        for name in ("base_colour", "metallic"):
            value = getattr(self, name)
            if is_drjit(value):
                continue
            values = np.asarray(value, np.float64)
            wrong = values[~((values >= 0.0) & (values <= 1.0))]  # NaN is wrong too
            if wrong.size:
                raise input_error(
                    f"{name} = {wrong[0]:g}",
                    "values in [0, 1]",
                    "Schlick(f0) takes colours that leave it.",
                )

    @property
    def f0(self) -> Any:
        """Reflectance at normal incidence."""
        colour, metallic = one_kind(self.base_colour, self.metallic)
        return DIELECTRIC_F0 * (1.0 - metallic) + colour * metallic

    def __call__(self, cos_theta: Any) -> Any:
        return schlick(self.f0, cos_theta)


@dataclass(frozen=True, eq=False)
class Curve:
    """Any reflectance of NumPy cosines as a model, for instance a material's integrated spectrum.

    Attributes
    ----------
    function : callable
        Takes (m,) cosines and returns (m, ...) reflectances, one for each channel; (m,) without
        channels.

    Examples
    --------
    >>> from fresnel_decomp import load_material
    >>> from fresnel_decomp.representations import Curve
    >>> Curve(load_material("Au").rgb_reflectance)(1.0).round(3)
    array([1.022, 0.782, 0.343])
    """

    name: ClassVar[str] = "curve"
    function: Callable[[np.ndarray], np.ndarray]

    def __call__(self, cos_theta: Any) -> Any:
        if is_drjit(cos_theta):
            raise input_error(
                "Dr.Jit cosines for a Curve", "NumPy arrays", "Convert it to coefficients first."
            )
        cosine = np.asarray(cos_theta, np.float64)
        flat = np.asarray(self.function(cosine.ravel()))
        channels = flat.shape[1:]
        # trailing axes of length one stand for the channels, as when cosines broadcast
        shape = cosine.shape
        while len(shape) and len(channels) and len(cosine.shape) - len(shape) < len(channels):
            if shape[-1] != 1:
                break
            shape = shape[:-1]
        return flat.reshape((*shape, *channels))

"""What inverse rendering returns: values, how sure they are, and the way there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...basis import Basis
from ...fresnel import conductor
from ...parametrization import gulbrandsen_to_ior

__all__ = ["Recovered", "Step", "coefficients", "curve", "indices"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Step:
    """Where a route stood on its way.

    Attributes
    ----------
    seconds : float
    samples : int
        Camera paths traced so far.
    values : dict
        Parameters by name, with "alpha"; of a descent the best so far.
    """

    seconds: float
    samples: int
    values: dict[str, Any]


@dataclass(frozen=True, eq=False)
class Recovered:
    """A recovered conductor.

    Attributes
    ----------
    parameters, route : str
        As asked for.
    values : dict
        (3,) arrays by name, red, green, blue; "alpha" is a number.
    standard_errors : dict
        Of `values`: one standard deviation, from the scatter of the images' own residuals.
        Infinite where the images say nothing. Roughness that was given has 0.
    identified : dict
        (3,) bool by name: whether the images know more than the parameter's range does.
    coefficients : (3, n) float
        Of the decomposed curves.
    alpha : float
    residual : float
        RMS difference between the images and our renderings of what was recovered, over the
        conductor's pixels, relative to their mean radiance.
    noise : float
        The same, as the noise of both would explain it. A residual far above says that the scene
        or the parameters cannot explain the images.
    iterations : int
        Linearisations, roughnesses tried, or steps of the descent.
    samples : int
        Camera paths traced.
    seconds : float
    converged : bool
    message : str
        What to do if something is doubtful, else "".
    constrained : (3,) bool
        Channels in which bounds decided.
    fresnel, distribution : str
        How parameters make curves, and of which normals.
    basis : Basis
    history : tuple of Step
    """

    parameters: str
    route: str
    values: dict[str, Any]
    standard_errors: dict[str, Any]
    identified: dict[str, Any]
    coefficients: Array
    alpha: float
    residual: float
    noise: float
    iterations: int
    samples: int
    seconds: float
    converged: bool
    message: str
    constrained: NDArray[np.bool_]
    fresnel: str
    basis: Basis = field(repr=False)
    distribution: str = "ggx"
    history: tuple[Step, ...] = field(default=(), repr=False)

    def reflectance(self, cos_theta: Any) -> Array:
        """Reflectance of red, green and blue at cosines (...), as (..., 3)."""
        return curve(self.values, self.basis, self.fresnel, cos_theta)

    def bsdf(self) -> dict[str, Any]:
        """The dictionary of a `decomposed_conductor` that looks so."""
        named = {name: value for name, value in self.values.items() if name != "alpha"}
        return {
            "type": "decomposed_conductor",
            **{name: {"type": "rgb", "value": list(map(float, v))} for name, v in named.items()},
            "alpha": self.alpha,
            "distribution": self.distribution,
            "fresnel": self.fresnel,
            "recipe": self.basis.recipe,
            "terms": self.basis.terms,
        }


def curve(values: Mapping[str, Any], basis: Basis, fresnel: str, cos_theta: Any) -> Array:
    """Reflectance (..., 3) of named parameters."""
    cosine = np.asarray(cos_theta, np.float64)[..., None]
    if fresnel == "exact":
        return np.asarray(conductor(cosine, *indices(values)))
    return basis.evaluate(coefficients(values, basis), cosine)


def indices(values: Mapping[str, Any]) -> tuple[Any, Any]:
    """(3,) eta and k of named parameters."""
    if "eta" in values:
        return np.asarray(values["eta"]), np.asarray(values["k"])
    return gulbrandsen_to_ior(np.asarray(values["r"]), np.asarray(values["g"]))


def coefficients(values: Mapping[str, Any], basis: Basis) -> Array:
    """(3, terms) of named parameters."""
    if "c0" in values:
        return np.stack([values[f"c{i}"] for i in range(basis.terms)], axis=-1)
    if "f0" in values:
        nodes = np.stack([values[f"f{i}"] for i in range(1, basis.terms - 1)], axis=-1)
        return np.asarray(basis.coefficients_from_reflectance(values["f0"], nodes))
    return np.asarray(basis.coefficients(*indices(values), poor_fit="keep"))

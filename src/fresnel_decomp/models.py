"""Models of Fresnel reflectance under one interface: `model(cos_theta)` is the reflectance.

Each model is a frozen dataclass of the parameters it is stored as, with `from_ior(eta, k)` to fit
it to an index of refraction. Parameters and cosines broadcast; Python floats, NumPy arrays and
Dr.Jit arrays are accepted except where a fit says otherwise, and the two kinds of array are not
mixed. No model is clamped to [0, 1] unless asked.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Protocol

import numpy as np

from ._arguments import one_kind, plain_numbers, without_axes
from ._array import drjit_module, is_drjit, ops_for
from ._check import choose, input_error
from ._schlick import bend_factor, bent_schlick, schlick
from .basis import Basis, load_basis
from .fresnel import conductor, refracted_cosine
from .parametrization import (
    F82_COSINE,
    f0_from_ior,
    f82_from_ior,
    gulbrandsen_to_ior,
    ior_to_gulbrandsen,
)

__all__ = [
    "F82",
    "MODELS",
    "Decomposition",
    "Exact",
    "Gulbrandsen",
    "Lazanyi",
    "Model",
    "Schlick",
    "model_from_ior",
]


class Model(Protocol):
    """What every model of this module offers."""

    name: ClassVar[str]

    def __call__(self, cos_theta: Any) -> Any:
        """Reflectance at cos_theta in [0, 1]."""
        ...


@dataclass(frozen=True, eq=False)
class Exact:
    """The Fresnel equations of a conductor or dielectric; see `fresnel.conductor`.

    Attributes
    ----------
    eta, k : (...) float, eta > 0, k >= 0
    precision : {"wide", "native"}

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp import Exact
    >>> Exact(eta=2.9, k=3.1)(np.array([1.0, 0.2])).round(4)
    array([0.5326, 0.5322])
    """

    name: ClassVar[str] = "exact"
    eta: Any
    k: Any = 0.0
    precision: Literal["wide", "native"] = "wide"

    @classmethod
    def from_ior(cls, eta: Any, k: Any) -> Exact:
        return cls(eta, k)

    def __call__(self, cos_theta: Any) -> Any:
        return conductor(cos_theta, self.eta, self.k, precision=self.precision)


@dataclass(frozen=True, eq=False)
class Schlick:
    """F0 + (1 - F0)(1 - cos)^5 (Schlick 1994, Eq. 15), from the reflectance at normal incidence.

    With the exact F0 it is the same function as the base form of Lazanyi and Szirmay-Kalos.

    Attributes
    ----------
    f0 : (...) float, in [0, 1] for a reflectance; colours may leave it

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp import Schlick
    >>> Schlick(np.array([1.0, 0.78, 0.34]))(0.2).round(3)  # three channels
    array([1.   , 0.852, 0.556])
    """

    name: ClassVar[str] = "schlick"
    f0: Any

    @classmethod
    def from_ior(cls, eta: Any, k: Any) -> Schlick:
        return cls(f0_from_ior(eta, k))

    def __call__(self, cos_theta: Any) -> Any:
        return schlick(self.f0, cos_theta)


@dataclass(frozen=True, eq=False)
class Lazanyi:
    """Schlick's curve with the correction - a cos (1 - cos)^exponent.

    Lazanyi and Szirmay-Kalos 2005, "Fresnel Term Approximations for Metals": the correction peaks
    at cos = 1 / (exponent + 1), which is put where Schlick's curve errs most.

    Attributes
    ----------
    f0 : (...) float
    a : (...) float, factor of the correction
    exponent : (...) float > 1

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp import Lazanyi
    >>> Lazanyi.from_ior(2.9, 3.1)(np.array([1.0, 0.2])).round(4)  # exact: .5326, .5322
    array([0.5326, 0.5373])
    """

    name: ClassVar[str] = "lazanyi"
    f0: Any
    a: Any = 0.0
    exponent: Any = 6.0

    @classmethod
    def from_ior(cls, eta: Any, k: Any) -> Lazanyi:
        """Fit place and height of the correction to the exact curve.

        Raises
        ------
        InputError
            For Dr.Jit arrays, and as `fresnel.conductor`.
        """
        if is_drjit(eta, k):
            raise input_error(
                "Lazanyi.from_ior with Dr.Jit arrays",
                "NumPy arrays and Python floats",
                "Fit in NumPy and convert the parameters.",
            )
        eta, k = np.broadcast_arrays(np.asarray(eta, np.float64), np.asarray(k, np.float64))
        f0 = np.asarray(f0_from_ior(eta, k))
        cos_theta = np.linspace(0.0, 0.5, 1025)[1:-1]  # exponents above 1
        excess = schlick(f0[..., None], cos_theta) - conductor(
            cos_theta, eta[..., None], k[..., None]
        )
        worst = np.argmax(np.abs(excess), axis=-1)
        peak = cos_theta[worst]
        exponent = 1.0 / peak - 1.0
        height = np.take_along_axis(excess, worst[..., None], axis=-1)[..., 0]
        a = height / (peak * (1.0 - peak) ** exponent)
        return cls(*(value if value.ndim else float(value) for value in (f0, a, exponent)))

    def __call__(self, cos_theta: Any) -> Any:
        # cos = 1 makes the base 0, whose power has no gradient in Dr.Jit: the factor (1 - cos)
        # stays outside
        cos_theta, f0, a, exponent = one_kind(cos_theta, self.f0, self.a, self.exponent)
        x = 1.0 - cos_theta
        if is_drjit(cos_theta, exponent):
            dr = drjit_module()
            assert dr is not None
            power = dr.power(dr.maximum(x, 1e-30), exponent - 1.0)
        else:
            power = np.maximum(x, 0.0) ** (exponent - 1.0)
        reflectance = schlick(f0, cos_theta) - a * cos_theta * x * power
        return without_axes(reflectance, plain_numbers(cos_theta, f0, a, exponent))


@dataclass(frozen=True, eq=False)
class F82:
    """Schlick's curve bent through a given reflectance at cos = 1/7, about 82 degrees.

    Hoffman 2019, "Fresnel Equations Considered Harmful": Lazanyi's correction with exponent 6,
    whose peak is at 1/7. Stored by value; `from_tint` takes the factor on Schlick's value there
    (1 changes nothing) that Kutz et al. 2021 and OpenPBR use.

    Attributes
    ----------
    f0, f82 : (...) float, in [0, 1] for reflectances at normal incidence and at cos = 1/7; colours
        may leave it

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp import F82
    >>> F82.from_ior(2.9, 3.1)(np.array([1.0, 0.2])).round(4)  # exact: .5326, .5322
    array([0.5326, 0.5238])
    """

    name: ClassVar[str] = "f82"
    f0: Any
    f82: Any

    @classmethod
    def from_ior(cls, eta: Any, k: Any) -> F82:
        return cls(f0_from_ior(eta, k), f82_from_ior(eta, k))

    @classmethod
    def from_tint(cls, f0: Any, tint: Any) -> F82:
        return cls(f0, tint * schlick(f0, F82_COSINE))

    @property
    def tint(self) -> Any:
        """f82 as a factor on Schlick's reflectance at cos = 1/7."""
        return self.f82 / schlick(self.f0, F82_COSINE)

    @property
    def a(self) -> Any:
        """Factor of the correction - a cos (1 - cos)^6."""
        return bend_factor(self.f0, self.f82)

    def __call__(self, cos_theta: Any) -> Any:
        return bent_schlick(self.f0, self.a, cos_theta)


@dataclass(frozen=True, eq=False)
class Gulbrandsen:
    """The exact equations from reflectivity r and edge tint g (Gulbrandsen 2014).

    Attributes
    ----------
    r : (...) float in [0, 1)
    g : (...) float in [0, 1]

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp import Gulbrandsen
    >>> Gulbrandsen(r=0.44, g=1.0)(np.array([1.0, 0.2])).round(4)
    array([0.44 , 0.804])
    """

    name: ClassVar[str] = "gulbrandsen"
    r: Any
    g: Any

    @classmethod
    def from_ior(cls, eta: Any, k: Any) -> Gulbrandsen:
        """Nearest (r, g) with g <= 1: exact where |eta + i k| >= 1."""
        r, g = ior_to_gulbrandsen(eta, k)
        return cls(r, min(g, 1.0) if isinstance(g, float) else ops_for(g).minimum(g, 1.0))

    def __call__(self, cos_theta: Any) -> Any:
        return conductor(cos_theta, *gulbrandsen_to_ior(self.r, self.g))


@dataclass(frozen=True, eq=False)
class Decomposition:
    """The preintegrable decomposition, sum_i c_i b_i (Belcour, Bati and Barla 2020, Eq. 4).

    Attributes
    ----------
    coefficients : (..., terms) float, or for Dr.Jit a sequence of `terms` arrays
    basis : Basis
    substitute : callable or None
        Where given, `substitute(cos_theta, reflectance)` replaces what the basis cannot follow.
    clamp : bool
        Clamp the result to [0, 1]. Fits leave it by a part of their error: the reflectance of an
        index of refraction comes nearer to the exact one, but no longer is linear in the
        coefficients, so that it does not agree with a preintegrated table; nor does it follow
        colours that leave [0, 1] as gold's red does. `scripts/range_table.py` measures both. No
        derivative passes where it clamps.

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp import Decomposition
    >>> Decomposition.from_ior(2.9, 3.1)(np.array([1.0, 0.2])).round(4)  # exact: .5326, .5322
    array([0.5326, 0.5331])
    """

    name: ClassVar[str] = "decomposition"
    coefficients: Any
    basis: Basis
    substitute: _Substitute | None = None
    clamp: bool = False

    @classmethod
    def from_ior(
        cls,
        eta: Any,
        k: Any,
        basis: Basis | None = None,
        *,
        poor_fit: Literal["raise", "keep", "substitute"] = "raise",
        clamp: bool = False,
    ) -> Decomposition:
        """Fit to an index of refraction; the default basis is `load_basis()`.

        Parameters
        ----------
        poor_fit : {"raise", "keep", "substitute"}
            About indices with total internal reflection, which no linear basis follows. With
            "substitute" (NumPy only) k = 0 uses reciprocity, R(eta, theta) = R(1/eta, theta_t) and
            1 beyond the critical angle, with the decomposition of 1/eta. Other poor fits, and
            eta > .95, whose reciprocal is near 1 and fits badly too, use the exact equations.
        clamp : bool
            See the class.

        Raises
        ------
        InputError
            As `Basis.coefficients`.
        """
        choose("poor_fit", poor_fit, ("raise", "keep", "substitute"))
        basis = load_basis() if basis is None else basis
        if poor_fit != "substitute":
            return cls(basis.coefficients(eta, k, poor_fit=poor_fit), basis, clamp=clamp)
        if is_drjit(eta, k):
            raise input_error(
                "poor_fit='substitute' with Dr.Jit arrays",
                "NumPy arrays and Python floats",
                "Use Exact(eta, k) for such indices in Dr.Jit.",
            )
        coefficients = basis.coefficients(eta, k, poor_fit="keep")
        poor = basis.poor_fit(eta, k, below=1.0)
        if not np.any(poor):
            return cls(coefficients, basis, clamp=clamp)
        eta, k = np.broadcast_arrays(np.asarray(eta, np.float64), np.asarray(k, np.float64))
        return cls(coefficients, basis, _Substitute(basis, eta, k, poor), clamp)

    def __call__(self, cos_theta: Any) -> Any:
        if self.substitute is not None and is_drjit(cos_theta):
            raise input_error(
                "Dr.Jit cosines for a decomposition with substituted curves",
                "NumPy arrays and Python floats",
                "Use Exact(eta, k) for such indices in Dr.Jit.",
            )
        reflectance = self.basis.evaluate(self.coefficients, cos_theta)
        if self.substitute is not None:
            reflectance = self.substitute(cos_theta, reflectance)
        if self.clamp:
            # by comparison, not by minimum and maximum, which may drop a NaN
            select = ops_for(reflectance).select
            reflectance = select(reflectance < 0.0, 0.0, reflectance)
            reflectance = select(reflectance > 1.0, 1.0, reflectance)
        return without_axes(reflectance, plain_numbers(cos_theta))


@dataclass(frozen=True, eq=False)
class _Substitute:
    """Replaces decomposed reflectances of indices with total internal reflection."""

    basis: Basis
    eta: np.ndarray
    k: np.ndarray
    poor: np.ndarray

    def __call__(self, cos_theta: Any, reflectance: np.ndarray) -> np.ndarray:
        lossless = self.poor & (self.k == 0.0) & (self.eta <= 0.95)
        others = self.poor & ~lossless
        inside = refracted_cosine(cos_theta, self.eta)
        coefficients = self.basis.coefficients(1.0 / np.where(lossless, self.eta, 1.0), 0.0)
        reciprocal = self.basis.evaluate(coefficients, inside)
        reciprocal = np.where(inside > 0.0, reciprocal, 1.0)
        result = np.where(lossless, reciprocal, reflectance)
        if np.any(others):
            result = np.where(others, conductor(cos_theta, self.eta, self.k), result)
        return result[()]


MODELS = ("exact", "schlick", "lazanyi", "f82", "gulbrandsen", "decomposition")
"""Names that `model_from_ior` knows."""


def model_from_ior(name: str, eta: Any, k: Any, basis: Basis | None = None) -> Model:
    """The model called `name`, fitted to an index of refraction.

    Parameters
    ----------
    name : one of `MODELS`
    eta, k : (...) float
    basis : Basis, for "decomposition"; default `load_basis()`

    Raises
    ------
    InputError
        For an unknown name or an index that the model cannot represent.

    Examples
    --------
    >>> from fresnel_decomp import model_from_ior
    >>> for name in ("exact", "schlick", "decomposition"):
    ...     print(f"{float(model_from_ior(name, 2.9, 3.1)(0.2)):.4f}")
    0.5322
    0.6858
    0.5331
    """
    choose("model", name, MODELS)
    if name == "decomposition":
        return Decomposition.from_ior(eta, k, basis)
    others = {model.name: model.from_ior for model in (Exact, Schlick, Lazanyi, F82, Gulbrandsen)}
    return others[name](eta, k)

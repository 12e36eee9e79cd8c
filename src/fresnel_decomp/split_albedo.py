r"""Directional albedo of a material in three channels: the material's half of the split-sum.

Lo(v) ≈ L(R, alpha) Fbar(n·v, alpha) (Karis 2013, "Real Shading in Unreal Engine 4"): L is light
that `mitsuba.prefilter` blurs, and Fbar is

- `SplitAlbedo(table, coefficients)`: a table's functions, weighed by the material's coefficients.
  With an `AlbedoTable` of four terms this is the decomposition;
- `schlick_albedo`, `f82_albedo`: the same with the functions of Schlick's curve, F0 A + B, and one
  more for F82;
- `compensated_albedo`: with the light that has bounced several times, from the same fetch;
- `integrated_albedo`: any curve integrated as it is, which is the reference of the first two.

All of them are called with (mu, alpha), NumPy's or Dr.Jit's; none needs a renderer.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ._array import is_drjit
from ._check import input_error, is_real
from ._coefficients import weighted_sum
from ._schlick import bend_factor
from ._vectors import of_kind
from .albedo import ROUGHEST, directional_albedo
from .energy import EnergyTable, missing, scaling
from .microfacet import Smith
from .table import AlbedoTable
from .table_layout import Layout

__all__ = [
    "CompensatedAlbedo",
    "SplitAlbedo",
    "compensated_albedo",
    "f82_albedo",
    "integrated_albedo",
    "schlick_albedo",
    "schlick_table",
]

_COSINES = 1025  # of integrated albedos, uniform in sqrt(mu): interpolation errs by some 1e-6


@dataclass(frozen=True, eq=False)
class SplitAlbedo:
    """Directional albedo of a material in three channels, sum_j c_j bbar_j(mu, alpha), unclamped.

    Attributes
    ----------
    table : AlbedoTable
    coefficients : (3, terms) float, or three sequences of `terms` Dr.Jit arrays
        By channel, as `Basis.coefficients` and `Material.rgb_coefficients` return them.

    Raises
    ------
    InputError
        If they are not for three channels with as many terms as the table has.

    Examples
    --------
    >>> from fresnel_decomp import AlbedoTable, load_basis
    >>> basis = load_basis()
    >>> table = AlbedoTable.bake(basis, size=16)
    >>> gold = SplitAlbedo(table, basis.coefficients([0.13, 0.43, 1.38], [3.9, 2.5, 1.9]))
    >>> gold(0.5, 0.3).shape
    (3,)
    """

    table: AlbedoTable
    coefficients: Any

    def __post_init__(self) -> None:
        rows = list(self.coefficients)
        lengths = sorted({len(row) if hasattr(row, "__len__") else 1 for row in rows})
        if len(rows) != 3 or lengths != [self.table.terms]:
            raise input_error(
                f"coefficients of {len(rows)} channels with {', '.join(map(str, lengths))} terms",
                f"3 channels with {self.table.terms} terms, as the table has",
                "Make both from one basis; repeat a grey material three times.",
            )

    def __call__(self, mu: Any, alpha: Any) -> Any:
        """(..., 3) float array, or a tuple of three Dr.Jit arrays.

        Parameters
        ----------
        mu, alpha : (...) float
            As for `AlbedoTable.lookup`: clamped to [0, 1], NaN gives NaN.

        Raises
        ------
        InputError
            For Dr.Jit coefficients if neither mu nor alpha is a Dr.Jit array.
        """
        return self._weighed(self.table.lookup(mu, alpha))

    def _weighed(self, functions: Any) -> Any:
        """For what a lookup has given."""
        if isinstance(functions, np.ndarray):
            if any(is_drjit(c) for row in self.coefficients for c in row):
                raise input_error(
                    "Dr.Jit coefficients together with mu and alpha of NumPy",
                    "mu or alpha as a Dr.Jit array",
                    "Convert it first, e.g. mi.Float(mu).",
                )
            return functions @ np.asarray(self.coefficients, functions.dtype).T
        kind = type(functions[0])
        return tuple(
            weighted_sum([of_kind(kind, c) for c in row], functions) for row in self.coefficients
        )


def _schlick_functions(cos_theta: np.ndarray) -> np.ndarray:
    x = 1.0 - cos_theta
    return np.stack([1.0 - x**5, x**5, -cos_theta * x**6], axis=-1)


@functools.lru_cache(maxsize=4, typed=True)  # 64 and 64.0 are not the same argument
def schlick_table(size: int = 64, smith: Smith = "separable") -> AlbedoTable:
    """Karis's table of A and B, with a third function for F82.

    Schlick's curve with its correction is F0 (1 - (1 - c)^5) + (1 - c)^5 - a c (1 - c)^6, linear
    in (F0, 1, a), so its albedo is F0 A + B + a C.

    Parameters
    ----------
    size : int or (width, height)
    smith : {"separable", "correlated"}

    Returns
    -------
    AlbedoTable
        Of three terms: A, B and C. The last four are kept.

    Raises
    ------
    InputError
        For other sizes and conventions.

    Examples
    --------
    >>> schlick_table(16).values.shape
    (16, 16, 3)
    """
    return AlbedoTable.bake(_schlick_functions, size, smith)


def schlick_albedo(f0: ArrayLike, table: AlbedoTable | None = None) -> SplitAlbedo:
    """Albedo of Schlick's curve, F0 A + B (Karis 2013).

    Parameters
    ----------
    f0 : (3,) float, or one for all channels
        Reflectances at normal incidence.
    table : AlbedoTable, optional
        Of `schlick_table`; the default one if none is given.

    Returns
    -------
    SplitAlbedo

    Raises
    ------
    InputError
        For other shapes, values that are not finite, and tables of other than three terms.

    Examples
    --------
    >>> gold = schlick_albedo([1.0, 0.78, 0.34])
    >>> gold(1.0, 0.0).round(2).tolist()
    [1.0, 0.78, 0.34]
    """
    return f82_albedo(f0, None, table)


def f82_albedo(
    f0: ArrayLike, f82: ArrayLike | None, table: AlbedoTable | None = None
) -> SplitAlbedo:
    """Albedo of Schlick's curve bent through a given reflectance at cos = 1/7 (Hoffman 2019).

    Parameters
    ----------
    f0, f82 : (3,) float
        Reflectances at normal incidence and at cos = 1/7; None for Schlick's curve as it is.
    table : AlbedoTable, optional
        Of `schlick_table`; the default one if none is given.

    Returns
    -------
    SplitAlbedo

    Raises
    ------
    InputError
        For other shapes, values that are not finite, and tables of other than three terms.
    """
    f0 = _three("f0", f0)
    bend = np.zeros(3) if f82 is None else bend_factor(f0, _three("f82", f82))
    return SplitAlbedo(table or schlick_table(), np.stack([f0, np.ones(3), bend], axis=-1))


def _three(name: str, value: ArrayLike) -> np.ndarray:
    array = np.asarray(value)
    if array.dtype.kind not in "fiu" or array.shape not in ((), (1,), (3,)):
        given = f"{name}: {array.dtype} array of shape {array.shape}"
    elif not np.isfinite(array).all():
        given = f"{name}={array.tolist()}"
    else:
        return np.broadcast_to(array.astype(np.float64), 3)
    raise input_error(
        given, "three finite numbers, or one", "Reflectances of linear red, green and blue."
    )


@dataclass(frozen=True, eq=False)
class CompensatedAlbedo:
    """Directional albedo with multiple scattering; made by `compensated_albedo`."""

    energy: EnergyTable
    coefficients: Any

    def __call__(self, mu: Any, alpha: Any) -> Any:
        """(..., 3) float array, or a tuple of three Dr.Jit arrays; see `SplitAlbedo`."""
        single = SplitAlbedo(self.energy.table, self.coefficients)
        functions = single.table.lookup(mu, alpha)
        plain = single._weighed(functions)
        if not is_drjit(mu, alpha):
            rows = np.asarray(self.coefficients, np.float64)
            alphas = np.asarray(alpha)[..., None]
            factor = self.energy.factor(rows, np.broadcast_to(alphas, (*alphas.shape[:-1], 3)))
            return plain * scaling(functions[..., :1], factor).astype(plain.dtype)
        kind = type(functions[0])
        factors = (
            self.energy.factor([of_kind(kind, c) for c in row], alpha) for row in self.coefficients
        )
        share = missing(functions[0]) / functions[0]
        return tuple(f * (1.0 + k * share) for f, k in zip(plain, factors, strict=True))


def compensated_albedo(energy: EnergyTable, coefficients: Any) -> CompensatedAlbedo:
    """Albedo of a material, scaled by 1 + K (1 - E) / E: what `energy` puts back.

    The plugin with `energy_compensation` has this albedo, with either kind of compensation. K is
    the same for all pixels of a surface of one roughness and colour.

    Parameters
    ----------
    energy : EnergyTable
    coefficients : (3, terms) float, or three sequences of `terms` Dr.Jit arrays
        As for `SplitAlbedo`.

    Raises
    ------
    InputError
        As `SplitAlbedo` does.

    Examples
    --------
    >>> from fresnel_decomp import AlbedoTable, load_basis
    >>> from fresnel_decomp.energy import EnergyTable
    >>> basis = load_basis()
    >>> energy = EnergyTable.of(AlbedoTable.bake(basis, size=16), basis)
    >>> white = compensated_albedo(energy, [[1.0, 0.0, 0.0, 0.0]] * 3)
    >>> white(0.5, 0.6).round(6).tolist()
    [1.0, 1.0, 1.0]
    """
    SplitAlbedo(energy.table, coefficients)  # checks them
    return CompensatedAlbedo(energy, coefficients)


def integrated_albedo(
    curve: Callable[[Any], Any],
    alpha: float,
    smith: Smith = "separable",
    *,
    cosines: int = _COSINES,
) -> SplitAlbedo:
    """Albedo of any curve at one roughness, by `directional_albedo` at 1,025 cosines.

    Parameters
    ----------
    curve : callable from (..., 1) cosines to (..., 3) reflectances
        Such as `Exact(eta, k)` with (3,) indices.
    alpha : float in [0, ROUGHEST]
        The result is for this roughness, whatever it is called with.
    smith : {"separable", "correlated"}
    cosines : int ≥ 2
        Between them the albedo is interpolated; 65 are enough for a preview, and quick.

    Returns
    -------
    SplitAlbedo

    Raises
    ------
    InputError
        For other roughnesses, conventions and numbers of cosines.
    """
    if not is_real(alpha, 0.0, ROUGHEST):
        raise input_error(
            f"alpha={alpha!r}",
            f"a number in [0, {ROUGHEST:g}]",
            "It is the square of the perceptual roughness.",
        )
    layout = Layout(cosines, 2)
    root = np.linspace(0.0, 1.0, layout.width)
    values = directional_albedo(
        lambda cos_theta: curve(cos_theta[..., None]), root * root, float(alpha), smith=smith
    )
    table = AlbedoTable(np.stack([values, values]), layout, smith)  # both rows alike
    return SplitAlbedo(table, np.eye(3))

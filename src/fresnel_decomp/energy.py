r"""Energy that a microfacet model loses, put back: multiple scattering in closed form.

Light that is thrown from one microfacet at another is lost to models of a single bounce. How much
of it is what the table of albedos says anyway, since b_0 = 1: with E = bbar_0 the lost share is
1 - E(mu, alpha). Kulla and Conty 2017, "Revisiting Physically Based Shading at Imageworks", send it
out by a second lobe that depends on the two elevations only,

    f(i, o) = C (1 - E_i)(1 - E_o) / (pi L),    L = 2 ∫ (1 - E) mu dmu,

with a colour C that accounts for the bounces in between, which the average reflectance
F_avg = 2 ∫ F mu dmu and a geometric series give. For a basis it is exact: F_avg = sum_j c_j <b_j>.
Here C knows more, at no further fetch. Light was reflected at least twice, for the first time near
the direction it came from, and for the last time near the one it leaves to. A fetch tells the mean
reflectance of those, F_1(mu) = Fbar / E, so

    C = F_1(mu_i) F_1(mu_o) G,      G = (1 - L) / (1 - L F_avg),

where theirs has F_avg for both F_1. (On their slides there is one factor F_avg too few, which Hill
2018, "A Multi-Faceted Exploration", pointed out.) It is symmetric in the directions, and nothing is
lost for F = 1. Its albedo is (1 - E) F_1 K with

    K = G sum_j c_j lambda_j,   lambda_j = 2 ∫ (bbar_j / E)(1 - E) mu dmu / L,

so it equals the single lobe's times (1 - E) K / E. Hence the scaling

    Fbar (1 + K (1 - E) / E),

which is that of Turquin 2019, "Practical Multiple Scattering Compensation for Microfacet Models",
with K in place of F_0: the same albedo from one fetch, for a lobe that stays glossy and is not
symmetric. K depends on roughness and colour only, so once per material where these are constant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._array import is_drjit, ops_for
from ._check import input_error
from ._coefficients import check_terms, weighted_sum
from ._lobe_rule import unit_gauss
from .albedo import average_fresnel
from .microfacet import Distribution, Smith
from .table import AlbedoTable
from .table_layout import Layout

__all__ = [
    "EnergyTable",
    "fdez_aguera",
    "gain",
    "kulla_conty",
    "lobe",
    "missing",
    "scaling",
    "turquin",
]

_NODES = 4  # of a Gauss rule in each cell of the table: exact where F = 1


# --- what shaders evaluate -----------------------------------------------------------------------


def missing(white: Any) -> Any:
    """1 - E, and 0 where a table's rounding makes E exceed 1.

    Parameters
    ----------
    white : (...) float
        E, the albedo of a perfect reflector.
    """
    ops = ops_for(white)
    # selected and not clipped: at E = 1, the limit of smooth surfaces, derivatives pass
    return ops.select(white > 1.0, 0.0, 1.0 - white)


def gain(fresnel_average: Any, loss_average: Any) -> Any:
    """G = (1 - L) / (1 - L F_avg): what gets out of the light between the first and last bounce.

    Parameters
    ----------
    fresnel_average : (...) float
        F_avg, possibly out of [0, 1] as colours are; below 1.5 the result is finite for any
        roughness, since no lobe loses two thirds.
    loss_average : (...) float in [0, 1)
        L.
    """
    return (1.0 - loss_average) / (1.0 - loss_average * fresnel_average)


def scaling(white: Any, factor: Any) -> Any:
    """1 + K (1 - E) / E: what the lobe of a single bounce is multiplied by.

    Parameters
    ----------
    white : (...) float > 0
        E at the view direction.
    factor : (...) float
        K of `EnergyTable.factor`; Turquin's own choice is F_0.

    Examples
    --------
    >>> from fresnel_decomp.energy import scaling
    >>> float(0.75 * scaling(0.75, 1.0))  # a perfect reflector reflects everything
    1.0
    """
    return 1.0 + factor * (missing(white) / white)


def lobe(missing_i: Any, missing_o: Any, loss_average: Any) -> Any:
    """(1 - E_i)(1 - E_o) / (pi L): the BRDF of a perfect reflector's second lobe.

    Times the cosine, its integral over either direction is 1 - E of the other.

    Parameters
    ----------
    missing_i, missing_o : (...) float in [0, 1]
    loss_average : (...) float in [0, 1]
        L; where it is 0 the lobe is 0.
    """
    ops = ops_for(missing_i, missing_o, loss_average)
    some = loss_average > 0.0  # safe before the division, for the sake of its derivative
    divisor = ops.select(some, loss_average, 1.0)
    return ops.select(some, missing_i / divisor * missing_o * (1.0 / math.pi), 0.0)


# --- published closed forms of the albedo --------------------------------------------------------


def kulla_conty(albedo: Any, white: Any, loss_average: Any, fresnel_average: Any) -> Any:
    """Albedo with the lobe of Kulla and Conty: F_avg for the first and the last bounce.

    Parameters
    ----------
    albedo, white : (...) float
        Fbar and E of a single bounce.
    loss_average, fresnel_average : (...) float
        L and F_avg.
    """
    colour = fresnel_average * fresnel_average * gain(fresnel_average, loss_average)
    return albedo + missing(white) * colour


def fdez_aguera(albedo: Any, white: Any, fresnel_average: Any) -> Any:
    """Fbar / (1 - F_avg (1 - E)): the series with E of the view in place of its average.

    Fdez-Agüera 2019, "A Multiple-Scattering Microfacet Model for Real-Time Image Based Lighting".
    Needs the fetch and nothing else.
    """
    return albedo / (1.0 - fresnel_average * missing(white))


def turquin(albedo: Any, white: Any, f0: Any) -> Any:
    """Fbar (1 + F_0 (1 - E) / E)."""
    return albedo * scaling(white, f0)


# --- the table -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class EnergyTable:
    """A table of albedos, and its averages over the hemisphere.

    Made by `EnergyTable.bake`, or by `EnergyTable.of` from a table that there is.

    Attributes
    ----------
    table : AlbedoTable
        Its first function is b_0 = 1.
    averages : (n,) float64
        <b_j>, cosine-weighted.
    losses : AlbedoTable
        L, lambda_1, lambda_2, ... by roughness: two equal columns.

    Examples
    --------
    >>> from fresnel_decomp import load_basis
    >>> from fresnel_decomp.energy import EnergyTable
    >>> basis = load_basis()
    >>> energy = EnergyTable.bake(basis)
    >>> gold = basis.coefficients(0.18, 3.4)
    >>> round(float(energy.average_fresnel(gold)), 3), round(float(energy.factor(gold, 0.6)), 3)
    (0.942, 0.912)
    >>> bool(abs(energy.albedo([1.0, 0.0, 0.0, 0.0], 0.5, 0.6) - 1.0) < 1e-12)  # white furnace
    True
    """

    table: AlbedoTable
    averages: np.ndarray
    losses: AlbedoTable

    @classmethod
    def bake(
        cls,
        basis: Any,
        size: int | tuple[int, int] = 64,
        smith: Smith = "correlated",
        *,
        distribution: Distribution = "ggx",
    ) -> EnergyTable:
        """Bake a table and average it.

        Parameters
        ----------
        basis : Basis, ClosedForm, or callable from (m,) cosines to (m, n) values
            With b_0 = 1.
        size, smith, distribution
            As for `AlbedoTable.bake`, but correlated Smith unless said otherwise, which the plugin
            has with `energy_compensation` too: what a single bounce loses is then what a surface
            throws at itself, and a random walk confirms the sum within .03.

        Raises
        ------
        InputError
            As `AlbedoTable.bake` and `of` do.
        """
        return cls.of(AlbedoTable.bake(basis, size, smith, distribution=distribution), basis)

    @classmethod
    def of(cls, table: AlbedoTable, basis: Any) -> EnergyTable:
        """Average a table, as it is interpolated, and the functions it was baked from.

        Parameters
        ----------
        table : AlbedoTable
        basis : Basis, ClosedForm, or callable from (m,) cosines to (m, n) values
            With b_0 = 1.

        Raises
        ------
        InputError
            If the functions are not as many as the table has, or the first one is not 1; for
            something else than a table.
        """
        if not isinstance(table, AlbedoTable):
            raise input_error(
                f"a {type(table).__name__} as table", "an AlbedoTable",
                "EnergyTable.bake(basis) makes both.",
            )  # fmt: skip
        averages = np.atleast_1d(average_fresnel(basis))
        first = np.asarray(basis(np.linspace(0.0, 1.0, 5)))[:, 0]
        if averages.shape != (table.terms,) or np.abs(first - 1.0).max() > 1e-6:
            raise input_error(
                f"a basis of {averages.size} functions, the first one "
                f"{'1' if np.abs(first - 1.0).max() <= 1e-6 else 'not 1'}, "
                f"and a table of {table.terms}",
                "what the table was baked from, with b_0 = 1",
                "Schlick's functions are 1 and (1 - cos_theta)^5.",
            )
        averages.flags.writeable = False
        layout = table.layout
        loss, fresnel = _averaged(table, layout.alpha)
        # towards alpha = 0 both vanish in proportion, so their ratio in the first row is the limit
        some = loss > 1e-9
        ratio = fresnel[:, 1:] / np.where(some, loss, 1.0)[:, None]
        ratio = ratio[np.maximum(np.arange(len(loss)), np.argmax(some))]
        rows = np.concatenate([loss[:, None], ratio], axis=1)
        narrow = Layout(
            2, layout.height, alpha_axis=layout.alpha_axis, addressing=layout.addressing
        )
        losses = AlbedoTable(
            np.stack([rows, rows], axis=1), narrow, table.smith, table.distribution
        )
        return cls(table, averages, losses)

    def average_fresnel(self, coefficients: Any) -> Any:
        """F_avg = sum_j c_j <b_j>, exact for the basis.

        Parameters
        ----------
        coefficients : (..., terms) float, or for Dr.Jit a sequence of `terms` arrays

        Returns
        -------
        (...) float or a Dr.Jit array
        """
        coefficients = check_terms(coefficients, 0.0, self.table.terms)
        return weighted_sum(coefficients, tuple(float(value) for value in self.averages))

    def factor(self, coefficients: Any, alpha: Any) -> Any:
        """K, the share of the lost light that gets out, over F_1 of the view.

        Parameters
        ----------
        coefficients : (..., terms) float, or for Dr.Jit a sequence of `terms` arrays
        alpha : (...) float
            Clamped to [0, 1].

        Returns
        -------
        (...) float or a Dr.Jit array: 1 where F = 1, 0 where F = 0; at alpha = 0 the limit.
        """
        coefficients = check_terms(coefficients, alpha, self.table.terms)
        rows = self.losses.lookup(alpha, alpha)  # equal columns: mu does not matter
        loss, *ratios = rows if is_drjit(alpha) else np.moveaxis(rows, -1, 0)
        last = weighted_sum(coefficients, (1.0, *ratios))
        return last * gain(self.average_fresnel(coefficients), loss)

    def albedo(self, coefficients: Any, mu: Any, alpha: Any) -> Any:
        """Directional albedo with multiple scattering, by either of the two lobes.

        Parameters
        ----------
        coefficients : (..., terms) float, or for Dr.Jit a sequence of `terms` arrays
        mu, alpha : (...) float
            Clamped to [0, 1].

        Returns
        -------
        (...) float or a Dr.Jit array, differentiable in all arguments
        """
        coefficients = check_terms(coefficients, alpha if is_drjit(alpha) else mu, self.table.terms)
        functions = self.table.lookup(mu, alpha)
        if not is_drjit(mu, alpha):
            functions = np.moveaxis(functions, -1, 0)
        single = weighted_sum(coefficients, functions)
        return single * scaling(functions[0], self.factor(coefficients, alpha))


def _averaged(table: AlbedoTable, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n,) averages of 1 - E and (n, terms) of (bbar_j / E)(1 - E), for (n,) roughnesses."""
    part, weight = unit_gauss(_NODES)
    # between nodes the table is linear in the default axis, sqrt(mu)
    edges = np.unique(np.concatenate([[0.0], np.sqrt(table.layout.mu), [1.0]]))
    step = np.diff(edges)[:, None]
    root = (edges[:-1, None] + step * part).ravel()
    weight = (step * weight).ravel() * 4.0 * root**3
    values = table.lookup((root * root)[:, None], alpha[None, :])
    white = values[..., 0]
    share = missing(white) / white
    return weight @ missing(white), np.einsum("m,mnj,mn->nj", weight, values, share)

"""The basis: evaluate it, project indices of refraction onto it, know its error, load it."""

from __future__ import annotations

import copy
import functools
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from ._arguments import check_indices, one_kind, real_arrays
from ._array import detached, drjit_module, is_drjit, ops_for, read_only
from ._check import choose, input_error
from ._coefficients import check_count, check_terms, evaluated, weighted_sum
from ._files import write_json
from .basis_table import BasisTable, Warp, tabulate_basis
from .closed_form import ClosedForm, fit_closed_form
from .curves import error_cosines
from .fresnel import conductor
from .recipes import RECIPES

__all__ = ["Basis", "FitErrors", "load_basis"]

POOR_FIT_ERROR = {3: 0.23, 4: 0.12, 5: 0.12, 6: 0.12}
"""Largest error, by number of terms, above which a fit with eta < 1 is refused: what total internal
reflection exceeds and no metal reaches, with any recipe (.222 with three terms, .1 with more)."""

NEARLY_MATCHED = 0.998
"""Above this eta nothing is refused: with c_1 = 1 - F0 every basis is as weak on the other side of
eta = 1, at grazing angles only, and the coefficients stay continuous across it."""

PoorFit = Literal["raise", "keep"]


class FitErrors(NamedTuple):
    """Absolute error of fitted curves: arrays of the shape of the indices.

    max : over 4,150 angles, dense at grazing incidence (`curves.error_cosines`)
    mean, rmse : over 2,049 cosines, uniform on [0, 1]
    """

    max: np.ndarray
    mean: np.ndarray
    rmse: np.ndarray


@dataclass(frozen=True, eq=False)
class Basis:
    """Functions b_0 = 1, b_1, ... of the cosine, and the nodes that define coefficients.

    Attributes
    ----------
    recipe : str
        Name of the recipe, "custom" for a user's own.
    nodes : (terms - 2,) float
        Interior nodes in radians; 0 and pi/2 are nodes of every basis.
    series : (terms - 1, n) float
        Chebyshev coefficients of b_1, b_2, ... in 2 cos_theta - 1: the extracted functions to
        rounding, without the training curves.
    provenance : mapping
        Recipe, training set and its hash, rules, versions.
    shipped_form : ClosedForm or None
        The closed form that a loaded basis brings; see `closed_form`.

    Raises
    ------
    InputError
        For nodes, series and closed form that do not belong together, or are not finite.

    Examples
    --------
    >>> from fresnel_decomp import load_basis
    >>> basis = load_basis("talk")
    >>> c = basis.coefficients(1.5, 0.0)
    >>> float(round(basis.evaluate(c, 1.0), 6))
    0.04
    """

    recipe: str
    nodes: np.ndarray
    series: np.ndarray = field(repr=False)
    provenance: Mapping[str, Any] = field(repr=False)
    shipped_form: ClosedForm | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        nodes, series = np.asarray(self.nodes), np.asarray(self.series)
        form = self.shipped_form
        fits = series.ndim == 2 and nodes.shape == (len(series) - 1,)
        if not fits or not (form is None or form.terms == self.terms):
            raise input_error(
                f"nodes of shape {nodes.shape}, series of shape {series.shape}"
                + (f", a closed form of {form.terms} terms" if form else ""),
                "(terms - 2,), (terms - 1, n), and as many terms",
                "One node inside for each of b_2, b_3, ...",
            )
        if not (np.isfinite(series).all() and np.all((nodes > 0.0) & (nodes < np.pi / 2))):
            raise input_error(
                f"nodes {nodes.tolist()} with series up to {np.abs(series).max():g}",
                "angles in (0, pi/2), in radians, and finite series",
                "0 and pi/2 are always nodes.",
            )
        # a loaded basis is shared by everyone who loads it
        object.__setattr__(self, "nodes", read_only(self.nodes))
        object.__setattr__(self, "series", read_only(self.series))
        object.__setattr__(
            self, "provenance", MappingProxyType(copy.deepcopy(dict(self.provenance)))
        )

    @property
    def terms(self) -> int:
        """Number of basis functions, b_0 = 1 included."""
        return len(self.series) + 1

    @functools.cached_property
    def closed_form(self) -> ClosedForm:
        """The rationals that shaders evaluate, within 1e-4 of the extracted functions.

        A loaded basis brings them; for one just extracted they are fitted on first use, which
        takes seconds. Those of a regression are the extracted functions themselves.
        """
        return self.shipped_form or fit_closed_form(lambda cos_theta: self(cos_theta)[:, 1:])

    def table(
        self,
        size: int,
        warp: Warp = "sqrt",
        storage: Literal["float32", "float16"] = "float32",
    ) -> BasisTable:
        """The functions sampled at `size` cosines for linear interpolation.

        Parameters
        ----------
        size : int >= 2
        warp : {"cos", "sqrt"}
            In what samples are equidistant.
        storage : {"float32", "float16"}

        Raises
        ------
        InputError
            As `basis_table.tabulate_basis`.

        Examples
        --------
        >>> from fresnel_decomp import load_basis
        >>> table = load_basis("notebook").table(400)
        >>> table.error < 1e-4, table.nbytes
        (True, 4800)
        """
        return tabulate_basis(lambda c: self(c)[:, 1:], size, warp, storage)

    def __call__(self, cos_theta: Any) -> Any:
        """The extracted basis functions.

        Parameters
        ----------
        cos_theta : (...) float in [0, 1]

        Returns
        -------
        (..., terms) float64 for NumPy arrays and Python floats; for Dr.Jit arrays a tuple of
        `terms` arrays. Outside [0, 1], cosines are clamped.
        """
        if is_drjit(cos_theta):
            select = ops_for(cos_theta).select
            # selected and not clipped: at the ends of [0, 1] derivatives pass
            inside = select(cos_theta < 0.0, 0.0, select(cos_theta > 1.0, 1.0, cos_theta))
            x = 2.0 * inside - 1.0
            return (1.0 + 0.0 * x, *(_clenshaw(row, x) for row in self.series))
        x = 2.0 * np.clip(np.asarray(cos_theta, np.float64), 0.0, 1.0) - 1.0
        return np.stack([np.ones_like(x), *(_clenshaw(row, x) for row in self.series)], axis=-1)

    def evaluate(self, coefficients: Any, cos_theta: Any) -> Any:
        """Reflectance sum_i c_i b_i, unclamped.

        Parameters
        ----------
        coefficients : (..., terms) float, or for Dr.Jit a sequence of `terms` arrays
        cos_theta : (...) float in [0, 1], broadcasts against the coefficients' leading axes
        """
        coefficients = check_terms(coefficients, cos_theta, self.terms)
        return evaluated(self, coefficients, cos_theta)

    @functools.cached_property
    def node_matrix(self) -> np.ndarray:
        """(terms - 2, terms - 2): b_2, b_3, ... (columns) at the interior nodes (rows)."""
        return self(np.cos(self.nodes))[:, 2:]

    @property
    def condition(self) -> float:
        """Condition number of the node system (2-norm): how it amplifies errors in F."""
        return float(np.linalg.cond(self.node_matrix))

    @functools.cached_property
    def _projection(self) -> tuple[np.ndarray, np.ndarray]:
        """(inverse node matrix, b_1 at the nodes)."""
        return np.linalg.inv(self.node_matrix), self(np.cos(self.nodes))[:, 1]

    def coefficients_from_reflectance(self, f0: Any, f_nodes: Any) -> Any:
        """Coefficients of the curve through given reflectances: affine in them.

        Parameters
        ----------
        f0 : (...) float
            Reflectance at normal incidence. Any real number: colours may leave [0, 1].
        f_nodes : (..., terms - 2) float, or for Dr.Jit a sequence of terms - 2 arrays
            Reflectances at `nodes`, in their order.

        Returns
        -------
        (..., terms) float64, or for Dr.Jit a tuple of `terms` arrays. At grazing incidence the
        curve is 1: c_0 = F0 and c_1 = 1 - F0.

        Raises
        ------
        InputError
            If the number of node reflectances is not terms - 2, or shapes do not broadcast.
        """
        inverse, b1 = self._projection
        if is_drjit(f0, *(f_nodes if isinstance(f_nodes, list | tuple) else [f_nodes])):
            self._check_node_count(len(f_nodes))
            f0, *f_nodes = one_kind(f0, *f_nodes)
            f0 = f0 + 0.0 * f_nodes[0]
            rest = [f - f0 - (1.0 - f0) * float(b) for f, b in zip(f_nodes, b1, strict=True)]
            interior = (weighted_sum(rest, row) for row in inverse.tolist())
            return (f0, 1.0 - f0, *interior)
        f0 = np.asarray(f0, np.float64)
        f_nodes = np.asarray(f_nodes, np.float64)
        self._check_node_count(f_nodes.shape[-1] if f_nodes.ndim else 0)
        try:
            np.broadcast_shapes(f0.shape, f_nodes.shape[:-1])
        except ValueError:
            raise input_error(
                f"f0 and f_nodes of shapes {f0.shape} and {f_nodes.shape}",
                "(...) and (..., terms - 2)",
                "Nodes are on the last axis.",
            ) from None
        residual = f_nodes - f0[..., None] - (1.0 - f0[..., None]) * b1
        ends = np.stack([f0, 1.0 - f0], axis=-1)
        interior = residual @ inverse.T
        ends = np.broadcast_to(ends, (*interior.shape[:-1], 2))
        return np.concatenate([ends, interior], axis=-1)

    def _check_node_count(self, count: int) -> None:
        if count != self.terms - 2:
            raise input_error(
                f"{count} node reflectances",
                f"{self.terms - 2}, at {np.round(self.nodes, 4).tolist()} radians",
                f"The '{self.recipe}' basis has {self.terms} terms.",
            )

    def coefficients(self, eta: Any, k: Any, *, poor_fit: PoorFit = "raise") -> Any:
        """Coefficients of the exact curve of an index of refraction, by its values at the nodes.

        Parameters
        ----------
        eta, k : (...) float, eta > 0, k >= 0
        poor_fit : {"raise", "keep"}
            What to do about indices that no linear basis can follow: eta < 1 with little
            absorption, whose curve has a kink at the critical angle. `models.Decomposition`
            can replace them by reciprocity or by the exact equations.

        Returns
        -------
        (..., terms) float64, or for Dr.Jit input a tuple of `terms` arrays, differentiable in
        both. Not checked while Dr.Jit records a loop or a call, or replays a frozen function:
        check before, by `error`.

        Raises
        ------
        InputError
            For indices out of range, and for poor fits unless kept.
        """
        choose("poor_fit", poor_fit, ("raise", "keep"))
        drjit_input = is_drjit(eta, k)
        if drjit_input:
            eta, k = one_kind(eta, k)
            plain = _evaluated(eta, k)
        else:
            eta, k = (value.astype(np.float64) for value in real_arrays(eta=eta, k=k))
            plain = eta, k
        if plain is not None:
            check_indices(*plain)
            if poor_fit == "raise":
                self._refuse_poor_fits(*plain)
        values = [conductor(float(np.cos(node)), eta, k) for node in (0.0, *self.nodes)]
        if drjit_input:
            return self.coefficients_from_reflectance(values[0], values[1:])
        return self.coefficients_from_reflectance(values[0], np.stack(values[1:], axis=-1))

    def poor_fit(self, eta: Any, k: Any, below: float = NEARLY_MATCHED) -> np.ndarray:
        """Where total internal reflection defeats the basis.

        Parameters
        ----------
        eta, k : (...) float, eta > 0, k >= 0
        below : float
            Indices from this eta on count as fitted, see `NEARLY_MATCHED`.

        Returns
        -------
        (...) bool: eta < below, and either k = 0 or a largest error above `POOR_FIT_ERROR`

        Raises
        ------
        InputError
            For indices out of range.
        """
        eta, k = np.broadcast_arrays(np.asarray(eta, np.float64), np.asarray(k, np.float64))
        check_indices(eta, k)
        poor = np.asarray((eta < below) & (k == 0.0))
        unsure = (eta < below) & (k > 0.0)
        if np.any(unsure):
            cos_theta = np.append((np.arange(128) + 0.5) / 128.0, np.geomspace(1e-4, 4e-3, 16))
            error = self._error(eta[unsure], k[unsure], cos_theta, cos_theta).max
            poor[unsure] = error > POOR_FIT_ERROR[self.terms]
        return poor

    def _refuse_poor_fits(self, eta: np.ndarray, k: np.ndarray) -> None:
        poor = self.poor_fit(eta, k)
        if np.any(poor):
            at = tuple(np.argwhere(poor)[0].tolist())
            pair = [float(np.broadcast_to(v, poor.shape)[at]) for v in (eta, k)]
            raise input_error(
                f"eta={pair[0]:g}, k={pair[1]:g}: total internal reflection, which no linear basis "
                f"follows (error {float(self.error(*pair).max):.2f})",
                f"eta >= {NEARLY_MATCHED:g}, or enough absorption for an error of at most "
                f"{POOR_FIT_ERROR[self.terms]:g}",
                "Use the exact equations (fresnel='exact'), or Decomposition.from_ior(..., "
                "poor_fit='substitute').",
            )

    def error(self, eta: Any, k: Any) -> FitErrors:
        """Error of the fit against the exact curve, for each index of refraction.

        Parameters
        ----------
        eta, k : (...) float, eta > 0, k >= 0

        Returns
        -------
        FitErrors of arrays of shape (...)
        """
        return self._error(eta, k, *error_cosines())

    def _error(self, eta: Any, k: Any, everywhere: np.ndarray, uniform: np.ndarray) -> FitErrors:
        eta, k = np.broadcast_arrays(np.asarray(eta, np.float64), np.asarray(k, np.float64))
        uniform_count = len(uniform)  # `everywhere` starts with the uniform points
        functions = self(everywhere)
        rows = [np.zeros((3, 0))]
        size = max(1, 2_000_000 // len(everywhere))
        for start in range(0, eta.size, size):
            e = eta.ravel()[start : start + size, None]
            kk = k.ravel()[start : start + size, None]
            fit = self.coefficients(e[:, 0], kk[:, 0], poor_fit="keep") @ functions.T
            rows.append(_summary(np.abs(fit - conductor(everywhere, e, kk)), uniform_count))
        maximum, mean, rmse = np.concatenate(rows, axis=1).reshape(3, *eta.shape)
        return FitErrors(maximum, mean, rmse)

    def fit(self, cos_theta: Any, reflectance: Any) -> np.ndarray:
        """Least-squares coefficients of sampled curves, c_1 = 1 - c_0 kept.

        Parameters
        ----------
        cos_theta : (m,) float in [0, 1], m >= terms - 1
        reflectance : (..., m) float

        Returns
        -------
        (..., terms) float64

        Raises
        ------
        InputError
            If the shapes do not match, samples are not finite, or there are too few of them.
        """
        cos_theta = np.asarray(cos_theta, np.float64)
        reflectance = np.asarray(reflectance, np.float64)
        if cos_theta.ndim != 1 or reflectance.shape[-1:] != cos_theta.shape:
            raise input_error(
                f"cosines of shape {cos_theta.shape}, reflectances of shape {reflectance.shape}",
                "(m,) and (..., m)",
                "Sample every curve at the same angles.",
            )
        if not (np.isfinite(cos_theta).all() and np.isfinite(reflectance).all()):
            raise input_error(
                "samples that are not finite", "finite cosines and reflectances", "Drop the others."
            )
        if len(cos_theta) < self.terms - 1:
            raise input_error(
                f"{len(cos_theta)} samples", f"at least {self.terms - 1}", "Sample more angles."
            )
        functions = self(cos_theta)
        # F - b_1 = c_0 (1 - b_1) + sum c_j b_j: F = 1 at grazing incidence is built in
        matrix = np.concatenate([1.0 - functions[:, 1:2], functions[:, 2:]], axis=1)
        target = (reflectance - functions[:, 1]).reshape(-1, len(cos_theta)).T
        solution = np.linalg.lstsq(matrix, target, rcond=None)[0].T
        solution = solution.reshape(*reflectance.shape[:-1], self.terms - 1)
        f0 = solution[..., :1]
        return np.concatenate([f0, 1.0 - f0, solution[..., 1:]], axis=-1)

    def to_json(self) -> dict[str, Any]:
        """Everything needed to load the basis again; floats keep their exact value."""
        return {
            "recipe": self.recipe,
            "nodes": self.nodes.tolist(),
            "series": self.series.tolist(),
            "closed_form": {
                "numerators": self.closed_form.numerators.tolist(),
                "denominator": self.closed_form.denominator.tolist(),
                "error": self.closed_form.error,
            },
            "provenance": dict(self.provenance),
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write `to_json` to a file, whole or not at all; `load_basis(path)` reads it.

        Raises
        ------
        InputError
            For a name that does not end in .json.
        """
        if Path(path).suffix != ".json":
            raise input_error(f"the file name '{path}'", "a name ending in .json", "Rename it.")
        write_json(path, self.to_json())

    @staticmethod
    def from_json(data: dict[str, Any]) -> Basis:
        """Inverse of `to_json`."""
        form = data["closed_form"]
        return Basis(
            data["recipe"],
            np.array(data["nodes"]),
            np.array(data["series"]),
            data["provenance"],
            ClosedForm(np.array(form["numerators"]), np.array(form["denominator"]), form["error"]),
        )


def _evaluated(eta: Any, k: Any) -> tuple[np.ndarray, np.ndarray] | None:
    """The values of Dr.Jit arrays; None while Dr.Jit records code that it does not run."""
    dr = drjit_module()
    assert dr is not None
    if dr.flag(dr.JitFlag.SymbolicScope):
        return None
    eta, k = (np.asarray(detached(v), np.float64) for v in (eta + 0.0 * k, k + 0.0 * eta))
    return eta, k


def _summary(error: np.ndarray, uniform_count: int) -> np.ndarray:
    """(3, n): max over all columns, mean and RMSE over the first `uniform_count`."""
    uniform = error[:, :uniform_count]
    rmse = np.sqrt((uniform * uniform).mean(axis=1))
    return np.stack([error.max(axis=1), uniform.mean(axis=1), rmse])


def _clenshaw(series: np.ndarray, x: Any) -> Any:
    """Chebyshev series at x in [-1, 1] by Clenshaw's recurrence."""
    ahead: Any = 0.0
    current: Any = 0.0
    for coefficient in series[:0:-1]:
        ahead, current = current, 2.0 * x * current - ahead + float(coefficient)
    return x * current - ahead + float(series[0])


def load_basis(recipe: str | os.PathLike[str] = "talk", terms: int | None = None) -> Basis:
    """A basis that ships with the package, or one of yours from a file; no extraction is run.

    Parameters
    ----------
    recipe : str or path
        A name of `recipes.RECIPES`, or a file that `Basis.save` wrote (it ends in .json).
    terms : int in 3..6, optional
        b_0 = 1 included. By default 4, or what the file has.

    Raises
    ------
    InputError
        For an unknown recipe or number of terms, and files that hold no such basis.

    Examples
    --------
    >>> from fresnel_decomp import load_basis
    >>> load_basis()
    Basis(recipe='talk', nodes=array([1.45, 1.31]))
    >>> load_basis("balanced", terms=5).terms
    5
    """
    if not isinstance(recipe, str) or recipe.endswith(".json"):
        basis = _from_file(Path(recipe))
        if terms not in (None, basis.terms):
            raise input_error(
                f"terms={terms!r} with '{recipe}'",
                f"{basis.terms}, which the file has",
                "Leave terms out.",
            )
        return basis
    choose("recipe", recipe, RECIPES)
    return _load(recipe, 4 if terms is None else check_count(terms))


@functools.cache
def _load(recipe: str, terms: int) -> Basis:
    file = resources.files(__package__) / "data" / f"{recipe}-{terms}.json"
    return Basis.from_json(json.loads(file.read_text(encoding="utf-8")))


def _from_file(path: Path) -> Basis:
    try:
        return Basis.from_json(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
        raise input_error(
            f"cannot load a basis from '{path}' ({reason})",
            "a .json file that Basis.save wrote",
            f"Shipped ones have names: {', '.join(RECIPES)}.",
        ) from error

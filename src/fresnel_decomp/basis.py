"""The basis: evaluate it, project indices of refraction onto it, and know its error."""

from __future__ import annotations

import copy
import functools
import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from ._array import drjit_module, is_drjit, one_kind, ops_for, real_arrays
from ._check import choose, input_error
from ._files import write_json
from ._version import __version__
from .basis_table import BasisTable, Warp, tabulate_basis
from .closed_form import ClosedForm, check_terms, fit_closed_form, read_only
from .curves import CurveSet, error_cosines
from .extraction import RECIPES, SIGN_RULE, Rule, extract
from .fresnel import conductor
from .regression import Regression, regress
from .regression_recipes import RegressionRecipe, training_for

__all__ = ["Basis", "FitError", "extract_basis", "load_basis"]

POOR_FIT_ERROR = {3: 0.23, 4: 0.12, 5: 0.12, 6: 0.12}
"""Largest error, by number of terms, above which a fit with eta < 1 is refused: what total internal
reflection exceeds and no metal reaches, with any recipe (.222 with three terms, .1 with more)."""

NEARLY_MATCHED = 0.998
"""Above this eta nothing is refused: with c_1 = 1 - F0 every basis is as weak on the other side of
eta = 1, at grazing angles only, and the coefficients stay continuous across it."""

PoorFit = Literal["raise", "keep"]


class FitError(NamedTuple):
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
        drjit_input = is_drjit(cos_theta, *coefficients)
        if drjit_input:
            cos_theta, *coefficients = one_kind(cos_theta, *coefficients)
        functions = self(cos_theta)
        if drjit_input:
            if not is_drjit(cos_theta):
                functions = [float(value) for value in functions]
            return sum(
                (c * b for c, b in zip(coefficients[1:], functions[1:], strict=True)),
                coefficients[0] * functions[0],
            )
        return (np.asarray(coefficients) * functions).sum(axis=-1)

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
            If the number of node reflectances is not terms - 2.
        """
        inverse, b1 = self._projection
        if is_drjit(f0, *(f_nodes if isinstance(f_nodes, list | tuple) else [f_nodes])):
            self._check_node_count(len(f_nodes))
            f0, *f_nodes = one_kind(f0, *f_nodes)
            f0 = f0 + 0.0 * f_nodes[0]
            rest = [f - f0 - (1.0 - f0) * float(b) for f, b in zip(f_nodes, b1, strict=True)]
            interior = (
                sum(
                    (r * float(m) for r, m in zip(rest[1:], row[1:], strict=True)),
                    rest[0] * float(row[0]),
                )
                for row in inverse
            )
            return (f0, 1.0 - f0, *interior)
        f0 = np.asarray(f0, np.float64)
        f_nodes = np.asarray(f_nodes, np.float64)
        self._check_node_count(f_nodes.shape[-1] if f_nodes.ndim else 0)
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
            _check_indices(*plain)
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
        """
        eta, k = np.broadcast_arrays(np.asarray(eta, np.float64), np.asarray(k, np.float64))
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

    def error(self, eta: Any, k: Any) -> FitError:
        """Error of the fit against the exact curve, for each index of refraction.

        Parameters
        ----------
        eta, k : (...) float, eta > 0, k >= 0

        Returns
        -------
        FitError of arrays of shape (...)
        """
        return self._error(eta, k, *error_cosines())

    def _error(self, eta: Any, k: Any, everywhere: np.ndarray, uniform: np.ndarray) -> FitError:
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
        return FitError(maximum, mean, rmse)

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
            If the shapes do not match or there are too few samples.
        """
        cos_theta = np.asarray(cos_theta, np.float64)
        reflectance = np.asarray(reflectance, np.float64)
        if cos_theta.ndim != 1 or reflectance.shape[-1:] != cos_theta.shape:
            raise input_error(
                f"cosines of shape {cos_theta.shape}, reflectances of shape {reflectance.shape}",
                "(m,) and (..., m)",
                "Sample every curve at the same angles.",
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
    """The values of Dr.Jit arrays; None while Dr.Jit records, when there are none."""
    dr = drjit_module()
    assert dr is not None
    if dr.flag(dr.JitFlag.SymbolicScope):
        return None
    eta, k = (np.array(dr.detach(v), np.float64) for v in (eta + 0.0 * k, k + 0.0 * eta))
    return eta, k


def _check_indices(eta: np.ndarray, k: np.ndarray) -> None:
    bad = ~(np.isfinite(eta) & (eta > 0.0) & np.isfinite(k) & (k >= 0.0))
    if np.any(bad):
        at = tuple(np.argwhere(bad)[0].tolist())
        pair = [float(np.broadcast_to(v, bad.shape)[at]) for v in (eta, k)]
        raise input_error(
            f"eta={pair[0]:g}, k={pair[1]:g}" + (f" at index {at}" if at else ""),
            "finite eta > 0 and k >= 0",
            "Absorbing media have k > 0 in the convention eta + i k.",
        )


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
        A name of `extraction.RECIPES`, or a file that `Basis.save` wrote (it ends in .json).
    terms : int in 3..6, optional
        b_0 = 1 included. By default 4, or what the file has.

    Raises
    ------
    InputError
        For an unknown recipe or number of terms, and files that hold no such basis.
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
    terms = 4 if terms is None else terms
    if terms not in (3, 4, 5, 6):
        raise input_error(f"terms={terms!r}", "3, 4, 5 or 6", "Four terms fit one RGBA table.")
    return _load(recipe, int(terms))


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


def extract_basis(
    training: CurveSet | str = "talk",
    terms: int = 4,
    *,
    rule: Rule | None = None,
    nodes: Sequence[float] | None = None,
    grid: int | None = None,
) -> Basis:
    """Extract a basis from exact curves; under a second for 1,000 curves at 1,000 cosines.

    Recipes by constrained regression take some seconds more, for their 19,593 curves.

    Parameters
    ----------
    training : str or CurveSet
        The name of a recipe, which fixes rule, nodes and grid; or a user's own set.
    terms : int in 3..6
    rule, nodes, grid
        For a user's own set only; see `extraction.extract` (default "deflation", no given nodes,
        1,000 cosines).

    Raises
    ------
    InputError
        For an unknown recipe, and as `extraction.extract`.

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp import CurveSet, extract_basis
    >>> metals = CurveSet("mine", np.linspace(0.2, 3.0, 40), np.linspace(6.0, 2.0, 40))
    >>> extract_basis(metals, terms=3).terms
    3
    """
    name = "custom"
    if isinstance(training, str):
        name = choose("recipe", training, RECIPES)
        if (rule, nodes, grid) != (None, None, None):
            raise input_error(
                f"recipe '{name}' with a rule, nodes or a grid of your own",
                "a recipe's name alone, or a CurveSet with these options",
                f"Its curves are RECIPES['{name}'].training().",
            )
        recipe = RECIPES[name]
        if isinstance(recipe, RegressionRecipe):
            return _regressed(name, recipe, terms)
        training, rule, nodes, grid = recipe.training(), recipe.rule, recipe.nodes, recipe.grid
    elif not isinstance(training, CurveSet):
        raise input_error(
            f"a training set of type {type(training).__name__}",
            "a recipe's name or a CurveSet",
            "Make one of your indices: CurveSet('mine', eta, k).",
        )
    rule, nodes, grid = rule or "deflation", nodes or (), 1000 if grid is None else grid
    extraction = extract(training, terms, rule, nodes, grid)
    series = _chebyshev(extraction.functions)
    provenance = {
        "recipe": name,
        "terms": terms,
        "training_set": training.name,
        "training_curves": len(training),
        "training_sha256": training.sha256,
        "grid": f"{grid} cosines, uniform on [0, 1]",
        "rule": rule,
        "sign_rule": SIGN_RULE,
        "given_nodes": [float(node) for node in nodes][: terms - 2],
        "versions": {"fresnel_decomp": __version__, "numpy": np.__version__},
        "sha256": _hash(series),
    }
    return Basis(name, extraction.nodes, series, provenance)


def _regressed(name: str, recipe: RegressionRecipe, terms: int) -> Basis:
    """The basis of a recipe by constrained regression, with its closed form."""
    import scipy

    if terms not in (3, 4, 5, 6):
        raise input_error(f"terms={terms!r}", "3, 4, 5 or 6", "Four terms fit one RGBA table.")
    design = recipe.designs[terms]
    training = training_for(recipe.objective)
    regression = regress(training, design, recipe.weights)
    series = _chebyshev(regression.functions, 1e-13)
    curves = recipe.training()
    provenance = {
        "recipe": name,
        "terms": terms,
        "training_set": curves.name,
        "training_curves": len(curves),
        "training_sha256": curves.sha256,
        "sets_sha256": {key: members.sha256 for key, members in training.sets.items()},
        "grid": f"{len(training.cos_theta)} cosines, dense at grazing incidence",
        "rule": "regression",
        "sign_rule": SIGN_RULE,
        "given_nodes": list(design.nodes),
        "pole": design.pole,
        "degrees": list(design.degrees),
        "objective": recipe.objective._asdict(),
        "weights": dict(recipe.weights),
        "bounds": dict(design.bounds),
        "versions": {
            "fresnel_decomp": __version__,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        "sha256": _hash(series),
    }
    form = _with_error(regression, series)
    return Basis(name, regression.nodes, series, provenance, form)


def _with_error(regression: Regression, series: np.ndarray) -> ClosedForm:
    """The rationals of a regression, and how far the series is from them: rounding."""
    cos_theta = np.linspace(0.0, 1.0, 1501) ** 2
    values = np.polynomial.chebyshev.chebval(2.0 * cos_theta - 1.0, series.T).T
    error = float(np.abs(regression.functions(cos_theta) - values).max())
    return replace(regression.form, error=error)


def _hash(series: np.ndarray) -> str:
    return hashlib.sha256(np.round(series, 12).astype("<f8").tobytes()).hexdigest()


def _chebyshev(
    functions: Callable[[np.ndarray], np.ndarray], tolerance: float = 1e-12
) -> np.ndarray:
    """(terms - 1, n) Chebyshev coefficients in 2 cos_theta - 1, of the least sufficient length."""
    for size in (64, 128, 256, 512, 1024):
        x = np.cos(np.pi * (np.arange(size) + 0.5) / size)
        values = functions((x + 1.0) / 2.0)
        angles = np.pi * np.outer(np.arange(size), np.arange(size) + 0.5) / size
        series = (2.0 / size * np.cos(angles) @ values).T
        series[:, 0] /= 2.0
        significant = np.flatnonzero(np.abs(series).max(axis=0) > tolerance)
        if significant[-1] < size - 8:
            return series[:, : significant[-1] + 1]
    return series

"""Only what a scene needs: the cheapest Fresnel term for each surface that keeps a bound.

Given the surfaces of a scene (`Surface`: indices of refraction, roughness, how they are lit), a
`Plan` says which of Schlick's curve, F82, a decomposition of 3 to 6 terms or the exact equations
each of them takes. All decompositions of a plan share one basis, since an engine has one table: a
shipped one, or one extracted for just these surfaces where that needs fewer terms. Cost is the
number of floating-point operations of an evaluation, which `mitsuba.operations` counts in kernels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from ._check import InputError, choose, input_error
from ._coefficients import TERMS
from .albedo import directional_albedo
from .basis import Basis, load_basis
from .curves import CurveSet
from .extraction import extract_basis
from .models import F82, Schlick
from .prediction import (
    METRICS,
    Metric,
    Surface,
    differences,
    operations,
    predicted_error,
)
from .recipes import RECIPES
from .table import AlbedoTable

__all__ = ["Choice", "LeftExact", "Plan", "Table", "plan_surfaces"]

TABLE_SIZES = (16, 32, 64, 128)


@dataclass(frozen=True, eq=False)
class Choice:
    """What a surface takes.

    Attributes
    ----------
    surface : Surface
    model : {"schlick", "f82", "decomposition", "exact"}
    error : float
        Predicted; 0 for the exact equations.
    operations : int
        Of one evaluation of all channels.
    numbers : int
        Stored per channel: F0, or F0 and a factor, or coefficients, or eta and k.
    coefficients : (n, numbers) float or None
    why : str
        Where the exact equations stay.
    """

    surface: Surface
    model: Literal["schlick", "f82", "decomposition", "exact"]
    error: float
    operations: int
    numbers: int
    coefficients: np.ndarray | None = None
    why: str = ""

    @property
    def exact_operations(self) -> int:
        """What the exact equations take."""
        return operations("exact", len(self.surface.eta))


@dataclass(frozen=True, eq=False)
class LeftExact:
    """A surface of a scene that no plan touches.

    Attributes
    ----------
    name, kind : str
        Its name and the type of its BSDF.
    why : str
    gain : str
        What it would gain from a counterpart of its BSDF; a plan fills it in where `surface` says
        what there is to represent.
    surface : Surface or None
    """

    name: str
    kind: str
    why: str
    gain: str = ""
    surface: Surface | None = None


@dataclass(frozen=True)
class Table:
    """The preintegrated table that image-based light takes, see `table.AlbedoTable`.

    Attributes
    ----------
    distribution : {"ggx", "beckmann"}
    size : int
        Texels along roughness and along the cosine.
    channels : int
        One for each term; up to four fit one RGBA texture.
    nbytes : int
        As half floats.
    error : float
        By which interpolation changes the averaged reflectance of a surface of the plan, at most,
        in units of the plan's metric.
    enough : bool
        Whether that is at most a tenth of the bound; if not, the largest size is not enough.
    """

    distribution: Literal["ggx", "beckmann"]
    size: int
    channels: int
    nbytes: int
    error: float
    enough: bool


@dataclass(frozen=True, eq=False)
class Plan:
    """The cheapest representations that keep a bound.

    Attributes
    ----------
    max_error : float
    metric : {"reflectance", "delta-e"}
    choices : tuple of Choice
    basis : Basis or None
        Shared by all decompositions; None if there is none: then nothing needs to be carried.
    left : tuple of LeftExact
    tables : tuple of Table
        The smallest tables that image-based light needs beside the closed form of the basis, one
        for each distribution of normals in use.
    """

    max_error: float
    metric: Metric
    choices: tuple[Choice, ...]
    basis: Basis | None
    left: tuple[LeftExact, ...] = field(default=())
    tables: tuple[Table, ...] = ()

    @property
    def operations(self) -> int:
        """Of evaluating every surface once."""
        return sum(choice.operations for choice in self.choices)

    @property
    def exact_operations(self) -> int:
        """The same with the exact equations throughout."""
        return sum(choice.exact_operations for choice in self.choices)

    @property
    def nbytes(self) -> int:
        """Constants of the closed form and numbers of all surfaces, in float32."""
        numbers = sum(choice.numbers * len(choice.surface.eta) for choice in self.choices)
        if self.basis is not None:
            form = self.basis.closed_form
            numbers += int(np.count_nonzero(form.numerators) + np.count_nonzero(form.denominator))
        return 4 * numbers


def plan_surfaces(
    surfaces: Sequence[Surface],
    max_error: float,
    metric: Metric = "reflectance",
    *,
    recipes: Sequence[str] = tuple(RECIPES),
    own_basis: bool = True,
    left: Sequence[LeftExact] = (),
    progress: Callable[[float], object] | None = None,
) -> Plan:
    """Choose for every surface the cheapest representation that keeps a bound.

    Where light comes from everywhere, terms that can be averaged ahead of time are preferred to the
    exact equations even if these have fewer operations, which happens for single channels.

    Parameters
    ----------
    surfaces : sequence of Surface
    max_error : float > 0
        Largest predicted error, in reflectance or in CIEDE2000.
    metric : {"reflectance", "delta-e"}
    recipes : sequence of str
        Shipped bases that may be taken.
    own_basis : bool
        Also extract bases from these surfaces, by deflation; taken where that costs less.
    left : sequence of LeftExact
        Passed on to the plan.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        For a bound that is not positive, an unknown metric or recipe.

    Examples
    --------
    >>> from fresnel_decomp.plan import plan_surfaces
    >>> from fresnel_decomp.prediction import Surface
    >>> glass = Surface("glass", [1.5], [0.0])
    >>> gold = Surface("gold", [0.14, 0.37, 1.44], [3.98, 2.38, 1.60])
    >>> [choice.model for choice in plan_surfaces([glass, gold], 0.04).choices]
    ['schlick', 'schlick']
    >>> [choice.model for choice in plan_surfaces([glass, gold], 0.01, own_basis=False).choices]
    ['decomposition', 'decomposition']
    """
    if not (np.isfinite(max_error) and max_error > 0.0):
        raise input_error(
            f"max_error={max_error}",
            "a number > 0",
            "0.01 means one per cent of the incident light; 1 in ΔE00 is just visible.",
        )
    choose("metric", metric, METRICS)
    bases = [load_basis(choose("recipe", r, RECIPES), terms) for terms in TERMS for r in recipes]
    fitted = [surface for surface in surfaces if not _total_reflection(surface)]
    if own_basis and fitted:
        bases += _own_bases(fitted)
    steps = max(1, len(surfaces) * (2 + len(bases)))
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done / steps)

    simple: dict[Surface, list[Choice]] = {}
    for surface in surfaces:
        simple[surface] = [_simple(surface, "schlick", metric), _simple(surface, "f82", metric)]
        if not surface.averaged:
            simple[surface].append(_exact(surface))
        step()
        step()
    # where light is averaged, terms that can be averaged go first: the exact ones have no table
    best: tuple[tuple[float, ...], tuple[Choice, ...], Basis | None] | None = None
    for basis in (None, *sorted(bases, key=lambda b: operations("decomposition", 3, b))):
        choices = []
        for surface in surfaces:
            options = simple[surface]
            if basis is not None:
                step()
                cost = operations("decomposition", len(surface.eta), basis)
                if all(option.operations > cost or option.error > max_error for option in options):
                    options = options + _decomposed(surface, basis, metric)
            keep = [option for option in options if option.error <= max_error]
            choices.append(min(keep, key=lambda c: c.operations, default=_exact(surface)))
        used = any(choice.model == "decomposition" for choice in choices)
        if basis is not None and not used:
            continue
        left_exact = sum(c.model == "exact" and c.surface.averaged for c in choices)
        total = sum(choice.operations for choice in choices)
        worst = max((choice.error for choice in choices), default=0.0)
        rank = (left_exact, total, worst)
        if best is None or rank < best[0]:
            best = rank, tuple(choices), basis if used else None
    assert best is not None
    _, chosen, basis = best
    told = tuple(_with_gain(entry, max_error, metric) for entry in left)
    tables = _tables(chosen, basis, max_error, metric)
    return Plan(float(max_error), metric, chosen, basis, told, tables)


def _with_gain(entry: LeftExact, max_error: float, metric: Metric) -> LeftExact:
    """The entry, with the cheapest that its surface would take if it could."""
    surface = entry.surface
    if surface is None or entry.gain:
        return entry
    option = next((c for c in _shipped(surface, metric) if c.error <= max_error), None)
    if option is None:
        return replace(entry, gain="nothing: no term keeps the bound")
    name: str = option.model
    if name == "decomposition":
        name = f"decomposition of {option.numbers} terms"
    exact = operations("exact", len(surface.eta))
    gain = f"{name}: error {option.error:.2g}, {option.operations} operations, not {exact}"
    return replace(entry, gain=gain)


def _tables(
    choices: Sequence[Choice], basis: Basis | None, max_error: float, metric: Metric
) -> tuple[Table, ...]:
    """For each distribution the smallest table with an error below a tenth of the bound."""
    rough = [c for c in choices if c.model == "decomposition" and c.surface.alpha is not None]
    if basis is None:
        return ()
    found = []
    for distribution in dict.fromkeys(choice.surface.distribution for choice in rough):
        users = [choice for choice in rough if choice.surface.distribution == distribution]
        error = np.inf
        for size in TABLE_SIZES:
            table = AlbedoTable.bake(basis, size, distribution=distribution)
            error = max(_interpolation_error(table, basis, choice, metric) for choice in users)
            if error <= 0.1 * max_error:
                break
        nbytes = 2 * (4 if basis.terms <= 4 else 8) * size * size
        enough = error <= 0.1 * max_error
        found.append(Table(distribution, size, basis.terms, nbytes, error, enough))
    return tuple(found)


def _interpolation_error(table: AlbedoTable, basis: Basis, choice: Choice, metric: Metric) -> float:
    """What looking up instead of integrating changes for a surface, views from cos = .01 on."""
    surface, coefficients = choice.surface, choice.coefficients
    assert surface.alpha is not None
    assert coefficients is not None
    mu, error = np.linspace(0.1, 1.0, 46) ** 2, 0.0
    low, high = np.sqrt(surface.alpha)
    for alpha in np.unique(np.linspace(low, high, 5) ** 2):
        exact = directional_albedo(basis, mu, alpha, distribution=surface.distribution)
        looked_up = table.lookup(mu, alpha) @ coefficients.T
        change = differences(surface, exact @ coefficients.T, looked_up, metric)
        error = max(error, float(np.abs(change).max()))
    return error


# --- candidates ----------------------------------------------------------------------------------


def _simple(surface: Surface, model: Literal["schlick", "f82"], metric: Metric) -> Choice:
    make: Any = {"schlick": Schlick, "f82": F82}[model]
    fit = make.from_ior(surface.eta, surface.k)
    error = predicted_error(surface, fit, metric)
    cost = operations(model, len(surface.eta))
    return Choice(surface, model, error, cost, {"schlick": 1, "f82": 2}[model])


def _decomposed(surface: Surface, basis: Basis, metric: Metric) -> list[Choice]:
    if _total_reflection(surface):
        return []
    coefficients = basis.coefficients(surface.eta, surface.k, poor_fit="keep")
    form = basis.closed_form
    error = predicted_error(
        surface, lambda cos_theta: form.evaluate(coefficients, cos_theta), metric
    )
    cost = operations("decomposition", len(surface.eta), basis)
    return [Choice(surface, "decomposition", error, cost, basis.terms, coefficients)]


def _shipped(surface: Surface, metric: Metric) -> Iterator[Choice]:
    """All terms that ship, from cheap to dear, each predicted only when it is asked for."""
    yield _simple(surface, "schlick", metric)
    yield _simple(surface, "f82", metric)
    bases = [load_basis(recipe, terms) for terms in TERMS for recipe in RECIPES]
    for basis in sorted(bases, key=lambda b: operations("decomposition", 3, b)):
        yield from _decomposed(surface, basis, metric)


def _exact(surface: Surface) -> Choice:
    why = "no cheaper term keeps the bound"
    if _total_reflection(surface):
        why = "eta < 1: total internal reflection, which no linear basis follows"
    return Choice(surface, "exact", 0.0, operations("exact", len(surface.eta)), 2, None, why)


def _total_reflection(surface: Surface) -> bool:
    return bool(np.any(load_basis().poor_fit(surface.eta, surface.k)))


def _own_bases(surfaces: Sequence[Surface]) -> list[Basis]:
    """Bases of 3 and 4 terms for just these indices, where they are enough and differ enough."""
    eta, k = (np.concatenate([getattr(s, name) for s in surfaces]) for name in ("eta", "k"))
    unique = np.unique(np.stack([eta, k], axis=1), axis=0)
    if len(unique) > 1000:
        unique = unique[np.linspace(0, len(unique) - 1, 1000).astype(int)]
    found = []
    for terms in (3, 4):
        if len(unique) < terms:
            break
        try:
            basis = extract_basis(CurveSet("scene", *unique.T), terms)
            assert basis.closed_form.terms == terms
        except InputError:  # too much alike, or no closed form: the shipped ones remain
            break
        found.append(basis)
    return found

"""Only what a scene needs: the cheapest Fresnel term for each surface that keeps a bound.

Given the surfaces of a scene (`Surface`: indices of refraction, roughness, how they are lit), a
`Plan` says which of Schlick's curve, F82, a decomposition of 3 to 6 terms or the exact equations
each of them takes. All decompositions of a plan share one basis, since an engine has one table: a
shipped one, or one extracted for just these surfaces where that needs fewer terms. Cost is the
number of floating-point operations of an evaluation, which `mitsuba.operations` counts in kernels.

"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from ._check import InputError, choose, input_error
from .albedo import directional_albedo
from .basis import Basis, extract_basis, load_basis
from .curves import CurveSet
from .extraction import RECIPES
from .models import F82, Schlick
from .prediction import METRICS, Metric, Surface, operations, predicted_error
from .table import AlbedoTable

__all__ = ["Choice", "LeftExact", "Plan", "Table", "plan_surfaces"]

TERMS = (3, 4, 5, 6)
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
    coefficients : (n, terms) float or None
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
    size : int
        Texels along roughness and along the cosine.
    terms : int
        Channels; up to four fit one RGBA texture.
    nbytes : int
        As half floats.
    error : float
        By which interpolation changes the averaged reflectance of a surface of the plan, at most.
    """

    size: int
    terms: int
    nbytes: int
    error: float


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
    table : Table or None
        The smallest table that image-based light needs beside the closed form of the basis.
    """

    max_error: float
    metric: Metric
    choices: tuple[Choice, ...]
    basis: Basis | None
    left: tuple[LeftExact, ...] = field(default=())
    table: Table | None = None

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

    simple = {}
    for surface in surfaces:
        for model in ("schlick", "f82"):
            simple[surface, model] = _simple(surface, model, metric)
            step()
    best: tuple[tuple[float, ...], tuple[Choice, ...], Basis | None] | None = None
    for basis in (None, *sorted(bases, key=lambda b: operations("decomposition", 3, b))):
        choices = []
        for surface in surfaces:
            options = [simple[surface, "schlick"], simple[surface, "f82"]]
            if basis is not None:
                options += _decomposed(surface, basis, metric)
                step()
            keep = [option for option in options if option.error <= max_error]
            chosen = min(keep, key=lambda c: c.operations, default=None)
            choices.append(_exact(surface) if chosen is None else chosen)
        used = any(choice.model == "decomposition" for choice in choices)
        if basis is not None and not used:
            continue
        total = sum(choice.operations for choice in choices)
        left_exact = sum(choice.model == "exact" for choice in choices)
        worst = max((choice.error for choice in choices), default=0.0)
        # integrable terms first: the exact equations have no table
        rank = (left_exact, total, worst)
        if best is None or rank < best[0]:
            best = rank, tuple(choices), basis if used else None
    assert best is not None
    told = tuple(_with_gain(entry, best[2], max_error, metric) for entry in left)
    return Plan(
        float(max_error), metric, best[1], best[2], told, _table(best[1], best[2], max_error)
    )


def _with_gain(
    entry: LeftExact, basis: Basis | None, max_error: float, metric: Metric
) -> LeftExact:
    """The entry, with what its surface would take if it could."""
    surface = entry.surface
    if surface is None or entry.gain:
        return entry
    options = [_simple(surface, "schlick", metric), _simple(surface, "f82", metric)]
    for candidate in (basis, *(load_basis("talk", terms) for terms in TERMS)):
        if candidate is not None:
            options += _decomposed(surface, candidate, metric)
    keep = [option for option in options if option.error <= max_error]
    if not keep:
        return replace(entry, gain="nothing: no term keeps the bound")
    cheapest = min(keep, key=lambda option: option.operations)
    exact = operations("exact", len(surface.eta))
    name: str = cheapest.model
    if name == "decomposition":
        name = f"decomposition of {cheapest.numbers} terms"
    gain = f"{name}: error {cheapest.error:.2g}, {cheapest.operations} operations, not {exact}"
    return replace(entry, gain=gain)


def _table(choices: Sequence[Choice], basis: Basis | None, max_error: float) -> Table | None:
    """The smallest table with an error below a tenth of the bound, or below .001."""
    rough = [c for c in choices if c.model == "decomposition" and c.surface.alpha is not None]
    if basis is None or not rough:
        return None
    mu, tolerance = np.linspace(0.1, 1.0, 46) ** 2, max(0.1 * max_error, 1e-3)
    for size in TABLE_SIZES:
        error = 0.0
        table = AlbedoTable.bake(basis, size)
        for choice in rough:
            assert choice.surface.alpha is not None
            assert choice.coefficients is not None
            low, high = np.sqrt(choice.surface.alpha)
            for alpha in np.unique(np.linspace(low, high, 5) ** 2):
                exact = directional_albedo(basis, mu, alpha)
                change = (table.lookup(mu, alpha) - exact) @ choice.coefficients.T
                error = max(error, float(np.abs(change).max()))
        if error <= tolerance:
            break
    channels = 4 if basis.terms <= 4 else 8
    return Table(size, basis.terms, 2 * channels * size * size, error)


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


def _exact(surface: Surface) -> Choice:
    why = "no term keeps the bound"
    if _total_reflection(surface):
        why = "eta < 1: total internal reflection, which no linear basis follows"
    return Choice(surface, "exact", 0.0, operations("exact", len(surface.eta)), 2, None, why)


@functools.cache
def _judge() -> Basis:
    return load_basis()


def _total_reflection(surface: Surface) -> bool:
    return bool(np.any(_judge().poor_fit(surface.eta, surface.k)))


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

"""Only what a scene needs: the cheapest Fresnel term for each surface that keeps a bound.

Given the surfaces of a scene (`Surface`: indices of refraction, roughness, how they are lit), a
`Plan` says which of Schlick's curve, F82, a decomposition of 3 to 6 terms or the exact equations
each of them takes. All decompositions of a plan share one basis, since an engine has one table: a
shipped one, or one extracted for just these surfaces where that needs fewer terms. Cost is the
number of floating-point operations of an evaluation, which `mitsuba.operations` counts in kernels.

The predicted error of a surface is the largest over the angle of view. A smooth surface, or one
that a point light illuminates, shows its reflectance at single angles, so this is the largest error
of the curve. Light from everywhere is averaged over the lobe of normals, and so is the error (its
absolute value, weighted by what the lobe reflects): rough surfaces under an environment need less.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from ._check import InputError, choose, input_error
from .basis import Basis, extract_basis, load_basis
from .colour import WAVELENGTH_NM, delta_e_2000, rgb_weights
from .curves import CurveSet, error_cosines
from .extraction import RECIPES
from .fresnel import conductor
from .models import F82, Schlick

__all__ = [
    "EXACT_OPERATIONS",
    "METRICS",
    "Choice",
    "LeftExact",
    "Plan",
    "Surface",
    "operations",
    "plan_surfaces",
]

Metric = Literal["reflectance", "delta-e"]
METRICS = ("reflectance", "delta-e")

EXACT_OPERATIONS = 34
"""Operations of `mi.fresnel_conductor` per channel, as counted in its kernel."""

TERMS = (3, 4, 5, 6)

_LOBE_COSINES = np.linspace(0.1, 1.0, 19) ** 2  # of the view, dense at grazing angles


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface whose reflectance is given by an index of refraction.

    Attributes
    ----------
    name : str
    eta, k : (n,) float, eta > 0, k >= 0
        One for each channel that is evaluated, or for each of `wavelength_nm`.
    alpha : (float, float) or None
        Least and greatest roughness; None for a smooth surface.
    punctual : bool
        Whether point, spot or directional lights shine on it.
    distribution : {"ggx", "beckmann"}
    wavelength_nm : (n,) float or None
        Where eta and k belong to wavelengths and not to channels.

    Raises
    ------
    InputError
        For other shapes and ranges than these.
    """

    name: str
    eta: np.ndarray
    k: np.ndarray
    alpha: tuple[float, float] | None = None
    punctual: bool = False
    distribution: str = "ggx"
    wavelength_nm: np.ndarray | None = None

    def __post_init__(self) -> None:
        curves = CurveSet(self.name, np.ravel(self.eta), np.ravel(self.k))
        object.__setattr__(self, "eta", curves.eta)
        object.__setattr__(self, "k", curves.k)
        choose("distribution", self.distribution, ("ggx", "beckmann"))
        if self.alpha is not None and not 0.0 < self.alpha[0] <= self.alpha[1]:
            raise input_error(
                f"alpha={self.alpha} of '{self.name}'",
                "(least, greatest) > 0, or None",
                "Smooth surfaces have None.",
            )

    @property
    def averaged(self) -> bool:
        """Whether light comes from everywhere and the lobe averages over angles."""
        return self.alpha is not None and not self.punctual

    def to_rgb(self, reflectance: np.ndarray) -> np.ndarray:
        """(..., 3) linear sRGB of reflectances (..., n), under D65 where they are spectra."""
        if self.wavelength_nm is None:
            return np.broadcast_to(reflectance, (*reflectance.shape[:-1], 3))
        weights = rgb_weights("D65")
        spectra = np.stack(
            [
                np.interp(WAVELENGTH_NM, self.wavelength_nm, row)
                for row in reflectance.reshape(-1, reflectance.shape[-1])
            ]
        )
        return (spectra @ weights.T).reshape(*reflectance.shape[:-1], 3)


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
    """

    max_error: float
    metric: Metric
    choices: tuple[Choice, ...]
    basis: Basis | None
    left: tuple[LeftExact, ...] = field(default=())

    @property
    def operations(self) -> int:
        """Of evaluating every surface once."""
        return sum(choice.operations for choice in self.choices)

    @property
    def exact_operations(self) -> int:
        """The same with the exact equations throughout."""
        return sum(EXACT_OPERATIONS * len(choice.surface.eta) for choice in self.choices)

    @property
    def nbytes(self) -> int:
        """Constants of the closed form and numbers of all surfaces, in float32."""
        numbers = sum(choice.numbers * len(choice.surface.eta) for choice in self.choices)
        if self.basis is not None:
            form = self.basis.closed_form
            numbers += np.count_nonzero(form.numerators) + np.count_nonzero(form.denominator)
        return 4 * int(numbers)


def operations(model: str, channels: int, basis: Basis | None = None) -> int:
    """Floating-point operations of one evaluation, a fused multiply-add counting as one.

    Parameters
    ----------
    model : {"schlick", "f82", "decomposition", "exact"}
    channels : int
        Share the cosine and, in the decomposition, the functions.
    basis : Basis
        For "decomposition".
    """
    choose("model", model, ("schlick", "f82", "decomposition", "exact"))
    if model == "schlick":
        return 4 + 2 * channels
    if model == "f82":
        return 6 + 4 * channels
    if model == "exact":
        return EXACT_OPERATIONS * channels
    assert basis is not None
    form = basis.closed_form
    # Horner's rule: one operation per degree; a leading zero in b_2, b_3, ... is the same
    horner = len(form.denominator) - 1 + form.numerators.size - len(form.numerators)
    return 2 + horner + len(form.numerators) * (1 + channels)


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
    >>> from fresnel_decomp.plan import Surface, plan_surfaces
    >>> glass = Surface("glass", [1.5], [0.0])
    >>> gold = Surface("gold", [0.14, 0.37, 1.44], [3.98, 2.38, 1.60])
    >>> [choice.model for choice in plan_surfaces([glass, gold], 0.04).choices]
    ['schlick', 'f82']
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
    return Plan(float(max_error), metric, best[1], best[2], told)


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
    name = cheapest.model
    if name == "decomposition":
        name = f"decomposition of {cheapest.numbers} terms"
    gain = f"{name}: error {cheapest.error:.2g}, {cheapest.operations} operations, not {exact}"
    return replace(entry, gain=gain)


# --- candidates ----------------------------------------------------------------------------------


def _simple(surface: Surface, model: Literal["schlick", "f82"], metric: Metric) -> Choice:
    make: Any = {"schlick": Schlick, "f82": F82}[model]
    fit = make.from_ior(surface.eta, surface.k)
    error = _error(surface, lambda cos_theta: fit(cos_theta[..., None]), metric)
    cost = operations(model, len(surface.eta))
    return Choice(surface, model, error, cost, {"schlick": 1, "f82": 2}[model])


def _decomposed(surface: Surface, basis: Basis, metric: Metric) -> list[Choice]:
    if _total_reflection(surface):
        return []
    coefficients = basis.coefficients(surface.eta, surface.k, poor_fit="keep")
    form = basis.closed_form
    error = _error(
        surface, lambda cos_theta: form.evaluate(coefficients, cos_theta[..., None]), metric
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


# --- prediction ----------------------------------------------------------------------------------


def _error(surface: Surface, fit: Callable[[np.ndarray], np.ndarray], metric: Metric) -> float:
    """The largest error of `fit`, from (m,) cosines to (m, n) reflectances, over the view."""

    def exact(cos_theta: np.ndarray) -> np.ndarray:
        return np.asarray(conductor(cos_theta[..., None], surface.eta, surface.k))

    if not surface.averaged:
        cos_theta = error_cosines()[0]
        return _distance(surface, exact(cos_theta), fit(cos_theta), metric)
    assert surface.alpha is not None
    low, high = surface.alpha
    alphas = np.unique([low, np.sqrt(low * high), high])
    return max(_lobe_error(surface, exact, fit, alpha, metric) for alpha in alphas)


def _lobe_error(surface: Surface, exact: Any, fit: Any, alpha: float, metric: Metric) -> float:
    from .albedo import directional_albedo

    n = len(surface.eta)

    def curves(cos_theta: np.ndarray) -> np.ndarray:
        F, fitted = exact(cos_theta), fit(cos_theta)
        return np.concatenate(
            [np.ones_like(F[..., :1]), np.abs(fitted - F), F, fitted - F], axis=-1
        )

    averages = directional_albedo(curves, _LOBE_COSINES, alpha, distribution=surface.distribution)
    white, parts = averages[..., :1], averages[..., 1:] / averages[..., :1]
    if metric == "reflectance":
        return float(parts[..., :n].max()) if white.size else 0.0
    F, change = parts[..., n : 2 * n], parts[..., 2 * n :]
    return _distance(surface, F, F + change, metric)


def _distance(surface: Surface, exact: np.ndarray, fitted: np.ndarray, metric: Metric) -> float:
    if metric == "reflectance":
        return float(np.abs(fitted - exact).max())
    colours = [np.clip(surface.to_rgb(F), 0.0, 1.0) for F in (exact, fitted)]
    return float(np.max(delta_e_2000(*colours)))

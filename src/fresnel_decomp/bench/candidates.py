"""All models as kernels evaluate them: what they store, and what they must answer.

A *candidate* is a model in one form, closed form or table of some size and format, say. Everything
about it that a benchmark needs is here, so that what is timed is what is judged.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from .._array import drjit_constant
from ..accuracy import RECIPE_ORDER, TERMS
from ..basis import Basis, load_basis
from ..converters import convert
from ..curves import CurveSet, dielectrics, error_cosines, gulbrandsen_grid, low_index_corner
from ..fresnel import conductor
from ..material import Material
from ..mitsuba import fresnel_terms as terms
from ..mitsuba.operations import count_gathers, count_operations, count_vector_operations
from ..mitsuba.workloads import BERYLLIUM, Picture
from ..models import F82, Gulbrandsen, Lazanyi, Schlick
from ..parametrization import F82_COSINE, gulbrandsen_to_ior
from ..representations import Curve
from . import answers

__all__ = [
    "BASE",
    "Candidate",
    "WrongAnswerError",
    "candidates",
    "check",
    "check_bsdf",
    "check_picture",
    "check_set",
    "operation_counts",
    "reflectances",
]

BASE = "mi.fresnel_conductor"
"""The exact built-in, to which times are ratios."""

Array = NDArray[np.float64]
Storage = Literal["float32", "float16"]
Answer = Callable[[Array, Array, Array], tuple[Array, "Array | float"]]


class WrongAnswerError(RuntimeError):
    """A model does not evaluate to what it claims to be."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model in one form.

    Attributes
    ----------
    name : str
    family : recipe, or name of the model
    form : "formula", "closed form" or "table"
    store : callable
        From indices (n,) to the numbers (n,) that are kept for a material.
    store_colour : callable or None
        From a measured material to such numbers (3,), for the channels under D65.
    evaluate : callable
        Of a cosine and those numbers, each a Float or (RGB) a Color3f.
    answer : callable
        From cosines (m,) and indices (n,) to the (n, m) reflectances that the model must have,
        independently in float64, and by how much they may differ.
    shared_bytes : int
        Constants or tables that all materials share.
    integrates : bool
        Linear in functions of the angle that all materials share, which can be integrated over
        rough surfaces ahead of time.
    bsdf : dict or None
        What makes `roughconductor` or `decomposed_conductor` this model of `BERYLLIUM`.
    dielectric : bool
        For k = 0 only.
    terms : of decompositions
    size, storage : of their tables
    basis : Basis or None
    """

    name: str
    family: str
    form: str
    store: Callable[[Array, Array], Sequence[Array]]
    store_colour: Callable[[Material], Sequence[Array]] | None
    evaluate: Callable[..., Any]
    answer: Answer
    shared_bytes: int = 0
    integrates: bool = False
    bsdf: Mapping[str, Any] | None = None
    dielectric: bool = False
    terms: int | None = None
    size: int | None = None
    storage: str | None = None
    basis: Basis | None = None

    def material_bytes(self, channels: int = 3) -> int:
        """Of the float32 numbers that are kept for a material."""
        one = np.array([1.5])
        return 4 * channels * len(self.store(one, 0.0 * one))


def candidates(table_sizes: Sequence[int]) -> list[Candidate]:
    """Everything that is compared, in the active variant, `BASE` first; tables of these sizes."""
    result = [*_exact_functions(), *_formulas()]
    for recipe in RECIPE_ORDER:
        for count in TERMS:
            result.append(_closed_form(recipe, count))
    for recipe in RECIPE_ORDER:
        for count in TERMS:
            for size in table_sizes:
                result.append(_table(recipe, count, size, "float32"))
                result.append(_table(recipe, count, size, "float16"))
    return result


def _exact_functions() -> list[Candidate]:
    def make(name: str, tolerance: float, formula: Callable[..., Any], **more: Any) -> Candidate:
        family = "Mitsuba" if name.startswith("mi.") else "exact"
        return Candidate(
            name, family, "formula", _indices, Material.rgb_indices, _per_channel(formula),
            _within(tolerance, answers.exact), **more,
        )  # fmt: skip

    built_in = make(
        BASE,
        5e-6,
        lambda c, eta, k: mi.fresnel_conductor(c, mi.Complex2f(eta, k)),
        bsdf={"type": "roughconductor", **_rgb(BERYLLIUM)},
    )
    dielectric = Candidate(
        "mi.fresnel", "Mitsuba", "formula", lambda eta, k: (eta,), None,
        _per_channel(lambda c, eta: mi.fresnel(c, eta)[0]),
        _within(2e-6, answers.exact), dielectric=True,
    )  # fmt: skip
    return [
        built_in,
        make("mi.fresnel_polarized", 2e-6, _polarized),
        dielectric,
        make("exact, native", 1e-6, lambda *args: conductor(*args, precision="native")),
        make("exact, wide", 3e-7, conductor),
    ]


def _polarized(cos_theta: Any, eta: Any, k: Any) -> Any:
    s, p = mi.fresnel_polarized(cos_theta, mi.Complex2f(eta, k))[:2]
    return (dr.squared_norm(s) + dr.squared_norm(p)) * 0.5


def _formulas() -> list[Candidate]:
    def schlick(material: Material) -> Sequence[Array]:
        return (material.rgb_reflectance(1.0),)

    def f82(material: Material) -> Sequence[Array]:
        ends = F82(*material.rgb_reflectance(np.array([1.0, F82_COSINE])))
        return ends.f0, ends.a

    def lazanyi(material: Material) -> Sequence[Array]:
        fit = Lazanyi.from_ior(*material.rgb_indices())
        return material.rgb_reflectance(1.0), fit.a, fit.exponent

    def gulbrandsen(material: Material) -> Sequence[Array]:
        model = convert(
            Curve(lambda c: material.rgb_reflectance(c)), "gulbrandsen", no_counterpart="nearest"
        ).value
        return model.r, model.g

    def of(kind: Any, *names: str) -> Callable[[Array, Array], Sequence[Array]]:
        def store(eta: Array, k: Array) -> Sequence[Array]:
            model = kind.from_ior(eta, k)
            return [getattr(model, name) for name in names]

        return store

    def tinted(cos_theta: Any, r: Any, g: Any) -> Any:
        return conductor(cos_theta, *gulbrandsen_to_ior(r, g), precision="native")

    index = {name: np.array(values) for name, values in BERYLLIUM.items()}
    r, g = of(Gulbrandsen, "r", "g")(index["eta"], index["k"])
    plugin = {"type": "decomposed_conductor", **_rgb(BERYLLIUM)}
    return [
        Candidate(
            "Schlick", "Schlick", "formula", of(Schlick, "f0"), schlick, terms.Schlick(),
            _within(1e-6, answers.schlick), integrates=True, bsdf=plugin | {"fresnel": "schlick"},
        ),
        Candidate(
            "F82", "F82", "formula", of(F82, "f0", "a"), f82, terms.F82(),
            _within(1e-6, answers.f82), integrates=True, bsdf=plugin | {"fresnel": "f82"},
        ),
        Candidate(
            "Lazanyi", "Lazanyi", "formula", of(Lazanyi, "f0", "a", "exponent"), lazanyi,
            _per_channel(lambda c, *stored: Lazanyi(*stored)(c)), _within(2e-6, answers.lazanyi),
        ),
        Candidate(
            "Gulbrandsen", "Gulbrandsen", "formula", of(Gulbrandsen, "r", "g"), gulbrandsen,
            _per_channel(tinted), _within(4e-6, answers.gulbrandsen),
            bsdf={
                "type": "decomposed_conductor", "fresnel": "exact", **_rgb({"r": r, "g": g})
            },
        ),
    ]  # fmt: skip


def _closed_form(recipe: str, count: int) -> Candidate:
    basis = load_basis(recipe, count)
    form = basis.closed_form

    def answer(cos_theta: Array, eta: Array, k: Array) -> tuple[Array, Array]:
        values, sizes = answers.decomposition(basis, cos_theta, eta, k)
        return values, form.error * sizes + _ROUNDING

    return Candidate(
        f"{recipe}, {count} terms", recipe, "closed form", *_stores(basis),
        terms.Decomposition(basis), answer,
        # what is 0 or 1 in every form needs no constant
        shared_bytes=4 * (len(form.denominator) - 1 + form.numerators.size - len(form.numerators)),
        integrates=True,
        bsdf={
            "type": "decomposed_conductor", "fresnel": "decomposition", "recipe": recipe,
            "terms": count, **_rgb(BERYLLIUM),
        },
        terms=count, basis=basis,
    )  # fmt: skip


def _table(recipe: str, count: int, size: int, storage: Storage) -> Candidate:
    basis = load_basis(recipe, count)

    def answer(cos_theta: Array, eta: Array, k: Array) -> tuple[Array, Array]:
        values, sizes = answers.tabulated(basis, size, storage, cos_theta, eta, k)
        return values, _ROUNDING * (1.0 + sizes)

    @functools.cache  # sampled when it is first evaluated
    def table() -> Any:
        return basis.table(size, storage=storage)

    return Candidate(
        f"{recipe}, {count} terms, {size} {storage}", recipe, "table", *_stores(basis),
        lambda cos_theta, *stored: table().evaluate(stored, cos_theta), answer,
        shared_bytes=size * (count - 1) * np.dtype(storage).itemsize,
        integrates=True, terms=count, size=size, storage=storage, basis=basis,
    )  # fmt: skip


_ROUNDING = 2e-6
"""Of sums of some products in float32."""


def _stores(basis: Basis) -> tuple[Callable[..., Sequence[Array]], Callable[..., Sequence[Array]]]:
    return (
        lambda eta, k: basis.coefficients(eta, k, poor_fit="keep").T,
        lambda material: material.rgb_coefficients(basis).T,
    )


def _indices(eta: Array, k: Array) -> Sequence[Array]:
    return eta, k


def _per_channel(formula: Callable[..., Any]) -> Callable[..., Any]:
    def evaluate(cos_theta: Any, *stored: Any) -> Any:
        if isinstance(stored[0], mi.Float):
            return formula(cos_theta, *stored)
        return mi.Color3f([formula(cos_theta, *one) for one in zip(*stored, strict=True)])

    return evaluate


def _within(tolerance: float, formula: Callable[..., Array]) -> Answer:
    return lambda cos_theta, eta, k: (formula(cos_theta, eta[:, None], k[:, None]), tolerance)


def _rgb(values: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: {"type": "rgb", "value": [float(v) for v in value]} for name, value in values.items()
    }


def reflectances(
    candidate: Candidate, stored: Sequence[Array], cos_theta: Array, channels: int = 1
) -> Array:
    """(n, m) reflectances in float32 for (n,) materials at (m,) cosines, by the kernel.

    With three channels, three neighbouring materials are evaluated together; n is a multiple of 3.
    """
    m, n = len(cos_theta), len(stored[0])
    cosines = dr.tile(drjit_constant(mi.Float, cos_theta), n // channels)
    columns = [
        [dr.repeat(drjit_constant(mi.Float, v[i::channels]), m) for i in range(channels)]
        for v in stored
    ]
    if channels == 1:
        found = np.array(candidate.evaluate(cosines, *(c[0] for c in columns)))
        return found.reshape(n, m).astype(np.float64)
    value = candidate.evaluate(cosines, *(mi.Color3f(c) for c in columns))
    found = np.array(value).reshape(channels, n // channels, m)
    return np.swapaxes(found, 0, 1).reshape(n, m).astype(np.float64)


def check_set(dielectric: bool = False) -> CurveSet:
    """Some curves of three sets: dielectrics, and unless only those, metals and low indices."""
    parts = [dielectrics().take(slice(None, None, 9))]
    if not dielectric:
        parts += [gulbrandsen_grid().take(slice(None, None, 41))]
        parts += [low_index_corner().take(slice(None, None, 7))]
    eta, k = (np.concatenate([getattr(part, name) for part in parts]) for name in ("eta", "k"))
    count = len(eta) // 3 * 3
    return CurveSet("check", eta[:count], k[:count])


def check(candidate: Candidate) -> float:
    """The largest distance of a candidate's kernels, with one channel and three, to its answer.

    Raises
    ------
    WrongAnswerError
        If it is larger than allowed anywhere, or not a number.
    """
    members = check_set(candidate.dielectric)
    cos_theta = _rounded(error_cosines()[0][::3])
    expected, allowed = candidate.answer(cos_theta, members.eta, members.k)
    stored = candidate.store(members.eta, members.k)
    largest = 0.0
    for channels in (1, 3):
        distance = np.abs(reflectances(candidate, stored, cos_theta, channels) - expected)
        if not np.all(distance <= allowed):
            raise WrongAnswerError(
                f"{candidate.name} is off by {np.nanmax(distance):.2g} with {channels} channels in "
                f"{mi.variant()}; nothing was timed"
            )
        largest = max(largest, float(distance.max()))
    return largest


def check_bsdf(candidate: Candidate, bsdf: Any, mirror: Any, si: Any, wo: Any) -> float:
    """The largest distance of a loaded BSDF, relative to a perfect mirror's, to the answer.

    Raises
    ------
    WrongAnswerError
        As `check`.
    """
    context = mi.BSDFContext()
    value, white = (b.eval(context, si, wo, True) for b in (bsdf, mirror))
    return _check_surface(candidate, value, white, si.wi, wo, "BSDF")


def _check_surface(
    candidate: Candidate, value: Any, white: Any, wi: Any, wo: Any, what: str
) -> float:
    value, white = (np.array(v, np.float64) for v in (value, white))
    seen = white.min(axis=0) > 1e-3 * white.max()
    half = dr.normalize(wi + wo)
    cos_theta = np.array(dr.dot(wi, half), np.float64)[seen]
    expected, allowed = candidate.answer(cos_theta, *(np.array(v) for v in BERYLLIUM.values()))
    distance = np.abs(value[:, seen] / white[:, seen] - expected)
    # cosines are those of float32 vectors, a few units in the last place apart
    if not (seen.any() and np.all(distance <= np.maximum(allowed, 2e-5))):
        raise WrongAnswerError(
            f"the {what} with {candidate.name} is off by {np.nanmax(distance, initial=0.0):.2g} in "
            f"{mi.variant()}; nothing was timed"
        )
    return float(distance.max())


def check_picture(candidate: Candidate, picture: Picture, mirror: Any, seed: int = 0) -> float:
    """The largest distance of the surfaces in a picture's scene, as its camera meets them.

    Where a ray through the middle of a pixel meets a surface, that surface's BSDF is evaluated and
    sampled, and both are compared with the answer, relative to a perfect mirror's of the same
    random numbers. What remains of a picture is Mitsuba's integrator; it has to be finite.

    Raises
    ------
    WrongAnswerError
        If anything is farther from the answer than the curve may be.
    """
    scene = picture.scene
    sensor = scene.sensors()[0]
    width, height = (int(n) for n in sensor.film().crop_size())
    x, y = dr.meshgrid(dr.arange(mi.Float, width), dr.arange(mi.Float, height))
    film = mi.Point2f((x + 0.5) / width, (y + 0.5) / height)
    ray, _ = sensor.sample_ray(0.0, 0.5, film, mi.Point2f(0.5))
    si = scene.ray_intersect(ray)
    met = si.is_valid()
    sampler = mi.PCG32(size=width * height, initseq=seed)

    def point() -> Any:
        return mi.Point2f(sampler.next_float32(), sampler.next_float32())

    context, surface = mi.BSDFContext(), si.bsdf()
    wo = mi.warp.square_to_cosine_hemisphere(point())
    value, white = (b.eval(context, si, wo, met) for b in (surface, mirror))
    largest = _check_surface(candidate, value, white, si.wi, wo, "picture")
    choice, u = sampler.next_float32(), point()
    (sample, value), (same, white) = (
        b.sample(context, si, choice, u, met) for b in (surface, mirror)
    )
    valid = dr.max(white) > 0.0
    if not dr.all(~valid | (dr.norm(sample.wo - same.wo) < 1e-4)):
        raise WrongAnswerError(
            f"the picture with {candidate.name} samples other directions than a mirror of its "
            f"roughness in {mi.variant()}; nothing was timed"
        )
    found = _check_surface(candidate, value, white, si.wi, sample.wo, "picture")
    if not np.isfinite(np.array(picture())).all():
        raise WrongAnswerError(
            f"the picture with {candidate.name} is not finite in {mi.variant()}; nothing was timed"
        )
    return max(largest, found)


def _rounded(values: Array) -> Array:
    """To the float32 numbers that kernels get."""
    return values.astype(np.float32).astype(np.float64)


def operation_counts(candidate: Candidate) -> dict[str, int | None]:
    """Of one evaluation in RGB: arithmetic on floats; in LLVM variants loads and all operations.

    All are `count_vector_operations` and `count_gathers`: a table's arithmetic on indices, and each
    load as one, whatever it takes.
    """
    stored = candidate.store(*(np.array(values) for values in BERYLLIUM.values()))

    def evaluate(cos_theta: Any, *flat: Any) -> Any:
        colours = [mi.Color3f(list(flat[i : i + 3])) for i in range(0, len(flat), 3)]
        return candidate.evaluate(cos_theta, *colours)

    point = (0.5, *(float(v) for values in stored for v in values))
    llvm = str(mi.variant()).startswith("llvm")
    gathers = count_gathers(evaluate, *point) if llvm else None
    packets = count_vector_operations(evaluate, *point).total() if llvm else None
    return {
        "arithmetic": count_operations(evaluate, *point).total(),
        "gathers": gathers,
        "operations": None if packets is None or gathers is None else packets + gathers,
    }

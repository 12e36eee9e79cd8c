"""Speed of evaluating Fresnel curves, relative to `mi.fresnel_conductor` in the same run.

    python scripts/speed_table.py --out speed.json

This is curve evaluation and not rendering: a renderer spends most of its time elsewhere
(`scripts/bench_plugin.py` times BSDFs and whole pictures). Two kinds of kernels: *streaming* reads
one cosine from memory, evaluates once and writes the result; *compute-bound* evaluates many cosines
per element and writes their sum. Each for one channel and for RGB, where three channels share the
cosine and, in the decomposition, the basis. Models are evaluated as the BSDF plugin does: from what
it stores for a material (F0, or coefficients), by the basis' closed form. "cosine only" is the
kernel without a model.

Before the timing, the same functions are evaluated on the 3,027 curves of set cp
(`curves.gulbrandsen_grid`); their errors against the equations in float64 are in the table. All
kernels take turns; a ratio is the median over rounds of (model / mi.fresnel_conductor in the same
round), and ± half the distance between its quartiles.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from _markdown import markdown
from fresnel_decomp import (
    F82,
    RECIPES,
    CurveSet,
    Decomposition,
    Exact,
    Schlick,
    conductor,
    curves,
    doctor,
    load_basis,
)
from fresnel_decomp._files import write_json
from fresnel_decomp.accuracy import TERMS

BASE = "mi.fresnel_conductor"
NOTHING = "cosine only"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Candidate:
    """A model as a kernel evaluates it."""

    name: str
    store: Callable[[Array, Array], Sequence[Array]]
    """From indices (n,) to the numbers (n,) that are kept for a material."""
    evaluate: Callable[..., Any]
    """Of a cosine and those numbers, each a Float or (RGB) a Color3f."""
    tolerance: float
    """Largest distance to the model in float64."""
    model: Callable[[Array, Array], Callable[[Array], Array]]
    """The model in float64, from indices (n, 1)."""


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--variant", default="llvm_ad_rgb", help="an llvm_ad or cuda_ad variant")
    parser.add_argument("--recipe", default="talk", choices=RECIPES)
    parser.add_argument("--rounds", type=int, default=15, help="at least 9")
    parser.add_argument("--points", type=int, default=10_000_000, help="cosines, streaming")
    parser.add_argument("--elements", type=int, default=65_536, help="elements, compute-bound")
    parser.add_argument("--turns", type=int, default=16, help="of the compute-bound loop")
    parser.add_argument("--out", type=Path, help="also write the numbers to this JSON file")
    options = parser.parse_args(arguments)
    if options.rounds < 9:
        parser.error(f"--rounds {options.rounds}: accepted are 9 and more; a median needs them")
    if options.variant.startswith("scalar"):
        parser.error("--variant: scalar ones have no kernels; accepted are llvm_ad_*, cuda_ad_*")
    doctor.prepare()
    doctor.require_variant(options.variant)
    import mitsuba as mi

    mi.set_variant(options.variant)
    from fresnel_decomp.mitsuba.timing import interleaved_times

    models = candidates(options.recipe)
    with Progress(console=Console(stderr=True), transient=True) as progress:
        test_set = curves.gulbrandsen_grid()
        task = progress.add_task("checking", total=len(test_set))
        errors = check(models, test_set, lambda count: progress.advance(task, count))
        task = progress.add_task("timing", total=options.rounds + 2)
        times = interleaved_times(
            kernels(models, options), options.rounds, lambda: progress.advance(task)
        )
    results = summary(times, options)
    print(table(results, errors))
    base = results[BASE]
    print(
        f"\n{BASE}: "
        + ", ".join(f"{kind} {cell['nanoseconds']:.2f} ns" for kind, cell in base.items())
        + f" an evaluation. {describe(about(options))}"
    )
    if options.out:
        rows = [
            {"model": name, "error": errors.get(name), "times": cells}
            for name, cells in results.items()
        ]
        write_json(options.out, {"about": about(options), "results": rows})


def candidates(recipe: str) -> list[Candidate]:
    """Everything that is timed, in the active variant."""
    import mitsuba as mi

    from fresnel_decomp.mitsuba import fresnel_terms as terms

    def indices(eta: Array, k: Array) -> Sequence[Array]:
        return eta, k

    def per_channel(formula: Callable[..., Any]) -> Callable[..., Any]:
        def evaluate(cos_theta: Any, eta: Any, k: Any) -> Any:
            if isinstance(eta, mi.Float):
                return formula(cos_theta, eta, k)
            return mi.Color3f([formula(cos_theta, *i) for i in zip(eta, k, strict=True)])

        return evaluate

    def exact(name: str, tolerance: float, formula: Callable[..., Any]) -> Candidate:
        return Candidate(name, indices, per_channel(formula), tolerance, Exact)

    def schlick(eta: Array, k: Array) -> Sequence[Array]:
        return (Schlick.from_ior(eta, k).f0,)

    def f82(eta: Array, k: Array) -> Sequence[Array]:
        model = F82.from_ior(eta, k)
        return model.f0, model.a

    def decomposition(count: int) -> Candidate:
        basis = load_basis(recipe, count)
        return Candidate(
            f"{recipe}, {count} terms",
            lambda eta, k: basis.coefficients(eta, k).T,
            terms.Decomposition(basis),
            1e-3,
            lambda eta, k: Decomposition.from_ior(eta, k, basis),
        )

    return [
        exact(BASE, np.inf, lambda c, eta, k: mi.fresnel_conductor(c, mi.Complex2f(eta, k))),
        exact("exact, wide", 1e-7, conductor),
        exact("exact, native", 1e-6, lambda c, eta, k: conductor(c, eta, k, precision="native")),
        Candidate("Schlick", schlick, terms.Schlick(), 1e-6, Schlick.from_ior),
        Candidate("F82", f82, terms.F82(), 1e-6, F82.from_ior),
        *(decomposition(count) for count in TERMS),
    ]


def check(
    models: Sequence[Candidate], test_set: CurveSet, advance: Callable[[int], object]
) -> dict[str, dict[str, float]]:
    """Evaluate every candidate on a set of curves; its errors against the float64 equations.

    Raises
    ------
    RuntimeError
        If a candidate is not the model it claims to be.
    """
    import mitsuba as mi

    cos_theta, uniform = curves.error_cosines()
    cos_theta = cos_theta.astype(np.float32).astype(np.float64)  # the kernels' own input
    largest = {model.name: 0.0 for model in models}
    squares = {model.name: 0.0 for model in models}
    for start in range(0, len(test_set), 256):
        eta, k = test_set.eta[start : start + 256], test_set.k[start : start + 256]
        cosines = mi.Float(np.tile(cos_theta, len(eta)))
        exact = Exact(eta[:, None], k[:, None])(cos_theta)
        for model in models:
            stored = [mi.Float(np.repeat(v, len(cos_theta))) for v in model.store(eta, k)]
            found = np.array(model.evaluate(cosines, *stored), np.float64).reshape(exact.shape)
            if np.isfinite(model.tolerance):
                fitted = model.model(eta[:, None], k[:, None])
                distance = float(np.abs(found - fitted(cos_theta)).max())
                if distance > model.tolerance:
                    raise RuntimeError(f"{model.name} is off by {distance:.2g} in {mi.variant()}")
            error = np.abs(found - exact)
            largest[model.name] = max(largest[model.name], float(error.max()))
            squares[model.name] += float((error[:, : len(uniform)] ** 2).sum())
        advance(len(eta))
    count = len(test_set) * len(uniform)
    return {
        name: {"max": largest[name], "rmse": (squares[name] / count) ** 0.5} for name in largest
    }


def kernels(
    models: Sequence[Candidate], options: argparse.Namespace
) -> dict[str, dict[str, Callable[[], Any]]]:
    """For each kind of kernel and each model, a function that runs it."""
    import drjit as dr
    import mitsuba as mi

    from fresnel_decomp.mitsuba.workloads import (
        BERYLLIUM,
        compute_bound,
        random_cosines,
        streaming,
    )

    many, few = random_cosines(options.points), random_cosines(options.elements)
    index = {name: np.array(values) for name, values in BERYLLIUM.items()}
    result: dict[str, dict[str, Callable[[], Any]]] = {}
    one = dr.opaque(mi.Float, 1.0)
    for channels, kind in ((1, mi.Float), (3, mi.Color3f)):
        rows: dict[str, Callable[[Any], Any]] = {NOTHING: lambda c, kind=kind: kind(c * one)}
        for model in models:
            values = model.store(index["eta"][:channels], index["k"][:channels])
            # opaque, or the material would be compiled into the kernel
            stored = [dr.opaque(kind, v.tolist() if channels > 1 else float(v[0])) for v in values]
            rows[model.name] = lambda c, model=model, stored=stored: model.evaluate(c, *stored)
        label = "one channel" if channels == 1 else "RGB"
        result[f"streaming, {label}"] = {n: streaming(f, many) for n, f in rows.items()}
        result[f"compute-bound, {label}"] = {
            n: compute_bound(f, kind, few, options.turns) for n, f in rows.items()
        }
    return result


def summary(
    times: dict[str, dict[str, list[float]]], options: argparse.Namespace
) -> dict[str, dict[str, dict[str, float]]]:
    """By model and kind: median time of an evaluation, its ratio to the base, and its spread."""
    from fresnel_decomp.mitsuba.workloads import UNROLL

    results: dict[str, dict[str, dict[str, float]]] = {}
    for kind, models in times.items():
        count = options.points
        if kind.startswith("compute"):
            count = options.elements * options.turns * UNROLL
        base = np.array(models[BASE])
        for name, milliseconds in models.items():
            low, ratio, high = np.percentile(np.array(milliseconds) / base, [25, 50, 75])
            results.setdefault(name, {})[kind] = {
                "ratio": float(ratio),
                "spread": float(high - low) / 2.0,
                "milliseconds": float(np.median(milliseconds)),
                "nanoseconds": 1e6 * float(np.median(milliseconds)) / count,
            }
    return results


def table(
    results: dict[str, dict[str, dict[str, float]]], errors: dict[str, dict[str, float]]
) -> str:
    """Ratios, and the errors on set cp, in Markdown."""
    kinds = list(results[BASE])
    rows = []
    for name, cells in results.items():
        row = [name]
        row += [f"{cells[kind]['ratio']:.2f} ± {cells[kind]['spread']:.2f}" for kind in kinds]
        error = errors.get(name)
        row.append(f"{_short(error['max'])} / {_short(error['rmse'])}" if error else "")
        rows.append(row)
    head = [f"curve evaluation, time relative to {BASE}", *kinds, "largest error / RMSE (cp)"]
    return markdown(head, rows)


def _short(value: float) -> str:
    return f"{value:.4f}" if value >= 1e-4 else f"{value:.0e}"


def about(options: argparse.Namespace) -> dict[str, Any]:
    """Machine, versions and settings."""
    from fresnel_decomp.bench.machine import machine_facts
    from fresnel_decomp.mitsuba.workloads import BERYLLIUM, UNROLL

    return {
        "what": "curve evaluation, not rendering",
        **machine_facts(options.variant),
        "recipe": options.recipe,
        "rounds": options.rounds,
        "points": options.points,
        "elements": options.elements,
        "evaluations_per_element": options.turns * UNROLL,
        "indices": BERYLLIUM,
    }


def describe(facts: dict[str, Any]) -> str:
    """One line on where and how the times were taken."""
    from fresnel_decomp.bench.machine import describe_machine

    return f"Medians of {facts['rounds']} runs in {describe_machine(facts)}."


if __name__ == "__main__":
    main()

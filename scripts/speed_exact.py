"""Speed of the exact equations, relative to Mitsuba's own functions in the same run.

    python scripts/speed_exact.py --page docs/speed.md --out speed_exact.json

`conductor` against `mi.fresnel_conductor` and `dielectric` against `mi.fresnel`, in both
precisions, float32 in and out. The kernels:

- *streaming*: one cosine from memory, one evaluation, one result to memory; one material, or an
  index for each cosine, from memory as well;
- *compute-bound*: many evaluations for each element, of which the sum is written;
- *value and gradient*: streaming with an index for each cosine; in backward mode the partial
  derivatives wrt all arguments, in forward mode the derivative along one direction. Those of
  Mitsuba's functions are Dr.Jit's.

Also counted are the operations of the streaming kernels with an index for each cosine, as Dr.Jit
hands them to LLVM, so in llvm_ad variants only.

Before the timing every result is compared with float64. All kernels take turns; a ratio is the
median over rounds of (function / Mitsuba's in the same round), and ± half the distance between its
quartiles. Times are those of the kernels, as Dr.Jit's history has them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from _command_line import json_option, main, page_option, script
from _markdown import insert, markdown, marks
from fresnel_decomp import conductor, dielectric, doctor
from fresnel_decomp._check import input_error
from fresnel_decomp._files import write_json

Array = NDArray[np.float64]
Run = Callable[[], Any]

MARKS = marks("tables")
COUNT_MARKS = marks("counts")
INDEX = (1.5, 2.0)
"""eta and k of the one material."""
MODES = ("backward", "forward")
TARGETS = {
    "streaming": {"native": 1.2, "wide": 2.5},
    "compute-bound": {"native": 1.4, "wide": 3.0},
    "value and gradient": {"native": 1.0},
}
"""Largest ratio wanted, by the beginning of a kernel's name and by precision."""


@dataclass(frozen=True)
class Settings:
    """How much is measured."""

    variant: str
    rounds: int
    points: int
    elements: int
    turns: int


@dataclass(frozen=True)
class Function:
    """One function as a kernel evaluates it."""

    name: str
    arity: int
    run: Callable[..., Any]
    """Of a cosine and `arity` arrays, eta and perhaps k."""
    tolerance: float
    """Largest distance of its value to float64, at random angles and indices."""


@dataclass(frozen=True)
class Cell:
    """Time of one function in one kind of kernel."""

    ratio: float
    spread: float
    nanoseconds: float
    """Median time of an evaluation."""


def functions() -> dict[str, list[Function]]:
    """By the function that the others are compared with, which comes first."""
    import mitsuba as mi

    def of_complex(cos_theta: Any, eta: Any, k: Any) -> Any:
        return mi.fresnel_conductor(cos_theta, mi.Complex2f(eta, k))

    def native(function: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *arguments: function(*arguments, precision="native")

    return {
        "mi.fresnel_conductor": [
            Function("mi.fresnel_conductor", 2, of_complex, 1e-3),
            Function("conductor, native", 2, native(conductor), 1e-6),
            Function("conductor, wide", 2, conductor, 1e-7),
        ],
        "mi.fresnel": [
            Function("mi.fresnel", 1, lambda c, eta: mi.fresnel(c, eta)[0], 1e-3),
            Function("dielectric, native", 1, native(dielectric), 1e-6),
            Function("dielectric, wide", 1, dielectric, 1e-7),
        ],
    }


def arguments_of(size: int) -> list[Any]:
    """Random cosines, eta and k, evaluated."""
    import drjit as dr
    import mitsuba as mi

    uniform = [mi.PCG32(size=size, initseq=i).next_float32() for i in range(3)]
    arguments = [uniform[0], 0.2 + 3.8 * uniform[1], 5.0 * uniform[2]]
    dr.eval(arguments)
    return arguments


def with_gradient(function: Function, arguments: Sequence[Any], mode: str) -> list[Any]:
    """The value and, in mode "backward", its derivatives; in "forward", the one along (1, 1, 1)."""
    import drjit as dr
    import mitsuba as mi

    copies = [mi.Float(argument) for argument in arguments[: 1 + function.arity]]
    dr.enable_grad(copies)
    value = function.run(*copies)
    if mode == "forward":
        for copy in copies:
            dr.set_grad(copy, 1.0)
        dr.forward_to(value)
        return [dr.detach(value), dr.grad(value)]
    dr.backward(value)
    return [dr.detach(value), *(dr.grad(copy) for copy in copies)]


def check(candidates: Sequence[Function], size: int = 20_000) -> None:
    """Values and gradients of all functions against ours in float64.

    Raises
    ------
    RuntimeError
        If one of them is not what it is called.
    """
    import drjit as dr

    arguments = arguments_of(size)
    double = [dr.float64_array_t(type(argument))(argument) for argument in arguments]
    for function in candidates:
        exact = conductor if function.arity == 2 else dielectric
        reference = [copy + 0.0 for copy in double[: 1 + function.arity]]
        dr.enable_grad(reference)
        expected = exact(*reference)
        dr.backward(expected)
        found = [np.array(v, np.float64) for v in with_gradient(function, arguments, "backward")]
        distance = float(np.abs(found[0] - np.array(expected)).max())
        if not distance <= function.tolerance:
            raise RuntimeError(f"{function.name} is off by {distance:.2g}")
        slopes = [np.array(dr.grad(copy)) for copy in reference]
        for slope, exact_slope in zip(found[1:], slopes, strict=True):
            # of nearly all: next to the critical angle derivatives have no bound
            error = np.abs(slope - exact_slope) / (1.0 + np.abs(exact_slope))
            if not np.quantile(error, 0.99) <= 1e-3:
                raise RuntimeError(f"a derivative of {function.name} is off")


def kernels(candidates: Sequence[Function], settings: Settings) -> dict[str, dict[str, Run]]:
    """For each kind of kernel and each function, what runs it."""
    import drjit as dr
    import mitsuba as mi

    from fresnel_decomp.mitsuba.workloads import compute_bound, streaming

    many, few = arguments_of(settings.points), arguments_of(settings.elements)[0]
    one = [dr.opaque(mi.Float, value) for value in INDEX]

    def on_one_material(function: Function) -> Callable[[Any], Any]:
        return lambda cosine: function.run(cosine, *one[: function.arity])

    def gradient(function: Function, mode: str) -> Run:
        return lambda: dr.eval(with_gradient(function, many, mode))

    kinds: dict[str, Callable[[Function], Run]] = {
        "streaming, one material": lambda f: streaming(on_one_material(f), many[0]),
        "streaming, index from memory": lambda f: streaming(
            lambda cosine: f.run(cosine, *many[1 : 1 + f.arity]), many[0]
        ),
        "compute-bound": lambda f: compute_bound(on_one_material(f), mi.Float, few, settings.turns),
        "value and gradient, backward": lambda f: gradient(f, "backward"),
        "value and gradient, forward": lambda f: gradient(f, "forward"),
    }
    return {kind: {f.name: make(f) for f in candidates} for kind, make in kinds.items()}


def summary(
    times: dict[str, dict[str, list[float]]], settings: Settings
) -> dict[str, dict[str, Cell]]:
    """By function and kind; the base is the first function of each kind."""
    from fresnel_decomp.mitsuba.timing import ratio_and_spread
    from fresnel_decomp.mitsuba.workloads import UNROLL

    results: dict[str, dict[str, Cell]] = {}
    for kind, by_name in times.items():
        base = next(iter(by_name.values()))
        count = settings.points
        if kind.startswith("compute"):
            count = settings.elements * settings.turns * UNROLL
        for name, milliseconds in by_name.items():
            nanoseconds = 1e6 * float(np.median(milliseconds)) / count
            cell = Cell(*ratio_and_spread(milliseconds, base), nanoseconds)
            results.setdefault(name, {})[kind] = cell
    return results


def table(base: str, results: dict[str, dict[str, Cell]]) -> str:
    """Ratios in Markdown, and the base's times below them."""
    rows = [
        [name, *(f"{cell.ratio:.2f} ± {cell.spread:.2f}" for cell in cells.values())]
        for name, cells in results.items()
        if name != base
    ]
    rows.append([f"{base}, ns", *(f"{cell.nanoseconds:.2f}" for cell in results[base].values())])
    return markdown([f"time / {base}", *results[base]], rows)


def verdicts(results: dict[str, dict[str, dict[str, Cell]]]) -> str:
    """Whether each ratio, as the tables show it, reaches its target, and how many do."""
    rows = []
    for by_name in results.values():
        for name, cells in by_name.items():
            precision = name.rpartition(", ")[2]
            for kind, cell in cells.items():
                wanted = next(v for start, v in TARGETS.items() if kind.startswith(start))
                if precision in wanted:
                    ratio, limit = f"{cell.ratio:.2f}", f"{wanted[precision]:.2f}"
                    verdict = "met" if float(ratio) <= float(limit) else "missed"
                    rows.append([f"{name}: {kind}", f"≤ {limit}", ratio, verdict])
    count = sum(row[-1] == "met" for row in rows)
    lines = markdown(["target", "wanted", "measured", "verdict"], rows)
    return f"{lines}\n\n{count} of {len(rows)} targets are met, {len(rows) - count} are missed."


def counts() -> list[dict[str, Any]]:
    """Operations of every function with its value alone and with derivatives, in an LLVM variant.

    Each as (arithmetic, all, in float64), where all takes in what `count_vector_operations` does.
    """
    from fresnel_decomp.mitsuba.operations import count_operations, count_vector_operations

    rows = []
    for candidates in functions().values():
        for function in candidates:
            point = (0.5, *INDEX)[: 1 + function.arity]
            runs: dict[str, Callable[..., Any]] = {"value": function.run}
            for mode in MODES:
                runs[f"value and gradient, {mode}"] = _differentiated(function, mode)
            row: dict[str, Any] = {"function": function.name}
            for kind, run in runs.items():
                everything = count_vector_operations(run, *point)
                double = sum(n for (_, bits), n in everything.items() if bits == 64)
                arithmetic = count_operations(run, *point).total()
                row[kind] = (arithmetic, everything.total(), double)
            rows.append(row)
    return rows


def _differentiated(function: Function, mode: str) -> Callable[..., list[Any]]:
    return lambda *arguments: with_gradient(function, arguments, mode)


def count_table(rows: Sequence[dict[str, Any]]) -> str:
    """Counts in Markdown."""
    lines = []
    for row in rows:
        cells = []
        for arithmetic, everything, double in list(row.values())[1:]:
            wide = f", {double} in float64" if double else ""
            cells.append(f"{everything} ({arithmetic} arithmetic{wide})")
        lines.append([row["function"], *cells])
    return markdown(["operations", *list(rows[0])[1:]], lines)


@script()
@click.option("--variant", default="llvm_ad_rgb", show_default=True, help="Of LLVM or CUDA.")
@click.option("--rounds", default=21, show_default=True, type=click.IntRange(9))
@click.option("--points", default=10_000_000, show_default=True, help="Evaluations, streaming.")
@click.option("--elements", default=65_536, show_default=True, help="Of compute-bound kernels.")
@click.option("--turns", default=19, show_default=True, help="Of the compute-bound loop.")
@click.option("--threads", type=int, help="Of the LLVM backend.  [default: all]")
@page_option(MARKS, COUNT_MARKS)
@json_option
def speed(threads: int | None, page: Path | None, out: Path | None, **given: Any) -> None:
    """Speed of the exact equations, relative to Mitsuba's own functions in the same run."""
    settings = Settings(**given)
    if settings.variant.startswith("scalar"):
        raise input_error(
            f"variant '{settings.variant}'",
            "an llvm_ad or cuda_ad variant",
            "Scalar variants have no kernels to time; `fresnel-decomp doctor` says what works.",
        )
    doctor.require_variant(settings.variant)
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(settings.variant)
    if threads:
        dr.set_thread_count(threads)
    from fresnel_decomp.bench.machine import describe_machine
    from fresnel_decomp.mitsuba.timing import interleaved_times

    families = functions()
    results = {}
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("timing", total=len(families) * (settings.rounds + 2))
        for base, candidates in families.items():
            check(candidates)
            times = interleaved_times(
                kernels(candidates, settings), settings.rounds, lambda: progress.advance(task)
            )
            results[base] = summary(times, settings)
    facts = about(settings)
    where = f"Medians of {settings.rounds} runs in {describe_machine(facts)}."
    times_text = "\n\n".join(
        [*(table(*item) for item in results.items()), where, verdicts(results)]
    )
    counted = counts() if settings.variant.startswith("llvm") else []
    counts_text = count_table(counted) if counted else f"Not counted in {settings.variant}."
    click.echo(f"{times_text}\n\n{counts_text}")
    if out:
        rows = [
            {"function": name, "kernel": kind, "relative_to": base, **vars(cell)}
            for base, by_name in results.items()
            for name, cells in by_name.items()
            for kind, cell in cells.items()
        ]
        write_json(out, {"about": facts, "results": rows, "operations": counted})
    if page:
        insert(page, times_text, MARKS)
        if counted:
            insert(page, counts_text, COUNT_MARKS)


def about(settings: Settings) -> dict[str, Any]:
    """Machine, versions and settings."""
    from fresnel_decomp.bench.machine import machine_facts
    from fresnel_decomp.mitsuba.workloads import UNROLL

    return {
        "what": "the exact equations alone",
        **machine_facts(settings.variant),
        "rounds": settings.rounds,
        "points": settings.points,
        "elements": settings.elements,
        "evaluations_per_element": settings.turns * UNROLL,
        "index": INDEX,
    }


if __name__ == "__main__":
    main(speed)

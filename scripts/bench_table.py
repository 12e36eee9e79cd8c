"""What baking and looking up the table cost, and what sampling would cost for the same error.

    python scripts/bench_table.py --out bench_table.json --page docs/preintegration.md

Baking: 64 x 64 texels of the `talk` basis, warm, whole calls to `AlbedoTable.bake` in NumPy and
with Dr.Jit, where the kernel's time is given too. The error is the largest over all texels and
terms, against 1,024 nodes a texel in float64. Quasi-Monte Carlo is a plain NumPy bake over a Sobol'
sequence of visible normals; it is run for up to 2^13 samples on every eighth texel in either
direction, and the samples for an equal error are extrapolated from a fit of its error, whose
exponent is printed. Its time is that of its evaluations per second.

Kinks: the default rule of `directional_albedo` against one whose nodes were doubled until nothing
changed by more than 1e-6, or to 512 x 384, over 12 x 11 views and roughnesses.

Looking up: four terms at 1e6 views, against evaluating the four functions in closed form, and the
whole integral.

All take turns; a time is the median over rounds, ± half the distance between its quartiles. Ratios
are of the time of all processors, which other programs disturb less than the clock; for Dr.Jit it
is about the time by the clock times the number of threads, on a machine that does nothing else.
"""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.progress import Progress

from _markdown import insert, markdown
from fresnel_decomp import (
    AlbedoTable,
    __version__,
    conductor,
    dielectric,
    directional_albedo,
    doctor,
    load_basis,
)
from fresnel_decomp._files import write_json
from fresnel_decomp.albedo import QUADRATURE
from fresnel_decomp.albedo_estimates import quasi_monte_carlo_albedo
from fresnel_decomp.albedo_refined import refined_albedo
from fresnel_decomp.cli import run_and_exit
from fresnel_decomp.fast_curves import FastCurves
from fresnel_decomp.microfacet import DISTRIBUTIONS, SMITH
from fresnel_decomp.table import BAKE_QUADRATURE, CHECK_QUADRATURE
from fresnel_decomp.table_layout import Layout

MARKS = ("<!-- bench table -->\n", "<!-- end of bench table -->\n")
KINK_MARKS = ("<!-- kinks -->\n", "<!-- end of kinks -->\n")
CURVES = {
    "white": lambda c: 1.0 + 0.0 * c,
    "gold, green": lambda c: conductor(c, 0.42, 2.4),
    "dielectric, η = 1.5": lambda c: dielectric(c, 1.5),
    "dielectric, η = 0.9": lambda c: dielectric(c, 0.9),
    "dielectric, η = 0.7": lambda c: dielectric(c, 0.7),
    "dielectric, η = 0.5": lambda c: dielectric(c, 0.5),
}
SAMPLES = (256, 512, 1024, 2048, 4096, 8192)
STRIDE = 8
VIEWS = 1_000_000
TARGETS = {"NumPy": 300.0, "Dr.Jit": 25.0}  # milliseconds of a whole bake by the clock, two cores
LARGEST_ERROR = 5e-5


def spread(times: list[float]) -> tuple[float, float]:
    """Median, and half the distance between the quartiles."""
    low, middle, high = statistics.quantiles(times, n=4, method="inclusive")
    return middle, 0.5 * (high - low)


def timed(call: Callable[[], Any]) -> tuple[float, float]:
    """Milliseconds of a call, by the clock and of all processors."""
    wall, processors = time.perf_counter(), time.process_time()
    call()
    return 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - processors)


def both(times: list[tuple[float, float]], scale: float = 1.0) -> dict[str, float]:
    """Medians and spreads of what `timed` returned."""
    wall, processors = (spread([scale * t for t in column]) for column in zip(*times, strict=True))
    return dict(
        zip(("wall", "wall_spread", "cpu", "cpu_spread"), (*wall, *processors), strict=True)
    )


def kernels(dr: Any, call: Callable[[], Any]) -> tuple[float, float]:
    """Milliseconds that the kernels of a call take, and of all processors for all of it."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        processors = time.process_time()
        dr.eval(call())
        dr.sync_thread()
        processors = 1e3 * (time.process_time() - processors)
        history = dr.kernel_history([dr.KernelType.JIT])
        return sum(kernel["execution_time"] for kernel in history), processors


def errors(progress: Callable[[int], None]) -> dict[str, float]:
    """Largest error of a bake for each distribution and Smith model."""
    basis, found = load_basis(), {}
    for distribution in DISTRIBUTIONS:
        for smith in SMITH:
            table = AlbedoTable.bake(basis, smith=smith, distribution=distribution)
            found[f"{distribution}, {smith}"] = table.error(basis)
            progress(1)
    return found


def kinks(progress: Callable[[int], None]) -> dict[str, dict[str, float]]:
    """Largest errors of the default rule, and of refined ones, with and without a kink in F."""
    root = np.linspace(0.0, 1.0, 12)
    alpha, mu = np.meshgrid(root[1:] ** 2, root**2, indexing="ij")
    found = {}
    for name, f in CURVES.items():
        refined = refined_albedo(f, mu, alpha, tolerance=1e-6)
        found[name] = {
            "default": float(np.abs(directional_albedo(f, mu, alpha) - refined.value).max()),
            "refined": float(refined.error.max()),
            "azimuth": refined.quadrature.azimuth,
            "slope": refined.quadrature.slope,
        }
        progress(1)
    return found


def sampling(progress: Callable[[int], None]) -> dict[str, Any]:
    """Errors of quasi-Monte Carlo by number of samples, and nanoseconds a sample and texel."""
    layout = Layout()
    alpha, mu = np.meshgrid(layout.alpha[1::STRIDE], layout.mu[::STRIDE], indexing="ij")
    curves = FastCurves.of(load_basis())
    exact = directional_albedo(curves, mu, alpha, quadrature=CHECK_QUADRATURE)
    found, nanoseconds = {}, []
    for samples in SAMPLES:
        largest = []
        for seed in range(4):
            start = time.process_time()
            estimate = quasi_monte_carlo_albedo(curves, mu, alpha, samples, seed=seed, replicates=1)
            nanoseconds.append(1e9 * (time.process_time() - start) / (samples * mu.size))
            largest.append(float(np.abs(estimate.value - exact).max()))
            progress(1)
        found[samples] = statistics.median(largest)
    exponent, offset = np.polyfit(np.log(list(found)), np.log(list(found.values())), 1)
    return {
        "errors": {str(n): e for n, e in found.items()},
        "exponent": float(exponent),
        "offset": float(offset),
        "ns_per_sample": statistics.median(nanoseconds),
    }


def baking(dr: Any, kind: Any, rounds: int, progress: Callable[[int], None]) -> dict[str, Any]:
    """Milliseconds of bakes: whole calls, and kernels."""
    basis = load_basis()
    times: dict[str, list[tuple[float, float]]] = {"NumPy": []}
    if kind is not None:
        times |= {"Dr.Jit": [], "Dr.Jit, kernel": []}
        for _ in range(2):
            AlbedoTable.bake(basis, float_type=kind)
    for _ in range(rounds):
        times["NumPy"].append(timed(lambda: AlbedoTable.bake(basis)))
        if kind is not None:
            times["Dr.Jit"].append(timed(lambda: AlbedoTable.bake(basis, float_type=kind)))
            times["Dr.Jit, kernel"].append(kernels(dr, lambda: _bake_only(basis, kind)))
        progress(1)
    return {name: both(t) for name, t in times.items()}


def _bake_only(basis: Any, kind: Any) -> None:
    AlbedoTable.bake(basis, float_type=kind)


def lookups(dr: Any, kind: Any, rounds: int, progress: Callable[[int], None]) -> dict[str, Any]:
    """Nanoseconds a view: lookup, closed form of the functions, integral (of fewer views)."""
    basis = load_basis()
    table, form = AlbedoTable.bake(basis), basis.closed_form
    mu, alpha = np.random.default_rng(0).random((2, VIEWS))
    calls: dict[str, tuple[int, Callable[[], Any]]] = {}
    few = VIEWS // 256
    if kind is None:
        calls = {
            "lookup": (VIEWS, lambda: table.lookup(mu, alpha)),
            "closed form, no roughness": (VIEWS, lambda: form(mu)),
        }
        measure: Callable[[Callable[[], Any]], tuple[float, float]] = timed
    else:
        m, a = (kind(v) + dr.opaque(kind, 0.0) for v in (mu, alpha))
        m_few, a_few = (kind(v[:few]) + dr.opaque(kind, 0.0) for v in (mu, alpha))
        dr.eval(m, a, m_few, a_few)
        curves = FastCurves.of(basis).on(kind)
        calls = {
            "lookup": (VIEWS, lambda: table.lookup(m, a)),
            "closed form, no roughness": (VIEWS, lambda: form(m)),
            "integral": (
                few,
                lambda: directional_albedo(curves, m_few, a_few, quadrature=BAKE_QUADRATURE),
            ),
        }

        def measure(call: Callable[[], Any]) -> tuple[float, float]:
            return kernels(dr, call)

    times: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    for i in range(-2, rounds):
        for name in list(calls)[:: -1 if i % 2 else 1]:
            count, call = calls[name]
            wall, processors = measure(call)
            if i >= 0:
                times[name].append((wall / count, processors / count))
        progress(1)
    return {name: both(t, 1e6) for name, t in times.items()}


def verdict(milliseconds: float, wanted: float | None) -> str:
    """Whether a target is met; nothing where there is none."""
    if wanted is None:
        return ""
    if milliseconds <= wanted:
        return f"{wanted:.0f}: met"
    return f"{wanted:.0f}: missed, {milliseconds / wanted:.1f} times as long"


def report(results: dict[str, Any]) -> str:
    """Markdown."""
    baked, sampled = results["baking"], results["sampling"]
    error = results["errors"]["ggx, separable"]
    needed = float(np.exp((np.log(error) - sampled["offset"]) / sampled["exponent"]))
    nodes = f"{np.prod(BAKE_QUADRATURE)}"
    base = baked["NumPy"]["cpu"]
    rows = [
        [
            f"rule, {name}",
            nodes,
            f"{error:.1e}",
            f"{t['wall']:.0f} ± {t['wall_spread']:.0f}",
            f"{t['cpu']:.0f} ± {t['cpu_spread']:.0f}",
            f"{t['cpu'] / base:.2f}",
            verdict(t["wall"], TARGETS.get(name)),
        ]
        for name, t in baked.items()
    ]
    counts = [(f"{n:,}", n, sampled["errors"][str(n)]) for n in (256, 4096)]
    counts.append((f"{needed:,.0f} (extrapolated)", needed, error))
    for label, count, largest in counts:
        ms = 1e-6 * count * sampled["ns_per_sample"] * 64**2
        cost = ["", f"{ms:,.0f}", f"{ms / base:,.1f}", ""]
        rows.append(["quasi-Monte Carlo, NumPy", label, f"{largest:.1e}", *cost])
    first = markdown(
        (
            "64 × 64 × 4, separable GGX",
            "evaluations a texel",
            "largest error",
            "ms by the clock",
            "ms of all processors",
            "ratio",
            "wanted by the clock",
        ),
        rows,
    )
    second = markdown(
        ("256 nodes a texel", "largest error", f"wanted: {LARGEST_ERROR:.0e}"),
        [
            [name, f"{value:.1e}", "met" if value <= LARGEST_ERROR else "missed"]
            for name, value in results["errors"].items()
        ],
    )
    base = results["lookups"]["lookup"]["cpu"]
    third = markdown(
        ("four terms, a view", "ns by the clock", "ns of all processors", "ratio"),
        [
            [
                name,
                f"{t['wall']:.2f} ± {t['wall_spread']:.2f}",
                f"{t['cpu']:.2f} ± {t['cpu_spread']:.2f}",
                f"{t['cpu'] / base:.2f}",
            ]
            for name, t in results["lookups"].items()
        ],
    )
    return f"{first}\n\n{second}\n\n{third}"


def kink_report(results: dict[str, Any]) -> str:
    """Markdown."""
    return markdown(
        (
            "F, separable GGX",
            f"largest error, {QUADRATURE.azimuth} × {QUADRATURE.slope}",
            "nodes, refined",
            "estimated error",
        ),
        [
            [
                name,
                f"{found['default']:.1e}",
                f"{found['azimuth']} × {found['slope']}",
                f"{found['refined']:.1e}",
            ]
            for name, found in results["kinks"].items()
        ],
    )


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--rounds", default=9, show_default=True, type=click.IntRange(7))
@click.option("--out", type=click.Path(path_type=Path), help="Also write this JSON file.")
@click.option(
    "--page",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Also put the tables into this Markdown file.",
)
def bench(rounds: int, out: Path | None, page: Path | None) -> None:
    """Cost of baking and looking up the preintegrated table."""
    console = Console(stderr=True)
    usable = doctor.usable_variants()["llvm_ad_rgb"].usable
    dr, kind = None, None
    if usable:
        import drjit as dr
        from drjit.llvm.ad import Float as kind  # noqa: N813
    else:
        console.print("No usable LLVM: NumPy only.")
    steps = 4 + len(CURVES) + 4 * len(SAMPLES) + rounds + rounds + 2
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("measuring", total=steps)

        def step(count: int) -> None:
            progress.advance(task, count)

        results = {
            "errors": errors(step),
            "kinks": kinks(step),
            "baking": baking(dr, kind, rounds, step),
            "sampling": sampling(step),
            "lookups": lookups(dr, kind, rounds, step),
        }
    click.echo(f"{kink_report(results)}\n\n{report(results)}")
    found = doctor.report()
    about = {
        "fresnel_decomp": __version__,
        "versions": found.versions | {"numpy": np.__version__},
        "llvm": ".".join(map(str, found.llvm.version or ())) if usable else None,
        "threads": dr.thread_count() if dr is not None else None,
        "machine": platform.machine(),
        "rounds": rounds,
    }
    if out:
        write_json(out, {"about": about, **results})
    if page:
        insert(page, kink_report(results), KINK_MARKS)
        insert(page, report(results), MARKS)
        click.echo(f"Wrote {page}", err=True)


def main() -> None:
    """Run and exit: 0 done, 1 failed, 2 bad input, 130 interrupted."""
    doctor.prepare()  # before anything imports Dr.Jit
    run_and_exit(bench, None, "bench_table.py", "Interrupted; nothing was written.")


if __name__ == "__main__":
    main()

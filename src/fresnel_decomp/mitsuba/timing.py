"""How long renders take with one BSDF relative to another, on a machine that does other things too.

Models take turns, and each time is divided by that of the reference model in the same round: what
slows the machine for a while slows both alike and cancels.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from .._check import choose, input_error
from .._spread import median_and_spread
from .scenes import load_scene
from .variants import variant_scope

__all__ = ["Timing", "interleaved_times", "kernel_milliseconds", "kernel_times", "ratio_and_spread"]

_WARM_UP = 2  # rounds that compile and fill caches
_MOST_REPEATS = 64


@dataclass(frozen=True)
class Timing:
    """How long a full render takes with one model."""

    median_ms: float
    runs_ms: tuple[float, ...]
    """One per round."""
    ratio: float
    """Median over rounds of the time relative to the reference model's in the same round."""
    spread: float
    """Half the distance between the quartiles of these ratios."""
    reference: str
    """Name of the reference model; its own ratio is 1 and its spread 0."""
    clock: str
    """'kernel' (sum of Dr.Jit's kernel times) or 'wall' (scalar variants have no kernels)."""
    variant: str
    threads: int
    """Of Dr.Jit's pool; 0 on a GPU."""


def kernel_times(
    bsdfs: Mapping[str, Any],
    *,
    scene: str = "studio",
    size: int | tuple[int, int] = 128,
    spp: int = 16,
    seed: int = 0,
    runs: int = 7,
    variant: str | None = None,
    reference: str | None = None,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Timing]:
    """Time of rendering one scene with each BSDF, warm, with forced evaluation.

    Models take turns, in alternating order, so that a slow moment of the machine falls on all of
    them. Two rounds go before the first that counts: they compile.

    Parameters
    ----------
    bsdfs, scene, size, spp, seed, variant
        As for `render_bsdfs`; one pass of spp samples is timed.
    runs : int, ≥ 7
        Rounds that count.
    reference : str, optional
        The model that the others' ratios refer to, by default the first.
    progress : callable, optional
        Called with the fraction done, in (0, 1], after each render.

    Returns
    -------
    dict of Timing
        By name; compare the ratios.

    Raises
    ------
    InputError
        For fewer rounds, an unknown reference, and as `variant_scope` and `load_scene`.

    Examples
    --------
    >>> from fresnel_decomp.mitsuba.comparison import model_bsdfs
    >>> bsdfs = model_bsdfs(1.5, 4.0, ("exact", "schlick"))
    >>> times = kernel_times(bsdfs, size=8, spp=1, variant="scalar_rgb")
    >>> times["schlick"].reference, times["exact"].ratio, len(times["exact"].runs_ms)
    ('exact', 1.0, 7)
    """
    import drjit as dr
    import mitsuba as mi

    if runs < 7:
        raise input_error(f"runs={runs}", "an integer ≥ 7", "A median of fewer says little.")
    base = next(iter(bsdfs)) if reference is None else choose("reference", reference, bsdfs)
    times: dict[str, list[float]] = {name: [] for name in bsdfs}
    with variant_scope(variant) as active:
        scalar = active.startswith("scalar")
        scenes = {name: load_scene(scene, bsdf, size) for name, bsdf in bsdfs.items()}

        def render(loaded: Any) -> None:
            dr.eval(mi.render(loaded, spp=spp, seed=seed))

        clock = _wall_milliseconds if scalar else kernel_milliseconds
        done, total = 0, (runs + _WARM_UP) * len(scenes)
        for run in range(-_WARM_UP, runs):
            for name in list(scenes)[:: -1 if run % 2 else 1]:
                elapsed = sum(clock(partial(render, scenes[name])))
                if run >= 0:
                    times[name].append(elapsed)
                done += 1
                if progress is not None:
                    progress(done / total)
        threads = 0 if active.startswith("cuda") else dr.thread_count()
    return {
        name: Timing(
            statistics.median(values),
            tuple(values),
            *ratio_and_spread(values, times[base]),
            base,
            "wall" if scalar else "kernel",
            active,
            threads,
        )
        for name, values in times.items()
    }


def interleaved_times(
    runs: Mapping[str, Mapping[str, Callable[[], Any]]],
    rounds: int,
    advance: Callable[[], object] = lambda: None,
) -> dict[str, dict[str, list[float]]]:
    """Kernel milliseconds of functions that take turns, after two rounds that compile.

    Each function is run as often in a row as it fits, by the second of these rounds, into the time
    of the first of its kind: a machine that does other things interrupts long work more often than
    short work, so that only times of about equal length can be compared.

    Parameters
    ----------
    runs : mapping from kinds to names to functions that evaluate something
    rounds : int
        That count.
    advance : callable
        Called after each round.

    Returns
    -------
    The times of one run in all rounds, by kind and name. The order alternates, so that a slow
    moment of the machine falls on all of a kind.
    """
    times: dict[str, dict[str, list[float]]] = {
        kind: {name: [] for name in by_name} for kind, by_name in runs.items()
    }
    repeats = {kind: dict.fromkeys(by_name, 1) for kind, by_name in runs.items()}
    for number in range(-_WARM_UP, rounds):
        for kind, by_name in runs.items():
            found = {}
            for name in list(by_name)[:: -1 if number % 2 else 1]:
                count = repeats[kind][name]
                found[name] = sum(kernel_milliseconds(by_name[name], count)) / count
            if number >= 0:
                for name, value in found.items():
                    times[kind][name].append(value)
            elif number == -1 and found:
                first = found[next(iter(by_name))]
                repeats[kind] = {n: _repeats(first, value) for n, value in found.items()}
        advance()
    return times


def kernel_milliseconds(run: Callable[[], object], count: int = 1) -> list[float]:
    """Of each kernel that a function launches in `count` calls, in an LLVM or CUDA variant."""
    import drjit as dr

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        for _ in range(count):
            run()
        dr.sync_thread()
        return [kernel["execution_time"] for kernel in dr.kernel_history([dr.KernelType.JIT])]


def _wall_milliseconds(run: Callable[[], object]) -> list[float]:
    """The same by the clock, where there are no kernels."""
    start = time.perf_counter()
    run()
    return [1e3 * (time.perf_counter() - start)]


def _repeats(whole: float, part: float) -> int:
    """How often a part fits into a whole, once at least."""
    return min(max(round(whole / part), 1), _MOST_REPEATS) if part > 0.0 else 1


def ratio_and_spread(times: Sequence[float], reference: Sequence[float]) -> tuple[float, float]:
    """Median of times[i] / reference[i], and half the distance between the quartiles.

    Examples
    --------
    >>> ratio_and_spread([1.0, 2.0, 6.0], [1.0, 1.0, 2.0])  # the last round was slow for both
    (2.0, 0.5)
    """
    return median_and_spread([a / b for a, b in zip(times, reference, strict=True)])

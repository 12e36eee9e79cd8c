"""Times of renders: interleaved rounds, and ratios within a round."""

from __future__ import annotations

import numpy as np
import pytest

from fresnel_decomp._check import InputError
from fresnel_decomp.mitsuba.comparison import model_bsdfs
from fresnel_decomp.mitsuba.timing import kernel_times, ratio_and_spread
from fresnel_decomp.mitsuba.workloads import directions, random_cosines

MODELS = ("exact", "schlick", "f82")


def test_times(variant: str) -> None:
    bsdfs = model_bsdfs(1.5, 4.0, MODELS)
    steps: list[float] = []
    times = kernel_times(
        bsdfs, size=8, spp=1, variant=variant, reference="schlick", progress=steps.append
    )
    assert list(times) == list(MODELS)
    for timing in times.values():
        assert len(timing.runs_ms) == 7
        assert 0 < min(timing.runs_ms) <= timing.median_ms <= max(timing.runs_ms)
        assert timing.variant == variant
        assert timing.clock == ("wall" if variant.startswith("scalar") else "kernel")
        assert timing.reference == "schlick"
        base = times["schlick"].runs_ms
        assert (timing.ratio, timing.spread) == ratio_and_spread(timing.runs_ms, base)
        assert timing.ratio > 0.0
    assert (times["schlick"].ratio, times["schlick"].spread) == (1.0, 0.0)
    assert steps == [(i + 1) / 27 for i in range(27)]  # two rounds do not count


def test_ratios_ignore_slow_rounds() -> None:
    base = [1.0, 1.0, 1.0, 1.0, 10.0, 10.0, 10.0]
    ratio, spread = ratio_and_spread([0.5 * time for time in base], base)
    assert (ratio, spread) == (0.5, 0.0)
    assert ratio_and_spread([1.0, 2.0, 3.0, 4.0, 5.0], [1.0] * 5) == (3.0, 1.0)


def test_bad_input(variant: str) -> None:
    bsdfs = model_bsdfs(1.5, 4.0, MODELS)
    with pytest.raises(InputError, match="runs"):
        kernel_times(bsdfs, runs=3)
    with pytest.raises(InputError, match="'exact'"):
        kernel_times(bsdfs, reference="exakt")


def test_workloads_come_from_their_seed(variant: str) -> None:
    if variant.startswith("scalar"):
        pytest.skip("workloads are arrays")

    def made(seed: int) -> np.ndarray:
        si, wo = directions(64, seed)
        return np.concatenate([np.array(random_cosines(64, seed)), np.ravel(si.wi), np.ravel(wo)])

    assert (made(0) == made(0)).all()
    assert (made(0) != made(1)).mean() > 0.9

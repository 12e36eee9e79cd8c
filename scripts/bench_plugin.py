"""Speed of `decomposed_conductor` relative to Mitsuba's `roughconductor`.

Two ratios per Fresnel term: kernel time of the BSDF alone (`eval` on random directions), and of a
whole path-traced picture with several bounces between conductors. Runs of all plugins are
interleaved, so that a busy machine slows them alike; each ratio is the median over rounds of
(plugin / built-in of the same round), its spread half the distance between quartiles. The last two
are the decomposition with energy compensation.

    python scripts/bench_plugin.py --variant llvm_ad_rgb --out bench.json
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

from _command_line import json_option, main, script
from fresnel_decomp import doctor
from fresnel_decomp._files import write_json
from fresnel_decomp.microfacet import DISTRIBUTIONS

PLUGINS = {
    "roughconductor": {"type": "roughconductor"},
    **{
        fresnel: {"type": "decomposed_conductor", "fresnel": fresnel}
        for fresnel in ("exact", "schlick", "f82", "decomposition")
    },
    **{
        kind: {
            "type": "decomposed_conductor",
            "energy_compensation": True,
            "compensation": kind,
        }
        for kind in ("lobe", "scaling")
    },
}
TARGETS = {"decomposition": {"eval": 0.85, "render": 1.03}}


@dataclass(frozen=True)
class Settings:
    """How much is measured, and of which surface."""

    variant: str
    rounds: int
    points: int
    size: int
    spp: int
    distribution: str
    material: str | None


@script()
@click.option("--variant", default="llvm_ad_rgb", show_default=True)
@click.option("--rounds", default=15, show_default=True, type=click.IntRange(3))
@click.option("--points", default=4_000_000, show_default=True, help="Pairs of directions.")
@click.option("--size", default=256, show_default=True, help="Width of the picture.")
@click.option("--spp", default=32, show_default=True)
@click.option("--distribution", type=click.Choice(DISTRIBUTIONS), default="ggx", show_default=True)
@click.option("--material", help="Take Mitsuba's preset instead of a fixed colour.")
@json_option
def bench(out: Path | None, **given: Any) -> None:
    """Speed of `decomposed_conductor` relative to Mitsuba's `roughconductor`."""
    settings = Settings(**given)
    doctor.require_variant(settings.variant)
    import mitsuba as mi

    mi.set_variant(settings.variant)
    from fresnel_decomp.mitsuba import register

    register()
    from fresnel_decomp.bench.machine import machine_facts
    from fresnel_decomp.mitsuba.timing import interleaved_times

    times = interleaved_times(kernels(settings), settings.rounds)
    results = {kind: summary(rounds) for kind, rounds in times.items()}
    click.echo(f"{'':16}{'BSDF only':>26}{'whole render':>26}   relative to roughconductor")
    for name in PLUGINS:
        cells = "".join(
            f"{row['ratio']:>12.3f} ± {row['spread']:.3f}{row['milliseconds']:>7.0f} ms"[
                -24:
            ].rjust(24)
            for row in (results["eval"][name], results["render"][name])
        )
        click.echo(f"{name:16}{cells}")
    for name, limits in TARGETS.items():
        for kind, limit in limits.items():
            ratio = results[kind][name]["ratio"]
            verdict = "met" if ratio <= limit else "missed"
            click.echo(f"{name}, {kind}: {ratio:.3f}, target {limit} {verdict}")
    if out:
        about = {**machine_facts(settings.variant), **asdict(settings)}
        write_json(out, {"about": about, "results": results})


def bsdf(name: str, settings: Settings) -> dict[str, Any]:
    """Scene description of a plugin under test."""
    from fresnel_decomp.mitsuba.workloads import BERYLLIUM

    colours = {key: {"type": "rgb", "value": value} for key, value in BERYLLIUM.items()}
    indices = {"material": settings.material} if settings.material else colours
    return {**PLUGINS[name], **indices, "distribution": settings.distribution, "alpha": 0.2}


def kernels(settings: Settings) -> dict[str, dict[str, Callable[[], Any]]]:
    """For the BSDF alone and for a picture, what runs each plugin."""
    import mitsuba as mi

    from fresnel_decomp.mitsuba.workloads import bsdf_evaluation, directions, picture

    pairs = directions(settings.points)
    return {
        "eval": {n: bsdf_evaluation(mi.load_dict(bsdf(n, settings)), *pairs) for n in PLUGINS},
        "render": {n: picture(bsdf(n, settings), settings.size, settings.spp) for n in PLUGINS},
    }


def summary(times: dict[str, list[float]]) -> dict[str, dict[str, float]]:
    """Median time of each plugin, and its ratio to the built-in one with the spread of that."""
    from fresnel_decomp.mitsuba.timing import ratio_and_spread

    rows = {}
    for name, values in times.items():
        ratio, spread = ratio_and_spread(values, times["roughconductor"])
        rows[name] = {
            "milliseconds": statistics.median(values),
            "ratio": ratio,
            "spread": spread,
        }
    return rows


if __name__ == "__main__":
    main(bench)

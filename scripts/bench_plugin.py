"""Speed of `decomposed_conductor` relative to Mitsuba's `roughconductor`.

Two ratios per Fresnel term: kernel time of the BSDF alone (`eval` on random directions), and of a
whole path-traced picture with several bounces between conductors. Runs of all plugins are
interleaved, so that a busy machine slows them alike; each ratio is the median over rounds of
(plugin / built-in of the same round), its spread half the distance between quartiles. The last two
are the decomposition with energy compensation.

    python scripts/bench_plugin.py --page docs/plugin.md
    python scripts/bench_plugin.py --page docs/plugin.md --distribution beckmann
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click

from _command_line import json_option, main, page_option, script
from _markdown import insert, markdown, marks
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
        f"and {kind}": {
            "type": "decomposed_conductor",
            "energy_compensation": True,
            "compensation": kind,
        }
        for kind in ("scaling", "lobe")
    },
}
MARKS = {name: marks(f"plugin speed, {name}") for name in DISTRIBUTIONS}
KINDS = {"eval": "BSDF only", "render": "whole render"}
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
@page_option(*MARKS.values(), text="Put the table of this distribution into this Markdown file.")
@json_option
def bench(out: Path | None, page: Path | None, **given: Any) -> None:
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
    about = {**machine_facts(settings.variant), **asdict(settings)}
    text = report(results, about)
    click.echo(text)
    if page:
        insert(page, text, MARKS[settings.distribution])
    if out:
        write_json(out, {"about": about, "results": results})


def report(results: dict[str, Any], about: dict[str, Any]) -> str:
    """The table, what it was measured on, and whether targets are met."""
    from fresnel_decomp.bench.machine import describe_machine

    rows = [
        [name]
        + [f"{rows[name]['ratio']:.3f} ± {rows[name]['spread']:.3f}" for rows in results.values()]
        for name in PLUGINS
    ]
    times = [f"{rows['roughconductor']['milliseconds']:.0f} ms" for rows in results.values()]
    verdicts = []
    for name, limits in TARGETS.items():
        for kind, limit in limits.items():
            ratio = results[kind][name]["ratio"]
            verdict = "met" if ratio <= limit else "missed"
            verdicts.append(f"{KINDS[kind]} {ratio:.3f}, target {limit} {verdict}")
    return (
        f"{markdown(('BSDF', *(KINDS[kind] for kind in results)), rows)}\n\n"
        f"{describe_machine(about)}; {about['distribution']}, medians of {about['rounds']} rounds "
        f"± half the distance between quartiles. The built-in takes {' and '.join(times)}. "
        f"Decomposition: {'; '.join(verdicts)}."
    )


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

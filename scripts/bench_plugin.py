"""Speed of `decomposed_conductor` relative to Mitsuba's `roughconductor`.

Two ratios per Fresnel term: kernel time of the BSDF alone (`eval` on random directions), and of a
whole path-traced picture with several bounces between conductors. Runs of all plugins are
interleaved, so that a busy machine slows them alike; each ratio is the median over rounds of
(plugin / built-in of the same round), its spread half the distance between quartiles. The last two
are the decomposition with energy compensation.

    python scripts/bench_plugin.py --variant llvm_ad_rgb --out bench.json
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fresnel_decomp import doctor
from fresnel_decomp._files import write_json

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


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--variant", default="llvm_ad_rgb")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--points", type=int, default=4_000_000)
    parser.add_argument("--size", type=int, default=256, help="width of the picture")
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--distribution", default="ggx", choices=("ggx", "beckmann"))
    parser.add_argument("--material", help="take Mitsuba's preset instead of a fixed colour")
    parser.add_argument("--out", type=Path, help="also write the numbers to this JSON file")
    options = parser.parse_args(arguments)

    doctor.prepare()
    import mitsuba as mi

    mi.set_variant(options.variant)
    from fresnel_decomp.mitsuba import register

    register()
    from fresnel_decomp.bench.machine import machine_facts
    from fresnel_decomp.mitsuba.timing import interleaved_times

    times = interleaved_times(kernels(options), options.rounds)
    results = {kind: summary(rounds) for kind, rounds in times.items()}
    print(f"{'':16}{'BSDF only':>26}{'whole render':>26}   relative to roughconductor")
    for name in PLUGINS:
        cells = "".join(
            f"{row['ratio']:>12.3f} ± {row['spread']:.3f}{row['milliseconds']:>7.0f} ms"[
                -24:
            ].rjust(24)
            for row in (results["eval"][name], results["render"][name])
        )
        print(f"{name:16}{cells}")
    for name, limits in TARGETS.items():
        for kind, limit in limits.items():
            ratio = results[kind][name]["ratio"]
            verdict = "met" if ratio <= limit else "missed"
            print(f"{name}, {kind}: {ratio:.3f}, target {limit} {verdict}")
    if options.out:
        about = {
            **machine_facts(options.variant),
            "rounds": options.rounds,
            "points": options.points,
            "size": options.size,
            "spp": options.spp,
            "distribution": options.distribution,
            "material": options.material,
        }
        write_json(options.out, {"about": about, "results": results})


def bsdf(name: str, options: argparse.Namespace) -> dict[str, Any]:
    """Scene description of a plugin under test."""
    from fresnel_decomp.mitsuba.workloads import BERYLLIUM

    colours = {key: {"type": "rgb", "value": value} for key, value in BERYLLIUM.items()}
    indices = {"material": options.material} if options.material else colours
    return {**PLUGINS[name], **indices, "distribution": options.distribution, "alpha": 0.2}


def kernels(options: argparse.Namespace) -> dict[str, dict[str, Callable[[], Any]]]:
    """For the BSDF alone and for a picture, what runs each plugin."""
    import mitsuba as mi

    from fresnel_decomp.mitsuba.workloads import bsdf_evaluation, directions, picture

    pairs = directions(options.points)
    return {
        "eval": {n: bsdf_evaluation(mi.load_dict(bsdf(n, options)), *pairs) for n in PLUGINS},
        "render": {n: picture(bsdf(n, options), options.size, options.spp) for n in PLUGINS},
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
    main()

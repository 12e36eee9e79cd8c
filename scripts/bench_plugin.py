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
import os
import platform
import statistics
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fresnel_decomp import doctor
from fresnel_decomp._files import write_json

INDICES = {"eta": [4.185, 3.185, 2.784], "k": [3.835, 3.010, 2.869]}  # about beryllium
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
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(options.variant)
    from fresnel_decomp.mitsuba import register

    register()
    times = {
        "eval": measure(eval_kernels(options), options.rounds),
        "render": measure(render_kernels(options), options.rounds),
    }
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
            "variant": options.variant,
            "rounds": options.rounds,
            "points": options.points,
            "size": options.size,
            "spp": options.spp,
            "distribution": options.distribution,
            "material": options.material,
            "machine": platform.processor() or platform.machine(),
            "threads": dr.thread_count() if "llvm" in options.variant else None,
            "cpus": os.cpu_count(),
            "llvm": ".".join(map(str, dr.detail.llvm_version() or ())),
            "mitsuba": mi.__version__,
            "drjit": dr.__version__,
        }
        write_json(options.out, {"about": about, "results": results})


def bsdf(name: str, options: argparse.Namespace) -> dict[str, Any]:
    """Scene description of a plugin under test."""
    colours = {key: {"type": "rgb", "value": value} for key, value in INDICES.items()}
    indices = {"material": options.material} if options.material else colours
    return {**PLUGINS[name], **indices, "distribution": options.distribution, "alpha": 0.2}


def eval_kernels(options: argparse.Namespace) -> dict[str, Callable[[], None]]:
    """For each plugin, a function that evaluates it on random pairs of directions."""
    import drjit as dr
    import mitsuba as mi

    sampler = mi.PCG32(size=options.points)

    def direction() -> Any:
        return mi.warp.square_to_cosine_hemisphere(
            mi.Point2f(sampler.next_float32(), sampler.next_float32())
        )

    si = dr.zeros(mi.SurfaceInteraction3f, options.points)
    si.wi, wo = direction(), direction()
    if mi.is_spectral:
        si.wavelengths = type(si.wavelengths)(
            *(360.0 + 470.0 * sampler.next_float32() for _ in range(len(si.wavelengths)))
        )
    dr.eval(si, wo)

    def kernel(name: str) -> Callable[[], None]:
        plugin = mi.load_dict(bsdf(name, options))
        return lambda: dr.eval(plugin.eval(mi.BSDFContext(), si, wo, True))

    return {name: kernel(name) for name in PLUGINS}


def render_kernels(options: argparse.Namespace) -> dict[str, Callable[[], None]]:
    """For each plugin, a function that renders conducting balls on a conducting floor."""
    import drjit as dr
    import mitsuba as mi

    def kernel(name: str) -> Callable[[], None]:
        material = bsdf(name, options)
        scale = mi.ScalarTransform4f().scale(4.0)
        view = mi.ScalarTransform4f().look_at([0, -5, 2.5], [0, 0, 0.4], [0, 0, 1])
        balls = {
            f"ball{i}": {
                "type": "sphere",
                "center": [1.1 * (i - 1), 0.4 * (i % 2), 0.5],
                "radius": 0.5,
                "bsdf": material,
            }
            for i in range(3)
        }
        film = {"type": "hdrfilm", "width": options.size, "height": options.size}
        scene = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "path", "max_depth": 5, "rr_depth": 6},
                "sensor": {"type": "perspective", "fov": 40, "to_world": view, "film": film},
                "floor": {"type": "rectangle", "to_world": scale, "bsdf": material},
                "sky": {"type": "constant"},
                **balls,
            }
        )
        return lambda: dr.eval(mi.render(scene, spp=options.spp, seed=0))

    return {name: kernel(name) for name in PLUGINS}


def measure(kernels: dict[str, Callable[[], None]], rounds: int) -> dict[str, list[float]]:
    """Kernel milliseconds of each function in each round, after two warm-up rounds."""
    import drjit as dr

    times: dict[str, list[float]] = {name: [] for name in kernels}
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        for warm in [False, False] + [True] * rounds:
            for name, run in kernels.items():
                dr.kernel_history_clear()
                run()
                dr.sync_thread()
                total = sum(entry["execution_time"] for entry in dr.kernel_history())
                if warm:
                    times[name].append(total)
    return times


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

"""Renders of metals in RGB against renders of their whole spectra.

    python scripts/spectral_renders.py
    python scripts/spectral_renders.py --metals Au --spp 4096 --out renders.json

A rough sphere in uniform daylight (D65) has at each distance from its centre the directional albedo
at one angle, so pixels at one distance are averaged, which takes the noise of spectral rendering
out. The truth is Mitsuba's `roughconductor` with its spectra, in a spectral variant. Against it:
the same plugin in RGB, where Mitsuba integrates eta and k with an equal-energy weight;
`decomposed_conductor` in RGB with `illuminant`; and `decomposed_conductor` in the spectral variant.
*RGB to spectral* is one of these against the other.
All are relative to a perfect mirror in the same variant. *noise* is the truth against itself with
another seed. Colour differences are CIEDE2000, weighted by area of the picture.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.progress import Progress

from _command_line import json_option, main, script
from _markdown import markdown
from fresnel_decomp import RECIPES, delta_e_2000, doctor
from fresnel_decomp._files import write_json

METALS = ("Au", "Cu", "Be")
SIZE = 48
RINGS = 24

Array = np.ndarray


@script()
@click.option("--metals", multiple=True, default=METALS, show_default=True, help="Repeatable.")
@click.option("--alpha", type=float, default=0.1, show_default=True)
@click.option("--spp", default=4096, show_default=True, help="A square, for stratification.")
@json_option
def renders(metals: tuple[str, ...], alpha: float, spp: int, out: Path | None) -> None:
    """Renders of metals in RGB against renders of their whole spectra."""
    for variant in ("llvm_ad_spectral", "llvm_ad_rgb"):
        doctor.require_variant(variant)
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("rendering", total=None)

        def report(done: int, count: int) -> None:
            progress.update(task, completed=done, total=count)

        results = measure(metals, alpha, spp, report)
    click.echo(table(results))
    if out:
        write_json(out, {"alpha": alpha, "spp": spp, "results": results})


def bsdfs(metal: str) -> dict[str, tuple[str, dict[str, Any]]]:
    """Variant and plugin of every row: the truth first."""
    ours = {"type": "decomposed_conductor", "material": metal, "illuminant": "D65"}
    built_in = {"type": "roughconductor", "material": metal}
    rows = {
        "truth": ("llvm_ad_spectral", built_in),
        "noise": ("llvm_ad_spectral", built_in),
        "roughconductor, RGB": ("llvm_ad_rgb", built_in),
    }
    for recipe in RECIPES:
        rows[f"{recipe}, RGB"] = ("llvm_ad_rgb", {**ours, "recipe": recipe})
        rows[f"{recipe}, spectral"] = ("llvm_ad_spectral", {**ours, "recipe": recipe})
    rows["schlick, RGB"] = ("llvm_ad_rgb", {**ours, "fresnel": "schlick"})
    rows["f82, RGB"] = ("llvm_ad_rgb", {**ours, "fresnel": "f82"})
    return rows


def measure(
    metals: Sequence[str],
    alpha: float,
    spp: int,
    report: Callable[[int, int], None] = lambda done, count: None,
    only: Sequence[str] | None = None,
) -> dict[str, dict[str, dict[str, float]]]:
    """Mean and largest colour difference by metal and row."""
    jobs = [
        (variant, metal, row, bsdf)
        for metal in metals
        for row, (variant, bsdf) in bsdfs(metal).items()
        if only is None or row in (*only, "truth", "noise")
    ]
    jobs.sort(key=lambda job: job[0])  # variants one after the other
    white: dict[str, Array] = {}
    pictures: dict[tuple[str, str], Array] = {}
    for done, (variant, metal, row, bsdf) in enumerate(jobs):
        report(done, len(jobs))
        if variant not in white:
            mirror = {"type": "roughconductor", "material": "none"}
            white[variant] = rings(render(variant, mirror, alpha, spp, seed=7))
        seed = {"truth": 0, "noise": 1}.get(row, 2)
        pictures[metal, row] = rings(render(variant, bsdf, alpha, spp, seed)) / white[variant]
    weight = np.arange(RINGS) + 0.5
    results: dict[str, dict[str, dict[str, float]]] = {metal: {} for metal in metals}

    def compare(metal: str, row: str, a: Array, b: Array) -> None:
        difference = delta_e_2000(a, b)
        mean = float(np.average(difference, weights=weight))
        results[metal][row] = {"mean": mean, "max": float(difference.max())}

    for (metal, row), picture in pictures.items():
        if row != "truth":
            compare(metal, row, picture, pictures[metal, "truth"])
    for metal, recipe in itertools.product(metals, RECIPES):
        pair = [pictures.get((metal, f"{recipe}, {kind}")) for kind in ("RGB", "spectral")]
        if pair[0] is not None and pair[1] is not None:
            compare(metal, f"{recipe}, RGB to spectral", *pair)
    return results


def render(variant: str, bsdf: dict[str, Any], alpha: float, spp: int, seed: int) -> Array:
    """A sphere that fills an orthographic picture, in uniform white light."""
    import mitsuba as mi

    if mi.variant() != variant:
        mi.set_variant(variant)
        mi.set_log_level(mi.LogLevel.Error)
        from fresnel_decomp.mitsuba import register

        register()
    look = mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
    scene = mi.load_dict(
        {
            "type": "scene",
            # direct light only: the sphere is convex, and every path ends in the environment
            "integrator": {"type": "path", "max_depth": 2, "hide_emitters": True},
            "sensor": {
                "type": "orthographic",
                "to_world": look,
                "film": {
                    "type": "hdrfilm",
                    "width": SIZE,
                    "height": SIZE,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                    "component_format": "float32",
                },
                "sampler": {"type": "stratified"},
            },
            # in spectral variants the colour of a light is relative to D65
            "light": {"type": "constant", "radiance": {"type": "rgb", "value": [1.0, 1.0, 1.0]}},
            "ball": {
                "type": "sphere",
                "bsdf": {**bsdf, "distribution": "ggx", "alpha": alpha},
            },
        }
    )
    return np.array(mi.render(scene, spp=spp, seed=seed), np.float64)


def rings(image: Array) -> Array:
    """(RINGS, 3) averages over pixels at one distance from the centre, up to the last whole one."""
    at = (np.arange(SIZE) + 0.5 - SIZE / 2.0) * 2.0 / SIZE
    distance = np.hypot(at[:, None], at[None, :])
    ring = np.floor(distance * (RINGS / (1.0 - 2.0 / SIZE))).astype(int)
    return np.stack([image[ring == i].mean(axis=0) for i in range(RINGS)])


def table(results: dict[str, dict[str, dict[str, float]]]) -> str:
    """Mean / largest colour difference."""
    rows = next(iter(results.values()))
    lines = [
        [row, *(f"{results[m][row]['mean']:.2f} / {results[m][row]['max']:.2f}" for m in results)]
        for row in rows
    ]
    return markdown(["ΔE00 of renders, mean / max", *results], lines)


if __name__ == "__main__":
    main(renders)

"""What four terms cost beside Schlick's two in a full-screen split-sum pass.

    python scripts/bench_gpu.py                        # on the GPU if there is one, else on LLVM
    python scripts/bench_gpu.py --page docs/speed_gpu.md --figure docs/figures/screen_pass.png

The talk measured "at most 0.05 ms" more than Schlick's decomposition, full screen at 1280 x 720 on
an RTX 2070. The pass here reads a G-buffer (normal, roughness; texture coordinates where material
textures are read), fetches the prefiltered light and the preintegrated table, and writes three
channels: `split_sum.shade` of the library, with everything in textures. With a GPU, times are in
milliseconds. A processor filters textures in software: there the script reports ratios only, which
say nothing on the talk's milliseconds.

Before the timing every pass is compared with the same picture computed in NumPy, in float64, at
all pixels; a wrong one ends the run. On a GPU that is done with filtering in software, whose
answers are exact, and again with the texture units, whose fractions have 8 bits; the latter are
timed.

All passes, and passes cut short, take turns; a ratio or a difference is the median over rounds of
what two passes took in the same round, ± half the distance between its quartiles. What lies within
that spread is undecided. Finished rounds are kept in the results: interrupt the script when you
like, the same command goes on. Rounds of another size, device, version or code have another file,
so they are neither mixed nor lost.
"""

from __future__ import annotations

import datetime
import hashlib
import inspect
import json
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.progress import Progress

from _command_line import ROOT, main, page_option, script
from _markdown import insert, marks
from _screen_pass import (
    METALS,
    PARTS,
    PASSES,
    UNIFORM,
    Materials,
    Screen,
    Shaders,
    make_materials,
    make_screen,
    reference,
)
from _screen_report import CLAIM, EXPOSURE, draw, report
from fresnel_decomp import __version__, doctor
from fresnel_decomp._check import input_error
from fresnel_decomp._files import writable_folder, write_json
from fresnel_decomp.bench.machine import graphics_card, processor, source_hash
from fresnel_decomp.images import delta_e, nrmse

OUT = ROOT / "out" / "bench_gpu"
MARKS = {kind: marks(f"full-screen pass, {kind}") for kind in ("cuda", "llvm")}
WARM_UP_S = 2.0
"""Uncounted rounds on a GPU, whose clock rises only under load."""
EXACT_RMS = 5e-5
"""Largest RMS error over the mean, in float32: it is 1e-6 to 1e-5 on a processor, where
roundings of the direction meet the edge of the sun."""
UNITS_RMS = 0.02
"""The same with texture units: 8 bits of fraction between texels of a light with a sun in it. With
coordinates rounded so in software it is 9e-4, and 2e-3 in the quick picture."""

Times = dict[str, list[float]]


@dataclass(frozen=True)
class Settings:
    """All that times and answers depend on, but for the machine."""

    variant: str
    width: int
    height: int
    recipe: str = "talk"
    texture: int = 512
    table: int = 64
    light_width: int = 256
    light_levels: int = 16


QUICK = {"width": 64, "height": 36, "texture": 32, "table": 16, "light_width": 32,
         "light_levels": 4}  # fmt: skip


# --- answers -------------------------------------------------------------------------------------


def prefiltered_city(width: int, levels: int) -> Any:
    """The prefiltered city with all maps of one size, as the layers of a texture have it."""
    from fresnel_decomp.mitsuba.prefilter import PrefilteredLight, blurred
    from fresnel_decomp.mitsuba.skies import city

    source = city(width)
    roughness = [(i / (levels - 1)) ** 2 for i in range(1, levels)]
    return PrefilteredLight("city", (source.radiance, *(blurred(source, a) for a in roughness)))


def rendered(shaders: Callable[[str], Any], name: str) -> np.ndarray:
    """(n, 3) float64: what a pass gives.

    Raises
    ------
    RuntimeError
        If a pixel is not finite.
    """
    import mitsuba as mi

    picture = np.array(mi.Color3f(*shaders(name)), np.float64).T
    bad = np.count_nonzero(~np.isfinite(picture).all(axis=1))
    if bad:
        raise RuntimeError(f"{name}: {bad} of {len(picture)} pixels are not finite")
    return picture


def relative_error(name: str, found: np.ndarray, expected: np.ndarray, limit: float) -> float:
    """RMS error over the mean.

    Raises
    ------
    RuntimeError
        If it is above the limit: what is wrong is not timed.
    """
    error = float(np.sqrt(np.mean((found - expected) ** 2)) / expected.mean())
    if not error <= limit:
        raise RuntimeError(f"{name} is off by {error:.2g} of the mean, {limit:g} are allowed")
    return error


def check(
    passes: Sequence[tuple[Callable[[str], Any], float]],
    screen: Screen,
    materials: Materials,
    light: Any,
    advance: Callable[[], object],
) -> tuple[dict[str, dict[str, Any]], dict[str, np.ndarray]]:
    """Compare every pass with NumPy; return its errors, and the pictures of the exact Fresnel too.

    `passes` are shaders with their largest allowed error, the ones that are timed last.
    """
    pictures = {}
    for kind in ("uniform", "textured"):
        pictures[f"exact, {kind}"] = reference(f"exact, {kind}", screen, materials, light)
        advance()
    errors: dict[str, dict[str, Any]] = {}
    shape = (screen.height, screen.width, 3)
    for name in PASSES:
        expected = reference(name, screen, materials, light)
        found = []
        for shaders, limit in passes:
            pictures[name] = rendered(shaders, name)
            found.append(relative_error(name, pictures[name], expected, limit))
        errors[name] = {"shader": found[0], "shader_as_timed": found[-1]}
        # (r, g) in between are those of other metals than mixtures of reflectances
        if "(r, g)" not in name:
            exact = pictures["exact, uniform" if name in UNIFORM else "exact, textured"]
            pair = [picture.reshape(shape) for picture in (exact, expected)]
            errors[name]["nrmse"] = nrmse(*pair)
            errors[name]["delta_e"] = float(delta_e(*pair, EXPOSURE).mean())
        advance()
    return errors, {name: picture.reshape(shape) for name, picture in pictures.items()}


# --- times ---------------------------------------------------------------------------------------


def measure(
    shaders: Callable[[str], Any],
    times: Times,
    rounds: int,
    repeat: int,
    finished: Callable[[], object],
    warm_up_s: float = 0.0,
) -> None:
    """Add kernel milliseconds to `times` until there are so many rounds, all passes in turn.

    Two rounds go before the first that counts: they compile. More do if two do not take
    `warm_up_s` seconds.

    Raises
    ------
    RuntimeError
        If a pass is not one kernel.
    """
    names = (*PASSES, *PARTS)
    done = len(times[names[0]])
    start = time.monotonic()
    while done < rounds and time.monotonic() - start < warm_up_s:
        for name in names:
            _milliseconds(shaders, name, repeat)
    for number in range(-2 if done < rounds else rounds, rounds - done):
        order = names[:: -1 if number % 2 else 1]
        found = {name: _milliseconds(shaders, name, repeat) for name in order}
        if number >= 0:
            for name, milliseconds in found.items():
                times[name].append(milliseconds)
            finished()


def _milliseconds(shaders: Callable[[str], Any], name: str, repeat: int) -> float:
    import drjit as dr

    from fresnel_decomp.mitsuba.timing import kernel_milliseconds

    kernels = kernel_milliseconds(lambda: dr.eval(shaders(name)), repeat)
    if len(kernels) != repeat:
        raise RuntimeError(f"{name}: {len(kernels)} kernels for {repeat} passes")
    return sum(kernels) / repeat


def about(variant: str, repeat: int) -> dict[str, Any]:
    """Machine and versions."""
    import drjit as dr

    found = doctor.report()
    if variant.startswith("cuda"):
        device = graphics_card()
    else:
        version = ".".join(map(str, dr.detail.llvm_version() or ()))
        device = f"{processor()}, {dr.thread_count()} threads, LLVM {version}"
    return {
        "device": device,
        "cpus": os.cpu_count(),
        "platform": platform.platform(),
        "versions": found.versions | {"fresnel_decomp": __version__, "numpy": np.__version__},
        "repeat": repeat,
        "sources": sources(),
        "metals": METALS,
    }


def sources() -> str:
    """A hash of what is timed and how: the package with its data, the pass, the timing.

    Texts of the report are not in it, so a page can be written again from finished rounds.
    """
    found = hashlib.sha256(source_hash().encode())
    found.update(Path(__file__).with_name("_screen_pass.py").read_bytes())
    for function in (prefiltered_city, measure, _milliseconds):
        found.update(inspect.getsource(function).encode())
    return found.hexdigest()


# --- command line --------------------------------------------------------------------------------


def results_path(folder: Path, settings: Settings, facts: Mapping[str, Any]) -> Path:
    """The file of all rounds that may be compared, and of no others."""
    same = {key: facts[key] for key in ("device", "versions", "repeat", "sources")}
    text = json.dumps([asdict(settings), same], sort_keys=True)
    label = f"{settings.variant}-{settings.width}x{settings.height}"
    if settings == Settings(settings.variant, **QUICK):
        label += "-quick"
    return folder / f"{label}-{hashlib.sha256(text.encode()).hexdigest()[:8]}.json"


def resumed(path: Path) -> tuple[Times, list[str]]:
    """Finished rounds and the day of each; none if the file is damaged."""
    names = (*PASSES, *PARTS)
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        times = {name: [float(t) for t in kept["times"][name]] for name in names}
        dates = [datetime.date.fromisoformat(day).isoformat() for day in kept["dates"]]
        if {len(values) for values in times.values()} == {len(dates)}:
            return times, dates
    except (OSError, ValueError, KeyError, TypeError):
        pass
    return {name: [] for name in names}, []


@script()
@click.option("--variant", help="cuda_ad_rgb or llvm_ad_rgb.  [default: the first that works here]")
@click.option("--rounds", default=31, show_default=True, type=click.IntRange(7))
@click.option("--width", type=click.IntRange(16), help=f"[default: {CLAIM[0]}]")
@click.option("--height", type=click.IntRange(9), help=f"[default: {CLAIM[1]}]")
@click.option("--quick", is_flag=True, help="A tiny picture, to see that everything runs.")
@click.option("--force", is_flag=True, help="Measure again what is finished.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for the results, VARIANT-SIZE-HASH.json.  [default: out/bench_gpu]",
)
@page_option(*MARKS.values())
@click.option("--figure", type=click.Path(path_type=Path), help="Also draw this picture.")
def bench(
    variant: str | None,
    rounds: int,
    width: int | None,
    height: int | None,
    quick: bool,
    force: bool,
    out: Path | None,
    page: Path | None,
    figure: Path | None,
) -> None:
    """Four terms beside Schlick's two in a full-screen split-sum pass."""
    variant = variant or doctor.best_variant()
    if variant not in ("cuda_ad_rgb", "llvm_ad_rgb"):
        raise input_error(
            f"variant '{variant}'",
            "cuda_ad_rgb or llvm_ad_rgb",
            "Scalar variants have no kernels to time; `fresnel-decomp doctor --fix` gets an LLVM.",
        )
    if quick and (width or height):
        raise input_error(
            "--quick with a size", "one of them", "The quick picture has 64 × 36 pixels."
        )
    for option, target in (("--page", page), ("--figure", figure)):
        if quick and target and target.resolve().is_relative_to(ROOT):
            raise input_error(
                f"--quick with {option} {target}", "a file outside of the repository",
                "Leave out --quick.",
            )  # fmt: skip
        if target and target.resolve().is_relative_to(ROOT):
            size = (width or CLAIM[0], height or CLAIM[1])
            if size != CLAIM:
                raise input_error(
                    f"{option} {target} with {size[0]} × {size[1]} pixels",
                    f"{CLAIM[0]} × {CLAIM[1]}, which is what the page is about",
                    "Leave out the size, or give a file outside of the repository.",
                )
    doctor.require_variant(variant)
    import mitsuba as mi

    mi.set_variant(variant)
    gpu = variant.startswith("cuda")
    settings = Settings(variant, width or CLAIM[0], height or CLAIM[1])
    if quick:
        settings = Settings(variant, **QUICK)
    repeat = 20 if gpu else 1
    facts = about(variant, repeat)
    path = results_path(writable_folder(out or OUT), settings, facts)
    times, dates = resumed(path)
    if force:
        times, dates = {name: [] for name in times}, []
    kept = len(times[PASSES[0]])
    if kept:
        click.echo(f"{kept} rounds are finished.", err=True)

    with Progress(console=Console(stderr=True), transient=True) as progress:
        steps = 1 + 2 + len(PASSES) + max(0, rounds - kept)
        task = progress.add_task("baking", total=steps)
        screen = make_screen(settings.width, settings.height)
        materials = make_materials(settings.recipe, settings.texture, settings.table)
        light = prefiltered_city(settings.light_width, settings.light_levels)
        progress.update(task, advance=1, description="checking")
        shaders = Shaders(screen, materials, light, use_accel=gpu)
        passes: list[tuple[Callable[[str], Any], float]] = [(shaders, EXACT_RMS)]
        if gpu:
            passes = [(Shaders(screen, materials, light), EXACT_RMS), (shaders, UNITS_RMS)]
        errors, pictures = check(passes, screen, materials, light, lambda: progress.advance(task))
        results = {
            "settings": asdict(settings),
            "about": facts,
            "errors": errors,
            "times": times,
            "dates": dates,
        }

        def finished() -> None:
            dates.append(datetime.date.today().isoformat())
            write_json(path, results)
            progress.advance(task)

        progress.update(task, description="timing")
        measure(shaders, times, rounds, repeat, finished, WARM_UP_S if gpu else 0.0)
    write_json(path, results)
    click.echo(report(results))
    if page:
        insert(page, report(results), MARKS["cuda" if gpu else "llvm"])
        click.echo(f"Wrote {page}", err=True)
    if figure:
        draw(pictures, figure)
        click.echo(f"Wrote {figure}", err=True)


if __name__ == "__main__":
    main(bench, interrupted="Interrupted. The same command goes on from finished rounds.")

"""One seed, one result: every seeded function, and nothing random without a seed."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import os
import pkgutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fresnel_decomp
from fresnel_decomp import Schlick

SOURCES = Path(fresnel_decomp.__file__).parent

GOLD = Schlick(0.8)
MU, ALPHA = np.linspace(0.1, 1.0, 4), np.linspace(0.1, 0.9, 4)


def monte_carlo(seed: int) -> Any:
    from fresnel_decomp.albedo_estimates import monte_carlo_albedo

    return monte_carlo_albedo(GOLD, MU, ALPHA, 64, seed=seed)


def quasi_monte_carlo(seed: int) -> Any:
    from fresnel_decomp.albedo_estimates import quasi_monte_carlo_albedo

    return quasi_monte_carlo_albedo(GOLD, MU, ALPHA, 64, seed=seed)


def random_walk(seed: int) -> Any:
    from fresnel_decomp.random_walk import random_walk_albedo

    return random_walk_albedo(GOLD, 0.3, 0.5, 256, seed=seed)


def bsdf() -> dict[str, Any]:
    from fresnel_decomp.mitsuba.comparison import conductor_bsdf

    return conductor_bsdf(0.2, 3.0, alpha=0.2)


def scene(seed: int) -> Any:
    from fresnel_decomp.mitsuba.comparison import render_scene
    from fresnel_decomp.mitsuba.scenes import load_scene

    return render_scene(load_scene("studio", bsdf(), 12), 4, seed)


def bsdfs(seed: int) -> Any:
    from fresnel_decomp.mitsuba.comparison import render_bsdfs

    return render_bsdfs({"one": bsdf()}, size=12, spp=4, seed=seed)["one"]


def surface(seed: int) -> Any:
    from fresnel_decomp.mitsuba.scenes import load_scene
    from fresnel_decomp.mitsuba.visible_surface import visible_surface

    found = visible_surface(load_scene("studio", bsdf(), 8), 4, seed)
    return [np.array(found.normal), np.array(found.view)]


def workload_picture(seed: int) -> Any:
    from fresnel_decomp.mitsuba.workloads import picture

    return picture(bsdf(), 12, 4, seed)()


SEEDED: dict[str, Callable[[int], Any]] = {
    "albedo_estimates.monte_carlo_albedo": monte_carlo,
    "albedo_estimates.quasi_monte_carlo_albedo": quasi_monte_carlo,
    "mitsuba.comparison.render_bsdfs": bsdfs,
    "mitsuba.comparison.render_scene": scene,
    "mitsuba.visible_surface.visible_surface": surface,
    "mitsuba.workloads.picture": workload_picture,
    "random_walk.random_walk_albedo": random_walk,
}
"""A call for every public function with a seed, and what comes of it."""

RECOVER = "hands its seed to `mi.render`; test_inverse tries `recover` and `recover_texture` twice"

ELSEWHERE = {
    "mitsuba.inverse.recovery.recover": RECOVER,
    "mitsuba.inverse.gradient.descend": RECOVER,
    "mitsuba.inverse.gradient.loss_and_gradient": RECOVER,
    "mitsuba.inverse.images.Images.derivative": RECOVER,
    "mitsuba.inverse.images.Images.render": RECOVER,
    "mitsuba.inverse.images.Images.roughness_derivative": RECOVER,
    "mitsuba.inverse.images.derived_seed": RECOVER,
    "mitsuba.inverse.images.half_seed": RECOVER,
    "mitsuba.inverse.calibration.calibrate": RECOVER,
    "mitsuba.inverse.linear.linearise": RECOVER,
    "mitsuba.inverse.roughness.refine_roughness": RECOVER,
    "mitsuba.inverse.roughness.search_roughness": RECOVER,
    "mitsuba.inverse.linear.solve_images": RECOVER,
    "mitsuba.inverse.texture.recover_texture": RECOVER,
    "mitsuba.inverse.texture.texel_shares": RECOVER,
    "bench.candidates.check_picture": "compares with an answer; test_speed_vs_error tries it",
    "mitsuba.comparison.render_passes": "what render_scene hands to Mitsuba; test_inverse compares",
    "mitsuba.timing.kernel_times": "what it returns are times; it renders with render_bsdfs' seeds",
    "mitsuba.workloads.Picture": "what `picture` returns",
    "mitsuba.workloads.directions": "only for variants with arrays; test_timing tries it",
    "mitsuba.workloads.random_cosines": "only for variants with arrays; test_timing tries it",
    "bench.run.Settings": "hands its seed to the workloads",
    "report.comparison.Settings": "hands its seed to render_bsdfs; test_cli runs it",
}

PLAIN = [name for name in SEEDED if not name.startswith("mitsuba")]


def seeded_names() -> set[str]:
    """Public functions and classes of the package that take a seed."""
    import mitsuba as mi

    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    found = set()
    for module in pkgutil.walk_packages(fresnel_decomp.__path__, "fresnel_decomp."):
        if module.name.endswith("__main__"):
            continue
        home = importlib.import_module(module.name)
        for name in getattr(home, "__all__", ()):
            value = getattr(home, name)
            if getattr(value, "__module__", None) == module.name and callable(value):
                callables = {name: value}
                if inspect.isclass(value):
                    callables |= {f"{name}.{n}": m for n, m in inspect.getmembers(value, callable)
                                  if not n.startswith("__")}  # fmt: skip
                for called, member in callables.items():
                    try:
                        parameters = inspect.signature(member).parameters
                    except (TypeError, ValueError):
                        continue
                    if "seed" in parameters:
                        found.add(f"{module.name.removeprefix('fresnel_decomp.')}.{called}")
    return found


def test_all_seeded_functions_are_known() -> None:
    """A new one belongs into SEEDED, where it is tried, or into ELSEWHERE with a reason."""
    assert seeded_names() == {*SEEDED, *ELSEWHERE}


def numbers(result: Any) -> list[Any]:
    return [np.asarray(part, np.float64).tolist() for part in result]


@pytest.mark.parametrize("name", SEEDED)
def test_same_seed_same_numbers(name: str, variant: str) -> None:
    if name in PLAIN and not variant.startswith("scalar"):
        pytest.skip("needs no variant")
    call = SEEDED[name]
    first, again, other = (
        np.concatenate([np.ravel(part) for part in numbers(call(seed))]) for seed in (3, 3, 4)
    )
    if name not in PLAIN:  # threads add to a picture in the order in which they finish
        np.testing.assert_allclose(again, first, rtol=1e-5)
        assert np.abs(other - first).max() > 1e-3
    else:
        assert (again == first).all()
        assert (other != first).any()


@pytest.mark.slow
@pytest.mark.parametrize("name", PLAIN)
def test_same_numbers_in_another_process(name: str) -> None:
    """Where the hashes of strings, and with them the order of sets, are others."""
    code = (
        f"import sys, json; sys.path.insert(0, {str(Path(__file__).parent)!r}); "
        f"import test_determinism as t; print(json.dumps(t.numbers(t.SEEDED[{name!r}](3))))"
    )
    runs = [
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True,
            env={**os.environ, "PYTHONHASHSEED": str(seed)},
        ).stdout
        for seed in (1, 2)
    ]  # fmt: skip
    assert json.loads(runs[0]) == json.loads(runs[1]) == numbers(SEEDED[name](3))


MODULES = sorted(SOURCES.rglob("*.py"))
SEEDS = {"default_rng": 0, "SeedSequence": 0, "RandomState": 0, "Sobol": {"seed", "rng"},
         "Halton": {"seed", "rng"}}  # fmt: skip
"""Where generators take the seed: as the first argument, or by one of these names."""


def test_generators_are_given_their_seed() -> None:
    """None starts from the clock, and nothing draws from the global generators."""
    seen = 0
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            where = f"{path.relative_to(SOURCES)}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.Import):
                assert not {"random", "secrets"} & {alias.name for alias in node.names}, where
            if not isinstance(node, ast.Call):
                continue
            name = ast.unparse(node.func)
            last = name.rpartition(".")[2]
            if last in SEEDS:
                seen += 1
                wanted = SEEDS[last]
                named = {keyword.arg for keyword in node.keywords}
                assert node.args if wanted == 0 else named & wanted, where
            elif name.startswith(("np.random.", "numpy.random.")):
                assert "(" in name, where  # a method of a generator made in the same breath
    assert seen >= 6

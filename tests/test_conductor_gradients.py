"""Derivatives through the BSDF plugin: forward, reverse and finite differences agree."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from fresnel_decomp.mitsuba import register

LLVM_RGB = pytest.mark.parametrize("variant", ["llvm_ad_rgb"], indirect=True)
STEP = 1e-2


@pytest.fixture(autouse=True)
def _registered(variant: str) -> None:
    """Every test runs in a variant that knows the plugin, and without Mitsuba's log."""
    mi.set_log_level(mi.LogLevel.Error)
    register()


def colour(*value: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(value)}


def bitmap(low: float, high: float, channels: int = 3) -> dict[str, Any]:
    texels = np.random.default_rng(0).uniform(low, high, (4, 4, channels)).astype(np.float32)
    return {"type": "bitmap", "raw": True, "data": mi.TensorXf(texels)}


#: Plugin parameters by name, made afresh (Mitsuba empties tensors), and what to differentiate.
CASES: dict[str, tuple[Callable[[], dict[str, Any]], tuple[str, ...]]] = {
    "indices": (
        lambda: {"eta": colour(0.2, 1.2, 2.0), "k": colour(3.0, 2.0, 1.5)},
        ("eta.value", "k.value"),
    ),
    "bitmap": (lambda: {"eta": bitmap(0.5, 2.0), "k": 2.0}, ("eta.data", "k.value")),
    "checkerboard": (
        lambda: {"eta": {"type": "checkerboard", "color0": 1.5, "color1": 0.4}, "k": 2.0},
        ("eta.color0.value", "eta.color1.value", "k.value"),
    ),
    "gulbrandsen": (lambda: {"r": 0.6, "g": colour(0.2, 0.5, 0.8)}, ("r.value", "g.value")),
    "node colours": (
        lambda: {"f0": colour(0.5, 0.6, 0.7), "f1": 0.75, "f2": 0.6},
        ("f0.value", "f1.value", "f2.value"),
    ),
    "coefficients": (
        lambda: {"c0": 0.4, "c1": 0.6, "c2": bitmap(-0.3, 0.3), "c3": colour(0.1, -0.1, 0.02)},
        ("c0.value", "c1.value", "c2.data", "c3.value"),
    ),
}
FRESNEL = {"indices": ("exact", "schlick", "f82", "decomposition")}
RUNS = [
    (case, fresnel, key)
    for case, (_, keys) in CASES.items()
    for fresnel in FRESNEL.get(case, ("decomposition",))
    for key in keys
]
RENDERS = [
    pytest.param(*run, marks=() if run[1] == "decomposition" else pytest.mark.slow) for run in RUNS
]


def derivatives(params: Any, key: str, result: Callable[[bool], Any]) -> tuple[float, float, float]:
    """Directional derivative of the sum of `result`: differences, reverse and forward mode.

    `result(True)` has derivatives attached, `result(False)` is evaluated for the differences.
    """
    start = type(params[key])(params[key])
    weights = np.random.default_rng(1).uniform(0.2, 1.0, np.array(start).shape).astype(np.float32)
    direction = type(start)(weights if weights.size > 3 else weights.ravel().tolist())

    def put(value: Any) -> None:
        params[key] = value
        params.update()

    totals = []
    for step in (STEP, -STEP):
        put(start + step * direction)
        totals.append(np.array(result(False), float).sum())
    difference = (totals[0] - totals[1]) / (2.0 * STEP)

    value = type(start)(start)
    dr.enable_grad(value)
    put(value)
    dr.backward(dr.sum(result(True), axis=None))
    reverse = float(np.sum(np.array(dr.grad(value), float).ravel() * weights.ravel()))

    t = mi.Float(0.0)
    dr.enable_grad(t)
    put(start + t * direction)
    image = result(True)
    dr.forward(t)
    forward = float(np.array(dr.grad(image), float).sum())
    put(start)
    return difference, reverse, forward


def assert_agree(values: tuple[float, float, float], rtol: float = 1e-3) -> None:
    difference, reverse, forward = values
    assert abs(difference) > 1e-3
    assert reverse == pytest.approx(difference, rel=rtol)
    assert forward == pytest.approx(reverse, rel=1e-4)


def eval_result(plugin: Any, n: int = 4096) -> Callable[[bool], Any]:
    """Evaluates the plugin on fixed directions over the whole surface."""
    rng = np.random.default_rng(2)
    wi, wo = (
        mi.warp.square_to_cosine_hemisphere(mi.Point2f(rng.uniform(size=(2, n)).astype("f4")))
        for _ in range(2)
    )
    si = dr.zeros(mi.SurfaceInteraction3f, n)
    si.wi, si.uv = wi, mi.Point2f(rng.uniform(size=(2, n)).astype("f4"))
    return lambda attached: plugin.eval(mi.BSDFContext(), si, wo)


PRB = {"type": "prb", "max_depth": 3, "rr_depth": 10}


def scene_with(bsdf: dict[str, Any], integrator: dict[str, Any] = PRB) -> Any:
    look = mi.ScalarTransform4f().look_at
    film = {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": integrator,
            "sensor": {
                "type": "perspective",
                "to_world": look([0, -4, 2], [0, 0, 0], [0, 0, 1]),
                "film": film,
            },
            "floor": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().scale(2),
                "bsdf": bsdf,
            },
            "ball": {"type": "sphere", "radius": 0.6, "center": [0, 0, 0.6]},
            "sky": {"type": "constant"},
        }
    )


def render_result(scene: Any, params: Any) -> Callable[[bool], Any]:
    """Renders; the derivative pass has the random numbers of the detached renders."""

    def result(attached: bool) -> Any:
        if attached:
            return mi.render(scene, params, spp=16, seed=2, seed_grad=1)
        return mi.render(scene, spp=16, seed=1)

    return result


COMPENSATED: dict[str, dict[str, Any]] = {
    "single": {},
    "lobe": {"energy_compensation": True},
    "scaling": {"energy_compensation": True, "compensation": "scaling"},
}
EVALS = [
    pytest.param(
        kind, *run, marks=pytest.mark.slow if run[0] != "indices" and kind != "single" else ()
    )
    for kind in COMPENSATED
    for run in RUNS
]


@LLVM_RGB
@pytest.mark.parametrize(("kind", "case", "fresnel", "key"), EVALS)
def test_derivatives_of_eval(kind: str, case: str, fresnel: str, key: str, variant: str) -> None:
    parameters = {"type": "decomposed_conductor", "fresnel": fresnel, "alpha": 0.5}
    parameters |= COMPENSATED[kind]
    plugin = mi.load_dict(parameters | CASES[case][0]())
    assert_agree(derivatives(mi.traverse(plugin), key, eval_result(plugin)))


COMPENSATED_RENDERS = [
    pytest.param(kind, *run, marks=pytest.mark.slow) for kind in ("lobe", "scaling") for run in RUNS
]


@LLVM_RGB
@pytest.mark.parametrize(
    ("kind", "case", "fresnel", "key"),
    [pytest.param("single", *run.values, marks=run.marks) for run in RENDERS] + COMPENSATED_RENDERS,
)
def test_derivatives_of_renders(kind: str, case: str, fresnel: str, key: str, variant: str) -> None:
    parameters = {"type": "decomposed_conductor", "fresnel": fresnel, "alpha": 0.3}
    parameters |= COMPENSATED[kind]
    scene = scene_with(parameters | CASES[case][0]())
    params = mi.traverse(scene)
    found = [name for name in params.keys() if name.endswith(".bsdf." + key)]  # noqa: SIM118
    assert_agree(derivatives(params, found[0], render_result(scene, params)))


@LLVM_RGB
@pytest.mark.parametrize("kind", COMPENSATED)
@pytest.mark.parametrize("key", ["alpha_u.value", "alpha_v.value", "specular_reflectance.value"])
def test_derivatives_of_eval_by_shape(key: str, kind: str, variant: str) -> None:
    shape = {"alpha_u": 0.4, "alpha_v": 0.6, "specular_reflectance": 0.5, "distribution": "ggx"}
    shape |= COMPENSATED[kind]
    plugin = mi.load_dict({"type": "decomposed_conductor", "eta": 1.5, "k": 2.0, **shape})
    # the slope of a grid of albedos is that of a chord between noisy sums: .002 off
    rtol = 5e-3 if kind != "single" else 1e-3
    assert_agree(derivatives(mi.traverse(plugin), key, eval_result(plugin)), rtol)


@LLVM_RGB
def test_derivative_of_renders_by_roughness_is_the_built_in_one(variant: str) -> None:
    """Sampling depends on roughness, which prb detaches: compared with the built-in plugin."""

    def gradient(plugin: dict[str, Any]) -> float:
        scene = scene_with({**plugin, "material": "Be", "alpha": 0.3})
        params = mi.traverse(scene)
        key = next(name for name in params.keys() if name.endswith("alpha.value"))  # noqa: SIM118
        dr.enable_grad(params[key])
        params.update()
        dr.backward(dr.sum(mi.render(scene, params, spp=16, seed=2), axis=None))
        return float(dr.grad(params[key])[0])

    exact = gradient({"type": "decomposed_conductor", "fresnel": "exact"})
    assert exact == pytest.approx(gradient({"type": "roughconductor"}), rel=1e-5)
    assert gradient({"type": "decomposed_conductor"}) == pytest.approx(exact, rel=0.05)


@pytest.mark.parametrize("variant", ["llvm_ad_spectral"], indirect=True)
def test_derivatives_reach_measured_spectra(variant: str) -> None:
    plugin = mi.load_dict({"type": "decomposed_conductor", "material": "Au", "alpha": 0.5})
    params = mi.traverse(plugin)
    n = 4096
    rng = np.random.default_rng(3)
    si = dr.zeros(mi.SurfaceInteraction3f, n)
    si.wi, wo = (
        mi.warp.square_to_cosine_hemisphere(mi.Point2f(rng.uniform(size=(2, n)).astype("f4")))
        for _ in range(2)
    )
    si.wavelengths = type(si.wavelengths)(
        *(mi.Float(rng.uniform(400, 700, n).astype("f4")) for _ in range(4))
    )
    for key in ("eta.values", "k.values"):
        values = derivatives(params, key, lambda attached: plugin.eval(mi.BSDFContext(), si, wo))
        assert_agree(values)

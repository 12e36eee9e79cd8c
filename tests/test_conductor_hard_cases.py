"""The plugin at the horizon, at the mirror, looking back, and for the extremes of roughness."""

from __future__ import annotations

import itertools
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from fresnel_decomp.mitsuba import register

LLVM_RGB = pytest.mark.parametrize("variant", ["llvm_ad_rgb"], indirect=True)

HEIGHTS = [1.0, 0.5, 1e-3, 1e-7, 1e-20, 1e-38, 0.0, -0.0, -1e-20, -0.5]
AZIMUTHS = [0.0, np.pi, 1.0]  # of wo: looking back, the mirror's side, elsewhere


def direction(height: float, azimuth: float) -> list[float]:
    s = np.sqrt(1.0 - height * height)
    return [float(s * np.cos(azimuth)), float(s * np.sin(azimuth)), height]


PAIRS = list(itertools.product(HEIGHTS, HEIGHTS, AZIMUTHS))
WI = np.array([direction(i, 0.0) for i, _, _ in PAIRS], np.float32)
WO = np.array([direction(o, azimuth) for _, o, azimuth in PAIRS], np.float32)
EDGES = np.array(list(itertools.product([0.0, 0.5, 1.0 - 2.0**-24], repeat=2)), np.float32)
INSIDE = np.clip(EDGES, 0.02, 0.97)
SHAPES = list(itertools.product(["ggx", "beckmann"], [True, False]))


@pytest.fixture(autouse=True)
def _registered(variant: str) -> None:
    """Every test runs in a variant that knows the plugin, and without Mitsuba's log."""
    mi.set_log_level(mi.LogLevel.Error)
    register()


def load(shape: tuple[str, bool], alpha: float, **parameters: Any) -> Any:
    distribution, visible = shape
    plugin = {"type": "decomposed_conductor", "alpha": alpha, "distribution": distribution}
    return mi.load_dict({**plugin, "sample_visible": visible, **parameters})


COEFFICIENTS = {"c0": 0.5, "c1": 0.5, "c2": -0.1, "c3": 0.05}
INDICES = {"eta": 0.2, "k": 3.0, "fresnel": "exact"}


def results(plugin: Any, method: str, u: np.ndarray) -> list[Any]:
    """Everything that a method returns, for all pairs of directions (and all of `u`)."""
    ctx = mi.BSDFContext()
    if method == "sample":
        wi, u = np.repeat(WI, len(u), axis=0), np.tile(u, (len(WI), 1))
        si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
        si.wi = mi.Vector3f(wi.T)
        # a third of the samples goes to the lobe where it has any chance
        choice = np.resize([0.0, 0.5, 1.0 - 2.0**-24], len(wi)).astype(np.float32)
        bs, weight = plugin.sample(ctx, si, mi.Float(choice), mi.Point2f(u.T))
        return [weight, bs.pdf, bs.wo]
    si = dr.zeros(mi.SurfaceInteraction3f, len(WI))
    si.wi = mi.Vector3f(WI.T)
    found = getattr(plugin, method)(ctx, si, mi.Vector3f(WO.T))
    return list(found) if isinstance(found, tuple) else [found]


METHODS = ["eval", "pdf", "eval_pdf", "sample"]
LOBE = {"energy_compensation": True}
SCALING = {"energy_compensation": True, "compensation": "scaling", "smith": "correlated"}
COMPENSATIONS = pytest.mark.parametrize(
    "compensation", [{}, LOBE, SCALING], ids=["single", "lobe", "scaling"]
)


@LLVM_RGB
@pytest.mark.parametrize("parameters", [COEFFICIENTS, INDICES], ids=["fitted", "exact"])
@COMPENSATIONS
@pytest.mark.parametrize("shape", SHAPES)
def test_values_are_finite_and_one_sided(shape, compensation, parameters, variant: str) -> None:
    for alpha in (1e-4, 1e-2, 0.3, 1.0):
        plugin = load(shape, alpha, **parameters, **compensation)
        found = {method: results(plugin, method, EDGES) for method in METHODS}
        for method, values in found.items():
            for i, value in enumerate(values):
                array = np.array(value)
                assert np.isfinite(array).all(), (method, i, alpha)
                if not (method == "sample" and i == 2):
                    assert (array >= 0.0).all(), (method, i, alpha)
        np.testing.assert_array_equal(found["eval"][0], found["eval_pdf"][0])
        np.testing.assert_array_equal(found["pdf"][0], found["eval_pdf"][1])
        below = (WI[:, 2] <= 0.0) | (WO[:, 2] <= 0.0)
        assert not np.array(found["eval"][0])[:, below].any()
        assert not np.array(found["pdf"][0])[below].any()
        weight, pdf, wo = (np.array(value) for value in found["sample"])
        below = np.repeat(WI[:, 2] <= 0.0, len(EDGES))
        assert not weight[:, below].any()
        assert not pdf[below].any()
        np.testing.assert_allclose(np.linalg.norm(wo, axis=0)[pdf > 0.0], 1.0, atol=1e-4)


@COMPENSATIONS
def test_a_scalar_horizon_is_finite_too(compensation, variant: str) -> None:
    si, ctx = dr.zeros(mi.SurfaceInteraction3f), mi.BSDFContext()
    for shape in SHAPES:
        plugin = load(shape, 0.1, **COEFFICIENTS, **compensation)
        for height in (0.0, 1e-20, 1e-7):
            si.wi = mi.Vector3f(direction(height, 0.0))
            values = [
                plugin.eval(ctx, si, mi.Vector3f(0.6, 0.0, 0.8)),
                plugin.pdf(ctx, si, mi.Vector3f(0.6, 0.0, 0.8)),
            ]
            bs, weight = plugin.sample(ctx, si, 0.5, mi.Point2f(0.3, 0.7))
            for value in (*values, weight, bs.pdf, bs.wo):
                assert np.isfinite(np.array(value)).all()


@LLVM_RGB
@pytest.mark.parametrize("mode", ["forward", "backward"])
@pytest.mark.parametrize(
    ("shape", "compensation"),
    [(shape, {}) for shape in SHAPES]
    + [
        pytest.param(shape, kind, marks=() if shape == ("ggx", True) else pytest.mark.slow)
        for shape in SHAPES
        for kind in (LOBE, SCALING)
    ],
    ids=lambda value: (
        value.get("compensation", "lobe" if value else "single")
        if isinstance(value, dict)
        else f"{value[0]}-{value[1]}"
    ),
)
def test_derivatives_are_finite(shape, compensation, mode: str, variant: str) -> None:
    cases = [("alpha.value", COEFFICIENTS), ("c2.value", COEFFICIENTS), ("k.value", INDICES)]
    for alpha, (key, parameters) in itertools.product((1e-4, 1e-2, 1.0), cases):
        for method in METHODS:
            if method == "sample" and (key, alpha) == ("alpha.value", 1e-4):
                continue  # normals that round to the surface's, see the class' notes
            # one derivative at a time: a fresh graph for each result
            for i in range({"sample": 3, "eval_pdf": 2}.get(method, 1)):
                plugin = load(shape, alpha, **parameters, **compensation)
                params = mi.traverse(plugin)
                value = type(params[key])(params[key])
                dr.enable_grad(value)
                params[key] = value
                params.update()
                u = INSIDE if key == "alpha.value" else EDGES
                result = results(plugin, method, u)[i]
                if not dr.grad_enabled(result):
                    continue
                if mode == "forward":
                    dr.forward(value)
                    gradient = np.array(dr.grad(result))
                else:
                    dr.backward(result)
                    gradient = np.array(dr.grad(value))
                assert np.isfinite(gradient).all(), (key, method, i, alpha)


@LLVM_RGB
@COMPENSATIONS
@pytest.mark.parametrize("shape", SHAPES)
def test_the_limit_at_the_horizon(shape, compensation, variant: str) -> None:
    """D G / (4 cos) tends to a constant, and keeps it down to the last representable cosine.

    With correlated shadowing it is reached later: 1e-4 is missing at a cosine of 1e-5.
    """
    plugin, ctx = load(shape, 0.3, **COEFFICIENTS, **compensation), mi.BSDFContext()
    heights = [1e-6, 1e-7, 1e-10, 1e-13, 1e-20, 1e-37]
    si = dr.zeros(mi.SurfaceInteraction3f, len(heights))
    si.wi = mi.Vector3f(np.array([direction(h, 0.0) for h in heights], np.float32).T)
    wo = mi.Vector3f(-0.8, 0.0, 0.6)
    for value in (plugin.eval(ctx, si, wo)[0], plugin.pdf(ctx, si, wo)):
        array = np.array(value)
        assert array[0] > 0.0
        if shape[1] or value is not array:
            np.testing.assert_allclose(array, array[0], rtol=1e-4)


@LLVM_RGB
def test_looking_back_at_the_light(variant: str) -> None:
    """wi = wo: the half vector is the direction itself, the Fresnel term that of cos = 1."""
    ctx, alpha = mi.BSDFContext(), 0.3
    heights = np.array([1.0, 0.9, 0.5, 0.1])
    si = dr.zeros(mi.SurfaceInteraction3f, len(heights))
    wi = np.array([direction(h, 0.0) for h in heights], np.float32).T
    si.wi = mi.Vector3f(wi)
    found = np.array(load(("ggx", True), alpha, **COEFFICIENTS).eval(ctx, si, mi.Vector3f(wi)))
    a2 = alpha * alpha
    d = a2 / (np.pi * (heights**2 * (a2 - 1.0) + 1.0) ** 2)
    tan2 = 1.0 / heights**2 - 1.0
    g1 = 2.0 / (1.0 + np.sqrt(1.0 + a2 * tan2))
    expected = 0.5 * d * g1 * g1 / (4.0 * heights)
    np.testing.assert_allclose(found[0], expected, rtol=1e-5)

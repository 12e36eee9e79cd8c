"""The principled BSDF where the conductor is tested too: horizon, mirror, hostile images, ends."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from fresnel_decomp import directional_albedo
from fresnel_decomp.mitsuba import register
from fresnel_decomp.parametrization import F82_COSINE
from test_conductor import FRESNEL, LLVM_RGB, NAN, bitmap, directions, evaluate, only
from test_conductor_gradients import scene_with
from test_conductor_hard_cases import direction
from test_principled import ANGLES, COPPER, MIXED, ROUGHNESS, albedo, principled


@pytest.fixture(autouse=True)
def _registered(variant: str) -> None:
    """Every test runs in a variant that knows the plugin, and without Mitsuba's log."""
    mi.set_log_level(mi.LogLevel.Error)
    register()


@only("fresnel", FRESNEL)
def test_a_scalar_horizon_is_finite_too(fresnel: str, variant: str) -> None:
    si, ctx = dr.zeros(mi.SurfaceInteraction3f), mi.BSDFContext()
    for distribution in ("ggx", "beckmann"):
        plugin = principled(**MIXED, fresnel=fresnel, distribution=distribution)
        for height in (0.0, 1e-20, 1e-7):
            si.wi = mi.Vector3f(direction(height, 0.0))
            wo = mi.Vector3f(0.6, 0.0, 0.8)
            values = [plugin.eval(ctx, si, wo), plugin.pdf(ctx, si, wo)]
            for choice in (0.01, 0.99):
                bs, weight = plugin.sample(ctx, si, choice, mi.Point2f(0.3, 0.7))
                values += [weight, bs.pdf, bs.wo]
            for value in values:
                assert np.isfinite(np.array(value)).all()


@LLVM_RGB
@only("fresnel", FRESNEL)
def test_the_limit_at_the_horizon(fresnel: str, variant: str) -> None:
    """Lobe and density tend to constants, down to the last representable cosine."""
    plugin, ctx = principled(**MIXED, fresnel=fresnel), mi.BSDFContext()
    heights = [1e-5, 1e-7, 1e-10, 1e-13, 1e-20, 1e-37]
    si = dr.zeros(mi.SurfaceInteraction3f, len(heights))
    si.wi = mi.Vector3f(np.array([direction(h, 0.0) for h in heights], np.float32).T)
    wo = mi.Vector3f(-0.8, 0.0, 0.6)
    for value in (plugin.eval(ctx, si, wo)[0], plugin.pdf(ctx, si, wo)):
        array = np.array(value)
        assert array[0] > 0.0
        # albedos are interpolated in the square root of the cosine: still rising by 1e-3
        np.testing.assert_allclose(array, array[-1], rtol=1e-2)
        np.testing.assert_allclose(array[2:], array[-1], rtol=1e-4)


@LLVM_RGB
@only("fresnel", FRESNEL)
def test_looking_back_at_the_light(fresnel: str, variant: str) -> None:
    """wi = wo: the half vector is the direction itself, the Fresnel term of a metal its F0."""
    heights, alpha = np.array([1.0, 0.9, 0.5, 0.1]), ROUGHNESS**2
    w = np.array([direction(h, 0.0) for h in heights], np.float32)
    plugin = principled(base_color=COPPER, metallic=1.0, fresnel=fresnel)
    a2 = alpha * alpha
    d = a2 / (np.pi * (heights**2 * (a2 - 1.0) + 1.0) ** 2)
    g1 = 2.0 / (1.0 + np.sqrt(1.0 + a2 * (1.0 / heights**2 - 1.0)))
    expected = np.outer(d * g1 * g1 / (4.0 * heights), [0.85, 0.55, 0.25])
    np.testing.assert_allclose(evaluate(plugin, w, w), expected, rtol=2e-5)


@only("fresnel", FRESNEL)
@only("name", ["base_color", "metallic", "roughness", "dielectric_f0"])
def test_bad_texels_are_refused(name: str, fresnel: str, variant: str) -> None:
    texels = np.full((3, 3, 1), 0.5)
    texels[1, 2] = -0.5
    board = {"type": "checkerboard", "color0": 0.5, "color1": bitmap(texels)()}
    for texture in (bitmap(texels), board):
        with pytest.raises(RuntimeError, match=f"'{name}' with values from -0.5 to 0.5"):
            principled(fresnel=fresnel, **{name: texture})
    texels[1, 2] = NAN
    with pytest.raises(RuntimeError, match=f"'{name}' with 1 of 9 values"):
        principled(fresnel=fresnel, **{name: bitmap(texels)})


@only("storage", ["variant", "fp16", "auto"])
def test_8_bit_images(storage: str, variant: str) -> None:
    def texture(value: int) -> dict[str, Any]:
        texels = mi.Bitmap(np.full((2, 2, 1), value, np.uint8))
        return {"type": "bitmap", "raw": True, "bitmap": texels, "format": storage}

    wi, wo = directions(6)
    for name in ("base_color", "metallic", "roughness", "dielectric_f0"):
        for value in (128, 255) if name != "dielectric_f0" else (10, 128):
            got = evaluate(principled(**{**MIXED, name: texture(value)}), wi, wo)
            expected = evaluate(principled(**{**MIXED, name: value / 255}), wi, wo)
            # half floats are off by up to 2^-11 of their value, and the lobe goes with alpha^-2
            np.testing.assert_allclose(got, expected, rtol=1e-2 if storage == "fp16" else 1e-4)
    with pytest.raises(RuntimeError, match="dielectric_f0"):
        principled(dielectric_f0=texture(255))


@only("wrap_mode", ["repeat", "mirror", "clamp"])
@only("filter_type", ["bilinear", "nearest"])
@LLVM_RGB
def test_what_is_stored_of_the_dielectric_follows_its_image(
    filter_type: str, wrap_mode: str, variant: str
) -> None:
    """Inside texels and beyond the edges, where stored terms are texels and not interpolated."""
    texels = np.random.default_rng(3).uniform(0.02, 0.3, (3, 4, 1))
    image = bitmap(texels, filter_type=filter_type, wrap_mode=wrap_mode)
    plugin, (wi, wo) = principled(base_color=0.2, dielectric_f0=image), directions(3)
    texture = mi.load_dict(image())
    # the centre of a texel, inside and one image to the right
    for uv in ((0.125, 0.5), (1.375, 0.5), (0.625, -0.5)):
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.uv = mi.Point2f(*uv)
        f0 = float(np.array(texture.eval_1(si)).ravel()[0])
        expected = evaluate(principled(base_color=0.2, dielectric_f0=f0), wi, wo)
        np.testing.assert_allclose(evaluate(plugin, wi, wo, uv=uv), expected, rtol=2e-4)


@LLVM_RGB
def test_metals_with_edges_give_the_albedo_of_their_curve(variant: str) -> None:
    """White at normal incidence and .7 at 82°, against quadrature of the curve as it is shaded."""
    from fresnel_decomp import load_basis
    from fresnel_decomp.metallic import metal_coefficients, metal_reflectance

    basis = load_basis()
    base, edge = np.array([1.0]), np.array([0.7])
    curve = metal_coefficients(base, edge, basis)
    assert float(basis.evaluate(curve, F82_COSINE)[0]) == pytest.approx(0.7, abs=0.02)
    assert float(metal_reflectance(base, edge, F82_COSINE)[0]) == pytest.approx(0.7, abs=1e-6)
    plugin = principled(base_color=1.0, metallic=1.0, edge_color=0.7)
    for wi in ANGLES[:3]:
        expected = directional_albedo(
            lambda c: basis.evaluate(curve, np.asarray(c)[..., None]), wi[2], ROUGHNESS**2
        )
        np.testing.assert_allclose(albedo(plugin, wi), float(np.ravel(expected)[0]), atol=4e-3)


@LLVM_RGB
def test_derivative_of_renders_by_roughness_is_the_conductors(variant: str) -> None:
    """Sampling depends on roughness, which prb detaches: compared with the other plugin."""

    def gradient(plugin: dict[str, Any], name: str) -> float:
        scene = scene_with(plugin)
        params = mi.traverse(scene)
        key = next(k for k in params.keys() if k.endswith(f"{name}.value"))  # noqa: SIM118
        dr.enable_grad(params[key])
        params.update()
        dr.backward(dr.sum(mi.render(scene, params, spp=16, seed=2), axis=None))
        return float(dr.grad(params[key])[0])

    metal = {"base_color": 0.8, "metallic": 1.0, "edge_tint": 0.5, "fresnel": "exact"}
    mine = gradient({"type": "decomposed_principled", "roughness": 0.6, **metal}, "roughness")
    same = {"type": "decomposed_conductor", "fresnel": "exact", "r": 0.8, "g": 0.5}
    other = gradient({**same, "alpha": 0.36, "distribution": "ggx"}, "alpha")
    assert abs(mine) > 1.0
    assert mine == pytest.approx(2.0 * 0.6 * other, rel=1e-3)


HIGH, LOW = (0.95, 0.9), (0.5, 0.2)
ENDS = [
    # curves over the base colour of a black metal bend within 1e-5 at lower cosines
    ("exact", "base_color", 0.0, {"metallic": 1.0}, HIGH),
    ("exact", "base_color", 1.0, {"metallic": 1.0}, LOW),
    ("exact", "edge_tint", 0.0, {"metallic": 1.0, "base_color": 0.6}, LOW),
    ("exact", "edge_tint", 1.0, {"metallic": 1.0, "base_color": 0.6}, LOW),
    ("decomposition", "base_color", 0.0, {"metallic": 0.5}, LOW),
    ("decomposition", "base_color", 1.0, {"metallic": 0.5}, LOW),
    ("decomposition", "metallic", 1.0, {"base_color": COPPER}, LOW),
    ("decomposition", "edge_color", 1.0, {"base_color": 0.9, "metallic": 1.0}, LOW),
]


@LLVM_RGB
@only(("fresnel", "name", "value", "others", "heights"), ENDS)
def test_derivatives_at_the_ends_are_one_sided(
    fresnel: str,
    name: str,
    value: float,
    others: dict[str, Any],
    heights: tuple[float, ...],
    variant: str,
) -> None:
    """At 0 and 1 as everywhere, so that a descent can leave them again."""
    si = dr.zeros(mi.SurfaceInteraction3f, len(heights))
    si.wi = mi.Vector3f(np.array([direction(h, 0.0) for h in heights], np.float32).T)
    wo = si.wi * mi.Vector3f(-1.0, 1.0, 1.0)

    def total(at: Any) -> Any:
        plugin = principled(**others, fresnel=fresnel, **{name: value})
        params = mi.traverse(plugin)
        key = f"{name}.value"
        params[key] = type(params[key])(at)
        params.update()
        return dr.sum(dr.sum(plugin.eval(mi.BSDFContext(), si, wo)))

    x = mi.Float(value)
    dr.enable_grad(x)
    dr.backward(total(x))
    inward = 1.0 if value == 0.0 else -1.0
    step = 2e-3
    at, near, far = (float(total(mi.Float(value + inward * i * step))[0]) for i in (0, 1, 2))
    slope = inward * (-1.5 * at + 2.0 * near - 0.5 * far) / step  # second order
    assert abs(slope) > 0.05
    assert float(dr.grad(x)[0]) == pytest.approx(slope, rel=0.03)

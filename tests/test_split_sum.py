"""Split-sum shading: uniform light, mirrors, linearity, and what a scene shows."""

from __future__ import annotations

import numpy as np
import pytest

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp._check import InputError
from fresnel_decomp.albedo import directional_albedo
from fresnel_decomp.basis import load_basis
from fresnel_decomp.mitsuba import register
from fresnel_decomp.mitsuba.comparison import conductor_bsdf, render_scene
from fresnel_decomp.mitsuba.environment import Environment, texel_directions
from fresnel_decomp.mitsuba.prefilter import prefilter
from fresnel_decomp.mitsuba.scenes import lit_object
from fresnel_decomp.mitsuba.skies import city
from fresnel_decomp.mitsuba.split_sum import SplitMaterial, render_split_sum, shade
from fresnel_decomp.mitsuba.visible_surface import visible_surface
from fresnel_decomp.models import F82, Exact, Schlick
from fresnel_decomp.split_albedo import (
    SplitAlbedo,
    f82_albedo,
    integrated_albedo,
    schlick_albedo,
    schlick_table,
)
from fresnel_decomp.table import AlbedoTable

ETA, K = np.array([0.13, 0.43, 1.38]), np.array([3.9, 2.5, 1.9])  # like gold
TABLE = 1.5e-4  # of 64 x 64 texels away from grazing angles, design and measurement agree


@pytest.fixture(scope="module")
def table() -> AlbedoTable:
    return AlbedoTable.bake(load_basis())


@pytest.fixture
def vectorised(llvm: None) -> None:
    """llvm_ad_rgb, the variant of most of these tests, with the plugin."""
    register()


def views(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Normals, and views on their upper side, away from grazing angles."""
    random = np.random.default_rng(seed)
    normal, view = random.normal(size=(2, count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    view *= np.sign(np.sum(normal * view, axis=1, keepdims=True))
    keep = np.sum(normal * view, axis=1) > 0.05
    return normal[keep], view[keep]


@pytest.mark.parametrize("alpha", [0.08, 0.5])
def test_uniform_light_gives_the_albedo(table: AlbedoTable, alpha: float) -> None:
    light = prefilter(Environment(np.full((16, 32, 3), 0.6)), levels=5)
    normal, view = views(40)
    mu = np.sum(normal * view, axis=1)
    basis = load_basis()
    coefficients = basis.coefficients(ETA, K)
    albedo = SplitAlbedo(table, coefficients)
    found = shade(light, albedo, normal, view, alpha)
    np.testing.assert_allclose(found, 0.6 * albedo(mu, alpha), rtol=1e-6)
    expected = directional_albedo(lambda c: basis.evaluate(coefficients, c[..., None]), mu, alpha)
    np.testing.assert_allclose(found, 0.6 * expected, atol=TABLE)


def test_smooth_surfaces_are_mirrors(table: AlbedoTable) -> None:
    light = city(64)
    basis = load_basis()
    coefficients = basis.coefficients(ETA, K)
    normal, view = views(40)
    mu = np.sum(normal * view, axis=1, keepdims=True)
    found = shade(prefilter(light, levels=3), SplitAlbedo(table, coefficients), normal, view, 0.0)
    expected = light.lookup(2.0 * mu * normal - view) * basis.evaluate(coefficients, mu)
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_turning_everything_changes_nothing() -> None:
    light = city(64)
    normal, view = views(40)
    albedo = schlick_albedo([0.9, 0.6, 0.3])
    angle = 10 * 2.0 * np.pi / 64
    turn = np.array(
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    )
    before = shade(prefilter(light, levels=4), albedo, normal, view, 0.3)
    turned = prefilter(light.turned(10), levels=4)
    after = shade(turned, albedo, normal @ turn.T, view @ turn.T, 0.3)
    np.testing.assert_allclose(after, before, rtol=1e-3)


def test_schlick_and_f82_are_integrals_of_their_curves() -> None:
    mu, alpha = np.linspace(0.05, 1.0, 9), 0.3
    bent = F82.from_ior(ETA, K)
    for model, albedo in (
        (Schlick(bent.f0), schlick_albedo(bent.f0)),
        (bent, f82_albedo(bent.f0, bent.f82)),
    ):
        expected = directional_albedo(lambda c, m=model: m(c[..., None]), mu, alpha)
        np.testing.assert_allclose(albedo(mu, alpha), expected, atol=TABLE)


def test_integrated_albedo() -> None:
    mu, alpha = np.linspace(0.0, 1.0, 23), 0.3
    exact = Exact(ETA, K)
    expected = directional_albedo(lambda c: exact(c[..., None]), mu, alpha)
    np.testing.assert_allclose(integrated_albedo(exact, alpha)(mu, 0.9), expected, atol=1e-5)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_drjit_and_gradient_in_coefficients(table: AlbedoTable, backend: str) -> None:
    import drjit as dr

    kind = float_type(backend)
    light = prefilter(city(32), levels=4)
    normal, view = views(30)
    coefficients = load_basis().coefficients(ETA, K)
    expected = shade(light, SplitAlbedo(table, coefficients), normal, view, 0.4)

    vectors = [[kind(c.astype(np.float32)) for c in v.T] for v in (normal, view)]
    rows = [[kind(float(c)) for c in row] for row in coefficients]
    dr.enable_grad(rows)
    found = shade(light, SplitAlbedo(table, rows), *vectors, 0.4)
    np.testing.assert_allclose(
        np.stack([np.array(c) for c in found], axis=-1), expected, rtol=2e-3, atol=1e-5
    )
    dr.backward(dr.sum(found[1]))
    # linear: the derivative is the light times the functions of the table
    mu = np.sum(normal * view, axis=1)
    incoming = light.lookup(2.0 * mu[:, None] * normal - view, 0.4)[:, 1]
    slopes = (incoming[:, None] * table.lookup(mu, 0.4)).sum(axis=0)
    np.testing.assert_allclose([dr.grad(c)[0] for c in rows[1]], slopes, rtol=2e-3, atol=1e-5)
    assert all(dr.grad(c)[0] == 0.0 for c in rows[0])


def test_below_the_surface_is_dark(table: AlbedoTable) -> None:
    light = prefilter(city(16), levels=2)
    albedo = schlick_albedo([0.5, 0.5, 0.5], table=None)
    assert np.all(shade(light, albedo, [0.0, 1.0, 0.0], [0.6, -0.8, 0.0], 0.3) == 0.0)


@pytest.mark.parametrize("backend", BACKENDS)
def test_kinds_may_be_mixed_with_three_numbers(backend: str) -> None:
    kind = float_type(backend)
    light = prefilter(city(32), levels=4)
    albedo = schlick_albedo([0.9, 0.6, 0.3])
    normal, view = [0, 0, 1], [0.0, 0.6, 0.8]
    expected = shade(light, albedo, normal, view, 0.3)
    many = [[kind(float(c)) for c in v] for v in (normal, view)]
    for arguments in (
        (normal, many[1], 0.3),
        (many[0], view, 0.3),
        (np.array(normal), many[1], kind(0.3)),
        (normal, view, kind(0.3)),
        ([0.0, 0.0, kind(1.0)], view, 0.3),
    ):
        found = shade(light, albedo, *arguments)
        assert isinstance(found, tuple)
        np.testing.assert_allclose([np.array(c).item() for c in found], expected, rtol=1e-4)
    with pytest.raises(InputError, match=r"normal: a NumPy array of shape \(4, 3\) together"):
        shade(light, albedo, np.ones((4, 3)), many[1], 0.3)
    with pytest.raises(InputError, match=r"a NumPy array together with a Dr\.Jit array"):
        shade(light, albedo, *many, np.full(3, 0.3))
    rows = SplitAlbedo(schlick_table(), [[kind(0.5)] * 3] * 3)
    with pytest.raises(InputError, match=r"Dr\.Jit coefficients together with"):
        shade(light, rows, normal, view, 0.3)


@pytest.mark.parametrize("name", ["normal", "view"])
def test_vectors_that_are_refused(name: str) -> None:
    light = prefilter(city(16), levels=2)
    vectors = {"normal": [0.0, 0.0, 1.0], "view": [0.0, 0.0, 1.0], name: [0.0, 1.0]}
    with pytest.raises(InputError, match=rf"{name}: .* shape \(2,\); accepted: .*last axis"):
        shade(light, schlick_albedo([0.5] * 3), **vectors, alpha=0.3)


@pytest.mark.parametrize("place", ["normal", "view", "alpha"])
def test_what_is_no_number_gives_none(place: str) -> None:
    """As in tables, and not the black of a viewer below the surface."""
    kind = float_type("llvm")
    light, albedo = prefilter(city(16), levels=3), schlick_albedo([0.9, 0.6, 0.3])
    good = {"normal": [0.0, 0.0, 1.0], "view": [0.0, 0.6, 0.8], "alpha": 0.3}
    bad = {**good, place: np.nan if place == "alpha" else [0.0, np.nan, 0.8]}
    assert np.isnan(shade(light, albedo, **bad)).all()
    bad["view"] = [kind(c) for c in bad["view"]]
    assert all(np.isnan(np.array(c)).all() for c in shade(light, albedo, **bad))


@pytest.mark.parametrize("backend", AD_BACKENDS)
@pytest.mark.parametrize(("alpha", "step"), [(0.0, 1e-10), (1e-4, 1e-8), (1.0, -1e-5)])
def test_gradient_in_roughness(backend: str, alpha: float, step: float) -> None:
    """Also at the ends, where the light and the table have to agree on what the slope is."""
    import drjit as dr

    kind = float_type(backend, "float64")
    light, albedo = prefilter(city(32), levels=4), schlick_albedo([0.9, 0.6, 0.3])
    normal, view = views(20)
    vectors = [[kind(np.ascontiguousarray(c)) for c in v.T] for v in (normal, view)]
    roughness = dr.full(kind, alpha, len(normal))
    dr.enable_grad(roughness)
    dr.backward(dr.sum(shade(light, albedo, *vectors, roughness)[1]))
    ends = (shade(light, albedo, normal, view, a)[:, 1] for a in (alpha + step, alpha))
    slope = np.subtract(*ends) / step
    np.testing.assert_allclose(np.array(dr.grad(roughness)), slope, rtol=2e-3, atol=1e-3)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradient_seen_from_above(backend: str) -> None:
    """At n·v = 1 the clamp passes derivatives: that of the albedo in the cosine is there."""
    import drjit as dr

    kind = float_type(backend, "float64")
    light = prefilter(Environment(np.ones((8, 16, 3))), levels=3)
    albedo = schlick_albedo([0.1, 0.1, 0.1])
    x, z = kind(0.0), kind(1.0)
    dr.enable_grad(z)
    dr.backward(shade(light, albedo, [x, x, z], [0.0, 0.0, 1.0], 0.5)[1])
    slope = (albedo(1.0, 0.5) - albedo(1.0 - 1e-5, 0.5)) / 1e-5
    assert dr.grad(z)[0] == pytest.approx(slope[1], rel=1e-3)


@pytest.mark.parametrize("shape", ["sphere", "shader-ball"])
def test_pictures_are_where_mitsuba_paints_them(vectorised: None, shape: str) -> None:
    """Nearly a mirror in smooth light: both methods give one picture, up to noise."""
    import mitsuba as mi

    slope = texel_directions(64)
    light = Environment(1.0 + 0.6 * slope)  # red grows along x, green along y, blue along z
    bsdf = conductor_bsdf(ETA, K, alpha=0.02, distribution="ggx")
    scene = mi.load_dict(lit_object(bsdf, light.emitter(), 24, shape=shape, max_depth=2))
    reference = render_scene(scene, 256)
    surface = visible_surface(scene, 16)
    material = SplitMaterial(integrated_albedo(Exact(ETA, K), 0.02), 0.02)
    found = np.array(render_split_sum(surface, prefilter(light, levels=8), material))
    error = np.abs(found - reference)
    empty = surface.coverage() == 0.0
    assert empty.any()
    assert error[empty].max() < 0.01  # background
    inside = surface.coverage() == 1.0
    if shape == "sphere":
        # at the rim the lobe is cut off by the horizon, which the split-sum does not know
        assert np.median(error[inside]) < 0.004
        assert np.quantile(error[inside], 0.95) < 0.03
    else:  # shadows in its grooves
        assert np.median(error[inside]) < 0.01


def test_furnace(vectorised: None) -> None:
    """Uniform light has no split to err by: the exact albedo is the path tracer's mean."""
    import mitsuba as mi

    light = Environment(np.ones((8, 16, 3)))
    bsdf = conductor_bsdf(ETA, K, alpha=0.4)
    scene = mi.load_dict(lit_object(bsdf, light.emitter(), 16))
    reference = [render_scene(scene, 256, seed) for seed in (1, 2)]
    surface = visible_surface(scene, 64)
    material = SplitMaterial(integrated_albedo(Exact(ETA, K), 0.4), 0.4)
    found = np.array(render_split_sum(surface, prefilter(light, levels=3), material))
    inside = surface.coverage() == 1.0
    noise = 0.5 * np.abs(reference[0] - reference[1])[inside].mean()
    error = np.abs(found - 0.5 * (reference[0] + reference[1]))[inside]
    assert error.mean() < 2.0 * noise + 1e-3
    assert abs((found - 0.5 * (reference[0] + reference[1]))[inside].mean()) < 1e-3


def test_scalar_variants_shade_alike(variant: str, table: AlbedoTable) -> None:
    import mitsuba as mi

    register()
    light = city(32)
    bsdf = conductor_bsdf(ETA, K, alpha=0.3)
    scene = mi.load_dict(lit_object(bsdf, light.emitter(), 8))
    surface = visible_surface(scene, 4, seed=3)
    material = SplitMaterial(SplitAlbedo(table, load_basis().coefficients(ETA, K)), 0.3)
    picture = np.array(render_split_sum(surface, prefilter(light, levels=4), material))
    assert picture.shape == (8, 8, 3)

    normal, view = (np.array(v).reshape(-1, 3) if variant == "scalar_rgb" else np.array(v).T
                    for v in (surface.normal, surface.view))  # fmt: skip
    levels = prefilter(light, levels=4)
    seen = (np.array(surface.shape) >= 0)[:, None]
    lit = shade(levels, material.albedo, normal, view, 0.3)
    samples = np.where(seen, lit, light.lookup(-view))
    expected = samples.reshape(8, 8, 4, 3).mean(axis=2)
    np.testing.assert_allclose(picture, expected, rtol=2e-3, atol=1e-4)
    dark = render_split_sum(surface, levels, material, background=False)
    assert np.all(np.array(dark)[surface.coverage() == 0.0] == 0.0)
    assert np.array_equal(np.array(dark)[3, 4], picture[3, 4])


def test_pictures_are_differentiable(vectorised: None, table: AlbedoTable) -> None:
    import drjit as dr
    import mitsuba as mi

    light = city(32)
    scene = mi.load_dict(lit_object(conductor_bsdf(ETA, K), light.emitter(), 8))
    surface, levels = visible_surface(scene, 4), prefilter(light, levels=4)
    values = load_basis().coefficients(ETA, K)
    rows = [[mi.Float(float(c)) for c in row] for row in values]
    dr.enable_grad(rows[0][0])
    picture = render_split_sum(surface, levels, SplitMaterial(SplitAlbedo(table, rows), 0.3))
    dr.backward(dr.sum(picture.array))
    more = values.copy()
    more[0, 0] += 0.5  # linear: any step will do
    plain, changed = (
        np.array(render_split_sum(surface, levels, SplitMaterial(SplitAlbedo(table, c), 0.3)))
        for c in (values, more)
    )
    difference = 2.0 * (changed - plain).sum(dtype=np.float64)
    assert dr.grad(rows[0][0])[0] == pytest.approx(difference, rel=1e-4)


def test_materials_by_shape(vectorised: None) -> None:
    import mitsuba as mi

    light = city(32)
    scene = lit_object({"type": "diffuse"}, light.emitter(), 16)
    scene["object"] |= {"center": [-0.5, 0.0, 0.0], "radius": 0.4}
    scene["other"] = {"type": "sphere", "center": [0.5, 0.0, 0.0], "radius": 0.4}
    loaded = mi.load_dict(scene)
    surface, levels = visible_surface(loaded, 4), prefilter(light, levels=3)
    red, green = (
        SplitMaterial(SplitAlbedo(_white(), np.diag(c)), 0.3) for c in ([1, 0, 0], [0, 1, 0])
    )
    materials = {"object": red, "other": green}
    picture = np.array(render_split_sum(surface, levels, materials, background=False))
    assert picture[:, :8, 0].max() > 0.0
    assert picture[:, 8:, 1].max() > 0.0
    assert picture[:, :8, 1].max() == picture[:, 8:, 0].max() == picture[..., 2].max() == 0.0
    with pytest.raises(InputError, match="material for shape='other' is unknown"):
        render_split_sum(surface, levels, {"object": red})


def _white() -> AlbedoTable:
    return AlbedoTable.bake(lambda c: np.stack([1.0 + 0.0 * c] * 3, axis=-1), 8)


def test_input_that_is_refused(table: AlbedoTable, vectorised: None) -> None:
    with pytest.raises(InputError, match="accepted: 3 channels with 4 terms"):
        SplitAlbedo(table, np.ones((3, 3)))
    with pytest.raises(InputError, match="accepted: 3 channels"):
        SplitAlbedo(table, np.ones(4))
    with pytest.raises(InputError, match=r"alpha=1\.5"):
        SplitMaterial(schlick_albedo([0.5] * 3), 1.5)
    for f0 in ([0.5, 0.5], [0.5, np.nan, 0.5], "gold"):
        with pytest.raises(InputError, match=r"f0.*accepted: three finite numbers, or one"):
            schlick_albedo(f0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"f82.*accepted: three finite numbers"):
        f82_albedo([0.5] * 3, [0.5, 0.5])
    with pytest.raises(InputError, match="accepted: 3 channels with 4 terms"):
        schlick_albedo([0.5] * 3, table)  # four terms, not three
    for alpha in (-0.1, np.nan, "rough"):
        with pytest.raises(InputError, match=r"alpha=.*accepted: a number in \[0, 1e\+06\]"):
            integrated_albedo(Exact(ETA, K), alpha)  # type: ignore[arg-type]
        with pytest.raises(InputError, match=r"alpha=.*accepted: a number in"):
            SplitMaterial(schlick_albedo([0.5] * 3), alpha)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"size=.*accepted: an int"):
        schlick_table(16.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="shape='cube' is unknown"):
        lit_object({"type": "diffuse"}, city(16).emitter(), 8, shape="cube")

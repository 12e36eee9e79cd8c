"""Area lights: irradiance in closed form against sums, shading against sums, and Mitsuba."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from backends import AD_BACKENDS, float_type
from fresnel_decomp import AlbedoTable, Exact, InputError, doctor, load_basis
from fresnel_decomp.area_light import (
    CORRECTIONS,
    AreaLight,
    AreaMaterial,
    lit_share,
    shade_area_light,
)
from fresnel_decomp.irradiance import ellipse_irradiance, polygon_irradiance
from fresnel_decomp.ltc import load_lobes

ETA, K = [0.13, 0.43, 1.38], [3.9, 2.5, 1.9]


@pytest.fixture(scope="module")
def gold() -> AreaMaterial:
    basis = load_basis()
    return AreaMaterial.from_table(AlbedoTable.bake(basis), basis.coefficients(ETA, K))


def cut(points: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """A polygon above a plane, vertex by vertex."""
    kept = []
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        height_a, height_b = a @ plane, b @ plane
        if height_a > 0.0:
            kept.append(a)
        if (height_a > 0.0) != (height_b > 0.0):
            kept.append(a + height_a / (height_a - height_b) * (b - a))
    return np.array(kept).reshape(-1, 3)


def summed(points: np.ndarray, count: int = 300) -> np.ndarray:
    """Vector irradiance of a convex polygon by a midpoint rule over the triangles of a fan."""
    total = np.zeros(3)
    t = (np.arange(count) + 0.5) / count
    x, y = np.meshgrid(t, t)
    for i in range(1, len(points) - 1):
        a, b, c = points[0], points[i], points[i + 1]
        place = a + x[..., None] * (b - a) + (x * y)[..., None] * (c - b)
        area = np.cross(b - a, c - a) * x[..., None] / count**2
        square = (place**2).sum(axis=-1, keepdims=True)
        seen = (place * area).sum(axis=-1, keepdims=True) / square**1.5
        total += (seen * place / np.sqrt(square)).sum(axis=(0, 1))
    return total


def random_patch(random: np.random.Generator) -> tuple[np.ndarray, ...]:
    centre = random.normal(size=3)
    centre *= random.uniform(1.0, 2.5) / np.linalg.norm(centre)
    u, v = random.normal(size=(2, 3)) * 0.6
    return (centre, u, v) if np.linalg.det([u, v, centre]) > 0.0 else (centre, u, -v)


@pytest.mark.parametrize("planes", [0, 1, 2])
def test_polygons(planes: int) -> None:
    """Against sums over the cut polygon, whose step is 1/300."""
    random = np.random.default_rng(planes)
    for _ in range(12):
        centre, u, v = random_patch(random)
        corners = np.array(
            [centre + x * u + y * v for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        )
        normals = random.normal(size=(planes, 3))
        found = polygon_irradiance([tuple(c) for c in corners], [tuple(n) for n in normals])
        for normal in normals:
            corners = cut(corners, normal) if len(corners) else corners
        expected = summed(corners) if len(corners) > 2 else np.zeros(3)
        np.testing.assert_allclose(found, expected, atol=2e-3)


@pytest.mark.parametrize("planes", [0, 1, 2])
def test_ellipses_are_limits_of_polygons(planes: int) -> None:
    """500 corners lack 3e-5 of the area."""
    random = np.random.default_rng(10 + planes)
    turn = 2.0 * np.pi * np.arange(500) / 500
    for _ in range(15):
        centre, u, v = random_patch(random)
        border = centre + np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v
        normals = random.normal(size=(planes, 3))
        found = ellipse_irradiance(
            tuple(centre), tuple(u), tuple(v), [tuple(normal) for normal in normals]
        )
        for normal in normals:
            border = cut(border, normal) if len(border) else border
        expected = np.zeros(3)
        if len(border) > 2:
            corners = [tuple(corner) for corner in border.T.T]
            expected = np.array(polygon_irradiance(corners))
        np.testing.assert_allclose(found, expected, atol=2e-4)


def test_known_irradiance() -> None:
    """A sixth of all around, a disk under 45°, one that half sinks below the horizon."""
    square = [(-1.0, -1.0, 1.0), (-1.0, 1.0, 1.0), (1.0, 1.0, 1.0), (1.0, -1.0, 1.0)]
    form_factor = -polygon_irradiance(square)[2] / np.pi
    side = 1.0 / np.sqrt(2.0)  # of one half of a wall, by the textbook formula for a corner
    assert form_factor == pytest.approx(4.0 * 2.0 * side * np.arctan(side) / (2.0 * np.pi))
    disk = ellipse_irradiance((0.0, 0.0, 2.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert disk[2] / np.pi == pytest.approx(1.0 / 5.0, rel=1e-12)
    upright = (2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    whole = ellipse_irradiance(*upright)
    assert whole[0] / np.pi == pytest.approx(1.0 / 5.0, rel=1e-12)
    above = ellipse_irradiance(*upright, [(0.0, 0.0, 1.0)])
    assert above[0] == pytest.approx(0.5 * whole[0], rel=1e-12)
    assert ellipse_irradiance(*upright, [(-1.0, 0.0, 0.0)])[0] == 0.0
    assert ellipse_irradiance((0.0, 0.0, -1.0), *upright[1:])[2] == 0.0  # turned away


def test_small_and_grazing_ellipses() -> None:
    """Rounding must not take a short arc for a whole turn."""
    random = np.random.default_rng(4)
    for _ in range(300):
        centre, u, v = random_patch(random)
        size = 10.0 ** random.uniform(-4.0, 0.0)
        edge = centre + size * (u * np.cos(1.0) + v * np.sin(1.0))
        normal = np.cross(edge, random.normal(size=3))  # through a point of the border
        part = ellipse_irradiance(*map(tuple, (centre, size * u, size * v)), [tuple(normal)])
        other = ellipse_irradiance(*map(tuple, (centre, size * u, size * v)), [tuple(-normal)])
        whole = ellipse_irradiance(*map(tuple, (centre, size * u, size * v)))
        np.testing.assert_allclose(np.add(part, other), whole, atol=1e-12 + 1e-7 * size**2)


def brute_force(light: AreaLight, place, normal, view, alpha: float, count: int = 400) -> float:
    """The lobe's density summed over the light, which must not be clipped by more than a bit."""
    t = 2.0 * (np.arange(count) + 0.5) / count - 1.0
    x, y = np.meshgrid(t, t)
    weight = np.where((x * x + y * y <= 1.0) | (light.shape == "rectangle"), 4.0 / count**2, 0.0)
    centre, u, v = map(np.array, (light.centre, light.u, light.v))
    away = centre + x[..., None] * u + y[..., None] * v - place
    square = (away**2).sum(axis=-1)
    w = away / np.sqrt(square)[..., None]
    facing = np.maximum(-(w @ np.cross(u, v)), 0.0)
    mu = normal @ view
    tangent = view - mu * normal
    tangent /= np.linalg.norm(tangent)
    local = (w @ tangent, w @ np.cross(normal, tangent), w @ normal)
    density = load_lobes().lobe(mu, alpha).density(local)
    return float((density * facing / square * weight).sum())


@pytest.mark.parametrize("shape", ["rectangle", "disk"])
@pytest.mark.parametrize("alpha", [0.15, 0.4, 1.0])
def test_share_is_the_lobe_over_the_light(shape, alpha: float) -> None:
    """In any place, also where either horizon cuts it; the sum's border errs by 1e-3."""
    random = np.random.default_rng(5)
    seen = 0
    for _ in range(12):
        normal, view = random.normal(size=(2, 3))
        normal /= np.linalg.norm(normal)
        view /= np.linalg.norm(view)
        view *= np.sign(view @ normal)
        place = 0.2 * random.normal(size=3)
        centre, u, v = random_patch(random)
        light = AreaLight(shape, centre, v, u)  # turned to the origin
        found = lit_share(light, load_lobes(), place, normal, view, alpha).share
        assert found == pytest.approx(brute_force(light, place, normal, view, alpha), abs=2e-3)
        seen += found > 0.01
    assert seen >= 3


@pytest.mark.parametrize("shape", ["rectangle", "disk"])
@pytest.mark.parametrize("alpha", [0.02, 0.3, 1.0])
@pytest.mark.parametrize("correction", ["none", "normalised", "blended"])
def test_furnace(gold: AreaMaterial, shape, alpha: float, correction) -> None:
    """A light all around gives the amplitude sum c_i bbar_i, whatever is cut off at the horizon.

    Of a disk 2,000 wide at distance 1e-3, 1e-6 of the hemisphere is not covered.
    """
    light = AreaLight(shape, [0, 0, 1e-3], [0, 2e3, 0], [2e3, 0, 0])
    mu = np.array([1.0, 0.7, 0.3, 0.05])
    view = np.stack([np.sqrt(1.0 - mu * mu), 0.0 * mu, mu], axis=-1)
    found = shade_area_light(
        light, load_lobes(), gold, [0, 0, 0], [0, 0, 1], view, alpha, correction
    )
    np.testing.assert_allclose(found, gold.albedo(mu, alpha), rtol=2e-3)


def test_black_surfaces_stay_black(gold: AreaMaterial) -> None:
    """No channel of theirs is divided by what it reflects."""
    black = AreaMaterial.from_table(AlbedoTable.bake(load_basis(), 4), np.zeros((3, 4)))
    light = AreaLight("disk", [0, 0, 1], [0, 1, 0], [1, 0, 0])
    for correction in CORRECTIONS:
        found = shade_area_light(
            light, load_lobes(), black, [0, 0, 0], [0, 0, 1], [0.6, 0, 0.8], 0.3, correction
        )
        np.testing.assert_array_equal(found, 0.0)


def test_rows_are_points_in_lists_and_tuples() -> None:
    """Three arrays in a tuple are x, y and z."""
    rows = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.5), (0.0, 0.0, 0.2))
    light = AreaLight("disk", [0, 0, 1], [0, 1, 0], [1, 0, 0])

    def share(position: Any) -> Any:
        return lit_share(light, load_lobes(), position, [0, 0, 1], [0.6, 0, 0.8], 0.3).share

    expected = [share(row) for row in rows]
    assert expected[1] > expected[0]
    for given in (rows, list(rows), np.array(rows), tuple(np.array(rows).T)):
        np.testing.assert_allclose(share(given), expected, rtol=1e-12)


def test_sides(gold: AreaMaterial) -> None:
    """Nothing behind a light, from below a surface, or to a viewer below it."""
    up, view = [0.0, 0.0, 1.0], [0.6, 0.0, 0.8]
    arguments = [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]
    lobes = load_lobes()
    for shape in ("rectangle", "disk"):
        down = AreaLight(shape, *arguments)  # type: ignore[arg-type]
        away = AreaLight(shape, arguments[0], arguments[2], arguments[1])  # type: ignore[arg-type]
        both = AreaLight(shape, *arguments[:1], *arguments[:0:-1], two_sided=True)  # type: ignore[arg-type]
        lit = shade_area_light(down, lobes, gold, [0, 0, 0], up, view, 0.3)
        assert np.all(lit > 0.05)
        np.testing.assert_allclose(
            shade_area_light(both, lobes, gold, [0, 0, 0], up, view, 0.3), lit, rtol=1e-9
        )
        for light, place, eye in ((away, [0, 0, 0], view), (down, [0, 0, 2], view),
                                  (down, [0, 0, 0], [0.6, 0.0, -0.8])):  # fmt: skip
            assert np.all(shade_area_light(light, lobes, gold, place, up, eye, 0.3) == 0.0)


@pytest.mark.parametrize("shape", ["rectangle", "disk"])
def test_a_light_whose_plane_holds_the_point_gives_nothing(gold: AreaMaterial, shape) -> None:
    """It is seen edge-on, from beside it, and from its centre."""
    light = AreaLight(shape, [1.5, 0, 0.5], [1.0, 0, 0], [0, 0, 0.4], two_sided=True)
    inside = AreaLight(shape, [0, 0, 0], [1.0, 0, 0], [0, 1.0, 0], two_sided=True)
    for one in (light, inside):
        for correction in CORRECTIONS:
            lit = shade_area_light(
                one, load_lobes(), gold, [0, 0, 0], [0, 0, 1], [0.6, 0, 0.8], 0.3, correction
            )
            np.testing.assert_allclose(lit, 0.0, atol=1e-12)


def test_dielectrics_need_the_half_vector() -> None:
    """Brute force with the exact lobe: small lights at several places, F of eta = 1.5."""
    from fresnel_decomp import dielectric
    from fresnel_decomp.microfacet import half_vector, masking_shadowing, ndf

    basis = load_basis("balanced")
    table = AlbedoTable.bake(basis)
    plastic = AreaMaterial.from_table(table, [basis.coefficients(1.5, 0.0)] * 3)
    mu, alpha = 0.5, 0.3
    view = np.array([np.sqrt(1.0 - mu * mu), 0.0, mu])
    errors: dict[str, list[float]] = {c: [] for c in CORRECTIONS}
    for x in (-3.0, -1.7, -0.8, 0.0):
        light = AreaLight("rectangle", [x, 0, 1], [0, 0.5, 0], [0.5, 0, 0])
        t = 2.0 * (np.arange(200) + 0.5) / 200 - 1.0
        a, b = np.meshgrid(t, t)
        away = np.stack([x + 0.5 * b, 0.5 * a, 1.0 + 0.0 * a]).reshape(3, -1)
        square = (away**2).sum(axis=0)
        w = away / np.sqrt(square)
        normal, cos_half = half_vector(tuple(w), tuple(np.full(w.shape[1], c) for c in view))
        lobe = ndf(normal, alpha) * masking_shadowing(w[2], mu, alpha) / (4.0 * mu)
        solid_angle = w[2] / square / 200**2
        share = lit_share(light, load_lobes(), [0, 0, 0], [0, 0, 1], view, alpha).share
        exact = (lobe * solid_angle) @ dielectric(cos_half, 1.5)
        white = (lobe * solid_angle).sum()
        for c in CORRECTIONS:
            shaded = shade_area_light(light, load_lobes(), plastic, [0, 0, 0], [0, 0, 1], view,
                                      alpha, c)[0]  # fmt: skip
            # the lobe's own error divided out: what is left is the Fresnel term's
            reflectance = shaded / (share * table.lookup(mu, alpha)[0])
            errors[c].append(abs(reflectance / (exact / white) - 1.0))
    assert max(errors["plain"]) < 0.04
    assert max(errors["none"]) > 0.3


@pytest.mark.parametrize("backend", AD_BACKENDS)
@pytest.mark.parametrize("shape", ["rectangle", "disk"])
def test_drjit_and_gradients(gold: AreaMaterial, backend: str, shape) -> None:
    """As NumPy; gradients by differences in the roughness, the place and the light's vectors."""
    import drjit as dr

    kind = float_type(backend, "float64")
    up, lobes = [0.0, 0.0, 1.0], load_lobes()
    # the last is seen head-on under a light head-on, where a disk's cone is round
    view = np.array([[0.6, 0.0, 0.8], [-0.3, 0.4, np.sqrt(0.75)], [0.0, 0.0, 1.0]])
    numbers = np.array([0.35, 0.2, 0.1, 1.1, 0.1, 0.9, 0.0, 0.8, 0.0, 0.2])

    def shaded(values, views):
        alpha, centre, u, v = values[0], values[1:4], values[4:7], values[7:10]
        light = AreaLight(shape, list(centre), list(u), list(v), radiance=2.0)
        return shade_area_light(light, lobes, gold, [0.0, 0.0, 0.0], up, views, alpha, "blended")

    arrays = [kind(float(value)) for value in numbers]
    dr.enable_grad(arrays)
    found = shaded(arrays, [kind(np.ascontiguousarray(c).tolist()) for c in view.T])
    expected = shaded(numbers, view)
    np.testing.assert_allclose(np.stack([np.array(c) for c in found], -1), expected, rtol=1e-6)
    dr.backward(dr.sum(found[1]))
    gradients = [dr.grad(array) for array in arrays]
    dr.eval(gradients)  # in one kernel
    slopes = np.array([gradient[0] for gradient in gradients])
    assert np.isfinite(slopes).all()
    h = 1e-5
    for i in range(len(numbers)):
        up_, down = numbers.copy(), numbers.copy()
        up_[i] += h
        down[i] -= h
        difference = (shaded(up_, view) - shaded(down, view))[:, 1].sum() / (2.0 * h)
        assert slopes[i] == pytest.approx(difference, rel=2e-3, abs=2e-4), i


def test_input_that_is_refused(gold: AreaMaterial) -> None:
    with pytest.raises(InputError, match="shape='sphere' is unknown"):
        AreaLight("sphere", [0, 0, 0], [1, 0, 0], [0, 1, 0])  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"centre: .*last axis"):
        AreaLight("disk", [0, 0], [1, 0, 0], [0, 1, 0])
    with pytest.raises(InputError, match=r"centre=\[nan, 0\.0, 1\.0\]; accepted: finite"):
        AreaLight("disk", [np.nan, 0, 1], [0, 1, 0], [1, 0, 0])
    with pytest.raises(InputError, match=r"v=.*inf"):
        AreaLight("rectangle", [0, 0, 1], [0, 1, 0], [np.inf, 0, 0])
    with pytest.raises(InputError, match=r"radiance of shape \(3, 3\)"):
        AreaLight("disk", [0, 0, 1], [0, 1, 0], [1, 0, 0], radiance=np.eye(3))
    light = AreaLight("disk", [0, 0, 1], [0, 1, 0], [1, 0, 0])
    place = [0, 0, 0], [0, 0, 1], [0, 0, 1]
    with pytest.raises(InputError, match="correction='all' is unknown"):
        shade_area_light(light, load_lobes(), gold, *place, 0.3, "all")  # type: ignore[arg-type]
    bare = AreaMaterial(gold.albedo)
    with pytest.raises(InputError, match="without 'fresnel'"):
        shade_area_light(light, load_lobes(), bare, *place, 0.3, "plain")
    with pytest.raises(InputError, match="3 channels with 4 terms"):
        AreaMaterial.from_table(AlbedoTable.bake(load_basis(), 4), np.ones((3, 3)))
    with pytest.raises(InputError, match="3 planes; accepted: two at most"):
        ellipse_irradiance((0, 0, 1), (1, 0, 0), (0, 1, 0), [(0, 0, 1)] * 3)


# --- Mitsuba -------------------------------------------------------------------------------------


@pytest.fixture
def vectorised() -> Iterator[None]:
    from fresnel_decomp.mitsuba.variants import variant_scope

    best = doctor.best_variant()
    if best.startswith("scalar"):
        pytest.skip("minutes in scalar variants")
    with variant_scope(best):
        yield


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["rectangle", "disk"])
def test_pictures_are_those_of_mitsuba(vectorised: None, shape) -> None:
    """A rough gold floor: what is left is the lobe's error; where the light is, it is the light."""
    import mitsuba as mi

    from fresnel_decomp.mitsuba.area_light import LitMaterial, lit_by_area, render_area_light
    from fresnel_decomp.mitsuba.comparison import conductor_bsdf, render_scene
    from fresnel_decomp.mitsuba.visible_surface import visible_surface
    from fresnel_decomp.split_albedo import integrated_albedo

    light = AreaLight(shape, [0, 0.8, -1.2], [0.8, 0, 0], [0, 0.55, 0], radiance=[6.0, 5.0, 4.0])
    bsdf = conductor_bsdf(ETA, K, alpha=0.3, distribution="ggx")
    scene = mi.load_dict(lit_by_area(bsdf, light, 32))
    reference = render_scene(scene, 400)
    surface = visible_surface(scene, 16)
    material = AreaMaterial(integrated_albedo(Exact(ETA, K), 0.3))
    lit = LitMaterial(material, 0.3)
    found = np.array(render_area_light(surface, light, load_lobes(), lit))
    seen = (np.array(surface.shape) == surface.names.index("object")).reshape(32, 32, 16)
    floor = seen.all(axis=2)
    floor[1:] &= floor[:-1]
    floor[:, 1:] &= floor[:, :-1]
    floor[:, :-1] &= floor[:, 1:]
    error = (found - reference)[floor]
    assert np.sqrt((error**2).mean()) / reference[floor].mean() < 0.12
    glow = ~seen.any(axis=2)
    glow[1:] &= glow[:-1]
    glow[:-1] &= glow[1:]
    bright = glow & (reference[..., 0] > 5.99)
    assert bright.any()
    np.testing.assert_allclose(found[bright], reference[bright], rtol=1e-3)

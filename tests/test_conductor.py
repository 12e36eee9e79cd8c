"""The BSDF plugin: against the built-in one, against the models, and against itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from fresnel_decomp import RECIPES, InputError, load_basis, load_material, models
from fresnel_decomp.mitsuba import register, tabulation

only = pytest.mark.parametrize
LLVM_RGB = only("variant", ["llvm_ad_rgb"], indirect=True)
BOTH_SPECTRAL = only("variant", ["llvm_ad_spectral", "scalar_spectral"], indirect=True)
OTHER_VARIANTS = [
    "llvm_ad_mono",
    "llvm_ad_mono_polarized",
    "llvm_ad_spectral",
    "llvm_ad_spectral_polarized",
    "scalar_spectral",
    "scalar_spectral_polarized",
]
BE = {"eta": 3.18, "k": 3.0}
COLOURS = {
    "eta": {"type": "rgb", "value": [0.2, 1.2, 2.0]},
    "k": {"type": "rgb", "value": [3.0, 2.0, 1.5]},
}
NAN = float("nan")
FRESNEL = ("exact", "schlick", "f82", "decomposition")
F_ONE = {"c0": 1.0, "c1": 0.0, "c2": 0.0, "c3": 0.0}


@pytest.fixture(autouse=True)
def _registered(variant: str) -> None:
    """Every test runs in a variant that knows the plugin, and without Mitsuba's log."""
    mi.set_log_level(mi.LogLevel.Error)
    register()


def conductor(**parameters: Any) -> Any:
    """A plugin with alpha .3 unless said otherwise; parameters called with () are made afresh."""
    made = {k: v() if callable(v) else v for k, v in parameters.items()}
    roughness = {} if "alpha_u" in made else {"alpha": 0.3}
    return mi.load_dict({"type": "decomposed_conductor", **roughness, **made})


def bitmap(texels: np.ndarray, **modes: Any) -> Callable[[], Any]:
    """A maker of bitmap textures (Mitsuba empties the tensor that it is given)."""
    data = np.asarray(texels, np.float32)
    return lambda: {"type": "bitmap", "raw": True, "data": mi.TensorXf(data), **modes}


def directions(n: int = 64, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of directions in the upper hemisphere."""
    wi, wo = np.random.default_rng(seed).normal(size=(2, n, 3))
    wi[:, 2], wo[:, 2] = np.abs(wi[:, 2]), np.abs(wo[:, 2])
    return tuple(w / np.linalg.norm(w, axis=1, keepdims=True) for w in (wi, wo))


def interactions(wi: np.ndarray, uv: Any = (0.5, 0.5), wavelengths: Any = (450.0, 500, 550, 600)):
    """One vectorised interaction, or one for each direction in scalar variants."""
    wi = np.asarray(wi, float)
    uv = np.broadcast_to(uv, (len(wi), 2))

    def make(wi: Any, uv: Any, n: int) -> Any:
        si = dr.zeros(mi.SurfaceInteraction3f, n)
        si.wi, si.uv = wi, uv
        if mi.is_spectral:
            si.wavelengths = type(si.wavelengths)(list(wavelengths))
        return si

    if "scalar" in mi.variant():
        return [make(mi.Vector3f(*w), mi.Point2f(*p), 1) for w, p in zip(wi, uv, strict=True)]
    return [make(mi.Vector3f(wi.T.astype("f4")), mi.Point2f(uv.T.astype("f4")), len(wi))]


def evaluate(plugin: Any, wi: np.ndarray, wo: np.ndarray, method: str = "eval", **where: Any):
    """`plugin.method(ctx, si, wo)` for all pairs as (n, ...) arrays, in any variant."""
    sis, ctx = interactions(wi, **where), mi.BSDFContext()
    call = getattr(plugin, method)
    if "scalar" not in mi.variant():
        return as_array(call(ctx, sis[0], mi.Vector3f(np.asarray(wo).T.astype("f4"))), len(wi))
    rows = [call(ctx, si, mi.Vector3f(*w)) for si, w in zip(sis, np.asarray(wo), strict=True)]
    return np.array([as_array(row, 1)[0] for row in rows])


def as_array(value: Any, n: int) -> np.ndarray:
    """(n, channels) or (n,): unpolarised part of a spectrum, or a number; pairs side by side."""
    if isinstance(value, tuple):
        return np.column_stack([as_array(part, n) for part in value])
    if mi.is_polarized and isinstance(value, mi.Spectrum):
        value = value[0, 0]
    array = np.array(value, float)
    array = array[None] if "scalar" in mi.variant() else array.T
    return np.broadcast_to(array, (n, *array.shape[1:]))


def sample(plugin: Any, wi: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sampled directions (n, 3), their densities (n,) and weights (n, channels).

    Of random numbers (n, 2), or (n, 3) with one for the choice of the lobe in front.
    """
    sis, ctx = interactions(wi), mi.BSDFContext()
    scalar = "scalar" in mi.variant()
    u = np.asarray(u) if np.shape(u)[1] == 3 else np.column_stack([np.full(len(u), 0.5), u])
    columns = u if scalar else [u.T.astype("f4")]
    points = [(mi.Float(a), mi.Point2f(b, c)) for a, b, c in columns]
    n, rows = len(wi) // len(sis), []
    for si, (lobe, point) in zip(sis, points, strict=True):
        bs, weight = plugin.sample(ctx, si, lobe, point)
        rows.append([as_array(value, n) for value in (bs.wo, bs.pdf, weight)])
    return tuple(np.concatenate(column) for column in zip(*rows, strict=True))


def reflectance(plugin: Any, cos_theta: np.ndarray, **where: Any) -> np.ndarray:
    """(n, channels) Fresnel term of a plugin: mirror directions, relative to one with F = 1."""
    sin = np.sqrt(1.0 - cos_theta**2)
    wi = np.stack([sin, 0.0 * sin, cos_theta], axis=1)
    wo = wi * [-1.0, 1.0, 1.0]
    return evaluate(plugin, wi, wo, **where) / evaluate(conductor(**F_ONE), wi, wo, **where)


COSINES = np.linspace(0.02, 1.0, 40)


# --- the built-in plugin -------------------------------------------------------------------------


def picture(bsdf: dict[str, Any], size: int, spp: int, integrator: dict[str, Any]) -> np.ndarray:
    """A conducting ball on a conducting floor, with several bounces between them."""
    look = mi.ScalarTransform4f().look_at
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}
    if mi.is_monochromatic:
        film["pixel_format"] = "luminance"
    fresh = lambda: {k: v() if callable(v) else v for k, v in bsdf.items()}  # noqa: E731
    scene = {
        "type": "scene",
        "integrator": integrator,
        "sensor": {
            "type": "perspective",
            "fov": 40,
            "to_world": look([0, -4, 2], [0, 0, 0], [0, 0, 1]),
            "film": film,
        },
        "floor": {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f().scale(2),
            "bsdf": {"type": "twosided", "inside": fresh()},
        },
        "ball": {"type": "sphere", "radius": 0.6, "center": [0, 0, 0.6], "bsdf": fresh()},
        "sky": {"type": "constant"},
        "lamp": {
            "type": "rectangle",
            "to_world": look([0, 2, 3], [0, 0, 0], [0, 0, 1]),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [3, 2, 1]}},
        },
    }
    return np.array(mi.render(mi.load_dict(scene), spp=spp, seed=3))


def assert_identical(integrator: dict[str, Any] | None = None, **parameters: Any) -> None:
    """Bit for bit in vectorised variants, to rounding in scalar ones."""
    scalar = "scalar" in mi.variant()
    integrator = integrator or {"type": "path", "max_depth": 4, "rr_depth": 5}
    size, spp = (10, 4) if scalar else (32, 8)
    builtin = picture({"type": "roughconductor", **parameters}, size, spp, integrator)
    ours = {"type": "decomposed_conductor", "fresnel": "exact", **parameters}
    image = picture(ours, size, spp, integrator)
    assert builtin.max() > 0.1
    if scalar:
        np.testing.assert_allclose(image, builtin, rtol=7e-5, atol=1e-6)
    else:
        np.testing.assert_array_equal(image, builtin)


ALPHA = bitmap(np.random.default_rng(0).uniform(0.05, 0.4, (8, 8, 1)))
IDENTITY = {
    "ggx": {"material": "Au", "distribution": "ggx"},
    "defaults": {"material": "Be"},
    "anisotropic": {"material": "Cr", "alpha_u": 0.05, "alpha_v": 0.3, "distribution": "ggx"},
    "all normals": {"material": "Al", "alpha": 0.2, "sample_visible": False},
    "all normals, anisotropic": {
        **{"material": "Al", "alpha_u": 0.2, "alpha_v": 0.1},
        **{"sample_visible": False, "distribution": "ggx"},
    },
    "textured alpha": {"material": "Cu", "alpha": ALPHA, "distribution": "ggx"},
    "colours": {**COLOURS, "specular_reflectance": {"type": "rgb", "value": [0.5, 0.8, 0.2]}},
    "textured indices": {"eta": ALPHA, "k": 1.0},
}


@only("case", IDENTITY)
def test_exact_is_the_built_in_plugin(case: str, variant: str) -> None:
    assert_identical(**IDENTITY[case])


@only("variant", OTHER_VARIANTS, indirect=True)
def test_exact_is_the_built_in_plugin_in_other_variants(variant: str) -> None:
    path = {"type": "path", "max_depth": 4, "rr_depth": 5}
    stokes = {"type": "stokes", "inside": path}
    parameters = {"material": "Au", "alpha_u": 0.1, "alpha_v": 0.3, "distribution": "ggx"}
    assert_identical(stokes if mi.is_polarized else path, **parameters)


@pytest.mark.slow
@only("case", IDENTITY)
@only("variant", OTHER_VARIANTS, indirect=True)
def test_exact_is_the_built_in_plugin_everywhere(case: str, variant: str) -> None:
    assert_identical(**IDENTITY[case])


# --- the Fresnel terms ---------------------------------------------------------------------------


@only("fresnel", FRESNEL)
def test_terms_are_the_models(fresnel: str, variant: str) -> None:
    eta, k = (np.array(COLOURS[name]["value"]) for name in ("eta", "k"))
    expected = models.model_from_ior(fresnel, eta, k)(COSINES[:, None])
    got = reflectance(conductor(fresnel=fresnel, **COLOURS), COSINES)
    # the decomposition's closed form is within 1e-4 of its basis
    np.testing.assert_allclose(got, expected, atol=2e-4 if fresnel == "decomposition" else 5e-6)


@only("recipe", ["talk", "notebook"])
@only("terms", [3, 4, 5, 6])
def test_recipes_and_terms(recipe: str, terms: int, variant: str) -> None:
    basis = load_basis(recipe, terms)
    c = basis.coefficients(BE["eta"], BE["k"])
    got = reflectance(conductor(recipe=recipe, terms=terms, **BE), COSINES)[:, 0]
    np.testing.assert_allclose(got, basis.closed_form.evaluate(c, COSINES), atol=2e-6)
    given = {f"c{i}": float(value) for i, value in enumerate(c)}
    again = reflectance(conductor(recipe=recipe, terms=terms, **given), COSINES)[:, 0]
    np.testing.assert_allclose(again, got, atol=2e-6)


@only("fresnel", ["schlick", "f82", "decomposition"])
def test_parameter_sets_agree(fresnel: str, variant: str) -> None:
    basis = load_basis()
    exact = models.Gulbrandsen(0.6, 0.3)
    nodes = {"f0": 0.6} | {f"f{i + 1}": float(exact(np.cos(t))) for i, t in enumerate(basis.nodes)}
    c = basis.coefficients_from_reflectance(0.6, list(nodes.values())[1:])
    sets = {"r": 0.6, "g": 0.3}, nodes, {f"c{i}": float(value) for i, value in enumerate(c)}
    first, *rest = (reflectance(conductor(fresnel=fresnel, **s), COSINES) for s in sets)
    for other in rest:  # f82 takes the value at 1/7 from the fit where there is no index
        np.testing.assert_allclose(other, first, atol=0.01 if fresnel == "f82" else 2e-6)


def test_exact_accepts_gulbrandsen(variant: str) -> None:
    expected = models.Gulbrandsen(0.6, 0.3)(COSINES)
    got = reflectance(conductor(fresnel="exact", r=0.6, g=0.3), COSINES)[:, 0]
    np.testing.assert_allclose(got, expected, atol=1e-5)


def test_result_is_linear_in_the_coefficients(variant: str) -> None:
    rng, (wi, wo) = np.random.default_rng(1), directions()

    def value(c: np.ndarray) -> np.ndarray:
        colours = {f"c{i}": {"type": "rgb", "value": row.tolist()} for i, row in enumerate(c)}
        return evaluate(conductor(**colours), wi, wo)

    a, b = rng.uniform(-1.0, 1.5, (2, 4, 3))
    scale = np.abs(value(a)).max()
    np.testing.assert_allclose(
        value(0.25 * a - 1.5 * b), 0.25 * value(a) - 1.5 * value(b), atol=2e-6 * scale
    )


@LLVM_RGB
def test_fits_leave_the_unit_interval_by_their_error_only(variant: str) -> None:
    r, g = (v.ravel() for v in np.meshgrid(np.linspace(0.05, 0.95, 19), np.linspace(0, 1, 11)))
    for r_, g_ in zip(r[::7], g[::7], strict=True):
        for fresnel in ("schlick", "f82", "decomposition"):
            values = reflectance(conductor(fresnel=fresnel, r=r_, g=g_), COSINES)
            error = np.abs(models.Gulbrandsen(r_, g_)(COSINES)[:, None] - values).max()
            assert values.min() >= -error
            assert values.max() <= 1.0 + error
            assert values.min() > -0.01
            assert values.max() < 1.06


# --- the microfacet model ------------------------------------------------------------------------

SHAPES = {
    "ggx": {"distribution": "ggx"},
    "beckmann": {"distribution": "beckmann"},
    "ggx anisotropic": {"distribution": "ggx", "alpha_u": 0.15, "alpha_v": 0.4},
    "beckmann anisotropic": {"alpha_u": 0.15, "alpha_v": 0.4},
    "ggx all normals": {"distribution": "ggx", "sample_visible": False},
    "beckmann all normals": {"sample_visible": False},
    "ggx correlated": {"distribution": "ggx", "smith": "correlated"},
    "ggx lobe": {"distribution": "ggx", "energy_compensation": True},
    "ggx all normals scaling": {
        **{"distribution": "ggx", "sample_visible": False, "smith": "correlated"},
        **{"energy_compensation": True, "compensation": "scaling"},
    },
    "beckmann all normals lobe": {
        **{"sample_visible": False, "smith": "separable", "energy_compensation": True},
    },
    "beckmann anisotropic lobe": {"alpha_u": 0.15, "alpha_v": 0.4, "energy_compensation": True},
}


CHI2 = [(shape, 0.3) for shape in SHAPES]
CHI2 += [(shape, 0.05) for shape in SHAPES if "anisotropic" not in shape]
CHI2 += [("ggx lobe", 0.9)]  # half of the samples


@only(("shape", "alpha"), CHI2)
@LLVM_RGB
def test_sampling_follows_the_density(shape: str, alpha: float, variant: str) -> None:
    roughness = "" if "anisotropic" in shape else f'<float name="alpha" value="{alpha}"/>'
    xml = roughness + "".join(
        f'<{kind} name="{name}" value="{str(value).lower()}"/>'
        for name, value in {**BE, **SHAPES[shape]}.items()
        for kind in [{str: "string", bool: "boolean", float: "float"}[type(value)]]
    )
    sample, pdf = mi.chi2.BSDFAdapter("decomposed_conductor", xml, wi=[0.6, 0.0, 0.8])
    test = mi.chi2.ChiSquareTest(
        domain=mi.chi2.SphericalDomain(),
        sample_func=sample,
        pdf_func=pdf,
        sample_dim=3,
        res=101,
        ires=16 if alpha == 0.05 else 8,
        sample_count=200_000,
    )
    assert test.run(), test.messages


@only("shape", SHAPES)
def test_eval_pdf_and_sample_agree(shape: str, variant: str) -> None:
    plugin, (wi, wo) = conductor(**COLOURS, **SHAPES[shape]), directions()
    value, pdf = (evaluate(plugin, wi, wo, method) for method in ("eval", "pdf"))
    np.testing.assert_allclose(
        evaluate(plugin, wi, wo, "eval_pdf"), np.column_stack([value, pdf]), rtol=1e-5, atol=1e-7
    )
    wo, pdf, weight = sample(plugin, wi, np.random.default_rng(2).uniform(size=(len(wi), 3)))
    valid = pdf > 1e-2
    assert valid.mean() > 0.7
    value = evaluate(plugin, wi, wo, "eval")[valid] / evaluate(plugin, wi, wo, "pdf")[valid, None]
    # at grazing angles the half vector is ill-conditioned in single precision
    np.testing.assert_allclose(value, weight[valid], rtol=5e-3)
    np.testing.assert_allclose(evaluate(plugin, wi, wo, "pdf")[valid], pdf[valid], rtol=5e-3)


@only("shape", [shape for shape in SHAPES if "scaling" not in shape])
def test_reciprocity(shape: str, variant: str) -> None:
    plugin, (wi, wo) = conductor(**COLOURS, **SHAPES[shape]), directions()
    there, back = evaluate(plugin, wi, wo), evaluate(plugin, wo, wi)
    np.testing.assert_allclose(there / wo[:, 2:], back / wi[:, 2:], rtol=2e-4, atol=1e-6)


@only("fresnel", FRESNEL)
@only("shape", ["ggx", "beckmann", "ggx anisotropic"])
@LLVM_RGB
def test_white_furnace(fresnel: str, shape: str, variant: str) -> None:
    """Reflected energy: at most that of F = 1, which loses only what is shadowed."""
    u = np.random.default_rng(4).uniform(size=(100_000, 2))

    def albedo(plugin: Any, wi: tuple[float, float, float]) -> np.ndarray:
        return sample(plugin, np.tile(wi, (len(u), 1)), u)[2].mean(axis=0)

    for wi in ((0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.995, 0.0, 0.0999)):
        one = albedo(conductor(**F_ONE, **SHAPES[shape]), wi)
        metal = albedo(conductor(fresnel=fresnel, **COLOURS, **SHAPES[shape]), wi)
        assert np.all(one <= 1.0 + 1e-5)
        assert np.all(one > 0.7)
        assert np.all(metal <= one)
        assert np.all(metal > 0.0)


@only("compensated", [False, True])
def test_grazing_and_back_sides_give_zero(compensated: bool, variant: str) -> None:
    plugin = conductor(**COLOURS, energy_compensation=compensated)
    wi = np.array([[1.0, 0.0, 0.0], [0.6, 0.0, -0.8], [0.0, 0.0, 1.0]])
    wo = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    for method in ("eval", "pdf", "eval_pdf"):
        assert np.all(evaluate(plugin, wi, wo, method) == 0.0)
    _, pdf, weight = sample(plugin, wi[:2], np.array([[0.3, 0.6], [0.7, 0.2]]))
    assert np.all(pdf == 0.0)
    assert np.all(weight == 0.0)


@only("compensated", [False, True])
def test_components_can_be_switched_off(compensated: bool, variant: str) -> None:
    plugin, ctx = conductor(**BE, energy_compensation=compensated), mi.BSDFContext()
    assert mi.has_flag(plugin.flags(), mi.BSDFFlags.GlossyReflection)
    assert mi.has_flag(plugin.flags(), mi.BSDFFlags.FrontSide)
    assert not mi.has_flag(plugin.flags(), mi.BSDFFlags.Anisotropic)
    assert mi.has_flag(conductor(**BE, alpha_u=0.1, alpha_v=0.2).flags(), mi.BSDFFlags.Anisotropic)
    assert plugin.component_count() == 1
    ctx.type_mask = mi.BSDFFlags.Diffuse
    si, up = interactions([[0.0, 0.0, 1.0]])[0], mi.Vector3f(0.0, 0.0, 1.0)
    assert np.all(np.array(plugin.eval(ctx, si, up)) == 0.0)
    assert np.all(np.array(plugin.pdf(ctx, si, up)) == 0.0)
    assert np.all(np.array(plugin.sample(ctx, si, 0.5, mi.Point2f(0.5, 0.5))[1]) == 0.0)


# --- textures and spectra ------------------------------------------------------------------------


def table_error(n: int = 100, **textures: Any) -> float:
    """Largest difference of tabulated (a, -3 b) from the textures themselves."""
    loaded = {
        name: mi.load_dict(
            {"type": "uniform", "value": t} if isinstance(t, float) else t() if callable(t) else t
        )
        for name, t in textures.items()
    }
    lookup = tabulation.tabulate(loaded, lambda a, b: (a, -3.0 * b))
    rng = np.random.default_rng(5)
    wavelengths = rng.uniform(360.0, 830.0, 4).tolist()
    worst = 0.0
    where = {"uv": rng.uniform(-2.0, 3.0, (n, 2)), "wavelengths": wavelengths}
    for si in interactions(np.tile([0.0, 0.0, 1.0], (n, 1)), **where):
        a, b = (texture.eval(si) for texture in loaded.values())
        for got, expected in zip(lookup.evaluate(si, True), (a, -3.0 * b), strict=True):
            worst = max(worst, np.abs(np.array(got) - np.array(expected)).max())
    return worst


def image(channels: int = 1, **modes: Any) -> Callable[[], Any]:
    """A bitmap without symmetries."""
    texels = np.random.default_rng(6).uniform(0.5, 2.0, (5, 7, channels))
    return bitmap(texels, to_uv=mi.ScalarTransform3f().rotate(30).scale([2, 3]), **modes)


@only("wrap_mode", ["repeat", "mirror", "clamp"])
@only("filter_type", ["bilinear", "nearest"])
def test_tables_follow_bitmaps(filter_type: str, wrap_mode: str, variant: str) -> None:
    modes = {"filter_type": filter_type, "wrap_mode": wrap_mode}
    assert table_error(a=image(1, **modes), b=image(3, **modes)) < 3e-5
    assert table_error(a=image(3, **modes), b=1.5) < 3e-5


def test_tables_follow_checkerboards(variant: str) -> None:
    to_uv = mi.ScalarTransform3f().rotate(20).scale(3)
    board = {"type": "checkerboard", "to_uv": to_uv, "color0": 0.3}
    colour = {"type": "rgb", "value": [0.1, 0.2, 0.3]}
    assert table_error(a={**board, "color1": colour}, b=2.0) < 1e-6
    other = {"type": "checkerboard", "color0": 0.7, "color1": image(1)()}
    assert table_error(a={**board, "color1": 0.8}, b=other) < 3e-5
    assert table_error(a={**board, "color1": 0.8}, b={**board, "color1": colour}) < 1e-6


@BOTH_SPECTRAL
def test_tables_follow_spectra(variant: str) -> None:
    regular = {"type": "regular", "wavelength_min": 360.0, "wavelength_max": 830.0}
    regular["values"] = "1, 2, 3, 1.5"
    irregular = {"type": "irregular", "wavelengths": "350, 472.3, 600, 900", "values": "1, 2, 3, 2"}
    colour = {"type": "rgb", "value": [0.9, 0.1, 0.2]}
    # kinks between two nodes of the table are cut by a quarter of their change of slope
    assert table_error(a=regular, b=1.0) < 5e-3
    assert table_error(a=irregular, b=colour) < 5e-3
    assert table_error(a=image(1), b=1.0) < 3e-5
    with pytest.raises(InputError, match="one channel"):
        table_error(a=image(3), b=1.0)
    with pytest.raises(InputError, match="one channel"):
        table_error(a=image(1), b=colour)


def test_bitmaps_that_disagree_are_refused(variant: str) -> None:
    with pytest.raises(InputError, match="filter_type and wrap_mode"):
        table_error(a=image(1), b=image(1, wrap_mode="clamp"))
    with pytest.raises(InputError, match="resolution or to_uv"):
        table_error(a=image(1), b=bitmap(np.ones((5, 7, 1))))
    attribute = {"type": "mesh_attribute", "name": "vertex_color"}
    with pytest.raises(InputError, match="c0, c1"):
        table_error(a=attribute, b=1.0)


def test_each_texel_is_projected(variant: str) -> None:
    texels = np.random.default_rng(7).uniform(0.5, 3.0, (2, 3, 1))
    plugin = conductor(eta=bitmap(texels), k=2.5, alpha=0.4)
    for y in range(2):
        for x in range(3):
            one = conductor(eta=float(texels[y, x, 0]), k=2.5, alpha=0.4)
            got, expected = (
                reflectance(p, COSINES, uv=((x + 0.5) / 3, (y + 0.5) / 2)) for p in (plugin, one)
            )
            np.testing.assert_allclose(got, expected, atol=5e-6)


def test_coefficients_may_be_textures_of_any_kind(variant: str) -> None:
    texels = np.random.default_rng(8).uniform(-0.5, 0.5, (3, 3, 3))
    plugin = conductor(**(F_ONE | {"c2": bitmap(texels)}))
    colour = {"type": "rgb", "value": texels[1, 1].tolist()}
    one = conductor(**(F_ONE | {"c2": colour}))
    got, expected = (reflectance(p, COSINES) for p in (plugin, one))
    np.testing.assert_allclose(got, expected, atol=2e-6)
    attribute = {"type": "mesh_attribute", "name": "vertex_color"}
    conductor(**(F_ONE | {"c2": attribute}))


@BOTH_SPECTRAL
def test_measured_spectra(variant: str) -> None:
    wavelengths = [420.0, 500.5, 580.25, 700.0]
    files = [mi.spectrum_from_file(f"data/ior/Au.{name}.spd") for name in ("eta", "k")]
    eta, k = (np.interp(wavelengths, *file) for file in files)
    expected = models.Decomposition.from_ior(eta, k)(COSINES[:, None])
    got = reflectance(conductor(material="Au"), COSINES, wavelengths=wavelengths)
    np.testing.assert_allclose(got, expected, atol=3e-4)


@only("fresnel", FRESNEL)
@only("variant", ["llvm_ad_rgb", "scalar_spectral", "llvm_ad_spectral_polarized"], indirect=True)
def test_no_material_is_a_mirror(fresnel: str, variant: str) -> None:
    for name in ("none", "None"):
        got = reflectance(conductor(fresnel=fresnel, material=name), COSINES)
        np.testing.assert_allclose(got, 1.0, atol=2e-6)


@only("variant", ["llvm_ad_rgb", "scalar_spectral"], indirect=True)
def test_materials_by_alias(variant: str) -> None:
    gold, silver = (reflectance(conductor(material=m), COSINES) for m in ("Au", "Ag"))
    for name in ("gold", "GOLD", "au"):
        np.testing.assert_array_equal(reflectance(conductor(material=name), COSINES), gold)
    assert np.any(gold != silver)


@only("fresnel", FRESNEL)
@only("material", ["CsI", "ThF4"])
@BOTH_SPECTRAL
def test_materials_without_absorption(material: str, fresnel: str, variant: str) -> None:
    """The built-in plugin cannot load them in spectral variants."""
    wavelengths = [420.0, 500.5, 580.25, 700.0]
    eta = np.interp(wavelengths, *mi.spectrum_from_file(f"data/ior/{material}.eta.spd"))
    expected = models.model_from_ior(fresnel, eta, 0.0)(COSINES[:, None])
    plugin = conductor(fresnel=fresnel, material=material)
    got = reflectance(plugin, COSINES, wavelengths=wavelengths)
    np.testing.assert_allclose(got, expected, atol=3e-4)


@only("variant", ["scalar_rgb", "scalar_spectral"], indirect=True)
def test_broken_materials_are_told(variant: str, caplog: pytest.LogCaptureFixture) -> None:
    for fresnel in FRESNEL:
        conductor(fresnel=fresnel, material="SnTe")
    conductor(fresnel="exact", material="AlAs")
    assert [r.args[0] for r in caplog.records] == ["SnTe"] * 4 + ["AlAs"]
    assert "'AlAs' is broken: eta = 0 at 13 samples" in caplog.text
    if mi.is_spectral:  # the gap itself is there
        with pytest.raises(RuntimeError, match="'eta' with values from 0 to"):
            conductor(material="AlAs")
    caplog.clear()
    conductor(material="Be")
    assert not caplog.records


@BOTH_SPECTRAL
def test_negative_numbers_survive_in_spectral_variants(variant: str) -> None:
    plugin = conductor(**(F_ONE | {"c0": 0.3, "c1": 0.7, "c2": -0.25}))
    b = load_basis().closed_form(COSINES)
    expected = 0.3 + 0.7 * b[:, 1] - 0.25 * b[:, 2]
    got = reflectance(plugin, COSINES)
    np.testing.assert_allclose(got, np.tile(expected[:, None], 4), atol=2e-6)
    with pytest.raises(RuntimeError, match="numbers of any sign"):
        conductor(**(F_ONE | {"c2": {"type": "rgb", "value": [0.1, -0.2, 0.3]}}))


@only("variant", ["llvm_ad_spectral_polarized", "scalar_spectral_polarized"], indirect=True)
@only("fresnel", ["schlick", "decomposition"])
def test_fitted_terms_depolarise(fresnel: str, variant: str) -> None:
    plugin, (wi, wo) = conductor(fresnel=fresnel, **BE), directions(1)
    si = interactions(wi)[0]
    matrix = np.array(plugin.eval(mi.BSDFContext(), si, mi.Vector3f(*wo[0].tolist())))
    matrix = matrix.reshape(4, 4, -1)
    assert np.all(matrix[0, 0] > 0.0)
    assert np.count_nonzero(matrix) == matrix[0, 0].size


# --- parameters ----------------------------------------------------------------------------------


def test_parameters_are_exposed(variant: str) -> None:
    params = mi.traverse(conductor(**COLOURS, specular_reflectance=0.5))
    assert params.flags("eta.value") & mi.ParamFlags.Discontinuous == 0
    assert params.flags("k.value") & mi.ParamFlags.NonDifferentiable == 0
    assert params.flags("alpha.value") & mi.ParamFlags.Discontinuous
    assert "specular_reflectance.value" in params
    assert {"alpha_u.value", "alpha_v.value", "r.value", "g.value"} <= set(
        mi.traverse(conductor(r=0.5, g=0.5, alpha_u=0.1, alpha_v=0.2)).keys()
    )
    assert {f"c{i}.value" for i in range(4)} <= set(mi.traverse(conductor(**F_ONE)).keys())


@only("fresnel", ["schlick", "f82", "decomposition"])
def test_updates_are_projected(fresnel: str, variant: str) -> None:
    plugin = conductor(fresnel=fresnel, eta=0.3, k=4.0)
    params = mi.traverse(plugin)
    params["eta.value"], params["k.value"] = mi.Float(BE["eta"]), mi.Float(BE["k"])
    params.update()
    expected = reflectance(conductor(fresnel=fresnel, **BE), COSINES)
    np.testing.assert_array_equal(reflectance(plugin, COSINES), expected)
    stored = np.array(params["table_0"]).ravel()[0]
    assert stored == pytest.approx(models.Schlick.from_ior(**BE).f0, abs=1e-6)


def test_bad_updates_are_refused(variant: str) -> None:
    params = mi.traverse(conductor(**BE))
    params["eta.value"], params["k.value"] = mi.Float(0.7), mi.Float(1e-3)
    with pytest.raises((InputError, RuntimeError), match="total internal reflection"):
        params.update()
    for fresnel in FRESNEL:
        for name, value in {"eta": -1.0, "k": NAN, "alpha": 0.0}.items():
            params = mi.traverse(conductor(fresnel=fresnel, **BE))
            params[f"{name}.value"] = mi.Float(value)
            with pytest.raises((InputError, RuntimeError), match=f"parameter {name}="):
                params.update()


@LLVM_RGB
def test_frozen_functions_may_set_the_exact_term(variant: str) -> None:
    plugin = conductor(fresnel="exact", **BE)
    params, (wi, wo) = mi.traverse(plugin), directions(4)
    si, wo_ = interactions(wi)[0], mi.Vector3f(wo.T.astype("f4"))

    @dr.freeze
    def value(si: Any, wo: Any, eta: Any) -> Any:
        params["eta.value"] = eta
        params.update()
        return plugin.eval(mi.BSDFContext(), si, wo)

    for eta in (1.5, 2.5, 3.5):
        got = as_array(value(si, wo_, dr.opaque(mi.Float, eta)), 4)
        expected = evaluate(conductor(fresnel="exact", eta=eta, k=BE["k"]), wi, wo)
        np.testing.assert_allclose(got, expected, rtol=1e-6)


@LLVM_RGB
def test_frozen_functions_may_not_project(variant: str) -> None:
    plugin = conductor(**BE)
    params = mi.traverse(plugin)

    @dr.freeze
    def change(eta: Any) -> Any:
        params["eta.value"] = eta
        params.update()
        return eta

    with pytest.raises(RuntimeError) as raised:
        change(dr.opaque(mi.Float, 1.5))
    assert "outside of it" in str(raised.value.__cause__)


def test_to_string(variant: str) -> None:
    text = str(conductor(**BE, recipe="notebook", terms=5))
    for line in (
        "DecomposedConductor[",
        "fresnel = decomposition",
        "recipe = notebook",
        "terms = 5",
        "distribution = beckmann",
        "smith = separable",
        "energy_compensation = none",
        "alpha_u = UniformSpectrum",
        "eta = UniformSpectrum",
    ):
        assert line in text


@only(
    ("parameters", "message"),
    [
        ({}, "nothing"),
        ({"eta": 1.5}, "exactly one of"),
        ({**BE, "material": "Au"}, "exactly one of"),
        ({**BE, "r": 0.5, "g": 0.5}, "exactly one of"),
        ({"c0": 0.5, "c1": 0.5}, "exactly one of"),
        ({**BE, "fresnel": "Schlick"}, "'schlick'"),
        ({**BE, "distribution": "phong"}, "'ggx'"),
        ({**BE, "recipe": "tlak"}, "'talk'"),
        ({**BE, "smith": "uncorrelated"}, "'correlated'"),
        ({**BE, "compensation": "lobe"}, "switch energy_compensation on"),
        ({**BE, "energy_compensation": True, "compensation": "lob"}, "'lobe'"),
        ({**BE, "terms": 9}, "3, 4, 5 or 6"),
        ({**F_ONE, "fresnel": "exact"}, "do not determine"),
        ({**BE, "alpha": 0.1, "alpha_u": 0.1}, "alpha_u = alpha_v"),
        ({**BE, "alpha_u": 0.1}, "alpha_u and alpha_v"),
        ({"r": 1.5, "g": 0.5}, r"r=1.5; accepted: values in \[0, 1\)"),
        ({"r": 1.0, "g": 0.5}, r"r=1; accepted: values in \[0, 1\)"),
        ({"r": 0.5, "g": 1.5}, "g=1.5"),
        ({"r": 0.5, "g": NAN}, "g=nan"),
        ({"f0": 0.5, "f1": NAN, "f2": 0.5}, "f1=nan"),
        ({**F_ONE, "c0": NAN}, "c0=nan"),
        ({**F_ONE, "specular_reflectance": NAN}, "specular_reflectance=nan"),
        *(({**BE, "alpha": alpha}, "alpha=") for alpha in (0.0, -0.1, NAN)),
        ({**BE, "alpha_u": 0.1, "alpha_v": 0.0}, "alpha_v=0"),
        ({"eta": 0.7, "k": 0.0}, "total internal reflection"),
        ({"material": "Unobtainium"}, "Unobtainium"),
        ({"material": "silwer"}, "'Ag'"),
        ({**BE, "aplha": 0.1}, "aplha"),
    ],
)
def test_bad_input(parameters: dict[str, Any], message: str, variant: str) -> None:
    with pytest.raises(RuntimeError, match=message):
        mi.load_dict({"type": "decomposed_conductor", **parameters})


@only("fresnel", FRESNEL)
@only("eta", [-1.0, 0.0, NAN, np.inf])
def test_bad_indices_are_refused(eta: float, fresnel: str, variant: str) -> None:
    with pytest.raises(RuntimeError, match=f"eta={eta:g}; accepted: finite values > 0"):
        conductor(fresnel=fresnel, eta=eta, k=2.0)
    with pytest.raises(RuntimeError, match="k=-2; accepted: finite values >= 0"):
        conductor(fresnel=fresnel, eta=1.5, k=-2.0)


@only("fresnel", FRESNEL)
def test_bad_texels_are_refused(fresnel: str, variant: str) -> None:
    texels = np.full((3, 3, 1), 2.0)
    texels[1, 2] = -1.0
    board = {"type": "checkerboard", "color0": 2.0, "color1": bitmap(texels)()}
    for eta in (bitmap(texels), board):
        with pytest.raises(RuntimeError, match="'eta' with values from -1 to 2"):
            conductor(fresnel=fresnel, eta=eta, k=2.0)
    texels[1, 2] = NAN
    for name in ("eta", "alpha"):
        with pytest.raises(RuntimeError, match=f"'{name}' with 1 of 9 values"):
            conductor(**{"fresnel": fresnel, **BE, name: bitmap(texels)})
    with pytest.raises(RuntimeError, match="c1"):
        conductor(**(F_ONE | {"c1": bitmap(texels)}))


@only("storage", ["variant", "fp16", "auto"])
def test_8_bit_images(storage: str, variant: str) -> None:
    def texture(value: int) -> dict[str, Any]:
        texels = mi.Bitmap(np.full((2, 2, 1), value, np.uint8))
        return {"type": "bitmap", "raw": True, "bitmap": texels, "format": storage}

    got = reflectance(conductor(r=texture(128), g=0.5), COSINES)
    expected = reflectance(conductor(r=128 / 255, g=0.5), COSINES)
    np.testing.assert_allclose(got, expected, atol=2e-3 if storage == "fp16" else 1e-5)
    with pytest.raises(RuntimeError, match=r"r=1; .* scale it below 1"):
        conductor(r=texture(255), g=0.5)
    with pytest.raises(RuntimeError, match="alpha=0"):
        conductor(**BE, alpha=texture(0))


def test_registering_again_does_no_harm(variant: str) -> None:
    register()
    assert str(conductor(**BE)).startswith("DecomposedConductor")


def test_registering_needs_a_variant(variant: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mi, "variant", lambda: None)
    with pytest.raises(InputError, match="no Mitsuba variant is set"):
        register()


@LLVM_RGB
def test_later_variants_know_the_plugin_too(variant: str) -> None:
    mi.set_variant("scalar_spectral")
    assert "IrregularSpectrum" in str(conductor(material="Au"))


# --- measured spectra, integrated ----------------------------------------------------------------


@only("recipe", RECIPES)
def test_integrated_spectra_are_the_materials_coefficients(recipe: str, variant: str) -> None:
    for name in ("Au", "beryllium"):
        c = load_material(name).rgb_coefficients(load_basis(recipe), "A")
        plugin = conductor(material=name, illuminant="A", recipe=recipe)
        parameters = mi.traverse(plugin)
        for i in range(4):
            np.testing.assert_allclose(
                np.array(parameters[f"c{i}.value"]).ravel(), c[:, i], rtol=2e-7, atol=1e-8
            )
        expected = load_basis(recipe).evaluate(c, COSINES[:, None])
        np.testing.assert_allclose(reflectance(plugin, COSINES), expected, atol=2e-4)
    gold = mi.traverse(conductor(material="Au", illuminant="D65"))
    assert np.array(gold["c0.value"]).ravel()[0] > 1.02  # out of gamut, and kept


@only(("name", "permission"), [("Se", "allow_partial"), ("AlAs", "allow_broken")])
def test_incomplete_spectra_are_integrated_if_asked(
    name: str, permission: str, variant: str
) -> None:
    plugin = conductor(material=name, illuminant="D65", **{permission: True})
    c = load_material(name, **{permission: True}).rgb_coefficients(load_basis(), "D65")
    for i, values in enumerate(c.T):
        got = np.array(mi.traverse(plugin)[f"c{i}.value"]).ravel()
        np.testing.assert_allclose(got, values, rtol=2e-7, atol=1e-8)


@only("fresnel", ["schlick", "f82"])
def test_integrated_spectra_by_other_terms(fresnel: str, variant: str) -> None:
    gold = load_material("Au")
    f0, f82 = gold.rgb_reflectance(1.0), gold.rgb_reflectance(1.0 / 7.0)
    model = models.Schlick(f0) if fresnel == "schlick" else models.F82(f0, f82)
    got = reflectance(conductor(material="Au", illuminant="D65", fresnel=fresnel), COSINES)
    np.testing.assert_allclose(got, model(COSINES[:, None]), atol=5e-6)


@only("variant", ["llvm_ad_mono"], indirect=True)
def test_integrated_spectra_without_colour(variant: str) -> None:
    from fresnel_decomp.colour import WAVELENGTH_NM, luminance_weights

    spectrum = load_basis().coefficients(*load_material("Cu").at(WAVELENGTH_NM))
    expected = load_basis().evaluate(luminance_weights("A") @ spectrum, COSINES)
    got = reflectance(conductor(material="Cu", illuminant="A"), COSINES)[:, 0]
    np.testing.assert_allclose(got, expected, atol=2e-4)


@BOTH_SPECTRAL
@only("fresnel", FRESNEL)
def test_spectral_variants_keep_the_spectra(fresnel: str, variant: str, tmp_path: Any) -> None:
    """Of files too, and beyond the ends of the data, where Mitsuba's own spectra are 0."""
    path = tmp_path / "mine.csv"
    path.write_text("390,1.5,2.0\n600,0.5,3.0\n720,1.0,4.0\n", encoding="utf-8")
    wavelengths = (370.0, 420.5, 610.0, 800.0)
    plugin = conductor(material=str(path), illuminant="D65", fresnel=fresnel)
    eta, k = load_material(path).at(np.array(wavelengths))
    expected = models.model_from_ior(fresnel, eta, k)(COSINES[:, None])
    got = reflectance(plugin, COSINES, wavelengths=wavelengths)
    # tables are linear between whole nanometres, the closed form is within 1e-4 of its basis
    np.testing.assert_allclose(got, expected, atol=3e-4)


@only(
    ("parameters", "message"),
    [
        ({"material": "Au", "illuminant": "D66"}, "Did you mean 'D65'"),
        ({"material": "Au", "illuminant": "D65", "fresnel": "exact"}, "spectral variant"),
        ({"eta": 1.0, "k": 2.0, "illuminant": "D65"}, "illuminant with eta, k"),
        ({"material": "Se", "illuminant": "D65"}, "partial.*allow_partial=True"),
        ({"material": "Se", "illuminant": "D65", "allow_broken": True}, "partial"),
        ({"material": "SnTe", "illuminant": "D65"}, "broken.*allow_broken=True"),
        ({"material": "Se", "allow_partial": True}, "allow_partial without illuminant"),
        ({"material": "none", "illuminant": "D65"}, "unknown"),
    ],
)
def test_integrated_spectra_refused(parameters: Any, message: str, variant: str) -> None:
    with pytest.raises((InputError, RuntimeError), match=message):
        conductor(**parameters)

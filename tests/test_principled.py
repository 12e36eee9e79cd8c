"""The principled BSDF: against the conductor, the models, Mitsuba's own, and against itself."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from fresnel_decomp import AlbedoTable, InputError, directional_albedo, load_basis, models
from fresnel_decomp.fresnel import dielectric
from fresnel_decomp.metallic import default_edge_colour, metal_coefficients, metal_reflectance
from fresnel_decomp.mitsuba import register
from fresnel_decomp.mitsuba.coupled_diffuse import cosine_average
from fresnel_decomp.mitsuba.fresnel_terms import F82, Schlick
from fresnel_decomp.parametrization import F82_COSINE
from test_conductor import (
    BOTH_SPECTRAL,
    COSINES,
    FRESNEL,
    LLVM_RGB,
    NAN,
    OTHER_VARIANTS,
    as_array,
    bitmap,
    directions,
    evaluate,
    interactions,
    only,
    picture,
    sample,
)
from test_conductor_gradients import (
    assert_agree,
    derivatives,
    eval_result,
    render_result,
    scene_with,
)
from test_conductor_hard_cases import EDGES, INSIDE, METHODS, WI, WO, results

ROUGHNESS = 0.55


def slow(*values: Any) -> Any:
    """Parameters of a test that is not among the quick ones."""
    return pytest.param(*values, marks=pytest.mark.slow)


def rgb(*values: float) -> dict[str, Any]:
    return {"type": "rgb", "value": list(values)}


COPPER = rgb(0.85, 0.55, 0.25)
MIXED = {"base_color": COPPER, "metallic": 0.4}
EDGES_OF_METAL = {
    "usual": {},
    "color": {"edge_color": rgb(0.9, 0.7, 0.5)},
    "nodes": {"edge_color_1": rgb(0.9, 0.7, 0.5), "edge_color_2": 0.6},
    "tint": {"edge_tint": rgb(0.1, 0.5, 0.9)},
}


@pytest.fixture(autouse=True)
def _registered(variant: str) -> None:
    """Every test runs in a variant that knows the plugin, and without Mitsuba's log."""
    mi.set_log_level(mi.LogLevel.Error)
    register()


def principled(**parameters: Any) -> Any:
    """A plugin of some roughness; parameters called with () are made afresh."""
    made = {k: v() if callable(v) else v for k, v in parameters.items()}
    return mi.load_dict({"type": "decomposed_principled", "roughness": ROUGHNESS, **made})


def metal(**parameters: Any) -> Any:
    """The conductor with the lobe of `principled()`."""
    return mi.load_dict(
        {
            "type": "decomposed_conductor",
            "alpha": ROUGHNESS**2,
            "distribution": "ggx",
            **parameters,
        }
    )


def lobe_only(plugin: Any, wi: np.ndarray, wo: np.ndarray, **where: Any) -> np.ndarray:
    """`eval` of the first component."""
    ctx = mi.BSDFContext()
    ctx.type_mask = mi.BSDFFlags.GlossyReflection
    sis, rows = interactions(wi, **where), []
    scalar = "scalar" in mi.variant()
    outgoing = [mi.Vector3f(*w) for w in wo] if scalar else [mi.Vector3f(wo.T.astype("f4"))]
    for si, direction in zip(sis, outgoing, strict=True):
        rows.append(as_array(plugin.eval(ctx, si, direction), len(wi) // len(sis)))
    return np.concatenate(rows)


def fresnel_term(plugin: Any, cos_theta: np.ndarray, **where: Any) -> np.ndarray:
    """(n, channels) Fresnel term: the lobe in mirror directions, relative to one with F = 1."""
    sin = np.sqrt(1.0 - cos_theta**2)
    wi = np.stack([sin, 0.0 * sin, cos_theta], axis=1)
    wo = wi * [-1.0, 1.0, 1.0]
    mirror = metal(c0=1.0, c1=0.0, c2=0.0, c3=0.0)
    return lobe_only(plugin, wi, wo, **where) / evaluate(mirror, wi, wo, **where)


# --- the Fresnel terms ---------------------------------------------------------------------------


def test_numbers_from_first_principles(variant: str) -> None:
    """Copper and concrete at V·H = 0.1 by Schlick's formula."""
    at = np.array([0.1])
    copper = principled(base_color=COPPER, metallic=1.0, fresnel="schlick")
    np.testing.assert_allclose(fresnel_term(copper, at)[0], [0.939, 0.816, 0.693], atol=5e-4)
    concrete = principled(base_color=0.6, metallic=0.0, fresnel="schlick")
    np.testing.assert_allclose(fresnel_term(concrete, at)[0], 0.607, atol=5e-4)


@only(
    ("fresnel", "metallic"),
    [(fresnel, 0.4) for fresnel in FRESNEL]
    + [slow(fresnel, metallic) for fresnel in FRESNEL for metallic in (0.0, 1.0)],
)
def test_terms_are_the_models(fresnel: str, metallic: float, variant: str) -> None:
    base, cosines, basis = np.array([0.85, 0.55, 0.25]), COSINES[:, None], load_basis()
    under = models.model_from_ior(fresnel, 1.5, 0.0)(cosines)
    edge = default_edge_colour(base)
    over = {
        "exact": models.Gulbrandsen(base, 0.5),
        "schlick": models.Schlick(base),
        "f82": models.F82(base, edge),
        "decomposition": models.Decomposition(metal_coefficients(base, edge, basis), basis),
    }[fresnel](cosines)
    got = fresnel_term(principled(base_color=COPPER, metallic=metallic, fresnel=fresnel), COSINES)
    # the decomposition's closed form is within 1e-4 of its basis
    tolerance = 2e-4 if fresnel == "decomposition" else 1e-5
    np.testing.assert_allclose(got, (1 - metallic) * under + metallic * over, atol=tolerance)
    if fresnel != "exact":
        head_on = fresnel_term(principled(base_color=COPPER, metallic=metallic), np.ones(1))
        np.testing.assert_allclose(head_on[0], 0.04 * (1 - metallic) + base * metallic, atol=2e-6)


QUICK = [("decomposition", edge) for edge in EDGES_OF_METAL]
QUICK += [("f82", "nodes"), ("exact", "tint"), ("exact", "color"), ("schlick", "color")]
QUICK += [slow(f, e) for f in FRESNEL for e in EDGES_OF_METAL if (f, e) not in QUICK]


@only(("fresnel", "edge"), QUICK)
def test_edges(fresnel: str, edge: str, variant: str) -> None:
    base = np.array([0.85, 0.55, 0.25])
    parameters = {"base_color": COPPER, "metallic": 1.0, "fresnel": fresnel}
    if fresnel == "exact" and edge in ("color", "nodes"):
        with pytest.raises(RuntimeError, match="do not determine an index"):
            principled(**parameters, **EDGES_OF_METAL[edge])
        return
    got = fresnel_term(principled(**parameters, **EDGES_OF_METAL[edge]), COSINES)
    basis, cosines = load_basis(), COSINES[:, None]
    given = np.array([0.9, 0.7, 0.5])
    tinted = models.Gulbrandsen(base, 0.5 if edge == "usual" else np.array([0.1, 0.5, 0.9]))
    nodes = np.cos(basis.nodes)
    values = {
        "usual": lambda c: metal_reflectance(base, default_edge_colour(base), c),
        "color": lambda c: metal_reflectance(base, given, c),
        "nodes": lambda c: given if c == nodes[0] else 0.6 * np.ones(3),
        "tint": lambda c: tinted(c),
    }[edge]
    c = basis.coefficients_from_reflectance(base, np.stack([values(x) for x in nodes], axis=-1))
    fitted = models.Decomposition(c, basis)
    f82 = fitted(F82_COSINE) if edge == "nodes" else values(F82_COSINE)
    expected = {
        "exact": tinted,
        "schlick": models.Schlick(base),
        "f82": models.F82(base, f82),
        "decomposition": fitted,
    }[fresnel](cosines)
    np.testing.assert_allclose(got, expected, atol=2e-4)


@only("fresnel", ["decomposition", "exact", slow("schlick"), slow("f82")])
def test_metallic_mixes_linearly(fresnel: str, variant: str) -> None:
    """Of the whole BSDF: coefficients are mixed, which mixes curves."""
    wi, wo = directions(24)
    zero, part, one = (
        evaluate(principled(base_color=COPPER, metallic=m, fresnel=fresnel), wi, wo)
        for m in (0.0, 0.3, 1.0)
    )
    np.testing.assert_allclose(part, 0.7 * zero + 0.3 * one, rtol=2e-5, atol=1e-6)


@only(
    ("fresnel", "eta"),
    [("decomposition", 1.33), ("exact", 1.0), ("f82", 2.4)]
    + [slow(fresnel, eta) for fresnel in FRESNEL for eta in (1.0, 1.33, 2.4)],
)
def test_index_and_reflectance_of_the_dielectric_agree(
    fresnel: str, eta: float, variant: str
) -> None:
    f0 = float(dielectric(1.0, eta))
    by_eta = fresnel_term(principled(eta=eta, fresnel=fresnel), COSINES)
    by_f0 = fresnel_term(principled(dielectric_f0=f0, fresnel=fresnel), COSINES)
    np.testing.assert_allclose(by_f0, by_eta, atol=5e-6)
    expected = models.model_from_ior(fresnel, eta, 0.0)(COSINES)
    np.testing.assert_allclose(by_eta[:, 0], expected, atol=2e-4)


@only(("recipe", "terms"), [("talk", 3), ("balanced", 4), ("talk", 6)])
def test_recipes_and_terms(recipe: str, terms: int, variant: str) -> None:
    basis = load_basis(recipe, terms)
    got = fresnel_term(principled(recipe=recipe, terms=terms, base_color=COPPER), COSINES)
    expected = basis.closed_form.evaluate(basis.coefficients(1.5, 0.0), COSINES)
    np.testing.assert_allclose(got[:, 0], expected, atol=3e-6)


# --- the conductor, and Mitsuba's own plugins ----------------------------------------------------

CONDUCTORS = {
    "decomposition": (
        {"edge_color_1": rgb(0.9, 0.7, 0.5), "edge_color_2": 0.6},
        {"f0": COPPER, "f1": rgb(0.9, 0.7, 0.5), "f2": 0.6},
    ),
    "f82": (
        {"edge_color_1": rgb(0.9, 0.7, 0.5), "edge_color_2": 0.6},
        {"f0": COPPER, "f1": rgb(0.9, 0.7, 0.5), "f2": 0.6},
    ),
    "schlick": ({}, {"f0": COPPER, "f1": 0.5, "f2": 0.5}),
    "exact": ({"edge_tint": 0.3}, {"r": COPPER, "g": 0.3}),
}


@only(
    ("fresnel", "distribution", "visible"),
    [
        *((fresnel, "ggx", True) for fresnel in FRESNEL),
        slow("decomposition", "beckmann", True),
        slow("exact", "ggx", False),
        slow("decomposition", "beckmann", False),
    ],
)
def test_metals_are_conductors(
    fresnel: str, distribution: str, visible: bool, variant: str
) -> None:
    shape = {"fresnel": fresnel, "distribution": distribution, "sample_visible": visible}
    ours, theirs = CONDUCTORS[fresnel]
    plugin = principled(base_color=COPPER, metallic=1.0, **ours, **shape)
    other, (wi, wo) = metal(**theirs, **shape), directions(24)
    for method in ("eval", "pdf"):
        got, expected = (evaluate(p, wi, wo, method) for p in (plugin, other))
        np.testing.assert_allclose(got, expected, rtol=2e-6, atol=1e-9)
    u = np.random.default_rng(1).uniform(size=(len(wi), 2))
    got, expected = (sample(p, wi, u) for p in (plugin, other))
    np.testing.assert_array_equal(got[0], expected[0])
    seen = expected[1] > 1e-2
    assert seen.mean() > 0.6
    for values, others in zip(got[1:], expected[1:], strict=True):
        # the conductor's come from the sampled normal, ours from the half vector
        np.testing.assert_allclose(values[seen], others[seen], rtol=5e-3)


@LLVM_RGB
def test_pictures_of_metals_are_those_of_conductors(variant: str) -> None:
    ours, theirs = CONDUCTORS["decomposition"]
    path = {"type": "path", "max_depth": 4, "rr_depth": 5}
    shared = {"base_color": COPPER, "metallic": 1.0, "roughness": 0.5}
    image = picture({"type": "decomposed_principled", **shared, **ours}, 32, 8, path)
    shape = {"alpha": 0.25, "distribution": "ggx"}
    expected = picture({"type": "decomposed_conductor", **shape, **theirs}, 32, 8, path)
    np.testing.assert_allclose(image, expected, rtol=2e-3, atol=1e-4)


def test_smooth_plastics_lobe_is_that_of_roughplastic(variant: str) -> None:
    wi, wo = directions()
    theirs = {"type": "roughplastic", "int_ior": 1.5, "ext_ior": 1.0, "distribution": "ggx"}
    theirs |= {"alpha": ROUGHNESS**2, "diffuse_reflectance": 0.0}
    expected = lobe_only(mi.load_dict(theirs), wi, wo)
    got = lobe_only(principled(eta=1.5, fresnel="exact"), wi, wo)
    np.testing.assert_allclose(got, expected, rtol=2e-4, atol=1e-6)


@only("metallic", [0.0, 1.0])
def test_lobe_is_that_of_mitsubas_principled(metallic: float, variant: str) -> None:
    """Which has the exact term for dielectrics and Schlick's for metals."""
    wi, wo = directions()
    base = {"base_color": COPPER if metallic else 0.0, "metallic": metallic}
    theirs = mi.load_dict({"type": "principled", "roughness": ROUGHNESS, "eta": 1.5, **base})
    ours = principled(eta=1.5, fresnel="schlick" if metallic else "exact", **base)
    expected, got = (evaluate(plugin, wi, wo) for plugin in (theirs, ours))
    np.testing.assert_allclose(got, expected, rtol=5e-4, atol=1e-5)


# --- sampling, reciprocity, energy ---------------------------------------------------------------

SHAPES = {
    "ggx": {},
    "beckmann": {"distribution": "beckmann"},
    "ggx all normals": {"sample_visible": False},
    "beckmann all normals": {"distribution": "beckmann", "sample_visible": False},
}


CHI2 = [("ggx", 0.0, 0.55), ("ggx", 0.4, 0.25), ("beckmann all normals", 0.4, 0.55)]
CHI2 += [
    slow(shape, metallic, roughness)
    for shape in SHAPES
    for metallic in (0.0, 0.4, 1.0)
    for roughness in (0.25, 0.55)
    if (shape, metallic, roughness) not in CHI2
]


@only(("shape", "metallic", "roughness"), CHI2)
@LLVM_RGB
def test_sampling_follows_the_density(
    shape: str, metallic: float, roughness: float, variant: str
) -> None:
    kinds = {str: "string", bool: "boolean", float: "float"}
    values = {"metallic": metallic, "roughness": roughness, "eta": 2.0, **SHAPES[shape]}
    xml = "".join(
        f'<{kinds[type(value)]} name="{name}" value="{str(value).lower()}"/>'
        for name, value in values.items()
    )
    xml += '<rgb name="base_color" value="0.8, 0.5, 0.2"/>'
    draw, pdf = mi.chi2.BSDFAdapter("decomposed_principled", xml, wi=[0.6, 0.0, 0.8])
    test = mi.chi2.ChiSquareTest(
        domain=mi.chi2.SphericalDomain(),
        sample_func=draw,
        pdf_func=pdf,
        sample_dim=3,
        res=101,
        ires=16 if roughness < 0.3 else 8,
        sample_count=200_000,
    )
    assert test.run(), test.messages


@only("shape", SHAPES)
def test_eval_pdf_and_sample_agree(shape: str, variant: str) -> None:
    n = 12 if "scalar" in variant else 64
    plugin, (wi, wo) = principled(**MIXED, **SHAPES[shape]), directions(n)
    value, pdf = (evaluate(plugin, wi, wo, method) for method in ("eval", "pdf"))
    both = evaluate(plugin, wi, wo, "eval_pdf")
    np.testing.assert_array_equal(both, np.column_stack([value, pdf]))
    wo, pdf, weight = sample(plugin, wi, np.random.default_rng(2).uniform(size=(len(wi), 2)))
    valid = pdf > 1e-2
    assert valid.mean() > 0.7
    again = evaluate(plugin, wi, wo, "pdf")
    np.testing.assert_allclose(again[valid], pdf[valid], rtol=1e-5)
    value = evaluate(plugin, wi, wo, "eval")[valid] / again[valid, None]
    np.testing.assert_allclose(value, weight[valid], rtol=1e-5)


RECIPROCAL = [("ggx", "exact"), ("ggx", "decomposition"), ("beckmann", "decomposition")]
RECIPROCAL += [slow(shape, fresnel) for shape in SHAPES for fresnel in FRESNEL[:3]]


@only(("shape", "fresnel"), RECIPROCAL)
def test_reciprocity(shape: str, fresnel: str, variant: str) -> None:
    plugin, (wi, wo) = principled(**MIXED, fresnel=fresnel, **SHAPES[shape]), directions(24)
    there, back = evaluate(plugin, wi, wo), evaluate(plugin, wo, wi)
    np.testing.assert_allclose(there / wo[:, 2:], back / wi[:, 2:], rtol=2e-5, atol=1e-6)


def albedo(plugin: Any, wi: Any, n: int = 100_000, **context: Any) -> np.ndarray:
    """Reflected energy per channel, by the plugin's own sampling of `wi`, LLVM only."""
    rng = np.random.default_rng(4)
    u, ctx = rng.uniform(size=(3, n)).astype("f4"), mi.BSDFContext()
    for name, value in context.items():
        setattr(ctx, name, value)
    si = interactions(np.tile(wi, (n, 1)))[0]
    _, weight = plugin.sample(ctx, si, mi.Float(u[0]), mi.Point2f(u[1:]))
    return as_array(weight, n).mean(axis=0)


ANGLES = ((0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.995, 0.0, 0.0999), (0.9999, 0.0, 0.0141))


FURNACES = [("ggx", "decomposition", 0.1), ("ggx", "exact", 0.55), ("beckmann", "f82", 1.0)]
FURNACES += [
    slow(distribution, fresnel, roughness)
    for distribution in ("ggx", "beckmann")
    for fresnel in FRESNEL
    for roughness in (0.1, 0.55, 1.0)
    if (distribution, fresnel, roughness) not in FURNACES
]


@only(("distribution", "fresnel", "roughness"), FURNACES)
@LLVM_RGB
def test_white_furnace(distribution: str, fresnel: str, roughness: float, variant: str) -> None:
    """A white base gives all light back; half of it metal, and coloured, no more."""
    shape = {"distribution": distribution, "fresnel": fresnel, "roughness": roughness}
    for wi in ANGLES:
        white = albedo(principled(base_color=1.0, **shape), wi)
        # 3e-3 noise; at 89 degrees the table is interpolated over a steep rise, see the page
        np.testing.assert_allclose(white, 1.0, atol=0.02 if wi[2] < 0.05 else 6e-3)
        mixed = albedo(principled(base_color=1.0, metallic=0.5, **shape), wi)
        assert np.all(mixed <= 1.0 + 6e-3)
        copper = albedo(principled(base_color=COPPER, metallic=0.5, **shape), wi)
        assert np.all(copper < mixed)
        assert np.all(copper > 0.0)


@only("fresnel", ["decomposition", slow("exact"), slow("schlick"), slow("f82")])
@LLVM_RGB
def test_white_metal_gives_what_one_bounce_gives(fresnel: str, variant: str) -> None:
    """No base is under a metal: of a white one, the albedo of F = 1 is left."""
    edge = {"edge_tint": 1.0} if fresnel == "exact" else {"edge_color": 1.0}
    plugin = principled(base_color=1.0, metallic=1.0, fresnel=fresnel, **edge)
    for wi in ANGLES[:3]:
        one = directional_albedo(lambda c: np.ones((*np.shape(c), 1)), wi[2], ROUGHNESS**2)
        np.testing.assert_allclose(albedo(plugin, wi), float(one[..., 0]), atol=4e-3)


@only("fresnel", ["decomposition", "f82"])
@LLVM_RGB
def test_weights_are_bounded_where_a_lobe_is_negative(fresnel: str, variant: str) -> None:
    """Fits of a dielectric that is hardly there fall below 0; they are drawn often enough."""
    plugin = principled(base_color=1.0, dielectric_f0=0.0, fresnel=fresnel, roughness=0.1)
    rng, n = np.random.default_rng(6), 20_000
    for cosine in (0.02, 0.1, 0.3, 0.7):
        wi = (np.sqrt(1.0 - cosine**2), 0.0, cosine)
        si = interactions(np.tile(wi, (n, 1)))[0]
        u = rng.uniform(size=(3, n)).astype("f4")
        _, weight = plugin.sample(mi.BSDFContext(), si, mi.Float(u[0]), mi.Point2f(u[1:]))
        assert np.abs(as_array(weight, n)).max() < 12.0  # 900, where its albedo was clamped at 0


@only("fresnel", ["decomposition", "exact", slow("schlick"), slow("f82")])
@LLVM_RGB
def test_base_receives_what_the_lobe_leaves(fresnel: str, variant: str) -> None:
    """Both albedos against quadrature of the model's own curve, which knows no table."""
    model = models.model_from_ior(fresnel, 1.5, 0.0)
    plugin = principled(base_color=0.5, eta=1.5, fresnel=fresnel)
    for wi in ANGLES[:3]:
        lobe = directional_albedo(lambda c: model(c)[..., None], wi[2], ROUGHNESS**2)[..., 0]
        only_lobe = albedo(plugin, wi, type_mask=mi.BSDFFlags.GlossyReflection)
        only_base = albedo(plugin, wi, type_mask=mi.BSDFFlags.DiffuseReflection)
        np.testing.assert_allclose(only_lobe, lobe, atol=3e-3)
        np.testing.assert_allclose(only_base, 0.5 * (1.0 - lobe), atol=3e-3)


@only("functions", [Schlick.functions, F82.functions, load_basis().closed_form])
def test_averages_are_integrals(functions: Any, variant: str) -> None:
    table = AlbedoTable.bake(functions, size=(64, 3))
    averages = cosine_average(table)
    mu = (np.arange(200_000) + 0.5) / 200_000
    for row, alpha in enumerate(table.layout.alpha):
        expected = (2.0 * mu[:, None] * table.lookup(mu, alpha)).mean(axis=0)
        np.testing.assert_allclose(averages[row], expected, atol=1e-7)
    if functions == Schlick.functions:
        np.testing.assert_allclose(averages[0], [1.0, 1.0 / 21.0], atol=2e-4)


def test_components_can_be_switched_off(variant: str) -> None:
    plugin, (wi, wo) = principled(**MIXED), directions(8)
    assert plugin.component_count() == 2
    flags = mi.BSDFFlags
    for flag in (flags.GlossyReflection, flags.DiffuseReflection, flags.FrontSide):
        assert mi.has_flag(plugin.flags(), flag)
    parts, densities = [], []
    for which in ({"type_mask": flags.GlossyReflection}, {"component": 1}, {"component": 7}):
        ctx = mi.BSDFContext()
        for name, value in which.items():
            setattr(ctx, name, value)
        rows = []
        si, direction = interactions(wi[:1])[0], mi.Vector3f(*wo[0].tolist())
        rows = [as_array(plugin.eval(ctx, si, direction), 1)]
        densities.append(as_array(plugin.pdf(ctx, si, direction), 1))
        parts.append(rows[0])
        _, weight = plugin.sample(ctx, si, 0.3, mi.Point2f(0.3, 0.6))
        assert np.all(np.array(weight) > 0.0) == (which != {"component": 7})
    np.testing.assert_allclose(parts[0] + parts[1], evaluate(plugin, wi[:1], wo[:1]), rtol=1e-6)
    np.testing.assert_allclose(densities[1], wo[0, 2] / np.pi, rtol=1e-5)
    assert not np.any(parts[2])
    assert not np.any(densities[2])


# --- textures, spectra, polarisation -------------------------------------------------------------


def image(low: float, high: float, channels: int = 1) -> Any:
    return bitmap(np.random.default_rng(7).uniform(low, high, (2, 3, channels)))


TEXTURED = {
    "base_color": image(0.1, 0.9, 3),
    "metallic": image(0.0, 1.0),
    "roughness": image(0.3, 0.8),
    "dielectric_f0": image(0.02, 0.2),
    "eta": image(1.2, 2.0),
    "edge_color": image(0.4, 0.9, 3),
    "edge_color_2": image(0.4, 0.9, 3),
    "edge_tint": image(0.0, 1.0, 3),
}


@only("variant", ["llvm_ad_rgb", slow("scalar_rgb")], indirect=True)
@only("name", TEXTURED)
def test_every_parameter_may_be_a_texture(name: str, variant: str) -> None:
    others = {**MIXED, **({"edge_color_1": 0.8} if name == "edge_color_2" else {})}
    plugin, (wi, wo) = principled(**{**others, name: TEXTURED[name]}), directions(6)
    texels = np.array(TEXTURED[name]()["data"]).astype(float)
    for y, x in ((0, 0), (1, 2)):
        value = texels[y, x].tolist()
        uniform = value[0] if len(value) == 1 else rgb(*value)
        where = {"uv": ((x + 0.5) / 3, (y + 0.5) / 2)}
        expected = evaluate(principled(**{**others, name: uniform}), wi, wo, **where)
        np.testing.assert_allclose(evaluate(plugin, wi, wo, **where), expected, rtol=2e-4)


@LLVM_RGB
def test_colours_may_be_textures_of_any_kind(variant: str) -> None:
    board = {"type": "checkerboard", "color0": COPPER, "color1": 0.2}
    plugin, (wi, wo) = principled(base_color=board, edge_color=board), directions(12)
    for uv, colour in (((0.2, 0.2), COPPER), ((0.7, 0.2), 0.2)):
        uniform = principled(base_color=colour, edge_color=colour)
        where = {"uv": uv}
        found, expected = (evaluate(p, wi, wo, **where) for p in (plugin, uniform))
        np.testing.assert_allclose(found, expected, rtol=2e-5)
    # only on a mesh can the other kind be looked up
    attribute = {"type": "mesh_attribute", "name": "vertex_color"}
    principled(base_color=attribute, edge_color=attribute)


@BOTH_SPECTRAL
def test_colour_images_in_spectral_variants(variant: str) -> None:
    texels = np.random.default_rng(7).uniform(0.1, 0.9, (2, 3, 3)).astype("f4")
    picture = {"type": "bitmap", "bitmap": mi.Bitmap(texels)}
    plugin, (wi, wo) = principled(base_color=picture), directions(4)
    value = evaluate(plugin, wi, wo, uv=(0.2, 0.3))
    assert np.all(value > 0.0)
    assert np.ptp(value, axis=1).max() > 1e-3  # it has a colour


@BOTH_SPECTRAL
def test_dispersion(variant: str) -> None:
    wavelengths = (420.0, 500.0, 580.0, 700.0)
    glass = {"type": "irregular", "wavelengths": "360, 830", "values": "1.6, 1.4"}
    got = fresnel_term(principled(eta=glass), COSINES, wavelengths=wavelengths)
    eta = np.interp(wavelengths, (360, 830), (1.6, 1.4))
    expected = models.Decomposition.from_ior(eta, 0.0)(COSINES[:, None])
    np.testing.assert_allclose(got, expected, atol=3e-4)


@only(
    "variant",
    [v if "polarized" not in v else slow(v) for v in OTHER_VARIANTS],
    indirect=True,
)
def test_other_variants_agree_on_greys(variant: str) -> None:
    """Greys are the same in RGB, spectral and monochromatic variants, polarised or not."""
    wi, wo = directions(6)
    parameters = {"base_color": 0.6, "metallic": 0.3}
    values = {
        fresnel: evaluate(principled(fresnel=fresnel, **parameters), wi, wo) for fresnel in FRESNEL
    }
    u = np.random.default_rng(3).uniform(size=(len(wi), 2))
    drawn = sample(principled(**parameters), wi, u)
    before = mi.variant()
    mi.set_variant("scalar_rgb")
    register()
    for fresnel, value in values.items():
        expected = evaluate(principled(fresnel=fresnel, **parameters), wi, wo)[:, :1]
        np.testing.assert_allclose(value, expected * np.ones_like(value), rtol=1e-4, atol=1e-6)
    for got, expected in zip(drawn, sample(principled(**parameters), wi, u), strict=True):
        expected = expected[:, :1] if expected.shape != got.shape else expected
        np.testing.assert_allclose(got, expected * np.ones_like(got), rtol=1e-4, atol=1e-5)
    mi.set_variant(before)


@only("variant", [slow("llvm_ad_spectral_polarized"), "scalar_spectral_polarized"], indirect=True)
def test_polarisation(variant: str) -> None:
    (wi, wo), ctx = directions(1), mi.BSDFContext()
    si, direction = interactions(wi)[0], mi.Vector3f(*wo[0].tolist())

    def matrix(plugin: Any) -> np.ndarray:
        return np.array(plugin.eval(ctx, si, direction)).reshape(4, 4, -1)

    fitted = matrix(principled(base_color=0.6, metallic=0.4))
    assert np.count_nonzero(fitted) == fitted[0, 0].size
    metallic = {"base_color": 0.6, "edge_tint": 0.3, "metallic": 1.0, "fresnel": "exact"}
    expected = matrix(metal(r=0.6, g=0.3, fresnel="exact"))
    assert np.count_nonzero(expected) > fitted[0, 0].size
    np.testing.assert_allclose(matrix(principled(**metallic)), expected, rtol=1e-4, atol=1e-7)
    # the base depolarises, the lobe above it does not
    plastic = matrix(principled(base_color=0.6, fresnel="exact"))
    bare = matrix(principled(base_color=0.0, fresnel="exact"))
    assert np.all(plastic[0, 0] > bare[0, 0])
    np.testing.assert_allclose(plastic.reshape(16, -1)[1:], bare.reshape(16, -1)[1:], atol=1e-7)


# --- parameters ----------------------------------------------------------------------------------


def test_parameters_are_exposed(variant: str) -> None:
    params = mi.traverse(principled(eta=1.5, edge_color=0.8))
    names = {"base_color", "metallic", "roughness", "eta", "edge_color"}
    assert {f"{name}.value" for name in names} <= set(params.keys())
    assert params.flags("roughness.value") & mi.ParamFlags.Discontinuous
    assert params.flags("base_color.value") & mi.ParamFlags.Discontinuous == 0


@only("fresnel", FRESNEL)
def test_updates(fresnel: str, variant: str) -> None:
    plugin, (wi, wo) = principled(fresnel=fresnel), directions(6)
    params = mi.traverse(plugin)
    new = {"base_color": 0.7, "metallic": 0.2, "roughness": 0.4, "dielectric_f0": 0.1}
    for name, value in new.items():
        params[f"{name}.value"] = mi.Float(value)
    params.update()
    expected = evaluate(principled(fresnel=fresnel, **new), wi, wo)
    np.testing.assert_allclose(evaluate(plugin, wi, wo), expected, rtol=1e-6)


def test_bad_updates_are_refused(variant: str) -> None:
    bad = {"base_color": 1.1, "metallic": -0.1, "roughness": NAN, "dielectric_f0": 1.0}
    for name, value in bad.items():
        params = mi.traverse(principled())
        params[f"{name}.value"] = mi.Float(value)
        with pytest.raises((InputError, RuntimeError), match=f"parameter {name}="):
            params.update()


@LLVM_RGB
def test_frozen_functions(variant: str) -> None:
    plugin, (wi, wo) = principled(), directions(4)
    params = mi.traverse(plugin)
    si, wo_ = interactions(wi)[0], mi.Vector3f(wo.T.astype("f4"))

    def value(si: Any, wo: Any, name: str, number: Any) -> Any:
        params[f"{name}.value"] = number
        params.update()
        return plugin.eval(mi.BSDFContext(), si, wo)

    frozen = dr.freeze(value)
    for metallic in (0.1, 0.5, 0.9):
        got = as_array(frozen(si, wo_, "metallic", dr.opaque(mi.Float, metallic)), 4)
        expected = evaluate(principled(metallic=metallic), wi, wo)
        np.testing.assert_allclose(got, expected, rtol=1e-5)
    with pytest.raises(RuntimeError) as raised:
        dr.freeze(value)(si, wo_, "dielectric_f0", dr.opaque(mi.Float, 0.05))
    assert "outside of it" in str(raised.value.__cause__)


def test_to_string(variant: str) -> None:
    text = str(principled(recipe="notebook", terms=5))
    for line in (
        "DecomposedPrincipled[",
        "fresnel = decomposition",
        "recipe = notebook",
        "terms = 5",
        "distribution = ggx",
        "base_color = UniformSpectrum",
        "dielectric_f0 = UniformSpectrum",
    ):
        assert line in text


@only(
    ("parameters", "message"),
    [
        ({"fresnel": "Schlick"}, "'schlick'"),
        ({"distribution": "phong"}, "'ggx'"),
        ({"recipe": "tlak"}, "'talk'"),
        ({"terms": 9}, "3, 4, 5 or 6"),
        ({"eta": 1.5, "dielectric_f0": 0.04}, "both eta and dielectric_f0"),
        ({"eta": 0.8}, "eta=0.8; accepted: finite values >= 1"),
        ({"eta": NAN}, "eta=nan"),
        ({"dielectric_f0": 1.0}, r"dielectric_f0=1; accepted: values in \[0, 1\)"),
        ({"base_color": 1.5}, r"base_color=1.5; accepted: values in \[0, 1\]"),
        ({"metallic": -0.5}, "metallic=-0.5"),
        ({"roughness": 1.01}, "roughness=1.01"),
        ({"edge_color": 2.0}, "edge_color=2"),
        ({"edge_color_1": 0.5}, "edge_color_1 \\+ edge_color_2"),
        ({"edge_color": 0.5, "edge_tint": 0.5}, "edge_color, edge_tint"),
        ({"edge_color_1": 0.5, "edge_color_2": 1.5}, "edge_color_2=1.5"),
        ({"edge_tint": -1.0}, "edge_tint=-1"),
        ({"alpha": 0.1}, "alpha"),
        ({"metalic": 0.1}, "metalic"),
    ],
)
def test_bad_input(parameters: dict[str, Any], message: str, variant: str) -> None:
    with pytest.raises(RuntimeError, match=message):
        principled(**parameters)


# --- limits --------------------------------------------------------------------------------------

LIMITS = {
    "plastic": {"base_color": 0.5},
    "metal": {"base_color": COPPER, "metallic": 1.0},
    "mixed": MIXED,
    "black": {"base_color": 0.0, "dielectric_f0": 0.0},
    "white": {"base_color": 1.0, "metallic": 0.5, "dielectric_f0": 0.999},
    "tinted": {"base_color": rgb(0.0, 0.5, 1.0), "metallic": 0.5, "edge_tint": rgb(0.0, 0.5, 1.0)},
}
FITS = [(case, "decomposition") for case in LIMITS]
FITS += [(case, fresnel) for case in ("black", "white", "tinted") for fresnel in FRESNEL[:3]]


@LLVM_RGB
@only(
    ("case", "fresnel", "visible"),
    [("tinted", "decomposition", True), ("black", "exact", True), ("white", "exact", False)]
    + [slow(*fit, visible) for fit in FITS for visible in (True, False)],
)
def test_values_are_finite_and_one_sided(
    case: str, fresnel: str, visible: bool, variant: str
) -> None:
    for roughness in (0.0, 0.1, 1.0):
        shape = {"roughness": roughness, "sample_visible": visible, "fresnel": fresnel}
        plugin = principled(**LIMITS[case], **shape)
        found = {method: results(plugin, method, EDGES) for method in METHODS}
        for method, values in found.items():
            for i, value in enumerate(values):
                array = np.array(value)
                assert np.isfinite(array).all(), (method, i, roughness)
                # fits of an index near 1 leave [0, 1], as the page says; densities never do
                signed = case == "black" and fresnel in ("decomposition", "f82") and i == 0
                signed &= method != "pdf"
                if not (method == "sample" and i == 2) and not signed:
                    assert (array >= -1e-6 * array.max()).all(), (method, i, roughness)
        below = (WI[:, 2] <= 0.0) | (WO[:, 2] <= 0.0)
        assert not np.array(found["eval"][0])[:, below].any()
        assert not np.array(found["pdf"][0])[below].any()
        _, pdf, wo = (np.array(value) for value in found["sample"])
        assert not pdf[np.repeat(WI[:, 2] <= 0.0, len(EDGES))].any()
        np.testing.assert_allclose(np.linalg.norm(wo, axis=0)[pdf > 0.0], 1.0, atol=1e-4)


KEYS = {
    "base_color.value": {"base_color": rgb(0.0, 0.5, 1.0), "metallic": 0.5},
    "metallic.value": {"base_color": rgb(0.0, 0.5, 1.0), "metallic": 1.0},
    "roughness.value": MIXED,
    "dielectric_f0.value": {"dielectric_f0": 0.0, "base_color": 0.5},
    "edge_tint.value": {"edge_tint": rgb(0.0, 0.5, 1.0), "base_color": COPPER, "metallic": 1.0},
}


ATTACHED = [
    ("roughness.value", "decomposition", "eval", "forward"),
    ("dielectric_f0.value", "exact", "eval", "backward"),
]
ATTACHED += [
    slow(key, fresnel, method, mode)
    for key in KEYS
    for fresnel in FRESNEL
    for method in ("eval", "sample")
    for mode in ("forward", "backward")
    if (key, fresnel, method, mode) not in ATTACHED
]


@LLVM_RGB
@only(("key", "fresnel", "method", "mode"), ATTACHED)
def test_derivatives_are_finite(
    key: str, fresnel: str, method: str, mode: str, variant: str
) -> None:
    for roughness in (0.05, 1.0):
        for i in range({"sample": 2}.get(method, 1)):
            shape = {"fresnel": fresnel, "roughness": roughness}
            plugin = principled(**{**KEYS[key], **shape})
            params = mi.traverse(plugin)
            value = type(params[key])(params[key])
            dr.enable_grad(value)
            params[key] = value
            params.update()
            result = results(plugin, method, INSIDE)[i]
            if not dr.grad_enabled(result):
                continue
            if mode == "forward":
                dr.forward(value)
                gradient = np.array(dr.grad(result))
            else:
                dr.backward(result)
                gradient = np.array(dr.grad(value))
            assert np.isfinite(gradient).all(), (fresnel, roughness, method, i)


# --- derivatives ---------------------------------------------------------------------------------


def drawn(low: float, high: float, channels: int = 3) -> Any:
    return lambda: {**bitmap(np.random.default_rng(0).uniform(low, high, (4, 4, channels)))()}


GRADIENTS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "colours": (
        {**MIXED, "edge_color": rgb(0.9, 0.7, 0.5), "dielectric_f0": 0.2},
        ("base_color.value", "metallic.value", "edge_color.value", "dielectric_f0.value"),
    ),
    "images": (
        {"base_color": drawn(0.2, 0.8), "metallic": drawn(0.2, 0.8, 1), "roughness": 0.6},
        ("base_color.data", "metallic.data"),
    ),
    "nodes": (
        {"metallic": 0.5, "edge_color_1": 0.7, "edge_color_2": 0.6, "eta": 1.5},
        ("edge_color_1.value", "edge_color_2.value", "eta.value"),
    ),
    "tint": ({**MIXED, "edge_tint": 0.5}, ("edge_tint.value", "base_color.value")),
}
RUNS = [
    (case, fresnel, key)
    for case, (_, keys) in GRADIENTS.items()
    for fresnel in (FRESNEL if case == "tint" else ("decomposition",))
    for key in keys
    if (fresnel, key) != ("schlick", "edge_tint.value")  # which it ignores
]


def fresh(parameters: dict[str, Any]) -> dict[str, Any]:
    return {k: v() if callable(v) else v for k, v in parameters.items()}


DERIVATIVES = [
    *(("colours", "decomposition", f"{name}.value") for name in ("base_color", "roughness")),
    *(("images", "decomposition", key) for key in GRADIENTS["images"][1]),
    ("nodes", "decomposition", "eta.value"),
    ("tint", "exact", "edge_tint.value"),
]
DERIVATIVES += [slow(*run) for run in RUNS if run not in DERIVATIVES]


@LLVM_RGB
@only(("case", "fresnel", "key"), DERIVATIVES)
def test_derivatives_of_eval(case: str, fresnel: str, key: str, variant: str) -> None:
    plugin = principled(fresnel=fresnel, **fresh({"roughness": 0.7, **GRADIENTS[case][0]}))
    difference, reverse, forward = derivatives(mi.traverse(plugin), key, eval_result(plugin))
    assert abs(difference) > 1e-3
    # the curve over roughness bends: a difference of 0.01 errs by 3e-3
    rtol = 5e-3 if key == "roughness.value" else 1e-3
    assert reverse == pytest.approx(difference, rel=rtol)
    assert forward == pytest.approx(reverse, rel=1e-4)


@pytest.mark.slow
@LLVM_RGB
@only(("case", "fresnel", "key"), RUNS)
def test_derivatives_of_renders(case: str, fresnel: str, key: str, variant: str) -> None:
    """With samples of the light only: the BSDF's own move with its colours.

    They choose between lobe and base, and `prb` detaches them; differences would move them.
    """
    parameters = {"type": "decomposed_principled", "fresnel": fresnel, "roughness": 0.6}
    lights_only = {"type": "direct", "emitter_samples": 2, "bsdf_samples": 0}
    scene = scene_with(parameters | fresh(GRADIENTS[case][0]), lights_only)
    params = mi.traverse(scene)
    found = [name for name in params.keys() if name.endswith(".bsdf." + key)]  # noqa: SIM118
    assert_agree(derivatives(params, found[0], render_result(scene, params)))

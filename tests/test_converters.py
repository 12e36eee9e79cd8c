"""Every parametrization to every other: values, losses, gradients, and what has no counterpart."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import (
    F82,
    Exact,
    Gulbrandsen,
    InputError,
    Schlick,
    f0_from_ior,
    ior_to_gulbrandsen,
    load_basis,
    load_material,
)
from fresnel_decomp.colour import delta_e_2000
from fresnel_decomp.converters import LARGEST_R, TARGETS, convert, loss
from fresnel_decomp.representations import Curve, LinearTint, MetallicBase, NodeColours
from oracles import textbook

BASIS = load_basis("notebook")
DEGREES = np.linspace(0.0, 90.0, 181)
COSINES = np.cos(np.radians(DEGREES))
METAL = Exact(np.array([0.2, 0.92, 1.1]), np.array([3.9, 2.45, 2.14]))


def values(model) -> dict[str, np.ndarray]:
    """Parameters of a model, without its basis."""
    names = [n for n in model.__dataclass_fields__ if n not in ("basis", "name", "precision")]
    return {n: np.asarray(getattr(model, n), float) for n in names if n != "substitute"}


def random_metals(n: int = 40) -> Exact:
    rng = np.random.default_rng(3)
    r, g = rng.uniform(0.1, 0.98, n), rng.uniform(0.05, 1.0, n)
    return convert(Gulbrandsen(r, g), "indices").value


# --- values --------------------------------------------------------------------------------------


def test_each_target_of_an_index():
    eta, k = METAL.eta, METAL.k
    f = {c: sum(textbook(c, eta, k)) / 2.0 for c in (1.0, 1.0 / 7.0)}
    nodes = np.stack([sum(textbook(np.cos(t), eta, k)) / 2.0 for t in BASIS.nodes], axis=-1)
    made = {to: convert(METAL, to, basis=BASIS, no_counterpart="nearest").value for to in TARGETS}
    np.testing.assert_allclose(
        [made["gulbrandsen"].r, made["gulbrandsen"].g], ior_to_gulbrandsen(eta, k)
    )
    np.testing.assert_allclose([made["f82"].f0, made["f82"].f82], [f[1.0], f[1.0 / 7.0]])
    np.testing.assert_allclose(made["nodes"].f0, f[1.0])
    np.testing.assert_allclose(made["nodes"].f_nodes, nodes)
    np.testing.assert_allclose(made["coefficients"].coefficients, BASIS.coefficients(eta, k))
    np.testing.assert_allclose(made["metallic_base"].base_colour, f[1.0])
    assert made["indices"] is METAL


def test_linear_tint_is_the_notebooks():
    """Its coefficients are on the line between those of g = 0 and g = 1."""
    r, beta = np.array([0.2, 0.5, 0.9]), np.array([0.0, 0.75, 1.0])
    ends = [
        BASIS.coefficients(
            *values(convert(Gulbrandsen(r, np.full(3, g)), "indices").value).values()
        )
        for g in (0.0, 1.0)
    ]
    got = LinearTint(r, beta, BASIS)
    np.testing.assert_allclose(
        got.coefficients, (1.0 - beta)[:, None] * ends[0] + beta[:, None] * ends[1], rtol=1e-13
    )
    for g, end in zip((0.0, 1.0), ends, strict=True):
        found = convert(Gulbrandsen(r, np.full(3, g)), "linear_tint", basis=BASIS).value
        np.testing.assert_allclose(found.beta, g, atol=1e-9)
        np.testing.assert_allclose(found.coefficients, end, atol=1e-9)
    # no other beta of that reflectivity is closer, by the RMSE over cosines
    source = random_metals(12)
    best = convert(source, "linear_tint", basis=BASIS, no_counterpart="nearest").value
    mu = (np.arange(512) + 0.5)[:, None] / 512.0
    fitted = BASIS.evaluate(BASIS.coefficients(source.eta, source.k), mu)

    def error(step: float) -> np.ndarray:
        model = LinearTint(best.r, best.beta + step, BASIS)
        return ((model(mu) - fitted) ** 2).mean(axis=0)

    inside = (best.beta > 0.01) & (best.beta < 0.99)
    assert inside.sum() > 8
    assert (error(0.0)[inside] <= error(0.01)[inside]).all()
    assert (error(0.0)[inside] <= error(-0.01)[inside]).all()


def test_metallic():
    made = convert(METAL, "metallic_base", metallic=0.5, no_counterpart="nearest")
    assert made.moved.tolist() == [True, True, False]  # 0.02 + 0.5 base colour is at most 0.52
    free = convert(Schlick(np.array([0.1, 0.3])), "metallic_base", metallic=0.5)
    np.testing.assert_allclose(free.value.f0, [0.1, 0.3], rtol=1e-14)
    np.testing.assert_allclose(free.value.base_colour, [0.16, 0.56], rtol=1e-14)
    assert free.loss.max.max() < 1e-15
    with pytest.raises(InputError, match=r"metallic=0\.0; accepted: a number in \(0, 1\]"):
        convert(METAL, "metallic_base", metallic=0.0)
    with pytest.raises(InputError, match=r"metallic=array"):
        convert(METAL, "metallic_base", metallic=np.array([0.5, 1.0]))


def test_round_trips_that_lose_nothing():
    source = random_metals()
    for there, back in itertools.product(("gulbrandsen", "indices"), repeat=2):
        way = convert(convert(source, there).value, back)
        assert way.loss.max.max() < 1e-12
    for to in ("nodes", "coefficients"):
        first = convert(source, to, basis=BASIS).value
        again = convert(convert(first, "nodes").value, "coefficients")
        assert again.loss.max.max() < 1e-12
    # a curve of (r, g) known at two angles only: the equation is solved
    sampled = Curve(lambda c: np.asarray(source(c[:, None])))
    found = convert(sampled, "gulbrandsen").value
    np.testing.assert_allclose(found.r, f0_from_ior(source.eta, source.k), rtol=1e-12)
    # where F hardly changes with g, g is known to as many digits less
    np.testing.assert_allclose(found.g, convert(source, "gulbrandsen").value.g, atol=1e-7)


@pytest.mark.parametrize(("start", "to"), list(itertools.product(TARGETS, TARGETS)))
def test_every_way(start, to):
    """It ends in the right kind, with the loss of its curve, whatever the shape."""
    source = convert(METAL, start, basis=BASIS, no_counterpart="nearest").value
    result = convert(source, to, basis=BASIS, no_counterpart="nearest")
    assert result.value.name == to.removesuffix("_tint" if to == "f82_tint" else "").replace(
        "coefficients", "decomposition"
    ).replace("indices", "exact")
    a, b = source(COSINES[:, None]), result.value(COSINES[:, None])
    np.testing.assert_allclose(result.loss.max, np.abs(a - b).max(axis=0), atol=1e-14)
    np.testing.assert_allclose(result.loss.rmse, np.sqrt(((a - b) ** 2).mean(0)), atol=1e-14)
    delta_e = delta_e_2000(a, b)
    assert result.loss.delta_e_mean == pytest.approx(delta_e.mean(), abs=1e-9)
    assert result.loss.delta_e_max == pytest.approx(delta_e.max(), abs=1e-9)
    if to == start:
        assert result.loss.max.max() < 1e-9

    single = convert(METAL.__class__(0.92, 2.45), start, basis=BASIS, no_counterpart="nearest")
    scalar = convert(single.value, to, basis=BASIS, no_counterpart="nearest")
    assert np.ndim(scalar.loss.max) == 0
    assert scalar.loss.delta_e_mean is None
    for name, value in values(scalar.value).items():
        many = values(result.value)[name]
        many = many[1] if many.ndim else many
        np.testing.assert_allclose(value, many, atol=1e-9, err_msg=name)


def test_losses_say_what_a_form_can_hold():
    """Worst channel over random metals: the fewer numbers, the greater the loss."""
    source = random_metals(200)
    rmse = {
        to: float(convert(source, to, basis=BASIS, no_counterpart="nearest").loss.rmse.max())
        for to in TARGETS
    }
    assert rmse["gulbrandsen"] < 1e-12
    assert rmse["coefficients"] < rmse["f82"] < rmse["metallic_base"]
    assert rmse["f82"] == rmse["f82_tint"] or rmse["f82_tint"] > rmse["f82"]


# --- what has no counterpart ---------------------------------------------------------------------

NONE = [
    (Exact(0.5, 0.3), "gulbrandsen", r"\|eta \+ i k\| < 1"),
    (Exact(0.5, 0.3), "linear_tint", "total internal reflection|beyond g"),
    (Schlick(1.0), "gulbrandsen", r"F0 outside \[0, 1\)"),
    (Schlick(1.02), "indices", r"F0 outside \[0, 1\)"),
    (Schlick(1.02), "linear_tint", r"F0 outside \[0, 1\)"),
    (F82(0.9, 0.98), "f82_tint", "F82 tint above 1"),
    (F82(0.6, 0.3), "gulbrandsen", "cos = 1/7 beyond"),
    (F82(0.6, 1.0), "linear_tint", "beyond g = 0 or g = 1"),
    (Schlick(1.02), "metallic_base", r"outside \[0, 1\]"),
    (Exact(0.7, 0.0), "coefficients", "total internal reflection"),
]


@pytest.mark.parametrize(("source", "to", "message"), NONE)
def test_no_counterpart(source, to, message):
    with pytest.raises(InputError, match=f"(?:{message}).*accepted.*no_counterpart='nearest'"):
        convert(source, to, basis=BASIS)
    nearest = convert(source, to, basis=BASIS, no_counterpart="nearest")
    assert nearest.moved
    assert nearest.loss.max > 5e-6
    assert np.isfinite(nearest.loss.max)


def test_nearest_values():
    assert convert(F82(0.9, 0.98), "f82_tint", no_counterpart="nearest").value.tint == 1.0
    assert convert(Schlick(1.02), "gulbrandsen", no_counterpart="nearest").value.r == LARGEST_R
    assert convert(Exact(0.5, 0.3), "gulbrandsen", no_counterpart="nearest").value.g == 1.0
    mixed = convert(Schlick(np.array([0.5, 1.2])), "metallic_base", no_counterpart="nearest")
    assert mixed.moved.tolist() == [False, True]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(("f28",), "Did you mean 'f82'"), (("f82",), "no_counterpart='close'")],
)
def test_bad_arguments(arguments, message):
    options = {"no_counterpart": "close"} if "close" in message else {}
    with pytest.raises(InputError, match=message):
        convert(METAL, *arguments, **options)


@pytest.mark.parametrize("source", [0.5, None, lambda c: c, "Au", Schlick])
def test_what_is_no_model(source):
    for call in (lambda: convert(source, "f82"), lambda: loss(METAL, source)):
        with pytest.raises(InputError, match=r"model of reflectance; accepted.*Curve\(function\)"):
            call()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.5, 2.0), r"metallic = 2; accepted: values in \[0, 1\]"),
        ((0.5, np.nan), "metallic = nan"),
        (([0.2, -0.1, 0.3],), "base_colour = -0.1"),
        ((1.02,), r"Schlick\(f0\)"),
    ],
)
def test_metallic_base_range(arguments, message):
    with pytest.raises(InputError, match=message):
        MetallicBase(*arguments)


def test_colours_outside_of_the_gamut_are_kept():
    """A negative channel is a colour that the space cannot hold, which F82 can express."""
    source = Schlick(np.array([-0.1, 0.5, 1.02]))
    made = convert(source, "f82")
    np.testing.assert_array_equal(made.value.f0, source.f0)
    assert not np.any(made.moved)
    assert made.loss.max.max() < 1e-15


# --- sources of other kinds ----------------------------------------------------------------------


def test_spectral_curve():
    gold = load_material("Au")
    result = convert(Curve(gold.rgb_reflectance), "coefficients", basis=BASIS)
    np.testing.assert_allclose(
        result.value.coefficients, gold.rgb_coefficients(BASIS), rtol=0.0, atol=1e-14
    )
    exact, fitted = gold.rgb_reflectance(COSINES), result.value(COSINES[:, None])
    assert result.loss.delta_e_max == pytest.approx(delta_e_2000(exact, fitted).max(), rel=1e-6)
    assert Curve(gold.rgb_reflectance)(COSINES[:, None]).shape == (181, 3)
    assert Curve(gold.rgb_reflectance)(0.5).shape == (3,)


@pytest.mark.parametrize("to", TARGETS)
def test_curve_without_channels(to):
    """A scalar cosine gives a scalar, as for the other models."""
    curve = Curve(lambda c: 0.0 * c + 0.5)
    assert np.ndim(curve(0.3)) == 0
    assert curve(COSINES[:, None]).shape == (181, 1)
    result = convert(curve, to, no_counterpart="nearest")
    scalars = values(result.value).keys() - {"coefficients", "f_nodes"}
    assert all(values(result.value)[name].ndim == 0 for name in scalars)
    assert np.ndim(result.loss.max) == 0
    assert float(result.value(1.0)) == pytest.approx(0.5)


def test_page_quotes_the_losses_of_copper():
    copper = Curve(load_material("Cu").rgb_reflectance)
    tint, pair = (
        convert(copper, to, no_counterpart="nearest").loss for to in ("linear_tint", "gulbrandsen")
    )
    numbers = [tint.max.max(), tint.delta_e_mean, pair.max.max(), pair.delta_e_mean]
    largest, mean, *others = (
        f"{number:.{digits}f}".removeprefix("0")
        for number, digits in zip(numbers, (3, 2, 3, 2), strict=True)
    )
    page = (Path(__file__).parent.parent / "docs" / "colour.md").read_text(encoding="utf-8")
    assert (
        f"is off by up to {largest} in reflectance and by a mean ΔE00 of {mean}, against "
        f"{others[0]} and {others[1]} with $(r, g)$"
    ) in " ".join(page.split())


def test_default_basis_is_the_sources():
    nodes = NodeColours(0.5, np.array([0.7, 0.6]), BASIS)
    assert convert(nodes, "coefficients").value.basis is BASIS
    assert convert(Schlick(0.5), "coefficients").value.basis is load_basis()


# --- Dr.Jit --------------------------------------------------------------------------------------


def as_list(model) -> list:
    parts = []
    for name in model.__dataclass_fields__:
        value = getattr(model, name)
        parts += list(value) if isinstance(value, tuple | list) else [value]
    return [np.array(p) for p in parts if hasattr(p, "state") or type(p).__module__[:6] == "drjit."]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("to", TARGETS)
def test_drjit_agrees_with_numpy(backend, to):
    array = float_type(backend, "float64" if backend != "scalar" else "float32")
    source = random_metals(8)
    expected = convert(source, to, basis=BASIS, no_counterpart="nearest")
    start = Exact(array(source.eta.tolist()), array(source.k.tolist()))
    got = convert(start, to, basis=BASIS, no_counterpart="nearest")
    tolerance = 1e-9 if backend != "scalar" else 2e-4
    np.testing.assert_allclose(got.loss.max, expected.loss.max, atol=tolerance)
    again = convert(got.value, "f82", no_counterpart="nearest")
    np.testing.assert_allclose(np.array(again.value.f82), expected.value(1.0 / 7.0), atol=tolerance)


@pytest.mark.parametrize("backend", AD_BACKENDS)
@pytest.mark.parametrize("to", TARGETS)
@pytest.mark.parametrize("mode", ["forward", "backward"])
@pytest.mark.parametrize("start", ["index", "f82"])
def test_gradients(backend, to, mode, start):
    """Of the reflectance at 70 degrees after conversion, against central differences."""
    import drjit as dr

    array = float_type(backend, "float64")
    at = float(np.cos(np.radians(70.0)))
    points = {
        "index": (np.array([0.3, 1.2, 2.5]), np.array([3.0, 2.4, 3.2])),
        "f82": (np.array([0.5, 0.6, 0.8]), np.array([0.55, 0.66, 0.75])),
    }[start]
    make = {"index": Exact, "f82": F82}[start]

    def number(a, b):
        return convert(make(a, b), to, basis=BASIS, no_counterpart="nearest").value(at)

    for i in range(2):
        arguments = [array(p.tolist()) for p in points]
        dr.enable_grad(arguments[i])
        result = number(*arguments)
        if mode == "forward":
            dr.forward(arguments[i], flags=dr.ADFlag.Default | dr.ADFlag.AllowNoGrad)
            gradient = np.array(dr.grad(result))
        else:
            free = dr.ADFlag.Default | dr.ADFlag.AllowNoGrad  # F0 alone does not depend on f82
            dr.backward(dr.sum(result), flags=free)
            gradient = np.array(dr.grad(arguments[i]))
        h = 1e-5
        shifted = [[p.copy() for p in points] for _ in range(2)]
        shifted[0][i] += h
        shifted[1][i] -= h
        expected = (number(*shifted[0]) - number(*shifted[1])) / (2.0 * h)
        np.testing.assert_allclose(gradient, expected, rtol=1e-4, atol=1e-6)


def test_loss_takes_any_two_models():
    found = loss(Exact(1.5, 0.0), MetallicBase(0.04))
    exact = sum(textbook(COSINES, 1.5, 0.0)) / 2.0
    schlick = 0.04 + 0.96 * (1.0 - COSINES) ** 5
    assert found.max == pytest.approx(np.abs(exact - schlick).max(), rel=1e-9)
    assert found.rmse == pytest.approx(np.sqrt(((exact - schlick) ** 2).mean()), rel=1e-9)

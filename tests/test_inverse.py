"""Inverse rendering: known answers, honest errors, gradients against finite differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from fresnel_decomp import InputError, conductor, ior_to_gulbrandsen, load_basis
from fresnel_decomp.mitsuba import register
from fresnel_decomp.mitsuba.comparison import render_scene
from fresnel_decomp.mitsuba.environment import Environment
from fresnel_decomp.mitsuba.inverse import NonFiniteGradientError, recover, recover_texture
from fresnel_decomp.mitsuba.inverse.gradient import loss_and_gradient
from fresnel_decomp.mitsuba.inverse.images import Images, derived_seed
from fresnel_decomp.mitsuba.inverse.observed import observe
from fresnel_decomp.mitsuba.scenes import lit_object, studio, studio_lights

LLVM_RGB = pytest.mark.parametrize("variant", ["llvm_ad_rgb"], indirect=True)
GOLD = (np.array([0.184, 0.457, 1.372]), np.array([3.066, 2.408, 1.825]))
COSINES = np.linspace(0.0, 1.0, 181)


@pytest.fixture(autouse=True)
def _registered(variant: str) -> None:
    mi.set_log_level(mi.LogLevel.Error)
    register()


def colour(value: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": np.broadcast_to(value, 3).tolist()}


def sphere(view: int, size: int) -> Callable[[dict[str, Any]], dict[str, Any]]:
    light = Environment(np.asarray(studio_lights(128))).turned(26 * view)
    return lambda bsdf: lit_object(bsdf, light.emitter(), size)


def photographs(
    setups: Any, spp: int, alpha: float = 0.1, seed: int = 1000, metal: Any = GOLD
) -> list[np.ndarray]:
    """By Mitsuba's own exact conductor, with random numbers that `recover` does not use."""
    bsdf = {"type": "roughconductor", "eta": colour(metal[0]), "k": colour(metal[1])}
    bsdf |= {"alpha": alpha, "distribution": "ggx"}
    return [
        render_scene(mi.load_dict(setup(dict(bsdf))), spp, seed + i)
        for i, setup in enumerate(setups)
    ]


def curve_error(result: Any, metal: Any = GOLD) -> float:
    exact = conductor(COSINES[:, None], *metal)
    return float(np.abs(result.reflectance(COSINES) - exact).max())


# --- known answers -------------------------------------------------------------------------------


@LLVM_RGB
def test_linear_solve(variant: str) -> None:
    setups = [sphere(i, 24) for i in range(2)]
    images = photographs(setups, 64)
    nodes = recover(images, setups, alpha=0.1, spp=64)
    assert nodes.converged
    assert nodes.iterations == 1
    cosines = np.cos([0.0, *nodes.basis.nodes])[:, None]
    truth = conductor(cosines, *GOLD)
    for i, name in enumerate(("f0", "f1", "f2")):
        error = np.abs(nodes.values[name] - truth[i])
        assert np.all(error < 4.5 * nodes.standard_errors[name] + 5e-4), name
        assert np.all(nodes.identified[name])
    # 1/18 of the pixels and half the samples of the study: F(83°) is known to about .02 here
    assert curve_error(nodes) < 0.06
    index = recover(images, setups, "indices", alpha=0.1, spp=36)
    for name, value in zip(("eta", "k"), GOLD, strict=True):
        error = np.abs(index.values[name] - value)
        assert np.all(error < 4.5 * index.standard_errors[name] + 1e-3), name
    gulbrandsen = recover(images, setups, "gulbrandsen", alpha=0.1, spp=36)
    for name, value in zip(("r", "g"), ior_to_gulbrandsen(*GOLD), strict=True):
        error = np.abs(gulbrandsen.values[name] - value)
        assert np.all(error < 4.5 * gulbrandsen.standard_errors[name] + 1e-3), name
    np.testing.assert_allclose(
        gulbrandsen.reflectance(COSINES), index.reflectance(COSINES), atol=1e-3
    )
    free = recover(images, setups, "coefficients", alpha=0.1, spp=36)
    c = load_basis().coefficients(*GOLD)  # its misfit is spread over the angles: .01
    for i in range(4):
        error = np.abs(free.values[f"c{i}"] - c[:, i])
        assert np.all(error < 4.5 * free.standard_errors[f"c{i}"] + 0.02), i
    again = render_scene(mi.load_dict(setups[0](index.bsdf())), 64, 1000)
    assert np.sqrt(np.mean((again - images[0]) ** 2)) < 0.02 * images[0].mean()


@pytest.mark.slow
@LLVM_RGB
def test_curves_of_five_renders(variant: str) -> None:
    """The bound of the study: .01 on five images of 64 x 64 pixels with 64 samples."""
    setups = [sphere(i, 64) for i in range(5)]
    images = photographs(setups, 64)
    for kind in ("nodes", "indices"):
        assert curve_error(recover(images, setups, kind, alpha=0.1)) < 0.01, kind


@LLVM_RGB
def test_tensors_are_images_and_roughness_is_not_guessed(variant: str) -> None:
    setup = sphere(0, 12)
    image = photographs([setup], 16)[0]
    first = recover(image, setup, alpha=0.1, spp=16)
    for same in (mi.TensorXf(image), mi.Bitmap(image)):
        again = recover(same, setup, alpha=0.1, spp=16)
        np.testing.assert_allclose(again.values["f0"], first.values["f0"], rtol=1e-4)
    with pytest.raises(InputError, match="unknown roughness"):
        recover(image, setup)

    def with_alpha(bsdf: dict[str, Any]) -> dict[str, Any]:
        scene = setup(bsdf)
        scene["sensor"]["film"]["pixel_format"] = "rgba"
        return scene

    with pytest.raises(InputError, match="a film of 4 channels"):
        recover(image, with_alpha, alpha=0.1, spp=4)


@LLVM_RGB
def test_residual_is_that_of_the_result(variant: str) -> None:
    """Images brighter than a perfect mirror's: node colours explain them, no index does."""
    setups = [sphere(i, 16) for i in range(2)]
    images = [2.0 * image for image in photographs(setups, 64)]
    options: dict[str, Any] = {"alpha": 0.1, "spp": 64, "bounds": (0.0, 3.0)}
    nodes = recover(images, setups, **options)
    index = recover(images, setups, "indices", **options)
    assert index.residual > 2.0 * nodes.residual


@LLVM_RGB
def test_descent_sees_the_samples_of_its_errors(variant: str) -> None:
    """The misfit is that of two renderings of `Images`, to which Newton's step belongs."""
    setup = sphere(0, 12)
    image = photographs([setup], 16)
    made = Images([setup], "nodes", load_basis())
    observed = observe(image, made.sizes, None)
    x = np.full((3, 3), 0.6)
    loss, _ = loss_and_gradient(made, observed, x, 0.1, spp=8, seed=5)
    a, b = (observed.values - made.render(x, 0.1, 8, derived_seed(5, half)) for half in (0, 1))
    assert loss == pytest.approx(float(np.sum(observed.weight * a * b)) / observed.count, rel=1e-4)


@LLVM_RGB
def test_same_seed_same_result(variant: str) -> None:
    setup = sphere(0, 16)
    images = photographs([setup], 16)
    first, second, other = (
        recover(images, setup, alpha=0.1, spp=16, seed=s).values for s in (3, 3, 4)
    )
    assert all(np.array_equal(first[name], second[name]) for name in first)
    assert not np.array_equal(first["f0"], other["f0"])


@pytest.mark.slow
@LLVM_RGB
def test_interreflection_is_seen_and_iterated(variant: str) -> None:
    """Light between sphere and plinth meets the sphere twice: images of second order."""

    def setup(bsdf: dict[str, Any]) -> dict[str, Any]:
        scene = studio(bsdf, 24, max_depth=5)
        scene["mirror"] = {  # much of it
            "type": "sphere", "center": [1.7, 1.0, 0.9], "radius": 0.7,
            "bsdf": {"type": "conductor", "material": "none"},
        }  # fmt: skip
        return scene

    images = photographs([setup], 64, alpha=0.2)
    direct = recover(images, setup, alpha=0.2, spp=32, iterations=1)
    assert not direct.converged
    assert "iterations" in direct.message
    result = recover(images, setup, alpha=0.2, spp=32)
    assert result.converged
    assert 2 <= result.iterations <= 6
    truth = conductor(1.0, *GOLD)
    error = np.abs(result.values["f0"] - truth)
    assert np.all(error < 4.5 * result.standard_errors["f0"] + 1e-3)


@LLVM_RGB
def test_masked_pixels_do_not_count(variant: str) -> None:
    """Broken pixels: 0 in the image, infinite noise."""
    setup = sphere(0, 24)
    image = photographs([setup], 64)[0]
    noise = np.full(image.shape[:2], 0.02)
    whole = recover(image, setup, alpha=0.1, spp=32, noise=noise)
    image[9:12], noise[9:12] = 0.0, np.inf
    masked = recover(image, setup, alpha=0.1, spp=32, noise=noise)
    assert np.isfinite(masked.noise)
    assert masked.residual < 1.5 * whole.residual
    # an eighth of the sphere's pixels less: by no more than the errors do they differ
    for name in ("f0", "f1", "f2"):
        bound = 4.0 * masked.standard_errors[name] + 1e-3
        assert np.all(np.abs(masked.values[name] - whole.values[name]) < bound), name


@LLVM_RGB
def test_goes_on_from_a_step(variant: str) -> None:
    """An interrupted descent is taken up where its last `Step` was; both ways end alike."""
    setup = sphere(0, 16)
    images = photographs([setup], 16)
    options: dict[str, Any] = {"route": "gradient", "alpha": 0.1, "spp": 16}
    reached: list[Any] = []

    def interrupt(step: Any) -> None:
        reached.append(step)
        if len(reached) == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        recover(images, setup, progress=interrupt, **options)
    on = recover(images, setup, start=reached[-1].values, **options)
    whole = recover(images, setup, **options)
    assert on.converged
    assert whole.converged
    for name in ("f0", "f1", "f2"):
        bound = 0.5 * whole.standard_errors[name]
        assert np.all(np.abs(on.values[name] - whole.values[name]) < bound), name
    few = recover(images, setup, iterations=3, **options)
    assert not few.converged
    assert "iterations" in few.message
    assert few.iterations == 3


@LLVM_RGB
def test_what_images_do_not_show_is_said(variant: str) -> None:
    """A plane seen from above shows no grazing angle."""

    def setup(bsdf: dict[str, Any]) -> dict[str, Any]:
        scene = lit_object(bsdf, {"type": "constant"}, 8)
        scene["sensor"]["to_world"] = mi.ScalarTransform4f().look_at(
            [0, 0, 9], [0, 0, 0], [0, 1, 0]
        )
        scene["object"] = {"type": "rectangle", "bsdf": bsdf}
        return scene

    result = recover(photographs([setup], 16, 0.05), setup, alpha=0.05, spp=16)
    assert np.all(result.identified["f0"])
    assert not np.any(result.identified["f1"])
    assert "say little about f1" in result.message
    assert np.all((result.coefficients @ load_basis()(COSINES).T) < 1.051)  # but bounded


@pytest.mark.slow
@LLVM_RGB
@pytest.mark.parametrize("start", [0.05, 0.6])
def test_hybrid_finds_roughness(start: float, variant: str) -> None:
    setups = [sphere(i, 32) for i in range(2)]
    images = photographs(setups, 64, alpha=0.2)
    options: dict[str, Any] = {"route": "hybrid", "alpha": start, "roughness": "unknown"}
    result = recover(images, setups, "indices", spp=64, **options)
    assert result.converged
    assert abs(result.alpha - 0.2) < 5.0 * result.standard_errors["alpha"] + 1e-3
    assert curve_error(result) < 0.02


@pytest.mark.slow
@LLVM_RGB
def test_gradient_descent(variant: str) -> None:
    """From a good start it arrives; the exact indices, from a bad one, do not, and say so."""
    setups = [sphere(i, 32) for i in range(2)]
    images = photographs(setups, 64)
    good = recover(images, setups, route="gradient", alpha=0.1, start={"f0": 0.7}, spp=64)
    linear = recover(images, setups, alpha=0.1, spp=64)
    assert good.converged
    assert not good.message
    for name in ("f0", "f1", "f2"):
        spread = np.hypot(good.standard_errors[name], linear.standard_errors[name])
        assert np.all(np.abs(good.values[name] - linear.values[name]) < 4.0 * spread + 0.01), name
    # of all angles these images say least about F(83°): .018
    assert curve_error(good) < 3.0 * good.standard_errors["f1"].max() + 0.01
    stuck = recover(
        images[:1], setups[:1], "indices", route="gradient", fresnel="exact", spp=32, alpha=0.1,
        start={"eta": 4.0, "k": 0.3},
    )  # fmt: skip
    assert curve_error(stuck) > 0.05
    assert not (stuck.converged and np.all([stuck.identified["eta"], stuck.identified["k"]]))
    assert "Start elsewhere" in stuck.message or "start elsewhere" in stuck.message


@pytest.mark.slow
@LLVM_RGB
def test_two_metals(variant: str) -> None:
    mask = np.indices((4, 8)).sum(axis=0) % 2
    metals = (GOLD, (np.array([1.36, 0.88, 0.66]), np.array([7.59, 6.47, 5.65])))

    def bitmap(which: int) -> dict[str, Any]:
        texels = np.where(mask[..., None] == 0, metals[0][which], metals[1][which])
        data = mi.TensorXf(texels.astype(np.float32))
        return {"type": "bitmap", "raw": True, "filter_type": "nearest", "data": data}

    def turned(view: int) -> Any:
        make = sphere(view, 40)

        def setup(bsdf: dict[str, Any]) -> dict[str, Any]:
            scene = make(bsdf)
            about = mi.ScalarTransform4f().rotate([1, 0, 0], -90).rotate([0, 0, 1], 120 * view)
            scene["object"]["to_world"] = about
            return scene

        return setup

    setups = [turned(i) for i in range(3)]
    bsdf = {"type": "roughconductor", "alpha": 0.1, "distribution": "ggx"}
    images = [
        render_scene(mi.load_dict(s({**bsdf, "eta": bitmap(0), "k": bitmap(1)})), 64, 500 + i)
        for i, s in enumerate(setups)
    ]
    truth = np.stack([conductor(1.0, *metal) for metal in metals])[mask]
    result = recover_texture(images, setups, mask.shape, alpha=0.1, spp=64)
    error = np.abs(result.nodes[..., 0] - truth)
    # small images, in which texels share most pixels: errors are as large as they say
    assert result.identified.mean() > 0.5
    assert np.median(error[result.identified]) < 0.02
    assert np.median(error / result.standard_errors[..., 0]) < 1.5
    known = recover_texture(images, setups, mask.shape, alpha=0.1, regions=mask, spp=64)
    assert np.abs(known.nodes[..., 0] - truth).max() < 0.01
    again = recover_texture(images, setups, mask.shape, alpha=0.1, regions=mask, spp=64)
    assert np.array_equal(known.nodes, again.nodes)


# --- gradients -----------------------------------------------------------------------------------


class SplitRoughness:
    """A conductor that samples with one roughness and reflects with another: detached sampling."""

    @staticmethod
    def register() -> None:
        def init(self: Any, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            common = {name: props[name] for name in ("eta", "k")}
            self.reflecting, self.sampling = (
                mi.load_dict({"type": "decomposed_conductor", "distribution": "ggx", **common,
                              "fresnel": "exact", "alpha": float(props[name])})
                for name in ("alpha", "alpha_sampled")
            )  # fmt: skip
            self.m_flags = self.sampling.flags()
            self.m_components = [self.m_flags]

        def sample(self: Any, ctx: Any, si: Any, one: Any, two: Any, active: Any = True) -> Any:
            bs, _ = self.sampling.sample(ctx, si, one, two, active)
            value = self.reflecting.eval(ctx, si, bs.wo, active)
            return bs, dr.select(bs.pdf > 0.0, value / bs.pdf, 0.0)

        def evaluate(self: Any, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.reflecting.eval(ctx, si, wo, active)

        def pdf(self: Any, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.sampling.pdf(ctx, si, wo, active)

        def eval_pdf(self: Any, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return evaluate(self, ctx, si, wo, active), pdf(self, ctx, si, wo, active)

        body = {"__init__": init, "sample": sample, "eval": evaluate, "pdf": pdf}
        body |= {"eval_pdf": eval_pdf, "traverse": lambda self, cb: None}
        mi.register_bsdf("split_roughness", type("SplitRoughness", (mi.BSDF,), body))


@LLVM_RGB
@pytest.mark.parametrize(
    ("kind", "fresnel", "values"),
    [
        ("nodes", "decomposition", [0.6, 0.7, 0.65]),
        ("coefficients", "decomposition", [0.6, 0.4, 0.02, 0.01]),
        ("indices", "decomposition", [1.2, 2.5]),
        ("indices", "exact", [1.2, 2.5]),
        ("gulbrandsen", "decomposition", [0.6, 0.5]),
        ("gulbrandsen", "exact", [0.6, 0.5]),
    ],
)
def test_gradients_are_differences(
    kind: str, fresnel: str, values: list[float], variant: str
) -> None:
    """The same samples for images, their derivatives, and the differences: to 1e-3, each number."""
    setup = sphere(0, 16)
    made = Images([setup], kind, load_basis(), fresnel=fresnel)
    observed = observe(photographs([setup], 16), made.sizes, None)
    x = np.array(values)[:, None] * np.array([1.0, 0.9, 0.8])
    options: dict[str, Any] = {"spp": 16, "seed": 5}
    _, gradient = loss_and_gradient(made, observed, x, 0.2, **options)
    found = np.stack([gradient[name] for name in made.names])
    difference = np.empty_like(x)
    for at in np.ndindex(x.shape):
        step = np.zeros_like(x)
        step[at] = 4e-3
        up, down = (
            loss_and_gradient(made, observed, x + s * step, 0.2, **options)[0] for s in (1, -1)
        )
        difference[at] = (up - down) / (2.0 * step[at])
    np.testing.assert_allclose(found, difference, rtol=1e-3, atol=1e-4 * np.abs(found).max())


@LLVM_RGB
def test_roughness_gradient_is_that_of_fixed_samples(variant: str) -> None:
    """`prb` holds samples fixed while roughness changes; so must the differences. To 1e-3.

    Differences whose samples move with roughness estimate the same derivative with other noise.
    """
    SplitRoughness.register()
    light = Environment(np.asarray(studio_lights(128))).emitter()
    prb = mi.load_dict({"type": "prb", "max_depth": 2, "rr_depth": 3})

    def render(bsdf: dict[str, Any]) -> float:
        scene = mi.load_dict(lit_object(bsdf, light, 16))
        return float(
            np.mean(np.array(mi.render(scene, integrator=prb, spp=16, seed=1)), dtype=float)
        )

    metal = {"eta": 1.2, "k": 2.5}
    h = 3e-3
    up, down = (
        render({"type": "split_roughness", **metal, "alpha": 0.3 + s, "alpha_sampled": 0.3})
        for s in (h, -h)
    )
    bsdf = {"type": "decomposed_conductor", "fresnel": "exact", "distribution": "ggx", **metal}
    scene = mi.load_dict(lit_object({**bsdf, "alpha": 0.3}, light, 16))
    params = mi.traverse(scene)
    key = next(name for name in params.keys() if name.endswith("alpha.value"))  # noqa: SIM118
    dr.enable_grad(params[key])
    params.update()
    image = mi.render(scene, params, integrator=prb, spp=16, seed=2, seed_grad=1)
    dr.backward(dr.mean(image, axis=None))
    assert float(dr.grad(params[key])[0]) == pytest.approx((up - down) / (2.0 * h), rel=1e-3)


@LLVM_RGB
def test_end_of_a_range_is_not_convergence(variant: str) -> None:
    """Images brighter than any index makes them drive k to the end of what it may be."""
    setup = sphere(0, 8)
    images = [1.2 * image for image in photographs([setup], 16)]
    start = {"eta": 0.2, "k": 19.0}
    result = recover(images, setup, "indices", route="gradient", alpha=0.1, start=start, spp=8)
    assert np.any(result.values["k"] > 19.99)
    assert not result.converged
    assert "end of the range" in result.message


@pytest.mark.slow
@LLVM_RGB
def test_standard_errors_are_the_spread_of_results(variant: str) -> None:
    """12 seeds of images and of ours.

    Right errors have a mean square of 1 in units of themselves. The three channels have their noise
    in common, so that 12 squares are known: a spread of sqrt(2 / 12) = .4, and 1 + 3 * .4 above.
    The study has .55 to .8 by 20 seeds, as errors are made to be on the safe side; far below would
    be errors that say nothing.
    """
    setups = [sphere(i, 24) for i in range(3)]
    cosines = np.cos([0.0, *load_basis().nodes])[:, None]
    truths = dict(zip(("f0", "f1", "f2"), conductor(cosines, *GOLD), strict=True))
    scores: dict[str, list[Any]] = {name: [] for name in truths}
    for seed in range(12):
        images = photographs(setups, 64, seed=100 * seed)
        found = recover(images, setups, alpha=0.1, spp=64, seed=seed)
        for name, truth in truths.items():
            scores[name].append((found.values[name] - truth) / found.standard_errors[name])
    for name, rows in scores.items():
        assert 0.15 < np.mean(np.square(rows)) < 2.2, name
        assert np.all(np.abs(rows) < 4.5), name


@LLVM_RGB
@pytest.mark.parametrize(("kind", "name"), [("nodes", "f0"), ("gulbrandsen", "r")])
def test_gradient_that_is_not_finite_names_its_parameter(
    kind: str, name: str, variant: str
) -> None:
    """Light so strong that a squared error leaves float32."""
    light = {"type": "constant", "radiance": {"type": "uniform", "value": 1e30}}

    def setup(bsdf: dict[str, Any]) -> dict[str, Any]:
        return lit_object(bsdf, light, 8)

    image = np.ones((8, 8, 3))
    made = Images([setup], kind, load_basis())
    observed = observe(image, made.sizes, None)
    x = np.full((len(made.names), 3), 0.5)
    with pytest.raises(NonFiniteGradientError, match=f"image 0 by '{name}' is"):
        loss_and_gradient(made, observed, x, 0.1, spp=4, seed=1)


@LLVM_RGB
@pytest.mark.parametrize("route", ["linear", "gradient"])
def test_light_that_is_not_finite_is_refused(route: str, variant: str) -> None:
    """Mitsuba's gradients are 0 there, which would look like the end of the descent."""
    lamp = {"type": "constant", "radiance": {"type": "uniform", "value": float("inf")}}
    with pytest.raises(InputError, match="scene 0 with radiance that is not finite"):
        recover(
            np.ones((8, 8, 3)),
            lambda bsdf: lit_object(bsdf, lamp, 8),
            route=route,
            alpha=0.1,
            spp=4,
        )


# --- bad input -----------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", ["scalar_rgb"], indirect=True)
def test_bad_input(variant: str) -> None:
    setup = sphere(0, 4)
    image = np.ones((4, 4, 3))

    def refused(words: str, *args: Any, **options: Any) -> None:
        with pytest.raises(InputError, match=words):
            recover(*(args or (image, setup)), **({"alpha": 0.1} | options))

    refused("is unknown", route="magic")
    refused("is unknown", parameters="colours")
    refused("not linear in roughness", roughness="unknown")
    refused("do not determine an index", fresnel="exact")
    refused("alpha=0", alpha=0.0)
    refused("unknown roughness", alpha=None)
    refused("search starts", route="hybrid", roughness="known")
    refused("known roughness", route="gradient", alpha=None, roughness="known")
    refused("spp=1", spp=1)
    refused("shape", np.ones((4, 5, 3)), setup)
    refused("2 images and 1 scenes", [image, image], setup)
    refused("not finite", np.full((4, 4, 3), np.nan), setup)
    refused("noise", noise=-1.0)
    refused("in 0 places", image, lambda bsdf: setup({"type": "diffuse"}))
    refused("gradient descent in scalar_rgb", route="gradient", spp=4)
    refused("start r=2", parameters="gulbrandsen", start={"r": 2.0})
    refused("low < high", bounds=(1.0, 0.0))
    refused("alpha=2", start={"alpha": 2.0})
    refused("no scene", [], [])

    def unlimited(bsdf: dict[str, Any]) -> dict[str, Any]:
        return {**setup(bsdf), "integrator": {"type": "path"}}

    refused("max_depth -1", image, unlimited)
    with pytest.raises(InputError, match="max_depth 3"):
        recover_texture(
            image, lambda b: {**setup(b), "integrator": {"type": "path", "max_depth": 3}}, (2, 2),
            alpha=0.1,
        )  # fmt: skip
    with pytest.raises(InputError, match="regions of shape"):
        recover_texture(image, setup, (2, 2), alpha=0.1, regions=np.zeros((3, 3), int))

"""What the study of inverse rendering recovers: scenes, cases, and what is kept of each result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import _kept
from _figure import Job
from fresnel_decomp import conductor, load_material
from fresnel_decomp.images import write_exr

WAVELENGTHS = (630.0, 532.0, 465.0)  # one index of refraction for each channel
ALPHA = 0.1
VIEWS, SPP = 5, 64
METALS = ("Au", "Cu", "Al", "Be", "W")
COSINES = np.sin(np.radians(np.linspace(90.0, 0.0, 181)))
TEXELS = (16, 32)
REPEATS, REPEAT_VIEWS, REPEAT_SIZE = 20, 3, 32
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Case:
    """One call of `recover`."""

    label: str
    start: str
    parameters: str
    route: str
    alpha: float = ALPHA
    roughness: str = "known"
    options: Mapping[str, Any] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def stem(self) -> str:
        return f"{self.label}-{self.start}".replace(" ", "_").replace(",", "").replace("/", "-")


GOOD, BAD = {"eta": 0.6, "k": 2.5}, {"eta": 4.0, "k": 0.3}
_STEPS = {"iterations": 200, "spp": 32}
CASES = (
    Case("linear, node colours", "any", "nodes", "linear"),
    Case("linear, (eta, k)", "any", "indices", "linear"),
    Case("linear, (r, g)", "any", "gulbrandsen", "linear"),
    Case("hybrid, (eta, k) and α", "good", "indices", "hybrid", 0.15, "unknown"),
    Case("hybrid, (eta, k) and α", "bad", "indices", "hybrid", 0.6, "unknown"),
    *(
        Case("gradient, node colours", name, "nodes", "gradient", options=_STEPS,
             values=dict.fromkeys(("f0", "f1", "f2"), value))
        for name, value in (("good", 0.7), ("bad", 0.05))
    ),
    *(
        Case(label, name, "indices", "gradient", options=_STEPS | {"fresnel": fresnel},
             values=values)
        for label, fresnel in (("gradient, (eta, k), fitted", "decomposition"),
                               ("gradient, (eta, k), exact", "exact"))
        for name, values in (("good", GOOD), ("bad", BAD))
    ),
    Case("gradient, node colours and α", "bad", "nodes", "gradient", 0.6, "unknown", _STEPS,
         dict.fromkeys(("f0", "f1", "f2"), 0.05)),
)  # fmt: skip


# --- scenes --------------------------------------------------------------------------------------


def light() -> Any:
    from fresnel_decomp.mitsuba.environment import Environment
    from fresnel_decomp.mitsuba.scenes import studio_lights

    return Environment(np.asarray(studio_lights(256)))


def sphere(view: int, size: int) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """The sphere, with the studio turned around it."""
    from fresnel_decomp.mitsuba.scenes import lit_object

    turned = light().turned(51 * view)
    return lambda bsdf: lit_object(bsdf, turned.emitter(), size)


def turned_sphere(view: int, size: int) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """The sphere itself turned, so that all its texels are seen."""
    import mitsuba as mi

    make = sphere(view, size)

    def setup(bsdf: dict[str, Any]) -> dict[str, Any]:
        scene = make(bsdf)
        tilt = -90.0 + 25.0 * float(np.sin(view))
        scene["object"]["to_world"] = (
            mi.ScalarTransform4f().rotate([1, 0, 0], tilt).rotate([0, 0, 1], 72.0 * view)
        )
        return scene

    return setup


def indices(metal: str) -> tuple[np.ndarray, np.ndarray]:
    eta, k = load_material(metal).at(np.array(WAVELENGTHS))
    return eta, k


def photograph(setups: Sequence[Any], eta: Any, k: Any, spp: int, seed: int) -> list[np.ndarray]:
    """Images by the built-in exact conductor."""
    import mitsuba as mi

    from fresnel_decomp.mitsuba.comparison import render_scene

    def property_of(value: Any) -> Any:
        return {"type": "rgb", "value": value.tolist()} if isinstance(value, np.ndarray) else value

    images = []
    for i, setup in enumerate(setups):
        metal = {
            "type": "roughconductor", "eta": property_of(eta), "k": property_of(k),
            "alpha": ALPHA, "distribution": "ggx",
        }  # fmt: skip
        images.append(render_scene(mi.load_dict(setup(metal)), spp, seed + i))
    return images


def curve_error(values: Values, basis: Any, fresnel: str, exact: np.ndarray) -> float:
    """Largest error of the three curves, over half degrees."""
    from fresnel_decomp.mitsuba.inverse import curve

    model = fresnel if values.keys() & {"eta", "r"} else "decomposition"
    return float(np.abs(curve(values, basis, model, COSINES) - exact).max())


# --- computing -----------------------------------------------------------------------------------


def compute(job: Job) -> dict[str, Any]:
    from fresnel_decomp.mitsuba.variants import variant_scope

    quick = bool(job.settings.get("quick"))
    size, spp = job.settings["size"], 16 if quick else SPP
    with variant_scope(job.settings["variant"]):
        setups = [sphere(i, size) for i in range(2 if quick else VIEWS)]
        cases = (
            (CASES[0], next(case for case in CASES if case.route == "gradient")) if quick else CASES
        )
        metals = METALS[:1] if quick else METALS
        total = len(cases) + len(metals) + 2
        results: dict[str, Any] = {"routes": {}, "metals": {}}
        for n, metal in enumerate(metals):
            job.report(f"metal {metal}", n / total)
            results["metals"][metal] = _kept.numbers(
                job, f"metal-{metal}", lambda metal=metal: _metal(setups, metal, spp, quick)
            )
        job.report("two metals", len(metals) / total)
        results["texture"] = _kept.numbers(job, "texture", lambda: _texture(job, size, spp, quick))
        job.report("standard errors", (len(metals) + 1) / total)
        results["calibration"] = _kept.numbers(job, "calibration", lambda: _calibration(quick))
        for n, case in enumerate(cases):
            job.report(f"{case.label}, {case.start}"[:26], (len(metals) + 2 + n) / total)
            results["routes"][case.stem] = _kept.numbers(
                job, case.stem, lambda case=case: _route(setups, case, spp, quick)
            )
    return results


def _route(setups: Sequence[Any], case: Case, spp: int, quick: bool) -> dict[str, Any]:
    from fresnel_decomp.mitsuba.inverse import recover

    eta, k = indices("Au")
    images = photograph(setups, eta, k, spp, 1000)
    options = dict(case.options)
    if quick and case.route == "gradient":
        options |= {"iterations": 3, "spp": 4}
    if quick and case.route != "gradient":
        options |= {"spp": 16}
    found = recover(
        images, setups, case.parameters, route=case.route, alpha=case.alpha,
        roughness=case.roughness, start=case.values or None, **options,
    )  # fmt: skip
    exact = conductor(COSINES[:, None], eta, k)
    path = [
        (s.seconds, s.samples, curve_error(s.values, found.basis, found.fresnel, exact))
        for s in found.history
    ]
    return {
        "error": float(np.abs(found.reflectance(COSINES) - exact).max()),
        "path": path,
        **_summary(found),
    }


def _summary(found: Any) -> dict[str, Any]:
    return {
        "seconds": found.seconds,
        "samples": found.samples,
        "iterations": found.iterations,
        "residual": found.residual,
        "noise": found.noise,
        "converged": found.converged,
        "message": found.message,
        "alpha": [found.alpha, found.standard_errors["alpha"]],
        "values": {n: np.asarray(v).tolist() for n, v in found.values.items()},
        "standard_errors": {n: np.asarray(v).tolist() for n, v in found.standard_errors.items()},
    }


def _metal(setups: Sequence[Any], metal: str, spp: int, quick: bool) -> dict[str, Any]:
    """The linear solve: node colours, and the indices they lead to."""
    from fresnel_decomp import load_basis
    from fresnel_decomp.mitsuba.inverse import recover

    eta, k = indices(metal)
    exact = conductor(COSINES[:, None], eta, k)
    basis = load_basis()
    fitted = basis.evaluate(basis.coefficients(eta, k)[None], COSINES[:, None])
    images = photograph(setups, eta, k, spp, 2000)
    results: dict[str, Any] = {
        "limit": float(np.abs(fitted - exact).max()),
        "truth": {"eta": eta.tolist(), "k": k.tolist()},
    }
    found = recover(images, setups, "indices", alpha=ALPHA, spp=16 if quick else 128)
    nodes = [step.values for step in found.history if "f0" in step.values][-1]
    results["nodes"] = {"error": curve_error(nodes, found.basis, "decomposition", exact)}
    five = recover(
        images, setups, alpha=ALPHA, basis=load_basis("balanced", 5), spp=16 if quick else 128
    )
    results["five terms"] = {"error": float(np.abs(five.reflectance(COSINES) - exact).max())}
    results["indices"] = {
        "error": float(np.abs(found.reflectance(COSINES) - exact).max()),
        **_summary(found),
    }
    return results


def _calibration(quick: bool) -> dict[str, Any]:
    """How far recovered values are off in units of their standard errors, for many seeds."""
    from fresnel_decomp import load_basis
    from fresnel_decomp.mitsuba.inverse import recover

    eta, k = indices("Au")
    cosines = np.cos([0.0, *load_basis().nodes])[:, None]
    truth = {"eta": eta, "k": k}
    truth |= dict(zip(("f0", "f1", "f2"), conductor(cosines, eta, k), strict=True))
    setups = [sphere(i, 12 if quick else REPEAT_SIZE) for i in range(REPEAT_VIEWS)]
    scores: dict[str, list[np.ndarray]] = {name: [] for name in ("f0", "f1", "f2", "eta", "k")}
    for seed in range(2 if quick else REPEATS):
        images = photograph(setups, eta, k, SPP, 5000 + 10 * seed)
        for kind in ("nodes", "indices"):
            found = recover(images, setups, kind, alpha=ALPHA, spp=64, seed=seed)
            for name in scores.keys() & found.values.keys():
                error = (found.values[name] - truth[name]) / found.standard_errors[name]
                scores[name].append(error)
    return {name: np.array(rows).ravel().tolist() for name, rows in scores.items()}


def _texture(job: Job, size: int, spp: int, quick: bool) -> dict[str, Any]:
    """Gold and aluminium in a pattern: without and with knowing where which of them is."""
    import mitsuba as mi

    from fresnel_decomp import load_basis
    from fresnel_decomp.mitsuba.comparison import render_scene
    from fresnel_decomp.mitsuba.inverse import recover_texture

    height, width = TEXELS
    y, x = np.mgrid[:height, :width]
    mask = ((x // 4 + y // 4) % 2).astype(int)
    metals = [indices("Au"), indices("Al")]

    def bitmap(which: int) -> dict[str, Any]:
        texels = np.where(mask[..., None] == 0, metals[0][which], metals[1][which])
        data = mi.TensorXf(texels.astype(np.float32))
        return {"type": "bitmap", "raw": True, "filter_type": "nearest", "data": data}

    setups = [turned_sphere(i, size) for i in range(2 if quick else 6)]
    images = []
    for i, setup in enumerate(setups):
        images += photograph([setup], bitmap(0), bitmap(1), spp, 3000 + i)
    basis = load_basis()
    cosines = np.cos([0.0, *basis.nodes])
    truth = np.stack([conductor(cosines, e[:, None], kk[:, None]) for e, kk in metals])[mask]
    results: dict[str, Any] = {}
    write_exr(job.folder / "texture_truth.exr", truth[..., 0].astype(np.float32))
    write_exr(job.folder / "texture_image.exr", images[0])
    for name, regions in (("texels", None), ("regions", mask)):
        found = recover_texture(
            images, setups, TEXELS, alpha=ALPHA, regions=regions, spp=16 if quick else 128
        )
        error = np.abs(found.nodes - truth)
        known = found.identified
        results[name] = {
            "residual": found.residual,
            "noise": found.noise,
            "samples": found.samples,
            "identified": float(known.mean()),
            "mean": [float(error[known][..., i].mean()) for i in range(3)],
            "p95": [float(np.quantile(error[known][..., i], 0.95)) for i in range(3)],
            "median_se": [float(np.median(found.standard_errors[..., i])) for i in range(3)],
        }
        write_exr(job.folder / f"texture_{name}.exr", found.nodes[..., 0].astype(np.float32))
        again = render_scene(mi.load_dict(setups[0](found.bsdf())), spp, 4000)
        write_exr(job.folder / f"texture_{name}_image.exr", again)
    return results

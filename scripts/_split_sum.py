"""Images and numbers of the split-sum study: what is rendered, what is compared with what.

Every image is kept as soon as it is finished, with what it was made from in its header.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import _kept
from _figure import Job
from fresnel_decomp import F82, AlbedoTable, Exact, load_basis, split_albedo
from fresnel_decomp.images import (
    compare,
    delta_e,
    nrmse,
)
from fresnel_decomp.subjects import Subject, from_gulbrandsen, from_indices, from_material

RECIPES = ("notebook", "balanced")
MODELS = ("decomposition", *RECIPES, "schlick", "f82")
"""What is compared with the exact term: four terms by the default recipe and by two others, and two
models of few parameters."""
MATERIALS = {
    "Be": "Beryllium",
    "Au": "Gold",
    "Al": "Aluminium",
    "Cu": "Copper",
    "plastic": "Plastic, η = 1.5",
    "edge": "Edge tint",
}
ALPHAS = (0.08, 0.3, 0.6)
EDGE_TINT = {"r": (0.44, 0.44, 0.44), "g": (0.0, 1.0, 0.0)}
"""Gulbrandsen's parameters of the talk's Figure 2."""
EXPOSURES = {"plastic": 3.0}
"""In stops, for pictures, ΔE00 and FLIP: a plastic reflects a twentieth of what metals do."""
SUNSKY: dict[str, Any] = {"sun_direction": [-0.6, 0.55, 0.35], "sun_scale": 1.5, "sky_scale": 1.5}
"""In front of the object, over the camera's shoulder; about as bright as the city."""
SPLIT_SPP = 16

Numbers = dict[str, float]


@dataclass(frozen=True)
class Scene:
    """An object in a light."""

    material: str
    alpha: float
    shape: str = "sphere"
    light: str = "city"

    @property
    def stem(self) -> str:
        """Of its files."""
        place = "" if (self.shape, self.light) == ("sphere", "city") else f"_{self.shape}"
        return f"{self.material}_alpha{self.alpha:g}{place}" + (
            f"_{self.light}" if self.light != "city" else ""
        )

    @property
    def exposure(self) -> float:
        return EXPOSURES.get(self.material, 0.0)


SPHERES = tuple(Scene(material, alpha) for material in MATERIALS for alpha in ALPHAS)
BALLS = tuple(
    Scene(material, alpha, "shader-ball", light)
    for light in ("city", "sunsky")
    for material, alpha in (("Au", 0.3), ("edge", 0.08))
)


def described(scene: Scene) -> dict[str, Any]:
    """What an image of a scene depends on."""
    return {"scene": repr(scene)} | (SUNSKY if scene.light == "sunsky" else {})


@functools.cache
def subject(material: str) -> Subject:
    if material == "plastic":
        return from_indices([1.5], [0.0])
    if material == "edge":
        return from_gulbrandsen(EDGE_TINT["r"], EDGE_TINT["g"])
    return from_material(material)


@functools.cache
def environment(name: str, width: int) -> Any:
    from fresnel_decomp.mitsuba.skies import city, sunsky

    if name == "city":
        return city(width)
    return sunsky(width, **SUNSKY)


@functools.cache
def prefiltered(name: str, width: int) -> Any:
    from fresnel_decomp.mitsuba.prefilter import prefilter

    return prefilter(environment(name, width))


@dataclass
class Study:
    """Everything that the images of one run share."""

    job: Job
    done: int = 0
    total: int = 1
    surfaces: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        settings = self.job.settings
        self.size, self.spp, self.seed = (settings[name] for name in ("size", "spp", "seed"))
        self.light_width = 512 if self.size > 64 else 64
        self.terms = settings["basis"]["terms"]
        default = load_basis(settings["basis"]["recipe"], self.terms)
        others = {recipe: load_basis(recipe, self.terms) for recipe in RECIPES}
        self.bases = {"decomposition": default, **others}

    # --- images --------------------------------------------------------------------------------

    def kept(
        self, stem: str, what: Mapping[str, Any], make: Callable[[], np.ndarray]
    ) -> np.ndarray:
        """The image called `stem`, read if it was made from the same settings, else made."""
        found = _kept.image(self.job, stem, make, **what, light_width=self.light_width)
        self.done += 1
        self.job.report(stem[:26], min(self.done / self.total, 1.0))
        return found

    def path_traced(self, scene: Scene, model: str, seed: int, name: str) -> np.ndarray:
        from fresnel_decomp.mitsuba.comparison import render_scene

        def make() -> np.ndarray:
            return render_scene(self.loaded(scene, model), self.spp, seed)

        what = {"method": "path tracing", "model": model, "seed": seed, **described(scene)}
        return self.kept(f"{scene.stem}_{name}", what, make)

    def split_sum(self, scene: Scene, model: str, name: str) -> np.ndarray:
        from fresnel_decomp.mitsuba.split_sum import SplitMaterial, render_split_sum

        def make() -> np.ndarray:
            material = SplitMaterial(self.albedo(scene, model), scene.alpha)
            light = prefiltered(scene.light, self.light_width)
            surface = self.surface(scene)
            return np.array(render_split_sum(surface, light, material, background=False))

        what = {"method": "split-sum", "model": model, **described(scene)}
        return self.kept(f"{scene.stem}_{name}", what, make)

    def coverage(self, shape: str) -> np.ndarray:
        scene = Scene("Be", 0.3, shape)
        what = {"method": "coverage", "shape": shape}
        make = lambda: self.surface(scene).coverage()  # noqa: E731
        return self.kept(f"coverage_{shape}", what, make)[..., 0]

    def loaded(self, scene: Scene, model: str) -> Any:
        import mitsuba as mi

        from fresnel_decomp.mitsuba.comparison import conductor_bsdf
        from fresnel_decomp.mitsuba.scenes import lit_object

        material = subject(scene.material)
        options: dict[str, Any] = {"fresnel": model}
        if model in self.bases:
            recipe = self.bases[model].recipe
            options = {"fresnel": "decomposition", "recipe": recipe, "terms": self.terms}
        bsdf = conductor_bsdf(material.eta, material.k, alpha=scene.alpha, **options)
        light = environment(scene.light, self.light_width).emitter()
        return mi.load_dict(lit_object(bsdf, light, self.size, shape=scene.shape, background=False))

    def surface(self, scene: Scene) -> Any:
        from fresnel_decomp.mitsuba.visible_surface import visible_surface

        if scene.shape not in self.surfaces:
            loaded = self.loaded(scene, "exact")
            self.surfaces[scene.shape] = visible_surface(loaded, SPLIT_SPP, self.seed)
        return self.surfaces[scene.shape]

    @functools.cached_property
    def tables(self) -> dict[str, AlbedoTable]:
        return {name: AlbedoTable.bake(basis) for name, basis in self.bases.items()}

    def albedo(self, scene: Scene, model: str) -> Any:
        """Fbar of a model: 'exact' and 'decomposed curve' integrated, the others from tables."""
        eta, k = subject(scene.material).eta, subject(scene.material).k
        if model == "exact":
            return split_albedo.integrated_albedo(Exact(eta, k), scene.alpha)
        if model == "decomposed curve":
            basis = self.bases["decomposition"]
            curve = functools.partial(basis.evaluate, basis.coefficients(eta, k))
            return split_albedo.integrated_albedo(curve, scene.alpha)
        if model in self.bases:
            coefficients = self.bases[model].coefficients(eta, k)
            return split_albedo.SplitAlbedo(self.tables[model], coefficients)
        bent = F82.from_ior(eta, k)
        return split_albedo.f82_albedo(bent.f0, bent.f82 if model == "f82" else None)

    # --- comparisons ---------------------------------------------------------------------------

    def sphere(self, scene: Scene) -> dict[str, Any]:
        """All three comparisons for one material and roughness."""
        inside = self.coverage(scene.shape) == 1.0
        exact = self.path_traced(scene, "exact", self.seed, "mc_exact")
        models = {m: self.path_traced(scene, m, self.seed, f"mc_{m}") for m in MODELS}
        split = {m: self.split_sum(scene, m, f"split_{m}") for m in ("exact", *MODELS)}
        curve = self.split_sum(scene, "decomposed curve", "split_decomposed_curve")
        differ = functools.partial(measure, inside=inside, exposure=scene.exposure)
        return {
            "fresnel_alone": {m: differ(exact, image) for m, image in models.items()},
            "table_alone": differ(curve, split["decomposition"]),
            "same_light": {m: differ(split["exact"], split[m]) for m in MODELS},
            **self.against_reference(scene, exact, split, inside),
        }

    def ball(self, scene: Scene) -> dict[str, Any]:
        """The third comparison, for a mesh or another light."""
        inside = self.coverage(scene.shape) == 1.0
        exact = self.path_traced(scene, "exact", self.seed, "mc_exact")
        split = {m: self.split_sum(scene, m, f"split_{m}") for m in ("exact", *MODELS)}
        return self.against_reference(scene, exact, split, inside)

    def against_reference(
        self, scene: Scene, exact: np.ndarray, split: Mapping[str, np.ndarray], inside: np.ndarray
    ) -> dict[str, Any]:
        again = self.path_traced(scene, "exact", self.seed + 1, "mc_exact_again")
        reference = 0.5 * (exact + again)
        differ = functools.partial(measure, inside=inside, exposure=scene.exposure)
        return {
            # two runs of equal quality: their mean errs by half of what they differ
            "noise": {name: 0.5 * value for name, value in differ(exact, again).items()},
            "split_sum": {m: differ(reference, image) for m, image in split.items()},
        }


def measure(
    reference: np.ndarray, test: np.ndarray, inside: np.ndarray, exposure: float
) -> Numbers:
    """NRMSE, mean ΔE00 and mean FLIP over the pixels that the object covers wholly."""
    if not inside.any():
        raise AssertionError("the object covers no pixel")
    first, second = (image[inside][None] for image in (reference, test))
    flip_map = compare(reference, test, exposure).flip_map
    return {
        "nrmse": nrmse(first, second),
        "delta_e": float(delta_e(first, second, exposure).mean()),
        "flip": float(flip_map[inside].mean(dtype=np.float64)),
    }


def light_effort(width: int) -> tuple[int, int]:
    """Directions, and samples in each, that the light of a map's width is checked with."""
    return (48, 2**18) if width == 512 else (8, 2**14)


def light_error(name: str, width: int, alpha: float, directions: int, samples: int) -> Numbers:
    """Largest and RMS error of the prefiltered light over the map's mean, by quasi-Monte Carlo."""
    from fresnel_decomp.mitsuba.prefilter import split_light

    towards = np.random.default_rng(1).normal(size=(directions, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    source = environment(name, width)
    expected = np.array([split_light(source, d, alpha, samples) for d in towards])
    error = prefiltered(name, width).lookup(towards, alpha) - expected
    mean = expected.mean()
    return {
        "rms": float(np.sqrt(np.mean(error**2)) / mean),
        "largest": float(np.abs(error).max() / mean),
    }


def compute(job: Job) -> dict[str, Any]:
    """Render everything that is not there yet, and compare."""
    from fresnel_decomp.mitsuba.variants import variant_scope  # imports the renderer

    with variant_scope(job.settings["variant"]) as variant:
        balls = [s for s in BALLS if s.light == "city" or not variant.startswith("scalar")]
        study = Study(job, total=13 * len(SPHERES) + 8 * len(balls))
        results: dict[str, Any] = {"scenes": {}}
        for scene in SPHERES:
            results["scenes"][scene.stem] = study.sphere(scene)
        for scene in balls:
            results["scenes"][scene.stem] = study.ball(scene)
        effort = light_effort(study.light_width)
        job.report("checking the light", 1.0)
        results["light_error"] = {
            f"{alpha:g}": light_error("city", study.light_width, alpha, *effort) for alpha in ALPHAS
        }
        results["light_width"] = study.light_width
        return results


def reference_image(folder: Path, scene: Scene) -> np.ndarray:
    """Mean of the two path-traced images with the exact Fresnel term."""
    return 0.5 * (
        _kept.image_of(folder, scene, "mc_exact") + _kept.image_of(folder, scene, "mc_exact_again")
    )

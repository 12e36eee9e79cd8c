"""Images and numbers of the area light study: what is rendered, what is compared with what.

Every image is kept as soon as it is finished, with what it was made from in its header.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import _kept
from _figure import Job
from fresnel_decomp import AlbedoTable, Basis, Exact, load_basis
from fresnel_decomp.area_light import CORRECTIONS, AreaLight, AreaMaterial
from fresnel_decomp.images import nrmse
from fresnel_decomp.ltc import load_lobes
from fresnel_decomp.subjects import Subject, from_indices, from_material

MATERIALS = {"Be": "Beryllium", "Au": "Gold", "Al": "Aluminium", "plastic": "Plastic, η = 1.5"}
METALS = ("Be", "Au", "Al")
RECIPES = ("talk", "notebook", "balanced")
SHOWN = "balanced"
"""The recipe of the pictures, and of what all approximations together cost."""
ALPHAS = (0.1, 0.3, 0.6)
OBJECTS = ("plane", "sphere")
SHAPES = ("rectangle", "disk")
TABLE_SIZE = 64
SHADER_SPP = 16
RADIANCE = 6.0


@dataclass(frozen=True)
class Scene:
    """An object in the light of a rectangle or a disk."""

    object: str
    light: str
    alpha: float

    @property
    def stem(self) -> str:
        """Of its files."""
        return f"{self.object}_{self.light}_alpha{self.alpha:g}"


SCENES = tuple(Scene(o, s, a) for o in OBJECTS for s in SHAPES for a in ALPHAS)


def light_for(scene: Scene) -> AreaLight:
    """Behind the floor, upright; or beside the sphere."""
    if scene.object == "plane":
        u, v, centre = [0.8, 0.0, 0.0], [0.0, 0.55, 0.0], [0.0, 0.8, -1.2]
    else:
        u, v, centre = [0.4, 0.0, 0.63], [-0.22, -0.49, 0.14], [-1.9, 2.2, 1.2]
    return AreaLight(scene.light, centre, u, v, RADIANCE)  # type: ignore[arg-type]


@functools.cache
def subject(material: str) -> Subject:
    return from_indices([1.5], [0.0]) if material == "plastic" else from_material(material)


def basis_of(model: str) -> Basis:
    """The basis that a model names: a recipe, and unless there are four, its terms: balanced-5."""
    recipe, _, terms = model.partition("-")
    return load_basis(recipe, int(terms or 4))


@functools.cache
def table(model: str) -> AlbedoTable:
    return AlbedoTable.bake(basis_of(model), TABLE_SIZE)


@functools.cache
def material_of(name: str, alpha: float, model: str) -> AreaMaterial:
    """By a recipe's table, or by the exact curve, integrated; 'white' reflects all."""
    from fresnel_decomp.split_albedo import integrated_albedo

    def white(mu: Any, roughness: Any) -> Any:
        return table("talk").lookup(mu, roughness)[0]

    if name == "white":
        return AreaMaterial(lambda mu, roughness: (white(mu, roughness),) * 3)
    eta, k = subject(name).eta, subject(name).k
    if model != "exact":
        coefficients = np.atleast_2d(basis_of(model).coefficients(eta, k))
        rows = np.broadcast_to(coefficients, (3, coefficients.shape[-1]))
        return AreaMaterial.from_table(table(model), rows)
    curve = Exact(np.broadcast_to(eta, 3), np.broadcast_to(k, 3))
    smooth = integrated_albedo(curve, 0.0)
    return AreaMaterial(integrated_albedo(curve, alpha), lambda c: smooth(c, 0.0), white)


@dataclass
class Study:
    """Everything that the images of one run share."""

    job: Job
    done: int = 0
    surfaces: dict[tuple[str, str], Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        settings = self.job.settings
        self.size, self.spp, self.seed = (settings[name] for name in ("size", "spp", "seed"))

    def kept(
        self, stem: str, what: Mapping[str, Any], make: Callable[[], np.ndarray]
    ) -> np.ndarray:
        """The image called `stem`, read if it was made from the same settings, else made."""
        found = _kept.image(self.job, stem, make, **what)
        self.done += 1
        each = 1 + 2 * len(CORRECTIONS) + len(RECIPES)
        total = len(SCENES) * (4 + len(MATERIALS) * each)
        self.job.report(stem[:26], min(self.done / total, 1.0))
        return found

    def path_traced(self, scene: Scene, material: str, model: str, seed: int) -> np.ndarray:
        from fresnel_decomp.mitsuba.comparison import render_scene

        def make() -> np.ndarray:
            return render_scene(self.loaded(scene, material, model), self.spp, seed)

        what = {
            "method": "path tracing",
            "light": repr(vars(light_for(scene))),
            "material": material,
            "model": model,
            "seed": seed,
            "at": repr(scene),
        }
        name = f"{scene.stem}_{material}_mc_{model}" + ("_again" if seed != self.seed else "")
        return self.kept(name, what, make)

    def loaded(self, scene: Scene, material: str, model: str) -> Any:
        import mitsuba as mi

        from fresnel_decomp.mitsuba.area_light import lit_by_area
        from fresnel_decomp.mitsuba.comparison import conductor_bsdf

        if material == "white":
            bsdf: dict[str, Any] = {
                "type": "decomposed_conductor",
                "material": "none",
                "distribution": "ggx",
                "alpha": scene.alpha,
            }
        else:
            eta, k = subject(material).eta, subject(material).k
            options = {"fresnel": "exact"}
            if model != "exact":
                options = {"fresnel": "decomposition", "recipe": model}
            bsdf = conductor_bsdf(eta, k, alpha=scene.alpha, **options)  # type: ignore[arg-type]
        return mi.load_dict(lit_by_area(bsdf, light_for(scene), self.size, shape=scene.object))

    def surface(self, scene: Scene) -> Any:
        from fresnel_decomp.mitsuba.visible_surface import visible_surface

        key = scene.object, scene.light
        if key not in self.surfaces:
            loaded = self.loaded(scene, "white", "exact")
            self.surfaces[key] = visible_surface(loaded, SHADER_SPP, self.seed)
        return self.surfaces[key]

    def shaded(self, scene: Scene, material: str, model: str, correction: str) -> np.ndarray:
        from fresnel_decomp.mitsuba.area_light import LitMaterial, render_area_light

        def make() -> np.ndarray:
            chosen = LitMaterial(
                material_of(material, scene.alpha, model),
                scene.alpha,
                correction,  # type: ignore[arg-type]
            )
            surface, light = self.surface(scene), light_for(scene)
            return np.array(render_area_light(surface, light, load_lobes(), chosen))

        what = {
            "method": "linearly transformed cosines",
            "light": repr(vars(light_for(scene))),
            "lobes": load_lobes().sha256,
            "material": material,
            "model": model,
            "correction": correction,
            "at": repr(scene),
        }
        return self.kept(f"{scene.stem}_{material}_ltc_{model}_{correction}", what, make)

    def inside(self, scene: Scene) -> np.ndarray:
        """Pixels that show the object and nothing else."""

        def make() -> np.ndarray:
            surface = self.surface(scene)
            seen = np.array(surface.shape) == surface.names.index("object")
            width, height = surface.size
            return seen.reshape(height, width, surface.spp).mean(axis=2)

        what = {"method": "coverage", "object": scene.object, "light": scene.light}
        whole = self.kept(f"coverage_{scene.object}_{scene.light}", what, make)[..., 0] == 1.0
        # the path tracer's samples lie elsewhere: not beside what shows the light either
        padded = np.pad(whole, 1, mode="edge")
        height, width = whole.shape
        shifts = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
        return np.logical_and.reduce(shifts)

    def compare(self, scene: Scene) -> dict[str, Any]:
        """All comparisons of one scene, NRMSE each."""
        inside = self.inside(scene)
        if not inside.any():
            raise AssertionError("the object covers no pixel")

        def differ(reference: np.ndarray, test: np.ndarray) -> float:
            return nrmse(reference[inside][None], test[inside][None])

        white = self.path_traced(scene, "white", "exact", self.seed)
        again = self.path_traced(scene, "white", "exact", self.seed + 1)
        shaded = self.shaded(scene, "white", "exact", "none")
        # two runs of equal quality: their mean errs by half of what they differ
        result: dict[str, Any] = {
            "noise": 0.5 * differ(white, again),
            "lobe": differ(0.5 * (white + again), shaded),
            "materials": {},
        }
        for material in MATERIALS:
            exact = self.path_traced(scene, material, "exact", self.seed)
            same_lobe = {c: self.shaded(scene, material, "exact", c) for c in CORRECTIONS}
            found: dict[str, Any] = {"fresnel": {}, "total": {}}
            for recipe in RECIPES:
                fitted = self.shaded(scene, material, recipe, "none")
                found["fresnel"][recipe] = differ(same_lobe["none"], fitted)
            for c in CORRECTIONS:
                found["total"][c] = differ(exact, self.shaded(scene, material, SHOWN, c))
            # the lobe as it is, from the white image of the same samples; only F is approximated
            found["half_vector"] = {
                c: differ(exact, white * ratio(same_lobe[c], shaded)) for c in CORRECTIONS
            }
            result["materials"][material] = found
        return result


def ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a / b where b is not 0."""
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0.0)


def compute(job: Job) -> dict[str, Any]:
    """Render everything that is not there yet, and compare."""
    from fresnel_decomp.mitsuba.variants import variant_scope  # imports the renderer

    with variant_scope(job.settings["variant"]):
        study = Study(job)
        return {"scenes": {scene.stem: study.compare(scene) for scene in SCENES}}

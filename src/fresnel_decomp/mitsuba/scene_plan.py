"""Plans for Mitsuba scenes: find what reflects, choose its Fresnel term, put it into the scene.

A scene is walked as it is loaded: shapes, their BSDFs, and the BSDFs nested in those, whether
written in place, referenced or inside a shape group that is instanced. To change it, the parsed
form of its XML file or dictionary is changed and instantiated or written anew, so that everything
else stays as its author wrote it.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from .._check import input_error
from .._files import replacing
from ..plan import Choice, LeftExact, Plan, plan_surfaces
from ..prediction import Metric, Surface
from . import register
from .tabulation import children, stored_values

__all__ = ["Inventory", "ScenePlan", "inventory", "plan_scene"]

Source = str | os.PathLike[str] | dict[str, Any] | Any
"""The path of an XML file, a dictionary as for `mi.load_dict`, or a loaded `mi.Scene`."""

CONDUCTORS = {"RoughConductor": "roughconductor", "SmoothConductor": "conductor"}
_NO_COUNTERPART = {
    "SmoothDielectric": "dielectric",
    "ThinDielectric": "thindielectric",
    "RoughDielectric": "roughdielectric",
    "SmoothPlastic": "plastic",
    "RoughPlastic": "roughplastic",
    "Principled": "principled",
    "PrincipledThin": "principledthin",
}
_UNKNOWN_ALPHA = (1e-3, 1.0)  # of textures whose values are known only at surface points
_COPIED = ("alpha", "alpha_u", "alpha_v", "distribution", "sample_visible", "specular_reflectance")


@dataclass(frozen=True, eq=False)
class Inventory:
    """What a scene has for a plan to work on.

    Attributes
    ----------
    surfaces : tuple of Surface
        Rough conductors, which `decomposed_conductor` can replace.
    left : tuple of LeftExact
        Other BSDFs with a Fresnel term, and conductors that a plan cannot take.
    lights : tuple of str
        Classes of the emitters in use.
    """

    surfaces: tuple[Surface, ...]
    left: tuple[LeftExact, ...]
    lights: tuple[str, ...]
    _objects: tuple[Any, ...] = field(repr=False)


@dataclass(frozen=True, eq=False)
class ScenePlan:
    """A plan, and the scene that it is for.

    Attributes
    ----------
    plan : Plan
    lights : tuple of str
    variant : str
        The plan holds for the colours of this Mitsuba variant.
    """

    plan: Plan
    lights: tuple[str, ...]
    variant: str
    _source: _Source | None = field(repr=False)
    _objects: tuple[Any, ...] = field(repr=False)
    _scratch: Any = field(default=None, repr=False)

    def apply(self) -> Any:
        """The scene with the plan in it, loaded in the active variant.

        Raises
        ------
        InputError
            If the plan was made for a loaded scene, or for another variant.
        """
        source = self._rewritable()
        folder = Path(self._scratch.name)
        state = source.parse()
        self._rewrite(state, source.nodes, folder / "basis.json")
        return _first(mi.parser.instantiate(source.config, state))

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the scene with the plan as XML; a basis of its own goes to a file beside it.

        File names in the scene stay as they are, so write it into the folder of the original.

        Raises
        ------
        InputError
            As `apply`; also for scenes that hold objects in memory, such as arrays or meshes.
        """
        source = self._rewritable()
        target = Path(path)
        if target.suffix != ".xml":
            raise input_error(f"'{path}'", "a name ending in .xml", "Rename it.")
        state = source.parse()
        basis_path = target.with_name(f"{target.stem}-basis.json")
        self._rewrite(state, source.nodes, basis_path, beside=True)
        try:
            text = mi.parser.write_string(state)
        except RuntimeError as error:
            raise input_error(
                f"a scene that XML cannot hold ({str(error).strip()})",
                "a scene of numbers, strings and file names",
                "Use apply(), which loads it instead.",
            ) from error
        with replacing(target) as temporary:
            temporary.write_text(text, encoding="utf-8")

    def _rewritable(self) -> _Source:
        if self._source is None:
            raise input_error(
                "a plan for a loaded scene",
                "a plan for an XML file or a dictionary",
                "A loaded scene cannot be changed: plan what it was loaded from.",
            )
        if mi.variant() != self.variant:
            raise input_error(
                f"variant {mi.variant()}",
                self.variant,
                "The colours of a plan are those of the variant that it was made in.",
            )
        register()
        return self._source

    def _rewrite(
        self, state: Any, nodes: Sequence[Any], basis_path: Path, beside: bool = False
    ) -> None:
        basis = self.plan.basis
        recipe = ""
        if basis is not None:
            recipe = basis.recipe
            if recipe == "custom":
                recipe = basis_path.name if beside else str(basis_path)
                basis.save(basis_path)
        for choice, surface_object in zip(self.plan.choices, self._objects, strict=True):
            if choice.model == "exact":
                continue
            for index, node in enumerate(nodes):
                if node is surface_object:
                    old = state.nodes[index].props
                    state.nodes[index].props = _planned(old, choice, recipe)


def inventory(source: Source) -> Inventory:
    """The surfaces, other BSDFs and lights of a scene.

    Parameters
    ----------
    source : path, dict or mi.Scene

    Raises
    ------
    InputError
        If no variant is set, or the scene cannot be loaded.
    """
    return _inventory(_load(source)[0])


def plan_scene(
    source: Source, max_error: float, metric: Metric = "reflectance", **options: Any
) -> ScenePlan:
    """Choose the cheapest Fresnel term for each conductor of a scene.

    Parameters
    ----------
    source : path, dict or mi.Scene
        An XML file, a dictionary, or a loaded scene (whose plan can be read but not applied).
        Dictionaries are parsed twice, so they should not hold tensors, which Mitsuba empties.
    max_error, metric, **options
        As for `plan.plan_surfaces`.

    Raises
    ------
    InputError
        As `plan_surfaces`; if no variant is set, or the scene cannot be loaded.

    Examples
    --------
    >>> import mitsuba as mi
    >>> from fresnel_decomp.mitsuba.scene_plan import plan_scene
    >>> mi.set_variant("scalar_rgb")
    >>> metal = {"type": "roughconductor", "material": "Al", "alpha": 0.2}
    >>> scene = {"type": "scene", "ball": {"type": "sphere", "bsdf": metal}}
    >>> planned = plan_scene(scene, 0.1)
    >>> [choice.model for choice in planned.plan.choices]
    ['schlick']
    """
    scene, parsed = _load(source)
    found = _inventory(scene)
    plan = plan_surfaces(found.surfaces, max_error, metric, left=found.left, **options)
    scratch = tempfile.TemporaryDirectory(prefix="fresnel-plan-") if parsed else None
    return ScenePlan(plan, found.lights, str(mi.variant()), parsed, found._objects, scratch)


# --- loading -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Source:
    """Where a scene comes from, and the object that each of its parsed nodes became."""

    origin: str | dict[str, Any]
    config: Any
    nodes: tuple[Any, ...]

    def parse(self) -> Any:
        return _parse(self.origin, self.config)


def _parse(origin: str | dict[str, Any], config: Any) -> Any:
    parse = mi.parser.parse_dict if isinstance(origin, dict) else mi.parser.parse_file
    state = parse(config, origin)
    mi.parser.transform_upgrade(config, state)
    mi.parser.transform_resolve_references(config, state)
    return state


def _load(source: Source) -> tuple[Any, _Source | None]:
    if mi.variant() is None:
        raise input_error(
            "no Mitsuba variant is set", ", ".join(mi.variants()), "Call mitsuba.set_variant first."
        )
    register()
    if isinstance(source, mi.Scene):
        return source, None
    if not isinstance(source, dict):
        source = os.fspath(source)
        if not Path(source).is_file():
            raise input_error(f"no file '{source}'", "a Mitsuba scene in XML", "Check the path.")
    config = mi.parser.ParserConfig(mi.variant())
    config.merge_equivalent = config.merge_meshes = False
    try:
        state = _parse(source, config)
        scene = _first(mi.parser.instantiate(config, state))
    except RuntimeError as error:
        raise input_error(
            f"a scene that does not load in {mi.variant()} ({str(error).strip()})",
            "a scene that Mitsuba renders",
            "Load it with mitsuba.load_file or load_dict to see what is wrong.",
        ) from error
    if not isinstance(scene, mi.Scene):
        raise input_error(f"a {type(scene).__name__}", "a scene", "Put it into a scene first.")
    # instantiating replaces references by the objects that they stand for
    again = _parse(source, config)
    nodes: list[Any] = [None] * len(again.nodes)
    for before, after in zip(again.nodes, state.nodes, strict=True):
        for name in list(before.props.keys()):
            if before.props.type(name) == mi.Properties.Type.ResolvedReference:
                nodes[before.props[name].index()] = after.props[name]
    return scene, _Source(source, config, tuple(nodes))


def _first(loaded: Any) -> Any:
    return loaded[0] if isinstance(loaded, list | tuple) else loaded


# --- walking -------------------------------------------------------------------------------------


def _walk(node: Any, path: str, seen: list[Any]) -> Iterator[tuple[str, Any]]:
    """All BSDFs that shapes below `node` use, each once, with the path to it."""
    for number, (name, child) in enumerate(children(node).items()):
        if not isinstance(child, mi.Object) or any(child is known for known in seen):
            continue
        if isinstance(node, mi.Scene) and isinstance(child, mi.BSDF):
            continue  # defined, but not by that alone in use
        seen.append(child)
        if name.startswith("object_"):  # without an id: an address
            name = f"{child.class_name().lower()}-{number}"
        where = f"{path}.{name}" if path else name
        if isinstance(child, mi.BSDF):
            yield where, child
        yield from _walk(child, where, seen)


def _inventory(scene: Any) -> Inventory:
    lights = list(scene.emitters())
    contrast = max((_contrast(light) for light in lights), default=1.0)
    surfaces: list[Surface] = []
    objects: list[Any] = []
    left: list[LeftExact] = []
    for path, bsdf in _walk(scene, "", []):
        kind = bsdf.class_name()
        name = bsdf.id() or path
        if kind in CONDUCTORS:
            found = _conductor(name, bsdf, kind, contrast)
            if isinstance(found, Surface):
                surfaces.append(found)
                objects.append(bsdf)
            else:
                left.append(found)
        elif kind in _NO_COUNTERPART:
            left.append(_without_counterpart(name, bsdf, kind, contrast))
    classes = tuple(sorted({light.class_name() for light in lights}))
    return Inventory(tuple(surfaces), tuple(left), classes, tuple(objects))


def _conductor(name: str, bsdf: Any, kind: str, contrast: float) -> Surface | LeftExact:
    parts = children(bsdf)
    plugin = CONDUCTORS[kind]
    textures = [parts["eta"], parts["k"]]
    if not all(texture.class_name().endswith("Spectrum") for texture in textures):
        gain = "a table of coefficients, one per texel, which decomposed_conductor makes of eta, k"
        return LeftExact(name, plugin, "its index is textured", gain)
    eta, k = (_spectrum(texture) for texture in textures)
    eta, k = np.broadcast_arrays(eta, k)
    if not (np.all(eta > 0.0) and np.all(k >= 0.0)):
        return LeftExact(name, plugin, "its index is not positive: a mirror, or a gap in the data")
    wavelengths = np.linspace(360.0, 830.0, len(eta)) if mi.is_spectral and len(eta) > 1 else None
    if plugin == "conductor":
        smooth = Surface(name, eta, k, None, contrast, wavelength_nm=wavelengths)
        why = "it is perfectly smooth, and decomposed_conductor is not"
        return LeftExact(name, plugin, why, surface=smooth)
    ggx = re.search(r"distribution = ggx", str(bsdf), re.I)
    return Surface(
        name,
        eta,
        k,
        _roughness([parts[key] for key in ("alpha", "alpha_u", "alpha_v") if key in parts]),
        contrast,
        "ggx" if ggx else "beckmann",
        wavelengths,
    )


def _without_counterpart(name: str, bsdf: Any, kind: str, contrast: float) -> LeftExact:
    plugin = _NO_COUNTERPART[kind]
    why = f"there is no counterpart of '{plugin}' with another Fresnel term"
    params = mi.traverse(bsdf)
    if "eta" not in params:
        return LeftExact(name, plugin, why, "it has a Fresnel term of its own")
    eta = float(np.ravel(np.array(dr.detach(params["eta"]), float))[0])
    if eta < 1.0:
        return LeftExact(name, plugin, f"{why}, and eta < 1 reflects totally")
    alpha = None
    if "alpha" in params:
        values = np.ravel(np.array(dr.detach(params["alpha"]), float))
        alpha = (float(values.min()), float(values.max()))
    elif "alpha.value" in params:
        alpha = _roughness([children(bsdf)["alpha"]])
    surface = Surface(name, [eta], [0.0], alpha, contrast)
    inside = " (from inside, eta < 1 stays exact)" if "ielectric" in kind else ""
    return LeftExact(name, plugin, why + inside, surface=surface)


def _contrast(light: Any) -> float:
    """Variance of what a light sends from all around, relative to its squared mean."""
    kind = light.class_name()
    if kind == "ConstantBackgroundEmitter":
        return 1.0  # not 0: objects hide a part of it
    if kind != "EnvironmentMapEmitter":
        return np.inf  # may be as small as a point, or has a sun
    texels = np.array(mi.traverse(light)["data"], np.float64)[..., :3].mean(axis=-1)
    area = np.sin(np.pi * (np.arange(len(texels)) + 0.5) / len(texels))[:, None]
    area = np.broadcast_to(area / area.sum() / texels.shape[1], texels.shape)
    mean = float((area * texels).sum())
    if mean <= 0.0:
        return 1.0
    return 1.0 + float((area * (texels / mean - 1.0) ** 2).sum())


def _spectrum(texture: Any) -> np.ndarray:
    return np.array(stored_values(texture)[0], np.float64).ravel()


def _roughness(textures: Sequence[Any]) -> tuple[float, float]:
    values = [np.array(v, np.float64).ravel() for t in textures for v in stored_values(t)]
    if len(values) < len(textures):
        return _UNKNOWN_ALPHA
    joined = np.concatenate(values)
    return float(joined.min()), float(joined.max())


# --- rewriting -----------------------------------------------------------------------------------


def _planned(old: Any, choice: Choice, recipe: str) -> Any:
    """Properties of `decomposed_conductor` that stand for those of `roughconductor`."""
    new = mi.Properties("decomposed_conductor")
    new.set_id(old.id())
    by_index = choice.model != "decomposition" or mi.is_spectral
    for name in list(old.keys()):
        if name in _COPIED or (by_index and name in ("material", "eta", "k")):
            new[name] = old[name]
    new["fresnel"] = choice.model
    if choice.model == "decomposition":
        new["recipe"] = recipe
        if not mi.is_spectral:
            # in spectral variants negative colours have no spectrum: eta and k are projected there
            assert choice.coefficients is not None
            new["terms"] = choice.coefficients.shape[1]
            for i, values in enumerate(choice.coefficients.T):
                new[f"c{i}"] = (
                    float(values[0])
                    if len(values) == 1
                    else mi.ScalarColor3f([float(value) for value in values])
                )
        elif not recipe.endswith(".json"):
            new["terms"] = choice.numbers
    elif "material" not in old and "eta" not in old:
        new["material"] = "none"
    return new

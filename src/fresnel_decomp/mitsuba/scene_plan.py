"""Plans for Mitsuba scenes: find what reflects, choose its Fresnel term, put it into the scene.

To change a scene, the parsed form of its XML file or dictionary is changed and instantiated or
written anew, so that everything else stays as its author wrote it.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mitsuba as mi

from .._check import input_error
from .._files import writable_folder, write_text
from ..basis import Basis
from ..plan import Choice, Plan, plan_surfaces
from ..prediction import Metric
from . import register
from .inventory import take_inventory
from .scene_source import ParsedScene, Source, load_source

__all__ = ["ScenePlan", "plan_scene"]

_COPIED = ("alpha", "alpha_u", "alpha_v", "distribution", "sample_visible", "specular_reflectance")


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
    _source: ParsedScene | None = field(repr=False)
    _objects: tuple[Any, ...] = field(repr=False)

    def apply(self) -> Any:
        """The scene with the plan in it, loaded in the active variant.

        Raises
        ------
        InputError
            If the plan was made for a loaded scene, or for another variant.
        """
        source = self._rewritable()
        state = source.parse()
        with tempfile.TemporaryDirectory(prefix="fresnel-plan-") as folder:
            path = Path(folder) / "basis.json"
            if self._own_basis is not None:
                self._own_basis.save(path)
            self._rewrite(state, source.nodes, str(path))
            return source.instantiate(state)

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
        writable_folder(target.parent)
        state = source.parse()
        basis_path = target.with_name(f"{target.stem}-basis.json")
        self._rewrite(state, source.nodes, basis_path.name)
        try:
            text = mi.parser.write_string(state)
        except RuntimeError as error:
            raise input_error(
                f"a scene that XML cannot hold ({str(error).strip()})",
                "a scene of numbers, strings and file names",
                "Use apply(), which loads it instead.",
            ) from error
        if self._own_basis is not None:
            self._own_basis.save(basis_path)
        write_text(target, text)

    def _rewritable(self) -> ParsedScene:
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

    @property
    def _own_basis(self) -> Basis | None:
        basis = self.plan.basis
        return basis if basis is not None and basis.recipe == "custom" else None

    def _rewrite(self, state: Any, nodes: Sequence[Any], basis_file: str) -> None:
        basis = self.plan.basis
        recipe = "" if basis is None else basis.recipe
        recipe = basis_file if recipe == "custom" else recipe
        for choice, surface_object in zip(self.plan.choices, self._objects, strict=True):
            if choice.model == "exact":
                continue
            for index, node in enumerate(nodes):
                if node is surface_object:
                    old = state.nodes[index].props
                    state.nodes[index].props = _planned(old, choice, recipe)


def plan_scene(
    source: Source,
    max_error: float,
    metric: Metric = "reflectance",
    *,
    contrast: float | None = None,
    **options: Any,
) -> ScenePlan:
    """Choose the cheapest Fresnel term for each conductor of a scene.

    Parameters
    ----------
    source : path, dict or mi.Scene
        An XML file, a dictionary, or a loaded scene (whose plan can be read but not applied).
        Dictionaries are parsed twice, so they should not hold tensors, which Mitsuba empties.
    max_error, metric, **options
        As for `plan.plan_surfaces`.
    contrast : float >= 0, optional
        Of the light, by default what the emitters have; infinite holds in any light. What objects
        hide of it is not looked for: in a cave the default predicts too little.

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
    >>> planned = plan_scene(scene, 0.2)
    >>> [choice.model for choice in planned.plan.choices]
    ['schlick']
    """
    scene, parsed = load_source(source)
    found = take_inventory(scene, contrast)
    plan = plan_surfaces(found.surfaces, max_error, metric, left=found.left, **options)
    return ScenePlan(plan, found.lights, str(mi.variant()), parsed, found.objects)


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

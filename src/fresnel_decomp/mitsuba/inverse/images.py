"""What inverse rendering asks of a renderer: images of an unknown conductor, and their derivatives.

The samples of an image depend on its seed and on roughness alone, neither on the Fresnel term nor,
as Russian roulette is off, on what it reflects. So all images of one seed share their paths, and
differences between them are derivatives along these paths, exact where the dependence is linear.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..._check import input_error
from ...basis import Basis
from ..comparison import render_scene

__all__ = [
    "KINDS",
    "RANGES",
    "Images",
    "Setup",
    "derived_seed",
    "half_seed",
    "names_of",
    "require_rgb",
]

Array = NDArray[np.float64]
Setup = Callable[[dict[str, Any]], dict[str, Any]]
"""From the dictionary of a BSDF to that of a scene."""

KINDS = ("coefficients", "nodes", "indices", "gulbrandsen")

RANGES = {
    "eta": (0.02, 20.0),
    "k": (0.0, 20.0),
    "r": (0.0, 1.0 - 1e-4),
    "g": (0.0, 1.0),
    "alpha": (0.005, 1.0),
}
"""Where values are kept; reflectances and coefficients are free."""

_PATHS = ("path", "prb", "prb_basic")
"""Integrators of which `max_depth` is known."""

_MARK = 0.2371
"""The roughness by which the conductor is found among a scene's parameters: names are Mitsuba's."""


def require_rgb() -> None:
    """Refuse variants in which images have not three channels that stay apart."""
    if mi.variant() is None or "_rgb" not in mi.variant() or "polarized" in mi.variant():
        raise input_error(
            f"variant {mi.variant()}", "an RGB variant", "Call mi.set_variant('llvm_ad_rgb')."
        )


def names_of(kind: str, terms: int) -> tuple[str, ...]:
    """Names of the plugin's parameters of one kind."""
    return {
        "coefficients": tuple(f"c{i}" for i in range(terms)),
        "nodes": tuple(f"f{i}" for i in range(terms - 1)),
        "indices": ("eta", "k"),
        "gulbrandsen": ("r", "g"),
    }[kind]


def derived_seed(seed: int, *path: int) -> int:
    """A seed of its own for every view, half and purpose."""
    return int(np.random.SeedSequence([seed, *path]).generate_state(1)[0])


def half_seed(seed: int, half: int, view: int) -> int:
    """The seed of `render_scene` with which `Images.render` renders a view, given
    `derived_seed(seed, half)`."""
    return derived_seed(derived_seed(seed, half), view)


class Images:
    """Renders the scenes with values of one set of parameters.

    Parameters
    ----------
    setups : sequence of Setup
    kind : one of `KINDS`
    basis : Basis
    fresnel, distribution : str
        As the plugin takes them.
    """

    def __init__(
        self,
        setups: Sequence[Setup],
        kind: str,
        basis: Basis,
        *,
        fresnel: str = "decomposition",
        distribution: str = "ggx",
    ) -> None:
        self.basis, self.names = basis, names_of(kind, basis.terms)
        self.samples = 0
        bsdf: dict[str, Any] = {
            "type": "decomposed_conductor",
            "fresnel": fresnel,
            "distribution": distribution,
            "alpha": _MARK,
            "recipe": basis.recipe,
            "terms": basis.terms,
        }
        start = {"eta": 1.5, "k": 1.0}
        for name in self.names:
            value = start.get(name, 0.5)
            bsdf[name] = {"type": "rgb", "value": [value] * 3}
        loaded = [_load(setup, dict(bsdf), i) for i, setup in enumerate(setups)]
        self.scenes = [scene for scene, _ in loaded]
        self.integrators = [integrator for _, integrator in loaded]
        self.depth = max((int(each["max_depth"]) for each in self.integrators), default=0)
        self.sizes = [tuple(scene.sensors()[0].film().size()) for scene in self.scenes]
        self.parameters = [mi.traverse(scene) for scene in self.scenes]
        self.keys = [self._keys(found) for found in self.parameters]

    def _keys(self, parameters: Any) -> dict[str, str]:
        """Mitsuba's names of the conductor's parameters."""
        found = [
            key.removesuffix("alpha.value")
            for key in parameters.keys()  # noqa: SIM118
            if key.endswith(".alpha.value") and abs(_number(parameters[key]) - _MARK) < 1e-6
        ]
        if len(found) != 1:
            raise input_error(
                f"a scene with the conductor to recover in {len(found)} places",
                "functions that put the BSDF they are given into the scene, once",
                "For example: lambda bsdf: lit_object(bsdf, light, size=64).",
            )
        names = (*self.names, "alpha")
        return {name: f"{found[0]}{name}.value" for name in names}

    def put(self, values: ArrayLike, alpha: float) -> None:
        """Set the parameters.

        Parameters
        ----------
        values : (n, 3) float
            Rows in the order of `names`.
        alpha : float
        """
        rows = np.asarray(values, np.float64)
        for parameters, keys in zip(self.parameters, self.keys, strict=True):
            for name, row in zip(self.names, rows, strict=True):
                parameters[keys[name]] = mi.Color3f(row.tolist())
            parameters[keys["alpha"]] = mi.Float(float(alpha))
            parameters.update()

    def render(self, values: ArrayLike, alpha: float, spp: int, seed: int) -> Array:
        """(m, 3): pixels of all scenes. Raises `InputError` if one of them is not finite."""
        self.put(values, alpha)
        parts = []
        for i, scene in enumerate(self.scenes):
            image = render_scene(scene, spp, derived_seed(seed, i))
            self.samples += spp * image.shape[0] * image.shape[1]
            if not np.isfinite(image).all():
                raise input_error(
                    f"scene {i} with radiance that is not finite",
                    "light of finite strength",
                    "Look at its emitters and textures for infinity and NaN.",
                )
            parts.append(image.reshape(-1, 3).astype(np.float64))
        return np.concatenate(parts)

    def derivative(
        self, values: ArrayLike, alpha: float, spp: int, seed: int, steps: ArrayLike
    ) -> Array:
        """(m, 3, n): by each parameter, all of whose channels are independent of each other.

        By central differences with the same samples: exact where images are of second order in
        what they are differentiated by, that is for light that meets the conductor at most twice.
        """
        x = np.asarray(values, np.float64)
        columns = []
        for i, step in enumerate(np.asarray(steps, np.float64)):
            d = np.zeros_like(x)
            d[i] = step
            up = self.render(x + d, alpha, spp, seed)
            down = self.render(x - d, alpha, spp, seed)
            columns.append((up - down) / (2.0 * step))
        return np.stack(columns, axis=-1)

    def roughness_derivative(self, values: ArrayLike, alpha: float, spp: int, seed: int) -> Array:
        """(m, 3): by alpha, as samples move with it."""
        step = 0.02 * alpha
        up = self.render(values, alpha + step, spp, seed)
        down = self.render(values, alpha - step, spp, seed)
        return (up - down) / (2.0 * step)


def _load(setup: Setup, bsdf: dict[str, Any], number: int) -> tuple[Any, dict[str, Any]]:
    """A scene and the options of its integrator, in which Russian roulette never starts."""
    scene = setup(bsdf)
    if not isinstance(scene, dict):
        raise input_error(
            f"scene {number} is a {type(scene).__name__}",
            "a function from a BSDF dictionary to a scene dictionary",
            "Return what you would give to mi.load_dict.",
        )
    given = scene.get("integrator", {"type": "path"})
    kind = given.get("type") if isinstance(given, dict) else type(given).__name__
    depth = 2 if kind == "direct" else given.get("max_depth", -1) if kind in _PATHS else -1
    if depth < 2:
        raise input_error(
            f"scene {number} with the integrator '{kind}' of max_depth {depth}",
            f"{', '.join(_PATHS)} with max_depth >= 2, or direct",
            "Give the number of bounces with which the images were made; 2 is direct light.",
        )
    options = {"max_depth": depth, "rr_depth": depth + 1}
    options["hide_emitters"] = given.get("hide_emitters", False)
    return mi.load_dict({**scene, "integrator": {"type": "path", **options}}), options


def _number(value: Any) -> float:
    return float(np.asarray(value).ravel()[0])

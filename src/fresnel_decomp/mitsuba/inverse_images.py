"""What inverse rendering asks of a renderer: images of an unknown conductor, and their derivatives.

The samples of an image depend on its seed and on roughness alone, neither on the Fresnel term nor,
as Russian roulette is off, on what it reflects. So all images of one seed share their paths, and
differences between them are derivatives along these paths, exact where the dependence is linear.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import uniform_filter

from .._check import input_error
from ..basis import Basis
from .comparison import render_scene

__all__ = [
    "KINDS",
    "Images",
    "Observed",
    "Setup",
    "derived_seed",
    "half_seed",
    "names_of",
    "observe",
]

Array = NDArray[np.float64]
Setup = Callable[[dict[str, Any]], dict[str, Any]]
"""From the dictionary of a BSDF to that of a scene."""

KINDS = ("coefficients", "nodes", "indices", "gulbrandsen")

_MARK = 0.2371
"""The roughness by which the conductor is found among a scene's parameters: names are Mitsuba's."""

_MISFIT = 0.01  # of the radiance: what a basis may be off by, which no number of samples cures
_FAINT = 0.1  # of the mean radiance: below this, errors count by their size


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
    """The seed that `Images.render` takes for a view, given `derived_seed(seed, half)`."""
    return derived_seed(derived_seed(seed, half), view)


class Observed:
    """The images, flat, with what each pixel should count.

    Attributes
    ----------
    values : (m, 3) float
        Pixels of all images, one after the other.
    shapes : list of (height, width)
    weight : (m, 3) float
        One over the variance, up to a factor. Until noise is known, errors count relative to the
        radiance around.
    known_noise : (m, 3) float or None
        Standard deviation.
    """

    def __init__(self, images: Sequence[Array], noise: Any = None) -> None:
        self.shapes = [image.shape[:2] for image in images]
        self.values = np.concatenate([image.reshape(-1, 3) for image in images])
        self.known_noise = None if noise is None else _noise(noise, images)
        smooth = self.smoothed(np.abs(self.values))
        self.brightness = np.maximum(smooth, _FAINT * smooth.mean())
        variance = self.brightness**2
        if self.known_noise is not None:
            variance = self.known_noise**2 + (_MISFIT * self.brightness) ** 2
        self.weight = 1.0 / variance

    @property
    def count(self) -> int:
        """Of numbers that have a weight."""
        return max(int(np.count_nonzero(self.weight)), 1)

    def noise_and_residual(self, predicted: Array, visible: NDArray[Any]) -> tuple[float, float]:
        """RMS differences from `predicted` (m, 3), relative to the mean radiance.

        As noise explains them, and as they are, over `visible` (m,) pixels that count.
        """
        counted = visible[:, None] & (self.weight > 0.0)
        residual = (self.values - predicted)[counted]
        expected = 1.0 / self.weight[counted]
        if self.known_noise is None:
            expected = expected * np.median(residual**2 / expected) / 0.455
        size = float(self.values[counted].mean())
        rms = [float(np.sqrt(np.mean(square))) / size for square in (expected, residual**2)]
        return rms[0], rms[1]

    def smoothed(self, flat: Array) -> Array:
        """Means over 5 x 5 pixels."""
        parts, at = [], 0
        for height, width in self.shapes:
            image = flat[at : at + height * width].reshape(height, width, -1)
            parts.append(uniform_filter(image, (5, 5, 1), mode="nearest").reshape(-1, 3))
            at += height * width
        return np.concatenate(parts)

    def weigh(self, difference: Array, residual: Array) -> None:
        """Take noise into the weight, from what two renderings of the model differ by.

        Parameters
        ----------
        difference : (m, 3) float
            Between the two halves.
        residual : (m, 3) float
            Of the images against the mean of both. The images' own noise is taken to be spread as
            the model's is; how strong it is shows in the residual.
        """
        spread = self.smoothed(difference**2)
        misfit = (_MISFIT * self.brightness) ** 2
        if self.known_noise is not None:
            self.weight = 1.0 / (0.25 * spread + self.known_noise**2 + misfit)
            return
        inside = spread > 0.0
        if not inside.any():
            return
        # robust: a few pixels hold what the model cannot explain
        ratio = float(np.median(residual[inside] ** 2 / spread[inside])) / 0.455
        self.weight = 1.0 / (max(ratio, 0.25) * spread + misfit)


class Images:
    """Renders the scenes with values of one set of parameters.

    Parameters
    ----------
    setups : sequence of Setup
    kind : one of `KINDS`
    basis : Basis
    fresnel, distribution : str
        As the plugin takes them.
    textures : mapping, optional
        Properties instead of uniform values, for which `put` is then not used.
    """

    def __init__(
        self,
        setups: Sequence[Setup],
        kind: str,
        basis: Basis,
        *,
        fresnel: str = "decomposition",
        distribution: str = "ggx",
        textures: Mapping[str, Any] | None = None,
    ) -> None:
        self.kind, self.basis, self.names = kind, basis, names_of(kind, basis.terms)
        self.samples = 0
        self.begun = time.perf_counter()
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
        bsdf.update(textures or {})
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

    @property
    def seconds(self) -> float:
        """Since the first scene was loaded."""
        return time.perf_counter() - self.begun

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

    def render(self, values: ArrayLike | None, alpha: float, spp: int, seed: int) -> Array:
        """(m, 3): pixels of all scenes. Without values, with those set before."""
        if values is not None:
            self.put(values, alpha)
        parts = []
        for i, scene in enumerate(self.scenes):
            image = render_scene(scene, spp, derived_seed(seed, i))
            self.samples += spp * image.shape[0] * image.shape[1]
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


_PATHS = ("path", "prb", "prb_basic")


def observe(images: Any, films: Sequence[tuple[int, int]], noise: Any) -> Observed:
    """Check images against the films of the scenes."""
    single = isinstance(images, np.ndarray) and images.ndim == 3
    arrays = [np.asarray(image, np.float64) for image in ([images] if single else images)]
    if not films:
        raise input_error("no scene", "one for each image", "Give the scenes of the images.")
    if len(arrays) != len(films):
        raise input_error(
            f"{len(arrays)} images and {len(films)} scenes",
            "one scene for each image",
            "Give a function that makes the scene for each camera or light.",
        )
    for i, (image, (width, height)) in enumerate(zip(arrays, films, strict=True)):
        if image.shape != (height, width, 3):
            raise input_error(
                f"image {i} of shape {image.shape}",
                f"{(height, width, 3)}, as its scene's film",
                "Give linear RGB, without alpha.",
            )
        if not np.isfinite(image).all():
            strange = np.count_nonzero(~np.isfinite(image))
            raise input_error(
                f"image {i} with {strange} numbers that are not finite",
                "finite radiance",
                "Mask broken pixels: set them to 0 and their noise to infinity.",
            )
    return Observed(arrays, noise)


def _noise(noise: Any, images: Sequence[Array]) -> Array:
    """Standard deviations for all pixels, from a number or from arrays like the images."""
    if np.ndim(noise) == 0:
        parts = [np.full(image.shape, float(noise)) for image in images]
    else:
        single = isinstance(noise, np.ndarray) and noise.ndim in (2, 3) and len(images) == 1
        given = [noise] if single else list(noise)
        parts = []
        for image, part in zip(images, given, strict=False):
            values = np.asarray(part, np.float64)
            values = values[..., None] if values.ndim == 2 else values
            if values.shape[:2] != image.shape[:2]:
                raise input_error(
                    f"noise of shape {values.shape}", f"{image.shape}", "Give it as the images."
                )
            parts.append(np.broadcast_to(values, image.shape))
        if len(parts) != len(images):
            raise input_error(
                f"noise for {len(parts)} images", f"for {len(images)}", "Give it as the images."
            )
    flat = np.concatenate([part.reshape(-1, 3) for part in parts])
    if not (np.all(flat > 0.0)):
        raise input_error(
            "noise that is not positive", "standard deviations > 0", "Give None to estimate it."
        )
    return flat

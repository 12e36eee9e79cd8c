"""One scene, several Fresnel models, the same random numbers: what is left is the model.

Sampling does not depend on the Fresnel term and Russian roulette is off in our scenes, so two
same-seed images use the same paths and differ by the reflectance along them, without noise of
their own.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._check import choose, input_error, is_whole
from .._files import writable_folder
from .._version import __version__
from ..basis import load_basis
from ..images import read_exr, read_exr_attributes, write_exr
from ..microfacet import DISTRIBUTIONS
from .fresnel_terms import FRESNEL_TERMS
from .scenes import load_scene
from .variants import variant_scope

__all__ = [
    "MODELS",
    "conductor_bsdf",
    "model_bsdfs",
    "render_bsdfs",
    "render_models",
    "render_passes",
    "render_scene",
]

MODELS = ("exact", "decomposition", "schlick")

_SETTINGS = "fresnelDecompSettings"  # attribute of our EXR files: what an image was made from
_WAVEFRONT = 2**22  # samples traced at once: memory, and the time until Ctrl-C is heard
_WAVEFRONT_SCALAR = 2**17

Progress = Callable[[str, float], None]


def _index(name: str, value: ArrayLike, wavelength_nm: ArrayLike | None) -> float | dict[str, Any]:
    values = np.asarray(value, dtype=np.float64)
    valid = np.isfinite(values) & (values > 0.0 if name == "eta" else values >= 0.0)
    if not valid.all():
        raise input_error(
            f"{name} with the value {values[~valid].flat[0]:g}",
            "finite eta > 0 and k >= 0",
            "Absorbing media have k > 0 in the convention eta + i k.",
        )
    if wavelength_nm is not None:
        wavelengths = np.asarray(wavelength_nm, dtype=np.float64)
        if values.ndim != 1 or values.shape != wavelengths.shape or len(values) < 2:
            raise input_error(
                f"{name} of shape {values.shape} for wavelengths of shape {wavelengths.shape}",
                "two (n,) arrays with n ≥ 2",
                "Give one value per wavelength.",
            )
        if not values.any():
            return 0.0  # Mitsuba has no spectra that are 0 everywhere
        pairs = zip(wavelengths.tolist(), values.tolist(), strict=True)
        return {"type": "spectrum", "value": list(pairs)}
    if values.shape not in ((), (1,), (3,)):
        raise input_error(
            f"{name} of shape {values.shape}",
            "one number, or three: red, green and blue",
            "Pass wavelength_nm for a spectrum.",
        )
    return {"type": "rgb", "value": values.tolist()} if values.size == 3 else values.item()


def _suits(variant: str, eta: ArrayLike, k: ArrayLike, wavelength_nm: ArrayLike | None) -> None:
    """Refuse indices that Mitsuba would convert: it treats them as colours, which they are not."""
    if wavelength_nm is not None:
        if "spectral" not in variant:
            raise input_error(
                f"spectral indices for {variant}",
                "one number or (3,) arrays in RGB variants",
                "Choose a spectral variant, or integrate the spectra first.",
            )
    elif "rgb" not in variant and max(np.size(eta), np.size(k)) == 3:
        raise input_error(
            f"RGB indices for {variant}",
            "one number, or in spectral variants (n,) arrays with wavelength_nm",
            "Choose an RGB variant, or pass spectra.",
        )


def conductor_bsdf(
    eta: ArrayLike,
    k: ArrayLike,
    *,
    alpha: float = 0.1,
    fresnel: str = "exact",
    wavelength_nm: ArrayLike | None = None,
    distribution: str = "ggx",
    recipe: str = "talk",
    terms: int | None = None,
) -> dict[str, Any]:
    """The dictionary of a `decomposed_conductor`.

    Parameters
    ----------
    eta, k : float or (3,) float array, or (n,) with `wavelength_nm`
        Relative index of refraction and extinction: grey, per RGB channel, or spectral.
    alpha : float in (0, 1]
        Roughness of the microfacet distribution (not the perceptual roughness, its square root).
    fresnel : 'exact', 'decomposition', 'schlick' or 'f82'
        The model that evaluates eta and k.
    wavelength_nm : (n,) float array, optional
        Makes eta and k spectra; for spectral variants, which would turn RGB into a colour.
    distribution : 'ggx' or 'beckmann'
    recipe, terms
        The basis, for `fresnel='decomposition'`; see `load_basis`.

    Returns
    -------
    dict
        For `mi.load_dict`, once the plugin is registered.

    Raises
    ------
    InputError
        For values that the plugin would refuse: its errors come out of Mitsuba as RuntimeErrors.
    """
    if not 0.0 < alpha <= 1.0:
        raise input_error(f"alpha={alpha}", "a number in (0, 1]", "Mirrors need alpha near 1e-3.")
    bsdf: dict[str, Any] = {
        "type": "decomposed_conductor",
        "eta": _index("eta", eta, wavelength_nm),
        "k": _index("k", k, wavelength_nm),
        "alpha": float(alpha),
        "distribution": choose("distribution", distribution, DISTRIBUTIONS),
        "fresnel": choose("fresnel", fresnel, FRESNEL_TERMS),
    }
    if fresnel == "decomposition":
        basis = load_basis(recipe, terms)
        basis.coefficients(eta, k)  # refuses indices that fit badly
        bsdf |= {"recipe": recipe, "terms": basis.terms}
    return bsdf


def model_bsdfs(
    eta: ArrayLike, k: ArrayLike, models: Sequence[str] = MODELS, **options: Any
) -> dict[str, dict[str, Any]]:
    """One `conductor_bsdf` for each model, alike in everything but `fresnel`."""
    return {model: conductor_bsdf(eta, k, fresnel=model, **options) for model in models}


def _grid(samples: int) -> bool:
    """Whether a stratified square or nearly square grid has this many cells (see below)."""
    side = math.isqrt(samples)
    return samples in (side * side, side * (side + 1))


def _passes(spp: int, limit: int) -> list[int]:
    """Split spp into passes of at most `limit`, each a number the multijitter sampler takes as is.

    That sampler rounds other numbers up, which would make passes of different weight.
    """
    limit = max(1, limit)
    even = max(d for d in range(1, min(spp, limit) + 1) if spp % d == 0 and _grid(d))
    if 4 * even >= min(spp, limit):
        return [even] * (spp // even)
    passes = []
    while spp:
        passes.append(max(d for d in range(1, min(spp, limit) + 1) if _grid(d)))
        spp -= passes[-1]
    return passes


def render_scene(
    scene: Any, spp: int = 64, seed: int = 0, progress: Callable[[float], None] | None = None
) -> NDArray[np.float32]:
    """Render a loaded scene in the active variant, in passes small enough for memory and Ctrl-C.

    Parameters
    ----------
    scene : mi.Scene
    spp : int, ≥ 1
        Samples per pixel.
    seed : int, ≥ 0
        Pass i of any scene of this size draws the same random numbers for the same seed.
    progress : callable, optional
        Called with the fraction done, in (0, 1], after each pass.

    Returns
    -------
    (height, width, 3) float32 array
        Linear sRGB; grey in monochrome variants.

    Raises
    ------
    InputError
        For bad numbers, and films with other channels.
    """
    import mitsuba as mi

    if not is_whole(spp, 1):
        raise input_error(
            f"spp={spp!r}", "an integer ≥ 1", "64 gives clean pictures of our scenes."
        )
    if not is_whole(seed, 0):
        raise input_error(f"seed={seed!r}", "an integer ≥ 0", "Any will do.")
    total = np.zeros((), dtype=np.float64)
    done = 0
    for samples, own_seed in render_passes(scene, spp, seed):
        with _interruptible():
            image = mi.render(scene, spp=samples, seed=own_seed)
        total = total + samples * np.array(image, np.float64)
        done += samples
        if progress is not None:
            progress(done / spp)
    mean: NDArray[np.float32] = (total / spp).astype(np.float32)
    if mean.shape[2] not in (1, 3):
        raise input_error(
            f"a film of {mean.shape[2]} channels",
            "three, or one in monochrome variants",
            "Give the film the pixel_format 'rgb', and the scene an integrator without AOVs.",
        )
    return mean if mean.shape[2] == 3 else np.repeat(mean, 3, axis=2)


def render_passes(scene: Any, spp: int, seed: int) -> list[tuple[int, int]]:
    """Samples and Mitsuba's seed of each pass of `render_scene`."""
    import mitsuba as mi

    width, height = scene.sensors()[0].film().size()
    scalar = str(mi.variant()).startswith("scalar")
    limit = (_WAVEFRONT_SCALAR if scalar else _WAVEFRONT) // (width * height)
    passes = _passes(spp, limit)
    seeds = np.random.SeedSequence(seed).generate_state(len(passes)).tolist()
    return list(zip(passes, seeds, strict=True))


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """Ctrl-C inside a Python plugin reaches us as a RuntimeError of Mitsuba's: undo that."""
    try:
        yield
    except RuntimeError as error:
        if isinstance(error.__cause__, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        raise


def render_bsdfs(
    bsdfs: Mapping[str, Any],
    *,
    scene: str = "studio",
    size: int | tuple[int, int] = 256,
    spp: int = 64,
    seed: int = 0,
    variant: str | None = None,
    folder: str | os.PathLike[str] | None = None,
    stem: str = "render",
    progress: Progress | None = None,
) -> dict[str, NDArray[np.float32]]:
    """Render one scene with each BSDF, same seed and same samples.

    Parameters
    ----------
    bsdfs : mapping of names to BSDF dictionaries
    scene : 'studio' or 'shader-ball'
    size : int or (width, height)
    spp, seed
        As for `render_scene`.
    variant : str, optional
        Mitsuba variant, by default the active one; restored afterwards.
    folder : path, optional
        Write each image to `<stem>_<name>.exr` there as soon as it is finished. A file that was
        made from the same settings by the same versions is read instead of rendered again, so an
        interrupted run goes on where it stopped.
    stem : str
    progress : callable, optional
        Called with the name of the model and the fraction of its image that is done.

    Returns
    -------
    dict of (height, width, 3) float32 arrays
        Linear sRGB, by name.

    Examples
    --------
    >>> bsdfs = model_bsdfs([1.35, 1.0, 0.62], [7.47, 6.4, 5.3], alpha=0.2)
    >>> images = render_bsdfs(bsdfs, size=16, spp=4, variant="scalar_rgb")
    >>> list(images), images["exact"].shape
    (['exact', 'decomposition', 'schlick'], (16, 16, 3))
    """
    import mitsuba as mi

    target = None if folder is None else writable_folder(folder)
    images = {}
    with variant_scope(variant) as active:
        for name, bsdf in bsdfs.items():
            settings = {
                "bsdf": bsdf,
                "basis": _basis_hash(bsdf),
                "scene": scene,
                "size": size,
                "spp": spp,
                "seed": seed,
                "variant": active,
                "fresnel_decomp": __version__,
                "mitsuba": mi.__version__,
            }
            text = json.dumps(settings, sort_keys=True, default=str)
            path = None if target is None else target / f"{stem}_{name}.exr"
            image = None if path is None else _finished(path, text)
            if image is None:

                def report(fraction: float, name: str = name) -> None:
                    if progress is not None:
                        progress(name, fraction)

                image = render_scene(load_scene(scene, bsdf, size), spp, seed, report)
                if path is not None:
                    software = f"fresnel_decomp {__version__}, Mitsuba {mi.__version__}"
                    write_exr(path, image, {"software": software, _SETTINGS: text})
            elif progress is not None:
                progress(name, 1.0)
            images[name] = image
    return images


def _basis_hash(bsdf: Mapping[str, Any]) -> str | None:
    """What a fitted BSDF's picture depends on besides its own dictionary."""
    if "recipe" not in bsdf:
        return None
    basis = load_basis(bsdf["recipe"], bsdf["terms"])
    return hashlib.sha256(json.dumps(basis.to_json()).encode()).hexdigest()


def _finished(path: Path, settings: str) -> NDArray[np.float32] | None:
    """The image at `path` if it was made from `settings`."""
    with contextlib.suppress(ValueError):  # not an EXR file: render it anew
        if path.is_file() and read_exr_attributes(path).get(_SETTINGS) == settings:
            return read_exr(path)
    return None


def render_models(
    eta: ArrayLike,
    k: ArrayLike,
    models: Sequence[str] = MODELS,
    *,
    alpha: float = 0.1,
    wavelength_nm: ArrayLike | None = None,
    distribution: str = "ggx",
    recipe: str = "talk",
    terms: int | None = None,
    **options: Any,
) -> dict[str, NDArray[np.float32]]:
    """Render a conductor with several Fresnel models that share indices, paths and samples.

    Parameters
    ----------
    eta, k, alpha, wavelength_nm, distribution, recipe, terms
        As for `conductor_bsdf`.
    models : sequence of str
        What `fresnel` takes; the names of the images.
    **options
        Go to `render_bsdfs`: scene, size, spp, seed, variant, folder, stem, progress.

    Returns
    -------
    dict of (height, width, 3) float32 arrays
        Linear sRGB, by model.
    """
    with variant_scope(options.get("variant")) as active:
        _suits(active, eta, k, wavelength_nm)
    bsdfs = model_bsdfs(
        eta,
        k,
        models,
        alpha=alpha,
        wavelength_nm=wavelength_nm,
        distribution=distribution,
        recipe=recipe,
        terms=terms,
    )
    return render_bsdfs(bsdfs, **options)

"""The images that are given, and what each pixel of them should count."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from ..._check import input_error

__all__ = ["Observed", "observe"]

Array = NDArray[np.float64]

_MISFIT = 0.01  # of the radiance: what a basis may be off by, which no number of samples cures
_FAINT = 0.1  # of the mean radiance: below this, errors count by their size


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


def observe(images: Any, films: Sequence[tuple[int, int]], noise: Any) -> Observed:
    """Check images (NumPy's, tensors, bitmaps) against the films of the scenes."""
    single = np.ndim(images) == 3 or isinstance(images, mi.Bitmap)
    arrays = [np.array(image, np.float64) for image in ([images] if single else images)]
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

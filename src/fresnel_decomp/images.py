"""Pictures as arrays: EXR files, one way to display them, and how far two of them are apart.

Images are (height, width, 3) float arrays in linear sRGB (Rec. 709 primaries, D65 white).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._check import input_error
from ._files import replacing
from .colour import delta_e_2000, linear_to_srgb

__all__ = [
    "PIXELS_PER_DEGREE",
    "ImageDifference",
    "compare",
    "delta_e",
    "display",
    "flip",
    "nrmse",
    "read_exr",
    "read_exr_attributes",
    "read_exr_planes",
    "rmse",
    "signed_difference",
    "write_exr",
]

PIXELS_PER_DEGREE = 67.0206
"""Viewing condition of FLIP: 0.7 m from a display 0.7 m wide with 3840 columns (its default)."""

_LUMINANCE = np.array([0.2126390059, 0.7151686788, 0.0721923154])  # Y of linear sRGB

_Image = NDArray[np.float32]


def _image(name: str, value: ArrayLike) -> _Image:
    image = np.asarray(value, dtype=np.float32)
    if image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
        raise input_error(
            f"{name} of shape {image.shape}",
            "an array of shape (height, width, 3)",
            "Drop alpha and repeat a grey channel three times.",
        )
    if not np.isfinite(image).all():
        raise input_error(
            f"{name} with {np.count_nonzero(~np.isfinite(image))} values that are not finite",
            "finite radiance",
            "Find the pixels with np.argwhere(~np.isfinite(image)).",
        )
    return image


def _pair(reference: ArrayLike, test: ArrayLike) -> tuple[_Image, _Image]:
    first, second = _image("reference", reference), _image("test", test)
    if first.shape != second.shape:
        raise input_error(
            f"reference of shape {first.shape} and test of shape {second.shape}",
            "two images of one shape",
            "Render both at the same size.",
        )
    return first, second


def write_exr(
    path: str | os.PathLike[str],
    image: ArrayLike | Mapping[str, ArrayLike],
    attributes: Mapping[str, str] | None = None,
) -> None:
    """Write an OpenEXR file, losslessly compressed, whole or not at all.

    Parameters
    ----------
    path : path
        Ends in `.exr`.
    image : (height, width, 3) array, (height, width) array, or mapping of names to such planes
        Three channels are named R, G and B, a single one Y. float16 is stored as half floats, all
        else as float32.
    attributes : mapping of str to str, optional
        Metadata for the header, for instance ``{"software": ..., "recipe": "talk"}``.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     write_exr(f"{folder}/a.exr", np.full((2, 3, 3), 0.5), {"comments": "a grey card"})
    ...     read_exr(f"{folder}/a.exr").shape, read_exr_attributes(f"{folder}/a.exr")["comments"]
    ((2, 3, 3), 'a grey card')
    """
    import OpenEXR

    if isinstance(image, Mapping):
        planes = {name: _storable(plane) for name, plane in image.items()}
    elif np.ndim(image) == 2:
        planes = {"Y": _storable(image)}
    else:
        values = _storable(image)
        if values.ndim != 3 or values.shape[2] != 3:
            raise input_error(
                f"image of shape {values.shape}",
                "(height, width, 3), (height, width), or a mapping of channel names to planes",
                "Name other channels with a mapping.",
            )
        planes = {name: values[..., i] for i, name in enumerate("RGB")}
    shapes = {plane.shape for plane in planes.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2 or 0 in next(iter(shapes)):
        raise input_error(
            f"channels of shapes {sorted(shapes)}",
            "one shape (height, width), not empty, for all channels",
            "Resize the planes.",
        )
    header: dict[str, Any] = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        **(attributes or {}),
    }
    channels = {name: np.ascontiguousarray(plane) for name, plane in planes.items()}
    with replacing(path) as temporary:
        OpenEXR.File(header, channels).write(str(temporary))


def _storable(plane: ArrayLike) -> NDArray[Any]:
    """An array of a type that EXR has."""
    array = np.asarray(plane)
    return array if array.dtype == np.float16 else np.asarray(array, np.float32)


def read_exr(path: str | os.PathLike[str]) -> _Image:
    """Read channels R, G and B of an OpenEXR file, or its only channel three times over.

    Returns
    -------
    (height, width, 3) float32 array
    """
    channels = read_exr_planes(path)
    planes = [channels[name] for name in "RGB"] if {*"RGB"} <= {*channels} else [*channels.values()]
    if len(planes) not in (1, 3):
        raise input_error(
            f"'{path}' with channels {', '.join(channels)}",
            "R, G and B, or a single channel",
            "Read it with the OpenEXR package.",
        )
    return np.stack([np.asarray(p, np.float32) for p in planes] * (3 // len(planes)), axis=-1)


def read_exr_planes(path: str | os.PathLike[str]) -> dict[str, NDArray[Any]]:
    """All channels of an OpenEXR file by name, (height, width) arrays of the type they have there.

    Raises
    ------
    InputError
        If it cannot be read, or not to its end.
    """
    with _open_exr(path) as file:
        try:
            return {name: channel.pixels for name, channel in file.channels().items()}
        except ValueError as error:  # the header was whole
            raise input_error(
                f"cannot read the pixels of '{path}' ({error})",
                "a whole OpenEXR file",
                "It is truncated: write it anew.",
            ) from error


def read_exr_attributes(path: str | os.PathLike[str]) -> dict[str, str]:
    """The text attributes in the header of an OpenEXR file; its pixels are not read."""
    with _open_exr(path, header_only=True) as file:
        return {name: value for name, value in file.header().items() if isinstance(value, str)}


def _open_exr(path: str | os.PathLike[str], header_only: bool = False) -> Any:
    import OpenEXR

    try:
        return OpenEXR.File(os.fspath(path), separate_channels=True, header_only=header_only)
    except RuntimeError as error:
        raise input_error(
            f"cannot read '{path}' ({error})",
            "an OpenEXR file",
            "Check the path, or write it anew.",
        ) from error


def display(image: ArrayLike, exposure: float = 0.0) -> _Image:
    """What a screen shows of a linear image: scaled by 2^exposure, clipped, sRGB-encoded.

    There is no tone curve, so that equal radiance looks equal in every picture of a comparison
    and a difference in a highlight is either shown or visibly clipped.

    Parameters
    ----------
    image : (height, width, 3) float array
        Linear sRGB.
    exposure : float
        In stops. Use one value for all pictures that are shown side by side.

    Returns
    -------
    (height, width, 3) float32 array in [0, 1]
    """
    exposed = _image("image", image) * np.float32(2.0**exposure)
    return linear_to_srgb(exposed).astype(np.float32)


def flip(
    reference: ArrayLike,
    test: ArrayLike,
    exposure: float = 0.0,
    pixels_per_degree: float = PIXELS_PER_DEGREE,
) -> tuple[float, _Image]:
    """Perceived difference of two linear images when one flips between them.

    This is LDR-FLIP (Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating
    Images") of the two images as `display` shows them.

    Parameters
    ----------
    reference, test : (height, width, 3) float arrays
        Linear sRGB.
    exposure : float
        In stops, for both images.
    pixels_per_degree : float, > 0
        Pixels of the image per degree of visual angle; see `PIXELS_PER_DEGREE`. FLIP blurs as
        the eye does at that distance, so values for different settings do not compare.

    Returns
    -------
    mean : float in [0, 1]
        Average over all pixels, the background included.
    values : (height, width) float32 array in [0, 1]
        0 where no difference is perceived.

    Examples
    --------
    >>> grey = np.full((8, 8, 3), 0.5)
    >>> flip(grey, grey)[0]
    0.0
    """
    import flip_evaluator

    if not pixels_per_degree > 0:
        raise input_error(
            f"pixels_per_degree={pixels_per_degree}", "a number > 0", "67 is a screen at 0.7 m."
        )
    first, second = _pair(reference, test)
    values, _, _ = flip_evaluator.evaluate(
        display(first, exposure),
        display(second, exposure),
        "LDR",
        inputsRGB=True,
        applyMagma=False,
        computeMeanError=False,
        parameters={"ppd": float(pixels_per_degree)},
    )
    values = np.array(values[..., 0], dtype=np.float32)
    return float(values.mean(dtype=np.float64)), values


def rmse(reference: ArrayLike, test: ArrayLike) -> float:
    """Root mean square of test − reference over pixels and channels, in linear radiance."""
    first, second = _pair(reference, test)
    return float(np.sqrt(np.mean((second.astype(np.float64) - first) ** 2)))


def nrmse(reference: ArrayLike, test: ArrayLike) -> float:
    """`rmse` relative to the mean of the reference."""
    mean = float(np.mean(_image("reference", reference), dtype=np.float64))
    if not mean > 0:
        raise input_error(
            f"reference with mean {mean:g}", "an image with some light in it", "Use rmse instead."
        )
    return rmse(reference, test) / mean


def signed_difference(reference: ArrayLike, test: ArrayLike) -> _Image:
    """Luminance of test minus that of the reference, linear: > 0 where the test is too bright."""
    first, second = _pair(reference, test)
    return ((second.astype(np.float64) - first) @ _LUMINANCE).astype(np.float32)


def delta_e(reference: ArrayLike, test: ArrayLike, exposure: float = 0.0) -> NDArray[np.float64]:
    """CIEDE2000 colour difference per pixel of two linear images as `display` exposes them.

    Radiance is clipped to what a screen can show, white being (1, 1, 1) after exposure.
    """
    scale = np.float32(2.0**exposure)
    first, second = (np.clip(image * scale, 0.0, 1.0) for image in _pair(reference, test))
    return np.asarray(delta_e_2000(first, second))


@dataclass(frozen=True)
class ImageDifference:
    """How far a test image is from its reference."""

    flip: float
    """Mean FLIP."""
    delta_e: float
    """Mean CIEDE2000."""
    rmse: float
    """In linear radiance."""
    nrmse: float
    """`rmse` over the mean of the reference."""
    flip_map: _Image
    """FLIP of each pixel."""
    signed_map: _Image
    """Signed luminance difference of each pixel."""

    def summary(self) -> dict[str, float]:
        """The four numbers, for a report."""
        return {name: getattr(self, name) for name in ("flip", "delta_e", "rmse", "nrmse")}


def compare(reference: ArrayLike, test: ArrayLike, exposure: float = 0.0) -> ImageDifference:
    """Every measure of this module at once, at one exposure (in stops)."""
    mean, values = flip(reference, test, exposure)
    return ImageDifference(
        flip=mean,
        delta_e=float(np.mean(delta_e(reference, test, exposure))),
        rmse=rmse(reference, test),
        nrmse=nrmse(reference, test),
        flip_map=values,
        signed_map=signed_difference(reference, test),
    )

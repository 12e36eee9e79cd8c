"""Light from all around as an equirectangular map: loaded, or given as an array.

Maps follow Mitsuba's `envmap` emitter in its own frame, y up. With N columns and M rows, the
direction (x, y, z) is at column N atan2(x, -z)/2π - 1/2 (periodic) and at row (M - 1) acos(y)/π,
and between texels the radiance is interpolated bilinearly. So the first and the last row *are* the
poles, and -z is where the left edge meets the right one.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._array import drjit_constant, drjit_module, is_drjit, ops_for
from .._check import input_error, is_whole
from .._vectors import as_vector
from .variants import active_variant

__all__ = [
    "LARGEST_WIDTH",
    "Environment",
    "fetch",
    "map_angles",
    "row_weights",
    "texel_directions",
    "unit_vectors",
]

_SUFFIXES = (".exr", ".hdr")
LARGEST_WIDTH = 16384  # columns
_ANY = 10**9  # columns to turn by


def texel_directions(width: int, height: int | None = None) -> NDArray[np.float64]:
    """Unit vectors to the texels of a map.

    Parameters
    ----------
    width, height : int
        Columns and rows, half as many if not given. There are two rows at least: the poles.

    Returns
    -------
    (height, width, 3) float64 array

    Raises
    ------
    InputError
        For sizes that are no integers, or smaller.

    Examples
    --------
    >>> texel_directions(8).shape
    (4, 8, 3)
    """
    given = f"width={width!r}" if height is None else f"width={width!r}, height={height!r}"
    height = width // 2 if height is None and is_whole(width, 1) else height
    if not is_whole(width, 1) or not is_whole(height, 2):
        raise input_error(
            given,
            "an integer width ≥ 1 and height ≥ 2, or a width ≥ 4 alone",
            "Rows are half as many as columns if their number is not given.",
        )
    assert height is not None
    polar = np.linspace(0.0, np.pi, height)[:, None]
    turn = 2.0 * np.pi * (np.arange(width) + 0.5) / width
    return unit_vectors(polar, turn)


def unit_vectors(polar: NDArray[np.float64], turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3) unit vectors to what is at these angles, in radians, in a map."""
    sine = np.sin(polar)
    parts = sine * np.sin(turn), np.cos(polar) + 0.0 * turn, -sine * np.cos(turn)
    return np.stack(parts, axis=-1)


def row_weights(height: int) -> NDArray[np.float64]:
    """(height,) float64: the solid angle of each row over 2π, integrated as interpolated.

    The weight is the integral of the row's hat function against sin(polar angle), which is not 0
    at the poles; the weights sum to 2.
    """
    polar = np.linspace(0.0, np.pi, height)
    step = np.pi / (height - 1)
    # ∫ (1 - |t - t_j| / step) sin t dt = 2 sin(t_j) (1 - cos step) / step
    weights = 2.0 * np.sin(polar) * (1.0 - np.cos(step)) / step
    weights[[0, -1]] = 1.0 - np.sin(step) / step  # half a hat
    return weights


@dataclass(frozen=True, eq=False)
class Environment:
    """Radiance from every direction.

    Attributes
    ----------
    radiance : (M, N, 3) float32 array
        Linear sRGB, layout as above; N = 2 M. Read-only.
    name : str
    """

    radiance: NDArray[Any]
    name: str = "environment"

    def __post_init__(self) -> None:
        radiance = np.array(_checked(self.radiance, f"map '{self.name}'"), np.float32)
        radiance.flags.writeable = False
        object.__setattr__(self, "radiance", radiance)

    @property
    def width(self) -> int:
        """Columns."""
        return self.radiance.shape[1]

    @property
    def height(self) -> int:
        """Rows."""
        return self.radiance.shape[0]

    @classmethod
    def load(cls, path: str | os.PathLike[str], width: int | None = None) -> Environment:
        """Read an OpenEXR or Radiance file.

        Parameters
        ----------
        path : path
            Ends in `.exr` or `.hdr`; twice as wide as high; linear RGB, or one grey channel.
        width : int, optional
            Scale the map down to this many columns, see `resized`.

        Raises
        ------
        InputError
            For other files, other shapes, and radiance that is negative or not finite.
        """
        import mitsuba as mi

        active_variant()
        path = Path(path)
        if path.suffix.lower() not in _SUFFIXES:
            raise input_error(
                f"'{path}'",
                "an equirectangular map in an OpenEXR (.exr) or Radiance (.hdr) file",
                "Pictures of 8 bits do not hold the range of a light.",
            )
        if not path.is_file():
            raise input_error(f"no file '{path}'", "a file that exists", "Check the path.")
        try:
            bitmap = mi.Bitmap(str(path))
            colour = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
        except RuntimeError as error:
            raise input_error(
                f"cannot read '{path}' ({' '.join(str(error).split())})",
                "an OpenEXR or Radiance file with RGB or grey channels",
                "Check that the file is whole, or write it anew.",
            ) from error
        environment = cls(np.array(colour), path.stem)
        return environment if width is None else environment.resized(width)

    def emitter(self) -> dict[str, Any]:
        """The dictionary of Mitsuba's `envmap` that emits this light.

        Raises
        ------
        InputError
            If no variant is set.
        """
        import mitsuba as mi

        active_variant()

        bitmap = mi.Bitmap(np.array(self.radiance), pixel_format=mi.Bitmap.PixelFormat.RGB)
        return {"type": "envmap", "bitmap": bitmap}

    def lookup(self, direction: Any) -> Any:
        """Radiance from a direction, as Mitsuba's `envmap` interpolates it.

        Parameters
        ----------
        direction : (..., 3) float array, or three Dr.Jit arrays, as `mi.Vector3f` has them
            Towards the light; unit length.

        Returns
        -------
        (..., 3) float array, or a tuple of three Dr.Jit arrays; NaN where the direction is.

        Raises
        ------
        InputError
            For directions without three components.
        """
        shape = (self.height, self.width)
        direction = as_vector(direction)
        if isinstance(direction, tuple):
            return fetch(drjit_constant(type(direction[0]), self.radiance), 0, *shape, *direction)
        values = fetch(self.radiance.ravel(), 0, *shape, *np.moveaxis(direction, -1, 0))
        return np.stack(values, axis=-1)

    def resized(self, width: int) -> Environment:
        """A smaller map with the same light: each texel averages what its hat function covers.

        Parameters
        ----------
        width : int
            Columns, even, at least 4. Maps are not enlarged: a width above the map's is ignored.

        Returns
        -------
        Environment
            This one if it is small enough.

        Raises
        ------
        InputError
            For another width.

        Examples
        --------
        >>> from fresnel_decomp.mitsuba.skies import city
        >>> city(64).resized(32).radiance.shape
        (16, 32, 3)
        """
        if not is_whole(width, 4) or width % 2:
            raise input_error(
                f"width={width!r}", "an even integer ≥ 4", "512 is enough for shading."
            )
        if width >= self.width:
            return self
        height = width // 2
        rows = _hats(np.linspace(0, np.pi, self.height), np.linspace(0, np.pi, height), False)
        rows *= row_weights(self.height)  # texels count by their solid angle
        rows /= rows.sum(axis=1, keepdims=True)
        columns = _hats(_turns(self.width), _turns(width), True)
        columns /= columns.sum(axis=1, keepdims=True)
        smaller = np.einsum("ij,jkc->ikc", rows, self.radiance.astype(np.float64), optimize=True)
        return Environment(np.einsum("lk,ikc->ilc", columns, smaller, optimize=True), self.name)

    def turned(self, columns: int) -> Environment:
        """The same light turned about the y axis by whole columns, to the right in the map.

        Parameters
        ----------
        columns : int
            Of either sign; the angle is 2π columns / width.

        Returns
        -------
        Environment

        Raises
        ------
        InputError
            If it is no integer.

        Examples
        --------
        >>> from fresnel_decomp.mitsuba.skies import city
        >>> light = city(64)
        >>> bool((light.turned(64).radiance == light.radiance).all())
        True
        """
        if not is_whole(columns, -_ANY, _ANY):
            raise input_error(
                f"columns={columns!r}", "an integer", "round(angle / (2 π) · width) is one."
            )
        return Environment(np.roll(self.radiance, columns, axis=1), self.name)


def _turns(width: int) -> NDArray[np.float64]:
    return 2.0 * np.pi * (np.arange(width) + 0.5) / width


def _hats(
    fine: NDArray[np.float64], coarse: NDArray[np.float64], periodic: bool
) -> NDArray[np.float64]:
    """(coarse, fine) values of the coarse grid's hat functions at the fine grid's nodes."""
    distance = np.abs(coarse[:, None] - fine)
    if periodic:
        distance = np.minimum(distance, 2.0 * np.pi - distance)
    return np.maximum(1.0 - distance / (coarse[1] - coarse[0]), 0.0)


def map_angles(x: Any, y: Any, z: Any) -> tuple[Any, Any]:
    """Where a direction is in a map: turns from its left edge, in [-1/2, 1/2], half turns down."""
    ops = ops_for(x, y, z)
    # not acos(y), which has neither digits nor a derivative near the poles
    polar = ops.arctan2(ops.sqrt(x * x + z * z), y) * (1.0 / np.pi)
    return ops.arctan2(x, -z) * (0.5 / np.pi), polar


def fetch(data: Any, offset: Any, height: Any, width: Any, x: Any, y: Any, z: Any) -> Any:
    """Bilinear lookup in a map of height times width texels that starts at texel `offset` of data.

    NumPy or Dr.Jit: data is flat with the three channels of a texel together; offset, height and
    width are integers or arrays of them. Returns a tuple of three arrays, NaN where x, y or z is.
    """
    dr, select = drjit_module(), ops_for(x, y, z).select
    if is_drjit(x, y, z):
        assert dr is not None
        number: Any = type(x)
        index: Any = dr.int32_array_t(number)
        floor, clip = dr.floor, dr.clip
    else:
        index, number = (lambda v: np.asarray(v).astype(np.int64)), np.asarray
        floor, clip = np.floor, np.clip
    turn, polar = map_angles(x, y, z)
    column = (turn - floor(turn)) * number(width) - 0.5
    row = polar * number(height - 1)
    # what is no direction has no texel, and reads some that exists
    length = x * x + y * y + z * z
    known = (length > 0.0) & (length < np.inf) & (column == column) & (row == row)
    left = select(known, floor(column), 0.0)
    top = select(known, clip(floor(row), 0, number(height - 2)), 0.0)
    s, t = select(known, column - left, np.nan), row - top
    first = index(left)
    first = _select(dr, first < 0, first + width, first)
    second = _select(dr, first + 1 >= width, first + 1 - width, first + 1)
    start = offset + index(top) * width

    def texel(position: Any) -> list[Any]:
        if dr is not None and dr.is_array_v(position):
            return [dr.gather(number, data, 3 * position + c) for c in range(3)]
        return [data[3 * position + c] for c in range(3)]

    corners = [texel(start + first), texel(start + second)]
    corners += [texel(start + width + first), texel(start + width + second)]
    above, below = (
        [a + s * (b - a) for a, b in zip(left_side, right_side, strict=True)]
        for left_side, right_side in (corners[:2], corners[2:])
    )
    return tuple(a + t * (b - a) for a, b in zip(above, below, strict=True))


def _select(dr: Any, mask: Any, a: Any, b: Any) -> Any:
    return dr.select(mask, a, b) if dr is not None and dr.is_array_v(mask) else np.where(mask, a, b)


def _checked(value: ArrayLike, what: str) -> NDArray[np.float32]:
    radiance = np.asarray(value)
    if radiance.dtype.kind not in "fiu" or radiance.ndim != 3 or radiance.shape[2] not in (1, 3):
        raise input_error(
            f"{what}: {radiance.dtype} array of shape {radiance.shape}",
            "real numbers of shape (M, 2 M, 3), or (M, 2 M, 1) for grey light",
            "Drop the alpha channel.",
        )
    height, width, _ = radiance.shape
    if width != 2 * height or height < 2 or width > LARGEST_WIDTH:
        raise input_error(
            f"{what} of {width} x {height} pixels",
            f"twice as many columns as rows, 4 to {LARGEST_WIDTH} columns",
            "Convert cube maps and light probes to the equirectangular projection first.",
        )
    bad = ~np.isfinite(radiance) | (radiance < 0)
    if bad.any():
        row, column, _ = np.argwhere(bad)[0]
        raise input_error(
            f"{what} with {np.count_nonzero(bad)} values that are negative or not finite, the "
            f"first one {radiance[bad][0]:g} at row {row}, column {column}",
            "finite radiance >= 0",
            "Repair it, e.g. with np.maximum(np.nan_to_num(radiance), 0).",
        )
    if not radiance.any():
        raise input_error(f"{what} without any light", "some radiance > 0", "Check the file.")
    return np.broadcast_to(radiance, (height, width, 3))

"""Light from all around as an equirectangular map: loaded, baked from `sunsky`, or made up.

Maps follow Mitsuba's `envmap` emitter in its own frame, y up. With N columns and M rows, the
direction (x, y, z) is at column N atan2(x, -z)/2π - 1/2 (periodic) and at row (M - 1) acos(y)/π,
and between texels the radiance is interpolated bilinearly. So the first and the last row *are* the
poles, and -z is where the left edge meets the right one.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._array import drjit_module, is_drjit, one_kind
from .._check import InputError, choose, input_error, is_real, is_whole

__all__ = ["Environment", "city", "sunsky", "texel_directions"]

_SUFFIXES = (".exr", ".hdr")
_LARGEST = 16384  # columns
_ANY = 10**9  # columns to turn by
_SUNSKY_OPTIONS = ("albedo", "sun_scale", "sky_scale", "sun_aperture", "complex_sun")


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
    return _direction(polar, turn)


def _direction(polar: NDArray[np.float64], turn: NDArray[np.float64]) -> NDArray[np.float64]:
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

        _require_variant()
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

        _require_variant()

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
            dr = drjit_module()
            assert dr is not None
            kind = type(direction[0])
            texels = self.radiance.ravel()
            return fetch(
                kind(texels if dr.is_jit_v(kind) else texels.tolist()), 0, *shape, *direction
            )
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


def as_vector(value: Any, name: str = "direction") -> Any:
    """A tuple of three Dr.Jit arrays, if `value` consists of them, else a NumPy array (..., 3).

    Vectors of Mitsuba's scalar variants consist of Python floats. Numbers beside Dr.Jit arrays
    become arrays as well.

    Raises
    ------
    InputError
        For other numbers of components, tensors, and NumPy arrays beside Dr.Jit arrays.
    """
    dr = drjit_module()
    if is_drjit(value) and dr is not None and dr.is_tensor_v(value):
        raise _no_vector(f"{name}: a tensor of shape {tuple(value.shape)}")
    if is_drjit(value) or (isinstance(value, tuple | list) and is_drjit(*value)):
        components = [value[i] for i in range(len(value))]
        if is_drjit(*components):
            assert dr is not None
            if len(components) != 3:
                raise _no_vector(f"{name} of {len(components)} Dr.Jit arrays")
            arrays = [c for c in components if is_drjit(c)]
            if not all(dr.depth_v(c) == 1 and dr.is_float_v(c) for c in arrays):
                raise _no_vector(f"{name} of {', '.join(type(c).__name__ for c in arrays)}")
            kind = type(sum(0.0 * c for c in arrays))
            return tuple(of_kind(kind, c) for c in one_kind(*components))
    array = np.asarray(value)
    if array.dtype.kind not in "fiu" or array.ndim == 0 or array.shape[-1] != 3:
        raise _no_vector(f"{name}: {array.dtype} array of shape {array.shape}")
    return array


def _no_vector(given: str) -> InputError:
    return input_error(
        given,
        "a real array (..., 3), or three Dr.Jit arrays such as mi.Vector3f has",
        "Components are on the last axis of NumPy arrays; np.stack([x, y, z], axis=-1) joins them.",
    )


def as_vectors(*beside: Any, **named: Any) -> list[Any]:
    """Vectors as `as_vector` returns them, all of one kind: that of Dr.Jit if any argument is.

    Parameters
    ----------
    *beside
        Numbers that are used together with them.
    **named
        Vectors; three numbers fit to Dr.Jit arrays, NumPy arrays of many vectors do not.

    Raises
    ------
    InputError
        For what is no vector, and for arrays of NumPy together with Dr.Jit's.
    """
    vectors = {name: as_vector(value, name) for name, value in named.items()}
    arrays = [v for v in vectors.values() if isinstance(v, tuple)]
    if not arrays and not is_drjit(*beside):
        return list(vectors.values())
    for name, vector in vectors.items():
        if not isinstance(vector, tuple) and vector.ndim != 1:
            raise input_error(
                f"{name}: a NumPy array of shape {vector.shape} together with Dr.Jit arrays",
                "arrays of one kind, and three numbers",
                f"Convert first, e.g. mi.Vector3f({name}.T).",
            )
    one_kind(*beside, *(array for vector in arrays for array in vector))
    parts = [value for value in beside if is_drjit(value)] + [v[0] for v in arrays]
    kind = type(sum(0.0 * part for part in parts))
    return [tuple(of_kind(kind, c) for c in vector) for vector in vectors.values()]


def of_kind(kind: Any, value: Any) -> Any:
    """A number as a Dr.Jit array, and no part of the kernel: the next one needs no new kernel."""
    if is_drjit(value):
        return value
    dr = drjit_module()
    assert dr is not None
    return dr.opaque(kind, float(value)) if dr.is_jit_v(kind) else kind(float(value))


def fetch(data: Any, offset: Any, height: Any, width: Any, x: Any, y: Any, z: Any) -> Any:
    """Bilinear lookup in a map of height times width texels that starts at texel `offset` of data.

    NumPy or Dr.Jit: data is flat with the three channels of a texel together; offset, height and
    width are integers or arrays of them. Returns a tuple of three arrays, NaN where x, y or z is.
    """
    dr = drjit_module()
    if is_drjit(x, y, z):
        assert dr is not None
        number: Any = type(x)
        index: Any = dr.int32_array_t(number)
        atan2, floor, clip, sqrt = dr.atan2, dr.floor, dr.clip, dr.sqrt
        select = dr.select
    else:
        index, number = (lambda v: np.asarray(v).astype(np.int64)), np.asarray
        atan2, floor, clip, sqrt = np.arctan2, np.floor, np.clip, np.sqrt
        select = np.where
    turn = atan2(x, -z) * (0.5 / np.pi)
    # not acos(y), which has neither digits nor a derivative near the poles
    polar = atan2(sqrt(x * x + z * z), y) * (1.0 / np.pi)
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
    if width != 2 * height or height < 2 or width > _LARGEST:
        raise input_error(
            f"{what} of {width} x {height} pixels",
            f"twice as many columns as rows, 4 to {_LARGEST} columns",
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


def _require_variant(vectorised: bool = False) -> None:
    import mitsuba as mi

    variant = mi.variant()
    if variant is None or (vectorised and variant.startswith("scalar")):
        raise input_error(
            "no Mitsuba variant is set" if variant is None else f"variant {variant}",
            "an LLVM or CUDA variant" if vectorised else "any variant",
            "Call mitsuba.set_variant(fresnel_decomp.doctor.best_variant()) first.",
        )


# --- sunsky --------------------------------------------------------------------------------------


def sunsky(
    width: int = 512,
    *,
    sun_direction: Sequence[float] = (-0.5, 0.45, -0.75),
    turbidity: float = 3.0,
    oversampling: int = 4,
    **parameters: Any,
) -> Environment:
    """Mitsuba's `sunsky` emitter as a map, y up.

    Each texel is the average over oversampling² directions of what it covers, and over many more
    near the sun, so that a sun that is smaller than a texel keeps its power.

    Parameters
    ----------
    width : int
        Columns, even, 4 to 16,384.
    sun_direction : (3,) float
        Towards the sun, y up; above the horizon.
    turbidity : float in [1, 10]
    oversampling : int, ≥ 1
        Directions along each side of a texel.
    **parameters
        Others of the emitter: `albedo`, `sun_scale`, `sky_scale`, `sun_aperture`, `complex_sun`.

    Returns
    -------
    Environment
        Called "sunsky".

    Raises
    ------
    InputError
        In scalar variants, which would need minutes; for a sun below the horizon, other sizes and
        other turbidities; and for parameters that the emitter does not have, or values that it
        refuses.
    """
    import drjit as dr
    import mitsuba as mi

    _require_variant(vectorised=True)
    sun = np.asarray(sun_direction, np.float64)
    if sun.shape != (3,) or not np.isfinite(sun).all() or not sun[1] > 0.0:
        raise input_error(
            f"sun_direction={sun_direction!r}",
            "three finite numbers, the second > 0",
            "y is up: (0, 1, 0) is a sun in the zenith.",
        )
    _check_size(width, oversampling)
    if not is_real(turbidity, 1.0, 10.0):
        raise input_error(
            f"turbidity={turbidity!r}",
            "a number in [1, 10]",
            "3 is the default; haze grows with it.",
        )
    for name, value in parameters.items():
        choose("parameter of sunsky", name, _SUNSKY_OPTIONS)
        if isinstance(value, float) and not math.isfinite(value):  # taken without a word
            raise input_error(f"{name}={value}", "finite values", "Leave it out for the default.")
    description = {
        "type": "sunsky",
        "sun_direction": sun.tolist(),  # in the world's frame
        "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -90.0),  # z is up in its own
        "turbidity": float(turbidity),
        **parameters,
    }
    try:
        emitter = mi.load_dict(description)
    except RuntimeError as error:
        raise input_error(
            f"parameters of sunsky {parameters} ({' '.join(str(error).split())})",
            "values that Mitsuba's emitter takes",
            "Leave out what you do not mean to change.",
        ) from error

    def radiance(directions: NDArray[np.float64]) -> NDArray[np.float64]:
        towards = directions.reshape(-1, 3).astype(np.float32).T
        si = dr.zeros(mi.SurfaceInteraction3f, towards.shape[1])
        si.wi = -mi.Vector3f(*(mi.Float(np.ascontiguousarray(row)) for row in towards))
        colour = np.array(mi.Color3f(emitter.eval(si)), np.float64).T
        return np.maximum(colour, 0.0).reshape(directions.shape)

    baked = _averaged(radiance, width, oversampling)
    # the sun is half a degree wide: around it, sixteen directions across its diameter
    towards = sun / np.linalg.norm(sun)
    reach = np.radians(float(parameters.get("sun_aperture", 0.5358))) + 3.0 * np.pi / width
    near = texel_directions(width) @ towards > np.cos(min(reach, np.pi))
    fine = max(math.ceil(16.0 * 360.0 / width / 0.5358), oversampling)
    baked[near] = _averaged(radiance, width, fine, near)
    return Environment(baked, "sunsky")


def _check_size(width: int, oversampling: int) -> None:
    if not is_whole(width, 4, _LARGEST) or width % 2 or not is_whole(oversampling, 1):
        raise input_error(
            f"width={width!r}, oversampling={oversampling!r}",
            f"an even integer width from 4 to {_LARGEST} and an integer oversampling ≥ 1",
            "512 and 4 are enough for shading.",
        )


def _averaged(
    radiance: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    width: int,
    oversampling: int,
    where: NDArray[np.bool_] | None = None,
) -> NDArray[np.float64]:
    """Bake a function of directions: box average over each texel, by solid angle.

    (height, width, 3), or (n, 3) for the n texels that are True in `where`.
    """
    height = width // 2
    where = np.ones((height, width), bool) if where is None else where
    rows, columns = np.nonzero(where)
    offsets = (np.arange(oversampling) + 0.5) / oversampling - 0.5
    total, weight = np.zeros((len(rows), 3)), np.zeros((len(rows), 1))
    for dy in offsets:
        # beyond a pole the texel's area is on the other side of it: mirrored
        polar = np.abs(np.pi * (rows + dy) / (height - 1))
        polar = np.where(polar > np.pi, 2.0 * np.pi - polar, polar)[:, None]
        share = np.maximum(np.sin(polar), 1e-12)  # a single direction may be the pole
        turn = 2.0 * np.pi * (columns[:, None] + 0.5 + offsets) / width
        total += share * radiance(_direction(polar, turn)).mean(axis=1)
        weight += share
    average = total / weight
    return average.reshape(height, width, 3) if where.all() else average


# --- a city made up ------------------------------------------------------------------------------


def city(width: int = 512) -> Environment:
    """A square between houses in the late afternoon, made of nothing but numbers.

    A blue sky that is warm near the horizon, a low sun with radiance 70 and 5° across, rows of
    houses with windows, some of them lit, and dark ground. It has what a photograph of a city has
    and a studio lacks: small bright lights, edges, and colour that depends on direction. The
    same numbers every time; needs no Mitsuba variant.

    Parameters
    ----------
    width : int
        Columns, even, 4 to 16,384.

    Returns
    -------
    Environment
        Called "city"; the last four widths are kept.

    Raises
    ------
    InputError
        For another width.

    Examples
    --------
    >>> light = city(64)
    >>> light.radiance.shape
    (32, 64, 3)
    """
    _check_size(width, 4)
    return _city(int(width))


@functools.lru_cache(maxsize=4)
def _city(width: int) -> Environment:
    return Environment(_averaged(_city_radiance, width, 4), "city")


_SUN = np.array([-0.78, 0.46, -0.42]) / np.linalg.norm([-0.78, 0.46, -0.42])
_SUN_RADIUS = np.radians(2.5)
_SUNLIGHT = np.array([1.0, 0.86, 0.66])


def _city_radiance(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y, z = np.moveaxis(directions, -1, 0)
    height = np.clip(y, 0.0, 1.0)[..., None]
    cos_sun = np.clip(directions @ _SUN, -1.0, 1.0)
    haze = (1.0 - height) ** 5
    sky = (1.0 - haze) * [0.20, 0.36, 0.75] + haze * [1.15, 0.95, 0.78]
    clouds = _clouds(x, y, z)[..., None]
    sky = sky + clouds * ([0.95, 0.93, 0.92] - 0.6 * sky)
    sky = sky + 0.9 * np.exp(-(1.0 - cos_sun) / 0.012)[..., None] * _SUNLIGHT
    edge = np.clip((np.arccos(cos_sun) - _SUN_RADIUS) / np.radians(0.3) + 0.5, 0.0, 1.0)
    sky = sky + 70.0 * (1.0 - edge)[..., None] * _SUNLIGHT

    houses, covered = _houses(np.arctan2(x, -z), np.arcsin(np.clip(y, -1.0, 1.0)))
    fade = 1.0 + 1.5 * np.exp(4.0 * np.minimum(y, 0.0))[..., None]
    ground = np.array([0.105, 0.10, 0.095]) * fade
    above = np.where(covered[..., None], houses, sky)
    return np.where((y > 0.0)[..., None], above, ground)


def _clouds(x: Any, y: Any, z: Any) -> Any:
    """Cover in [0, 1]: a sum of waves over a flat layer high above."""
    random = np.random.default_rng(11)
    distance = 1.0 / (np.maximum(y, 0.0) + 0.15)
    total = 0.0
    for octave in range(4):
        for _ in range(5):
            turn, phase = 2.0 * np.pi * random.random(2)
            along = 1.7 * 2.0**octave * distance * (np.cos(turn) * x + np.sin(turn) * z)
            total = total + 0.62**octave * np.sin(along + phase)
    cover = np.clip((total - 0.8) / 3.0, 0.0, 1.0)
    return cover * np.clip(4.0 * y, 0.0, 1.0)


def _houses(turn: NDArray[np.float64], elevation: NDArray[np.float64]) -> tuple[Any, Any]:
    """Radiance of the row of houses, and where it hides the sky."""
    random = np.random.default_rng(7)
    count = 26
    edges = np.cumsum(0.6 + random.random(count))
    edges = 2.0 * np.pi * edges / edges[-1]
    top = np.radians(8.0 + 36.0 * random.random(count) ** 1.5)
    street = random.random(count) < 0.12
    middle = edges - 0.5 * np.diff(edges, prepend=0.0)
    facing = np.cos(middle - np.arctan2(_SUN[0], -_SUN[2]))
    top = np.where(facing > 0.9, np.minimum(top, np.radians(13.0)), top)  # the sun is not hidden
    walls = 0.45 + 0.45 * random.random((count, 1)) * [1.0, 1.0, 1.0] + [0.12, 0.03, -0.06]
    # the sun shines on the houses that it is opposite to
    walls = walls * (0.3 + 1.3 * np.clip(-facing, 0.0, 1.0)[:, None] * _SUNLIGHT)
    lit = random.random((count, 64, 32)) < 0.2

    turn = np.mod(turn, 2.0 * np.pi)
    house = np.minimum(np.searchsorted(edges, turn, side="right"), count - 1)
    width, storey = np.radians(3.2), np.radians(3.6)
    column, row = turn / width, elevation / storey
    across, up = np.mod(column, 1.0), np.mod(row, 1.0)
    window = (np.abs(across - 0.5) < 0.27) & (np.abs(up - 0.55) < 0.28)
    window &= elevation < top[house] - 0.35 * storey
    shining = lit[house, column.astype(int) % 64, np.clip(row, 0, 31).astype(int)]
    glass = np.where(shining[..., None], [4.2, 2.7, 1.3], [0.10, 0.13, 0.17])
    colour = np.where(window[..., None], glass, walls[house])
    return colour, (elevation < top[house]) & ~street[house]

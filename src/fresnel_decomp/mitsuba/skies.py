"""Environments to light scenes with: Mitsuba's `sunsky` as a map, and a city that is made up."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import choose, input_error, is_real, is_whole
from .environment import LARGEST_WIDTH, Environment, texel_directions, unit_vectors
from .variants import active_variant

__all__ = ["city", "sunsky"]

_SUNSKY_OPTIONS = ("albedo", "sun_scale", "sky_scale", "sun_aperture", "complex_sun")


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

    active_variant(vectorised=True)
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
    if not is_whole(width, 4, LARGEST_WIDTH) or width % 2 or not is_whole(oversampling, 1):
        raise input_error(
            f"width={width!r}, oversampling={oversampling!r}",
            f"an even integer width from 4 to {LARGEST_WIDTH} and an integer oversampling ≥ 1",
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
        total += share * radiance(unit_vectors(polar, turn)).mean(axis=1)
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

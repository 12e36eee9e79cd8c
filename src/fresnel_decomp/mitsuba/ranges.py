"""What the parameters of the plugins may be, and what the textures that give them can be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np

from .._array import is_recording
from .._check import InputError, input_error
from .tabulation import stored_values

__all__ = ["UNKNOWN_ALPHA", "check_range", "refuse_recording", "value_range"]

UNKNOWN_ALPHA = (1e-3, 1.0)
"""What roughness may be where `value_range` does not tell."""

_Range = tuple[Callable[[Any], Any], str, str]  # what it contains, in words, advice

_ANY: _Range = (lambda x: True, "finite values", "Check the texture or the spectrum.")
_ROUGHNESS: _Range = (lambda x: x > 0.0, "finite values > 0", "For a mirror, use 0.001.")
_FRACTION: _Range = (
    lambda x: (x >= 0.0) & (x <= 1.0),
    "values in [0, 1]",
    "Scale or clip the texture.",
)
_RANGES: dict[str, _Range] = {
    "eta": (lambda x: x > 0.0, "finite values > 0", "Give eta relative to the medium outside."),
    "k": (
        lambda x: x >= 0.0,
        "finite values >= 0",
        "Negate k if your data follow the convention eta - i k.",
    ),
    "r": (
        lambda x: (x >= 0.0) & (x < 1.0),
        "values in [0, 1)",
        "No finite index of refraction reflects everything: where r is 1, as white in an 8-bit "
        "image, scale it below 1, for instance by 0.99.",
    ),
    "g": (lambda x: (x >= 0.0) & (x <= 1.0), "values in [0, 1]", "The edge tint is a fraction."),
    "dielectric_f0": (
        lambda x: (x >= 0.0) & (x < 1.0),
        "values in [0, 1)",
        "Plastics have 0.04; no finite index of refraction has 1.",
    ),
    "dielectric eta": (
        lambda x: x >= 1.0,
        "finite values >= 1",
        "Give eta relative to the medium outside; there is no light inside to be reflected.",
    ),
    "base_color": _FRACTION,
    "metallic": _FRACTION,
    "roughness": _FRACTION,
    "edge_tint": _FRACTION,
    "edge_color": _FRACTION,
    "alpha": _ROUGHNESS,
    "alpha_u": _ROUGHNESS,
    "alpha_v": _ROUGHNESS,
}


def check_range(name: str, texture: Any, zero: bool = False, like: str | None = None) -> None:
    """Refuse a texture with values out of the range of the parameter `name`.

    Textures whose values cannot be read when they are set are taken as they are; so are all in
    code that is only recorded.

    Parameters
    ----------
    name : str
    texture : mi.Texture
    zero : bool
        Accept 0 beside what the range has.
    like : str, optional
        Another parameter whose range holds.

    Raises
    ------
    InputError
        With the name, the values and the range.
    """
    if is_recording():
        return
    contains, accepted, advice = _RANGES.get(like or name, _ANY)
    for values in stored_values(texture):
        if values is None:
            continue
        valid = dr.isfinite(values) & contains(values)
        if not dr.all((valid | (values == 0.0)) if zero else valid):
            raise _out_of_range(name, np.array(values, np.float64), accepted, advice)


def value_range(texture: Any) -> tuple[float, float] | None:
    """Least and largest value of a texture; None if some are known only at surface points."""
    parts = stored_values(texture)
    if any(part is None for part in parts):
        return None
    values = np.concatenate([np.array(part, np.float64).ravel() for part in parts])
    return float(values.min()), float(values.max())


def refuse_recording(what: str, accepted: str) -> None:
    """Refuse `what` in code that is only recorded: what needs its values would end the process.

    Raises
    ------
    InputError
        In a symbolic loop, and in a function that Dr.Jit freezes.
    """
    if is_recording():
        raise input_error(
            f"{what} in a recorded function (dr.freeze) or a symbolic loop",
            accepted,
            "Call params.update() before it.",
        )


def _out_of_range(name: str, values: np.ndarray, accepted: str, advice: str) -> InputError:
    strange = np.count_nonzero(~np.isfinite(values))
    if np.unique(values).size == 1:
        given = f"{name}={values[0]:g}"
    elif strange:
        given = f"'{name}' with {strange} of {values.size} values that are not finite"
    else:
        given = f"'{name}' with values from {values.min():g} to {values.max():g}"
    return input_error(f"parameter {given}", accepted, advice)

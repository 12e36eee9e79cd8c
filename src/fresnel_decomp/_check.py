"""Errors at the public edge: what was given, what is accepted, what to do next."""

from __future__ import annotations

import difflib
import math
import numbers
from collections.abc import Iterable
from typing import Any

__all__ = ["InputError", "choose", "input_error", "is_real", "is_whole"]


class InputError(ValueError):
    """An argument that the library cannot work with; the command line exits with code 2."""


def input_error(given: str, accepted: str, advice: str) -> InputError:
    """An `InputError` with the three-part message that every public function uses."""
    return InputError(f"{given}; accepted: {accepted}. {advice}")


def choose(name: str, value: str, options: Iterable[str]) -> str:
    """Return `value` if it is one of `options`, else raise naming the nearest of them."""
    known = list(options)
    if value in known:
        return value
    near = difflib.get_close_matches(str(value), known, n=3, cutoff=0.5)
    advice = f"Did you mean {' or '.join(map(repr, near))}?" if near else "Choose one of these."
    raise input_error(f"{name}={value!r} is unknown", ", ".join(map(repr, known)), advice)


def is_whole(value: Any, least: int, most: float = math.inf) -> bool:
    """Whether `value` is an integer, of Python or NumPy, from `least` to `most`."""
    return (
        isinstance(value, numbers.Integral)
        and not isinstance(value, bool)
        and least <= int(value) <= most
    )


def is_real(value: Any, least: float, most: float) -> bool:
    """Whether `value` is a real number, of Python or NumPy, from `least` to `most`."""
    return (
        isinstance(value, numbers.Real)
        and not isinstance(value, bool)
        and least <= float(value) <= most
    )

"""Coefficients of a basis, of NumPy and of Dr.Jit: whether they fit, and what they sum up to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ._arguments import one_kind
from ._array import is_drjit
from ._check import input_error, is_whole

__all__ = ["TERMS", "check_count", "check_terms", "evaluated", "weighted_sum"]

TERMS = (3, 4, 5, 6)
"""Numbers of terms that a basis may have, b_0 = 1 included."""


def check_count(terms: Any) -> int:
    """`terms` if it is one of `TERMS`.

    Raises
    ------
    InputError
        If not.
    """
    if not is_whole(terms, TERMS[0], TERMS[-1]):
        raise input_error(f"terms={terms!r}", "3, 4, 5 or 6", "Four terms fit one RGBA table.")
    return int(terms)


def check_terms(coefficients: Any, cos_theta: Any, terms: int) -> Any:
    """`coefficients` if they have `terms` entries and broadcast; NumPy input as an array."""
    drjit_input = is_drjit(cos_theta, coefficients) or (
        isinstance(coefficients, list | tuple) and is_drjit(*coefficients)
    )
    if drjit_input:
        given: Any = len(coefficients) if hasattr(coefficients, "__len__") else "no sequence"
        if given != "no sequence":
            one_kind(cos_theta, *coefficients)
        fits = given == terms
    else:
        coefficients = np.asarray(coefficients)
        given = f"shape {coefficients.shape}"
        fits = coefficients.shape[-1:] == (terms,)
    if not fits:
        raise input_error(
            f"coefficients: {given}",
            f"{terms} of them" if drjit_input else f"an array of shape (..., {terms})",
            f"The basis has {terms} terms.",
        )
    if not drjit_input:
        try:
            np.broadcast_shapes(coefficients.shape[:-1], np.shape(cos_theta))
        except ValueError:
            raise input_error(
                f"coefficients of shape {coefficients.shape}, cosines of shape "
                f"{np.shape(cos_theta)}",
                "leading axes that broadcast with the cosines",
                "To evaluate every curve at every angle: coefficients[:, None].",
            ) from None
    return coefficients


def weighted_sum(coefficients: Any, functions: Any) -> Any:
    """sum_j c_j f_j, for coefficients (..., terms) of NumPy or a sequence, and a sequence f."""
    if isinstance(coefficients, np.ndarray):
        coefficients = np.moveaxis(coefficients, -1, 0)
    total: Any = None
    for c, f in zip(coefficients, functions, strict=True):
        c, f = one_kind(c, f)
        total = c * f if total is None else total + c * f
    return total


def evaluated(functions: Callable[..., Any], coefficients: Any, *at: Any) -> Any:
    """sum_j c_j f_j(at), for coefficients that `check_terms` has let pass.

    `functions` gives (..., terms) arrays for NumPy's, and a tuple for Dr.Jit's; only one of `at`
    and the coefficients need be of Dr.Jit.
    """
    if isinstance(coefficients, np.ndarray) and not is_drjit(*at):
        return (coefficients * functions(*at)).sum(axis=-1)
    numbers = one_kind(*at, *coefficients)
    at, coefficients = numbers[: len(at)], numbers[len(at) :]
    values = functions(*at)
    return weighted_sum(coefficients, values if is_drjit(*at) else values.tolist())

"""Mitsuba's variants: the active one, another for a while, and what differs between them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import Any

from .._check import input_error

__all__ = ["active_variant", "unpolarized", "variant_scope"]


def active_variant(vectorised: bool = False) -> str:
    """The name of the variant that is set.

    Raises
    ------
    InputError
        If none is, or a scalar one although a vectorised one is needed.
    """
    import mitsuba as mi

    variant = mi.variant()
    if variant is None or (vectorised and variant.startswith("scalar")):
        raise input_error(
            "no Mitsuba variant is set" if variant is None else f"variant {variant}",
            "an LLVM or CUDA variant" if vectorised else ", ".join(mi.variants()),
            "Call mitsuba.set_variant(fresnel_decomp.doctor.best_variant()) first.",
        )
    return str(variant)


@contextlib.contextmanager
def variant_scope(variant: str | None = None) -> Iterator[str]:
    """Activate a Mitsuba variant with our plugin for a block, then restore the one before.

    Parameters
    ----------
    variant : str, optional
        Name of a variant; by default the active one.

    Yields
    ------
    str
        The variant in use.

    Raises
    ------
    InputError
        If there is no such variant, it cannot run here, or none was named and none is active.
    """
    import mitsuba as mi

    from ..doctor import require_variant
    from . import register

    before = mi.variant()
    name = variant or active_variant()
    require_variant(name)  # a kernel without a usable LLVM would end the process
    try:
        if name != before:
            mi.set_variant(name)
        register()
        yield name
    finally:
        if before is not None and mi.variant() != before:
            mi.set_variant(before)


def unpolarized(channels: Sequence[Any]) -> Any:
    """The `mi.UnpolarizedSpectrum` of these channels, of which monochrome variants have one."""
    import mitsuba as mi

    return mi.UnpolarizedSpectrum(list(channels) if len(channels) > 1 else channels[0])

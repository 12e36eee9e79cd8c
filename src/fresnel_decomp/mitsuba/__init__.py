"""The decomposition in Mitsuba 3: BSDF plugins `decomposed_conductor`, `decomposed_principled`.

Importing this package loads Mitsuba but sets no variant. Its modules are loaded on first use, so
that `fresnel_decomp.mitsuba.scenes` needs no import of its own. Inside it, `mi` is the renderer.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any

import mitsuba as mi

__all__ = ["register"]

_registered: set[str] = set()
_MODULES = {module.name for module in pkgutil.iter_modules(__path__)}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})


def register() -> None:
    """Make the BSDF plugins `decomposed_conductor` and `decomposed_principled` known to Mitsuba.

    They are registered for the active variant, and for every variant that is set later. Calling
    this again does no harm. The parameters are those of `DecomposedConductor` and
    `DecomposedPrincipled`.

    Raises
    ------
    InputError
        If no variant is set.

    Examples
    --------
    >>> import mitsuba as mi
    >>> mi.set_variant("scalar_rgb")
    >>> from fresnel_decomp.mitsuba import register
    >>> register()
    >>> beryllium = mi.load_dict({"type": "decomposed_conductor", "material": "Be", "alpha": 0.1})
    """
    from .variants import active_variant

    variant = active_variant()
    if not _registered:
        mi.detail.add_variant_callback(_register_variant)
    _register_variant(None, variant)


def _register_variant(_old: str | None, new: str) -> None:
    if new in _registered:
        return
    from . import conductor, principled

    mi.register_bsdf("decomposed_conductor", conductor.plugin_class())
    mi.register_bsdf("decomposed_principled", principled.plugin_class())
    _registered.add(new)

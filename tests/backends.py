"""Dr.Jit array types by backend; a backend that cannot run here skips the test and says why."""

from __future__ import annotations

import importlib

import pytest

from fresnel_decomp import doctor

BACKENDS = ("scalar", "llvm", "cuda")
AD_BACKENDS = ("llvm", "cuda")


def float_type(backend: str, precision: str = "float32"):
    """The one-dimensional floating-point array type of a backend."""
    if backend == "scalar":
        module, single = "drjit.scalar", "ArrayXf"
    else:
        status = doctor.usable_variants()[f"{backend}_ad_rgb"]
        if not status.usable:
            pytest.skip(f"{backend}: {status.reason}. {status.remedy}")
        module, single = f"drjit.{backend}.ad", "Float"
    name = single + ("64" if precision == "float64" else "")
    return getattr(importlib.import_module(module), name)

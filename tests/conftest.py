"""Shared fixtures. A working LLVM is chosen here, before any test module imports Dr.Jit."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from fresnel_decomp import doctor

doctor.prepare()

REFERENCE = Path(__file__).resolve().parents[2] / "shared" / "reference"


@pytest.fixture(params=["scalar_rgb", "llvm_ad_rgb"])
def variant(request: pytest.FixtureRequest) -> Iterator[str]:
    """Set each Mitsuba variant in turn and give its name; skip one that cannot run here."""
    name = request.param
    status = doctor.usable_variants()[name]
    if not status.usable:
        pytest.skip(f"{name}: {status.reason}. {status.remedy}")
    import mitsuba as mi

    before = mi.variant()
    mi.set_variant(name)
    yield name
    if before:
        mi.set_variant(before)


@pytest.fixture(scope="session")
def reference() -> Path:
    """Give the folder of reference tables, which are not part of this repository."""
    folder = Path(os.environ.get("FRESNEL_DECOMP_REFERENCE", REFERENCE))
    if not (folder / "talk_basis.csv").is_file():
        pytest.skip(f"no reference tables in '{folder}'; FRESNEL_DECOMP_REFERENCE names another")
    return folder

"""Shared fixtures. A working LLVM is chosen here, before any test module imports Dr.Jit."""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from fresnel_decomp import doctor

doctor.prepare()

REFERENCE = Path(__file__).resolve().parents[2] / "shared" / "reference"
SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"


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


@contextlib.contextmanager
def using_llvm() -> Iterator[None]:
    """An active llvm_ad_rgb, or a skipped test; the variant as before afterwards."""
    status = doctor.usable_variants()["llvm_ad_rgb"]
    if not status.usable:
        pytest.skip(f"llvm_ad_rgb: {status.reason}. {status.remedy}")
    import mitsuba as mi

    before = mi.variant()
    mi.set_variant("llvm_ad_rgb")
    yield
    if before:
        mi.set_variant(before)


@pytest.fixture
def llvm() -> Iterator[None]:
    with using_llvm():
        yield


class _Scripts:
    def __getattr__(self, name: str) -> Any:
        return importlib.import_module(name)


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Import the scripts, anew in each test; `scripts.NAME` is a module of that name."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    yield _Scripts()
    for path in SCRIPTS.glob("*.py"):
        sys.modules.pop(path.stem, None)


@pytest.fixture
def run_script(scripts: Any) -> Callable[..., int]:
    """Run a script's command with arguments, by the script's `main`, and give its exit code."""

    def run(command: Any, *arguments: str | Path, main: Any = None) -> int:
        with pytest.raises(SystemExit) as end:
            (main or scripts._command_line.main)(command, [str(a) for a in arguments])
        return int(end.value.code or 0)

    return run


@pytest.fixture(scope="session")
def reference() -> Path:
    """Give the folder of reference tables, which are not part of this repository."""
    folder = Path(os.environ.get("FRESNEL_DECOMP_REFERENCE", REFERENCE))
    if not (folder / "talk_basis.csv").is_file():
        pytest.skip(f"no reference tables in '{folder}'; FRESNEL_DECOMP_REFERENCE names another")
    return folder

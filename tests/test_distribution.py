"""Wheel and sdist: built, installed where the source tree is not, used by a stranger's program."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest

import fresnel_decomp

ROOT = Path(__file__).parent.parent
SOURCES = ROOT / "src" / "fresnel_decomp"

PROGRAM = """
import json, math, sys
import numpy as np
import fresnel_decomp as fd
from fresnel_decomp.recipes import RECIPES

loaded = {f"{r}-{n}": fd.load_basis(r, n).terms for r in RECIPES for n in (3, 4, 5, 6)}
basis = fd.load_basis()
table = fd.AlbedoTable.bake(basis, size=8)
table.save("table.npz")
gold = fd.load_material("Au")
print(json.dumps({
    "home": fd.__file__,
    "version": fd.__version__,
    "bases": loaded,
    "gold": gold.rgb_coefficients(basis)[:, 0].tolist(),
    "same": bool((fd.AlbedoTable.load("table.npz").values == table.values).all()),
}))
"""

TYPED_PROGRAM = """
from __future__ import annotations

import numpy as np

import fresnel_decomp as fd
from fresnel_decomp.split_albedo import schlick_albedo


def coefficients(name: str, terms: int) -> np.ndarray:
    basis: fd.Basis = fd.load_basis("talk", terms)
    material: fd.Material = fd.load_material(name)
    return material.rgb_coefficients(basis)


table: fd.AlbedoTable = fd.AlbedoTable.bake(fd.load_basis(), size=(8, 4), smith="correlated")
reveal_type(fd.load_basis().nodes)
reveal_type(table.terms)
reveal_type(fd.RECIPES)
fd.doctor.usable_variants()
schlick_albedo([1.0, 0.8, 0.3])
coefficients("Au", 4)
"""

WRONG_PROGRAM = """
import fresnel_decomp as fd

fd.load_basis(4)
fd.AlbedoTable.bake(fd.load_basis(), smith="neither")
fd.load_basis().no_such_attribute
fd.no_such_name
"""


@dataclass(frozen=True)
class Built:
    wheel: Path
    sdist: Path
    python: Path
    """Of an environment with the wheel and, beside it, what it depends on."""


def run(*command: str | Path, cwd: Path | None = None) -> str:
    """Standard output of a command that sees neither the source tree nor the caller's settings."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    result = subprocess.run(
        [str(part) for part in command],
        capture_output=True, text=True, check=False, cwd=cwd, env=clean, timeout=600,
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """Build both with the backend of pyproject.toml, then install the wheel."""
    folder = tmp_path_factory.mktemp("distribution")
    builder = Path(sys.executable)
    if importlib.util.find_spec("hatchling") is None:
        run(sys.executable, "-m", "venv", folder / "builder")
        builder = folder / "builder" / "bin" / "python"
        fetch = [str(builder), "-m", "pip", "install", "-q", "hatchling>=1.25"]
        fetched = subprocess.run(fetch, capture_output=True, text=True, check=False, timeout=300)
        if fetched.returncode:
            pytest.skip("hatchling is neither installed nor to be had; pip install hatchling")
    run(builder, "-m", "hatchling", "build", "-d", folder / "dist", cwd=ROOT)
    (wheel,) = (folder / "dist").glob("*.whl")
    (sdist,) = (folder / "dist").glob("*.tar.gz")
    run(sys.executable, "-m", "venv", folder / "clean")
    python = folder / "clean" / "bin" / "python"
    run(python, "-m", "pip", "install", "-q", "--no-deps", wheel)
    # dependencies from the environment of the tests: a line of a .pth file adds a folder, but not
    # the .pth files in it, one of which is this project's editable installation
    (packages,) = (folder / "clean").glob("lib/python*/site-packages")
    packages.joinpath("dependencies.pth").write_text(sysconfig.get_paths()["purelib"] + "\n")
    return Built(wheel, sdist, python)


def package_files() -> set[str]:
    """All that belongs to the package, data included."""
    return {
        f"fresnel_decomp/{path.relative_to(SOURCES).as_posix()}"
        for path in SOURCES.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


@pytest.mark.slow
def test_wheel_has_everything_and_no_more(built: Built) -> None:
    with zipfile.ZipFile(built.wheel) as archive:
        names = set(archive.namelist())
        (metadata,) = (n for n in names if n.endswith(".dist-info/METADATA"))
        about = archive.read(metadata).decode()
        entries = archive.read(metadata.replace("METADATA", "entry_points.txt")).decode()
    outside = {name for name in names if ".dist-info/" not in name}
    assert outside == package_files()
    assert "fresnel_decomp/py.typed" in outside
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert f"\nVersion: {fresnel_decomp.__version__}\n" in about
    assert "\nLicense-Expression: BSD-3-Clause\n" in about
    assert "fresnel-decomp = fresnel_decomp.cli:main" in entries


@pytest.mark.slow
def test_sdist_has_what_it_takes_to_build_and_test(built: Built) -> None:
    with tarfile.open(built.sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {f"src/{name}" for name in package_files()} <= names
    for name in ("LICENSE", "README.md", "CHANGELOG.md", "CITATION.cff", "pyproject.toml",
                 "tests/conftest.py", "docs/index.md", "scripts/reproduce.py"):  # fmt: skip
        assert name in names, name
    assert not [n for n in names if n.startswith((".ci", ".venv", "out", "docs/_build"))]


@pytest.mark.slow
def test_installed_package_works_without_the_source_tree(built: Built, tmp_path: Path) -> None:
    found = json.loads(run(built.python, "-c", PROGRAM, cwd=tmp_path))
    home = Path(found["home"])
    assert built.python.parent.parent in home.parents
    assert ROOT not in home.parents
    assert found["version"] == fresnel_decomp.__version__
    assert all(terms == int(name[-1]) for name, terms in found["bases"].items())
    shipped = {path.stem for path in (SOURCES / "data").glob("*-[3-6].json")}
    assert set(found["bases"]) == shipped
    assert found["gold"][0] == pytest.approx(1.022, abs=1e-3)  # red is beyond the gamut
    assert found["same"]
    command = built.python.parent / "fresnel-decomp"
    assert fresnel_decomp.__version__ in run(command, "--version", cwd=tmp_path)
    assert run(command, "basis", "--help") == run(
        built.python, "-m", "fresnel_decomp", "basis", "--help"
    )


@pytest.mark.slow
def test_types_reach_a_stranger(built: Built, tmp_path: Path) -> None:
    """A program is checked against the installed package, strictly: the right one passes."""
    pytest.importorskip("mypy")
    common = [sys.executable, "-m", "mypy", "--strict", "--python-executable", str(built.python),
              "--cache-dir", str(tmp_path / "cache"), "--config-file", os.devnull]  # fmt: skip
    right, wrong = tmp_path / "right.py", tmp_path / "wrong.py"
    right.write_text(TYPED_PROGRAM, encoding="utf-8")
    wrong.write_text(WRONG_PROGRAM, encoding="utf-8")
    checked = run(*common, right, cwd=tmp_path)
    assert "Success" in checked
    assert 'Revealed type is "Any"' not in checked
    assert 'Revealed type is "int"' in checked.replace("builtins.", "")
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    refused = subprocess.run(
        [*common, str(wrong)], capture_output=True, text=True, check=False, cwd=tmp_path, env=clean
    ).stdout
    for code in ("arg-type", "attr-defined"):
        assert f"[{code}]" in refused
    assert len([line for line in refused.splitlines() if ": error:" in line]) == 4, refused

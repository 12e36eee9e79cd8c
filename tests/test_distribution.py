"""Wheel and sdist: built, installed where the source tree is not, with what they say they depend on
and nothing else; used there by a stranger's program, and by the notebooks.
"""

from __future__ import annotations

import contextlib
import fcntl
import importlib.util
import json
import os
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import fresnel_decomp
from fresnel_decomp import doctor

ROOT = Path(__file__).parent.parent
SOURCES = ROOT / "src" / "fresnel_decomp"
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))

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


def attempt(*command: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command that sees neither the source tree nor the caller's settings."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    return subprocess.run(
        [str(part) for part in command],
        capture_output=True, text=True, check=False, cwd=cwd, env=clean, timeout=600,
    )  # fmt: skip


def run(*command: str | Path, cwd: Path | None = None) -> str:
    """Standard output of such a command, which must succeed."""
    result = attempt(*command, cwd=cwd)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def install(python: Path, *what: str | Path) -> None:
    """By pip, from where it is told to look; without a network to look in, skip the test."""
    pip = (python, "-m", "pip", "install", "-q", "--retries", "1", "-c", ROOT / "constraints.txt")
    result = attempt(*pip, *what)
    if result.returncode and "after connection broken by" in result.stderr:
        pytest.skip(f"pip cannot reach its index to install {what[-1]}: {result.stderr[-300:]}")
    assert result.returncode == 0, result.stdout + result.stderr


@contextlib.contextmanager
def once(folder: Path) -> Iterator[bool]:
    """Whether a folder that the workers of pytest-xdist share is still to be filled: they wait for
    the one that fills it."""
    folder.mkdir(exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield not (folder / "filled").exists()
        (folder / "filled").touch()


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that is the same for all workers of this run."""
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "distribution"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def built(shared: Path) -> Built:
    """Both, built with the backend of pyproject.toml."""
    with once(shared / "dist") as first:
        if first:
            builder = Path(sys.executable)
            if importlib.util.find_spec("hatchling") is None:
                run(sys.executable, "-m", "venv", "--clear", shared / "builder")
                builder = shared / "builder" / "bin" / "python"
                install(builder, "hatchling")
            run(builder, "-m", "hatchling", "build", "-d", shared / "dist", cwd=ROOT)
    (wheel,) = (shared / "dist").glob("*.whl")
    (sdist,) = (shared / "dist").glob("*.tar.gz")
    return Built(wheel, sdist)


@pytest.fixture(scope="session")
def python(built: Built, shared: Path) -> Path:
    """That of a new environment with the wheel, its extra for notebooks, and their dependencies.

    The versions are those of constraints.txt, which names no package that is not asked for.
    """
    clean = shared / "clean"
    program = clean / "venv" / "bin" / "python"
    with once(clean) as first:
        if first:
            run(sys.executable, "-m", "venv", "--clear", clean / "venv")
            install(program, f"{built.wheel}[notebook]")
            kernel = ("-m", "ipykernel", "install", "--name", "clean", "--prefix", clean)
            run(program, *kernel)
    return program


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
def test_installed_package_works_without_the_source_tree(python: Path, tmp_path: Path) -> None:
    found = json.loads(run(python, "-c", PROGRAM, cwd=tmp_path))
    home = Path(found["home"])
    assert python.parent.parent in home.parents
    assert ROOT not in home.parents
    assert found["version"] == fresnel_decomp.__version__
    assert all(terms == int(name[-1]) for name, terms in found["bases"].items())
    shipped = {path.stem for path in (SOURCES / "data").glob("*-[3-6].json")}
    assert set(found["bases"]) == shipped
    assert found["gold"][0] == pytest.approx(1.022, abs=1e-3)  # red is beyond the gamut
    assert found["same"]
    installed = {f"fresnel_decomp/{p.relative_to(home.parent)}" for p in home.parent.rglob("*")}
    assert package_files() <= installed
    run(python, "-m", "pip", "check")
    command = python.parent / "fresnel-decomp"
    assert fresnel_decomp.__version__ in run(command, "--version", cwd=tmp_path)
    assert run(command, "basis", "--help") == run(python, "-m", "fresnel_decomp", "basis", "--help")


@pytest.mark.slow
def test_types_reach_a_stranger(python: Path, tmp_path: Path) -> None:
    """A program is checked against the installed package, strictly: the right one passes."""
    pytest.importorskip("mypy")
    common = [sys.executable, "-m", "mypy", "--strict", "--python-executable", str(python),
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


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(
    path: Path, python: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the new environment, without an error, a warning or a word of advice, with pictures."""
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    jupytext = pytest.importorskip("jupytext")
    kernels = python.parents[2] / "share" / "jupyter"
    monkeypatch.setenv("JUPYTER_PATH", str(kernels))
    for name in [name for name in os.environ if name.startswith("PYTHON")]:
        monkeypatch.delenv(name)
    executed = jupytext.read(path, fmt="py:percent")
    executed.cells.append(nbformat.v4.new_code_cell("print(fd.__file__)"))
    resources = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(
        executed, timeout=600, kernel_name="clean", resources=resources
    ).execute()
    *cells, last = executed.cells
    assert python.parent.parent in Path(last.outputs[0].text).parents
    outputs = [output for cell in cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", ()) for output in outputs) >= 3
    told = [output.text for output in outputs if output.get("name") == "stderr"]
    assert told == [] or doctor.best_variant().startswith("scalar")  # which is told

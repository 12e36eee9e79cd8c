"""What importing the package does, and which names it offers."""

from __future__ import annotations

import ast
import importlib
import json
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import fresnel_decomp

HEAVY = ("mitsuba", "drjit", "colour", "matplotlib", "scipy", "OpenEXR", "flip_evaluator")
NAMES = [
    # what others build on
    "conductor",
    "dielectric",
    "polarized",
    "reflectance_components",
    "transmittance",
    "refracted_cosine",
    "load_basis",
    "extract_basis",
    "Basis",
    "load_material",
    "list_materials",
    "Material",
    "gulbrandsen_to_ior",
    "ior_to_gulbrandsen",
    "f0_from_ior",
    "f82_from_ior",
    "Exact",
    "Schlick",
    "Lazanyi",
    "F82",
    "Gulbrandsen",
    "Decomposition",
    "InputError",
    "RECIPES",
    "doctor",
]


def run(code):
    """What a fresh interpreter prints, as JSON."""
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def test_import_is_light():
    loaded = run("import sys, json, fresnel_decomp; print(json.dumps([*sys.modules]))")
    assert not set(HEAVY) & set(loaded)
    assert "numpy" not in loaded


def test_import_takes_no_time():
    """Processor time, so that other work on the machine does not count; best of three."""
    code = (
        "import time; start = time.process_time(); import fresnel_decomp; "
        "print(time.process_time() - start)"
    )
    assert min(run(code) for _ in range(3)) < 0.05


@pytest.mark.parametrize(
    "use",
    [
        "fresnel_decomp.conductor(0.5, 1.5, 0.0)",
        "fresnel_decomp.load_basis().coefficients(1.5, 0.0)",
        "fresnel_decomp.Lazanyi.from_ior(1.5, 0.1)(0.5)",
        "fresnel_decomp.load_material('Au')",
    ],
)
def test_plain_numbers_need_no_renderer(use):
    loaded = run(f"import sys, json, fresnel_decomp; {use}; print(json.dumps([*sys.modules]))")
    assert not set(HEAVY) & set(loaded)


def test_no_variant_is_set():
    """Neither by the package nor by its parts, with the renderer loaded."""
    modules = ["", *(f".{name}" for name in sorted(fresnel_decomp._SUBMODULES))]
    code = (
        "import importlib, json, fresnel_decomp.doctor\n"
        "fresnel_decomp.doctor.prepare()\n"
        "import mitsuba as mi\n"
        f"for name in {modules!r}: importlib.import_module('fresnel_decomp' + name)\n"
        "import fresnel_decomp; [getattr(fresnel_decomp, n) for n in fresnel_decomp.__all__]\n"
        "print(json.dumps(mi.variant()))"
    )
    assert run(code) is None


@pytest.mark.parametrize("name", NAMES)
def test_public_names(name):
    assert getattr(fresnel_decomp, name) is not None
    assert name in dir(fresnel_decomp)


def test_all_names_lead_home():
    for name, module in fresnel_decomp._HOME_OF.items():
        home = importlib.import_module(f"fresnel_decomp.{module}")
        assert name in home.__all__
        assert getattr(fresnel_decomp, name) is getattr(home, name)
    assert set(fresnel_decomp._HOME_OF) | {"__version__"} == set(fresnel_decomp.__all__)
    assert len(set(fresnel_decomp.__all__)) == len(fresnel_decomp.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = fresnel_decomp.nothing


def test_type_checkers_see_the_same_names():
    """What is imported for type checkers alone is what is there when a program runs."""
    tree = ast.parse(Path(fresnel_decomp.__file__).read_text(encoding="utf-8"))
    (block,) = (
        node for node in tree.body if isinstance(node, ast.If) and isinstance(node.test, ast.Name)
    )
    seen = {"": set()} | {module: set() for module in fresnel_decomp._HOMES}
    for statement in block.body:
        assert isinstance(statement, ast.ImportFrom)
        seen[statement.module or ""] |= {alias.name for alias in statement.names}
        if statement.module is None:  # strict checkers pass on what is called so on purpose
            assert all(alias.asname == alias.name for alias in statement.names)
    assert seen.pop("") == fresnel_decomp._SUBMODULES
    assert seen == {module: set(names) for module, names in fresnel_decomp._HOMES.items()}


def test_every_public_module_is_there():
    found = {module.name for module in pkgutil.iter_modules(fresnel_decomp.__path__)}
    public = {name for name in found if not name.startswith("_")}
    assert public - {"cli"} == fresnel_decomp._SUBMODULES


def test_every_all_is_true():
    for name in sorted(fresnel_decomp._SUBMODULES):
        module = importlib.import_module(f"fresnel_decomp.{name}")
        if hasattr(module, "__path__") and not hasattr(module, "__all__"):
            continue  # a folder of modules
        for public in module.__all__:
            assert hasattr(module, public), f"{name}.{public}"


TERMINAL = "cli/"
"""What may write to the terminal; the rest of the library logs."""


def test_the_library_does_not_print():
    home = Path(fresnel_decomp.__file__).parent
    for path in sorted(home.rglob("*.py")):
        if path.relative_to(home).as_posix().startswith(TERMINAL):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                name = ast.unparse(node.func)
                prints = name in ("print", "click.echo") or name.startswith("sys.stdout.")
                assert not prints, f"{path.name}:{node.lineno}"


def test_loggers_are_those_of_the_package():
    """Quiet unless the program that uses the library asks: no handlers, no levels of its own."""
    code = (
        "import json, logging, fresnel_decomp.spectra, fresnel_decomp._llvm.choice\n"
        "names = [n for n in logging.root.manager.loggerDict if n.startswith('fresnel_decomp')]\n"
        "found = [logging.getLogger(n) for n in names]\n"
        "print(json.dumps([[l.name, l.level, len(l.handlers)] for l in found]))"
    )
    found = run(code)
    assert found
    assert all(level == handlers == 0 for _, level, handlers in found)
    assert run("import json, logging, fresnel_decomp; print(len(logging.root.handlers))") == 0


def test_version():
    assert all(part.isdigit() for part in fresnel_decomp.__version__.split(".")[:2])

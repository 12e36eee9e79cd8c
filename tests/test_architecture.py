"""The map on docs/architecture.md is that of the code; imports point one way; the API is listed."""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "fresnel_decomp"
SCRIPTS = ROOT / "scripts"

RENDERERS = ("mitsuba", "report", "bench", "cli", "notebook")
"""What the rest of the package does not know."""

ENTRANCES = {
    "__main__": "runs the command line",
}
"""Modules outside `RENDERERS` that know one of them, each with its reason."""

ASKING = {
    "_llvm.choice": "sees whether it loads with the LLVM that was chosen, and renders nothing",
}
"""Modules outside `RENDERERS` that import Mitsuba, each with its reason."""

ON_DEMAND = {
    ("curves", "spectra"): "`measured_metals` reads the spectra when it is called",
    ("curves", "_data_sets"): "the same",
    ("curves", "_spectrum_files"): "the same",
}
"""Imports against the order of the map, inside of functions, each with its reason."""


@dataclass
class Module:
    """What a module imports of its own package.

    Attributes
    ----------
    path : Path
    loaded : set of str
        With the module.
    on_demand : set of str
        When a function is called.
    """

    path: Path
    loaded: set[str] = field(default_factory=set)
    on_demand: set[str] = field(default_factory=set)

    @property
    def all(self) -> set[str]:
        return self.loaded | self.on_demand


def modules_of(folder: Path, package: str) -> dict[str, Module]:
    """Modules by their names in the package; a package by that of its folder, "" for the root."""
    found = {}
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = Module(path)
    for name, module in found.items():
        tree = ast.parse(module.path.read_text(encoding="utf-8"))
        for node, inside in _imports(tree, inside=False):
            known = module.on_demand if inside else module.loaded
            known |= set(_targets(node, name, module.path, package, found))
    return found


def _imports(tree: ast.AST, inside: bool) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Imports, and whether they stand in a function; none that are for type checkers only."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node, inside
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            for other in node.orelse:
                yield from _imports(other, inside)
        else:
            function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            yield from _imports(node, inside or function)


def _targets(
    node: ast.Import | ast.ImportFrom, name: str, path: Path, package: str, known: dict[str, Module]
) -> Iterator[str]:
    """Modules of the package that an import statement names."""
    if isinstance(node, ast.Import):
        names = [alias.name for alias in node.names]
    else:
        base = node.module or ""
        if node.level:
            here = name.split(".") if name else []
            up = node.level - (path.name == "__init__.py")
            parents = here[: len(here) - up] if up else here
            base = ".".join([package, *parents, *([node.module] if node.module else [])])
        # a name of a package may be a module in it, or something that its __init__ holds
        names = [f"{base}.{alias.name}" if base else alias.name for alias in node.names]
        names = [n if _within(n, package) in known else base for n in names]
    for imported in names:
        inner = _within(imported, package)
        if inner is not None and inner in known:
            yield inner


def _within(name: str, package: str) -> str | None:
    """The name inside of the package, None for a module elsewhere."""
    if not package:
        return name
    if name == package:
        return ""
    return name.removeprefix(f"{package}.") if name.startswith(f"{package}.") else None


MODULES = modules_of(PACKAGE, "fresnel_decomp")
SCRIPT_MODULES = modules_of(SCRIPTS, "")


# --- the map -------------------------------------------------------------------------------------


@dataclass
class Map:
    """What the page says.

    Attributes
    ----------
    group : dict of str to int
        The group in which a module is named first.
    arrows : list of (str, str)
        What is imported, and by which module.
    folders : set of str
        Packages that have a group of their own.
    """

    group: dict[str, int] = field(default_factory=dict)
    arrows: list[tuple[str, str]] = field(default_factory=list)
    folders: set[str] = field(default_factory=set)


def read_map(block: str, known: dict[str, Module]) -> Map:
    """Groups begin at the margin, with the folder if they have one; arrows are indented."""
    found = Map()
    folder, number = "", -1
    for line in block.splitlines():
        if line and not line.startswith(" "):
            number += 1
            head = re.match(r"([\w/]+)/  ", line)
            folder = head[1].replace("/", ".") if head else ""
            found.folders |= {folder} if folder else set()
            continue
        for chain in filter(None, (part.strip() for part in line.split(";"))):
            steps = [
                [_named(name.strip(), folder, known) for name in step.split(",")]
                for step in chain.split("──►")
            ]
            for name in (name for step in steps for name in step):
                found.group.setdefault(name, number)
            for before, after in itertools.pairwise(steps):
                found.arrows += [(a, b) for a in before for b in after]
    return found


def _named(name: str, folder: str, known: dict[str, Module]) -> str:
    """A module by its name in the group's folder, in the package, or by its last part."""
    by_last_part = [module for module in known if module.rpartition(".")[2] == name]
    for candidate in (f"{folder}.{name}", name):
        if candidate in known:
            return candidate
    assert len(by_last_part) == 1, f"the map names '{name}', which is {by_last_part or 'no module'}"
    return by_last_part[0]


BLOCKS = re.findall(
    r"```text\n(.*?)```", (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8"), re.S
)
PACKAGE_MAP = read_map(BLOCKS[0], MODULES)
# the head names the folder, but scripts are no package
SCRIPT_MAP = read_map(BLOCKS[1], SCRIPT_MODULES)


def test_every_module_is_on_the_map():
    named = set(PACKAGE_MAP.group) | PACKAGE_MAP.folders
    assert set(MODULES) - {""} - named == set()
    packages = {name for name, module in MODULES.items() if module.path.name == "__init__.py"}
    assert packages - {""} == PACKAGE_MAP.folders
    helpers = {name for name in SCRIPT_MODULES if name.startswith("_")}
    assert helpers - set(SCRIPT_MAP.group) == set()


@pytest.mark.parametrize(
    ("found", "known"),
    [(PACKAGE_MAP, MODULES), (SCRIPT_MAP, SCRIPT_MODULES)],
    ids=["package", "scripts"],
)
def test_every_arrow_is_an_import(found: Map, known: dict[str, Module]):
    assert len(found.arrows) > 10
    wrong = [f"{a} ──► {b}" for a, b in found.arrows if a not in known[b].all]
    assert not wrong


def test_modules_import_from_their_own_group_and_those_above():
    group = PACKAGE_MAP.group
    against = {
        (name, imported)
        for name, module in MODULES.items()
        for imported in module.all
        if name in group and imported in group and group[imported] > group[name]
    }
    assert against == set(ON_DEMAND)
    assert not [pair for pair in ON_DEMAND if pair[1] in MODULES[pair[0]].loaded]


# --- one way -------------------------------------------------------------------------------------


def top(name: str) -> str:
    return name.partition(".")[0]


@pytest.mark.parametrize(
    ("folder", "forbidden"),
    [
        ("mitsuba", ("report", "bench", "cli", "notebook")),
        ("report", ("bench", "cli", "notebook")),
        ("bench", ("cli", "notebook")),
        ("cli", ("notebook",)),
    ],
)
def test_folders_know_only_what_is_below(folder: str, forbidden: tuple[str, ...]):
    inside = {name: module for name, module in MODULES.items() if top(name) == folder}
    assert len(inside) > 1
    assert not [
        (name, imported)
        for name, module in inside.items()
        for imported in module.all
        if top(imported) in forbidden
    ]


def test_the_rest_knows_no_renderer():
    """Neither the package's own modules that touch one, nor Mitsuba itself."""
    rest = {name: module for name, module in MODULES.items() if top(name) not in RENDERERS}
    known = {name for name, module in rest.items() if {top(m) for m in module.all} & {*RENDERERS}}
    assert known == set(ENTRANCES)
    code = {name: module.path.read_text(encoding="utf-8") for name, module in rest.items()}
    assert {name for name, text in code.items() if _imports_mitsuba(text)} == set(ASKING)


def _imports_mitsuba(text: str) -> bool:
    return any(
        "mitsuba" in map(top, [alias.name for alias in node.names])
        if isinstance(node, ast.Import)
        else not node.level and top(node.module or "") == "mitsuba"
        for node, _ in _imports(ast.parse(text), inside=False)
    )


def test_no_module_needs_itself_to_load():
    graph = {name: module.loaded - {name} for name, module in MODULES.items()}
    assert sum(map(len, graph.values())) > 200
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" ──► ".join(error.args[1]))


@pytest.mark.parametrize(
    ("text", "loaded", "on_demand"),
    [
        ("from .b import x", {"b"}, set()),
        ("from . import b", {"b"}, set()),
        ("import p.b", {"b"}, set()),
        ("from p import b", {"b"}, set()),
        ("def f():\n    from .c.d import x", set(), {"c.d"}),
        ("from .c import d, x", {"c.d", "c"}, set()),
        ("if TYPE_CHECKING:\n    from .b import x", set(), set()),
        ("try:\n    from .b import x\nexcept ImportError:\n    pass", {"b"}, set()),
        ("import numpy as b", set(), set()),
    ],
)
def test_imports_are_found(tmp_path: Path, text: str, loaded: set[str], on_demand: set[str]):
    (tmp_path / "c").mkdir()
    for name in ("b.py", "c/__init__.py", "c/d.py"):
        (tmp_path / name).write_text("", encoding="utf-8")
    (tmp_path / "a.py").write_text(text, encoding="utf-8")
    found = modules_of(tmp_path, "p")["a"]
    assert (found.loaded, found.on_demand) == (loaded, on_demand)


def test_relative_imports_go_up(tmp_path: Path):
    (tmp_path / "c").mkdir()
    for name, text in {"b.py": "", "c/__init__.py": "from .d import x", "c/e.py": ""}.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "c" / "d.py").write_text("from ..b import x\nfrom .e import y", encoding="utf-8")
    found = modules_of(tmp_path, "p")
    assert found["c.d"].loaded == {"b", "c.e"}
    assert found["c"].loaded == {"c.d"}


# --- the reference -------------------------------------------------------------------------------

ELSEWHERE = {
    "cli": "commands are on docs/command_line.md",
    "notebook": "on docs/notebook.md",
}
"""Modules without a place in docs/api, and where they have it."""


def test_every_public_module_is_in_the_reference():
    pages = sorted((ROOT / "docs" / "api").glob("*.md"))
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    listed = re.findall(r"^\.\. automodule:: fresnel_decomp\.(\S+)$", text, re.M)
    assert len(listed) == len(set(listed))
    public = {
        name
        for name, module in MODULES.items()
        if not any(part.startswith("_") for part in name.split("."))
        and module.path.name != "__init__.py"
        and top(name) not in ELSEWHERE
    }
    assert public - {""} <= set(listed)
    assert not set(listed) - set(MODULES)


def test_headings_of_the_reference_are_modules():
    for page in (ROOT / "docs" / "api").glob("*.md"):
        text = page.read_text(encoding="utf-8")
        headings = re.findall(r"^## (\S+)\n\n```\{eval-rst\}\n\.\. automodule:: (\S+)$", text, re.M)
        assert [f"fresnel_decomp.{name}" for name, _ in headings] == [m for _, m in headings]
        assert len(headings) == text.count("automodule::")

"""Examples in docstrings and pages run as shown; the documentation builds."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import fresnel_decomp
from links import broken_links, read

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").rglob("*.md"))
MODULES = sorted(
    module.name
    for module in pkgutil.walk_packages(fresnel_decomp.__path__, "fresnel_decomp.")
    if module.name != "fresnel_decomp.__main__"
)
EXAMPLES = [page for page in PAGES if "```pycon" in page.read_text(encoding="utf-8")]


@pytest.fixture(autouse=True)
def _variant_as_before(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Examples may set a Mitsuba variant and write files."""
    import mitsuba as mi

    monkeypatch.chdir(tmp_path)
    before = mi.variant()
    yield
    if before:
        mi.set_variant(before)


def failures(test: doctest.DocTest) -> str:
    report: list[str] = []
    doctest.DocTestRunner().run(test, out=report.append, clear_globs=False)
    return "".join(report)


@pytest.mark.parametrize("name", MODULES)
def test_docstring_examples(name: str):
    module = importlib.import_module(name)
    tests = [test for test in doctest.DocTestFinder().find(module) if test.examples]
    assert not "".join(failures(test) for test in tests)


@pytest.mark.parametrize("page", EXAMPLES, ids=lambda page: page.stem)
def test_page_examples(page: Path, monkeypatch: pytest.MonkeyPatch):
    """Blocks of a page run in turn and share their names, definitions on `extend_` pages too."""
    module = ModuleType("a_page")  # where dataclasses look for what annotations mean
    monkeypatch.setitem(sys.modules, module.__name__, module)
    names: dict[str, Any] = vars(module)
    blocks = re.findall(r"```(pycon|python)\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    for number, (kind, text) in enumerate(blocks):
        if kind == "pycon":
            title = f"{page.name}, block {number}"
            test = doctest.DocTestParser().get_doctest(text, names, title, str(page), 0)
            assert not failures(test)
            names.update(test.globs)
        elif page.stem.startswith("extend_"):
            exec(compile(text, str(page), "exec"), names)


def test_there_are_examples():
    names = {page.stem for page in EXAMPLES}
    assert {"index", "decomposition", "recipes", "plugin"} <= names
    assert {"extend_model", "extend_recipe", "extend_bsdf"} <= names


@pytest.mark.parametrize("name", fresnel_decomp.__all__)
def test_public_names_are_listed(name: str):
    if not name.startswith("__"):
        listed = "".join(p.read_text(encoding="utf-8") for p in (ROOT / "docs/api").glob("*.md"))
        assert re.search(rf"\b{name}$", listed, re.M), f"docs/api/index.md lacks {name}"


def test_every_command_option_is_described():
    from fresnel_decomp.cli import cli

    text = (ROOT / "docs/command_line.md").read_text(encoding="utf-8")
    for name, command in cli.commands.items():
        assert f"## {name}\n" in text
        for parameter in command.params:
            for option in parameter.opts if parameter.param_type_name == "option" else ():
                assert option in text or option == "--help", f"{name} {option}"


def test_citation_has_this_version():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {fresnel_decomp.__version__}\n" in text


@pytest.fixture(scope="module")
def html(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The documentation, built without warnings."""
    pytest.importorskip("myst_nb")
    pytest.importorskip("furo")
    folder = tmp_path_factory.mktemp("documentation")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    command += ["-D", "nb_execution_mode=off"]  # test_distribution executes
    build = subprocess.run(
        [*command, "-d", str(folder / "doctrees"), str(ROOT / "docs"), str(folder / "html")],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert build.returncode == 0, build.stderr
    return folder / "html"


@pytest.mark.slow
def test_documentation_builds(html: Path):
    assert "<math" in (html / "decomposition.html").read_text(encoding="utf-8")
    pages = sorted((html / "notebooks").glob("*.html"))
    assert len(pages) == len(list((ROOT / "notebooks").glob("*.py")))
    for page in pages:
        notebook = page.read_text(encoding="utf-8")
        assert notebook.count("<h2") >= 4
        assert "cdn." not in notebook  # readable without a network


@pytest.mark.slow
def test_links_of_the_documentation(html: Path):
    """Pages, anchors, pictures and styles: nothing is missing, and nothing comes from elsewhere."""
    assert not broken_links(html)
    loaded = [
        (path.name, link)
        for path in html.rglob("*.html")
        for tag, link in read(path).links
        if tag in ("img", "script", "iframe", "source") and "//" in link
    ]
    assert not loaded

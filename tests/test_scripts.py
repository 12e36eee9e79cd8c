"""All scripts: each is one command, and pages and docstrings give it options that it has."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import click
import pytest

from conftest import SCRIPTS

ROOT = SCRIPTS.parent
NAMES = sorted(path.stem for path in SCRIPTS.glob("[a-z]*.py"))
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *SCRIPTS.glob("*.py")])


def command_of(module: Any) -> click.Command:
    """The one that the script runs."""
    made = [value for value in vars(module).values() if isinstance(value, click.Command)]
    groups = [command for command in made if isinstance(command, click.Group)]
    inner = [command for group in groups for command in group.commands.values()]
    (command,) = (command for command in made if command not in inner)
    return command


def options_of(command: click.Command) -> set[str]:
    inner = command.commands.values() if isinstance(command, click.Group) else ()
    return {o for c in (command, *inner) for p in c.params for o in p.opts} | {"--help"}


def test_each_is_one_command_that_explains_itself(
    scripts: Any, run_script: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in NAMES:
        module = getattr(scripts, name)
        command = command_of(module)
        assert run_script(command, "--help", main=module.main) == 0, name
        printed = capsys.readouterr().out
        assert "Usage:" in printed
        assert len(printed.splitlines()[2].strip()) > 10, name


def test_options_on_pages_exist(scripts: Any) -> None:
    found = 0
    for page in PAGES:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for name, rest in re.findall(r"python scripts/(\w+)\.py([^`\n#&|\"]*)", text):
            assert name in NAMES, f"{page.name}: {name}"
            known = options_of(command_of(getattr(scripts, name)))
            given = set(re.findall(r"(?<!\S)--?[a-z][\w-]*", rest))
            assert given <= known, f"{page.name}: {name} {sorted(given - known)}"
            found += len(given)
    assert found > 50


@pytest.mark.parametrize("name", ["plan_study", "bench_plugin", "speed_exact", "speed_vs_error"])
def test_bad_input_is_a_message(
    name: str, scripts: Any, run_script: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = command_of(getattr(scripts, name))
    assert run_script(command, "--variant", "no_such_variant") == 2
    assert "Error: " in capsys.readouterr().err

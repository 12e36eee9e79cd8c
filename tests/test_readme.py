"""The README's examples print what they say, and its figures are those of the documentation."""

from __future__ import annotations

import contextlib
import io
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
CODE = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_example_prints_its_output():
    (output,) = re.findall(r"```python\n.*?```\n\n```text\n(.*?)```", README, re.DOTALL)
    assert len(CODE[0].splitlines()) <= 12
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(CODE[0], "README.md", "exec"), {})
    assert printed.getvalue() == output


def test_plugin_example_runs():
    code = CODE[0] + CODE[1] + "print(spectral_gold)"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert "DecomposedConductor" in result.stdout


def test_accuracy_and_speed_are_those_of_the_documentation():
    """docs/recipes.md is compared with what the script prints in test_tables."""
    recipes = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| (?:Schlick|Lazanyi|F82|notebook|talk|balanced|robust|minimax|albedo).*$",
        README,
        re.MULTILINE,
    )
    assert len(rows) >= 12
    assert all(row in recipes for row in rows)
    plugin = (ROOT / "docs" / "plugin.md").read_text(encoding="utf-8")
    (times,) = re.findall(r"```text\n( +BSDF only.*?)```", README, re.DOTALL)
    assert times in plugin


def test_linked_files_exist():
    links = re.findall(r"\]\(([^)#:]+)\)", README)
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []

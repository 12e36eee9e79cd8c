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
    """test_speed_vs_error compares both with the file of numbers, test_tables docs/recipes.md."""
    page = (ROOT / "docs" / "speed_vs_error.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| (?:Schlick|Lazanyi|F82|notebook|talk|balanced|robust|minimax|albedo).*$",
        README,
        re.MULTILINE,
    )
    assert len(rows) == 27  # three formulas, and six recipes of four sizes
    assert all(row in page for row in rows)
    # what kernels evaluate is within 1e-4 of the functions themselves, whose errors these are
    recipes = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
    table = recipes.partition("| largest error / RMSE | a ")[2].partition("\n\n")[0]
    found = {cells[0]: cells for cells in (_cells(line) for line in table.splitlines()[2:])}
    for row in rows:
        name, *_, a, cp, d, low, _ = _cells(row)
        for given, exact in zip((a, cp, d, low), found[name][1:5], strict=True):
            for one, other in zip(given.split(" / "), exact.split(" / "), strict=True):
                assert abs(float(one) - float(other)) < 2.5e-4, name


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_linked_files_exist():
    links = re.findall(r"\]\(([^)#:]+)\)", README)
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_figures_are_those_of_the_scripts(scripts):
    """All that `reproduce.py` makes, with the minutes that it says."""
    listed = re.findall(r"\(scripts/(\w+)\.py\) \| ([\d.]+) \|", README)
    known = {name: f"{figure.minutes:.1f}" for name, figure in scripts.reproduce.FIGURES.items()}
    assert dict(listed) == known

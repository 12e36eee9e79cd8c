"""The benchmark of the exact equations: its form, its check of answers, and the page it writes."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from fresnel_decomp import dielectric

ROOT = Path(__file__).parent.parent


@pytest.fixture
def script(scripts: Any) -> ModuleType:
    return scripts.speed_exact


PAGE = (ROOT / "docs" / "speed.md").read_text(encoding="utf-8")


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def head_and_names(markdown: str) -> list[str]:
    """First line of each table, and the first column."""
    rows = [line for line in markdown.splitlines() if line.startswith("|")]
    heads = [
        re.sub(r" +", " ", row) for row in rows if row.startswith(("| time", "| op", "| target"))
    ]
    return heads + [row.split("|")[1].strip() for row in rows]


@pytest.mark.slow  # 30 kernels to compile
def test_all_ratios(script, run_script, llvm, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path, page = tmp_path / "speed.json", tmp_path / "page.md"
    marks = [mark for pair in (script.MARKS, script.COUNT_MARKS) for mark in pair]
    page.write_text("# Page\n" + "".join(marks) + "End.\n")
    quick = ["--rounds", "9", "--points", "10000", "--elements", "64", "--turns", "2"]
    assert run_script(script.speed, *quick, "--out", path, "--page", page) == 0
    printed = capsys.readouterr().out
    report = json.loads(path.read_text(encoding="utf-8"))
    assert report["about"]["llvm"]
    rows = {(row["function"], row["kernel"]): row for row in report["results"]}
    assert len(rows) == 2 * 3 * 5
    assert all(row["nanoseconds"] > 0.0 for row in rows.values())
    for base in ("mi.fresnel_conductor", "mi.fresnel"):
        own = [row for row in rows.values() if row["function"] == base]
        assert all((row["ratio"], row["spread"]) == (1.0, 0.0) for row in own)
    times, counted = printed.strip().split("\n\n| operations")
    assert times in page.read_text(encoding="utf-8")
    assert f"| operations{counted}" in page.read_text(encoding="utf-8")
    assert len(report["operations"]) == 6
    # the page of the documentation is of this form
    assert head_and_names(PAGE) == head_and_names(printed)


def test_the_page_has_the_counts_of_these_kernels(script, llvm):
    _, _, rest = PAGE.partition(script.COUNT_MARKS[0])
    shown, end, _ = rest.partition(script.COUNT_MARKS[1])
    assert end
    assert shown.strip() == script.count_table(script.counts())


def test_the_page_has_the_verdicts_of_its_ratios(script):
    """All targets, each with the ratio of the table above and what follows from it."""
    rows = [cells(line) for line in PAGE.splitlines() if line.startswith("|")]
    ratios, head = {}, []
    for row in rows:
        if row[0].startswith("time / "):
            head = row
        elif "±" in row[1]:
            ratios |= {
                f"{row[0]}: {kind}": cell.split()[0]
                for kind, cell in zip(head[1:], row[1:], strict=True)
            }
    assert len(ratios) == 2 * 2 * 5
    found = {row[0]: row[1:] for row in rows if row[-1] in ("met", "missed")}
    for name, ratio in ratios.items():
        function, kind = name.split(": ")
        wanted = {
            ("native", "streaming"): "1.20",
            ("wide", "streaming"): "2.50",
            ("native", "compute-bound"): "1.40",
            ("wide", "compute-bound"): "3.00",
            ("native", "value and gradient"): "1.00",
        }.get((function.split(", ")[1], kind.split(",")[0]))
        if wanted:
            verdict = "met" if float(ratio) <= float(wanted) else "missed"
            assert found.pop(name) == [f"≤ {wanted}", ratio, verdict]
    assert not found
    met, missed = (sum(row[-1] == word for row in rows) for word in ("met", "missed"))
    assert f"{met} of 16 targets are met, {missed} are missed." in PAGE


def test_answers_are_checked_before_timing(script, llvm):
    functions = [f for family in script.functions().values() for f in family]
    script.check(functions, 2000)
    right = dielectric

    def doubled_slope(c, eta):
        import drjit as dr

        R = right(c, eta)
        return 2.0 * R - dr.detach(R)

    for run in (lambda c, eta: right(c, 1.001 * eta), doubled_slope):
        with pytest.raises(RuntimeError, match="wrong"):
            script.check([script.Function("wrong", 1, run, 1e-6)], 2000)


@pytest.mark.parametrize(
    ("wrong", "accepted"),
    [(["--rounds", "3"], "x>=9"), (["--variant", "scalar_rgb"], "accepted: an llvm_ad or cuda_ad")],
)
def test_bad_input(
    wrong: list[str], accepted: str, script, run_script, capsys: pytest.CaptureFixture[str]
):
    assert run_script(script.speed, *wrong) == 2
    assert accepted in capsys.readouterr().err


def test_a_page_without_a_place_is_found_before_anything_is_timed(
    script, run_script, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    page = tmp_path / "page.md"
    page.write_text("".join(script.MARKS), encoding="utf-8")  # but none for the counts
    assert run_script(script.speed, "--variant", "no variant", "--page", page) == 2
    assert "without a place for the tables" in capsys.readouterr().err

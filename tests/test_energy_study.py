"""The energy study: its page is what it prints, and a run at thumbnail size."""

from __future__ import annotations

import re
from typing import Any

import pytest

from conftest import SCRIPTS
from fresnel_decomp import doctor

PAGE = SCRIPTS.parent / "docs" / "energy.md"


@pytest.fixture
def study(scripts: Any) -> Any:
    return scripts.energy_study


def test_page_meets_the_bounds() -> None:
    """Albedo within .03 up to alpha = .6 with correlated Smith; white furnace within 1 %."""
    text = PAGE.read_text(encoding="utf-8")
    table = text.partition("| correlated Smith")[2].partition("| separable Smith")[0]
    row = re.search(r"^\| ours.*$", table, re.MULTILINE)
    assert row is not None
    cells = [float(cell) for cell in row[0].split("|")[2:-1]]
    assert len(cells) == 8
    assert max(cells[:-1]) < 0.03 < cells[-1]
    furnace = re.findall(r"^\| (?:ggx|beckmann)[^|]*\|([^|]*)\|([^|]*)\|", text, re.MULTILINE)
    assert len(furnace) == 4
    assert all(float(after) < 0.01 < float(before) for before, after in furnace)


@pytest.mark.slow
def test_quick_study(
    study: Any, run_script: Any, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    if doctor.best_variant().startswith("scalar"):
        pytest.skip("minutes in scalar variants")
    page = tmp_path / "page.md"
    page.write_text("".join(study.MARKS), encoding="utf-8")
    for expected in ("took", "was finished"):
        assert run_script(study.command, "--quick", "--out", tmp_path, "--page", page) == 0
        printed = capsys.readouterr().out
        assert expected in printed
    inside = page.read_text(encoding="utf-8").split(study.MARKS[0])[1].split(study.MARKS[1])[0]
    assert inside.strip() in printed
    # what does not depend on the number of paths is on the page of the full run too
    furnace = [line for line in inside.splitlines() if line.startswith(("| ggx", "| beckmann"))]
    assert len(furnace) == 4
    full = PAGE.read_text(encoding="utf-8")
    assert all(line in full for line in furnace)

"""The Fresnel term alone under area lights: what the page says of it."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from fresnel_decomp import doctor

ROOT = Path(__file__).parent.parent


@pytest.fixture
def script(scripts: Any) -> ModuleType:
    return scripts.area_light_fresnel


def shown(text: str) -> dict[str, list[str]]:
    rows = [line for line in text.splitlines() if re.match(r"\| \w+, \d terms", line)]
    cells = [[cell.strip() for cell in row.strip("| ").split("|")] for row in rows]
    return {name: rest for name, *rest in cells}


def test_page_names_the_recipes_that_keep_the_bound(script: ModuleType) -> None:
    page = (ROOT / "docs" / "area_lights.md").read_text(encoding="utf-8")
    rows = shown(page.split(script.MARKS[0])[1].split(script.MARKS[1])[0])
    assert len(rows) == len(script.RECIPES) * len(script.TERMS)
    for *values, inside in rows.values():
        assert (inside == "yes") == (max(map(float, values)) <= 100.0 * script.BOUND)
    good = {name for name, row in rows.items() if row[-1] == "yes"}
    assert good == {"albedo, 4 terms", "albedo, 5 terms", "balanced, 5 terms"}


@pytest.mark.slow
def test_numbers_of_the_page(script: ModuleType) -> None:
    """At a third of the size, where highlights are a few pixels wide."""
    if doctor.best_variant().startswith("scalar"):
        pytest.skip("minutes in scalar variants")
    page = (ROOT / "docs" / "area_lights.md").read_text(encoding="utf-8")
    written, found = shown(page), shown(script.table(script.errors(32)))
    for name, row in found.items():
        for small, whole in zip(row[:-1], written[name][:-1], strict=True):
            assert float(small) == pytest.approx(float(whole), rel=0.25, abs=0.03)

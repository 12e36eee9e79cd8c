"""The study of plans: three different ones, each kept when rendered."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture
def study(scripts: Any) -> Any:
    return scripts.plan_study


def row(study, **changes):
    kept = {"bound": 0.02, "metal": "gold", "model": "decomposition", "basis": "talk, 3 terms"}
    numbers = {"operations": 23, "predicted": 0.01, "measured": 0.008, "noise": 0.0001}
    return study.Row(**{**kept, **numbers, **changes})


def test_broken_predictions_are_told(study):
    assert study.violations([row(study)]) == []
    assert len(study.violations([row(study, measured=0.0102), row(study, measured=0.003)])) == 2
    assert study.violations([row(study, measured=0.01005)]) == []  # within the noise
    assert study.violations([row(study, model="exact", predicted=0.0, measured=1e-4)]) == []


@pytest.mark.slow
def test_three_plans(study, run_script, llvm, tmp_path: Path):
    out, picture = tmp_path / "plans.json", tmp_path / "plans.png"
    options = ["--size", "256", "--spp", "128", "--folder", tmp_path / "renders"]
    assert run_script(study.plans, *options, "--out", out, "--picture", picture) == 0
    rows = json.loads(out.read_text(encoding="utf-8"))["rows"]
    plans = {}
    for entry in rows:
        plans.setdefault(entry["bound"], []).append((entry["metal"], entry["basis"]))
    assert len(plans) == 3
    assert len({str(plan) for plan in plans.values()}) == 3
    assert picture.stat().st_size > 10_000
    # plans and predictions do not depend on the renders: the page quotes them
    page = (ROOT / "docs" / "plans.md").read_text(encoding="utf-8")
    quoted = {tuple(line.split("|")[1:6]) for line in page.splitlines() if line.startswith("| 0.")}
    quoted = {tuple(re.sub(r"\s+", " ", cell).strip() for cell in line) for line in quoted}
    for entry in rows:
        takes = entry["basis"] or entry["model"]
        numbers = (str(entry["operations"]), f"{entry['predicted']:.4f}")
        assert (f"{entry['bound']:g}", entry["metal"], takes, *numbers) in quoted

"""The study of plans: three different ones, each kept when rendered."""

from __future__ import annotations

import importlib
import json
import re
from pathlib import Path

import pytest

from fresnel_decomp import doctor

ROOT = Path(__file__).parent.parent


@pytest.fixture
def study(monkeypatch: pytest.MonkeyPatch):
    """The script as a module."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    return importlib.import_module("plan_study")


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
def test_three_plans(study, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    if not doctor.usable_variants()["llvm_ad_rgb"].usable:
        pytest.skip("llvm_ad_rgb does not run here")
    import mitsuba as mi

    before = mi.variant()
    out, picture = tmp_path / "plans.json", tmp_path / "plans.png"
    options = ["--size", "256", "--spp", "128", "--folder", str(tmp_path / "renders")]
    try:
        study.main([*options, "--out", str(out), "--picture", str(picture)])
    finally:
        if before:
            mi.set_variant(before)
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

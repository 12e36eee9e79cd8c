"""The benchmark of the plugin: its table and verdicts, and a run in miniature."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
ABOUT = {
    "variant": "v", "machine": "m", "threads": 2, "llvm": "19", "mitsuba": "3", "drjit": "1",
    "distribution": "ggx", "rounds": 15,
}  # fmt: skip


@pytest.fixture
def bench(scripts: Any) -> Any:
    return scripts.bench_plugin


def test_summary_of_known_times(bench: Any) -> None:
    """Ratios are taken round by round: here always a half, though the machine slows down."""
    rows = bench.summary({"roughconductor": [2.0, 4.0, 8.0], "schlick": [1.0, 2.0, 4.0]})
    assert rows["schlick"] == {"milliseconds": 2.0, "ratio": 0.5, "spread": 0.0}


@pytest.mark.parametrize(("ratio", "verdict"), [(0.85, "met"), (0.86, "missed")])
def test_report(bench: Any, ratio: float, verdict: str) -> None:
    row = {"milliseconds": 14.0, "ratio": 1.0, "spread": 0.01}
    table = {name: dict(row) for name in bench.PLUGINS}
    table["decomposition"]["ratio"] = ratio
    text = bench.report({"eval": table, "render": table}, ABOUT)
    assert f"BSDF only {ratio:.3f}, target 0.85 {verdict}" in text
    line = next(line for line in text.splitlines() if line.startswith("| decomposition "))
    assert line.count(f"{ratio:.3f} ± 0.010") == 2
    assert "The built-in takes 14 ms and 14 ms." in text


def test_page_has_both_tables(bench: Any) -> None:
    page = (ROOT / "docs" / "plugin.md").read_text(encoding="utf-8")
    for first, last in bench.MARKS.values():
        inside = page.partition(first)[2].partition(last)[0]
        for name in bench.PLUGINS:
            assert f"| {name} " in inside
        for limits in bench.TARGETS.values():
            assert inside.count("target") == len(limits)


@pytest.mark.slow
def test_in_miniature(bench: Any, run_script: Any, llvm: None, tmp_path: Path) -> None:
    out = tmp_path / "plugin.json"
    few = ("--rounds", "3", "--points", "2000", "--size", "8", "--spp", "1")
    assert run_script(bench.bench, *few, "--out", str(out)) == 0
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["about"]["points"] == 2000
    assert set(found["results"]["eval"]) == set(bench.PLUGINS)
    assert all(row["ratio"] > 0.0 for row in found["results"]["render"].values())

"""The study of the principled BSDF: its tables are the page's, and a run at thumbnail size."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from conftest import SCRIPTS
from fresnel_decomp import doctor

PAGE = SCRIPTS.parent / "docs" / "principled.md"


@pytest.fixture
def study(scripts: Any) -> Any:
    return scripts.principled_study


@pytest.fixture
def compared(scripts: Any) -> Any:
    return scripts._principled


def test_mixing_is_linear_for_schlick_only(compared: Any) -> None:
    rows = compared.mixing_errors()
    assert all(value < 1e-12 for value in rows["copper, Schlick"].values())
    for way in ("index, k = 0", "usual edge"):
        assert rows[f"copper, {way}"]["0.5"] > 0.05


@pytest.mark.slow
def test_page_has_the_tables(study: Any, compared: Any) -> None:
    """All but the times and the pictures, which depend on the machine and on chance."""
    page = PAGE.read_text(encoding="utf-8")
    results = {
        "curves": compared.curve_errors(),
        "recipes": compared.recipe_errors(),
        "mixing": compared.mixing_errors(),
        "furnace": compared.furnace(),
        "indices": compared.furnace_of_indices(),
        "cost": {"": {"": [0.0, 0.0]}},
        "renders": {
            name: {kind: {"delta_e": 0.0} for kind in ("schlick", "usual", "edge", "nodes")}
            for name in ("Au", "Cu")
        }
        | {name: {"delta_e": 0.0} for name in ("0", "0.5", "1")},
    }
    texts = study.tables(results)
    for name in ("curves", "mixing", "furnace", "indices"):
        for line in texts[name].splitlines():
            assert line in page


@pytest.mark.slow
def test_quick_study(
    study: Any, run_script: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if doctor.best_variant().startswith("scalar"):
        pytest.skip("minutes in scalar variants")

    def run() -> None:
        assert run_script(study.command, "--quick", "--out", tmp_path) == 0

    run()
    written = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert written == set(study.FIGURE.pictures)
    sidecar = tmp_path / "principled_study" / "principled_study.json"
    results = json.loads(sidecar.read_text(encoding="utf-8"))["results"]
    for metal in ("Au", "Cu"):
        errors = {name: found["delta_e"] for name, found in results["renders"][metal].items()}
        assert errors["nodes"] < errors["schlick"] < errors["usual"]
    assert max(abs(v) for v in results["indices"]["η = 1"].values()) == 0.0
    assert max(abs(v) for row in results["indices"].values() for v in row.values()) < 0.1
    for row in results["furnace"].values():
        assert row["decomposition"] < 1e-3
        assert row["exact"] < 1e-3
    stamp = sidecar.stat().st_mtime_ns
    capsys.readouterr()
    run()
    assert "was finished" in capsys.readouterr().out
    assert sidecar.stat().st_mtime_ns == stamp

"""The area light study: its page quotes it, and a run at thumbnail size."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import SCRIPTS
from fresnel_decomp import doctor

PAGE = SCRIPTS.parent / "docs" / "area_lights.md"


@pytest.fixture
def study(scripts: Any) -> Any:
    return scripts.area_light_study


def test_numbers(study: Any) -> None:
    assert [study.percent(v) for v in (0.1234, 0.0567, 0.00123)] == ["12", "5.7", "0.12"]


def test_page_quotes_the_study() -> None:
    text = PAGE.read_text(encoding="utf-8")
    printed = text.partition("```text\n")[2].partition("```")[0]
    section = text.partition("## What each step costs")[2].partition("## ")[0]
    quoted = re.findall(r"[\d.]+–[\d.]*\d", section)
    assert len(quoted) > 9
    assert set(quoted) <= set(re.findall(r"[\d.]+–[\d.]*\d", printed))
    mean = re.search(r"mean ([\d.]+) %", printed)
    assert mean is not None
    assert f"{mean[1]} % over all" in section


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
    sidecar = tmp_path / "area_light_study" / "area_light_study.json"
    scenes = json.loads(sidecar.read_text(encoding="utf-8"))["results"]["scenes"]
    for scene in scenes.values():
        for metal in study.METALS:
            found = scene["materials"][metal]
            assert found["fresnel"]["balanced"] < 0.012
            assert found["half_vector"]["plain"] < found["half_vector"]["none"]
    plastic = [scene["materials"]["plastic"]["half_vector"] for scene in scenes.values()]
    plain, none = (np.mean([errors[name] for errors in plastic]) for name in ("plain", "none"))
    assert plain < 0.4 * none  # of single scenes the noise may be half of what it leaves
    # four samples a pixel are noisy; together the scenes tell a good lobe from a wrong one
    assert np.mean([scene["lobe"] - scene["noise"] for scene in scenes.values()]) < 0.25
    capsys.readouterr()
    run()
    assert "was finished" in capsys.readouterr().out

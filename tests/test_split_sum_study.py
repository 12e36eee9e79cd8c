"""The split-sum study: how its numbers are written, and a run at thumbnail size."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fresnel_decomp import doctor
from test_figures import MODULES, SCRIPTS


@pytest.fixture
def study(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.syspath_prepend(str(SCRIPTS))
    yield importlib.import_module("split_sum_study")
    for name in MODULES:
        sys.modules.pop(name, None)


def test_cells(study: Any) -> None:
    numbers = {"nrmse": 0.3456, "delta_e": 6.823, "flip": 0.01234}
    assert study.cell(numbers) == "34.6 · 6.82 · 0.012"
    assert study.rounded(3e-5) == "3e-05"


def test_only_covered_pixels_count(study: Any) -> None:
    module = sys.modules["_split_sum"]
    random = np.random.default_rng(0)
    reference = random.random((8, 8, 3)).astype(np.float32)
    test = reference.copy()
    inside = np.zeros((8, 8), bool)
    inside[2:6, 2:6] = True
    test[~inside] += 0.5
    assert module.measure(reference, test, inside, 0.0)["nrmse"] == 0.0
    test[inside] *= 1.1
    expected = 0.1 * np.sqrt(np.mean(reference[inside] ** 2)) / reference[inside].mean()
    found = module.measure(reference, test, inside, 0.0)
    assert found["nrmse"] == pytest.approx(expected, rel=1e-4)
    assert found["delta_e"] > 0.0
    assert found["flip"] > 0.0


def test_scenes_have_names_of_their_own(study: Any) -> None:
    module = sys.modules["_split_sum"]
    stems = [scene.stem for scene in (*module.SPHERES, *module.BALLS)]
    assert len(set(stems)) == len(stems) == 22


@pytest.mark.slow
def test_quick_study(study: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if doctor.best_variant().startswith("scalar"):
        pytest.skip("minutes in scalar variants")
    main = sys.modules["_figure"].main

    def run() -> None:
        with pytest.raises(SystemExit) as end:
            main(study.study, ["--quick", "--out", str(tmp_path)])
        assert end.value.code == 0

    run()
    written = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert written == set(study.FIGURE.pictures)
    sidecar = tmp_path / "split_sum_study" / "split_sum_study.json"
    results = json.loads(sidecar.read_text(encoding="utf-8"))["results"]
    for scene in sys.modules["_split_sum"].SPHERES:
        found = results["scenes"][scene.stem]
        assert found["table_alone"]["nrmse"] < 1e-3
        assert found["fresnel_alone"]["decomposition"]["nrmse"] < 0.06
        if scene.material == "edge":
            after = found["same_light"]
            assert after["decomposition"]["delta_e"] < 1.0
            assert after["schlick"]["delta_e"] > 3.0
    for name in study.TABLES:
        lines = (tmp_path / name).read_text(encoding="utf-8").splitlines()
        assert len(lines) >= 19
    stamp = sidecar.stat().st_mtime_ns
    capsys.readouterr()
    run()
    assert "was finished" in capsys.readouterr().out
    assert sidecar.stat().st_mtime_ns == stamp

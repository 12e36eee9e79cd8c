"""The split-sum study: how its numbers are written, and a run at thumbnail size."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import SCRIPTS
from fresnel_decomp import doctor

FIGURES = SCRIPTS.parent / "docs" / "figures"


@pytest.fixture
def study(scripts: Any) -> Any:
    return scripts.split_sum_study


def test_cells(study: Any) -> None:
    numbers = {"nrmse": 0.3456, "delta_e": 6.823, "flip": 0.01234}
    assert study.cell(numbers) == "34.6 · 6.82 · 0.012"
    assert study.rounded(3e-5) == "3e-05"


def test_only_covered_pixels_count(study: Any, scripts: Any) -> None:
    module = scripts._split_sum
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


def test_scenes_have_names_of_their_own(study: Any, scripts: Any) -> None:
    module = scripts._split_sum
    stems = [scene.stem for scene in (*module.SPHERES, *module.BALLS)]
    assert len(set(stems)) == len(stems) == 22


def read_rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    places = (
        ["first", "second", "third", *header[3:]] if header[1] == "" else ["first", *header[1:]]
    )
    return [dict(zip(places, row, strict=True)) for row in rows]


GROUPS = {
    "metals": ("Beryllium", "Gold", "Aluminium", "Copper"),
    "beryllium": ("Beryllium",),
    "copper": ("Copper",),
    "plastic": ("Plastic, η = 1.5",),
    "edge tint": ("Edge tint",),
    "spheres": ("Beryllium", "Gold", "Aluminium", "Copper", "Plastic, η = 1.5", "Edge tint"),
    "shader balls": tuple(f"{m}, shader-ball, {light}" for m in ("Gold", "Edge tint")
                          for light in ("city", "sunsky")),
}  # fmt: skip
SOURCES = {
    "(i) Fresnel term alone": ("fresnel", None),
    "(ii) table alone": ("table", "table alone"),
    "(ii) against exact F̄": ("table", None),
    "(iii) split-sum": ("reference", None),
    "(iii) noise of the reference": ("reference", "noise"),
}


def test_summary_is_that_of_the_tables() -> None:
    """Least and largest of the cells of the tables beside it, as they are written there."""
    rows = [
        row
        for row in read_rows(FIGURES / "split_sum_summary.csv")
        if not row["first"].startswith("light term")
    ]
    assert {row["first"] for row in rows} == set(SOURCES)
    for row in rows:
        name, column = SOURCES[row["first"]]
        table = read_rows(FIGURES / f"split_sum_{name}.csv")
        members = [r for r in table if r["first"] in GROUPS[row["second"]]]
        assert len(members) == 4 if row["second"] == "shader balls" else len(members) % 3 == 0
        measure = {"NRMSE, %": 0, "ΔE00": 1}[row["third"]]
        cells = {k: v for k, v in row.items() if k not in ("first", "second", "third") and v}
        assert len(cells) == 1 or column is None
        for model, cell in cells.items():
            values = [r[column or model].split(" · ")[measure] for r in members]
            assert cell == f"{min(values, key=float)}–{max(values, key=float)}", (row, model)


def test_page_quotes_the_summary() -> None:
    text = (FIGURES.parent / "split_sum.md").read_text(encoding="utf-8")
    section = text.partition("## What the table improves, and what not")[2]
    section = section.partition("```\n\n-")[2].replace("ΔE00", "ΔE").replace("F82", "F")
    summary = read_rows(FIGURES / "split_sum_summary.csv")
    cells = {cell for row in summary for cell in row.values()}
    quoted = re.findall(r"[\d.]*\d(?:–[\d.]*\d)?", section)
    ranges = [number for number in quoted if "–" in number]
    assert len(ranges) > 20
    assert set(ranges) <= cells
    light = {row["second"].removeprefix("α = "): row["exact F̄"]
             for row in summary if row["third"] == "RMS, %"}  # fmt: skip
    rest = {number for number in quoted if "–" not in number}
    assert rest == {"48", *light, *light.values()}
    assert any("48 directions" in row["first"] for row in summary)


@pytest.mark.slow
def test_quick_study(
    study: Any, scripts: Any, run_script: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if doctor.best_variant().startswith("scalar"):
        pytest.skip("minutes in scalar variants")

    def run() -> None:
        assert run_script(study.command, "--quick", "--out", tmp_path) == 0

    run()
    written = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert written == set(study.FIGURE.pictures)
    sidecar = tmp_path / "split_sum_study" / "split_sum_study.json"
    results = json.loads(sidecar.read_text(encoding="utf-8"))["results"]
    for scene in scripts._split_sum.SPHERES:
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

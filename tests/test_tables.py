"""The tables of accuracy: their numbers, their form, and what the pages quote."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from fresnel_decomp import CurveSet, Schlick, conductor, curves, load_basis

ROOT = Path(__file__).parent.parent
RECIPES_PAGE = ROOT / "docs" / "recipes.md"
DECOMPOSITION_PAGE = ROOT / "docs" / "decomposition.md"

# largest error, RMSE: published with three digits, or found by an independent implementation
KNOWN = {
    ("a", "Schlick"): ("0.550", "0.046"),
    ("a", "F82"): ("0.250", "0.018"),
    ("a", "notebook, 4 terms"): ("0.1200", "0.0025"),
    ("a", "talk, 4 terms"): ("0.0868", "0.0021"),
    ("low", "notebook, 4 terms"): ("0.054", "0.0054"),
    ("low", "talk, 4 terms"): ("0.099", "0.0095"),
    ("cp", "Schlick"): ("0.315", "0.073"),
    ("cp", "F82"): ("0.140", "0.025"),
    ("cp", "notebook, 4 terms"): ("0.1001", "0.0033"),
    ("cp", "talk, 4 terms"): ("0.0906", "0.0032"),
    ("d", "Schlick"): ("0.338", "0.066"),
    ("d", "F82"): ("0.110", "0.012"),
    ("d", "notebook, 4 terms"): ("0.0375", "0.0025"),
    ("d", "talk, 4 terms"): ("0.0281", "0.0019"),
}


@pytest.fixture
def table(scripts: Any) -> ModuleType:
    return scripts.accuracy_table


def assert_known(name: str, results: dict) -> None:
    """Compare with as many digits as `KNOWN` has."""
    known = {model: numbers for (where, model), numbers in KNOWN.items() if where == name}
    assert known
    for model, numbers in known.items():
        found = (results[model].max, results[model].rmse)
        for text, value in zip(numbers, found, strict=True):
            assert f"{value:.{len(text) - 2}f}" == text, model


@pytest.mark.parametrize("name", ["a", "low"])
def test_accuracy_of_small_sets(name: str, table):
    assert_known(name, table.measure(table.SETS[name]()))


def test_errors_are_what_they_say(table):
    curve_set = CurveSet("two", np.array([1.5, 0.2]), np.array([0.0, 3.0]))
    found = table.measure(curve_set, only=["Schlick"])["Schlick"]
    everywhere, uniform = curves.error_cosines()

    def error(cos_theta: np.ndarray) -> np.ndarray:
        eta, k = curve_set.eta[:, None], curve_set.k[:, None]
        return np.abs(Schlick.from_ior(eta, k)(cos_theta) - conductor(cos_theta, eta, k))

    assert found.max == error(everywhere).max()
    assert found.mean == pytest.approx(error(uniform).mean())
    assert found.rmse == pytest.approx(np.sqrt((error(uniform) ** 2).mean()))
    row, column = np.unravel_index(error(everywhere).argmax(), (2, len(everywhere)))
    assert (found.worst_eta, found.worst_k) == (curve_set.eta[row], curve_set.k[row])
    assert np.cos(np.radians(found.worst_degrees)) == pytest.approx(everywhere[column])


def test_errors_agree_with_the_library(table):
    curve_set = curves.low_index_corner()
    found = table.measure(curve_set, only=["talk, 5 terms"])["talk, 5 terms"]
    error = load_basis("talk", 5).error(curve_set.eta, curve_set.k)
    assert found.max == pytest.approx(error.max.max(), rel=1e-9)
    assert found.mean == pytest.approx(error.mean.mean(), rel=1e-9)
    assert found.rmse == pytest.approx(np.sqrt((error.rmse**2).mean()), rel=1e-9)


def test_accuracy_files_and_print(
    table, run_script, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    paths = [tmp_path / name for name in ("errors.json", "errors.csv")]
    out = [f"--out={path}" for path in paths]
    assert run_script(table.accuracy, "--sets", "low", *out) == 0
    printed = capsys.readouterr().out
    report = json.loads(paths[0].read_text(encoding="utf-8"))
    with paths[1].open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(report["errors"]) == 27
    for row, entry in zip(rows, report["errors"], strict=True):
        assert float(row["max"]) == entry["max"]
        assert f"{entry['max']:.4f} / {entry['rmse']:.4f}" in printed
    assert printed.count("\n\n") == 3  # four tables


def test_accuracy_refuses_other_files(
    table, run_script, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "errors.xlsx"
    assert run_script(table.accuracy, "--sets", "low", "--out", out) == 2
    assert ".json or .csv" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def table_rows(markdown: str) -> set[str]:
    """Rows of all tables, without alignment."""
    lines = [line for line in markdown.splitlines() if line.startswith("|")]
    return {re.sub(r" +", " ", line) for line in lines if not line.startswith("| -")}


def test_page_quotes_the_bases(table):
    page = table_rows(RECIPES_PAGE.read_text(encoding="utf-8"))
    assert table_rows(table.basis_table()) <= page


@pytest.mark.slow
@pytest.mark.parametrize("models", ["fits", "varied"])
def test_page_quotes_the_accuracy(models: str, table):
    results = {
        name: table.measure(make(), models=getattr(table, models))
        for name, make in table.SETS.items()
    }
    printed = table.error_table(results, table.colours() if models == "fits" else None)
    if models == "fits":
        for name, models_of_set in results.items():
            assert_known(name, models_of_set)
        printed += "\n" + table.albedo_table(results) + "\n" + table.worst_table(results)
    assert not table_rows(printed) - table_rows(RECIPES_PAGE.read_text(encoding="utf-8"))


def test_ranges(scripts, run_script, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out, command = tmp_path / "range.json", scripts.range_table.ranges
    assert run_script(command, "--sets", "a", "--sets", "tir", "--out", out) == 0
    printed = table_rows(capsys.readouterr().out)
    page = DECOMPOSITION_PAGE.read_text(encoding="utf-8")
    assert printed <= table_rows(page)
    report = json.loads(out.read_text(encoding="utf-8"))
    curve_set, basis = curves.dielectrics(), load_basis("talk")
    fit = basis.coefficients(curve_set.eta, curve_set.k)[:, None]
    F = basis.evaluate(fit, curves.error_cosines()[0])
    row = next(r for r in report["ranges"] if (r["recipe"], r["set"]) == ("talk", "a"))
    assert row["least"]["value"] == pytest.approx(F.min(), abs=1e-12)
    assert row["largest"]["value"] == pytest.approx(F.max(), abs=1e-12)
    assert row["leaving"] == np.mean(((F < -1e-9) | (F > 1.0 + 1e-9)).any(axis=1))
    uniform = np.linspace(0.0, 1.0, 2049)
    dense = basis.evaluate(fit, uniform)
    change = 2.0 * np.trapezoid((np.clip(dense, 0.0, 1.0) - dense) * uniform, uniform, axis=1)
    assert row["bias"] == pytest.approx([change.min(), change.max()], abs=1e-6)
    # gold under D65, whose red is above 1
    assert [(c["material"], c["channel"]) for c in report["colours"] if c["above"] > 0] == [
        ("Au", "R")
    ]


@pytest.mark.slow
def test_page_quotes_all_ranges(scripts, run_script, capsys: pytest.CaptureFixture[str]):
    assert run_script(scripts.range_table.ranges) == 0
    page = table_rows(DECOMPOSITION_PAGE.read_text(encoding="utf-8"))
    assert table_rows(capsys.readouterr().out) <= page

"""The stability report: its exact answers, the formulas it transcribes, its output."""

from __future__ import annotations

import csv
import importlib
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from backends import float_type
from oracles import textbook
from tolerances import NATIVE_ULP, WIDE_ULP

SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"


@pytest.fixture(scope="module")
def scripts():
    sys.path.insert(0, str(SCRIPTS))
    names = ("stability", "_hard_cases", "_peer_formulas")
    yield SimpleNamespace(**{name.lstrip("_"): importlib.import_module(name) for name in names})
    sys.path.remove(str(SCRIPTS))


@pytest.fixture
def run(scripts):
    """Run the script with arguments and return its exit code."""
    import mitsuba as mi

    before = mi.variant()

    def call(*arguments):
        with pytest.raises(SystemExit) as end:
            scripts.stability.main(scripts.stability.stability, [str(a) for a in arguments])
        return end.value.code

    yield call
    if before:
        mi.set_variant(before)


def test_exact_answers_are_those_of_the_table(scripts, reference):
    hard = scripts.hard_cases
    table = hard.read(reference / "hard_cases.csv")
    assert len(table) == 1182
    assert set(table.region) == set(hard.REGIONS)
    for i in range(0, len(table), 5):
        answer = hard.exact(*table.inputs[:, i])
        for name in (*hard.VALUES, *hard.GRADIENTS):
            high, low = hard.two_doubles(answer[name])
            # the table has 24 digits
            difference = (high - table.exact[name][0, i]) + (low - table.exact[name][1, i])
            if np.isnan(high):
                assert np.isnan(table.exact[name][0, i])
            else:
                assert abs(difference) <= 1e-22 * abs(high), (name, table.inputs[:, i])


def test_generated_points_are_what_their_region_says(scripts):
    hard = scripts.hard_cases
    for region in hard.REGIONS:
        for single in (True, False):
            points = hard.generate(region, single, 40)
            cos_theta, eta, k = points.inputs
            assert ((cos_theta >= 0.0) & (cos_theta <= 1.0) & (eta > 0.0) & (k >= 0.0)).all()
            if single:
                np.testing.assert_array_equal(points.inputs, points.inputs.astype(np.float32))
            assert (k > 0.0).all() == (
                region.endswith("_absorbing")
                or region in ("metal", "weak_absorption", "strong_conductor")
            )
            again = hard.generate(region, single, 40)
            np.testing.assert_array_equal(again.inputs, points.inputs)
            if region == "TIR":
                assert (points.exact["R"][0] == 1.0).mean() > 0.9
            if region == "critical":
                exact = points.exact["R"][0]
                assert (exact == 1.0).any()
                assert (exact < 1.0).any()


def test_transcribed_formulas_are_right_where_it_is_easy(scripts):
    Float = float_type("llvm", "float64")
    import mitsuba as mi

    before = mi.variant()
    mi.set_variant("llvm_ad_rgb")
    rng = np.random.default_rng(3)
    cos_theta, eta, k = rng.uniform(0.1, 0.95, 50), rng.uniform(1.2, 3.0, 50), rng.uniform(1, 4, 50)
    for formula in scripts.peer_formulas.FORMULAS:
        absorption = k if formula.absorbing else 0.0 * k
        R_s, R_p = textbook(cos_theta, eta, absorption)
        if formula.numpy:
            arguments, tolerance = (cos_theta, eta, absorption), 1e-12
        else:
            kind = mi.Float if formula.single else Float
            arguments = [kind(value) for value in (cos_theta, eta, absorption)]
            tolerance = 2e-5 if formula.single else 1e-12
        outputs = formula.run(*arguments)
        for name, expected in {"R": 0.5 * (R_s + R_p), "R_s": R_s, "R_p": R_p}.items():
            if name in outputs:
                np.testing.assert_allclose(
                    np.array(outputs[name], float), expected, rtol=tolerance, atol=1e-8
                )
    if before:
        mi.set_variant(before)


def test_one_region(scripts, run, tmp_path, capsys):
    float_type("llvm")  # skips without
    files = [tmp_path / name for name in ("s.json", "s.csv", "s.png", "page.md")]
    files[3].write_text("# Page\n<!-- tables -->\nold\n<!-- end of tables -->\nEnd.\n")
    arguments = ["--region", "critical", "--region", "matched", "--points", "40"]
    arguments += ["--out", files[0], "--out", files[1], "--picture", files[2], "--page", files[3]]
    assert run(*arguments) == 0
    printed = capsys.readouterr().out
    assert "worst ulp of R" in printed
    report = json.loads(files[0].read_text(encoding="utf-8"))
    names = [formula.name for formula in scripts.peer_formulas.FORMULAS]
    assert list(report["about"]["formulas"]) == names
    rows = {(row["formula"], row["region"]): row for row in report["results"]}
    assert {region for _, region in rows} == {"all", "critical", "matched"}
    for name in names:
        row = rows[name, "critical"]
        if name.startswith("ours"):
            limit = WIDE_ULP if "wide" in name else NATIVE_ULP
            assert row["worst_ulp"] <= limit
            assert row["gradients_off"] == row["not_finite"] == row["outside"] == 0
        else:
            assert row["worst_ulp"] > 1e4
            assert row["gradient_share"] > 0.1
        assert (row["gradients"] == 0) == (name == "ours, wide, NumPy")
    with files[1].open(encoding="utf-8", newline="") as file:
        assert len(list(csv.DictReader(file))) == len(report["results"])
    assert files[2].read_bytes().startswith(b"\x89PNG")
    assert files[2].stat().st_size < 500_000
    page = files[3].read_text(encoding="utf-8")
    assert page.startswith("# Page\n<!-- tables -->\n\n| formula")
    assert page.endswith("<!-- end of tables -->\nEnd.\n")
    assert "old" not in page


def test_hard_cases_join(scripts, run, reference, tmp_path):
    """Rows of a table are measured with the points that the script makes, and the page says so."""
    page = tmp_path / "page.md"
    page.write_text("<!-- tables -->\n<!-- end of tables -->\n")
    table = reference / "hard_cases.csv"
    rows = len(scripts.hard_cases.read(table, ["matched"]))
    assert rows > 20
    counts = []
    for given in ((), ("--hard-cases", table)):
        arguments = ["--variant", "scalar_rgb", "--region", "matched", "--points", 8]
        assert run(*arguments, *given, "--out", tmp_path / "s.json", "--page", page) == 0
        text = (tmp_path / "s.json").read_text(encoding="utf-8")
        results = {(r["formula"], r["region"]): r for r in json.loads(text)["results"]}
        assert results["ours, float64", "matched"]["worst_ulp"] <= NATIVE_ULP
        counts.append(results["notebook, float64", "all"]["points"])
        assert "Of 8 points made by this script" in page.read_text(encoding="utf-8")
    assert counts == [8, 8 + rows]
    assert f"and {rows} rows of a table" in page.read_text(encoding="utf-8")


def test_without_llvm_values_remain(run, tmp_path):
    out = tmp_path / "s.json"
    assert (
        run("--variant", "scalar_rgb", "--region", "dielectric", "--points", 8, "--out", out) == 0
    )
    rows = json.loads(out.read_text(encoding="utf-8"))["results"]
    assert {row["gradients"] for row in rows} == {0}
    assert all(row["worst_absolute"] < 1e-5 for row in rows)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "s.txt"], "files that end in .json or .csv"),
        (["--hard-cases", "nowhere.csv"], "there is no file"),
        (["--region", "moon"], "moon"),
        (["--variant", "llvm_ad_moon"], "llvm_ad_moon"),
        (["--points", "0"], "0"),
    ],
)
def test_bad_input(run, capsys, arguments, message):
    assert run(*arguments) == 2
    assert message in capsys.readouterr().err


def test_bad_files(run, tmp_path, capsys):
    table = tmp_path / "t.csv"
    table.write_text("region,precision\nTIR,f32\n")
    assert run("--region", "TIR", "--points", 4, "--hard-cases", table) == 2
    assert "cos_theta_hex" in capsys.readouterr().err
    page = tmp_path / "page.md"
    page.write_text("# No place\n")
    assert run("--region", "TIR", "--points", 4, "--page", page) == 2
    assert "end of tables" in capsys.readouterr().err
    assert page.read_text() == "# No place\n"

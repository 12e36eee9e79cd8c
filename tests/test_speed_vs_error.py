"""The benchmark of all models: its checks, its records, its front, its files and its pages."""

from __future__ import annotations

import importlib
import json
import re
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from fresnel_decomp import InputError, doctor
from fresnel_decomp.report import bench as bench_module
from fresnel_decomp.report import bench_tables as tables
from fresnel_decomp.report.bench import KINDS, Settings
from fresnel_decomp.report.pareto import pareto_front

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "speed_vs_error.md"
NUMBERS = ROOT / "docs" / "figures" / "speed_vs_error.csv"
FEW = ("Schlick", "talk, 4 terms", "talk, 4 terms, 32 float16")


@pytest.fixture(scope="module")
def llvm():
    """An active llvm_ad_rgb; the variant as before afterwards."""
    status = doctor.usable_variants()["llvm_ad_rgb"]
    if not status.usable:
        pytest.skip(f"{status.reason}. {status.remedy}")
    import mitsuba as mi

    before = mi.variant()
    mi.set_variant("llvm_ad_rgb")
    from fresnel_decomp.mitsuba import register

    register()
    yield
    if before:
        mi.set_variant(before)


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    return importlib.import_module("speed_vs_error")


def quick(**changes: Any) -> Settings:
    return Settings.quick(variant="llvm_ad_rgb", **({"models": FEW} | changes))


@pytest.fixture(scope="module")
def measured(llvm, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bench_module.Bench]:
    folder = tmp_path_factory.mktemp("bench")
    return folder, bench_module.run(quick(), folder)


def brute_force_front(costs: list[float], errors: list[float]) -> set[int]:
    points = list(zip(costs, errors, strict=True))
    return {
        i
        for i, (c, e) in enumerate(points)
        if not any(
            (d <= c and f <= e and (d < c or f < e)) or (j < i and (d, f) == (c, e))
            for j, (d, f) in enumerate(points)
        )
    }


def test_front_is_what_nothing_beats():
    rng = np.random.default_rng(3)
    for count in (0, 1, 2, 7, 40):
        costs, errors = rng.integers(1, 12, (2, count)).astype(float).tolist()
        front = pareto_front(costs, errors)
        assert set(front) == brute_force_front(costs, errors)
        assert [costs[i] for i in front] == sorted(costs[i] for i in front)


def test_front_does_not_tell_apart_what_noise_may_have_made():
    assert pareto_front([1.0, 1.04, 1.08, 2.0], [0.4, 0.3, 0.2, 0.1], slack=0.05) == [1, 2, 3]
    # not even in small steps from the cheapest to the dearest
    many = [1.0 + 0.01 * i for i in range(51)]
    front = pareto_front(many, [1.0 - 0.01 * i for i in range(51)], slack=0.1)
    assert 4 <= len(front) <= 6
    assert front[-1] == 50


def test_front_leaves_out_what_is_not_known():
    assert pareto_front([1.0, 2.0, float("nan")], [0.5, float("nan"), 0.1]) == [0]
    with pytest.raises(InputError, match="one of each"):
        pareto_front([1.0], [])


def made_up_row(model: str, form: str, errors: float, built_in_ns: float) -> dict[str, Any]:
    row: dict[str, Any] = {"model": model, "form": form, **dict.fromkeys(tables.ERRORS, errors)}
    return row | {f"{kind}_built_in_ns": built_in_ns for kind in tables.KINDS}


def test_a_machine_that_was_not_quiet_is_said():
    quiet = [made_up_row("a", "closed form", 0.1, ns) for ns in (2.0, 2.9)]
    assert tables.caution(quiet) == ""
    busy = [*quiet, made_up_row("b", "closed form", 0.1, 8.0)]
    assert set(tables.drift(busy).values()) == {4.0}
    assert "up to 4.0 times" in tables.caution(busy)


def test_accuracy_is_counted_error_by_error():
    built_in = made_up_row(tables.BUILT_IN, "formula", 0.2, 1.0) | {"d_max": 1e-6}
    forms = [made_up_row(str(e), "closed form", e, 1.0) for e in (0.1, 0.15, 0.3)]
    rows = {row["model"]: row for row in (built_in, *forms)}
    said = tables._accuracy(forms, rows)
    assert "largest error: 0 of 3" in said
    assert "mean ΔE00: 2 of 3" in said


def test_rows_are_complete(measured):
    _, result = measured
    assert [row["model"] for row in result.rows] == ["mi.fresnel_conductor", *FEW]
    built_in, schlick, closed, table = result.rows
    for kind in KINDS:
        assert (built_in[f"{kind}_ratio"], built_in[f"{kind}_spread"]) == (1.0, 0.0)
        assert schlick[f"{kind}_ratio"] > 0.0
        assert schlick[f"{kind}_ns"] > 0.0
    assert table["bsdf_ratio"] is None
    assert table["render_ratio"] is None
    assert built_in["d_max"] < 1e-5 < closed["d_max"] < schlick["d_max"]
    assert closed["delta_e_mean"] < 0.2 * schlick["delta_e_mean"]
    # Schlick: 1 - c, three products for its fifth power; 1 - F0 and a multiply-add a channel
    assert schlick["operations"] == 10
    assert (schlick["shared_bytes"], schlick["material_bytes"]) == (0, 12)
    assert (table["shared_bytes"], table["gathers"]) == (32 * 3 * 2, 6)
    assert table["d_max"] == pytest.approx(closed["d_max"], abs=5e-3)
    assert result.about["backend"] == "llvm"
    assert {"machine", "llvm", "mitsuba", "rounds", "seed"} <= result.about.keys()


def test_errors_are_those_of_the_library(measured):
    from fresnel_decomp import load_basis
    from fresnel_decomp.accuracy import SETS

    _, result = measured
    row = result.rows[2]
    for name, make in SETS.items():
        members = make().take(slice(None, None, quick().thin))
        error = load_basis("talk").error(members.eta, members.k)
        # the closed form is within 5e-5 of the functions, which coefficients below 1 multiply
        assert row[f"{name}_max"] == pytest.approx(error.max.max(), abs=1e-4)
        assert row[f"{name}_p99"] == pytest.approx(np.percentile(error.max, 99), abs=1e-4)
        assert row[f"{name}_rmse"] == pytest.approx(np.sqrt((error.rmse**2).mean()), abs=5e-5)
        assert row[f"{name}_mean"] == pytest.approx(error.mean.mean(), abs=5e-5)


def test_a_run_goes_on_where_it_stopped(measured, tmp_path: Path, monkeypatch):
    folder, result = measured
    done = {path.name: path.stat().st_mtime_ns for path in (folder / "models").iterdir()}
    assert len(done) == 4
    again = bench_module.run(quick(), folder)
    assert again.rows == result.rows
    assert done == {path.name: path.stat().st_mtime_ns for path in (folder / "models").iterdir()}
    # interrupted between errors and times: errors stay, times are measured
    from fresnel_decomp.mitsuba import candidates, timing

    settings, checked = quick(models=("exact, wide", "Lazanyi")), []
    check = candidates.check

    def interrupted(*args: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(candidates, "check", lambda c: checked.append(c.name) or check(c))
    with monkeypatch.context() as patch:
        patch.setattr(timing, "interleaved_times", interrupted)
        with pytest.raises(KeyboardInterrupt):
            bench_module.run(settings, tmp_path)
    assert checked == ["mi.fresnel_conductor", "exact, wide", "Lazanyi"]
    records = [json.loads(p.read_text(encoding="utf-8")) for p in (tmp_path / "models").iterdir()]
    assert [record["finished"] for record in records] == [["errors"]] * 3
    rows = bench_module.run(settings, tmp_path).rows
    assert len(checked) == 3
    for row in rows:
        assert row["compute_ratio"] > 0.0
        (kept,) = (r["row"]["d_max"] for r in records if r["row"]["model"] == row["model"])
        assert row["d_max"] == kept


def test_records_of_other_settings_are_not_used(measured, monkeypatch):
    """Another seed, say: nothing of the folder is taken, and what is refused leaves it alone."""
    from fresnel_decomp.mitsuba import candidates

    folder, _ = measured
    before = {path: path.read_text(encoding="utf-8") for path in (folder / "models").iterdir()}

    def stop(candidate: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(candidates, "check", stop)
    with pytest.raises(KeyboardInterrupt):
        bench_module.run(quick(seed=1), folder)
    with pytest.raises(KeyboardInterrupt):
        bench_module.run(quick(), folder, force=True)
    bench_module.run(quick(), folder)  # checks nothing anew
    assert before == {path: path.read_text(encoding="utf-8") for path in before}


def wrong_schlick(candidate: Any) -> Any:
    return replace(candidate, evaluate=lambda c, f0: f0 + (1.0 - f0) * (1.0 - c) ** 4)


def test_a_wrong_model_is_refused_before_anything_is_timed(llvm, tmp_path: Path, monkeypatch):
    from fresnel_decomp.mitsuba import candidates, timing

    everything = candidates.candidates

    def with_a_wrong_one(*args: Any) -> list[Any]:
        return [wrong_schlick(c) if c.name == "Schlick" else c for c in everything(*args)]

    def no_time(*args: Any) -> None:
        raise AssertionError("timed")

    monkeypatch.setattr(candidates, "candidates", with_a_wrong_one)
    monkeypatch.setattr(timing, "interleaved_times", no_time)
    with pytest.raises(
        candidates.WrongAnswerError, match=r"Schlick is off by 0\.\d+ .*nothing was"
    ):
        bench_module.run(quick(models=("Schlick",)), tmp_path)
    assert not (tmp_path / "models" / "Schlick.json").exists()


@pytest.mark.parametrize(
    "name",
    [
        "exact, native",
        "Lazanyi",
        "F82",
        "Gulbrandsen",
        "minimax, 3 terms",
        "talk, 6 terms, 32 float16",
    ],
)
def test_small_mistakes_are_found(name: str, llvm):
    """Off by 2e-4 for grazing angles, or with two stored numbers exchanged."""
    from fresnel_decomp.mitsuba.candidates import WrongAnswerError, candidates, check

    (candidate,) = (c for c in candidates((32,)) if c.name == name)
    assert check(candidate) < 2e-4
    shifted = replace(
        candidate,
        evaluate=lambda c, *stored: candidate.evaluate(c, *stored) + 2e-4 * (1.0 - c),
    )
    exchanged = replace(candidate, store=lambda eta, k: candidate.store(eta, k)[::-1])
    for mistaken in (shifted, exchanged):
        with pytest.raises(WrongAnswerError):
            check(mistaken)


def test_wrong_bsdfs_and_pictures_are_found(llvm):
    import mitsuba as mi

    from fresnel_decomp.mitsuba import candidates as module
    from fresnel_decomp.mitsuba.workloads import directions, picture

    look = {"distribution": "ggx", "alpha": 0.2}
    known = {c.name: c for c in module.candidates(())}
    schlick, talk = known["Schlick"], known["talk, 4 terms"]
    mirror = mi.load_dict({"type": "roughconductor", "material": "none", **look})
    pairs = directions(2000)
    bsdf = mi.load_dict({**schlick.bsdf, **look})
    assert module.check_bsdf(schlick, bsdf, mirror, *pairs) < 1e-5
    with pytest.raises(module.WrongAnswerError, match="the BSDF with talk"):
        module.check_bsdf(talk, bsdf, mirror, *pairs)
    exact, drawn = (
        np.array(picture({**known[name].bsdf, **look}, 16, 1)(), np.float64)
        for name in (module.BASE, "Schlick")
    )
    assert module.check_picture(schlick, drawn, exact) < 0.5
    with pytest.raises(module.WrongAnswerError, match="the picture with talk"):
        module.check_picture(talk, drawn, exact)


def test_files_and_figures(measured, tmp_path: Path):
    from fresnel_decomp.report.bench_figures import figure_paths, write_figures

    _, result = measured
    csv_path, json_path, page = tables.write(result, tmp_path)
    rows = tables.read_csv(csv_path)
    for row, original in zip(rows, result.rows, strict=True):
        assert row.keys() == original.keys()
        for key, value in original.items():
            expected = pytest.approx(value, rel=1e-5) if isinstance(value, float) else value
            assert row[key] == expected
    about = json.loads(json_path.read_text(encoding="utf-8"))["about"]
    assert about["mitsuba"]
    text = page.read_text(encoding="utf-8")
    assert "CPU (LLVM)" in text
    assert "Not in the plugin" in text
    drawn = write_figures(rows, tmp_path, tables.about_line(about))
    assert set(drawn) == set(figure_paths(tmp_path).values())
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in drawn)


def test_command(llvm, tmp_path: Path):
    from fresnel_decomp.cli import cli

    arguments = ["bench", "--quick", "--models", "Lazanyi", "--variant", "llvm_ad_rgb"]
    found = CliRunner().invoke(cli, [*arguments, "--out", str(tmp_path)], catch_exceptions=False)
    assert found.exit_code == 0
    assert "| Lazanyi" in found.output
    for suffix in ("csv", "json", "md", "png"):
        assert (tmp_path / f"speed_vs_error.{suffix}").is_file()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rounds": 2}, "rounds=2; accepted: a whole number from 3"),
        ({"variant": "scalar_rgb"}, "Scalar variants have no kernels"),
        ({"variant": "llvm_ad_spectral"}, "one with RGB"),
        ({"models": ("Shlick",)}, "no model is called 'Shlick'"),
    ],
    ids=["rounds", "scalar", "spectral", "model"],
)
def test_refused(changes: dict[str, Any], message: str, llvm, tmp_path: Path):
    settings = replace(quick(), **changes)
    with pytest.raises(InputError, match=re.escape(message)):
        bench_module.run(settings, tmp_path)


def test_pages_say_what_the_file_of_numbers_says(script):
    """README and documentation are made of the numbers beside the figures, and of nothing else."""
    rows = tables.read_csv(NUMBERS)
    about = json.loads(NUMBERS.with_suffix(".json").read_text(encoding="utf-8"))
    pages = ((PAGE, script.page_texts), (ROOT / "README.md", script.readme_texts))
    for path, texts in pages:
        page = path.read_text(encoding="utf-8")
        for name, text in texts(about, rows).items():
            start, end = script.marks(name)
            assert page.partition(start)[2].partition(end)[0].strip() == text.strip(), name


def test_the_file_of_numbers_has_every_model(llvm):
    from fresnel_decomp.mitsuba.candidates import candidates

    rows = tables.read_csv(NUMBERS)
    assert [row["model"] for row in rows] == [c.name for c in candidates()]
    for row, candidate in zip(rows, candidates(), strict=True):
        assert (row["shared_bytes"], row["in_plugin"]) == (
            candidate.shared_bytes,
            candidate.bsdf is not None,
        )
        assert all((row[f"{k}_ratio"] is None) == (k in ("bsdf", "render") and not row["in_plugin"])
                   for k in KINDS)  # fmt: skip


def test_script_refuses_pages_without_marks(script, tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text("# Page\n", encoding="utf-8")
    found = CliRunner().invoke(script.main, ["--quick", "--page", str(page)])
    assert isinstance(found.exception, InputError)
    assert "without the line '<!-- verdicts -->'" in str(found.exception)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["F82", "balanced, 4 terms", "robust, 5 terms, 128 float16"])
def test_errors_in_the_file_are_those_of_these_kernels(name: str, llvm, tmp_path: Path):
    """On all curves and materials; times are those of another run."""
    (row,) = (row for row in tables.read_csv(NUMBERS) if row["model"] == name)
    settings = replace(quick(models=(name,)), thin=1, table_sizes=Settings.table_sizes)
    found = bench_module.run(settings, tmp_path).rows[-1]
    for key, value in found.items():
        if key.startswith(("a_", "cp_", "d_", "low_", "delta_e_", "operations", "gathers")):
            assert row[key] == pytest.approx(value, rel=1e-3, abs=2e-7), key

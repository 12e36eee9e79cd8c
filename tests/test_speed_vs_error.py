"""The benchmark of all models: its checks, its records, its front, its files and its pages."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from conftest import using_llvm
from fresnel_decomp import InputError
from fresnel_decomp.bench import run as bench_module
from fresnel_decomp.bench import tables
from fresnel_decomp.bench.pareto import pareto_front
from fresnel_decomp.bench.run import KINDS, Settings

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "speed_vs_error.md"
NUMBERS = ROOT / "docs" / "figures" / "speed_vs_error.csv"
FEW = ("Schlick", "talk, 4 terms", "talk, 4 terms, 32 float16")


@pytest.fixture(scope="module")
def llvm():
    """An active llvm_ad_rgb with the plugin, for all tests."""
    with using_llvm():
        from fresnel_decomp.mitsuba import register

        register()
        yield


@pytest.fixture
def script(scripts: Any) -> ModuleType:
    return scripts.speed_vs_error


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


def test_front_leaves_out_what_is_not_known():
    assert pareto_front([1.0, 2.0, float("nan")], [0.5, float("nan"), 0.1]) == [0]
    with pytest.raises(InputError, match="one of each"):
        pareto_front([1.0], [])


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
    assert schlick["arithmetic"] == schlick["operations"] == 10
    assert (schlick["shared_bytes"], schlick["material_bytes"]) == (0, 12)
    assert (table["shared_bytes"], table["gathers"]) == (32 * 3 * 2, 6)
    assert table["operations"] >= table["arithmetic"] + table["gathers"]
    assert closed["worst_max"] == max(closed[f"{name}_max"] for name in ("a", "cp", "d", "low"))
    for kind in KINDS:
        if (ratios := closed[f"{kind}_ratios"]) is not None:
            assert len(ratios) == quick().rounds
            assert np.median(ratios) == closed[f"{kind}_ratio"]
    assert table["d_max"] == pytest.approx(closed["d_max"], abs=5e-3)
    assert result.about["backend"] == "llvm"
    assert {"machine", "llvm", "mitsuba", "rounds", "seed", "source"} <= result.about.keys()


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


def records(folder: Path) -> dict[Path, str]:
    """All records of all runs, as they are."""
    return {path: path.read_text(encoding="utf-8") for path in folder.glob("models-*/*.json")}


def interrupted(*args: Any) -> None:
    raise KeyboardInterrupt


def test_a_run_goes_on_where_it_stopped(measured, tmp_path: Path, monkeypatch):
    """Errors and times that are there are kept; answers are checked every time."""
    folder, result = measured
    done = records(folder)
    assert len(done) == 4
    from fresnel_decomp.bench import candidates
    from fresnel_decomp.mitsuba import timing

    settings, checked = quick(models=("exact, wide", "Lazanyi")), []
    check = candidates.check
    monkeypatch.setattr(candidates, "check", lambda c: checked.append(c.name) or check(c))
    again = bench_module.run(quick(), folder)
    assert again.rows == result.rows
    assert done == records(folder)
    assert checked == ["mi.fresnel_conductor", *FEW]
    # interrupted between errors and times: errors stay, times are measured
    with monkeypatch.context() as patch:
        patch.setattr(timing, "interleaved_times", interrupted)
        with pytest.raises(KeyboardInterrupt):
            bench_module.run(settings, tmp_path)
    kept = [json.loads(text) for text in records(tmp_path).values()]
    assert [record["finished"] for record in kept] == [["errors"]] * 3
    rows = bench_module.run(settings, tmp_path).rows
    assert checked[4:] == 2 * ["mi.fresnel_conductor", "exact, wide", "Lazanyi"]
    for row in rows:
        assert row["compute_ratio"] > 0.0
        (before,) = (r["row"]["d_max"] for r in kept if r["row"]["model"] == row["model"])
        assert row["d_max"] == before


def test_records_of_other_settings_are_not_used(measured, monkeypatch):
    """Another seed, or another version of the code: both have records of their own."""
    from fresnel_decomp.bench import machine
    from fresnel_decomp.mitsuba import timing

    folder, _ = measured
    before = records(folder)
    monkeypatch.setattr(timing, "interleaved_times", interrupted)
    bench_module.run(quick(), folder)  # times nothing anew
    with pytest.raises(KeyboardInterrupt):
        bench_module.run(quick(seed=1), folder)
    with monkeypatch.context() as patch:
        patch.setattr(machine, "source_hash", lambda: "another")
        with pytest.raises(KeyboardInterrupt):
            bench_module.run(quick(), folder)
    after = records(folder)
    assert after.items() > before.items()
    assert len({path.parent for path in after}) == 3


def wrong_schlick(candidate: Any) -> Any:
    return replace(candidate, evaluate=lambda c, f0: f0 + (1.0 - f0) * (1.0 - c) ** 4)


@pytest.mark.parametrize("finished", [False, True], ids=["new", "resumed"])
def test_a_wrong_model_is_refused_before_anything_is_timed(
    finished: bool, measured, llvm, tmp_path: Path, monkeypatch
):
    """Also one of a later group, and one whose record is there already."""
    from fresnel_decomp.bench import candidates
    from fresnel_decomp.mitsuba import timing

    everything = candidates.candidates

    def with_a_wrong_one(*args: Any) -> list[Any]:
        return [wrong_schlick(c) if c.name == "Schlick" else c for c in everything(*args)]

    def no_time(*args: Any) -> None:
        raise AssertionError("timed")

    monkeypatch.setattr(bench_module, "_GROUP", 1)
    monkeypatch.setattr(candidates, "candidates", with_a_wrong_one)
    monkeypatch.setattr(timing, "interleaved_times", no_time)
    folder = measured[0] if finished else tmp_path
    before = records(folder)
    with pytest.raises(
        candidates.WrongAnswerError, match=r"Schlick is off by 0\.\d+ .*nothing was"
    ):
        bench_module.run(quick(), folder)
    assert records(folder) == before


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
    from fresnel_decomp.bench.candidates import WrongAnswerError, candidates, check

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

    from fresnel_decomp.bench import candidates as module
    from fresnel_decomp.mitsuba.workloads import directions

    look = {"distribution": "ggx", "alpha": 0.2}
    known = {c.name: c for c in module.candidates(())}
    schlick, talk = known["Schlick"], known["talk, 4 terms"]
    mirror = mi.load_dict({"type": "roughconductor", "material": "none", **look})
    pairs = directions(2000)
    bsdf = mi.load_dict({**schlick.bsdf, **look})
    assert module.check_bsdf(schlick, bsdf, mirror, *pairs) < 1e-5
    with pytest.raises(module.WrongAnswerError, match="the BSDF with talk"):
        module.check_bsdf(talk, bsdf, mirror, *pairs)


def test_pictures_cannot_be_exchanged(llvm):
    """The scene of one model is not accepted as that of any other that differs from it."""
    import mitsuba as mi

    from fresnel_decomp.bench import candidates as module
    from fresnel_decomp.mitsuba.workloads import BERYLLIUM, picture

    look = {"distribution": "ggx", "alpha": 0.2}
    mirror = mi.load_dict({"type": "roughconductor", "material": "none", **look})
    chosen = [c for c in module.candidates(()) if c.bsdf is not None]
    pictures = {c.name: picture({**c.bsdf, **look}, 32, 1) for c in chosen}
    index = [np.array(values) for values in BERYLLIUM.values()]
    angles = np.linspace(0.1, 1.0, 91)  # those that the camera meets
    curves = {c.name: c.answer(angles, *index)[0] for c in chosen}
    refused = exchanged = 0
    for candidate in chosen:
        assert module.check_picture(candidate, pictures[candidate.name], mirror) < 1e-4
        for name, other in pictures.items():
            if np.abs(curves[name] - curves[candidate.name]).max() > 1e-3:
                exchanged += 1
                try:
                    module.check_picture(candidate, other, mirror)
                except module.WrongAnswerError:
                    refused += 1
    assert refused == exchanged > 300


def test_files_and_figures(measured, tmp_path: Path):
    from fresnel_decomp.bench.figures import figure_paths, write_figures

    _, result = measured
    csv_path, json_path, page = tables.write(result, tmp_path)
    rows = tables.read_csv(csv_path)
    for row, original in zip(rows, result.rows, strict=True):
        assert row.keys() == original.keys()
        for key, value in original.items():
            several = isinstance(value, list)
            near = 1e-3 if several else 1e-5  # rounds are kept with four digits
            expected = (
                pytest.approx(value, rel=near) if several or isinstance(value, float) else value
            )
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
        ({"variant": "foo"}, "variant"),
        ({"models": ("Shlick",)}, "no model is called 'Shlick'"),
    ],
    ids=["rounds", "scalar", "spectral", "unknown", "model"],
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
    from fresnel_decomp.bench.candidates import candidates

    rows, known = tables.read_csv(NUMBERS), candidates(Settings.table_sizes)
    assert [row["model"] for row in rows] == [c.name for c in known]
    for row, candidate in zip(rows, known, strict=True):
        assert (row["shared_bytes"], row["in_plugin"]) == (
            candidate.shared_bytes,
            candidate.bsdf is not None,
        )
        assert all((row[f"{k}_ratio"] is None) == (k in ("bsdf", "render") and not row["in_plugin"])
                   for k in KINDS)  # fmt: skip


def test_script_refuses_pages_without_marks(script, tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text("# Page\n", encoding="utf-8")
    found = CliRunner().invoke(script.speed_vs_error, ["--page", str(page)])
    assert isinstance(found.exception, InputError)
    assert "lines '<!-- verdicts -->' and" in str(found.exception)


@pytest.mark.parametrize(
    "given", [["--quick"], ["--models", "F82"], ["--rounds", "5"]], ids=lambda given: given[0]
)
def test_script_publishes_whole_measurements_only(given: list[str], script):
    found = CliRunner().invoke(script.speed_vs_error, [*given, "--readme", str(ROOT / "README.md")])
    assert isinstance(found.exception, InputError)
    assert f"{' '.join(given)} together with --page" in str(found.exception)


def test_script_publishes_what_a_quiet_machine_measured(script, tmp_path: Path):
    """From numbers of a file, to the end; refused where the built-in's own time varies."""
    page, source = tmp_path / "page.md", tmp_path / "speed_vs_error.csv"
    parts = script.README_PARTS
    page.write_text("".join("".join(script.marks(name)) for name in parts), encoding="utf-8")
    rows = [row for row in tables.read_csv(NUMBERS) if row["form"] != "table"]
    for row in rows:
        row |= {f"{kind}_built_in_ns": 1.0 for kind in KINDS if row[f"{kind}_ratio"] is not None}
    source.write_text(tables.to_csv(rows), encoding="utf-8")
    about = NUMBERS.with_suffix(".json").read_text(encoding="utf-8")
    source.with_suffix(".json").write_text(about, encoding="utf-8")
    arguments = ["--readme", str(page), "--from", str(source), "--figures", str(tmp_path)]
    found = CliRunner().invoke(script.speed_vs_error, arguments, catch_exceptions=False)
    assert found.exit_code == 0
    written = page.read_text(encoding="utf-8")
    assert "| Schlick" in written
    assert "not quiet" not in written
    assert (tmp_path / "speed_vs_error_bytes.png").is_file()
    rows[-1]["bsdf_built_in_ns"] = 2.0
    source.write_text(tables.to_csv(rows), encoding="utf-8")
    found = CliRunner().invoke(script.speed_vs_error, arguments)
    assert isinstance(found.exception, InputError)
    assert "varies by up to 2.0" in str(found.exception)
    assert page.read_text(encoding="utf-8") == written
    assert CliRunner().invoke(script.speed_vs_error, [*arguments, "--noisy"]).exit_code == 0
    assert "not quiet" in page.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["F82", "balanced, 4 terms", "robust, 5 terms, 128 float16"])
def test_errors_in_the_file_are_those_of_these_kernels(name: str, llvm, tmp_path: Path):
    """On all curves and materials; times are those of another run."""
    (row,) = (row for row in tables.read_csv(NUMBERS) if row["model"] == name)
    settings = replace(quick(models=(name,)), thin=1, table_sizes=Settings.table_sizes)
    found = bench_module.run(settings, tmp_path).rows[-1]
    for key, value in found.items():
        if key.startswith(
            ("a_", "cp_", "d_", "low_", "delta_e_", "operations", "arithmetic", "gathers")
        ):
            assert row[key] == pytest.approx(value, rel=1e-3, abs=2e-7), key

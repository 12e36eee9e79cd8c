"""The full-screen pass: its answers, its labels, and that wrong answers are not timed."""

from __future__ import annotations

import dataclasses
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import SCRIPTS

PAGE = SCRIPTS.parent / "docs" / "speed_gpu.md"


@pytest.fixture
def bench(scripts: Any) -> Any:
    return scripts.bench_gpu


@pytest.fixture
def said(scripts: Any) -> Any:
    return scripts._screen_report


def made_up(bench: Any, variant: str, device: str = "a device") -> dict[str, Any]:
    """Results as the script keeps them: pass i takes 1 + i/10 ms, and twice that in every third
    round."""
    names = (*bench.PASSES, *bench.PARTS)
    times = {n: [(1.0 + 0.1 * i) * (1 + (r % 3 == 0)) for r in range(9)]
             for i, n in enumerate(names)}  # fmt: skip
    errors = {n: {"shader": 1e-6, "shader_as_timed": 1e-3, "nrmse": 0.01, "delta_e": 0.5}
              for n in bench.PASSES}  # fmt: skip
    return {
        "settings": {"variant": variant, "width": 1280, "height": 720},
        "about": {
            "device": device,
            "versions": {"mitsuba": "3", "drjit": "1"},
            "repeat": 1,
            "sources": "a hash",
        },
        "dates": ["2026-11-24"] * 4 + ["2026-11-25"] * 5,
        "errors": errors,
        "times": times,
    }


def test_every_pixel_shows_a_surface(bench: Any) -> None:
    """The camera looks down at unit normals; all roughnesses occur; texture units may filter."""
    screen = sys.modules["_screen_pass"].make_screen(64, 36)
    assert np.linalg.norm(screen.normal, axis=1) == pytest.approx(1.0, abs=1e-6)
    cosine = (screen.normal * screen.view).sum(axis=1)
    assert cosine.min() > 0.0
    assert screen.alpha.min() < 0.01 < 0.8 < screen.alpha.max() < 1.0
    with pytest.raises(ValueError, match="does not fill"):
        sys.modules["_screen_pass"].make_screen(36, 64)


def test_mixtures_are_those_of_the_metals(bench: Any) -> None:
    """Where one metal has nearly all the weight, the maps have its F0 and its coefficients."""
    from fresnel_decomp import load_material

    module = sys.modules["_screen_pass"]
    made = module.make_materials("talk", 32, 16)
    assert made.mixture.sum(axis=2) == pytest.approx(1.0, abs=1e-6)
    for i, name in enumerate(bench.METALS):
        at = np.unravel_index(made.mixture[:, :, i].argmax(), (32, 32))
        weight, metal = float(made.mixture[*at, i]), load_material(name)
        assert weight > 0.9
        rest = 2.0 * (1.0 - weight) + 1e-6  # reflectances differ by at most 1, coefficients by 2
        assert made.f0_map[at] == pytest.approx(metal.rgb_reflectance(1.0), abs=rest)
        expected = metal.rgb_coefficients(made.basis)
        assert made.coefficient_map[at] == pytest.approx(expected, abs=rest)


def test_quick_run(bench: Any, llvm: None, tmp_path: Path, capsys: Any) -> None:
    """From the G-buffer to page and picture; the same command goes on from finished rounds."""
    page = tmp_path / "page.md"
    page.write_text("".join("".join(marks) for marks in bench.MARKS.values()), encoding="utf-8")
    picture = tmp_path / "picture.png"
    common = ["--quick", "--variant", "llvm_ad_rgb", "--out", str(tmp_path)]

    def run(*more: str) -> dict[str, Any]:
        bench.bench.main([*common, *more], standalone_mode=False)
        (path,) = tmp_path.glob("llvm_ad_rgb-64x36-quick-*.json")
        return json.loads(path.read_text(encoding="utf-8"))

    first = run("--rounds", "7")
    assert set(first["times"]) == {*bench.PASSES, *bench.PARTS}
    assert all(len(v) == 7 and min(v) > 0.0 for v in first["times"].values())
    assert first["about"]["device"]
    errors = first["errors"]
    assert all(0.0 < error["shader"] < 5e-5 for error in errors.values())
    # the talk's edge tint defeats two terms
    schlick, four = (errors[name] for name in bench.UNIFORM)
    assert four["delta_e"] < 0.3 * schlick["delta_e"]
    assert errors["four terms, textured"]["nrmse"] < 0.2 * errors["Schlick, textured"]["nrmse"]

    second = run("--rounds", "8", "--page", str(page), "--figure", str(picture))
    assert "7 rounds are finished" in capsys.readouterr().err
    for name, values in second["times"].items():
        assert values[:7] == first["times"][name]
        assert len(values) == 8
    assert picture.read_bytes().startswith(b"\x89PNG")
    text = page.read_text(encoding="utf-8")
    (begin, end), (cuda, _) = bench.MARKS["llvm"], bench.MARKS["cuda"]
    part = text[text.index(begin) : text.index(end)]
    assert "Ratios on a processor" in part
    assert " ms" not in part
    assert text.index(cuda) + len(cuda) == text.index(bench.MARKS["cuda"][1])  # left alone


def test_rounds_of_something_else_have_a_file_of_their_own(bench: Any, tmp_path: Path) -> None:
    """So nothing overwrites finished rounds, and nothing is mixed with them."""
    settings = bench.Settings("llvm_ad_rgb", 64, 36)
    facts = made_up(bench, "llvm_ad_rgb")["about"]
    runs = [(settings, facts), (bench.Settings("llvm_ad_rgb", **bench.QUICK), facts)]
    runs += [(dataclasses.replace(settings, width=96), facts)]
    others = {
        "device": "another", "versions": {"mitsuba": "4"}, "repeat": 2, "sources": "another hash"
    }  # fmt: skip
    runs += [(settings, facts | {key: value}) for key, value in others.items()]
    paths = [bench.results_path(tmp_path, *run) for run in runs]
    assert len(set(paths)) == len(runs)
    assert [path.name.startswith("llvm_ad_rgb-64x36-quick-") for path in paths[:2]] == [False, True]
    assert bench.results_path(tmp_path, settings, facts | {"platform": "new"}) == paths[0]


def test_the_code_that_is_timed_is_what_counts(bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another way to time is other code; another text of the report is not."""
    before = bench.sources()
    monkeypatch.setattr(sys.modules["_screen_report"], "verdicts", lambda results: "")
    assert bench.sources() == before
    monkeypatch.setattr(bench, "_milliseconds", lambda shaders, name, repeat: 1.0)
    assert bench.sources() != before


def test_data_of_the_package_count(
    bench: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from fresnel_decomp.bench import machine

    (tmp_path / "data").mkdir()
    code, data = tmp_path / "__init__.py", tmp_path / "data" / "basis.json"
    for path in (code, data):
        path.write_text("1", encoding="utf-8")
    monkeypatch.setattr(machine, "__file__", str(tmp_path / "bench" / "machine.py"))
    found = {bench.sources()}
    for path in (data, code):
        path.write_text("2", encoding="utf-8")
        found.add(bench.sources())
    assert len(found) == 3


def test_damaged_rounds_start_anew(bench: Any, tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    fresh = ({name: [] for name in (*bench.PASSES, *bench.PARTS)}, [])

    def kept(results: dict[str, Any]) -> Any:
        path.write_text(json.dumps(results), encoding="utf-8")
        return bench.resumed(path)

    results = made_up(bench, "llvm_ad_rgb")
    assert kept(results) == (results["times"], results["dates"])
    assert kept(results | {"dates": results["dates"][1:]}) == fresh
    results["times"]["Schlick, uniform"].pop()
    assert kept(results) == fresh
    assert bench.resumed(tmp_path / "none.json") == fresh


def test_rounds_keep_the_day_they_were_measured(bench: Any) -> None:
    results = made_up(bench, "llvm_ad_rgb")
    assert "; 2026-11-24 to 2026-11-25." in bench.report(results)
    results["dates"] = ["2026-11-24"] * 9
    assert "; 2026-11-24." in bench.report(results)


def test_wrong_answers_are_not_timed(bench: Any, llvm: None) -> None:
    """Another coefficient, or a NaN in one pixel, ends the check."""
    import drjit as dr
    import mitsuba as mi

    module = sys.modules["_screen_pass"]
    screen = module.make_screen(32, 18)
    materials = module.make_materials("talk", 32, 16)
    light = bench.prefiltered_city(16, 3)
    shaders = module.Shaders(screen, materials, light)
    limit = bench.EXACT_RMS
    bench.check([(shaders, limit)], screen, materials, light, lambda: None)

    def scaled(name: str) -> Any:
        return tuple(1.001 * c if "four" in name else c for c in shaders(name))

    with pytest.raises(RuntimeError, match=r"four terms, uniform is off by 0\.001"):
        bench.check([(scaled, limit)], screen, materials, light, lambda: None)

    def broken(name: str) -> Any:
        red, green, blue = shaders(name)
        return red, dr.select(dr.arange(mi.UInt32, 576) == 100, float("nan"), green), blue

    with pytest.raises(RuntimeError, match="1 of 576 pixels are not finite"):
        bench.check([(broken, limit)], screen, materials, light, lambda: None)


def test_ratios_without_a_gpu(bench: Any) -> None:
    """A pass that takes 1.1 times as long in every round, slow ones included, has that ratio."""
    text = bench.report(made_up(bench, "llvm_ad_rgb"))
    assert "Ratios on a processor" in text
    assert "1.100 ± 0.000" in text
    assert " ms " not in text
    assert "RTX" not in text


def test_milliseconds_and_the_claim_with_a_gpu(bench: Any) -> None:
    results = made_up(bench, "cuda_ad_rgb", "NVIDIA GeForce RTX 4090, driver 1")
    text = bench.report(results)
    assert "Milliseconds on a GPU" in text
    assert "1.1000 ± 0.5500" in text  # 2.2 in three of nine rounds
    assert "four terms, uniform: +0.1000" in text
    assert "This is another card" in text
    results["times"]["four terms, uniform"] = [
        t + 0.01 for t in results["times"]["Schlick, uniform"]
    ]
    results["about"]["device"] = "NVIDIA GeForce RTX 2070, driver 1"
    text = bench.report(results)
    assert "four terms, uniform: +0.0100 ± 0.0000 ms against 0.05 ms: within" in text
    assert "another card" not in text
    results["times"]["four terms, uniform"] = [
        t + (0.03 if i % 2 else 0.06) for i, t in enumerate(results["times"]["Schlick, uniform"])
    ]
    line = "four terms, uniform: +0.0600 ± 0.0150 ms against 0.05 ms: undecided"
    assert line in bench.report(results)
    results["about"]["device"] = "NVIDIA GeForce RTX 2070 SUPER, driver 1"
    assert "another card" in bench.report(results)
    results["settings"]["height"] = 1080
    assert "within" not in bench.report(results)


@pytest.mark.parametrize(
    ("more", "half", "word"),
    [
        (0.01, 0.03, "within"),
        (-0.10, 0.03, "within"),
        (0.04, 0.03, "undecided"),
        (0.06, 0.03, "undecided"),
        (0.09, 0.03, "above"),
        (0.05, 0.00, "within"),  # "at most"
    ],
)
def test_three_verdicts(said: Any, more: float, half: float, word: str) -> None:
    """The spread counts: a median on one side of 0.05 ms is not enough."""
    rounds = [more - half, more, more + half]
    assert said.verdict([more - 2 * half, *rounds, more + 2 * half]) == word


def test_what_is_dearer_follows_from_the_times(bench: Any, said: Any) -> None:
    """Slow rounds are slow for all passes; only differences in a round count."""
    results = made_up(bench, "llvm_ad_rgb")
    times = results["times"]
    slow = [1 + (r % 3 == 0) for r in range(9)]
    noise = [0.1 * (-1) ** r for r in range(9)]

    def rows() -> dict[str, str]:
        lines = [line.split("|") for line in said.comparisons(times).splitlines()[2:]]
        return {line[1].strip(): line[3].strip() for line in lines}

    schlick, four = bench.UNIFORM
    _, _, maps, rg = (times[name] for name in (schlick, four, "four terms, textured", said.RG))
    _, _, two_channels, four_channels = (times[name] for name in bench.PARTS)
    for i, s in enumerate(slow):
        times[schlick][i], times[four][i] = 3.0 * s, (3.7 + noise[i]) * s
        two_channels[i], four_channels[i] = 2.0 * s, 2.7 * s
        maps[i], rg[i] = 5.0 * s, 4.0 * s
    found = rows()
    assert found["table: four channels, not two"] == "dearer"
    assert found["coefficients and sum: four terms, not two; uniform"] == "undecided"
    assert found["(r, g) in two maps, not coefficients in three"] == "cheaper"
    rg[:] = [6.0 * s for s in slow]
    assert rows()["(r, g) in two maps, not coefficients in three"] == "dearer"
    assert said.comparisons(times) in bench.report(results)


def test_scalar_variants_are_refused(bench: Any) -> None:
    from fresnel_decomp import InputError

    with pytest.raises(InputError, match="no kernels"):
        bench.bench.main(["--variant", "scalar_rgb"], standalone_mode=False)


def test_throw_away_numbers_stay_out_of_the_repository(
    bench: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In a copy, so that a failure does no harm."""
    from fresnel_decomp import InputError

    assert PAGE.is_relative_to(bench.ROOT)
    monkeypatch.setattr(bench, "ROOT", tmp_path)
    page, picture = tmp_path / "README.md", tmp_path / "docs" / "figures" / "screen_pass.png"
    page.write_text("".join("".join(marks) for marks in bench.MARKS.values()), encoding="utf-8")
    common = ["--quick", "--variant", "llvm_ad_rgb", "--out", str(tmp_path / "out")]
    for option, path in (("--page", page), ("--figure", picture)):
        with pytest.raises(InputError, match=f"--quick with {option}"):
            bench.bench.main([*common, option, str(path)], standalone_mode=False)
    for size in (["--width", "32"], ["--height", "18"]):
        with pytest.raises(InputError, match="--quick with a size"):
            bench.bench.main([*common, *size], standalone_mode=False)
    sized = ["--width", "640", "--variant", "llvm_ad_rgb", "--out", str(tmp_path / "out")]
    for option, path in (("--page", page), ("--figure", picture)):
        with pytest.raises(InputError, match=f"{option} .* with 640 × 720 pixels"):
            bench.bench.main([*sized, option, str(path)], standalone_mode=False)
    assert not (tmp_path / "out").exists()


def test_page_says_which_numbers_are_which() -> None:
    """Ratios where there was no GPU, never milliseconds."""
    text = PAGE.read_text(encoding="utf-8")
    begin, end = (f"<!-- {word}full-screen pass, llvm -->" for word in ("", "end of "))
    part = text[text.index(begin) : text.index(end)]
    assert "Ratios on a processor" in part
    assert "1280 × 720" in part
    assert "llvm_ad_rgb" in part
    assert " ms" not in part


def test_page_draws_no_conclusion_of_its_own(bench: Any, said: Any) -> None:
    """Every comparison that the script makes is on the page, with its verdict."""
    made = said.comparisons(made_up(bench, "llvm_ad_rgb")["times"]).splitlines()[2:]
    page = PAGE.read_text(encoding="utf-8").splitlines()
    for line in made:
        (quoted,) = (other for other in page if other.split("|")[1:2] == line.split("|")[1:2])
        number, word = (cell.strip() for cell in quoted.split("|")[2:4])
        more, half = (float(part) for part in number.split("±"))
        assert word == said.direction(more, half)


@pytest.mark.slow
def test_page_quotes_the_errors(bench: Any, llvm: None) -> None:
    """Errors to the exact Fresnel do not depend on the machine."""
    module = sys.modules["_screen_pass"]
    settings = bench.Settings("llvm_ad_rgb", *bench.CLAIM)
    screen = module.make_screen(settings.width, settings.height)
    materials = module.make_materials(settings.recipe, settings.texture, settings.table)
    light = bench.prefiltered_city(settings.light_width, settings.light_levels)
    shaders = module.Shaders(screen, materials, light)
    errors, _ = bench.check([(shaders, bench.EXACT_RMS)], screen, materials, light, lambda: None)
    results = made_up(bench, "llvm_ad_rgb") | {"errors": errors}
    printed, page = (
        [line.split("|") for line in text.splitlines() if re.match(r"\|.*\| light, table", line)]
        for text in (bench.report(results), PAGE.read_text(encoding="utf-8"))
    )
    columns = (1, 2, 4)  # name, fetches, errors: all but the times
    assert len(printed) == len(page) == len(bench.PASSES)
    for mine, theirs in zip(printed, page, strict=True):
        assert [mine[i].strip() for i in columns] == [theirs[i].strip() for i in columns]

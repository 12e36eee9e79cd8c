"""The full-screen pass: its answers, its labels, and that wrong answers are not timed."""

from __future__ import annotations

import importlib
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fresnel_decomp import doctor

SCRIPTS = Path(__file__).parent.parent / "scripts"
PAGE = SCRIPTS.parent / "docs" / "speed_gpu.md"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(SCRIPTS))
    return importlib.import_module("bench_gpu")


@pytest.fixture
def llvm() -> Iterator[None]:
    status = doctor.usable_variants()["llvm_ad_rgb"]
    if not status.usable:
        pytest.skip(f"{status.reason}. {status.remedy}")
    import mitsuba as mi

    before = mi.variant()
    mi.set_variant("llvm_ad_rgb")
    yield
    if before:
        mi.set_variant(before)


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
            "date": "today",
            "repeat": 1,
            "sources": "a hash",
        },
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
        return json.loads((tmp_path / "llvm_ad_rgb-64x36.json").read_text(encoding="utf-8"))

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


def test_other_settings_start_anew(bench: Any, tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    results = made_up(bench, "llvm_ad_rgb")
    path.write_text(json.dumps(results), encoding="utf-8")
    settings, facts = results["settings"], results["about"]
    assert bench.resumed(path, settings, facts | {"date": "later"}) == results["times"]
    fresh = {name: [] for name in results["times"]}
    assert bench.resumed(path, settings | {"width": 640}, facts) == fresh
    others = {
        "device": "another", "versions": {"mitsuba": "4"}, "repeat": 2, "sources": "another hash"
    }  # fmt: skip
    for key, value in others.items():
        assert bench.resumed(path, settings, facts | {key: value}) == fresh
    results["times"]["Schlick, uniform"].pop()
    path.write_text(json.dumps(results), encoding="utf-8")
    assert bench.resumed(path, settings, facts) == fresh
    assert bench.resumed(tmp_path / "none.json", settings, facts) == fresh


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
    assert "above 0.05 ms" in text
    assert "This is another card" in text
    results["times"]["four terms, uniform"] = [
        t + 0.01 for t in results["times"]["Schlick, uniform"]
    ]
    results["about"]["device"] = "NVIDIA GeForce RTX 2070, driver 1"
    text = bench.report(results)
    assert "four terms, uniform: +0.0100 ± 0.0000 ms, within 0.05 ms" in text
    assert "another card" not in text
    results["times"]["four terms, uniform"] = [
        t + (0.03 if i % 2 else 0.06) for i, t in enumerate(results["times"]["Schlick, uniform"])
    ]
    assert "too near to tell from 0.05 ms" in bench.report(results)
    results["settings"]["height"] = 1080
    assert "within" not in bench.report(results)


def test_scalar_variants_are_refused(bench: Any) -> None:
    from fresnel_decomp import InputError

    with pytest.raises(InputError, match="no kernels"):
        bench.bench.main(["--variant", "scalar_rgb"], standalone_mode=False)


def test_throw_away_numbers_stay_out_of_the_pages(bench: Any, llvm: None) -> None:
    from fresnel_decomp import InputError

    common = ["--quick", "--variant", "llvm_ad_rgb"]
    with pytest.raises(InputError, match="--quick with --page"):
        bench.bench.main([*common, "--page", str(PAGE)], standalone_mode=False)
    with pytest.raises(InputError, match="--quick with a size"):
        bench.bench.main([*common, "--width", "32"], standalone_mode=False)


def test_page_says_which_numbers_are_which() -> None:
    """Ratios where there was no GPU, never milliseconds."""
    text = PAGE.read_text(encoding="utf-8")
    begin, end = (f"<!-- {word}full-screen pass, llvm -->" for word in ("", "end of "))
    part = text[text.index(begin) : text.index(end)]
    assert "Ratios on a processor" in part
    assert "1280 × 720" in part
    assert "llvm_ad_rgb" in part
    assert " ms" not in part


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

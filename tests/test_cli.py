"""The command line: what it writes and prints, and how it fails."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from fresnel_decomp import cli, load_basis
from fresnel_decomp.report import comparison

QUICK = ["--variant", "scalar_rgb", "--size", "12", "--spp", "4"]


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of the command, run in this process."""
    with pytest.raises(SystemExit) as exit_info:
        cli.main(arguments)
    captured = capsys.readouterr()
    return int(exit_info.value.code or 0), captured.out, captured.err


def test_compare_writes_everything(capsys, tmp_path):
    out = tmp_path / "Be"
    code, text, _ = run(capsys, "compare", "Be", "--alpha", "0.2", "--out", str(out), *QUICK)
    assert code == 0
    names = {path.name for path in out.iterdir()}
    images = {f"Be_alpha0.2_{m}.exr" for m in ("exact", "decomposition", "schlick")}
    assert names == images | {"curves.png", "renders.png", "report.json", "report.md"}
    for name in ("curves.png", "renders.png"):
        assert (out / name).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"

    report = json.loads((out / "report.json").read_text())
    (material,) = report["materials"]
    errors = material["curve_errors"]
    assert errors["decomposition"]["max"] < 0.01 < errors["schlick"]["max"]
    assert set(errors) == {"decomposition", "schlick", "f82"}
    (render,) = report["renders"]
    assert render["models"]["decomposition"]["flip"] < render["models"]["schlick"]["flip"]
    assert set(report["times"]["models"]) == {"exact", "decomposition", "schlick", "f82"}
    assert report["times"]["runs"] >= 7
    assert report["settings"]["seed"] == 0
    assert report["settings"]["variant"] == "scalar_rgb"
    assert report["command"].startswith("fresnel-decomp")
    assert {"mitsuba", "drjit", "numpy", "llvm"} <= set(report["versions"])
    # the table is the last thing printed: a header and a row for each fitted model
    last = text.rstrip().splitlines()[-3:]
    assert last[0].split()[:3] == ["material", "α", "model"]
    assert [line.split()[2] for line in last[1:]] == ["decomposition", "schlick"]


def test_spectral_coefficients_are_in_the_report(capsys, tmp_path):
    code, *_ = run(capsys, "compare", "gold", "--out", str(tmp_path), *QUICK)
    assert code == 0
    (material,) = json.loads((tmp_path / "report.json").read_text())["materials"]
    assert material["name"] == "Au"
    assert material["spectral"]["coefficients_rgb"][0][0] > 1.0  # red F0 of gold in sRGB
    assert material["spectral"]["delta_e_mean"] < 0.3
    assert "Au.eta.spd" in material["source"]


def test_several_subjects_and_alphas(capsys, tmp_path):
    code, text, _ = run(
        capsys, "compare", "Cu", "--eta", "0.2", "0.92", "1.1", "--k=3.9,2.45,2.14", "--rg",
        "0.44", "0.44", "0.44", "0", "1", "0", "--alpha", "0.1", "--alpha", "0.3",
        "--recipe", "notebook", "--terms", "5", "--out", str(tmp_path), *QUICK,
    )  # fmt: skip
    assert code == 0
    report = json.loads((tmp_path / "report.json").read_text())
    names = [entry["name"] for entry in report["materials"]]
    assert names == ["Cu", "eta-k-0.2_0.92_1.1-3.9_2.45_2.14", "r-g-0.44-0_1_0"]
    assert len(report["renders"]) == 6
    assert all(len(c) == 5 for m in report["materials"] for c in m["coefficients_rgb"])
    assert "notebook" in (tmp_path / "report.md").read_text()
    assert len(text.splitlines()) == 2 + 1 + 6 * 2  # where, times; the table


def test_spectrum_from_a_file(capsys, tmp_path):
    file = tmp_path / "mine.csv"
    file.write_text("wavelength_nm,n,k\n380,1.2,2\n550,1.0,3\n780,1.1,4\n")
    code, *_ = run(capsys, "compare", str(file), "--out", str(tmp_path / "out"), *QUICK)
    assert code == 0
    assert (tmp_path / "out" / "mine_alpha0.1_exact.exr").is_file()


def test_spectral_variant(capsys, tmp_path):
    options = ["--variant", "scalar_spectral", "--size", "8", "--spp", "4", "--out", str(tmp_path)]
    assert run(capsys, "compare", "Cu", "--eta", "1.5", "--k", "3", *options)[0] == 0
    code, _, error = run(capsys, "compare", "--eta", "1", "2", "3", "--k", "3", *options)
    assert code == 2
    assert "spectral" in error


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["compare", "Bee"], "Did you mean 'Be'"),
        (["compare", "AlAs"], "broken"),
        (["compare", "Se"], "--allow-partial"),
        (["compare"], "no material"),
        (["compare", "nowhere.csv"], "cannot read"),
        (["compare", "--eta", "-1", "--k", "2"], "eta=-1"),
        (["compare", "--eta", "1", "--k", "-2"], "k=-2"),
        (["compare", "--eta", "nan", "--k", "2"], "eta=nan"),
        (["compare", "--eta", "x", "--k", "2"], "not a list of numbers"),
        (["compare", "--eta", "1", "2", "--k", "2"], "2 values for eta"),
        (["compare", "--eta", "1"], "--k"),
        (["compare", "--eta", "0.7", "--k", "0"], "total internal reflection"),
        (["compare", "--rg", "1", "0"], "r=1"),
        (["compare", "--rg", "0.5", "1.5"], "g=1.5"),
        (["compare", "--rg", "0.5"], "--rg"),
        (["compare", "Be", "--alpha", "0"], "alpha=0"),
        (["compare", "Be", "--alpha", "nan"], "alpha=nan"),
        (["compare", "Be", "--spp", "0"], "spp=0"),
        (["compare", "Be", "--size", "-3"], "size=-3"),
        (["compare", "Be", "--seed", "-1"], "seed=-1"),
        (["compare", "Be", "--scene", "cornell"], "scene"),
        (["compare", "Be", "--recipe", "tlak"], "Did you mean 'talk'"),
        (["compare", "Be", "--terms", "9"], "terms=9"),
        (["compare", "Be", "--variant", "llvm_rgb"], "llvm_ad_rgb"),
        (["compare", "Be", "--variant", "scalar_mono"], "scalar_"),
        (["basis", "--recipe", "x"], "recipe"),
        (["basis", "--out", "basis.txt"], ".png"),
        (["nonsense"], "No such command"),
    ],
)
def test_bad_input_exits_with_2_and_writes_nothing(
    capsys, tmp_path, monkeypatch, arguments, expected
):
    monkeypatch.chdir(tmp_path)
    extra = ["--out", "results"] if arguments[:1] == ["compare"] else []
    code, _, error = run(capsys, *arguments, *extra)
    assert code == 2
    assert expected in error
    assert "Traceback" not in error
    assert list(tmp_path.iterdir()) == []


def test_two_materials_of_one_name_are_refused(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Be.csv").write_text("wavelength_nm,n,k\n380,0.2,3\n780,0.3,4\n")
    code, _, error = run(capsys, "compare", "Be", "Be.csv", "--out", "results", *QUICK)
    assert code == 2
    assert "two materials of one name" in error
    assert not (tmp_path / "results").exists()
    assert run(capsys, "compare", "Be", "beryllium", "--out", "results", *QUICK)[0] == 0


def test_spectrum_that_cannot_be_fitted_is_refused_before_anything_is_written(
    capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dip.csv").write_text(
        "wavelength_nm,n,k\n360,0.7,0.001\n372,0.7,0.001\n380,1.3,2\n780,1.3,2\n"
    )
    code, _, error = run(
        capsys, "compare", "dip.csv", "--variant", "scalar_spectral", "--out", "results"
    )
    assert code == 2
    assert "total internal reflection" in error
    assert not (tmp_path / "results").exists()


def test_transparent_spectrum_in_a_spectral_variant(capsys, tmp_path):
    code, *_ = run(
        capsys, "compare", "CsI", "--variant", "scalar_spectral", "--size", "8", "--spp", "4",
        "--out", str(tmp_path),
    )  # fmt: skip
    assert code == 0


def test_unwritable_folder(capsys, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    code, _, error = run(capsys, "compare", "Be", "--out", str(blocked), *QUICK)
    assert code == 2
    assert "cannot write" in error


def test_interruption_keeps_finished_images_and_resumes(capsys, tmp_path, monkeypatch):
    arguments = ["compare", "Be", "--out", str(tmp_path), *QUICK]
    original = comparison.render_bsdfs

    def interrupted(bsdfs, *, progress, **options):
        def stop_at_second(model: str, fraction: float) -> None:
            if model == "decomposition":
                raise KeyboardInterrupt
            progress(model, fraction)

        return original(bsdfs, progress=stop_at_second, **options)

    monkeypatch.setattr(comparison, "render_bsdfs", interrupted)
    code, _, error = run(capsys, *arguments)
    assert code == 130
    assert "continues" in error
    exrs = [path.name for path in tmp_path.glob("*.exr")]
    assert exrs == ["Be_alpha0.1_exact.exr"]
    assert not (tmp_path / "report.json").exists()
    stamp = (tmp_path / exrs[0]).stat().st_mtime_ns

    monkeypatch.setattr(comparison, "render_bsdfs", original)
    assert run(capsys, *arguments)[0] == 0
    assert (tmp_path / exrs[0]).stat().st_mtime_ns == stamp  # not rendered again
    assert (tmp_path / "report.json").is_file()


def test_materials(capsys):
    code, text, _ = run(capsys, "materials")
    assert code == 0
    assert text.rstrip().endswith("71 names, 41 data sets, 35 of them usable.")
    assert "AlAs" in text
    assert "broken: eta = 0" in text


def test_basis(capsys, tmp_path):
    path = tmp_path / "basis.png"
    code, text, _ = run(capsys, "basis", "--recipe", "talk", "--terms", "4", "--out", str(path))
    assert code == 0
    assert "node 2: 1.450000 rad" in text
    assert "node 3: 1.310000 rad" in text
    assert "condition number" in text
    assert path.stat().st_size > 10_000


def test_basis_from_a_file(capsys, tmp_path, monkeypatch):
    """Its number of terms is that of the file, and the picture is not put beside it."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "mine"
    folder.mkdir()
    load_basis("talk", 5).save(folder / "own.json")
    code, text, _ = run(capsys, "basis", "--recipe", str(folder / "own.json"))
    assert code == 0
    assert "node 4:" in text
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["basis-own-5.png"]


def test_doctor(capsys):
    code, text, _ = run(capsys, "doctor")
    assert code == 0
    assert "scalar_rgb" in text


def test_module_is_the_command(tmp_path: Path):
    result = subprocess.run(
        [sys.executable, "-m", "fresnel_decomp", "--version"],
        capture_output=True, text=True, cwd=tmp_path, check=False,
    )  # fmt: skip
    assert result.returncode == 0
    assert result.stdout.startswith("fresnel-decomp, version ")


def test_without_llvm_the_comparison_runs_in_scalar_rgb(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("FRESNEL_DECOMP_LLVM", "off")
    result = subprocess.run(
        [sys.executable, "-m", "fresnel_decomp", "compare", "Be", "--size", "8", "--spp", "4",
         "--out", str(tmp_path)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    if "cuda" not in result.stdout:
        assert "rendering in scalar_rgb" in result.stderr
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["settings"]["variant"].startswith(("scalar", "cuda"))

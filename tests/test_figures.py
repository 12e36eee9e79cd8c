"""The scripts that make the figures: computing, skipping, resuming, drawing, exit codes."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"
RENDERED = ("fig01b_beryllium", "fig01c_roughness", "fig02_edge_tint", "fig03_shader_balls")


@pytest.fixture
def reproduce(scripts: Any, run_script: Any) -> Any:
    """Run `reproduce.py` with arguments and return its exit code."""
    return functools.partial(run_script, scripts.reproduce.reproduce, main=scripts.reproduce.main)


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def sidecar(folder: Path, name: str) -> dict[str, Any]:
    return json.loads((folder / name / f"{name}.json").read_text(encoding="utf-8"))


def test_list_names_every_script(reproduce: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert reproduce("--list") == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    figures = sorted(path.stem for path in SCRIPTS.glob("fig*.py"))
    others = (
        "inverse_study", "split_sum_study", "table_study", "principled_study", "area_light_study",
        "energy_study",
    )  # fmt: skip
    assert listed == [*figures, *others]


def test_only_takes_names_and_their_beginnings(
    reproduce: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    assert reproduce("--list", "--only", "fig01a", "fig02_edge_tint") == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert listed == ["fig01a_basis", "fig02_edge_tint"]


@pytest.mark.parametrize("name", ["fig20", "fig02_edge_tnt", ""])
def test_unknown_figure(
    name: str, reproduce: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert reproduce("--only", name, "--out", tmp_path / "new") == 2
    error = capsys.readouterr().err
    assert "is unknown; accepted:" in error
    assert "fig02" in error
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("variant", ["scalar_rbg", "scalar_spectral"])
def test_unsuitable_variant(
    variant: str, reproduce: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("--only", "fig02", "--variant", variant, "--out", tmp_path)
    assert reproduce(*arguments) == 2
    assert "accepted:" in capsys.readouterr().err
    assert not files(tmp_path)


def test_folder_that_cannot_be_written(
    reproduce: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert reproduce("--only", "fig01a", "--out", tmp_path / "file") == 2
    assert "cannot write to folder" in capsys.readouterr().err


def test_basis_from_extraction_to_picture(reproduce: Any, scripts: Any, tmp_path: Path) -> None:
    assert reproduce("--quick", "--only", "fig01a", "--out", tmp_path) == 0
    assert files(tmp_path) == {
        "fig01a_basis.png",
        "fig01a_basis/fig01a_basis.json",
        "fig01a_basis/notebook.csv",
        "fig01a_basis/talk.csv",
    }
    assert (tmp_path / "fig01a_basis.png").read_bytes().startswith(b"\x89PNG")
    record = sidecar(tmp_path, "fig01a_basis")
    assert record["results"]["talk"]["nodes_rad"] == [1.45, 1.31]
    for recipe in ("talk", "notebook"):
        assert record["results"][recipe]["largest_difference_from_shipped"] < 1e-9
    assert {"mitsuba", "numpy", "python"} <= set(record["versions"])
    assert record["runtime_s"] > 0

    table = scripts._figure.read_table(tmp_path / "fig01a_basis" / "talk.csv")
    np.testing.assert_allclose(table["b0"], 1.0)
    np.testing.assert_allclose(table["b1"][[0, -1]], [0.0, 1.0], atol=1e-8)


def test_finished_figures_are_left_alone(
    reproduce: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("--quick", "--only", "fig02", "--variant", "scalar_rgb", "--out", tmp_path)

    def stamps() -> dict[str, int]:
        return {name: (tmp_path / name).stat().st_mtime_ns for name in files(tmp_path)}

    assert reproduce(*arguments) == 0
    first = stamps()
    capsys.readouterr()
    assert reproduce(*arguments) == 0
    assert stamps() == first
    assert "was finished" in capsys.readouterr().out

    (tmp_path / "fig02_edge_tint.png").unlink()
    assert reproduce(*arguments) == 0  # draws, computes nothing
    assert set(stamps()) == set(first)
    table = "fig02_edge_tint/curves.csv"
    assert stamps()[table] == first[table]

    (tmp_path / table).unlink()
    assert reproduce(*arguments) == 0
    second = stamps()
    assert set(second) == set(first)
    assert reproduce(*arguments, "--force") == 0
    assert all(time > second[name] for name, time in stamps().items())


def test_drawing_needs_finished_data(
    scripts: Any, run_script: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    commands = scripts._figure_commands.commands(scripts.fig02_edge_tint.FIGURE)
    assert run_script(commands, "draw", "--data", tmp_path) == 2
    assert "reproduce.py --only fig02_edge_tint" in capsys.readouterr().err


def test_what_other_settings_left_is_not_used(scripts: Any, tmp_path: Path) -> None:
    """Numbers of an interrupted run count for its own settings only, and not with `force`."""
    calls: list[float] = []

    def interrupted(job: Any) -> dict[str, Any]:
        shown = job.settings["parameters"]["shown"]

        def make() -> dict[str, Any]:
            calls.append(shown)
            return {"shown": shown}

        found = scripts._kept.numbers(job, "slow", make)
        table = scripts._kept.table(job, "slow", lambda: {"shown": np.array([float(shown)])})
        if len(calls) == 1:
            raise KeyboardInterrupt
        return {"found": found, "table": table["shown"].tolist()}

    def figure(shown: int) -> Any:
        return scripts._figure.Figure(
            name="trial", title="A trial", minutes=0.0, compute=interrupted,
            draw=lambda folder, pictures: None, pictures=(), parameters={"shown": shown},
        )  # fmt: skip

    def results() -> Any:
        return scripts._figure.read_sidecar("trial", tmp_path)["results"]

    with pytest.raises(KeyboardInterrupt):
        scripts._figure.compute(figure(1), tmp_path)
    scripts._figure.compute(figure(2), tmp_path)
    assert results() == {"found": {"shown": 2}, "table": [2.0]}
    (tmp_path / "slow.csv").unlink()  # not whole: goes on from the rest
    scripts._figure.compute(figure(2), tmp_path)
    assert calls == [1, 2]
    scripts._figure.compute(figure(2), tmp_path, force=True)
    assert calls == [1, 2, 2]


@pytest.mark.parametrize("wrapped", [False, True])
def test_interrupted_figure_goes_on(
    wrapped: bool, reproduce: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    arguments = ("--quick", "--only", "fig02", "--variant", "scalar_rgb", "--out", tmp_path)
    folder = tmp_path / "fig02_edge_tint"
    render = mi.render
    rendered: list[int] = []

    def render_until_interrupted(*parameters: Any, **options: Any) -> Any:
        if len(rendered) == 1:
            if wrapped:  # what Dr.Jit makes of it during a render
                raise RuntimeError("error in drjit.custom") from KeyboardInterrupt()
            raise KeyboardInterrupt
        rendered.append(1)
        return render(*parameters, **options)

    with monkeypatch.context() as patch:
        patch.setattr(mi, "render", render_until_interrupted)
        assert reproduce(*arguments) == 130
    assert "goes on" in capsys.readouterr().err
    assert files(folder) == {"curves.csv", "edge_exact.exr", "fig02_edge_tint.json"}  # all whole
    assert "results" not in sidecar(tmp_path, "fig02_edge_tint")
    stamp = (folder / "edge_exact.exr").stat().st_mtime_ns

    assert reproduce(*arguments) == 0
    assert (folder / "edge_exact.exr").stat().st_mtime_ns == stamp
    record = sidecar(tmp_path, "fig02_edge_tint")
    assert record["images_of_an_earlier_run"] == ["edge_exact.exr"]
    assert set(record["files"]) | {"fig02_edge_tint.json"} == files(folder)
    assert record["settings"]["variant"] == "scalar_rgb"
    assert (tmp_path / "fig02_edge_tint.png").is_file()

    errors = record["results"]["renders"]["edge"]
    assert errors["decomposition"]["delta_e"] < 0.2 * errors["schlick"]["delta_e"]


@pytest.mark.slow
@pytest.mark.parametrize("name", RENDERED)
def test_rendered_figures(
    name: str, variant: str, reproduce: Any, scripts: Any, tmp_path: Path
) -> None:
    assert reproduce("--quick", "--only", name, "--variant", variant, "--out", tmp_path) == 0
    for picture in getattr(scripts, name).FIGURE.pictures:
        assert (tmp_path / picture).is_file()
    for numbers in sidecar(tmp_path, name)["results"]["renders"].values():
        assert numbers["decomposition"]["rmse"] < 0.2 * numbers["schlick"]["rmse"]
        assert numbers["decomposition"]["delta_e"] < 0.5


@pytest.mark.slow
def test_linear_tint_is_even(variant: str, reproduce: Any, tmp_path: Path) -> None:
    name = "fig04_linear_tint"
    assert reproduce("--quick", "--only", name, "--variant", variant, "--out", tmp_path) == 0
    assert (tmp_path / f"{name}.png").is_file()
    ratios = sidecar(tmp_path, name)["results"]["largest_to_smallest"]
    assert ratios["beta"] < 1.5
    assert ratios["g"] > 8.0


@pytest.mark.slow
def test_table_study(scripts: Any, reproduce: Any, run_script: Any, tmp_path: Path) -> None:
    """Every step runs; larger tables are better, half floats cost little, eight bits more."""
    assert reproduce("--quick", "--only", "table_study", "--out", tmp_path) == 0
    assert (tmp_path / "table_study.png").read_bytes().startswith(b"\x89PNG")
    results = sidecar(tmp_path, "table_study")["results"]
    errors = [results["layouts"][f"default-{size}"]["max_outside_corner"] for size in (16, 24, 32)]
    assert errors == sorted(errors, reverse=True)
    added = [results["formats"][name]["added"] for name in ("half", "8-bit unorm", "RGB10A2")]
    assert 0.0 < added[0] < 5e-4 < added[1] < added[2] < 0.05
    page = tmp_path / "page.md"
    page.write_text("".join(scripts.table_study.MARKS), encoding="utf-8")
    study = scripts.table_study.command
    assert run_script(study, "--quick", "--out", tmp_path, "--page", page) == 0
    assert "8-bit unorm" in page.read_text(encoding="utf-8")

"""The one import of notebooks, pictures and sliders without a kernel; the notebooks as text.

They are run by test_distribution.py, where the package is installed as users install it.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fresnel_decomp import InputError, notebook
from fresnel_decomp.report import style

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    import os

    return subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True, text=True, check=False, env={**os.environ, **environment},
    )  # fmt: skip


# --- the import ----------------------------------------------------------------------------------


def test_nothing_is_loaded_before_it_is_asked_for():
    code = (
        "import json, sys\n"
        "from fresnel_decomp.notebook import explore, fd, show\n"
        "print(json.dumps([*sys.modules]))"
    )
    result = run(code)
    assert result.returncode == 0, result.stderr
    heavy = {"mitsuba", "drjit", "numpy", "matplotlib", "IPython", "ipywidgets"}
    assert not heavy & set(json.loads(result.stdout))


def test_mitsuba_is_ready_to_render():
    code = (
        "from fresnel_decomp.notebook import fast, fd, mi, np\n"
        "bsdf = {'type': 'decomposed_conductor', 'material': 'Be'}\n"
        "mi.load_dict(bsdf)\n"
        "print(mi.variant(), fast, fd.doctor.best_variant())"
    )
    result = run(code)
    assert result.returncode == 0, result.stderr
    variant, fast, best = result.stdout.split()
    assert variant == best
    assert fast == str(not variant.startswith("scalar"))


def test_a_slow_variant_is_told():
    code = "from fresnel_decomp.notebook import fast, mi; print(mi.variant(), fast)"
    result = run(code, FRESNEL_DECOMP_LLVM="off", CUDA_VISIBLE_DEVICES="")
    assert result.returncode == 0, result.stderr
    if result.stdout.split()[0].startswith("scalar"):
        assert result.stdout.split()[1] == "False"
        assert "LLVM is switched off" in result.stderr
        assert "restart the kernel" in result.stderr


def test_a_variant_that_is_set_stays(variant: str):
    assert notebook.mi.variant() == variant
    assert notebook.fast == (not variant.startswith("scalar"))


def test_unknown_names():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = notebook.nothing
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = notebook.fd.mitsuba.nothing


# --- pictures ------------------------------------------------------------------------------------


def test_row_of_pictures_and_maps():
    image = np.full((4, 8, 3), 0.2)
    maps = {"difference": np.linspace(-0.1, 0.1, 32).reshape(4, 8)}
    fig = notebook.draw_row({"a": image, "b": 4 * image}, 1.0, maps=maps)
    a, b, difference, _colour_bar = fig.axes
    assert [ax.get_title() for ax in fig.axes[:3]] == ["a", "b", "difference"]
    shown = np.asarray(a.images[0].get_array())
    np.testing.assert_allclose(shown, notebook.fd.images.display(image, 1.0))
    assert np.all(np.asarray(b.images[0].get_array()) == 1.0)
    limits = difference.images[0].get_clim()
    assert limits[0] == -limits[1] < -0.09


def test_row_needs_a_picture():
    with pytest.raises(InputError, match="at least one image"):
        notebook.draw_row({})


# --- sliders -------------------------------------------------------------------------------------


@pytest.fixture
def displayed(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """What is handed to the frontend."""
    display = pytest.importorskip("IPython.display")
    bundles: list[dict[str, Any]] = []
    monkeypatch.setattr(display, "display", lambda bundle, raw: bundles.append(bundle))
    return bundles


def draw(eta: float, k: float) -> Any:
    if k > 5.0:
        raise InputError("k < 5")
    fig = style.figure(2.0, 1.0)
    fig.subplots().plot([0.0, eta], [0.0, k])
    return fig


def test_sliders_have_a_picture_for_readers(displayed: list[dict[str, Any]]):
    notebook.explore(draw, eta=(1.5, 1.0, 3.0), k=(1.0, 0.0, 6.0))
    (bundle,) = displayed
    assert bundle["image/png"].startswith("iVBOR")


def test_no_widgets_no_sliders(displayed: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    notebook.explore(draw, eta=(1.5, 1.0, 3.0), k=(1.0, 0.0, 6.0))
    assert {*displayed[0]} == {"image/png", "text/plain"}


def test_moving_a_slider_draws_anew():
    pytest.importorskip("ipywidgets")
    box = notebook._box(draw, {"eta": (1.5, 1.0, 3.0), "k": (1.0, 0.0, 6.0)}, b"first")
    sliders, picture, message = box.children
    eta, k = sliders.children
    assert bytes(picture.value) == b"first"
    eta.value = 2.0
    second = bytes(picture.value)
    assert second.startswith(b"\x89PNG")
    k.value = 5.5
    assert bytes(picture.value) == second
    assert message.value == "k &lt; 5"
    k.value = 2.0
    assert message.value == ""
    assert bytes(picture.value) != second


def test_events_that_wait_are_answered_together():
    pytest.importorskip("ipywidgets")
    import asyncio

    drawn = []

    def counted(eta: float) -> Any:
        drawn.append(eta)
        return draw(eta, 1.0)

    async def drag() -> None:
        box = notebook._box(counted, {"eta": (1.5, 1.0, 3.0)}, b"")
        for value in (1.6, 1.8, 2.0):
            box.children[0].children[0].value = value
        await asyncio.sleep(10 * notebook._PAUSE)

    asyncio.run(drag())
    assert drawn == [2.0]


@pytest.mark.parametrize("slider", [(0.5, 1.0, 2.0), (2.5, 1.0, 2.0), (1.0, 2.0)])
def test_sliders_in_order(slider: Any):
    with pytest.raises(InputError, match="lowest ≤ start ≤ highest"):
        notebook.explore(draw, eta=slider, k=(1.0, 0.0, 6.0))


# --- the notebooks -------------------------------------------------------------------------------


def cells(path: Path) -> list[Any]:
    jupytext = pytest.importorskip("jupytext")
    return jupytext.read(path, fmt="py:percent").cells


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
class TestText:
    def test_starts_from_one_import(self, path: Path):
        first = next(cell for cell in cells(path) if cell.cell_type == "code")
        imports = [
            node for node in ast.walk(ast.parse(first.source))
            if isinstance(node, ast.Import | ast.ImportFrom)
        ]  # fmt: skip
        assert [getattr(node, "module", "") for node in imports] == ["fresnel_decomp.notebook"]

    def test_a_missing_package_is_told(self, path: Path, monkeypatch: pytest.MonkeyPatch):
        first = next(cell for cell in cells(path) if cell.cell_type == "code")
        monkeypatch.setitem(sys.modules, "fresnel_decomp.notebook", None)
        with pytest.raises(ModuleNotFoundError, match=r"%pip install \./clone ") as told:
            exec(first.source, {})
        assert "fresnel_decomp.notebook" in str(told.value)

    def test_is_text_and_says_what_it_does(self, path: Path):
        kinds = [cell.cell_type for cell in cells(path)]
        assert kinds[0] == "markdown"
        assert cells(path)[0].source.startswith("# ")
        assert kinds.count("markdown") >= 5
        assert not any(cell.get("outputs") for cell in cells(path))

    def test_code_is_python(self, path: Path):
        """Comments that begin with %pip would be run by Jupytext."""
        for cell in cells(path):
            if cell.cell_type == "code":
                ast.parse(cell.source)

    def test_has_a_page(self, path: Path):
        assert (ROOT / "docs" / "notebooks" / f"{path.stem}.md").is_file()
        listed = (ROOT / "docs" / "notebook.md").read_text(encoding="utf-8")
        assert re.search(rf"^notebooks/{path.stem}$", listed, re.M)


def test_there_are_notebooks():
    assert len(NOTEBOOKS) >= 6
    pages = {page.stem for page in (ROOT / "docs" / "notebooks").glob("*.md")}
    assert pages == {path.stem for path in NOTEBOOKS}

"""The card of a material: numbers, remarks, picture, and the command that prints it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fresnel_decomp import RECIPES, Material, load_basis, load_material
from fresnel_decomp.cli import main
from fresnel_decomp.colour import srgb_hex
from fresnel_decomp.report.material_card import (
    draw_card,
    make_card,
    remarks,
    render_card,
    table_rows,
)


@pytest.mark.parametrize("recipe", RECIPES)
def test_numbers_are_the_materials(recipe):
    gold, basis = load_material("Au"), load_basis(recipe)
    card = make_card(gold, basis, "A")
    cosines = np.cos(np.array([0.0, *basis.nodes]))
    np.testing.assert_allclose(card.node_colours, gold.rgb_reflectance(cosines, "A"), atol=1e-14)
    np.testing.assert_allclose(
        card.coefficients.value.coefficients, gold.rgb_coefficients(basis, "A"), atol=1e-13
    )
    np.testing.assert_allclose(card.node_degrees, np.degrees([0.0, *basis.nodes]))
    rows = {row[0]: row for row in table_rows(card)}
    assert rows["F0"][1] == srgb_hex(gold.rgb_reflectance(1.0, "A"))
    assert float(rows["c_0"][2]) == pytest.approx(gold.rgb_reflectance(1.0, "A")[0], abs=1e-4)
    assert float(rows["c_0"][5]) < float(rows["F82 (with F0)"][5]) < float(rows["base colour"][5])


def test_remarks_tell_what_is_out_of_range():
    gold = " ".join(remarks(make_card(load_material("Au"), load_basis())))
    assert "R = 1.0219" in gold
    assert "No (r, g) has the colour in R" in gold
    assert "OpenPBR" not in gold
    assert remarks(make_card(load_material("W"), load_basis())) == []
    bent = Material("bent", [400.0, 700.0], [0.06, 0.06], [1.2, 1.2], "test")
    assert "F82 tint above 1" in " ".join(remarks(make_card(bent, load_basis())))


@pytest.mark.parametrize("terms", [3, 4, 6])
def test_picture_without_a_render(terms, tmp_path: Path):
    path = tmp_path / "card.png"
    draw_card(make_card(load_material("Cu"), load_basis(terms=terms)), path)
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("other", [False, True])
def test_the_picture_is_of_the_card_s_own_basis(other: bool):
    """Also where a basis of that name ships, and another one is meant."""
    shipped = load_basis("talk", 4)
    basis = replace(load_basis("notebook", 4), recipe="talk") if other else shipped
    picture = render_card(make_card(load_material("Cu"), basis), "scalar_rgb", 12, 4)
    usual = render_card(make_card(load_material("Cu"), shipped), "scalar_rgb", 12, 4)
    assert (picture == usual).all() != other


def command(*arguments: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(["material", *arguments])
    return int(end.value.code)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = tmp_path / "new" / "card.png"
    assert command("gold", "--variant", "scalar_rgb", "--out", str(path)) == 0
    printed = capsys.readouterr().out
    for text in ("Au, gold", "Au.eta.spd", "#ffe59e", "c_3", "F82 tint", "beta", str(path)):
        assert text in printed
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("Goldd",), "Did you mean 'Au'"),
        (("Au", "--illuminant", "D56"), "Did you mean"),
        (("Au", "--out", "card.txt"), ".png, .pdf or .svg"),
        (("Au", "--variant", "scalar_spectral"), "renders RGB"),
        (("Se",), "--allow-partial"),
    ],
)
def test_bad_input(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert command(*arguments) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.png"))

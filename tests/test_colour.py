"""Weights, colour differences and encoding, against colour-science's own integration."""

import subprocess
import sys

import numpy as np
import pytest

from fresnel_decomp._check import InputError
from fresnel_decomp.colour import (
    ADAPTATIONS,
    ILLUMINANTS,
    OBSERVERS,
    RGB_SPACES,
    WAVELENGTH_NM,
    delta_e_2000,
    gamut_excess,
    linear_to_srgb,
    luminance_weights,
    rgb_weights,
    srgb_hex,
)
from fresnel_decomp.colour import _colour as colour_science

RAMP = 0.05 + 0.9 * np.linspace(0.0, 1.0, WAVELENGTH_NM.size) ** 2


@pytest.mark.parametrize("colourspace", RGB_SPACES)
@pytest.mark.parametrize("observer", OBSERVERS)
@pytest.mark.parametrize("illuminant", ILLUMINANTS)
def test_neutral_spectrum_is_neutral(illuminant, observer, colourspace):
    weights = rgb_weights(illuminant, observer, colourspace)
    assert weights.shape == (3, WAVELENGTH_NM.size)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=0.0, atol=2e-15)
    np.testing.assert_allclose(weights @ np.full(WAVELENGTH_NM.size, 0.25), 0.25, atol=1e-15)


@pytest.mark.parametrize(("observer", "degrees"), [("cie_2_1931", 2), ("cie_10_1964", 10)])
@pytest.mark.parametrize("illuminant", ILLUMINANTS)
def test_agrees_with_independent_integration(illuminant, observer, degrees):
    colour = colour_science()
    name = {2: "CIE 1931 2 Degree Standard Observer", 10: "CIE 1964 10 Degree Standard Observer"}
    space = colour.RGB_COLOURSPACES["sRGB"].copy()
    space.use_derived_transformation_matrices(True)

    observer_table = colour.MSDS_CMFS[name[degrees]]
    light = colour.SDS_ILLUMINANTS[illuminant].copy().align(observer_table.shape)

    def integrated(reflectance):
        spectrum = colour.SpectralDistribution(reflectance, WAVELENGTH_NM)
        xyz = colour.sd_to_XYZ(spectrum, observer_table, light, method="Integration")
        return space.matrix_XYZ_to_RGB @ (xyz / 100.0)

    expected = integrated(RAMP) / integrated(np.ones_like(RAMP))
    np.testing.assert_allclose(rgb_weights(illuminant, observer) @ RAMP, expected, atol=1e-12)


def test_reflectance_times_light_is_the_reflected_light():
    """What the normalisation is for: no error from multiplying RGB by RGB, under any light."""
    equal_energy, flat = rgb_weights("E"), np.ones_like(WAVELENGTH_NM)
    power = np.interp(WAVELENGTH_NM, [360.0, 830.0], [0.1, 2.0])
    light, reflected = equal_energy @ power, equal_energy @ (power * RAMP)
    weights = rgb_weights((WAVELENGTH_NM, power))
    np.testing.assert_allclose((weights @ RAMP) * light, reflected, rtol=1e-12)
    np.testing.assert_allclose(rgb_weights((WAVELENGTH_NM, flat)), equal_energy, atol=1e-17)


def test_user_illuminant_equals_the_named_one_at_any_scale():
    table = colour_science().SDS_ILLUMINANTS["A"]
    given = rgb_weights((table.wavelengths.tolist(), (1e-6 * table.values).tolist()))
    np.testing.assert_allclose(given, rgb_weights("A"), atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"illuminant": "D66"}, "Did you mean 'D65'"),
        ({"observer": "cie_2_1932"}, "Did you mean 'cie_2_1931'"),
        ({"colourspace": "sRBG"}, "Did you mean 'sRGB'"),
        ({"illuminant": ([400.0, 700.0], [1.0])}, r"shapes \(2,\) and \(1,\)"),
        ({"illuminant": ([700.0, 400.0], [1.0, 1.0])}, "increasing"),
        ({"illuminant": ([400.0, 700.0], [1.0, np.nan])}, "finite"),
        ({"illuminant": ([400.0, 700.0], [1.0, -1.0])}, "power >= 0"),
        ({"illuminant": ([400.0, 700.0], [0.0, 0.0])}, "power >= 0"),
        ({"illuminant": 5}, "an illuminant 5; accepted: 'D65'.*Give a spectrum"),
        ({"illuminant": None}, "an illuminant None; accepted: 'D65'"),
        ({"illuminant": ([400.0, 700.0], [1.0, 1.0], [1.0, 1.0])}, "accepted: 'D65'.*two arrays"),
        ({"illuminant": (["400", "red"], [1.0, 1.0])}, "two arrays of numbers"),
        ({"illuminant": ([400.0, 700.0], [[1.0], [1.0, 2.0]])}, "two arrays of numbers"),
        ({"illuminant": (400.0, 700.0)}, "accepted: .wavelength_nm, power"),
        ({"illuminant": ([589.0, 590.0], [1.0, 1.0])}, "covers 400–700 nm"),
        ({"illuminant": ([400.0, 588, 590.0, 700.0], [0, 0, 1, 0])}, "inside the gamut of sRGB"),
    ],
)
def test_bad_arguments(arguments, message):
    with pytest.raises(InputError, match=message):
        rgb_weights(**arguments)


@pytest.mark.parametrize("illuminant", [5, None, ([400.0, 700.0],), "D66"])
def test_bad_light_for_luminance(illuminant):
    with pytest.raises(InputError, match="accepted"):
        luminance_weights(illuminant)


def _linear_srgb(lab):
    """Linear sRGB of a CIELAB value under the white of sRGB, by the textbook formulas."""
    fy = (lab[0] + 16.0) / 116.0
    f = np.array([fy + lab[1] / 500.0, fy, fy - lab[2] / 200.0])
    relative = np.where(f > 6 / 29, f**3, 3 * (6 / 29) ** 2 * (f - 4 / 29))
    white = np.array([0.3127 / 0.3290, 1.0, (1 - 0.3127 - 0.3290) / 0.3290])
    primaries = np.array([[0.64, 0.33, 0.03], [0.30, 0.60, 0.10], [0.15, 0.06, 0.79]]).T
    rgb_to_xyz = primaries * np.linalg.solve(primaries, white)
    return np.linalg.solve(rgb_to_xyz, relative * white)


@pytest.mark.parametrize(
    ("lab_a", "lab_b", "expected"),  # Sharma, Wu, Dalal 2005, table 1: pairs 1, 25 and 30
    [
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
        ((90.8027, -2.0831, 1.4410), (91.1528, -1.6435, 0.0447), 1.4441),
    ],
)
def test_published_colour_differences(lab_a, lab_b, expected):
    rgb_a, rgb_b = _linear_srgb(lab_a), _linear_srgb(lab_b)
    assert delta_e_2000(rgb_a, rgb_b) == pytest.approx(expected, abs=1e-4)
    with colour_science().domain_range_scale("1"):  # a caller's setting is not ours
        assert delta_e_2000(rgb_a, rgb_b) == pytest.approx(expected, abs=1e-4)


def test_colour_difference_broadcasts_and_does_not_clip():
    grey = np.full((4, 1, 3), 0.5)
    assert delta_e_2000(grey, np.zeros((5, 3))).shape == (4, 5)
    np.testing.assert_array_equal(delta_e_2000(grey, grey), 0.0)
    assert delta_e_2000([1.0, 1.0, 1.0], [1.1, 1.0, 1.0]) > 1.0
    assert delta_e_2000([0.0, 0.5, 0.0], [-0.1, 0.5, 0.0]) > 1.0
    assert delta_e_2000([1.0, 1.0, 1.0], [0.0, 0.0, 0.0], "ACEScg") == pytest.approx(100.0)
    with pytest.raises(InputError, match=r"shape \(2,\)"):
        delta_e_2000([0.5, 0.5], grey)


def test_encoding_for_display():
    x = np.linspace(0.0, 1.0, 513)
    expected = colour_science().cctf_encoding(x, "sRGB")
    np.testing.assert_allclose(linear_to_srgb(x), expected, atol=1e-12)
    np.testing.assert_allclose(linear_to_srgb([0.0, 0.001, 0.5, 1.0]), [0, 0.01292, 0.735357, 1])
    np.testing.assert_allclose(linear_to_srgb([-0.5, 1.5]), [0.0, 1.0], atol=1e-15)
    assert srgb_hex([1.022, 0.2140411, -0.1]) == "#ff7f00"


def test_import_is_light_and_colour_science_leaves_no_trace():
    program = """
import sys
import numpy as np
import fresnel_decomp.colour, fresnel_decomp.spectra
assert not {"colour", "mitsuba", "drjit", "scipy", "matplotlib"} & set(sys.modules)
before = np.get_printoptions()
fresnel_decomp.colour.rgb_weights()
assert np.get_printoptions() == before
"""
    subprocess.run([sys.executable, "-W", "error", "-c", program], check=True)


# --- adaptation and gamut ------------------------------------------------------------------------


@pytest.mark.parametrize("colourspace", RGB_SPACES)
@pytest.mark.parametrize("adaptation", ADAPTATIONS)
@pytest.mark.parametrize("illuminant", ILLUMINANTS)
def test_every_adaptation_keeps_white(illuminant, adaptation, colourspace):
    weights = rgb_weights(illuminant, colourspace=colourspace, adaptation=adaptation)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=0.0, atol=2e-15)


@pytest.mark.parametrize("adaptation", ["bradford", "cat02", "cat16"])
@pytest.mark.parametrize("illuminant", ILLUMINANTS)
def test_adaptation_is_that_of_colour_science(illuminant, adaptation):
    colour = colour_science()
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    light = colour.SDS_ILLUMINANTS[illuminant].copy().align(cmfs.shape)
    space = colour.RGB_COLOURSPACES["sRGB"].copy()
    space.use_derived_transformation_matrices(True)

    def xyz(reflectance):
        spectrum = colour.SpectralDistribution(reflectance, WAVELENGTH_NM)
        return colour.sd_to_XYZ(spectrum, cmfs, light, method="Integration") / 100.0

    to = colour.xy_to_XYZ(space.whitepoint)
    adapted = colour.chromatic_adaptation(
        xyz(RAMP),
        xyz(np.ones_like(RAMP)),
        to,
        method="Von Kries",
        transform=ADAPTATIONS[adaptation],
    )
    expected = space.matrix_XYZ_to_RGB @ adapted
    got = rgb_weights(illuminant, adaptation=adaptation) @ RAMP
    np.testing.assert_allclose(got, expected, atol=2e-6)  # its matrices are rounded


def test_adaptations_differ_only_where_whites_do():
    metal = 0.3 + 0.6 / (1.0 + np.exp((530.0 - WAVELENGTH_NM) / 15.0))  # a golden step
    day, evening = (
        {a: rgb_weights(i, adaptation=a) @ metal for a in ADAPTATIONS} for i in ("D65", "A")
    )
    for adaptation in ("bradford", "cat02", "cat16"):
        np.testing.assert_allclose(day[adaptation], day["rgb"], atol=1e-4)
        assert np.abs(evening[adaptation] - evening["rgb"]).max() > 1e-2


def test_gamut_excess():
    np.testing.assert_allclose(gamut_excess([[1.25, 0.5, -0.5], [0.0, 1.0, 0.2]]),
                               [[0.25, 0.0, -0.5], [0.0, 0.0, 0.0]])  # fmt: skip
    with pytest.raises(InputError, match="Did you mean 'bradford'"):
        rgb_weights(adaptation="bradfort")

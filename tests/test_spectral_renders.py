"""RGB renders of integrated spectra against spectral renders of the spectra themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fresnel_decomp import RECIPES, directional_albedo, doctor, load_material


@pytest.fixture
def script(scripts: Any):
    for name in ("llvm_ad_spectral", "llvm_ad_rgb"):
        status = doctor.usable_variants()[name]
        if not status.usable:
            pytest.skip(f"{name}: {status.reason}. {status.remedy}")
    import mitsuba as mi

    before = mi.variant()
    yield scripts.spectral_renders
    if before:
        mi.set_variant(before)


def test_picture_is_the_directional_albedo(script):
    """The spectral render of gold is the integral of its spectrum, ring by ring."""
    bsdf = {"type": "roughconductor", "material": "Au"}
    white = script.rings(
        script.render("llvm_ad_spectral", {**bsdf, "material": "none"}, 0.3, 1024, 0)
    )
    gold = script.rings(script.render("llvm_ad_spectral", bsdf, 0.3, 1024, 1))
    np.testing.assert_allclose(white[1:4], white[1:4].mean(), atol=0.004)  # D65 is white
    # pixels of a ring average over cosines: compare well inside
    distance = (np.arange(6) + 0.5) / script.RINGS
    mu = np.sqrt(1.0 - distance**2)
    # tabulated: the albedo asks for thousands of cosines
    grid = np.linspace(0.0, 1.0, 257)
    table = load_material("Au").rgb_reflectance(grid)

    def f(cos_theta):
        return np.stack([np.interp(cos_theta, grid, column) for column in table.T], axis=-1)

    expected = directional_albedo(f, mu, 0.3)
    one = directional_albedo(lambda c: 1.0 + 0.0 * c, mu, 0.3)[:, None]
    np.testing.assert_allclose(gold[:6] / white[:6], expected / one, atol=0.006)  # noise .002


@pytest.mark.slow
def test_rgb_renders_are_those_of_the_spectra(script):
    results = script.measure(script.METALS, 0.1, 4096)
    for metal, rows in results.items():
        noise = rows["noise"]["mean"]
        assert noise < 0.05, metal
        for recipe in RECIPES:
            assert rows[f"{recipe}, RGB to spectral"]["mean"] < 0.1 + noise, (metal, recipe)
        for recipe in ("notebook", "talk"):
            for variant in ("RGB", "spectral"):
                assert rows[f"{recipe}, {variant}"]["mean"] < 0.1 + noise, (metal, recipe, variant)
        assert 0.7 < rows["roughconductor, RGB"]["mean"] < 6.0, metal

"""Same-seed comparisons: only the Fresnel term may differ."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fresnel_decomp._check import InputError
from fresnel_decomp.images import read_exr, read_exr_attributes
from fresnel_decomp.mitsuba import comparison
from fresnel_decomp.mitsuba.variants import variant_scope

ETA, K = [4.37, 2.92, 1.65], [5.21, 4.23, 3.75]  # chromium


def built_in(**changes: Any) -> dict[str, Any]:
    """The same conductor as Mitsuba's own plugin."""
    bsdf = comparison.conductor_bsdf(ETA, K, alpha=0.2) | {"type": "roughconductor"}
    del bsdf["fresnel"]
    return bsdf | changes


@pytest.mark.parametrize("scene", ["studio", "shader-ball"])
def test_exact_model_is_the_built_in_conductor(variant: str, scene: str) -> None:
    bsdfs = comparison.model_bsdfs(ETA, K, ("exact",), alpha=0.2) | {"built-in": built_in()}
    images = comparison.render_bsdfs(bsdfs, scene=scene, size=16, spp=4)
    if variant.startswith("llvm"):
        np.testing.assert_array_equal(images["exact"], images["built-in"])
    else:  # scalar code is compiled differently
        np.testing.assert_allclose(images["exact"], images["built-in"], rtol=7e-5)


def test_models_differ_only_where_the_metal_is_seen(variant: str) -> None:
    images = comparison.render_models(ETA, K, alpha=0.2, size=16, spp=4, seed=5)
    assert list(images) == ["exact", "decomposition", "schlick"]
    top = slice(0, 1)  # backdrop
    for name in ("decomposition", "schlick"):
        np.testing.assert_array_equal(images[name][top], images["exact"][top])
        assert np.any(images[name] != images["exact"])
    error = {name: np.abs(image - images["exact"]).mean() for name, image in images.items()}
    assert error["decomposition"] < 0.2 * error["schlick"]


def test_passes_add_up(variant: str, monkeypatch: pytest.MonkeyPatch) -> None:
    bsdfs = {"metal": built_in()}
    whole = comparison.render_bsdfs(bsdfs, size=8, spp=64, seed=2)["metal"]
    for name in ("_WAVEFRONT", "_WAVEFRONT_SCALAR"):
        monkeypatch.setattr(comparison, name, 16 * 8 * 8)
    steps: list[tuple[str, float]] = []
    split = comparison.render_bsdfs(
        bsdfs, size=8, spp=64, seed=2, progress=lambda *step: steps.append(step)
    )["metal"]
    assert steps == [("metal", x) for x in (0.25, 0.5, 0.75, 1.0)]
    assert np.any(whole != split)
    np.testing.assert_allclose(split.mean(), whole.mean(), rtol=0.02)


@pytest.mark.parametrize("spp", [*range(1, 40), 64, 100, 127, 128, 1000, 4096])
def test_pass_sizes(spp: int) -> None:
    for limit in (0, 1, 5, 64, 10**6):
        passes = comparison._passes(spp, limit)
        assert sum(passes) == spp
        assert max(passes) <= max(1, limit)
        assert all(comparison._grid(n) for n in passes)
    assert comparison._passes(64, 64) == [64]
    assert comparison._passes(128, 10**6) == [64, 64]


def test_finished_images_are_kept(tmp_path: Path, variant: str) -> None:
    """A stopped run leaves whole files, and the next one renders only what is missing."""
    bsdfs = {"a": built_in(), "b": built_in(alpha=0.3)}

    def stop(name: str, fraction: float) -> None:
        if name == "b":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        comparison.render_bsdfs(bsdfs, size=8, spp=1, folder=tmp_path, stem="Cr", progress=stop)
    assert [p.name for p in tmp_path.iterdir()] == ["Cr_a.exr"]
    os.utime(tmp_path / "Cr_a.exr", (0, 0))

    options: dict[str, Any] = {"size": 8, "spp": 1, "folder": tmp_path, "stem": "Cr"}
    images = comparison.render_bsdfs(bsdfs, **options)
    assert (tmp_path / "Cr_a.exr").stat().st_mtime == 0
    np.testing.assert_array_equal(images["b"], read_exr(tmp_path / "Cr_b.exr"))
    assert "Mitsuba" in read_exr_attributes(tmp_path / "Cr_b.exr")["software"]

    comparison.render_bsdfs(bsdfs, **options | {"seed": 1})  # other settings: not the same image
    assert (tmp_path / "Cr_a.exr").stat().st_mtime > 0
    (tmp_path / "Cr_a.exr").write_text("damaged")
    comparison.render_bsdfs(bsdfs, **options)
    np.testing.assert_array_equal(read_exr(tmp_path / "Cr_a.exr"), images["a"])


def test_variant_is_restored(variant: str) -> None:
    import mitsuba as mi

    with variant_scope("scalar_spectral") as name:
        assert name == mi.variant() == "scalar_spectral"
    assert mi.variant() == variant
    with pytest.raises(InputError, match="scalar_rgb"), variant_scope("scalar_rbg"):
        pass
    assert mi.variant() == variant


def test_grey_indices_look_alike_in_every_kind_of_variant() -> None:
    flat, wavelength = np.ones(3), np.linspace(360.0, 830.0, 3)
    options: dict[str, Any] = {"models": ("exact",), "alpha": 0.3, "size": 8, "spp": 256}
    grey = comparison.render_models(1.5, 4.0, variant="scalar_rgb", **options)["exact"]
    for image in (
        comparison.render_models(1.5 * flat, 4 * flat, variant="scalar_rgb", **options),
        comparison.render_models(1.5, 4.0, variant="scalar_spectral", **options),
        comparison.render_models(
            1.5 * flat, 4 * flat, variant="scalar_spectral", wavelength_nm=wavelength, **options
        ),
    ):
        np.testing.assert_allclose(image["exact"].mean((0, 1)), grey.mean(), rtol=0.02)


def test_indices_must_suit_the_variant() -> None:
    wavelength = np.linspace(360.0, 830.0, 3)
    with pytest.raises(InputError, match="RGB indices for scalar_spectral"):
        comparison.render_models(ETA, K, variant="scalar_spectral")
    with pytest.raises(InputError, match="spectral indices for scalar_rgb"):
        comparison.render_models(ETA, K, variant="scalar_rgb", wavelength_nm=wavelength)


def test_spectral_indices() -> None:
    wavelength = np.linspace(360.0, 830.0, 48)
    images = comparison.render_models(
        np.linspace(4.0, 1.5, 48),
        np.linspace(4.0, 2.0, 48),
        ("exact", "schlick"),
        wavelength_nm=wavelength,
        size=8,
        spp=1,
        variant="scalar_spectral",
    )
    assert images["exact"].shape == (8, 8, 3)
    assert np.isfinite(images["exact"]).all()
    assert np.any(images["exact"] != images["schlick"])


def test_spectra_without_absorption() -> None:
    """Mitsuba has no spectra that are 0 everywhere."""
    wavelength = np.linspace(360.0, 830.0, 5)
    bsdf = comparison.conductor_bsdf(np.full(5, 1.8), np.zeros(5), wavelength_nm=wavelength)
    assert bsdf["k"] == 0.0
    options: dict[str, Any] = {"size": 8, "spp": 1, "variant": "scalar_spectral"}
    images = comparison.render_bsdfs({"metal": bsdf}, **options)
    assert np.isfinite(images["metal"]).all()


@pytest.mark.parametrize(("name", "value"), [("spp", 1.5), ("spp", 0), ("seed", -1)])
def test_samples_and_seeds_are_counted(variant: str, name: str, value: float) -> None:
    bsdfs = {"a": {"type": "diffuse"}}
    with pytest.raises(InputError, match=f"{name}={value}; accepted: an integer"):
        comparison.render_bsdfs(bsdfs, **{"size": 4, "spp": 1, name: value})


def test_bad_input(variant: str) -> None:
    with pytest.raises(InputError, match="eta of shape"):
        comparison.conductor_bsdf([1.0, 2.0], K)
    for eta, k in ((-1.0, 2.0), (0.0, 2.0), (np.nan, 2.0), (1.0, -2.0), (ETA, [1.0, np.inf, 2.0])):
        with pytest.raises(InputError, match="with the value"):
            comparison.conductor_bsdf(eta, k)
    with pytest.raises(InputError, match="total internal reflection"):
        comparison.model_bsdfs([1.5, 0.7, 1.5], 0.0)
    with pytest.raises(InputError, match="'talk'"):
        comparison.model_bsdfs(ETA, K, recipe="tlak")
    with pytest.raises(InputError, match="wavelengths of shape"):
        comparison.conductor_bsdf(ETA, K, wavelength_nm=[400.0, 700.0])
    with pytest.raises(InputError, match="alpha"):
        comparison.conductor_bsdf(ETA, K, alpha=0.0)
    with pytest.raises(InputError, match="decomposition"):
        comparison.conductor_bsdf(ETA, K, fresnel="decomp")
    with pytest.raises(InputError, match="spp"):
        comparison.render_bsdfs({"a": built_in()}, size=8, spp=0)

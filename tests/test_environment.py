"""Maps of light: Mitsuba's layout, files, sizes, baked and made-up skies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backends import BACKENDS, float_type
from fresnel_decomp._check import InputError
from fresnel_decomp.images import write_exr
from fresnel_decomp.mitsuba.environment import Environment, row_weights, texel_directions
from fresnel_decomp.mitsuba.skies import _city, city, sunsky


def random_map(width: int = 16, seed: int = 0) -> Environment:
    radiance = np.random.default_rng(seed).random((width // 2, width, 3))
    return Environment(radiance.astype(np.float32), "random")


def random_directions(count: int, seed: int = 1) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors.astype(np.float32)


def total(light: Environment) -> np.ndarray:
    """Radiance integrated over all directions."""
    weights = row_weights(light.height)[:, None, None] * 2.0 * np.pi / light.width
    return (weights * light.radiance).sum(axis=(0, 1))


def emitted(emitter: Any, directions: np.ndarray, variant: str) -> np.ndarray:
    """(n, 3) radiance that an emitter of Mitsuba's sends from directions."""
    import drjit as dr
    import mitsuba as mi

    if variant.startswith("scalar"):
        result = []
        for direction in directions:
            si = dr.zeros(mi.SurfaceInteraction3f)
            si.wi = mi.Vector3f(*(-direction).tolist())
            result.append(np.array(emitter.eval(si)))
        return np.array(result)
    si = dr.zeros(mi.SurfaceInteraction3f, len(directions))
    si.wi = -mi.Vector3f(*(mi.Float(np.ascontiguousarray(c)) for c in directions.T))
    return np.array(emitter.eval(si)).T


def test_lookup_is_that_of_envmap(variant: str) -> None:
    """Every texel, row and column has its place: bilinear values agree to single precision."""
    import mitsuba as mi

    light = random_map()
    axes = np.eye(3, dtype=np.float32)[[0, 2]]  # at the poles themselves azimuth has no meaning
    directions = np.concatenate([random_directions(400), axes, -axes])
    expected = emitted(mi.load_dict(light.emitter()), directions, variant)
    # a texel is .4 wide, Mitsuba's acos has an error of 3e-4 near the poles
    poles = np.abs(directions[:, 1]) > 0.999
    found = light.lookup(directions)
    np.testing.assert_allclose(found[~poles], expected[~poles], atol=3e-6)
    np.testing.assert_allclose(found[poles], expected[poles], atol=3e-3)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_lookup_with_drjit(backend: str, precision: str) -> None:
    kind = float_type(backend, precision)
    light, directions = random_map(), random_directions(100)
    vector = [kind(np.ascontiguousarray(c, precision)) for c in directions.T]
    found = np.stack([np.array(channel) for channel in light.lookup(vector)], axis=-1)
    np.testing.assert_allclose(found, light.lookup(directions.astype(precision)), atol=3e-6)


def test_texels_are_where_their_directions_are() -> None:
    light = random_map(32)
    found = light.lookup(texel_directions(32))
    np.testing.assert_allclose(found[1:-1], light.radiance[1:-1], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(texel_directions(8), axis=-1), 1.0)


@pytest.mark.parametrize("height", [2, 3, 16, 255])
def test_row_weights_are_integrals_of_hats(height: int) -> None:
    polar = np.linspace(0.0, np.pi, height)
    fine = (np.arange(200_000) + 0.5) * np.pi / 200_000
    for row in {0, 1, height // 2, height - 1}:
        hat = np.maximum(1.0 - np.abs(fine - polar[row]) / (polar[1] - polar[0]), 0.0)
        expected = np.sum(hat * np.sin(fine)) * np.pi / 200_000
        assert row_weights(height)[row] == pytest.approx(expected, rel=1e-5)
    assert row_weights(height).sum() == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize("suffix", [".exr", ".hdr"])
def test_files_are_read(variant: str, suffix: str, tmp_path: Path) -> None:
    import mitsuba as mi

    light = random_map()
    path = tmp_path / f"light{suffix}"
    mi.Bitmap(np.array(light.radiance)).write(str(path))
    read = Environment.load(path)
    assert read.name == "light"
    tolerance = 1e-6 if suffix == ".exr" else 1.0 / 128  # a shared exponent and 8 bits
    np.testing.assert_allclose(read.radiance, light.radiance, atol=tolerance)
    assert Environment.load(path, width=8).radiance.shape == (4, 8, 3)


def test_grey_files(variant: str, tmp_path: Path) -> None:
    grey = np.random.default_rng(0).random((4, 8)).astype(np.float32)
    write_exr(tmp_path / "grey.exr", grey)
    found = Environment.load(tmp_path / "grey.exr").radiance
    np.testing.assert_array_equal(found, np.repeat(grey[..., None], 3, axis=2))


def test_files_that_are_refused(variant: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no file .*accepted"):
        Environment.load(tmp_path / "missing.exr")
    with pytest.raises(InputError, match=r"\.png.*accepted: an equirectangular map"):
        Environment.load(tmp_path / "light.png")
    write_exr(tmp_path / "whole.exr", np.ones((64, 128, 3)))
    data = (tmp_path / "whole.exr").read_bytes()
    (tmp_path / "cut.exr").write_bytes(data[: len(data) // 2])
    (tmp_path / "text.hdr").write_text("not a picture")
    for name in ("cut.exr", "text.hdr"):
        with pytest.raises(InputError, match=f"cannot read .*{name}.*accepted"):
            Environment.load(tmp_path / name)
    write_exr(tmp_path / "square.exr", np.ones((4, 4, 3)))
    with pytest.raises(InputError, match="4 x 4 pixels; accepted: twice as many columns"):
        Environment.load(tmp_path / "square.exr")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e-3])
def test_radiance_that_is_refused(bad: float) -> None:
    radiance = np.ones((4, 8, 3))
    radiance[2, 5, 1] = bad
    with pytest.raises(InputError, match=r"1 values .* at row 2, column 5; accepted: finite"):
        Environment(radiance)


def test_arrays_that_are_refused() -> None:
    with pytest.raises(InputError, match="without any light"):
        Environment(np.zeros((4, 8, 3)))
    with pytest.raises(InputError, match="accepted: real numbers of shape"):
        Environment(np.ones((4, 8, 4)))
    with pytest.raises(InputError, match="accepted: real numbers of shape"):
        Environment(np.ones((4, 8)))
    with pytest.raises(InputError, match="width=7"):
        random_map().resized(7)


def test_maps_are_copied_and_read_only() -> None:
    radiance = np.ones((4, 8, 3), np.float32)
    light = Environment(radiance)
    radiance[:] = 5.0
    assert np.all(light.radiance == 1.0)
    with pytest.raises(ValueError, match="read-only"):
        light.radiance[0, 0] = 2.0


def test_resizing_keeps_the_light() -> None:
    light = city(128)
    # rows weigh what they cover in the fine map; the coarse one integrates them again
    np.testing.assert_allclose(total(light.resized(32)), total(light), rtol=3e-3)
    flat = Environment(np.full((32, 64, 3), 0.7)).resized(16)
    np.testing.assert_allclose(flat.radiance, 0.7, rtol=1e-6)
    assert light.resized(512) is light


def test_turning() -> None:
    light = random_map(16)
    angle = 3 * 2.0 * np.pi / 16
    x, y, z = random_directions(50).T.astype(np.float64)
    # columns grow from -z over +x: turning to the right takes -z towards +x
    turned = np.stack(
        [np.cos(angle) * x - np.sin(angle) * z, y, np.sin(angle) * x + np.cos(angle) * z], axis=-1
    )
    expected = light.lookup(np.stack([x, y, z], axis=-1))
    np.testing.assert_allclose(light.turned(3).lookup(turned), expected, atol=1e-6)


def test_city_is_the_same_every_time() -> None:
    first, second = city(64).radiance, _city.__wrapped__(64).radiance
    np.testing.assert_array_equal(first, second)
    mean = first.mean(axis=(0, 1))
    assert np.all((mean > 0.1) & (mean < 1.0))
    assert mean[2] > mean[0]  # blue sky
    assert first.max() > 20.0 * mean.max()  # and a sun


def test_sunsky(variant: str) -> None:
    import mitsuba as mi

    if variant.startswith("scalar"):
        with pytest.raises(InputError, match="accepted: an LLVM or CUDA variant"):
            sunsky(16)
        return
    sun = np.array([-0.4, 0.7, 0.2])
    light = sunsky(64, sun_direction=sun)
    finer = sunsky(256, sun_direction=sun)
    np.testing.assert_allclose(total(light), total(finer), rtol=0.02)  # the sun keeps its power
    brightest = np.unravel_index(light.radiance.sum(axis=2).argmax(), (32, 64))
    assert texel_directions(64)[brightest] @ sun / np.linalg.norm(sun) > np.cos(np.radians(6))
    assert np.all(light.radiance[17:] == 0.0)  # nothing comes from below

    emitter = mi.load_dict(
        {
            "type": "sunsky",
            "sun_direction": sun.tolist(),
            "turbidity": 3.0,
            "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -90),
        }
    )
    directions = texel_directions(64)[3:13].reshape(-1, 3)
    directions = directions[directions @ sun / np.linalg.norm(sun) < 0.9]
    expected = emitted(emitter, directions, variant)
    # averages over a texel of 6°, in a sky without edges
    np.testing.assert_allclose(light.lookup(directions), expected, rtol=0.03, atol=0.003)


@pytest.mark.parametrize("sun", [(0, 0, 1), (0, -1, 0), (0, np.nan, 0), (1, 2)])
def test_suns_that_are_refused(sun: tuple[float, ...], llvm: None) -> None:
    """Skies are baked in vectorised variants."""
    with pytest.raises(InputError, match="sun_direction"):
        sunsky(16, sun_direction=sun)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"turbidity": 100}, r"turbidity=100; accepted: a number in \[1, 10\]\. 3 is"),
        ({"turbidity": np.nan}, "turbidity=nan; accepted"),
        ({"turbidity": "clear"}, "turbidity='clear'; accepted"),
        ({"sun_scal": 2.0}, r"'sun_scal' is unknown; accepted: .*Did you mean 'sun_scale'"),
        ({"albedo": 2.0}, r"albedo.*must be in \[0, 1\].*; accepted: values that Mitsuba"),
        ({"sun_scale": np.nan}, "sun_scale=nan; accepted: finite"),
        ({"sun_aperture": "wide"}, r"sun_aperture.*; accepted: values that Mitsuba"),
        ({"width": 16.0}, r"width=16\.0, oversampling=4; accepted: an even integer width"),
        ({"width": 15}, "width=15, oversampling=4; accepted"),
        ({"oversampling": 0}, "width=16, oversampling=0; accepted"),
        ({"oversampling": 1.5}, r"oversampling=1\.5; accepted"),
    ],
)
def test_options_of_sunsky_that_are_refused(
    llvm: None, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        sunsky(**{"width": 16, **options})


def test_options_of_sunsky(llvm: None) -> None:
    brighter = sunsky(16, sky_scale=2.0, sun_scale=2.0)
    np.testing.assert_allclose(brighter.radiance, 2.0 * sunsky(16).radiance, rtol=1e-4)
    hazy, clear = sunsky(16, turbidity=10), sunsky(16, turbidity=np.float32(2.0), complex_sun=True)
    assert total(clear)[0] > total(hazy)[0]
    # a single direction in a texel of the zenith is the zenith
    coarse = sunsky(32, sun_direction=(1.0, 0.5, 0.0), oversampling=1).radiance[0]
    np.testing.assert_allclose(coarse, np.tile(coarse[0], (32, 1)), rtol=1e-3)
    assert np.all(coarse > 0.0)


@pytest.mark.parametrize("width", [8.0, "8", True, 2, 7, 10**6, [8]])
def test_widths_that_are_refused(width: Any) -> None:
    city(8)  # 8.0 is not taken for it
    with pytest.raises(InputError, match=r"width=.*accepted: an even integer width"):
        city(width)
    if width != 10**6:  # which means no change
        with pytest.raises(InputError, match=r"width=.*accepted: an even integer ≥ 4"):
            random_map().resized(width)


@pytest.mark.parametrize(
    "size", [(1,), (3,), (0,), (8.0,), ("8",), (8, 1), (0, 4), (8, 4.0), (-4, -2)]
)
def test_sizes_of_directions_that_are_refused(size: tuple[Any, ...]) -> None:
    with pytest.raises(InputError, match=r"width=.*accepted: an integer width ≥ 1 and height ≥ 2"):
        texel_directions(*size)


def test_smallest_directions() -> None:
    np.testing.assert_allclose(texel_directions(1, 2)[:, 0], [[0, 1, 0], [0, -1, 0]], atol=1e-15)
    assert texel_directions(np.int64(4)).shape == (2, 4, 3)


@pytest.mark.parametrize("columns", [1.0, 0.5, "1", None])
def test_turns_that_are_refused(columns: Any) -> None:
    with pytest.raises(InputError, match=r"columns=.*accepted: an integer"):
        random_map().turned(columns)

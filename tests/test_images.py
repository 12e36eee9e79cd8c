"""EXR files, display encoding and image differences."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fresnel_decomp import images
from fresnel_decomp._check import InputError
from fresnel_decomp.colour import linear_to_srgb


@pytest.fixture
def picture() -> np.ndarray:
    """A picture with every kind of value that a render can hold."""
    values = np.random.default_rng(1).lognormal(-1.0, 1.5, (24, 37, 3)).astype(np.float32)
    values[0, 0] = [0.0, 1e-30, 6.0e4]
    values[0, 1] = [-0.25, 1e10, 1.0]  # out of gamut; beyond half precision
    return values


def test_exr_round_trip(tmp_path: Path, picture: np.ndarray) -> None:
    path = tmp_path / "picture.exr"
    images.write_exr(path, picture, {"software": "a test", "recipe": "talk"})
    np.testing.assert_array_equal(images.read_exr(path), picture)
    attributes = images.read_exr_attributes(path)
    assert attributes["software"] == "a test"
    assert attributes["recipe"] == "talk"
    assert [p.name for p in tmp_path.iterdir()] == ["picture.exr"]


def test_exr_is_read_by_mitsuba(tmp_path: Path, picture: np.ndarray) -> None:
    import mitsuba as mi

    path = tmp_path / "picture.exr"
    images.write_exr(path, picture)
    bitmap = mi.Bitmap(str(path))
    assert bitmap.component_format() == mi.Struct.Type.Float32
    assert bitmap.pixel_format() == mi.Bitmap.PixelFormat.RGB
    np.testing.assert_array_equal(np.array(bitmap), picture)


def test_exr_by_mitsuba_is_read(tmp_path: Path, picture: np.ndarray) -> None:
    import mitsuba as mi

    path = tmp_path / "picture.exr"
    mi.Bitmap(picture).write(str(path))
    np.testing.assert_array_equal(images.read_exr(path), picture)


def test_exr_planes(tmp_path: Path, picture: np.ndarray) -> None:
    images.write_exr(tmp_path / "map.exr", picture[..., 1])
    read = images.read_exr(tmp_path / "map.exr")
    np.testing.assert_array_equal(read, np.repeat(picture[..., 1:2], 3, axis=2))
    images.write_exr(tmp_path / "named.exr", {"flip": picture[..., 0]})
    np.testing.assert_array_equal(images.read_exr(tmp_path / "named.exr")[..., 2], picture[..., 0])


def test_exr_bad_input(tmp_path: Path) -> None:
    bad: list[Any] = [np.zeros((4, 4, 2)), np.zeros(3), np.zeros((0, 4, 3)), {}]
    for image in bad:
        with pytest.raises(InputError):
            images.write_exr(tmp_path / "bad.exr", image)
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="cannot read"):
        images.read_exr(tmp_path / "missing.exr")
    (tmp_path / "text.exr").write_text("not an image")
    with pytest.raises(InputError, match="cannot read"):
        images.read_exr_attributes(tmp_path / "text.exr")
    images.write_exr(tmp_path / "two.exr", {"a": np.ones((2, 2)), "b": np.ones((2, 2))})
    with pytest.raises(InputError, match="channels a, b"):
        images.read_exr(tmp_path / "two.exr")


def test_display_exposes_and_clips() -> None:
    grey = np.full((2, 2, 3), 0.25)
    np.testing.assert_allclose(images.display(grey, 2.0), 1.0)
    np.testing.assert_allclose(images.display(grey, 9.0), 1.0)
    np.testing.assert_allclose(images.display(-grey), 0.0)
    np.testing.assert_allclose(images.display(grey), linear_to_srgb(0.25), rtol=1e-6)


def test_identical_images_do_not_differ(picture: np.ndarray) -> None:
    difference = images.compare(picture, picture)
    assert difference.summary() == {"flip": 0.0, "delta_e": 0.0, "rmse": 0.0, "nrmse": 0.0}
    assert not difference.flip_map.any()
    assert not difference.signed_map.any()
    assert difference.flip_map.shape == difference.signed_map.shape == picture.shape[:2]


def test_flip_sees_what_the_display_shows() -> None:
    dark = np.full((32, 32, 3), 0.2, np.float32)
    mean, values = images.flip(dark, dark * 1.5)
    assert values.shape == (32, 32)
    assert mean == pytest.approx(values.mean(), rel=1e-6)
    assert 0.05 < mean < 0.5
    assert images.flip(dark, dark * 1.01)[0] < mean
    assert images.flip(dark * 8, dark * 12)[0] == 0.0  # both are clipped to white
    half = dark.copy()
    half[:, 16:] *= 2
    far = images.flip(dark, half, pixels_per_degree=67.0)[1]
    assert far[:, -1].min() > 0.1
    assert far[:, 0].max() < 0.01


def test_rmse_and_sign() -> None:
    reference = np.full((3, 4, 3), 0.5)
    assert images.rmse(reference, reference + 0.1) == pytest.approx(0.1, rel=1e-6)
    assert images.nrmse(reference, reference - 0.1) == pytest.approx(0.2, rel=1e-6)
    np.testing.assert_allclose(images.signed_difference(reference, reference + 0.1), 0.1, rtol=1e-6)
    green = reference + np.array([0.0, 0.1, 0.0])
    np.testing.assert_allclose(images.signed_difference(reference, green), 0.0715169, rtol=1e-5)


def test_delta_e_follows_the_exposure() -> None:
    reference = np.full((2, 2, 3), 0.3)
    test = reference * [1.1, 1.0, 0.9]
    assert images.delta_e(reference, test).shape == (2, 2)
    assert images.delta_e(reference, test).min() > 1.0
    assert images.delta_e(reference, test, exposure=4.0).max() == 0.0  # all white


def test_bad_images() -> None:
    good = np.ones((4, 4, 3))
    with pytest.raises(InputError, match="one shape"):
        images.rmse(good, np.ones((4, 5, 3)))
    with pytest.raises(InputError, match=r"height, width, 3"):
        images.flip(np.ones((4, 4)), np.ones((4, 4)))
    with pytest.raises(InputError, match="not finite"):
        images.flip(good, good * np.nan)
    with pytest.raises(InputError, match="pixels_per_degree"):
        images.flip(good, good, pixels_per_degree=0)
    with pytest.raises(InputError, match="light"):
        images.nrmse(good * 0, good)


def test_grid_is_drawn_whole(tmp_path: Path, picture: np.ndarray) -> None:
    import sys

    from fresnel_decomp.report.renders import RenderRow, draw_renders

    light = np.clip(np.abs(picture), 0, 1)
    row = RenderRow.compute("Be, α = 0.1", {"exact": light, "schlick": light * 0.9})
    pyplot = "matplotlib.pyplot" in sys.modules
    draw_renders([row, row], tmp_path / "renders.png", "A title")
    assert ("matplotlib.pyplot" in sys.modules) == pyplot
    once = (tmp_path / "renders.png").read_bytes()
    draw_renders([row, row], tmp_path / "renders.png", "A title")
    assert (tmp_path / "renders.png").read_bytes() == once
    assert [p.name for p in tmp_path.iterdir()] == ["renders.png"]
    with pytest.raises(InputError, match="at least one row"):
        draw_renders([], tmp_path / "none.png")
    with pytest.raises(InputError, match="without 'exact'"):
        RenderRow.compute("x", {"schlick": light})


def test_colour_bars_end_at_round_numbers() -> None:
    from fresnel_decomp.report.style import nice_limit

    assert [nice_limit(x) for x in (0.0, 1.0, 0.0015, 0.055, 7.5)] == pytest.approx(
        [1.0, 1.0, 0.0016, 0.06, 8.0]
    )

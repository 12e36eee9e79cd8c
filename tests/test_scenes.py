"""The studio and the shader ball: lights, loading and reproducibility."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fresnel_decomp._check import InputError
from fresnel_decomp.mitsuba import scenes

METAL: dict[str, Any] = {"type": "roughconductor", "material": "Cr", "alpha": 0.2}


def test_lights_are_bounded_and_neutral() -> None:
    image = scenes.studio_lights()
    assert image.shape == (512, 1024, 3)
    assert image.min() > 0.05
    assert image.max() < 3.0
    np.testing.assert_array_equal(image[..., 0], image[..., 2])
    assert np.abs(image[:, 0] - image[:, -1]).max() < 0.1  # no seam
    assert not image.flags.writeable


@pytest.mark.parametrize("name", list(scenes.SCENES))
def test_scenes_render_the_same_twice(variant: str, name: str) -> None:
    import mitsuba as mi

    scene = scenes.load_scene(name, METAL, size=(20, 16))
    first = np.array(mi.render(scene, spp=4, seed=3))
    assert first.shape == (16, 20, 3)
    assert np.isfinite(first).all()
    assert first.min() > 0.0  # no black holes
    assert first.max() < 3.0  # no fireflies
    again = scenes.load_scene(name, METAL, size=(20, 16))
    np.testing.assert_array_equal(np.array(mi.render(again, spp=4, seed=3)), first)
    assert np.any(np.array(mi.render(scene, spp=4, seed=4)) != first)


def test_lights_are_where_their_docstring_says(variant: str) -> None:
    """A mirror sphere sees the key light on its upper left and the horseshoe along its top."""
    import mitsuba as mi

    mirror = {"type": "conductor", "material": "none"}
    image = np.array(mi.render(scenes.load_scene("studio", mirror, size=64), spp=4))[..., 1]
    assert image[20, 24] > 2.0  # key
    assert image[7, 32] == pytest.approx(0.95, abs=0.1)  # horseshoe
    assert image[30, 32] < 0.6  # front of the ball: what is behind the camera


def test_russian_roulette_never_starts(variant: str) -> None:
    for make in scenes.SCENES.values():
        integrator = make(METAL, 16)["integrator"]
        assert integrator["rr_depth"] > integrator["max_depth"]


def test_bad_input(variant: str) -> None:
    with pytest.raises(InputError, match="shader-ball"):
        scenes.load_scene("shaderball", METAL)
    for size in (0, 2.5, (8,), "8"):
        with pytest.raises(InputError, match="size"):
            scenes.load_scene("studio", METAL, size=size)

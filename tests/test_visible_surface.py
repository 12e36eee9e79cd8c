"""What a camera sees: points, normals, directions and shapes of scenes that are known in full."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from fresnel_decomp._check import InputError
from fresnel_decomp.mitsuba.visible_surface import averaged, visible_surface, where

EYE = np.array([0.0, 0.0, 6.0])


def scene(size: int = 12) -> mi.Scene:
    """A unit sphere, and a smaller one behind it."""
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": {
                "type": "perspective",
                "fov": 25.0,
                "to_world": mi.ScalarTransform4f().look_at(EYE.tolist(), [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": size, "height": size},
            },
            "ball": {"type": "sphere"},
            "hidden": {"type": "sphere", "center": [0.0, 0.0, -2.0], "radius": 0.5},
        }
    )


def rows(vectors: object) -> np.ndarray:
    """(n, 3), whatever the variant has."""
    array = np.array(vectors, np.float64)
    return array if array.shape[1] == 3 else array.T


def test_a_sphere_is_where_it_is(variant: str) -> None:
    surface = visible_surface(scene(), 4)
    assert (surface.size, surface.spp, set(surface.names)) == ((12, 12), 4, {"ball", "hidden"})
    shape = np.array(surface.shape)
    assert set(shape.tolist()) == {-1, surface.names.index("ball")}
    seen = shape >= 0
    position, normal, view = map(rows, (surface.position, surface.normal, surface.view))
    np.testing.assert_allclose(normal[seen], position[seen], atol=1e-5)
    towards = EYE - position[seen]
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    np.testing.assert_allclose(view[seen], towards, atol=1e-5)
    # the cone that touches the sphere, on the picture; samples are stratified
    radius = np.tan(np.arcsin(1.0 / 6.0)) / np.tan(np.radians(12.5))
    assert surface.coverage().mean() == pytest.approx(np.pi * radius**2 / 4.0, abs=0.02)


def test_seeds_jitter(variant: str) -> None:
    first, again, other = (rows(visible_surface(scene(), 4, seed).view) for seed in (0, 0, 1))
    assert (first == again).all()
    assert (first != other).any()


def test_pictures_are_means_of_samples(variant: str) -> None:
    surface = visible_surface(scene(), 4)
    if variant.startswith("scalar"):
        black, white = (np.full((len(surface.shape), 3), c) for c in (0.0, 1.0))
    else:
        black, white = ((mi.Float(c),) * 3 for c in (0.0, 1.0))
    picture = np.array(averaged(surface, where(surface.shape >= 0, white, black)))
    np.testing.assert_allclose(picture, surface.coverage()[..., None].repeat(3, 2), atol=1e-6)


def test_what_is_refused(variant: str) -> None:
    for spp in (12, 0, -4, 4.0, "4"):
        with pytest.raises(InputError, match=r"spp=.*; accepted: a square number"):
            visible_surface(scene(), spp)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="seed=-1; accepted: an integer"):
        visible_surface(scene(), 4, seed=-1)
    blind = mi.load_dict({"type": "scene", "object": {"type": "sphere"}})
    with pytest.raises(InputError, match=r"a scene without a sensor; accepted: .*Add a"):
        visible_surface(blind, 4)

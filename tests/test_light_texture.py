"""The light as one texture, against the light that it was made of."""

from __future__ import annotations

import numpy as np
import pytest

from fresnel_decomp._check import InputError
from fresnel_decomp.mitsuba.prefilter import PrefilteredLight, blurred, prefilter
from fresnel_decomp.mitsuba.skies import city
from test_environment import random_directions


def layered(width: int, levels: int) -> PrefilteredLight:
    source = city(width)
    maps = (blurred(source, (i / (levels - 1)) ** 2) for i in range(1, levels))
    return PrefilteredLight("city", (source.radiance, *maps))


def found(texture: object, direction: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Lookups of the active variant, scalar ones one by one."""
    import drjit as dr
    import mitsuba as mi

    if dr.is_jit_v(mi.Float):
        parts = [mi.Float(np.ascontiguousarray(c, np.float32)) for c in direction.T]
        rgb = texture.lookup(parts, mi.Float(np.asarray(alpha, np.float32)))
        return np.stack([np.array(channel) for channel in rgb], axis=-1)
    return np.array([texture.lookup(d, float(a)) for d, a in zip(direction, alpha, strict=True)])


def test_same_as_the_light(variant: str) -> None:
    """Between texels, layers and across the left edge; at the poles; alpha is clamped."""
    from fresnel_decomp.mitsuba.light_texture import LightTexture

    light = layered(32, 4)
    random = np.random.default_rng(2)
    turn = np.linspace(-0.25, 0.25, 9)  # about the left edge, where columns join
    edge = np.stack([np.sin(turn), 0.3 + 0.0 * turn, -np.cos(turn)], axis=1) / np.hypot(1.0, 0.3)
    poles = [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]
    direction = np.concatenate([random_directions(60), edge, poles])
    alpha = np.concatenate([random.random(len(direction) - 2), [-1.0, 2.0]])
    expected = light.lookup(direction, np.clip(alpha, 0.0, 1.0))
    # float32: the position errs by 1e-6 of the map's width, and the sun is 70
    np.testing.assert_allclose(
        found(LightTexture(light), direction, alpha), expected, rtol=2e-4, atol=2e-3
    )


def test_maps_of_several_sizes(variant: str) -> None:
    """They are interpolated once more; `light` is what is looked up."""
    from fresnel_decomp.mitsuba.light_texture import LightTexture

    light = prefilter(city(256), levels=4)
    assert len({level.shape for level in light.levels}) > 1
    texture = LightTexture(light, width=64)
    assert {level.shape for level in texture.light.levels} == {(32, 64, 3)}
    direction, alpha = random_directions(20), np.full(20, 0.6)
    result = found(texture, direction, alpha)
    np.testing.assert_allclose(result, texture.light.lookup(direction, alpha), rtol=1e-4)
    # the maps are smooth at this roughness: the layers differ little from them
    np.testing.assert_allclose(result, light.lookup(direction, alpha), rtol=0.02)


def test_shading_takes_it(variant: str) -> None:
    """`shade` gives with the texture what it gives with the light."""
    import drjit as dr
    import mitsuba as mi

    if not dr.is_jit_v(mi.Float):
        pytest.skip("shade takes vectors of arrays")
    from fresnel_decomp.mitsuba.light_texture import LightTexture
    from fresnel_decomp.mitsuba.split_sum import shade
    from fresnel_decomp.split_albedo import schlick_albedo, schlick_table

    light, albedo = layered(32, 4), schlick_albedo([1.0, 0.8, 0.3], schlick_table(16))
    normal, view = random_directions(30), random_directions(30, seed=9)
    columns = [
        [mi.Float(np.ascontiguousarray(c, np.float32)) for c in vectors.T]
        for vectors in (normal, view)
    ]
    result = shade(LightTexture(light), albedo, *columns, mi.Float(0.4))
    expected = shade(light, albedo, normal, view, 0.4)
    np.testing.assert_allclose(np.array(mi.Color3f(*result)).T, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("width", [0, 3, 7, 32.0])
def test_bad_width(width: object, variant: str) -> None:
    from fresnel_decomp.mitsuba.light_texture import LightTexture

    with pytest.raises(InputError, match="width"):
        LightTexture(layered(16, 2), width=width)

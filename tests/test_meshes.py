"""Surfaces of revolution: closed, facing outward, with the normals of what they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from fresnel_decomp.mitsuba import meshes


@pytest.mark.parametrize("name", ["plinth", "collar", "ball"])
def test_meshes_are_watertight_and_face_outward(name: str) -> None:
    positions, normals, faces = meshes._geometry(name)
    assert faces.max() == len(positions) - 1
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    codes = directed[:, 0].astype(np.int64) * len(positions) + directed[:, 1]
    twins = directed[:, 1].astype(np.int64) * len(positions) + directed[:, 0]
    assert len(np.unique(codes)) == len(codes)  # each edge once in this direction
    np.testing.assert_array_equal(np.sort(codes), np.sort(twins))  # and once in the other
    assert len(positions) - len(codes) // 2 + len(faces) == 2  # Euler: a sphere's topology

    corners = positions[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    assert np.linalg.norm(area, axis=1).min() > 0
    assert np.einsum("fi,fi->", corners.mean(axis=1), area) / 3 > 0  # volume: outward
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    assert np.einsum("fi,fvi->fv", area, normals[faces]).min() > 0


def test_revolved_sphere_is_a_sphere() -> None:
    t = np.linspace(0.0, np.pi, 200)
    radius = np.sin(t)
    radius[-1] = 0.0
    positions, normals, faces = meshes.revolve(radius, np.cos(t), 128)
    np.testing.assert_allclose(normals, positions, atol=1e-12)
    corners = positions[faces]
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume == pytest.approx(4 / 3 * np.pi, rel=2e-3)

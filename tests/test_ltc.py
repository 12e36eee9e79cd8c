"""Linearly transformed cosines: the lobe itself, the table that ships, and how it is fitted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from backends import AD_BACKENDS, float_type
from fresnel_decomp import InputError, directional_albedo
from fresnel_decomp.ltc import LEAST_ALPHA, LobeTable, load_lobes
from fresnel_decomp.ltc_fit import fit_column, fit_lobe, lobe_samples
from fresnel_decomp.table_layout import Layout

VIEWS = [(1.0, 0.5), (0.7, 0.3), (0.4, 0.6), (0.15, 0.25), (0.5, 1.0)]


def hemisphere(count: int = 1200) -> tuple[np.ndarray, np.ndarray]:
    """Directions of a midpoint rule over z and azimuth, and their solid angle."""
    z = (np.arange(count) + 0.5) / count
    turn = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    z, turn = np.meshgrid(z, turn)
    radius = np.sqrt(1.0 - z * z)
    directions = np.stack([radius * np.cos(turn), radius * np.sin(turn), z])
    return directions, np.full(z.shape, 2.0 * np.pi / count**2)


@pytest.mark.parametrize(("mu", "alpha"), VIEWS)
def test_lobes_have_integral_one(mu: float, alpha: float) -> None:
    """Also where much of them would be below the horizon."""
    directions, weight = hemisphere()
    density = load_lobes().lobe(mu, alpha).density(tuple(directions))
    assert (density * weight).sum() == pytest.approx(1.0, abs=2e-4)


@pytest.mark.parametrize(("mu", "alpha"), VIEWS)
def test_lobes_are_near_the_brdf(mu: float, alpha: float) -> None:
    """Against another quadrature than the fit's: the share of light that goes the wrong way."""
    from fresnel_decomp.microfacet import half_vector, masking_shadowing, ndf

    directions, weight = hemisphere(600)
    view = (np.sqrt(1.0 - mu * mu), 0.0, mu)
    flat = directions.reshape(3, -1)
    normal, _ = half_vector(tuple(flat), tuple(np.full(flat.shape[1], c) for c in view))
    brdf = ndf(normal, alpha) * masking_shadowing(flat[2], mu, alpha) / (4.0 * mu)
    albedo = directional_albedo(lambda c: 1.0 + 0.0 * c, mu, alpha)
    assert brdf @ weight.ravel() == pytest.approx(albedo, rel=1e-3)
    lobe = load_lobes().lobe(mu, alpha).density(tuple(flat))
    wrong = 0.5 * np.abs(brdf / albedo - lobe) @ weight.ravel()
    assert wrong < (0.06 if mu > 0.3 else 0.23)


@pytest.mark.parametrize("mu", [1.0, 0.6, 0.2, 0.0])
@pytest.mark.parametrize("alpha", [LEAST_ALPHA, 0.01, 0.3, 1.0])
def test_samples_have_the_albedo_of_the_table(mu: float, alpha: float) -> None:
    """Two quadratures that share nothing; 2,048 lattice points err by up to 1e-3."""
    white = directional_albedo(lambda c: 1.0 + 0.0 * c, mu, alpha)
    assert lobe_samples(mu, alpha).albedo == pytest.approx(white, abs=1.5e-3)


def test_smooth_lobes_are_exact() -> None:
    """GGX over slopes is a cosine over the tangent plane: n0 = n3 = 1 and n1 = 0."""
    for mu in (0.9, 0.5):
        fit = fit_lobe(mu, 3e-4)
        assert fit.distance < 2e-3
        assert np.array(fit.residual)[[0, 1, 3]] == pytest.approx([1.0, 0.0, 1.0], abs=5e-3)


def test_isotropic_at_normal_incidence() -> None:
    table = load_lobes()
    assert np.all(table.values[:, -1, 0] == 1.0)
    k00, k02, k11, k20, _ = table.lobe(1.0, 0.4).inverse
    assert k00 == pytest.approx(k11, rel=1e-6)
    assert k02 == k20 == 0.0


def test_the_table_is_smooth_and_keeps_orientation() -> None:
    """No texel jumps but at grazing incidence, where two lobes are about equally near."""
    values = load_lobes().values
    inner = values[:, 20:]  # mu > 0.1
    assert np.abs(np.diff(inner, axis=0)).max() < 0.25
    assert np.abs(np.diff(inner, axis=1)).max() < 0.25
    mu, alpha = np.meshgrid(np.linspace(0, 1, 97), np.linspace(0, 1, 95))
    assert np.all(load_lobes().lobe(mu, alpha).determinant > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("column", [10, 40, 63])
def test_what_ships_is_what_the_fit_gives(column: int) -> None:
    table = load_lobes()
    fits = fit_column(float(table.layout.mu[column]), table.layout.alpha)
    found = np.array([fit.residual for fit in fits])
    # another machine's rounding may end a search elsewhere in a flat valley
    np.testing.assert_allclose(found, table.values[:, column], atol=5e-3)
    assert all(fit.converged for fit in fits)


def test_lobes_between_texels() -> None:
    """Interpolation costs little beside the fit: the wrong share there, against a new fit."""
    table = load_lobes()
    for mu, alpha in ((0.553, 0.31), (0.304, 0.11), (0.985, 0.2)):
        samples = lobe_samples(mu, alpha)
        lobe = table.lobe(mu, alpha).density(tuple(samples.direction))
        wrong = 0.5 * samples.weight @ np.abs(samples.lobe - lobe)
        start = tuple(float(v) for v in table.values[int(63 * alpha**0.5), int(63 * mu**0.5)])
        assert wrong < fit_lobe(mu, alpha, start=start).distance + 3e-3  # type: ignore[arg-type]


def test_directions_there_and_back() -> None:
    lobe = load_lobes().lobe(0.3, 0.4)
    w = (0.36, 0.48, 0.8)
    back = np.array(lobe.from_cosine(lobe.to_cosine(w)))
    np.testing.assert_allclose(back / np.linalg.norm(back), w, rtol=1e-12)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_drjit(backend: str) -> None:
    """As NumPy does it; derivatives in mu and alpha by differences, and finite at the ends."""
    import drjit as dr

    kind = float_type(backend, "float64")
    mu = np.array([0.0, 0.33, 0.71, 0.95, 1.0])
    alpha = np.array([0.2, 0.31, 0.0, 0.5, 1.0])
    w = (-0.6, 0.3, float(np.sqrt(1.0 - 0.45)))
    arrays = [kind(mu), kind(alpha)]
    dr.enable_grad(arrays)
    density = load_lobes().lobe(*arrays).density(w)
    expected = load_lobes().lobe(mu, alpha).density(w)
    np.testing.assert_allclose(np.array(density), expected, rtol=1e-5)
    dr.backward(dr.sum(density))
    for which, array in enumerate(arrays):
        slope = np.array(dr.grad(array))
        assert np.isfinite(slope).all()
        h = 1e-6
        up, down = (
            load_lobes().lobe(mu + by * (which == 0), alpha + by * (which == 1)).density(w)
            for by in (h, -h)
        )
        inside = [1, 3]
        np.testing.assert_allclose(slope[inside], ((up - down) / (2 * h))[inside], rtol=2e-3)


def test_files(tmp_path: Path) -> None:
    table = load_lobes()
    table.save(tmp_path / "lobes.npz")
    again = LobeTable.load(tmp_path / "lobes.npz")
    assert again.sha256 == table.sha256
    assert again.smith == "separable"
    assert again.metadata["measure"] == table.metadata["measure"]
    data = (tmp_path / "lobes.npz").read_bytes()
    (tmp_path / "half.npz").write_bytes(data[: len(data) // 2])
    for name, text in (("half.npz", "is no table of lobes"), ("none.npz", "no file")):
        with pytest.raises(InputError, match=text):
            LobeTable.load(tmp_path / name)
    with pytest.raises(InputError, match="format"):
        table.save(tmp_path / "lobes.exr")
    with np.load(tmp_path / "lobes.npz") as file:
        np.savez(tmp_path / "other.npz", values=file["values"] * 0.999, metadata=file["metadata"])
    with pytest.raises(InputError, match="do not match the hash"):
        LobeTable.load(tmp_path / "other.npz")


def test_input_that_is_refused() -> None:
    with pytest.raises(InputError, match=r"does not ship.*fit_ltc\.py --smith correlated"):
        load_lobes("correlated")
    values = load_lobes().values
    with pytest.raises(InputError, match=r"\(64, 64, 4\)"):
        LobeTable(values[..., :3], Layout())
    with pytest.raises(InputError, match="determinant that is not positive"):
        LobeTable(values * [-1.0, 1.0, 1.0, 1.0], Layout())
    with pytest.raises(InputError, match="ascending"):
        fit_column(0.5, np.array([0.5, 0.1]))
    with pytest.raises(InputError, match="count=3"):
        fit_column(0.5, np.array([0.1]), count=3)

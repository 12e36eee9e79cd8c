"""Energy compensation: averages, both lobes against quadrature and the random walk, limits."""

from __future__ import annotations

import numpy as np
import pytest

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import AlbedoTable, InputError, conductor, directional_albedo, load_basis
from fresnel_decomp.albedo import average_albedo, average_fresnel
from fresnel_decomp.anisotropy import AnisotropicGrid, anisotropic_albedo
from fresnel_decomp.energy import (
    EnergyTable,
    fdez_aguera,
    gain,
    kulla_conty,
    lobe,
    missing,
    scaling,
    turquin,
)
from fresnel_decomp.microfacet import DISTRIBUTIONS, SMITH
from fresnel_decomp.random_walk import random_walk_albedo

BASIS = load_basis()
METALS = {"Be": (3.2, 3.1), "Au blue": (1.43, 1.85), "Al": (0.96, 6.7)}
ONE = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module", params=SMITH)
def energy(request):
    return EnergyTable.of(AlbedoTable.bake(BASIS, smith=request.param), BASIS)


def test_average_fresnel_is_that_of_the_basis():
    energy = EnergyTable.of(AlbedoTable.bake(BASIS, size=8), BASIS)
    for eta, k in METALS.values():
        c = BASIS.coefficients(eta, k)
        expected = average_fresnel(lambda x, c=c: BASIS.evaluate(c, x))
        assert energy.average_fresnel(c) == pytest.approx(expected, abs=1e-12)
        exact = average_fresnel(lambda x, eta=eta, k=k: conductor(x, eta, k), 256)
        assert energy.average_fresnel(c) == pytest.approx(exact, abs=2e-3)


def test_average_fresnel_in_closed_form():
    """2 ∫ (1 - x)^5 x dx = 1/21 and 2 ∫ x² (1 - x)^6 dx = 1/126."""

    def functions(x):
        return np.stack([1.0 + 0.0 * x, (1.0 - x) ** 5, -x * (1.0 - x) ** 6], axis=-1)

    energy = EnergyTable.of(AlbedoTable.bake(functions, size=8), functions)
    np.testing.assert_allclose(energy.averages, [1.0, 1.0 / 21.0, -1.0 / 126.0], atol=1e-14)


def test_loss_is_that_of_the_table(energy):
    alpha = np.array([0.05, 0.2, 0.6, 1.0])
    expected = 1.0 - average_albedo(lambda c: 1.0 + 0.0 * c, alpha, smith=energy.table.smith)
    found = energy.losses.lookup(alpha, alpha)[:, 0]
    np.testing.assert_allclose(found, expected, atol=4e-4)  # that of interpolation


def test_baked_is_averaged():
    """Correlated shadowing unless said otherwise; averages as of the same table."""
    baked = EnergyTable.bake(BASIS, 16)
    assert baked.table.smith == baked.losses.smith == "correlated"
    other = EnergyTable.bake(BASIS, 16, "separable", distribution="beckmann")
    assert (other.table.smith, other.table.distribution) == ("separable", "beckmann")
    assert np.all(other.losses.values[1:, 0, 0] != baked.losses.values[1:, 0, 0])
    again = EnergyTable.of(AlbedoTable.bake(BASIS, 16, "correlated"), BASIS)
    np.testing.assert_array_equal(again.losses.values, baked.losses.values)


@pytest.mark.parametrize("layout", [{"mu_axis": "mu"}, {"addressing": "edges"}])
def test_other_layouts_have_the_same_averages(layout):
    """To the error of interpolation, which is larger for an axis in mu."""
    found = EnergyTable.of(AlbedoTable.bake(BASIS, **layout), BASIS).losses
    usual = EnergyTable.of(AlbedoTable.bake(BASIS), BASIS).losses
    alpha = np.array([0.05, 0.2, 0.6, 0.9])
    np.testing.assert_allclose(
        found.lookup(alpha, alpha), usual.lookup(alpha, alpha), rtol=0.02, atol=2e-3
    )


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("smith", SMITH)
def test_white_furnace(smith, distribution):
    """The lobe's energy by integration of the *exact* loss: within 1 %, and by far."""
    table = AlbedoTable.bake(BASIS, smith=smith, distribution=distribution)
    energy = EnergyTable.of(table, BASIS)
    x, weight = np.polynomial.legendre.leggauss(64)
    root = 0.5 * (x + 1.0)
    mu_o = root * root
    cosine_weight = 0.5 * weight * 2.0 * root * mu_o * 2.0 * np.pi  # of cos d omega
    mu = np.array([0.01, 0.03, 0.1, 0.3, 0.6, 1.0])
    for alpha in (0.013, 0.1, 0.31, 0.62, 1.0):
        single = directional_albedo(
            lambda c: 1.0 + 0.0 * c, mu, alpha, smith=smith, distribution=distribution
        )
        sides = [missing(table.lookup(m, np.full(m.shape, alpha))[:, 0]) for m in (mu, mu_o)]
        loss = energy.losses.lookup(alpha, alpha)[0]
        second = lobe(sides[0][:, None], sides[1], loss) @ cosine_weight
        np.testing.assert_allclose(single + second, 1.0, atol=6e-3)
        assert np.all(np.abs(single + second - 1.0)[mu >= 0.1] < 2e-3)
        np.testing.assert_allclose(energy.albedo(ONE, mu, np.full(6, alpha)), 1.0, atol=1e-12)


def test_both_lobes_have_one_albedo(energy):
    """The coloured lobe, integrated over the hemisphere, is what the scaling adds."""
    x, weight = np.polynomial.legendre.leggauss(64)
    root = 0.5 * (x + 1.0)
    mu_o = root * root
    cosine_weight = 0.5 * weight * 2.0 * root * mu_o * 2.0 * np.pi
    mu, alpha = np.array([0.05, 0.4, 1.0]), float(energy.table.layout.alpha[45])
    for eta, k in METALS.values():
        c = BASIS.coefficients(eta, k)
        near, far = (energy.table.lookup(m, np.full(m.shape, alpha)) for m in (mu, mu_o))
        ends = [functions @ c / functions[:, 0] for functions in (near, far)]
        loss = energy.losses.lookup(alpha, alpha)[0]
        colour = ends[0][:, None] * ends[1] * gain(energy.average_fresnel(c), loss)
        shape = lobe(missing(near[:, 0])[:, None], missing(far[:, 0]), loss)
        expected = near @ c + (colour * shape) @ cosine_weight
        np.testing.assert_allclose(energy.albedo(c, mu, np.full(3, alpha)), expected, atol=2e-4)


@pytest.mark.parametrize("alpha", [0.03, 0.1, 0.3, 0.6])
def test_albedo_is_that_of_the_random_walk(alpha):
    """Within .03 at all angles with correlated Smith; single scattering is far off."""
    energy = EnergyTable.of(AlbedoTable.bake(BASIS, smith="correlated"), BASIS)
    indices = np.array(list(METALS.values())).T

    def f(cos_theta):
        return conductor(np.asarray(cos_theta)[..., None], *indices)

    coefficients, worst = BASIS.coefficients(*indices), 0.0
    for seed, mu in enumerate((0.02, 0.06, 0.15, 0.4, 1.0)):
        walk = random_walk_albedo(f, mu, alpha, 20_000, seed=seed)
        found = energy.albedo(coefficients, np.full(3, mu), np.full(3, alpha))
        assert np.all(np.abs(found - walk.albedo) < 0.03 + 3.0 * walk.standard_error)
        single = energy.table.evaluate(coefficients, np.full(3, mu), np.full(3, alpha))
        worst = max(worst, float(np.max(walk.albedo - single)))
    assert worst > 0.08


def test_published_forms():
    e, f, loss = 0.7, 0.8, 0.2
    assert kulla_conty(f * e, e, loss, f) == pytest.approx(f * e + 0.3 * f * f * 0.8 / 0.84)
    assert fdez_aguera(f * e, e, f) == pytest.approx(f * e / (1.0 - f * 0.3))
    assert turquin(f * e, e, f) == pytest.approx(f * e * (1.0 + f * 0.3 / 0.7))
    for found in (kulla_conty(e, e, loss, 1.0), fdez_aguera(e, e, 1.0), turquin(e, e, 1.0)):
        assert found == pytest.approx(1.0)
    # the series that it sums: reflected n times among microfacets, n >= 2
    series = sum(f**n * loss ** (n - 2) for n in range(2, 200)) * (1.0 - loss)
    assert f * f * gain(f, loss) == pytest.approx(series)


def test_limits(energy):
    gold = BASIS.coefficients(0.18, 3.4)
    assert energy.factor(0.0 * ONE, 0.5) == 0.0
    assert energy.factor(ONE, np.array([0.0, 1e-9, 0.3, 1.0])) == pytest.approx(1.0)
    near = energy.factor(gold, np.array([0.0, 1e-12, 1e-6, 1e-4]))
    np.testing.assert_allclose(near, near[0], rtol=1e-5)
    assert energy.albedo(gold, 1.0, 0.0) == pytest.approx(gold[0], abs=1e-6)
    assert missing(1.0 + 1e-7) == 0.0
    assert lobe(0.0, 0.0, 0.0) == 0.0
    assert scaling(1.0, 0.5) == 1.0


@pytest.mark.parametrize("backend", BACKENDS)
def test_drjit(energy, backend):
    kind = float_type(backend)
    mu, alpha = np.array([0.1, 0.5, 1.0]), np.array([0.0, 0.3, 1.0])
    c = BASIS.coefficients(1.43, 1.85)
    found = energy.albedo([kind(float(v)) for v in c], kind(mu.tolist()), kind(alpha.tolist()))
    np.testing.assert_allclose(np.array(found), energy.albedo(c, mu, alpha), atol=2e-6)


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradients(backend):
    import drjit as dr

    kind = float_type(backend, "float64")
    energy = EnergyTable.of(AlbedoTable.bake(BASIS), BASIS)
    # in the middle of texels: between them the slope jumps
    alpha, mu = ((np.array([0.5, 20.5, 40.5, 62.5]) / 63.0) ** 2 for _ in range(2))
    c = BASIS.coefficients(1.43, 1.85)
    values = [kind(alpha), kind(mu), *(kind(float(v)) for v in c)]
    for i, step in enumerate([1e-6] * 2 + [1e-4] * 4):
        given = [kind(v) for v in values]
        dr.enable_grad(given[i])
        result = energy.albedo(given[2:], given[1], given[0])
        dr.forward(given[i])
        ends = []
        for sign in (1.0, -1.0):
            moved = [np.array(v) for v in values]
            moved[i] = moved[i] + sign * step
            row = np.stack(np.broadcast_arrays(*moved[2:]), axis=-1)
            row = np.broadcast_to(row, (4, 4))
            ends.append(energy.albedo(row, moved[1], moved[0]))
        expected = (ends[0] - ends[1]) / (2.0 * step)
        found = np.array(dr.grad(result)) * np.ones(4)
        np.testing.assert_allclose(found, expected, rtol=2e-4, atol=1e-6)
    # at the ends, all finite
    edge = kind([0.0, 0.0, 1.0])
    dr.enable_grad(edge)
    result = energy.albedo(values[2:], kind([0.0, 1.0, 1.0]), edge)
    dr.backward(result)
    assert np.isfinite(np.array(dr.grad(edge))).all()


def test_bad_input():
    table = AlbedoTable.bake(BASIS, size=4)
    with pytest.raises(InputError, match="not 1"):
        EnergyTable.of(table, lambda c: BASIS(c)[..., ::-1])
    with pytest.raises(InputError, match="functions"):
        EnergyTable.of(table, load_basis("talk", 5))
    with pytest.raises(InputError, match=r"a ClosedForm as table.*EnergyTable\.bake"):
        EnergyTable.of(BASIS.closed_form, BASIS)  # type: ignore[arg-type]


# --- two roughnesses -----------------------------------------------------------------------------


def white(cos_theta):
    return np.ones((*np.shape(cos_theta), 1))


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("smith", SMITH)
def test_equal_roughnesses_are_one(smith, distribution):
    mu, alpha = np.array([0.05, 0.3, 0.7, 1.0]), np.array([0.1, 0.5, 0.9, 0.3])
    sine = np.sqrt(1.0 - mu * mu)
    towards = np.stack([sine * np.cos(1.0), sine * np.sin(1.0), mu], axis=-1)
    options = {"smith": smith, "distribution": distribution}
    found = anisotropic_albedo(white, towards, alpha, alpha, samples=4096, **options)[:, 0]
    expected = directional_albedo(lambda c: 1.0 + 0.0 * c, mu, alpha, **options)
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_two_roughnesses_by_another_estimator():
    """Normals by their distribution, whether they are visible or not."""
    a, b, mu, phi, n = 0.2, 0.6, 0.5, 0.4, 400_000
    s = np.sqrt(1.0 - mu * mu)
    wo = np.array([s * np.cos(phi), s * np.sin(phi), mu])
    u1, u2 = np.random.default_rng(0).random((2, n))
    slope = np.sqrt(u1 / (1.0 - u1))
    h = np.stack([-a * slope * np.cos(2 * np.pi * u2), -b * slope * np.sin(2 * np.pi * u2),
                  np.ones(n)])  # fmt: skip
    h /= np.sqrt((h * h).sum(axis=0))
    cosine = wo @ h
    wi = 2.0 * cosine * h - wo[:, None]

    def g1(w):
        tangent = (a * a * w[0] ** 2 + b * b * w[1] ** 2) / w[2] ** 2
        return 2.0 / (1.0 + np.sqrt(1.0 + tangent))

    weight = np.where((cosine > 0.0) & (wi[2] > 0.0), cosine / (mu * h[2]) * g1(wo) * g1(wi), 0.0)
    error = weight.std() / np.sqrt(n)
    found = anisotropic_albedo(white, wo[None], np.array([a]), np.array([b]), samples=4096)[0, 0]
    assert abs(found - weight.mean()) < 4.0 * error + 1e-3


def test_views_of_two_roughnesses_that_are_no_such():
    up, alpha = np.array([[0.0, 0.0, 1.0]]), np.array([0.3])
    with pytest.raises(InputError, match="samples=100; accepted: a power of 2"):
        anisotropic_albedo(white, up, alpha, alpha, samples=100)
    with pytest.raises(InputError, match=r"of shapes \(1, 3\), \(2,\), \(1,\)"):
        anisotropic_albedo(white, up, np.full(2, 0.3), alpha)
    with pytest.raises(InputError, match="smith='seperable'"):
        anisotropic_albedo(white, up, alpha, alpha, smith="seperable")


def test_a_grid_spans_what_is_asked_for():
    grid = AnisotropicGrid.bake(white, (0.1, 0.1), (0.2, 0.4))
    assert grid.values.shape[:2] == (2, 5)
    assert grid.root_u[0] < 0.1**0.5 < grid.root_u[1]
    np.testing.assert_allclose(grid.root_v, np.sqrt([0.2, 0.4]))
    assert np.all((grid.losses[..., 0] > 0.02) & (grid.losses[..., 0] < 0.25))
    one = AnisotropicGrid.bake(white, (0.3, 0.3), (0.3, 0.3)).losses.mean()
    isotropic = 1.0 - average_albedo(lambda c: 1.0 + 0.0 * c, 0.3)
    assert one == pytest.approx(isotropic, abs=1e-3)


def test_no_single_roughness_will_do():
    mu, azimuth = (grid.ravel() for grid in np.meshgrid([0.05, 0.2, 0.5, 1.0], [0.0, 0.8, 1.57]))
    sine = np.sqrt(1.0 - mu * mu)
    towards = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), mu], axis=-1)
    n = len(mu)
    found = anisotropic_albedo(white, towards, np.full(n, 0.15), np.full(n, 0.4))[:, 0]
    alpha = np.linspace(0.15, 0.4, 26)[:, None]
    single = directional_albedo(lambda c: 1.0 + 0.0 * c, mu, alpha)
    assert np.abs(single - found).max(axis=1).min() > 0.03

"""Directional albedo: reference tables, closed forms, limits, sampling estimators, gradients."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import InputError, conductor, dielectric, directional_albedo, load_basis
from fresnel_decomp.albedo import ROUGHEST, average_albedo, average_fresnel
from fresnel_decomp.albedo_estimates import monte_carlo_albedo, quasi_monte_carlo_albedo
from fresnel_decomp.albedo_refined import refined_albedo
from fresnel_decomp.microfacet import DISTRIBUTIONS, SMITH

cases = pytest.mark.parametrize(
    ("distribution", "smith"), [(d, s) for d in DISTRIBUTIONS for s in SMITH]
)
compiled = pytest.mark.parametrize(  # kernels take seconds to compile: quick runs have two of four
    ("distribution", "smith"),
    [
        ("ggx", "separable"),
        ("beckmann", "correlated"),
        pytest.param("ggx", "correlated", marks=pytest.mark.slow),
        pytest.param("beckmann", "separable", marks=pytest.mark.slow),
    ],
)
# every hard corner once: grazing, smooth, both, rough
MU = np.array([0.0, 0.0, 1e-9, 1e-4, 0.01, 0.01, 0.2, 0.7, 1.0, 1.0, 0.3])
ALPHA = np.array([0.05, 1.0, 0.3, 0.02, 1e-3, 0.9, 0.5, 1e-6, 1.0, 0.1, 0.0])


def white(cos_theta):
    return 1.0 + 0.0 * cos_theta


def schlick(cos_theta):
    return (1.0 - cos_theta) ** 5


@pytest.mark.parametrize("smith", SMITH)
def test_reference_table(reference, smith):
    """Every row of `albedo.csv`. The indices of its metals were fitted: two numbers for 96 rows."""
    with open(reference / "albedo.csv", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["smith"] == smith]
    assert len(rows) == {"separable": 52, "correlated": 44}[smith]
    mu, alpha = (np.array([float(row[name]) for row in rows]) for name in ("mu", "alpha"))
    columns = {
        "white": white,
        "schlick5": schlick,
        "n1.5": lambda c: dielectric(c, 1.5),
        "Be_r": lambda c: conductor(c, 4.17288918, 3.8482102),
        "Au_g": lambda c: conductor(c, 0.3774229, 2.38469977),
        "Cr_b": lambda c: conductor(c, 1.66204972, 3.75205985),
    }
    for name, f in columns.items():
        expected = np.array([float(row[name]) for row in rows])
        error = np.abs(directional_albedo(f, mu, alpha, smith=smith) - expected).max()
        assert error <= 2e-6, name


def test_closed_form():
    """Separable GGX, F = 1, alpha = 1, normal incidence: E = 1 - ln 2."""
    assert directional_albedo(white, 1.0, 1.0) == pytest.approx(1.0 - math.log(2.0), abs=1e-12)


@cases
def test_converged(distribution, smith):
    """The default rule against one of 96 x 96 nodes, on the hard corners, for sharp curves."""

    def f(cos_theta):
        return np.stack([white(cos_theta), schlick(cos_theta), dielectric(cos_theta, 1.2)], -1)

    options = {"smith": smith, "distribution": distribution}
    finer = directional_albedo(f, MU, ALPHA, **options, quadrature=(96, 96))
    assert np.abs(directional_albedo(f, MU, ALPHA, **options) - finer).max() <= 2e-6
    # where a search found the largest error, of correlated GGX
    finer = directional_albedo(f, 2.3e-5, 0.368, **options, quadrature=(96, 96))
    assert np.abs(directional_albedo(f, 2.3e-5, 0.368, **options) - finer).max() <= 3e-6


@cases
@pytest.mark.parametrize(("mu", "alpha"), [(1.0, 0.5), (0.3, 1.0), (0.02, 0.1), (0.0, 0.6)])
def test_estimators_agree(distribution, smith, mu, alpha):
    """Sampling shares nothing with the rule: within 5 standard errors of it."""
    options = {"smith": smith, "distribution": distribution}

    def f(cos_theta):
        return np.stack([white(cos_theta), schlick(cos_theta)], axis=-1)

    exact = directional_albedo(f, mu, alpha, **options)
    plain = monte_carlo_albedo(f, mu, alpha, 50_000, **options)
    quasi = quasi_monte_carlo_albedo(f, mu, alpha, 2048, **options)
    floor = 3e-7  # of Beckmann's slopes, the outermost are cut off on both sides
    assert np.all(np.abs(plain.value - exact) <= 5.0 * plain.standard_error + floor)
    assert np.all(np.abs(quasi.value - exact) <= 5.0 * quasi.standard_error + floor)
    noisy = plain.standard_error > 1e-6
    assert np.all(quasi.standard_error[noisy] < plain.standard_error[noisy])


@pytest.mark.parametrize("eta", [0.5, 0.7, 0.9])
def test_refined_at_a_critical_angle(eta):
    """The default nodes err by up to .014; refined ones by less than they say, against sampling."""

    def inside(cos_theta):
        return dielectric(cos_theta, eta)

    mu = np.array([0.0335, 0.7, 0.3, 0.72, 1.0, 0.0])
    alpha = np.array([0.718, 0.02, 0.3, 0.1, 0.05, 0.5])
    sampled = quasi_monte_carlo_albedo(inside, mu, alpha, 1 << 13)
    noise = 5.0 * sampled.standard_error
    plain = directional_albedo(inside, mu, alpha)
    assert np.abs(plain - sampled.value).max() > 1e-3
    for tolerance in (1e-2, 1e-3, 1e-5):
        refined = refined_albedo(inside, mu, alpha, tolerance=tolerance)
        assert refined.error.shape == (6,)
        assert np.all(np.abs(refined.value - sampled.value) <= refined.error + noise)
    assert refined.quadrature == (512, 384)
    assert refined.error.max() < 1e-3


def test_refined_of_smooth_curves():
    refined = refined_albedo(load_basis(), MU, ALPHA, tolerance=3e-6)
    assert refined.value.shape == refined.error.shape == (*MU.shape, 4)
    assert refined.error.max() <= 3e-6
    assert refined.quadrature == (128, 96)
    mirror = refined_albedo(schlick, 0.3, 0.0)
    assert mirror.value == pytest.approx(schlick(0.3))
    assert mirror.error == 0.0
    for tolerance in (0.0, math.nan, "fine"):
        with pytest.raises(InputError, match="tolerance="):
            refined_albedo(white, 0.5, 0.5, tolerance=tolerance)
    kind = float_type("scalar")
    with pytest.raises(InputError, match=r"a Dr\.Jit array"):
        refined_albedo(white, kind([0.5]), 0.5)


@cases
def test_white_furnace(distribution, smith):
    """Nothing is gained, single scattering loses; correlated masking loses less."""
    mu, alpha = np.meshgrid(np.linspace(0.0, 1.0, 12) ** 2, np.linspace(0.0, 1.0, 9) ** 2)
    e = directional_albedo(white, mu, alpha, smith=smith, distribution=distribution)
    assert e.min() > 0.1
    assert e.max() <= 1.0 + 1e-6
    np.testing.assert_array_equal(e[0], 1.0)


def test_conventions_differ():
    """By up to 2 ln 2 - 1 = .39 in bbar_0: rough surfaces, seen at grazing angles."""
    mu, alpha = np.meshgrid([0.0, 0.01, 0.1, 0.5], [0.1, 0.3, 1.0])
    difference = directional_albedo(white, mu, alpha, smith="correlated") - directional_albedo(
        white, mu, alpha
    )
    assert difference.min() > 0.0
    assert difference.max() == pytest.approx(2.0 * math.log(2.0) - 1.0, abs=1e-6)


def test_limits():
    """alpha = 0 is f itself, bit for bit; small alpha and mu approach their limits smoothly."""
    basis = load_basis()
    mu = np.array([0.0, 1e-6, 0.1, 1.0])
    np.testing.assert_array_equal(directional_albedo(basis, mu, np.zeros(4)), basis(mu))
    smooth = directional_albedo(basis, mu[2:], 1e-4)
    np.testing.assert_allclose(smooth, basis(mu[2:]), atol=1e-5)
    # the corner has no limit: along mu = 0 the white albedo tends to another value than 1
    assert directional_albedo(white, 0.0, 1e-6) == pytest.approx(0.936, abs=5e-4)
    assert directional_albedo(white, 1e-6, 0.0) == 1.0
    for alpha in (0.02, 0.5):
        at_zero = directional_albedo(basis, 0.0, alpha)
        near = directional_albedo(basis, 1e-7, alpha)
        np.testing.assert_allclose(near, at_zero, atol=1e-5)


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(1.01, 3.0), st.floats(0.0, 8.0))
def test_linear_and_bounded(mu, alpha, eta, k):
    """Linear in F, between the extremes of F times the white albedo."""
    options = {"quadrature": (16, 16)}

    def f(cos_theta):
        return conductor(cos_theta, eta, k)

    albedo = directional_albedo(f, mu, alpha, **options)
    rest = directional_albedo(lambda c: 1.0 - f(c), mu, alpha, **options)
    e = directional_albedo(white, mu, alpha, **options)
    assert albedo + rest == pytest.approx(e, abs=1e-12)
    low = min(f(float(c)) for c in np.linspace(0.0, 1.0, 65))
    assert low * e - 1e-3 <= albedo <= e + 1e-12


def test_shapes_and_types():
    basis = load_basis()
    eta = np.array([1.5, 2.0, 3.0])
    mu = np.array([[0.1], [0.9]])
    per_material = directional_albedo(lambda c: dielectric(c, eta), mu + 0.0 * eta, 0.3)
    assert per_material.shape == (2, 3)
    assert per_material[1, 2] == pytest.approx(
        directional_albedo(lambda c: dielectric(c, 3.0), 0.9, 0.3), abs=1e-14
    )
    assert directional_albedo(basis, mu, 0.3).shape == (2, 1, 4)
    assert isinstance(directional_albedo(white, 0.5, 0.5), float)
    assert directional_albedo(white, mu.astype(np.float32), np.float32(0.3)).dtype == np.float32


def test_bad_input():
    for arguments, words in (
        ((1.2, 0.5), "mu=1.2"),
        ((0.5, -0.1), "alpha=-0.1"),
        ((float("nan"), 0.5), "mu=nan"),
    ):
        with pytest.raises(InputError, match=words):
            directional_albedo(white, *arguments)
    with pytest.raises(InputError, match="Did you mean 'separable'"):
        directional_albedo(white, 0.5, 0.5, smith="seperable")
    with pytest.raises(InputError, match="the first one even"):
        directional_albedo(white, 0.5, 0.5, quadrature=(15, 16))
    result = directional_albedo(
        white, np.array([-0.5, 2.0, np.nan, 0.5]), np.array([0.1, 0.1, 0.1, -1])
    )
    np.testing.assert_array_equal(np.isnan(result), [False, False, True, True])
    assert result[0] == directional_albedo(white, 0.0, 0.1)
    with pytest.raises(InputError, match="mu or alpha out of range"):
        monte_carlo_albedo(white, 0.5, 0.0, 10)
    with pytest.raises(InputError, match="samples=1"):
        monte_carlo_albedo(white, 0.5, 0.5, 1)


NOT_REAL = ["rough", None, True, 0.5 + 0.1j, np.array([1j]), [[0.1], [0.1, 0.2]], "0.5"]


@pytest.mark.parametrize("wrong", NOT_REAL, ids=repr)
def test_arguments_that_are_not_real(wrong):
    calls = (
        lambda: directional_albedo(white, wrong, 0.5),
        lambda: directional_albedo(white, 0.5, wrong),
        lambda: refined_albedo(white, wrong, 0.5),
        lambda: average_albedo(white, wrong),
        lambda: monte_carlo_albedo(white, wrong, 0.5, 16),
        lambda: quasi_monte_carlo_albedo(white, 0.5, wrong, 16),
    )
    for call in calls:
        with pytest.raises(InputError, match="accepted: real numbers"):
            call()


def test_shapes_that_do_not_fit():
    for call in (directional_albedo, lambda *a: monte_carlo_albedo(*a, 16)):
        with pytest.raises(InputError, match=r"mu and alpha of shapes \(3,\), \(2,\)"):
            call(white, np.full(3, 0.5), np.full(2, 0.5))
    kind = float_type("llvm")
    with pytest.raises(InputError, match="mu and alpha of sizes 2, 3"):
        directional_albedo(white, kind([0.1, 0.2, 0.3]), kind([0.1, 0.2]))
    with pytest.raises(InputError, match=r"a Dr\.Jit array"):
        monte_carlo_albedo(white, kind([0.1]), 0.5, 16)
    assert len(directional_albedo(white, kind([0.1, 0.2]), kind([0.1]))) == 2


@pytest.mark.parametrize("wrong", [5, (4.0, 4.0), (4, 4, 4), "fine", (0, 8), (8, 1024)])
def test_wrong_quadrature(wrong):
    with pytest.raises(InputError, match=r"quadrature=.* the first one even"):
        directional_albedo(white, 0.5, 0.5, quadrature=wrong)


def test_numbers_of_nodes_and_samples():
    plain = directional_albedo(white, 0.5, 0.5, quadrature=(8, 8))
    assert directional_albedo(white, 0.5, 0.5, quadrature=(np.int64(8), 8)) == plain
    for wrong in (0, 2.5, "many", 513):
        with pytest.raises(InputError, match="nodes="):
            average_fresnel(white, wrong)
        with pytest.raises(InputError, match="nodes="):
            average_albedo(white, 0.5, nodes=wrong)
    with pytest.raises(InputError, match=r"samples=10\.5"):
        quasi_monte_carlo_albedo(white, 0.5, 0.5, 10.5)
    with pytest.raises(InputError, match="at 64 cosines"):
        average_fresnel(lambda c: np.ones((3, len(c))))


def test_constants_and_extremes():
    """Curves that ignore the cosine, of mirrors too; the largest roughness, without a warning."""
    for alpha in (0.0, 0.5, np.array([0.0, 0.5])):
        np.testing.assert_array_equal(
            directional_albedo(lambda _: 0.3, 0.5, alpha),
            directional_albedo(lambda c: 0.3 + 0.0 * c, 0.5, alpha),
        )
    assert average_fresnel(lambda _: 0.3) == pytest.approx(0.3)
    for distribution in DISTRIBUTIONS:
        for smith in SMITH:
            options = {"distribution": distribution, "smith": smith}
            assert 0.0 <= directional_albedo(white, 0.5, ROUGHEST, **options) < 1e-3
    with pytest.raises(InputError, match=r"alpha=1e\+100"):
        directional_albedo(white, 0.5, 1e100)
    assert np.isnan(directional_albedo(white, 0.5, np.array([1e100])))[0]


def test_averages():
    """<F> of Schlick's curve is F0 + (1 - F0)/21; E averages to the hemispherical albedo."""
    assert average_fresnel(lambda c: 0.04 + 0.96 * schlick(c)) == pytest.approx(0.04 + 0.96 / 21)
    assert average_fresnel(load_basis()).shape == (4,)
    alpha = np.array([0.0, 0.25, 1.0])
    averages = average_albedo(load_basis(), alpha)
    assert averages.shape == (3, 4)
    np.testing.assert_allclose(averages[0], average_fresnel(load_basis()), atol=1e-6)
    mu = (np.arange(2000) + 0.5) / 2000
    midpoint = 2.0 * (directional_albedo(white, mu, 0.25, quadrature=(16, 16)) * mu).mean()
    assert averages[1, 0] == pytest.approx(midpoint, abs=1e-5)


@compiled
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_drjit_agrees(distribution, smith, backend, precision):
    if backend == "scalar" and distribution == "beckmann":
        pytest.skip("one case is enough: a Python loop over all nodes")
    kind = float_type(backend, precision)
    basis = load_basis()
    options = {"smith": smith, "distribution": distribution}
    expected = directional_albedo(basis, MU, ALPHA, **options)
    mu, alpha = kind(MU.tolist()), kind(ALPHA.tolist())
    result = directional_albedo(basis, mu, alpha, **options)
    assert isinstance(result, tuple)
    assert len(result) == 4
    # float32 has cosines of 1e-7 and sums 768 terms
    tolerance = 1e-5 if precision == "float32" else 1e-11
    np.testing.assert_allclose(
        np.stack([np.array(v) for v in result], -1), expected, atol=tolerance
    )


def _f(cos_theta):
    return conductor(cos_theta, 1.5, 2.0)


@compiled
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradients_inside(distribution, smith, backend):
    """float64, forward and backward, against central differences of the NumPy values."""
    import drjit as dr

    kind = float_type(backend, "float64")
    options = {"smith": smith, "distribution": distribution}
    mu, alpha = (v.ravel() for v in np.meshgrid([1e-3, 0.1, 0.9], [0.01, 0.3, 0.9]))
    h = 1e-5
    for which in (0, 1):
        backward, forward = _slopes(dr, kind, mu, alpha, which, options)
        np.testing.assert_allclose(forward, backward, rtol=1e-7, atol=1e-9)

        def moved(by, which=which):
            return directional_albedo(_f, mu + by * (1 - which), alpha + by * which, **options)

        near, far = moved(h) - moved(-h), moved(2.0 * h) - moved(-2.0 * h)
        difference = (8.0 * near - far) / (12.0 * h)
        np.testing.assert_allclose(backward, difference, rtol=1e-5, atol=1e-6)


@compiled
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradients_on_the_borders(distribution, smith, precision, backend):
    """Finite for mu -> 0 and alpha -> 0, alike in both modes, right at mu = 1 and alpha = 0."""
    import drjit as dr

    kind = float_type(backend, precision)
    options = {"smith": smith, "distribution": distribution}
    mu, alpha = (v.ravel() for v in np.meshgrid([0.0, 1e-6, 0.3, 1.0], [0.0, 1e-6, 1e-3, 0.4, 1.0]))
    tolerance = 1e-3 if precision == "float32" else 1e-6
    slopes = []
    for which in (0, 1):
        backward, forward = _slopes(dr, kind, mu, alpha, which, options)
        assert np.all(np.isfinite(backward))
        assert np.all(np.isfinite(forward))
        # at mu = 0 the slope wrt a small alpha is a difference of terms a million times larger
        same = (mu > 0.0) | (alpha != 1e-6) | (precision == "float64")
        np.testing.assert_allclose(forward[same], backward[same], rtol=tolerance, atol=tolerance)
        slopes.append(backward)
    h = 1e-5
    # one-sided, second order
    at_one = mu == 1.0
    parts = [directional_albedo(_f, 1.0 - i * h, alpha[at_one], **options) for i in range(3)]
    difference = (3.0 * parts[0] - 4.0 * parts[1] + parts[2]) / (2.0 * h)
    np.testing.assert_allclose(slopes[0][at_one], difference, atol=2e-4)
    smooth = alpha == 0.0
    np.testing.assert_array_equal(slopes[1][smooth], 0.0)
    curve = kind(mu[smooth])
    dr.enable_grad(curve)
    dr.backward(_f(curve))
    np.testing.assert_allclose(slopes[0][smooth], np.array(curve.grad), rtol=1e-6)


def _slopes(dr, kind, mu, alpha, which, options):
    arrays = [kind(mu), kind(alpha)]
    dr.enable_grad(arrays[which])
    dr.backward(directional_albedo(_f, *arrays, **options))
    backward = np.array(arrays[which].grad)
    arrays = [kind(mu), kind(alpha)]
    dr.enable_grad(arrays[which])
    dr.set_grad(arrays[which], 1.0)
    return backward, np.array(dr.forward_to(directional_albedo(_f, *arrays, **options)))


@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradients_of_coefficients(backend):
    """Linear: the derivative wrt c_i is bbar_i, in both modes."""
    import drjit as dr

    kind = float_type(backend, "float64")
    basis = load_basis()
    mu, alpha = kind([0.1, 0.7]), kind([0.4, 0.2])
    expected = directional_albedo(basis, np.array([0.1, 0.7]), np.array([0.4, 0.2]))

    def albedo(coefficients):
        return directional_albedo(lambda c: basis.evaluate(coefficients, c), mu, alpha)

    coefficients = [kind(float(c)) for c in basis.coefficients(1.5, 2.0)]
    dr.enable_grad(coefficients)
    dr.backward(albedo(coefficients))
    gradient = [np.array(c.grad)[0] for c in coefficients]
    np.testing.assert_allclose(gradient, expected.sum(axis=0), atol=1e-10)
    for i in range(4):
        coefficients = [kind(float(c)) for c in basis.coefficients(1.5, 2.0)]
        dr.enable_grad(coefficients[i])
        dr.set_grad(coefficients[i], 1.0)
        forward = np.array(dr.forward_to(albedo(coefficients)))
        np.testing.assert_allclose(forward, expected[:, i], atol=1e-10)

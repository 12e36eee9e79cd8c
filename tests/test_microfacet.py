"""Microfacet terms against their definitions, and at their limits: values and gradients."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, special

from backends import AD_BACKENDS, BACKENDS, float_type
from fresnel_decomp import InputError
from fresnel_decomp.microfacet import (
    DISTRIBUTIONS,
    SMITH,
    half_vector,
    masking,
    masking_shadowing,
    ndf,
    projected_area,
    reflect,
    sample_visible_normal,
    shadowing,
    smith_lambda,
)

both = pytest.mark.parametrize("distribution", DISTRIBUTIONS)
COSINES = np.concatenate([[0.0, 1e-12, 1e-6, 1e-3], np.linspace(0.01, 1.0, 34)])
ALPHAS = np.array([0.0, 1e-9, 1e-6, 1e-3, 0.02, 0.2, 0.5, 1.0])


def direction(theta, phi=0.3):
    sine = math.sin(theta)
    return sine * math.cos(phi), sine * math.sin(phi), math.cos(theta)


def textbook_lambda(theta, alpha, distribution):
    """Walter et al. 2007 and Heitz 2014, as printed: for benign angles."""
    a = 1.0 / (alpha * np.tan(theta))
    if distribution == "ggx":
        return 0.5 * (np.sqrt(1.0 + 1.0 / a**2) - 1.0)
    return 0.5 * (special.erf(a) - 1.0) + np.exp(-(a**2)) / (2.0 * a * math.sqrt(math.pi))


@both
@pytest.mark.parametrize("alpha", [0.01, 0.3, 1.0])
def test_density_is_normalized(distribution, alpha):
    """Integral of D cos over the hemisphere is 1; over the slope, where it is smooth."""

    def integrand(u):
        t = alpha * u / (1.0 - u)  # tan theta
        theta = math.atan(t)
        jacobian = alpha / (1.0 - u) ** 2 * math.cos(theta) ** 2
        d = float(ndf(direction(theta), alpha, distribution))
        return 2.0 * math.pi * d * math.cos(theta) * math.sin(theta) * jacobian

    total, _ = integrate.quad(integrand, 0.0, 1.0 - 1e-9, epsabs=1e-8)
    assert total == pytest.approx(1.0, abs=1e-7)


@both
@pytest.mark.parametrize(("mu", "alpha"), [(1.0, 0.7), (0.7, 0.1), (0.05, 0.7)])
def test_masking_conserves_the_projected_area(distribution, mu, alpha):
    """Smith's condition: the visible part of ∫ <w·h> D dh is the projected area."""
    sine = math.sqrt(1.0 - mu * mu)
    t, wt = np.polynomial.legendre.leggauss(160)
    u = 0.5 * (t + 1.0)
    slope, dslope = alpha * u / (1.0 - u), alpha / (1.0 - u) ** 2 * 0.5 * wt
    phi = 2.0 * math.pi * (np.arange(240) + 0.5) / 240
    s, p = np.meshgrid(slope, phi, indexing="ij")
    cos = 1.0 / np.sqrt(1.0 + s * s)
    normal = (s * cos * np.cos(p), s * cos * np.sin(p), cos)
    facing = np.maximum(sine * normal[0] + mu * normal[2], 0.0)
    density = ndf(normal, alpha, distribution) * facing * s * cos**3 * (2.0 * math.pi / 240)
    area = float((density.sum(axis=1) * dslope).sum())
    assert float(projected_area(mu, alpha, distribution)) == pytest.approx(area, abs=2e-5)


@both
def test_lambda_as_printed(distribution):
    theta, alpha = np.meshgrid(np.linspace(0.1, 1.5, 15), [0.1, 0.4, 1.0])
    expected = textbook_lambda(theta, alpha, distribution)
    cos = np.cos(theta)
    np.testing.assert_allclose(smith_lambda(cos, alpha, distribution), expected, 1e-9, 1e-14)
    np.testing.assert_allclose(masking(cos, alpha, distribution), 1 / (1 + expected), 1e-12)
    other = textbook_lambda(0.8, alpha, distribution)
    np.testing.assert_allclose(
        masking_shadowing(cos, math.cos(0.8), alpha, "correlated", distribution),
        1.0 / (1.0 + expected + other),
        1e-12,
    )
    np.testing.assert_allclose(
        masking_shadowing(cos, math.cos(0.8), alpha, "separable", distribution),
        1.0 / ((1.0 + expected) * (1.0 + other)),
        1e-12,
    )


@both
@pytest.mark.parametrize("smith", SMITH)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_limits(distribution, smith, dtype):
    """Every pair of hard cosines and roughnesses: finite, in [0, 1], symmetric, G2 <= G1."""
    i, o, alpha = (v.astype(dtype) for v in np.meshgrid(COSINES, COSINES, ALPHAS, indexing="ij"))
    g = masking_shadowing(i, o, alpha, smith, distribution)
    assert g.dtype == dtype
    assert np.all(np.isfinite(g))
    assert np.all((g >= 0.0) & (g <= 1.0))
    tolerance = 4.0 * np.finfo(dtype).eps
    np.testing.assert_allclose(
        g, masking_shadowing(o, i, alpha, smith, distribution), tolerance * 8, 1e-30
    )
    g1 = np.minimum(masking(i, alpha, distribution), masking(o, alpha, distribution))
    assert np.all(g <= g1 * (1.0 + tolerance))
    assert np.all(g[alpha == 0.0] == 1.0)
    assert np.all(g[(np.minimum(i, o) == 0.0) & (alpha > 0.0)] == 0.0)
    share = shadowing(i, o, alpha, smith, distribution)
    np.testing.assert_allclose(share * masking(o, alpha, distribution), g, 1e-5, 1e-30)


@both
def test_correlated_is_never_darker(distribution):
    i, o, alpha = np.meshgrid(COSINES, COSINES, ALPHAS[1:], indexing="ij")
    separable = masking_shadowing(i, o, alpha, "separable", distribution)
    correlated = masking_shadowing(i, o, alpha, "correlated", distribution)
    assert np.all(correlated >= separable * (1.0 - 1e-12))
    assert (correlated - separable).max() > 0.08


@both
@pytest.mark.parametrize("alpha", [1e-4, 1e-6, 1e-8])
def test_density_of_smooth_surfaces_in_float32(distribution, alpha):
    """A slope of alpha has half its peak (GGX: a quarter), where the cosine rounds to 1."""
    single = np.float32
    normal = (single(alpha), single(0.0), single(1.0))
    peak = ndf((single(0.0), single(0.0), single(1.0)), single(alpha), distribution)
    ratio = {"ggx": 0.25, "beckmann": math.exp(-1.0)}[distribution]
    assert peak == pytest.approx(1.0 / (math.pi * alpha**2), rel=1e-5)
    assert ndf(normal, single(alpha), distribution) / peak == pytest.approx(ratio, rel=1e-5)
    assert ndf((0.0, 0.6, -0.8), alpha, distribution) == 0.0


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_retroreflection(dtype):
    """wi = wo: the half vector is wo, the cosine 1, exactly."""
    rng = np.random.default_rng(2)
    z = np.concatenate([[0.0, 1.0, 1e-6], rng.random(2000)])
    phi = rng.random(z.size) * 2.0 * np.pi
    sine = np.sqrt((1.0 - z) * (1.0 + z))
    wo = tuple(v.astype(dtype) for v in (sine * np.cos(phi), sine * np.sin(phi), z))
    normal, cos_theta = half_vector(wo, wo)
    eps = np.finfo(dtype).eps
    assert np.abs(cos_theta - 1.0).max() <= 2.0 * eps
    assert np.all(cos_theta <= 1.0)
    for a, b in zip(normal, wo, strict=True):
        np.testing.assert_allclose(a, b, atol=2.0 * eps)
    back = reflect(wo, normal)
    for a, b in zip(back, wo, strict=True):
        np.testing.assert_allclose(a, b, atol=8.0 * eps)


def test_half_vector_of_grazing_and_opposite_directions():
    """Half the length of the sum keeps its digits where a dot product leaves none."""
    tiny = 1e-9
    wo = (math.sqrt(1.0 - tiny * tiny), 0.0, tiny)
    wi = (-wo[0], 0.0, tiny)
    normal, cos_theta = half_vector(wi, wo)
    assert cos_theta == pytest.approx(tiny, rel=1e-12)
    assert normal == pytest.approx((0.0, 0.0, 1.0))
    normal, cos_theta = half_vector((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    assert [float(v) for v in normal] == [0.0, 0.0, 1.0]
    assert cos_theta == 0.0


@both
@pytest.mark.parametrize(("mu", "alpha"), [(1.0, 0.8), (0.6, 0.05), (0.02, 0.8), (0.0, 0.3)])
def test_visible_normals_have_their_density(distribution, mu, alpha):
    """Averages of test functions against the projected area of D, within 5 standard errors."""
    u1, u2 = np.random.default_rng(7).random((2, 100_000))
    sine = math.sqrt(1.0 - mu * mu)
    wo = (0.6 * sine, 0.8 * sine, mu)
    x, y, z = sample_visible_normal(wo, alpha, u1, u2, distribution)
    np.testing.assert_allclose(x * x + y * y + z * z, 1.0, atol=1e-12)
    facing = wo[0] * x + wo[1] * y + wo[2] * z
    assert facing.min() >= -1e-12
    # ∫ visible density times h = ∫ over slopes by quadrature
    t, wt = np.polynomial.legendre.leggauss(160)
    u = 0.5 * (t + 1.0)
    slope, dslope = alpha * u / (1.0 - u), alpha / (1.0 - u) ** 2 * 0.5 * wt
    phi = 2.0 * math.pi * (np.arange(240) + 0.5) / 240
    s, p = np.meshgrid(slope, phi, indexing="ij")
    c = 1.0 / np.sqrt(1.0 + s * s)
    h = (s * c * np.cos(p), s * c * np.sin(p), c)
    weight = np.maximum(wo[0] * h[0] + wo[1] * h[1] + wo[2] * h[2], 0.0)
    weight *= ndf(h, alpha, distribution) * s * c**3 * dslope[:, None] * (2.0 * math.pi / 240)
    weight /= float(projected_area(mu, alpha, distribution))
    for sample, function in ((x, h[0]), (z, h[2]), (z**8, h[2] ** 8), (x * y, h[0] * h[1])):
        error = sample.std() / math.sqrt(sample.size)
        assert abs(sample.mean() - (weight * function).sum()) <= 5.0 * error + 2e-5


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("mu", [1.0, 0.5, 1e-3, 0.0])
def test_visible_normals_at_the_ends_of_the_range(distribution, dtype, mu):
    """u = 0 and the last float32 below 1 give unit normals that are seen, to a rounding."""
    ends = np.array([0.0, 2.0**-24, 0.5, 1.0 - 2.0**-24], dtype)
    u1, u2 = (u.ravel() for u in np.meshgrid(ends, ends))
    wo = tuple(np.full(u1.shape, c, dtype) for c in (np.sqrt(1.0 - mu * mu), 0.0, mu))
    for alpha in (0.05, 1.0):
        x, y, z = sample_visible_normal(wo, dtype(alpha), u1, u2, distribution)
        np.testing.assert_allclose(x * x + y * y + z * z, 1.0, atol=1e-6)
        assert np.all(z >= 0.0)
        if distribution == "beckmann" or dtype == np.float64:  # see `sample_visible_normal`
            assert np.all(wo[0] * x + wo[2] * z >= -1e-6)


@settings(max_examples=200, deadline=None)
@given(
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.floats(1e-6, 1.0),
    st.sampled_from(DISTRIBUTIONS),
)
def test_monotonic_in_roughness_and_angle(mu, other, alpha, distribution):
    """Rougher and more grazing means more masking."""
    g = masking(mu, alpha, distribution)
    assert masking(mu, 1.1 * alpha, distribution) <= g + 1e-15
    low, high = sorted((mu, other))
    assert masking(low, alpha, distribution) <= masking(high, alpha, distribution) + 1e-15
    assert mu <= projected_area(mu, alpha, distribution) <= max(mu, 1.0)


@both
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_drjit_agrees(distribution, backend, precision):
    kind = float_type(backend, precision)
    i, o, alpha = (v.ravel() for v in np.meshgrid(COSINES[1:], COSINES[1:], ALPHAS[2:]))
    arrays = [kind(v.tolist()) if backend == "scalar" else kind(v) for v in (i, o, alpha)]
    tolerance = 3e-6 if precision == "float32" else 1e-13
    for smith in SMITH:
        expected = masking_shadowing(i, o, alpha, smith, distribution)
        result = masking_shadowing(*arrays, smith, distribution)
        np.testing.assert_allclose(np.array(result), expected, atol=tolerance)
    u = [kind([0.1, 0.9]), kind([0.3, 0.999])]
    wo = (kind([0.6, 0.0]), kind([0.0, 1.0]), kind([0.8, 0.0]))
    result = sample_visible_normal(wo, kind([0.3, 0.9]), *u, distribution)
    expected = sample_visible_normal(
        tuple(np.array([a, b]) for a, b in ((0.6, 0.0), (0.0, 1.0), (0.8, 0.0))),
        np.array([0.3, 0.9]),
        np.array([0.1, 0.9]),
        np.array([0.3, 0.999]),
        distribution,
    )
    for a, b in zip(result, expected, strict=True):
        # Dr.Jit's erfinv has single precision in float64 too
        np.testing.assert_allclose(np.array(a), b, atol=max(10.0 * tolerance, 1e-7))


@both
@pytest.mark.parametrize("smith", SMITH)
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradients(distribution, smith, backend):
    """Against central differences inside; finite on the borders, forward and backward alike."""
    import drjit as dr

    kind = float_type(backend, "float64")
    i, o, alpha = (
        v.ravel() for v in np.meshgrid([0.0, 0.05, 0.4, 1.0], [0.0, 0.3, 1.0], [0.05, 0.4, 1.0])
    )
    step = 1e-5
    for argument in range(3):
        arrays = [kind(v) for v in (i, o, alpha)]
        dr.enable_grad(arrays[argument])
        dr.backward(masking_shadowing(*arrays, smith, distribution))
        backward = np.array(arrays[argument].grad)
        arrays = [kind(v) for v in (i, o, alpha)]
        dr.enable_grad(arrays[argument])
        dr.set_grad(arrays[argument], 1.0)
        forward = np.array(dr.forward_to(masking_shadowing(*arrays, smith, distribution)))
        assert np.all(np.isfinite(backward))
        np.testing.assert_allclose(forward, backward, atol=1e-12)
        plain = [i, o, alpha]
        inside = (plain[argument] > step) & (plain[argument] < 1.0 - step)

        def moved(by, plain=plain, argument=argument):
            values = list(plain)
            values[argument] = np.clip(values[argument] + by, 0.0, 1.0)
            return masking_shadowing(*values, smith, distribution)

        difference = (moved(step) - moved(-step)) / (2.0 * step)
        np.testing.assert_allclose(backward[inside], difference[inside], atol=2e-7)


@both
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("backend", AD_BACKENDS)
def test_gradients_are_finite(distribution, precision, backend):
    """Backward, at every pair of hard cosines and roughnesses, of every term."""
    import drjit as dr

    kind = float_type(backend, precision)
    i, o, alpha = (v.ravel() for v in np.meshgrid(COSINES[::3], COSINES[::3], ALPHAS))

    def direction_of(cosine, side):
        return side * dr.sqrt((1.0 - cosine) * (1.0 + cosine) + 1e-12), 0.0 * cosine, cosine

    terms = {
        "ndf": lambda i, o, alpha: ndf(direction_of(i, 1.0), alpha + 1e-9, distribution),
        "half vector": lambda i, o, alpha: half_vector(direction_of(i, 1.0), direction_of(o, -1.0))[
            1
        ],
        "projected area": lambda i, o, alpha: projected_area(i, alpha, distribution),
    }
    for smith in SMITH:
        options = (smith, distribution)
        terms[f"g2 {smith}"] = lambda *arrays, o=options: masking_shadowing(*arrays, *o)
        terms[f"shadowing {smith}"] = lambda *arrays, o=options: shadowing(*arrays, *o)
    for name, term in terms.items():
        arrays = [kind(v) for v in (i, o, alpha)]
        dr.enable_grad(arrays)
        dr.backward(term(*arrays))
        for array in arrays:
            assert np.all(np.isfinite(np.array(array.grad))), name


def test_unknown_names():
    with pytest.raises(InputError, match="Did you mean 'ggx'"):
        masking(0.5, 0.5, "ggxx")
    with pytest.raises(InputError, match="Did you mean 'correlated'"):
        masking_shadowing(0.5, 0.5, 0.5, "corelated")

"""What the BSDF plugins share: the microfacet lobe but for its Fresnel term, and Mueller matrices.

Directions are in the local frame; Smith's shadowing is uncorrelated, as Mitsuba has it, unless said
otherwise.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from .variants import unpolarized

__all__ = ["correlated", "mueller", "raised", "weight_and_density"]

_LEAST_COSINE = 1e-12
"""The squared tangent of a lower direction, and its derivatives, would leave float32."""


def weight_and_density(
    distr: Any, wi: Any, wo: Any, m: Any, sample_visible: bool, smith: str = "separable"
) -> tuple[Any, Any, Any]:
    """D, what multiplies the Fresnel term (the cosine included), and the density of `wo`.

    Parameters
    ----------
    distr : mi.MicrofacetDistribution
    wi, wo, m : mi.Vector3f
        Directions, both `raised`, and the half vector.
    sample_visible : bool
        Whether `distr` samples visible normals only.
    smith : {"separable", "correlated"}
    """
    cos_i = mi.Frame3f.cos_theta(wi)
    d = distr.eval(m)
    g1_i, g1_o = distr.smith_g1(wi, m), distr.smith_g1(wo, m)
    g = g1_i * g1_o if smith == "separable" else correlated(g1_i, g1_i, g1_o)
    weight = d * g / (4.0 * cos_i)
    if sample_visible:
        density = d * g1_i / (4.0 * cos_i)
    else:
        density = distr.pdf(wi, m) / (4.0 * dr.dot(wo, m))
    return d, weight, density


def correlated(g: Any, g_i: Any, g_o: Any) -> Any:
    """G2 of height-correlated Smith, times g / g_i, from the masking of both directions."""
    total = g_i + g_o - g_i * g_o
    some = total > 0.0
    return dr.select(some, g * g_o / dr.select(some, total, 1.0), 0.0)


def raised(direction: Any) -> Any:
    """The direction, or one just above the horizon instead of one on or below it.

    What is computed from it is finite, with finite derivatives, also where it is discarded.
    """
    return mi.Vector3f(direction.x, direction.y, dr.maximum(direction.z, _LEAST_COSINE))


def mueller(ctx: Any, wi: Any, wo: Any, m: Any, weight: Any, eta: Any, k: Any) -> Any:
    """Mueller matrix of specular reflection at `m`, between the Stokes bases of both rays."""
    radiance = ctx.mode == mi.TransportMode.Radiance
    incoming, outgoing = (-wo, wi) if radiance else (-wi, wo)
    s_in, s_out = dr.cross(m, incoming), dr.cross(m, outgoing)
    collinear = dr.all(s_in == mi.Vector3f(0))  # no plane of incidence: any axis will do
    s_in = dr.select(collinear, mi.Vector3f(1, 0, 0), dr.normalize(s_in))
    s_out = dr.select(collinear, mi.Vector3f(1, 0, 0), dr.normalize(s_out))
    frames = [
        *(incoming, s_in, mi.mueller.stokes_basis(incoming)),
        *(outgoing, s_out, mi.mueller.stokes_basis(outgoing)),
    ]
    channels = [
        mi.mueller.rotate_mueller_basis(
            mi.mueller.specular_reflection(dr.dot(-incoming, m), mi.Complex2f(*index)), *frames
        )
        for index in zip(eta, k, strict=True)
    ]
    result = dr.zeros(mi.Spectrum)
    for i in range(4):
        for j in range(4):
            result[i, j] = unpolarized([channel[i, j] for channel in channels]) * weight
    return result

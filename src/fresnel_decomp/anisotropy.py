"""Albedos of surfaces whose roughness differs along the two tangents.

They depend on the azimuth of the view and on two roughnesses, which no table of two dimensions
holds: whatever single roughness stands in for (.15, .4), some albedo is off by more than .03.
`AnisotropicGrid` has all four dimensions, but only over the range that a surface
needs. Sums run over visible normals, the same quasi-random ones everywhere.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._array import ops_for
from ._check import choose, input_error, is_whole
from ._distributions import named_shape
from ._lobe_rule import unit_gauss
from .albedo import SMOOTH, Fresnel
from .energy import missing
from .fast_curves import FastCurves
from .microfacet import (
    SMITH,
    Distribution,
    Smith,
    masking,
    sample_visible_normal,
    shadowing_ratio,
)

__all__ = ["AnisotropicGrid", "anisotropic_albedo"]

SAMPLES = 256
"""Visible normals for each view: errors of about .001."""

AZIMUTHS, ELEVATIONS = 9, 32

_BLOCK = 1 << 18  # samples at a time


def anisotropic_albedo(
    f: Fresnel,
    direction: Any,
    alpha_u: Any,
    alpha_v: Any,
    *,
    smith: Smith = "separable",
    distribution: Distribution = "ggx",
    samples: int = SAMPLES,
) -> np.ndarray:
    """Directional albedo of a rough surface with two roughnesses.

    Parameters
    ----------
    f : callable from (m,) cosines to (m, n) values
    direction : (n_views, 3) float, unit vectors with z >= 0
        Towards the viewer, x along the tangent of `alpha_u`.
    alpha_u, alpha_v : (n_views,) float > 0
    smith, distribution
        As for `directional_albedo`.
    samples : int, a power of 2

    Returns
    -------
    (n_views, n) float64

    Raises
    ------
    InputError
        For arrays of other shapes, numbers of samples that are no power of 2, and unknown options.

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp.anisotropy import anisotropic_albedo
    >>> white = lambda cos_theta: np.ones((len(cos_theta), 1))
    >>> up = np.array([[0.0, 0.0, 1.0]])
    >>> found = anisotropic_albedo(white, up, np.array([1.0]), np.array([1.0]), samples=4096)
    >>> bool(abs(found[0, 0] - (1.0 - np.log(2.0))) < 1e-3)
    True
    """
    shape = named_shape(distribution)
    choose("smith", smith, SMITH)
    if not is_whole(samples, 1) or samples & (samples - 1):
        raise input_error(f"samples={samples!r}", "a power of 2", f"{SAMPLES} err by about .001.")
    direction, alpha_u, alpha_v = (np.asarray(v, np.float64) for v in (direction, alpha_u, alpha_v))
    if (
        direction.shape != (*alpha_u.shape, 3)
        or alpha_u.shape != alpha_v.shape
        or alpha_u.ndim != 1
    ):
        raise input_error(
            f"direction, alpha_u, alpha_v of shapes {direction.shape}, {alpha_u.shape}, "
            f"{alpha_v.shape}",
            "(n_views, 3), (n_views,), (n_views,)",
            "Give each view its two roughnesses: np.full(len(direction), 0.3).",
        )
    u1, u2 = _points(int(samples))
    step = max(1, _BLOCK // samples)
    rows = []
    for start in range(0, len(direction), step):
        wo = tuple(direction[start : start + step].T[:, :, None])
        a, b = (v[start : start + step, None] for v in (alpha_u, alpha_v))
        # in the frame in which the surface has roughness 1, and back
        view = _unit((a * wo[0], b * wo[1], wo[2]))
        x, y, z = sample_visible_normal(view, 1.0, u1, u2, distribution)
        h = _unit((a * x, b * y, z))
        cosine = np.clip(sum(v * m for v, m in zip(wo, h, strict=True)), 0.0, 1.0)
        wi = tuple(2.0 * cosine * m - v for v, m in zip(wo, h, strict=True))
        # Smith's Lambda knows the roughness along the ray only
        seen = masking(wo[2], _along(wo, a, b), distribution)
        lit = np.clip(wi[2], 1e-12, 1.0)
        weight = shadowing_ratio(ops_for(), shape, smith, lit, _along(wi, a, b), seen)
        weight = np.where(wi[2] > 0.0, weight, 0.0)
        values = np.asarray(f(cosine.ravel())).reshape(*cosine.shape, -1)
        rows.append(np.einsum("vs,vsn->vn", weight, values) / samples)
    return np.concatenate(rows)


def _along(w: Any, alpha_u: Any, alpha_v: Any) -> Any:
    """Roughness in the plane of a ray and the normal."""
    sine = np.maximum(w[0] * w[0] + w[1] * w[1], 1e-30)
    square = (alpha_u * w[0]) ** 2 + (alpha_v * w[1]) ** 2
    return np.maximum(np.sqrt(square / sine), SMOOTH)


def _unit(vector: Any) -> Any:
    length = np.sqrt(sum(value * value for value in vector))
    return tuple(value / length for value in vector)


@functools.cache
def _points(samples: int) -> np.ndarray:
    from scipy.stats import qmc

    sequence = qmc.Sobol(2, scramble=True, seed=0)
    return sequence.random_base2(samples.bit_length() - 1).T


@dataclass(frozen=True, eq=False)
class AnisotropicGrid:
    """Albedos over view and two roughnesses, for interpolation in all four.

    Attributes
    ----------
    values : (n_u, n_v, azimuths, elevations, n) float32
        Equidistant in the roots of alpha_u and alpha_v, in the azimuth from 0 (along u) to pi/2,
        and in the root of the cosine.
    losses : (n_u, n_v, n) float32
        L, lambda_1, ... of `energy`.
    root_u, root_v : pairs of float
        Ends of the ranges, as roots.
    """

    values: np.ndarray
    losses: np.ndarray
    root_u: tuple[float, float]
    root_v: tuple[float, float]

    @classmethod
    def bake(
        cls,
        basis: Any,
        range_u: tuple[float, float],
        range_v: tuple[float, float],
        *,
        smith: Smith = "separable",
        distribution: Distribution = "ggx",
    ) -> AnisotropicGrid:
        """Integrate a basis with b_0 = 1 over ranges of both roughnesses.

        Parameters
        ----------
        basis : callable from (m,) cosines to (m, n) values
        range_u, range_v : pairs of float > 0
            Least and largest alpha; they may be equal.
        smith, distribution
            As for `directional_albedo`.

        Notes
        -----
        A range has a node for every .06 of its root and two at least, which lie a little apart
        where it is a single value, for the derivative.
        """
        roots_u, roots_v = (_nodes(*ends) for ends in (range_u, range_v))
        azimuth = np.linspace(0.0, 0.5 * np.pi, AZIMUTHS)
        mu = np.linspace(0.0, 1.0, ELEVATIONS) ** 2
        u, v, phi, z = (
            grid.ravel() for grid in np.meshgrid(roots_u**2, roots_v**2, azimuth, mu, indexing="ij")
        )
        sine = np.sqrt(1.0 - z * z)
        direction = np.stack([sine * np.cos(phi), sine * np.sin(phi), z], axis=-1)
        curves = FastCurves.of(basis)
        values = anisotropic_albedo(curves, direction, u, v, smith=smith, distribution=distribution)
        values = values.reshape(len(roots_u), len(roots_v), AZIMUTHS, ELEVATIONS, -1)
        return cls(
            values.astype(np.float32),
            _losses(values).astype(np.float32),
            (float(roots_u[0]), float(roots_u[-1])),
            (float(roots_v[0]), float(roots_v[-1])),
        )


def _nodes(low: float, high: float) -> np.ndarray:
    """Roots of alpha."""
    low, high = math.sqrt(low), math.sqrt(high)
    if high - low < 0.02 * high:  # the mean of two near ones errs by the square of their distance
        middle = 0.5 * (low + high)
        return np.array([0.98, 1.02]) * middle
    return np.linspace(low, high, max(2, math.ceil((high - low) / 0.06) + 1))


def _losses(values: np.ndarray) -> np.ndarray:
    """L, lambda_1, ... of a grid as it is interpolated."""
    part, weight = unit_gauss(4)
    cells = ELEVATIONS - 1
    root = (np.arange(cells)[:, None] + part) / cells
    weight = 4.0 * root**3 * (weight / cells)
    near, far = values[..., :-1, None, :], values[..., 1:, None, :]
    inside = near + (far - near) * part[:, None]
    # between two azimuths everything is linear: the trapezoidal rule, 1 in all
    white = inside[..., 0]
    lost = missing(white)
    trapezia = np.full(AZIMUTHS, 1.0 / (AZIMUTHS - 1))
    trapezia[[0, -1]] *= 0.5
    loss = np.einsum("uvpcq,p,cq->uv", lost, trapezia, weight)
    share = lost / white
    fresnel = np.einsum("uvpcqn,uvpcq,p,cq->uvn", inside, share, trapezia, weight, optimize=True)
    ratio = fresnel[..., 1:] / np.maximum(loss, 1e-9)[..., None]
    return np.concatenate([loss[..., None], ratio], axis=-1)

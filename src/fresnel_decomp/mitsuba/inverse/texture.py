"""A conductor whose node colours vary over its surface: one sparse linear system for all texels.

A pixel's radiance is linear in the node colours of the texels that its samples fall on. The shares
of texels in pixels come from the surface coordinates of samples; what light does to a pixel comes
from the same few renderings as for a uniform conductor. So the cost of rendering does not grow with
the texture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import mitsuba as mi
import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import ArrayLike, NDArray

from ..._check import input_error, is_real, is_whole
from ...basis import Basis, load_basis
from ...inverse_fit import PRIOR_DEVIATION, nearest_feasible
from .images import Images, Setup, derived_seed, require_rgb
from .linear import Linearised, Unknowns, linearise, solve_twice
from .observed import Observed, observe

__all__ = ["RecoveredTexture", "recover_texture", "texel_shares"]

Array = NDArray[np.float64]

_SHARE_PASSES = 32
_CHUNK = 256
_LOOSE = 0.2  # the first contrast
_TURNS = 6


@dataclass(frozen=True, eq=False)
class RecoveredTexture:
    """Node colours over the surface.

    Attributes
    ----------
    nodes : (height, width, 3, terms - 1) float
        Reflectance at 0° and at the nodes, of red, green and blue. The first row is at v = 0.
    standard_errors : the same shape
        Of the posterior: no texel is less known than its neighbours and the prior make it.
    identified : (height, width) bool
        Whether the texel, or its region, is seen on a pixel or more, and the images halve at least
        what the prior leaves open, in all numbers.
    seen : (height, width) float
        Pixels that the texel covers, in all images together.
    residual, noise : float
        As in `Recovered`.
    alpha, samples
    """

    nodes: Array
    standard_errors: Array
    identified: NDArray[np.bool_]
    seen: Array
    residual: float
    noise: float
    alpha: float
    samples: int
    basis: Basis = field(repr=False)
    distribution: str = "ggx"

    @property
    def coefficients(self) -> Array:
        """(height, width, 3, terms) float"""
        return np.asarray(
            self.basis.coefficients_from_reflectance(self.nodes[..., 0], self.nodes[..., 1:])
        )

    def bsdf(self, filter_type: str = "nearest") -> dict[str, Any]:
        """A `decomposed_conductor` with these textures, for the active variant."""
        maps = {}
        for i in range(self.basis.terms - 1):
            data = mi.TensorXf(np.ascontiguousarray(self.nodes[..., i], np.float32))
            maps[f"f{i}"] = {
                "type": "bitmap", "raw": True, "filter_type": filter_type, "data": data,
                "wrap_mode": "clamp",
            }  # fmt: skip
        return {
            "type": "decomposed_conductor",
            **maps,
            "alpha": self.alpha,
            "distribution": self.distribution,
            "recipe": self.basis.recipe,
            "terms": self.basis.terms,
        }


def recover_texture(
    images: Any,
    scenes: Setup | Sequence[Setup],
    shape: tuple[int, int],
    *,
    alpha: float,
    regions: ArrayLike | None = None,
    contrast: float = 0.03,
    basis: Basis | None = None,
    distribution: str = "ggx",
    noise: Any = None,
    bounds: tuple[float, float] | None = (0.0, 1.05),
    spp: int = 128,
    seed: int = 0,
) -> RecoveredTexture:
    """Recover textures of node colours from images under known, direct light.

    Parameters
    ----------
    images, scenes, alpha, basis, distribution, noise, bounds, spp, seed
        As for `recover`; roughness is known and uniform, and `max_depth` is 2.
    shape : (height, width)
        Of the texture, over surface coordinates in [0, 1]².
    regions : (height, width) int array, optional
        Texels with equal numbers are one material and share their colours.
    contrast : float
        By how much neighbouring texels may differ and still be taken for one material. A texel that
        few pixels see takes from such neighbours; borders with far larger steps stay sharp.

    Returns
    -------
    RecoveredTexture

    Raises
    ------
    InputError
        As `recover`; for scenes with `max_depth` above 2, where pixels depend on products of
        texels; and for bad shapes.

    Notes
    -----
    Within a pixel, light is taken to be the same on all its texels, which errs where a border
    crosses it and the light changes too. Where borders are is found by solving repeatedly: a step
    between neighbours costs less the larger it was (Geman and McClure 1987, by reweighting). The
    bounds are imposed texel by texel, after the solve.
    """
    require_rgb()
    if len(shape) != 2 or not all(is_whole(n, 1) for n in shape):
        raise input_error(f"shape={shape}", "(height, width), both >= 1", "Use (32, 64).")
    if not is_real(contrast, 1e-4, 10.0):
        raise input_error(f"contrast={contrast!r}", "a number from 1e-4 to 10", "Use 0.1.")
    height, width = (int(n) for n in shape)
    groups = np.arange(height * width)
    if regions is not None:
        labels = np.asarray(regions)
        if labels.shape != (height, width):
            raise input_error(
                f"regions of shape {labels.shape}", f"{(height, width)}", "One number per texel."
            )
        groups = np.unique(labels.ravel(), return_inverse=True)[1].reshape(-1)
    basis = basis or load_basis()
    setups = [scenes] if callable(scenes) else list(scenes)
    made = Images(setups, "coefficients", basis, distribution=distribution)
    if made.depth > 2:
        raise input_error(
            f"a scene with max_depth {made.depth}",
            "max_depth 2, direct light",
            "Light from texel to texel makes images quadratic in them; hide it, or limit the depth "
            "and take the images with direct light only.",
        )
    observed = observe(images, made.sizes, noise)
    unknowns = Unknowns.of(basis, True, bounds, np.full((basis.terms - 1, 3), 0.5))
    model = linearise(made, alpha, max(1, spp // 2), seed, unknowns)
    _, uniform = solve_twice(model, observed, unknowns)  # and weighs by noise
    shares = texel_shares(made, (height, width), model.visible, seed)
    gather = scipy.sparse.csr_matrix(
        (np.ones(len(groups)), (np.arange(len(groups)), groups)), (len(groups), groups.max() + 1)
    )
    W = (shares @ gather).tocsr()
    edges = None if regions is not None else _neighbours(height, width)
    systems = [_System(model, observed, W, i, uniform[:, i]) for i in range(3)]
    coupling = np.zeros(0) if edges is None else np.full(edges.shape[0], 1.0 / _LOOSE**2)
    for turn in range(1 if edges is None else _TURNS):
        x = np.stack([s.solve(edges, coupling) for s in systems], axis=1)
        if edges is not None and turn < _TURNS - 1:
            steps = edges @ x.reshape(len(x), -1)
            # from smooth to sharp, or the first blur would decide where borders are
            sharpness = contrast * max(1.0, 2.0 ** (2 - turn))
            coupling = 1.0 / (contrast**2 * (1.0 + np.mean(steps**2, axis=1) / sharpness**2) ** 2)
    if unknowns.limits is not None:
        for i, system in enumerate(systems):
            system.confine(x[:, i], unknowns.limits)
    x = x[groups]  # (texels, 3, n)
    errors = np.stack([s.standard_errors() for s in systems], axis=1)[groups]
    predicted = model.offset.mean(axis=0) + np.einsum(
        "mcn,mcn->mc", model.columns.mean(axis=0), (shares @ x.reshape(len(x), -1)).reshape(
            -1, 3, basis.terms - 1)
    )  # fmt: skip
    noise_found, residual = observed.noise_and_residual(predicted, model.visible)
    grid = (height, width, 3, basis.terms - 1)
    seen = np.asarray(shares.sum(axis=0)).ravel()
    of_group = np.bincount(groups, seen)[groups]
    known = np.all(errors < 0.5 * PRIOR_DEVIATION, axis=(1, 2)) & (of_group >= 1.0)
    return RecoveredTexture(
        x.reshape(grid),
        errors.reshape(grid),
        known.reshape(height, width),
        seen.reshape(height, width),
        residual,
        noise_found,
        float(alpha),
        made.samples,
        basis,
        distribution,
    )


def texel_shares(images: Images, shape: tuple[int, int], visible: NDArray[Any], seed: int) -> Any:
    """(m, texels) sparse: what part of the conductor in a pixel each texel is.

    From the surface coordinates of `_SHARE_PASSES` samples in each pixel.
    """
    height, width = shape
    integrator = mi.load_dict({"type": "aov", "aovs": "uv:uv,index:shape_index"})
    found, at = [], 0
    for i, scene in enumerate(images.scenes):
        w, h = images.sizes[i]
        here = visible[at : at + w * h]
        at += w * h
        u, v, index = np.moveaxis(
            np.stack(
                [
                    np.array(
                        mi.render(
                            scene, integrator=integrator, spp=1, seed=derived_seed(seed, i, 5, n)
                        )
                    ).reshape(-1, 3)
                    for n in range(_SHARE_PASSES)
                ]
            ),
            -1,
            0,
        )
        images.samples += _SHARE_PASSES * w * h
        mine = _conductor(index, here)
        texel = np.clip((v * height).astype(int), 0, height - 1) * width + np.clip(
            (u * width).astype(int), 0, width - 1
        )
        pixel = np.broadcast_to(np.arange(w * h), texel.shape)
        counts = scipy.sparse.coo_matrix(
            (np.ones(np.count_nonzero(mine)), (pixel[mine], texel[mine])), (w * h, height * width)
        ).tocsr()
        total = np.asarray(counts.sum(axis=1)).ravel()
        found.append(scipy.sparse.diags(1.0 / np.maximum(total, 1.0)) @ counts)
    return scipy.sparse.vstack(found).tocsr()


def _conductor(index: Array, visible: NDArray[Any]) -> NDArray[np.bool_]:
    """Which samples are on the conductor: on shapes that are hit where it shows."""
    hit = np.zeros(index.shape, bool)
    for value in np.unique(index[index > 0.0]):
        here = index == value
        if np.count_nonzero(here[:, visible]) > 0.5 * np.count_nonzero(here):
            hit |= here
    return hit


def _neighbours(height: int, width: int) -> Any:
    """(edges, texels) sparse: differences between neighbours; u wraps around."""
    at = np.arange(height * width).reshape(height, width)
    pairs = [(at[:-1].ravel(), at[1:].ravel())]
    if width > 2:
        pairs.append((at.ravel(), np.roll(at, -1, axis=1).ravel()))
    elif width == 2:
        pairs.append((at[:, 0], at[:, 1]))
    a, b = (np.concatenate(side) for side in zip(*pairs, strict=True))
    rows = np.arange(len(a))
    ones = np.ones(len(a))
    shape = (len(a), height * width)
    return scipy.sparse.csr_matrix((ones, (rows, a)), shape) - scipy.sparse.csr_matrix(
        (ones, (rows, b)), shape
    )


class _System:
    """The normal equations of one channel for the node colours of all texels."""

    def __init__(
        self, model: Linearised, observed: Observed, W: Any, channel: int, prior: Array
    ) -> None:
        self.n, self.count = model.columns.shape[-1], W.shape[1]
        inside = model.visible
        a, b = (
            scipy.sparse.hstack(
                [scipy.sparse.diags(half[inside, i]) @ W[inside] for i in range(self.n)]
            )
            for half in model.columns[:, :, channel]
        )
        weight = observed.weight[inside, channel]
        self.start = np.repeat(prior, self.count)
        ra, rb = (
            observed.values[inside, channel] - offset[inside, channel] - J @ self.start
            for offset, J in zip(model.offset, (a, b), strict=True)
        )
        wa, wb = (scipy.sparse.diags(weight) @ part for part in (a, b))
        self.cross = 0.5 * (wa.T @ b + wb.T @ a)
        self.right = 0.5 * (wa.T @ rb + wb.T @ ra)

    def solve(self, edges: Any, coupling: Array) -> Array:
        """(texels, n), with neighbours coupled."""
        penalty = scipy.sparse.identity(self.count) / PRIOR_DEVIATION**2
        if edges is not None:
            penalty = penalty + edges.T @ scipy.sparse.diags(coupling) @ edges
        self.normal = (
            self.cross + scipy.sparse.kron(scipy.sparse.identity(self.n), penalty)
        ).tocsc()
        self.factor = scipy.sparse.linalg.splu(self.normal)
        x = self.start + self.factor.solve(self.right)
        return np.asarray(x.reshape(self.n, self.count).T)

    def confine(self, x: Array, limits: tuple[Array, Array]) -> None:
        """Move texels that leave the bounds, in place."""
        G, h = limits
        for t in np.flatnonzero(np.any(x @ G.T < h - 1e-12, axis=1)):
            own = np.arange(self.n) * self.count + t
            block = self.normal[own][:, own].toarray()
            root = np.linalg.cholesky(0.5 * (block + block.T)).T
            x[t] = nearest_feasible(root, x[t], G, h)

    def standard_errors(self) -> Array:
        """(texels, n): of the posterior."""
        size = self.n * self.count
        variance = np.empty(size)
        for first in range(0, size, _CHUNK):
            columns = np.arange(first, min(first + _CHUNK, size))
            unit = np.zeros((size, len(columns)))
            unit[columns, np.arange(len(columns))] = 1.0
            variance[columns] = self.factor.solve(unit)[columns, np.arange(len(columns))]
        return np.sqrt(np.maximum(variance, 0.0)).reshape(self.n, self.count).T

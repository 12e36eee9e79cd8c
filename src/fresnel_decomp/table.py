"""The preintegrated table: directional albedos of a basis over view angle and roughness.

The default layout is 64 x 64 texels of bbar_0 ... bbar_3, with x = sqrt(mu) and y the perceptual
roughness (alpha = y²), 0 and 1 on the centres of the outer texels. Fbar = sum_i c_i bbar_i then
costs one bilinear fetch, whatever the material.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from ._arguments import floating_type, real_arguments
from ._array import drjit_constant, drjit_module, is_drjit
from ._check import choose, input_error, is_whole
from ._coefficients import check_terms, evaluated
from ._version import __version__
from .albedo import Quadrature, checked_quadrature, directional_albedo
from .basis import Basis
from .fast_curves import FastCurves, Packets, packets
from .microfacet import DISTRIBUTIONS, SMITH, Distribution, Smith
from .table_layout import Layout

__all__ = ["BAKE_QUADRATURE", "CHECK_QUADRATURE", "AlbedoTable"]

BAKE_QUADRATURE = Quadrature(16, 16)
"""256 nodes a texel: largest error below 3e-5, for both distributions and both Smith models."""

CHECK_QUADRATURE = Quadrature(32, 32)
"""1,024 nodes, good to 1e-6 for smooth functions: what a table's error is measured against."""


@dataclass(frozen=True, eq=False)
class AlbedoTable:
    """Directional albedos of basis functions, tabulated.

    Attributes
    ----------
    values : (height, width, terms) float32
        Row 0 is the smoothest, column 0 is at grazing incidence. Read-only.
    layout : Layout
    smith : {"separable", "correlated"}
    distribution : {"ggx", "beckmann"}
        What was integrated.
    metadata : mapping
        Recipe and hash of the basis, quadrature, measured error, versions: whatever JSON can hold;
        kept in files.

    Raises
    ------
    InputError
        For values of another shape than the layout has, or that are not real and finite in float32;
        for unknown conventions; for metadata that JSON cannot hold.

    Examples
    --------
    >>> from fresnel_decomp import AlbedoTable, load_basis
    >>> basis = load_basis()
    >>> table = AlbedoTable.bake(basis, size=16)
    >>> silver = basis.coefficients(0.13, 3.9)
    >>> bool(abs(table.evaluate(silver, 1.0, 0.0) - silver[0]) < 1e-6)  # F0: smooth, seen head-on
    True
    """

    values: np.ndarray = field(repr=False)
    layout: Layout
    smith: Smith = "separable"
    distribution: Distribution = "ggx"
    metadata: Mapping[str, Any] = field(default_factory=dict, repr=False)
    _on_device: dict[type, Packets] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.layout, Layout):
            raise input_error(f"layout={self.layout!r}", "a Layout", "Layout() is the default.")
        given = np.asarray(self.values)
        if given.dtype.kind not in "fiub":
            raise input_error(
                f"values of type {given.dtype}",
                "real numbers",
                "Take the real part.",
            )
        with np.errstate(over="ignore"):
            values = given.astype(np.float32)
        height, width = self.layout.height, self.layout.width
        if values.ndim != 3 or values.shape[:2] != (height, width) or values.shape[2] < 1:
            raise input_error(
                f"values of shape {values.shape}",
                f"({height}, {width}, terms): rows, columns, terms",
                "The first axis is the roughness.",
            )
        if not np.isfinite(values).all():
            raise input_error(
                f"values, {np.count_nonzero(~np.isfinite(values))} are not finite in float32",
                "finite numbers",
                "Look at the functions that were integrated.",
            )
        choose("smith", self.smith, SMITH)
        choose("distribution", self.distribution, DISTRIBUTIONS)
        values.flags.writeable = False
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "metadata", MappingProxyType(_as_json(self.metadata)))

    @property
    def terms(self) -> int:
        """Number of basis functions."""
        return int(self.values.shape[2])

    @property
    def sha256(self) -> str:
        """Hash of the values, as little-endian float32 in the order of the array."""
        return hashlib.sha256(self.values.astype("<f4").tobytes()).hexdigest()

    @classmethod
    def bake(
        cls,
        basis: Any,
        size: int | tuple[int, int] = 64,
        smith: Smith = "separable",
        *,
        distribution: Distribution = "ggx",
        mu_axis: str = "sqrt_mu",
        alpha_axis: str = "perceptual_roughness",
        addressing: Literal["centres", "edges"] = "centres",
        quadrature: tuple[int, int] = BAKE_QUADRATURE,
        float_type: Any = None,
        measure: bool = False,
    ) -> AlbedoTable:
        """Integrate a basis for every texel.

        Parameters
        ----------
        basis : Basis, ClosedForm, or callable from (m,) cosines to (m, terms) values
        size : int or (width, height)
        smith : {"separable", "correlated"}
        distribution : {"ggx", "beckmann"}
        mu_axis, alpha_axis, addressing
            See `Layout`.
        quadrature : pair of int
            Nodes in azimuth and slope, see `albedo.Quadrature`.
        float_type : type, optional
            A Dr.Jit array type such as `mi.Float`, to compute with Dr.Jit; NumPy if none is given,
            or `float`, which `mi.Float` is in scalar variants.
        measure : bool
            Also measure the largest error, see `error`, and note it in the metadata. Takes four
            times as long again.

        Raises
        ------
        InputError
            For unknown options or sizes.
        """
        width, height = _width_and_height(size)
        quadrature = checked_quadrature(quadrature)
        layout = Layout(width, height, mu_axis, alpha_axis, addressing)
        options: dict[str, Any] = {"smith": smith, "distribution": distribution}
        values = _integrate(basis, layout, {**options, "quadrature": quadrature}, float_type)
        metadata = {
            "basis": _described(basis),
            "quadrature": f"Gauss-Legendre, {quadrature[0]} azimuths x {quadrature[1]} slopes, "
            "horizon in closed form",
            "measured_error": None,
            "software": f"fresnel_decomp {__version__}",
        }
        table = cls(values, layout, smith, distribution, metadata)
        if not measure:
            return table
        noted = {
            "max": table.error(basis),
            "against": f"{CHECK_QUADRATURE.azimuth} x {CHECK_QUADRATURE.slope} nodes in float64, "
            "every texel",
        }
        return replace(table, metadata={**metadata, "measured_error": noted})

    def error(self, basis: Any) -> float:
        """Largest distance of any texel from a much finer quadrature, in float64.

        Parameters
        ----------
        basis
            That the table was baked from. Of functions with a kink, the finer quadrature errs
            too, by up to 0.02: see `albedo_refined`.
        """
        options = {"smith": self.smith, "distribution": self.distribution}
        finer = _integrate(basis, self.layout, {**options, "quadrature": CHECK_QUADRATURE}, None)
        return float(np.abs(self.values - finer).max())

    def lookup(self, mu: Any, alpha: Any) -> Any:
        """Bilinear interpolation of the table, as a texture unit does it.

        Parameters
        ----------
        mu, alpha : (...) float
            Clamped to [0, 1]; NaN gives NaN.

        Returns
        -------
        (..., terms) float for NumPy arrays and Python floats, of their precision; for Dr.Jit a
        tuple of arrays, one per term, differentiable in mu and alpha: finite everywhere, and
        0 beyond [0, 1].

        Raises
        ------
        InputError
            If mu and alpha are not real, do not broadcast, or are of several kinds.
        """
        mu, alpha = real_arguments(mu=mu, alpha=alpha)
        if is_drjit(mu, alpha):
            return self._lookup_drjit(mu, alpha)
        dtype = floating_type(mu, alpha)
        column, row = self.layout.texel(np.asarray(mu, dtype), np.asarray(alpha, dtype))
        column, row = np.broadcast_arrays(column, row)
        i, j = (
            np.minimum(np.nan_to_num(position).astype(np.intp), size - 2)
            for position, size in ((column, self.layout.width), (row, self.layout.height))
        )
        x, y = (column - i)[..., None], (row - j)[..., None]
        below, above = (
            self.values[rows, i] * (1.0 - x) + self.values[rows, i + 1] * x for rows in (j, j + 1)
        )
        return (below * (1.0 - y) + above * y).astype(dtype)

    def evaluate(self, coefficients: Any, mu: Any, alpha: Any) -> Any:
        """Directional albedo sum_i c_i bbar_i of a material, unclamped.

        Parameters
        ----------
        coefficients : (..., terms) float, or for Dr.Jit a sequence of as many arrays
        mu, alpha : (...) float
            As for `lookup`; they broadcast against the coefficients' leading axes.

        Returns
        -------
        (...) float, or a Dr.Jit array if any argument is one: differentiable in each of them.

        Raises
        ------
        InputError
            For another number of coefficients, and for arguments that are not real, do not
            broadcast, or are of several kinds.
        """
        mu, alpha = real_arguments(mu=mu, alpha=alpha)
        coefficients = check_terms(coefficients, alpha if is_drjit(alpha) else mu, self.terms)
        return evaluated(self.lookup, coefficients, mu, alpha)

    def _lookup_drjit(self, mu: Any, alpha: Any) -> Any:
        dr = drjit_module()
        assert dr is not None
        kind = type(mu * 0.0 + alpha * 0.0)
        column, row = self.layout.texel(kind(mu), kind(alpha))
        index = dr.uint32_array_t(kind)
        width = self.layout.width
        i = dr.minimum(index(dr.detach(column)), width - 2)
        j = dr.minimum(index(dr.detach(row)), self.layout.height - 2)
        x, y = column - kind(i), row - kind(j)
        if kind not in self._on_device:
            self._on_device[kind] = packets(kind, self.values.reshape(-1, self.terms))
        texel = i + j * width
        corners = zip(
            *(self._on_device[kind].gather(texel + offset) for offset in (0, 1, width, width + 1)),
            strict=True,
        )
        values = []
        for low, right, up, diagonal in corners:
            below, above = dr.fma(right - low, x, low), dr.fma(diagonal - up, x, up)
            values.append(dr.fma(above - below, y, below))
        return tuple(values)

    def textures(self) -> list[np.ndarray]:
        """The table as RGBA textures: one for up to four terms, two for more.

        Returns
        -------
        list of (height, width, 4) float32
            Missing channels are 0. Row 0 is the smoothest.
        """
        padding = -self.terms % 4
        padded = np.pad(self.values, ((0, 0), (0, 0), (0, padding)))
        return [np.ascontiguousarray(half) for half in np.split(padded, padded.shape[2] // 4, 2)]

    def save(self, path: str | os.PathLike[str], *, half: bool | None = None) -> None:
        """Write a file, whole or not at all; its suffix says the format.

        Parameters
        ----------
        path : path
            `.exr`: channels R, G, B, A of named terms, metadata in the header. `.npz`: NumPy
            arrays and metadata. `.half`: half floats of RGBA textures and nothing else, with the
            metadata beside them in `.half.json`. See `table_files`.
        half : bool, optional
            Store half floats (`.exr` and `.npz`; default True for `.exr`).

        Raises
        ------
        InputError
            For another suffix, and if half floats cannot hold the values.
        """
        from .table_files import save

        save(self, path, half=half)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> AlbedoTable:
        """Read what `save` wrote.

        Raises
        ------
        InputError
            For missing, truncated or changed files, for another layout than the metadata say, and
            for files of something else.
        """
        from .table_files import load

        return load(path)


def _integrate(
    basis: Any, layout: Layout, options: Mapping[str, Any], float_type: Any
) -> np.ndarray:
    """(height, width, terms) albedos at the texels."""
    alpha, mu = np.meshgrid(layout.alpha, layout.mu, indexing="ij")
    curves = FastCurves.of(basis)
    if float_type in (None, float):
        # rows at a time, which fit the caches
        rows = max(1, 512 // layout.width)
        parts = [
            directional_albedo(curves, mu[j : j + rows], alpha[j : j + rows], **options)
            for j in range(0, layout.height, rows)
        ]
        return np.concatenate(parts)
    dr = drjit_module()
    if dr is None or not (dr.is_array_v(float_type) and dr.is_float_v(float_type)):
        raise input_error(
            f"float_type={float_type!r}",
            "a floating-point array type of Dr.Jit",
            "Take mi.Float of a variant such as llvm_ad_rgb, or none for NumPy.",
        )
    arguments = (drjit_constant(float_type, values) for values in (mu, alpha))
    functions = directional_albedo(curves.on(float_type), *arguments, **options)
    dr.eval(functions)  # at once: converted one by one, they would be computed one by one
    return np.stack([np.array(v) for v in functions], axis=-1).reshape(*mu.shape, -1)


def _as_json(metadata: Mapping[str, Any]) -> dict[str, Any]:
    """A copy, as files give it back."""
    try:
        copy: dict[str, Any] = json.loads(json.dumps(dict(metadata), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise input_error(
            f"metadata that JSON cannot hold ({error})",
            "a mapping of names to text, finite numbers, True, False, None, lists and mappings",
            "Convert NumPy's numbers: float(x), array.tolist().",
        ) from error
    return copy


def _width_and_height(size: Any) -> tuple[int, int]:
    if is_whole(size, 0):
        return size, size
    if not isinstance(size, tuple | list) or len(size) != 2:
        raise input_error(f"size={size!r}", "an int, or (width, height)", "64 is enough.")
    return size[0], size[1]


def _described(basis: Any) -> dict[str, Any]:
    if isinstance(basis, Basis):
        return {
            "recipe": basis.recipe,
            "terms": basis.terms,
            "nodes": basis.nodes.tolist(),
            "sha256": basis.provenance.get("sha256"),
        }
    return {"recipe": "custom", "type": type(basis).__name__}

"""The preintegrated table: directional albedos of a basis over view angle and roughness.

The default layout is 64 x 64 texels of b_0 ... b_3, with x = sqrt(mu) and y the perceptual
roughness (alpha = y²), 0 and 1 on the centres of the outer texels. Then Fbar = sum_i c_i bbar_i
costs one bilinear fetch, whatever the material.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from ._array import drjit_module, floating_type, is_drjit, one_kind, ops_for
from ._check import choose, input_error
from ._version import __version__
from .albedo import directional_albedo
from .basis import Basis
from .closed_form import check_terms
from .microfacet import DISTRIBUTIONS, SMITH, Distribution, Smith

__all__ = ["ALPHA_AXES", "MU_AXES", "AlbedoTable", "Layout"]


class _Axis(NamedTuple):
    """A coordinate in [0, 1] of mu or alpha in [0, 1], and back."""

    forward: Callable[[Any, Any], Any]  # of Ops and values
    inverse: Callable[[np.ndarray], np.ndarray]


def _root(ops: Any, x: Any) -> Any:
    # the slope of the root is infinite at 0, which no gradient survives: it ends at 5e5
    return ops.sqrt(ops.maximum(x, 1e-12)) - 1e-6 * ops.select(x < 1e-12, 1.0, 0.0)


def _angle(ops: Any, mu: Any) -> Any:
    # 1 at grazing incidence, as for the other axes 0 is; the slope at normal incidence ends at 5e5
    return 1.0 - ops.arccos(ops.minimum(mu, 1.0 - 1e-7)) * (2.0 / np.pi)


MU_AXES = {
    "sqrt_mu": _Axis(_root, lambda x: x * x),
    "mu": _Axis(lambda ops, mu: mu, lambda x: x),
    "theta": _Axis(_angle, lambda x: np.sin(0.5 * np.pi * x)),
}
"""Horizontal axes, 0 at grazing and 1 at normal incidence; "theta" is 1 - 2 theta / pi."""

ALPHA_AXES = {
    "perceptual_roughness": _Axis(_root, lambda y: y * y),
    "alpha": _Axis(lambda ops, alpha: alpha, lambda y: y),
}
"""Vertical axes, from smooth to rough; perceptual roughness is sqrt(alpha)."""

ADDRESSING = ("centres", "edges")
"""Where 0 and 1 lie: on the centres of the outer texels, or on the edges of the texture."""


@dataclass(frozen=True)
class Layout:
    """Which view angle and roughness a texel stands for.

    Attributes
    ----------
    width, height : int >= 2
        Texels along mu and along alpha.
    mu_axis : one of `MU_AXES`
    alpha_axis : one of `ALPHA_AXES`
    addressing : {"centres", "edges"}
        With "centres" texel i of n stands for i / (n - 1), with "edges" for (i + 1/2) / n.
    """

    width: int = 64
    height: int = 64
    mu_axis: str = "sqrt_mu"
    alpha_axis: str = "perceptual_roughness"
    addressing: Literal["centres", "edges"] = "centres"

    def __post_init__(self) -> None:
        choose("mu_axis", self.mu_axis, MU_AXES)
        choose("alpha_axis", self.alpha_axis, ALPHA_AXES)
        choose("addressing", self.addressing, ADDRESSING)
        for size in (self.width, self.height):
            if not isinstance(size, int) or not 2 <= size <= 4096:
                raise input_error(
                    f"a table of {self.width} x {self.height} texels",
                    "whole numbers from 2 to 4096",
                    "64 x 64 is enough; see docs/preintegration.md.",
                )

    @property
    def mu(self) -> np.ndarray:
        """(width,) cosines of the columns."""
        return MU_AXES[self.mu_axis].inverse(self._centres(self.width))

    @property
    def alpha(self) -> np.ndarray:
        """(height,) roughnesses of the rows."""
        return ALPHA_AXES[self.alpha_axis].inverse(self._centres(self.height))

    def _centres(self, size: int) -> np.ndarray:
        if self.addressing == "centres":
            return np.linspace(0.0, 1.0, size)
        return (np.arange(size) + 0.5) / size

    def texel(self, mu: Any, alpha: Any) -> tuple[Any, Any]:
        """Fractional column and row of mu and alpha: whole numbers at the centres of texels.

        Both are clamped to [0, 1] before, and the result to the centres of the outer texels.
        """
        ops = ops_for(mu, alpha)
        positions = []
        for value, axis, size in (
            (mu, MU_AXES[self.mu_axis], self.width),
            (alpha, ALPHA_AXES[self.alpha_axis], self.height),
        ):
            inside = ops.select(value < 0.0, 0.0, ops.select(value > 1.0, 1.0, value))
            coordinate = axis.forward(ops, inside)
            if self.addressing == "centres":
                position = coordinate * float(size - 1)
            else:
                position = coordinate * float(size) - 0.5
            positions.append(ops.minimum(ops.maximum(position, 0.0), float(size - 1)))
        return positions[0], positions[1]

    def texture_coordinates(self, mu: Any, alpha: Any) -> tuple[Any, Any]:
        """(u, v) in [0, 1] for a bilinear texture lookup with clamped addressing."""
        column, row = self.texel(mu, alpha)
        return (column + 0.5) / float(self.width), (row + 0.5) / float(self.height)


@dataclass(frozen=True, eq=False)
class AlbedoTable:
    """Directional albedos of basis functions, tabulated.

    Attributes
    ----------
    values : (height, width, terms) float32
        Row 0 is the smoothest, column 0 grazing incidence.
    layout : Layout
    smith, distribution : str
        What was integrated.
    metadata : mapping
        Recipe and hash of the basis, quadrature, measured error, versions; kept by every file
        format that can.

    Examples
    --------
    >>> from fresnel_decomp import AlbedoTable, load_basis
    >>> basis = load_basis()
    >>> table = AlbedoTable.bake(basis, size=16)
    >>> gold = basis.coefficients(0.18, 3.4)
    >>> bool(abs(table.evaluate(gold, 1.0, 0.0) - gold[0]) < 1e-6)  # smooth, at normal incidence
    True
    """

    values: np.ndarray = field(repr=False)
    layout: Layout
    smith: Smith = "separable"
    distribution: Distribution = "ggx"
    metadata: Mapping[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        values = np.array(self.values, np.float32)
        if values.ndim != 3 or values.shape[:2] != (self.layout.height, self.layout.width):
            raise input_error(
                f"values of shape {values.shape}",
                f"({self.layout.height}, {self.layout.width}, terms): rows, columns, terms",
                "The first axis is the roughness.",
            )
        choose("smith", self.smith, SMITH)
        choose("distribution", self.distribution, DISTRIBUTIONS)
        values.flags.writeable = False
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "metadata", MappingProxyType(dict(self.metadata)))

    @property
    def terms(self) -> int:
        """Number of basis functions."""
        return int(self.values.shape[2])

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
        float_type: Any = None,
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
        float_type : type, optional
            A Dr.Jit array type such as `mi.Float`, to compute with Dr.Jit; NumPy if none is given.

        Raises
        ------
        InputError
            For unknown options or sizes.
        """
        width, height = (size, size) if isinstance(size, int) else size
        layout = Layout(width, height, mu_axis, alpha_axis, addressing)
        alpha, mu = np.meshgrid(layout.alpha, layout.mu, indexing="ij")
        curves = _Curves.of(basis)
        options: dict[str, Any] = {
            "smith": smith,
            "distribution": distribution,
            "quadrature": (16, 20),
        }
        if float_type is None:
            values = directional_albedo(curves, mu, alpha, **options)
        else:
            on_device = (float_type(v.ravel().astype(np.float32)) for v in (mu, alpha))
            functions = directional_albedo(curves.on(float_type), *on_device, **options)
            values = np.stack([np.array(v) for v in functions], -1).reshape(*mu.shape, -1)
        metadata = {"basis": _described(basis), "versions": {"fresnel_decomp": __version__}}
        return cls(values, layout, smith, distribution, metadata)

    def lookup(self, mu: Any, alpha: Any) -> Any:
        """Bilinear interpolation of the table.

        Parameters
        ----------
        mu, alpha : (...) float
            Clamped to [0, 1]; NaN gives NaN.

        Returns
        -------
        (..., terms) float for NumPy arrays and Python floats, of their precision; for Dr.Jit a
        tuple of `terms` arrays, differentiable in mu and alpha (finite everywhere, and constant
        beyond [0, 1]).
        """
        mu, alpha = one_kind(mu, alpha)
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
            self.values[rows, i] * (1 - x) + self.values[rows, i + 1] * x for rows in (j, j + 1)
        )
        return (below * (1 - y) + above * y).astype(dtype)

    def evaluate(self, coefficients: Any, mu: Any, alpha: Any) -> Any:
        """Directional albedo sum_i c_i bbar_i of a material, unclamped.

        Parameters
        ----------
        coefficients : (..., terms) float, or for Dr.Jit a sequence of `terms` arrays
        mu, alpha : (...) float
            As for `lookup`; they broadcast against the coefficients' leading axes.
        """
        functions = self.lookup(mu, alpha)
        if is_drjit(mu, alpha):
            coefficients = one_kind(mu + alpha, *coefficients)[1:]
            return sum(
                (c * b for c, b in zip(coefficients[1:], functions[1:], strict=True)),
                coefficients[0] * functions[0],
            )
        coefficients = check_terms(coefficients, functions[..., 0], self.terms)
        return (np.asarray(coefficients) * functions).sum(axis=-1)

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
        texel = i + j * width
        values = []
        for plane in self._planes(kind):
            corners = [
                dr.gather(kind, plane, texel + offset) for offset in (0, 1, width, width + 1)
            ]
            below = dr.fma(corners[1] - corners[0], x, corners[0])
            above = dr.fma(corners[3] - corners[2], x, corners[2])
            values.append(dr.fma(above - below, y, below))
        return tuple(values)

    def _planes(self, kind: Any) -> list[Any]:
        """One array per term in memory of Dr.Jit, made once for each type."""
        cache = self.__dict__.setdefault("_plane_cache", {})
        if kind not in cache:
            cache[kind] = [_constant(kind, plane) for plane in np.moveaxis(self.values, 2, 0)]
        return cache[kind]


def _constant(kind: Any, values: np.ndarray) -> Any:
    """Values in memory of Dr.Jit: NumPy's, mapped, would recompile by accidental alignment."""
    dr = drjit_module()
    assert dr is not None
    flat = np.ascontiguousarray(values).ravel()
    if not dr.is_jit_v(kind):
        return kind(flat.tolist())
    copy = kind(flat) + dr.opaque(kind, 0.0)
    dr.eval(copy)
    return copy


@dataclass(frozen=True, eq=False)
class _Curves:
    """A basis, finely tabulated over sqrt(cos_theta) for speed: linear interpolation of 8,192
    intervals errs by 1e-7."""

    samples: np.ndarray  # (n + 1, terms)
    tables: tuple[Any, ...] = ()

    @classmethod
    def of(cls, basis: Any) -> _Curves:
        root = np.linspace(0.0, 1.0, 8193)
        samples = np.asarray(basis(root * root), np.float64)
        if samples.ndim != 2 or samples.shape[0] != root.size:
            raise input_error(
                f"a basis with values of shape {samples.shape[1:]} per cosine",
                "a callable from (m,) cosines to (m, terms) values",
                "Stack the functions: np.stack([...], axis=-1).",
            )
        return cls(samples)

    def on(self, kind: Any) -> _Curves:
        return _Curves(self.samples, tuple(_constant(kind, column) for column in self.samples.T))

    def __call__(self, cos_theta: Any) -> Any:
        last = len(self.samples) - 1
        if not self.tables:
            position = np.sqrt(cos_theta) * last
            index = np.minimum(position.astype(np.intp), last - 1)
            fraction = (position - index)[..., None]
            low = self.samples[index]
            return low + fraction * (self.samples[index + 1] - low)
        dr = drjit_module()
        assert dr is not None
        position = dr.sqrt(cos_theta) * float(last)
        index = dr.minimum(dr.uint32_array_t(type(cos_theta))(position), last - 1)
        fraction = position - type(cos_theta)(index)
        pairs = (
            (dr.gather(type(position), t, index), dr.gather(type(position), t, index + 1))
            for t in self.tables
        )
        return tuple(dr.fma(high - low, fraction, low) for low, high in pairs)


def _described(basis: Any) -> dict[str, Any]:
    if isinstance(basis, Basis):
        return {
            "recipe": basis.recipe,
            "terms": basis.terms,
            "sha256": basis.provenance.get("sha256", ""),
            "nodes": basis.nodes.tolist(),
        }
    return {"recipe": "custom"}

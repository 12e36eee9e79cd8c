r"""Linearly transformed cosines: reflection lobes whose integral over a light has a closed form.

Heitz, Dupuy, Hill and Neubelt 2016, "Real-Time Polygonal-Light Shading with Linearly Transformed
Cosines": if directions are moved by a matrix, a cosine lobe becomes a lobe that can be narrow,
stretched and tilted, and its integral over a polygon is that of a cosine over the moved polygon.

Directions are (x, y, z) in a frame in which z is the surface normal and the view direction is
(sin theta, 0, cos theta). With K the *inverse* matrix, up to a factor, the lobe is

    D(w) = |K| max((K w)_z, 0) / (pi |K w|⁴) / U   above the horizon, 0 below.

Two things differ from the paper. What such a lobe has below the horizon of the surface is cut off,
and U = (1 + n·z)/2, the rest of it, makes up for that: n is the normal of the surface's horizon
where the cosine lobe is, so that U is the share that one hemisphere sees of another. And K is not
stored as it is, but by what remains of it when its known part is taken out,

    K = diag(s, 1, 2 alpha) [[n0, 0, n1 sin], [0, 1, 0], [n2 sin, 0, s n3]] Rot,
    s² = cos² + alpha² sin²,

where Rot turns the mirror direction to the normal. For alpha -> 0 a GGX lobe *is* a linearly
transformed cosine, with n0 = n3 = 1, n1 = 0: its density over slopes, 1/(pi (1 + t²)²), is that of
a cosine over the tangent plane. n0 ... n3 are smooth, bounded, and even in the view angle, so that
few texels hold them.
"""

from __future__ import annotations

import functools
import json
import math
import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ._array import Ops, is_drjit, ops_for
from ._check import InputError, choose, input_error
from ._files import replacing
from ._vectors import Vector
from .microfacet import SMITH, Distribution, Smith
from .table import AlbedoTable
from .table_layout import Layout

__all__ = ["LEAST_ALPHA", "Lobe", "LobeTable", "load_lobes"]

LEAST_ALPHA = 1e-4
"""Lobes of smoother surfaces are those of this roughness, 0.01 on the perceptual scale: a mirror
has no density."""

_KIND = "fresnel_decomp table of linearly transformed cosines"
_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Lobe:
    """A linearly transformed cosine, cut off at the horizon, of integral 1 above it.

    Attributes
    ----------
    inverse : five (...) float
        K = [[k00, 0, k02], [0, k11, 0], [k20, 0, k22]], up to a positive factor: what moves
        directions to where the lobe is a cosine.
    """

    inverse: tuple[Any, Any, Any, Any, Any]

    @classmethod
    def from_residual(cls, mu: Any, alpha: Any, residual: tuple[Any, Any, Any, Any]) -> Lobe:
        """The lobe of a view angle and roughness from what tables store of it.

        Parameters
        ----------
        mu : (...) float in [0, 1]
        alpha : (...) float in [1e-4, 1]
        residual : four (...) float
            n0 ... n3.
        """
        ops = ops_for(mu, alpha, *residual)
        n0, n1, n2, n3 = residual
        square = (1.0 - mu) * (1.0 + mu)
        # its slope at normal incidence is infinite; nothing but n1 and n2 depends on it there
        tilted = square > _TINY
        square = ops.select(tilted, square, 0.0)
        sine = ops.select(tilted, ops.sqrt(ops.select(tilted, square, 1.0)), 0.0)
        spread = ops.sqrt(mu * mu + alpha * alpha * square)
        twice = 2.0 * alpha
        return cls(
            (
                spread * (n0 * mu - n1 * square),
                spread * sine * (n0 + n1 * mu),
                1.0 + 0.0 * spread,
                twice * sine * (n2 * mu - spread * n3),
                twice * (n2 * square + spread * n3 * mu),
            )
        )

    @property
    def ops(self) -> Ops:
        return ops_for(*self.inverse)

    @property
    def determinant(self) -> Any:
        """|K|, which is positive."""
        k00, k02, k11, k20, k22 = self.inverse
        return k11 * (k00 * k22 - k02 * k20)

    @property
    def horizon(self) -> Vector:
        """Unit normal of the surface's horizon where the lobe is a cosine: K moves what is above
        the surface to this side of it."""
        k00, _, _, k20, _ = self.inverse
        length = self.ops.sqrt(k00 * k00 + k20 * k20)
        return -k20 / length, 0.0 * length, k00 / length

    @property
    def above(self) -> Any:
        """U, the share of the whole lobe that is above the horizon of the surface."""
        return 0.5 * (1.0 + self.horizon[2])

    def to_cosine(self, direction: Vector) -> Vector:
        """K w, of any length."""
        k00, k02, k11, k20, k22 = self.inverse
        x, y, z = direction
        return k00 * x + k02 * z, k11 * y, k20 * x + k22 * z

    def from_cosine(self, direction: Vector) -> Vector:
        """The way back, up to a positive factor."""
        k00, k02, k11, k20, k22 = self.inverse
        x, y, z = direction
        return k22 * x - k02 * z, (k00 * k22 - k02 * k20) / k11 * y, k00 * z - k20 * x

    def density(self, direction: Vector) -> Any:
        """D, per solid angle: what the lobe reflects, and the density to sample it with.

        Parameters
        ----------
        direction : triple of (...) float, unit vectors

        Returns
        -------
        (...) float ≥ 0, whose integral over the hemisphere is 1; 0 for z ≤ 0.

        Examples
        --------
        >>> lobe = load_lobes().lobe(mu=1.0, alpha=0.1)
        >>> bool(lobe.density((0.0, 0.0, 1.0)) > 5.0)
        True
        """
        ops = ops_for(*self.inverse, *direction)
        x, y, z = self.to_cosine(direction)
        square = x * x + y * y + z * z
        lit = (z > 0.0) & (direction[2] > 0.0)
        scale = self.determinant / (math.pi * self.above)
        return ops.select(lit, scale * z / (square * square), 0.0)


@dataclass(frozen=True, eq=False)
class LobeTable:
    """Linearly transformed cosines of all view angles and roughnesses.

    Attributes
    ----------
    values : (height, width, 4) float32
        n0 ... n3 of the texels; row 0 is the smoothest, column 0 at grazing incidence. Read-only.
    layout : Layout
    smith : {"separable", "correlated"}
    distribution : {"ggx"}
        What was fitted.
    metadata : mapping
        How: quadrature, residuals, versions.

    Raises
    ------
    InputError
        For values of another shape than the layout has, or not finite, or with a matrix that turns
        directions inside out; for unknown conventions.
    """

    values: np.ndarray = field(repr=False)
    layout: Layout
    smith: Smith = "separable"
    distribution: Distribution = "ggx"
    metadata: Mapping[str, Any] = field(default_factory=dict, repr=False)
    _grid: AlbedoTable = field(init=False, repr=False)

    def __post_init__(self) -> None:
        grid = AlbedoTable(
            self.values, self.layout, self.smith, self.distribution, self.metadata
        )  # the same checks, and the same fetch
        if grid.terms != 4:
            raise input_error(
                f"values of shape {grid.values.shape}",
                f"({self.layout.height}, {self.layout.width}, 4)",
                "They are n0 ... n3 of every texel.",
            )
        object.__setattr__(self, "values", grid.values)
        object.__setattr__(self, "metadata", grid.metadata)
        object.__setattr__(self, "_grid", grid)
        n0, n1, n2, n3 = np.moveaxis(grid.values.astype(np.float64), -1, 0)
        mu = self.layout.mu
        alpha = self.layout.alpha[:, None]
        square = 1.0 - mu * mu
        spread = np.sqrt(mu * mu + np.maximum(alpha, LEAST_ALPHA) ** 2 * square)
        wrong = ~(spread * n0 * n3 - n1 * n2 * square > 0.0)
        if wrong.any():
            raise input_error(
                f"{np.count_nonzero(wrong)} matrices with a determinant that is not positive",
                "matrices that keep the orientation of what they move",
                "Fit the table anew: python scripts/fit_ltc.py.",
            )

    @property
    def sha256(self) -> str:
        """Hash of the values, as little-endian float32 in the order of the array."""
        return self._grid.sha256

    def lobe(self, mu: Any, alpha: Any) -> Lobe:
        """The lobe for a view angle and roughness: one bilinear fetch and a product of matrices.

        Parameters
        ----------
        mu, alpha : (...) float
            Clamped to [0, 1], alpha to `LEAST_ALPHA` at least; NaN gives NaN.

        Returns
        -------
        Lobe
            Of arrays of their kind; for Dr.Jit differentiable in both, finite everywhere.

        Raises
        ------
        InputError
            If mu and alpha are not real, do not broadcast, or are of several kinds.

        Examples
        --------
        >>> import numpy as np
        >>> lobe = load_lobes().lobe(np.array([0.2, 0.7]), 0.3)
        >>> lobe.density((-0.6, 0.0, 0.8)).shape
        (2,)
        """
        found = self._grid.lookup(mu, alpha)
        if is_drjit(mu, alpha):
            residual = tuple(found)
            mu, alpha = (0.0 * residual[0] + value for value in (mu, alpha))
        else:
            residual = tuple(np.moveaxis(found, -1, 0))
            mu, alpha = (np.asarray(value, found.dtype) for value in (mu, alpha))
        ops = ops_for(mu, alpha)
        # selected and not clipped: at the ends of [0, 1] derivatives pass
        mu = ops.select(mu < 0.0, 0.0, ops.select(mu > 1.0, 1.0, mu))
        alpha = ops.select(alpha < LEAST_ALPHA, LEAST_ALPHA, ops.select(alpha > 1.0, 1.0, alpha))
        return Lobe.from_residual(mu, alpha, residual)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an `.npz` file, whole or not at all: `values`, and `metadata` as JSON text.

        Raises
        ------
        InputError
            For another suffix, and where nothing can be written.
        """
        path = Path(path)
        choose("format", path.suffix.lower(), (".npz",))
        description = {
            "kind": _KIND,
            "version": 1,
            "layout": asdict(self.layout),
            "smith": self.smith,
            "distribution": self.distribution,
            "sha256": self.sha256,
            "metadata": dict(self.metadata),
        }
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(
                file, values=self.values, metadata=np.array(json.dumps(description))
            )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> LobeTable:
        """Read what `save` wrote.

        Raises
        ------
        InputError
            For missing, truncated or changed files, and for files of something else.
        """
        path = Path(path)
        if not path.is_file():
            raise input_error(f"no file '{path}'", "a table of lobes", "Check the path.")
        try:
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                values, description = file["values"], json.loads(str(file["metadata"]))
            if description["kind"] != _KIND:
                raise ValueError(f"kind '{description['kind']}'")
            table = cls(
                values,
                Layout(**description["layout"]),
                description["smith"],
                description["distribution"],
                description["metadata"],
            )
            expected = description["sha256"]
        except InputError:
            raise
        except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile,
                zlib.error, AttributeError) as error:  # fmt: skip
            raise input_error(
                f"'{path}' is no table of lobes ({error})",
                "what LobeTable.save writes",
                "Fit it anew: python scripts/fit_ltc.py.",
            ) from error
        if table.sha256 != expected:
            raise input_error(
                f"'{path}' with values that do not match the hash in its metadata",
                "a table as it was written",
                "Fit it anew: python scripts/fit_ltc.py.",
            )
        return table


@functools.cache
def load_lobes(smith: Smith = "separable") -> LobeTable:
    """The table that ships with the package: GGX with separable Smith masking and shadowing.

    Raises
    ------
    InputError
        For another convention; `scripts/fit_ltc.py --smith correlated` fits it in a minute.

    Examples
    --------
    >>> load_lobes().values.shape
    (64, 64, 4)
    """
    choose("smith", smith, SMITH)
    path = Path(__file__).parent / "data" / f"ltc-ggx-{smith}.npz"
    if not path.is_file():
        raise input_error(
            f"smith='{smith}', which does not ship",
            "'separable'",
            f"python scripts/fit_ltc.py --smith {smith} --out FILE makes it, LobeTable.load(FILE) "
            "reads it.",
        )
    return LobeTable.load(path)

"""What a comparison is about: a material as RGB indices of refraction, however it was given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._arguments import check_indices
from ._check import input_error
from .material import Material
from .parametrization import gulbrandsen_to_ior
from .spectra import load_material

__all__ = ["Subject", "from_gulbrandsen", "from_indices", "from_material"]


@dataclass(frozen=True, eq=False)
class Subject:
    """Indices of refraction per colour channel, and the spectrum they come from if there is one.

    Attributes
    ----------
    name : str
        Short, usable in file names.
    label : str
        For figures.
    eta, k : (3,) float
        Relative index of refraction of the red, green and blue channel.
    material : Material or None
    """

    name: str
    label: str
    eta: np.ndarray
    k: np.ndarray
    material: Material | None = None

    @property
    def grey(self) -> bool:
        """Whether all channels have the same index."""
        return bool(np.all(self.eta == self.eta[0]) and np.all(self.k == self.k[0]))


def from_material(name_or_path: str, **accept: Any) -> Subject:
    """A measured material by name, alias or file; its indices are white-balanced under D65.

    Parameters, errors: as `spectra.load_material`.
    """
    material = load_material(name_or_path, **accept)
    return Subject(material.name, material.name, *material.rgb_indices(), material)


def from_indices(eta: Sequence[float], k: Sequence[float]) -> Subject:
    """One grey index, or three: red, green and blue.

    Raises
    ------
    InputError
        For other counts, eta <= 0, k < 0, NaN or infinity.
    """
    triples = _triple("eta", eta), _triple("k", k)
    check_indices(*triples, "channel")
    return Subject(_file_name("eta-k", triples), _label(("η", "k"), triples), *triples)


def from_gulbrandsen(r: Sequence[float], g: Sequence[float]) -> Subject:
    """Reflectivity and edge tint (Gulbrandsen 2014), each one number or three.

    Raises
    ------
    InputError
        For other counts, r outside [0, 1) or g outside [0, 1].
    """
    triples = _triple("r", r), _triple("g", g)
    pairs = [gulbrandsen_to_ior(float(a), float(b)) for a, b in zip(*triples, strict=True)]
    eta, k = np.array(pairs).T
    return Subject(_file_name("r-g", triples), _label(("r", "g"), triples), eta, k)


Triples = tuple[np.ndarray, np.ndarray]


def _triple(name: str, values: Sequence[float]) -> np.ndarray:
    if len(values) not in (1, 3):
        raise input_error(
            f"{len(values)} values for {name}",
            "one for grey, or three: red, green, blue",
            f"For example --{name} 0.2 0.92 1.1",
        )
    return np.array(np.broadcast_to(np.asarray(values, np.float64), 3))


def _numbers(values: np.ndarray, separator: str = ", ") -> str:
    texts = [f"{value:g}" for value in values]
    return texts[0] if len(set(texts)) == 1 else separator.join(texts)


def _label(symbols: tuple[str, str], triples: Triples) -> str:
    parts = zip(symbols, map(_numbers, triples), strict=True)
    return ", ".join(f"{symbol} = {f'({v})' if ',' in v else v}" for symbol, v in parts)


def _file_name(prefix: str, triples: Triples) -> str:
    return "-".join([prefix, *(_numbers(values, "_") for values in triples)])

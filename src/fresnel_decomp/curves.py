"""Sets of Fresnel curves: what bases are trained on, and what every model is judged on."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._arguments import check_indices
from ._check import input_error
from .fresnel import conductor, transmittance
from .parametrization import gulbrandsen_to_ior

__all__ = [
    "SETS",
    "CurveSet",
    "dielectrics",
    "error_cosines",
    "gulbrandsen_grid",
    "low_index_corner",
    "measured_metals",
    "notebook_training_set",
    "talk_training_set",
]


@dataclass(frozen=True, eq=False)
class CurveSet:
    """Indices of refraction whose exact Fresnel curves form a set.

    Attributes
    ----------
    name : str
    eta, k : (n,) float64, eta > 0, k >= 0

    Raises
    ------
    InputError
        If eta and k are not two rows of that kind.

    Examples
    --------
    >>> import numpy as np
    >>> from fresnel_decomp import CurveSet
    >>> metals = CurveSet("two metals", np.array([0.18, 2.9]), np.array([3.4, 3.1]))
    >>> metals.reflectance([1.0, 0.2]).round(4)
    array([[0.9444, 0.945 ],
           [0.5326, 0.5322]])
    """

    name: str
    eta: np.ndarray
    k: np.ndarray

    def __post_init__(self) -> None:
        eta, k = (np.asarray(value, np.float64) for value in (self.eta, self.k))
        if eta.ndim != 1 or eta.shape != k.shape:
            raise input_error(
                f"eta and k of shapes {eta.shape} and {k.shape}",
                "two arrays of the same shape (n,)",
                "Flatten them after broadcasting: numpy.broadcast_arrays(eta, k).",
            )
        check_indices(eta, k, "curve")
        object.__setattr__(self, "eta", eta)
        object.__setattr__(self, "k", k)

    def __len__(self) -> int:
        return len(self.eta)

    def take(self, rows: Any) -> CurveSet:
        """The curves with these indices, or where a mask is true."""
        return CurveSet(self.name, self.eta[rows], self.k[rows])

    def reflectance(self, cos_theta: Any) -> np.ndarray:
        """(n, m) exact reflectances at (m,) cosines."""
        cos_theta = np.asarray(cos_theta, np.float64)
        return conductor(cos_theta, self.eta[:, None], self.k[:, None])

    def rescaled(self, cos_theta: Any) -> np.ndarray:
        """(n, m) curves shifted and rescaled to run from 0 (normal) to 1 (grazing incidence).

        (F - F0) / (1 - F0) = 1 - T / T0: with accurate transmittances nothing cancels, however
        near to 1 the reflectance is.
        """
        cos_theta = np.asarray(cos_theta, np.float64)
        # T0 > 0: indices are limited, so that none is a perfect mirror
        return 1.0 - transmittance(cos_theta, self.eta[:, None], self.k[:, None]) / self.t0

    @property
    def t0(self) -> np.ndarray:
        """(n, 1) transmittance at normal incidence, 1 - F0."""
        return transmittance(1.0, self.eta, self.k)[:, None]

    @property
    def sha256(self) -> str:
        """Hash of the indices: identifies the set in a basis' provenance."""
        data = np.stack([self.eta, self.k]).astype("<f8").tobytes()
        return hashlib.sha256(data).hexdigest()


def notebook_training_set() -> CurveSet:
    """The 1,000 curves of the authors' published notebook (belcour/sig2020_fresnel_decomposition).

    Row 0 is n = 1.1. Rows i = 1..999 have r = i/1000: up to r = .01 a conductor of reflectivity
    (r/.01) / (1 - 1e-5) + 1e-5 and edge tint 1, above it a dielectric with
    n = 1.01 + 1.99 (r - .01)/.99. The conductor of row 10 has a reflectivity above 1 and thus, in
    the notebook, n = -1e-5; its absolute value is used.
    """
    i = np.arange(1, 1000)
    r = i / 1000.0
    dielectric_eta = 1.01 + 1.99 * (r - 0.01) / 0.99
    reflectivity = r / 0.01 / (1.0 - 1e-5) + 1e-5
    metal_eta = np.abs((1.0 - reflectivity) / (1.0 + reflectivity))
    metal_k = 2.0 * np.sqrt(reflectivity) / (1.0 + reflectivity)
    metal = i <= 10
    eta = np.where(metal, metal_eta, dielectric_eta)
    k = np.where(metal, metal_k, 0.0)
    return CurveSet("notebook", np.append(1.1, eta), np.append(0.0, k))


def talk_training_set() -> CurveSet:
    """The notebook's training set without its row 10, whose reflectivity is above 1."""
    whole = notebook_training_set()
    keep = np.arange(len(whole)) != 10
    return CurveSet("talk", whole.eta[keep], whole.k[keep])


def dielectrics() -> CurveSet:
    """Set *a*: n = linspace(1.01, 3, 400)."""
    return CurveSet("a", np.linspace(1.01, 3.0, 400), np.zeros(400))


def gulbrandsen_grid() -> CurveSet:
    """Set *cp*: r = (i + 1/2)/64, g = linspace(0, 1, 65), those with n <= 6 (3,027 curves)."""
    r, g = np.meshgrid((np.arange(64) + 0.5) / 64, np.linspace(0.0, 1.0, 65), indexing="ij")
    eta, k = gulbrandsen_to_ior(r.ravel(), g.ravel())
    keep = eta <= 6.0
    return CurveSet("cp", eta[keep], k[keep])


def low_index_corner() -> CurveSet:
    """Set *low*: eta = linspace(.05, 1, 20) x k = linspace(.5, 8, 16)."""
    eta, k = np.meshgrid(np.linspace(0.05, 1.0, 20), np.linspace(0.5, 8.0, 16), indexing="ij")
    return CurveSet("low", eta.ravel(), k.ravel())


def measured_metals(names: Collection[str] | None = None) -> CurveSet:
    """Set *d*: the measured spectra that ship with Mitsuba, every nanometre of 380-780.

    Linear interpolation; duplicates are dropped, and the wavelengths at which interpolation would
    use a sample without a positive eta (15,846 curves remain). With `names` only these materials.
    """
    from ._data_sets import data_set_files
    from ._spectrum_files import read_spectrum
    from .spectra import list_materials, load_material

    rows = []
    for entry in list_materials():
        if entry.duplicate_of is not None or (names is not None and entry.name not in names):
            continue
        material = load_material(entry.name, allow_partial=True, allow_broken=True)
        first, last = material.wavelength_nm[[0, -1]]
        wavelength = np.arange(max(380, int(np.ceil(first))), min(780, int(last)) + 1.0)
        at, eta = read_spectrum(*data_set_files(entry.name))[0].T
        measured = np.interp(wavelength, at, eta <= 0.0) == 0.0
        rows.append(np.stack(material.at(wavelength[measured])))
    eta, k = np.concatenate(rows, axis=1)
    return CurveSet("d", eta, k)


SETS: dict[str, Callable[[], CurveSet]] = {
    "a": dielectrics,
    "cp": gulbrandsen_grid,
    "d": measured_metals,
    "low": low_index_corner,
}
"""What every model is judged on, by name."""


def error_cosines() -> tuple[np.ndarray, np.ndarray]:
    """Where errors are measured: (all points, those of them that are uniform in cosine).

    2,049 points uniform in cosine (for mean and RMSE); for the maximum also 1,801 uniform in the
    angle and 300 log-spaced cosines in [1e-6, .1], where curves are steep.
    """
    uniform = np.linspace(0.0, 1.0, 2049)
    by_angle = np.cos(np.linspace(0.0, np.pi / 2, 1801))
    steep = np.geomspace(1e-6, 0.1, 300)
    return np.concatenate([uniform, np.clip(by_angle, 0.0, 1.0), steep]), uniform

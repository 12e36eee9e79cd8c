"""Accurate Fresnel reflectance for real-time rendering: a preintegrable decomposition.

F(theta; eta) = sum_i c_i(eta) b_i(theta) after Belcour, Bati and Barla, "Bringing an Accurate
Fresnel to Real-Time Rendering: a Preintegrable Decomposition", SIGGRAPH 2020 Talks. Public names
are loaded on first use; importing the package runs nothing and sets no Mitsuba variant.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ._version import __version__

if TYPE_CHECKING:
    from . import accuracy as accuracy
    from . import albedo as albedo
    from . import albedo_estimates as albedo_estimates
    from . import albedo_refined as albedo_refined
    from . import anisotropy as anisotropy
    from . import area_light as area_light
    from . import basis as basis
    from . import basis_table as basis_table
    from . import bench as bench
    from . import closed_form as closed_form
    from . import colour as colour
    from . import converters as converters
    from . import curves as curves
    from . import doctor as doctor
    from . import energy as energy
    from . import extraction as extraction
    from . import fast_curves as fast_curves
    from . import fresnel as fresnel
    from . import images as images
    from . import inverse_curves as inverse_curves
    from . import inverse_fit as inverse_fit
    from . import irradiance as irradiance
    from . import ltc as ltc
    from . import ltc_fit as ltc_fit
    from . import material as material
    from . import metallic as metallic
    from . import microfacet as microfacet
    from . import mitsuba as mitsuba
    from . import models as models
    from . import node_search as node_search
    from . import notebook as notebook
    from . import parametrization as parametrization
    from . import plan as plan
    from . import prediction as prediction
    from . import random_walk as random_walk
    from . import recipes as recipes
    from . import regression as regression
    from . import regression_recipes as regression_recipes
    from . import report as report
    from . import representations as representations
    from . import singular_vectors as singular_vectors
    from . import spectra as spectra
    from . import split_albedo as split_albedo
    from . import subjects as subjects
    from . import table as table
    from . import table_files as table_files
    from . import table_layout as table_layout
    from ._check import InputError
    from .albedo import directional_albedo
    from .area_light import AreaLight, AreaMaterial, shade_area_light
    from .basis import Basis, FitErrors, load_basis
    from .basis_table import BasisTable
    from .closed_form import ClosedForm
    from .colour import delta_e_2000, gamut_excess, linear_to_srgb, rgb_weights
    from .converters import Converted, Loss, convert
    from .curves import CurveSet
    from .energy import EnergyTable
    from .extraction import extract_basis
    from .fresnel import (
        conductor,
        dielectric,
        polarized,
        reflectance_components,
        refracted_cosine,
        transmittance,
    )
    from .ltc import LobeTable, load_lobes
    from .material import Material
    from .models import F82, Decomposition, Exact, Gulbrandsen, Lazanyi, Schlick, model_from_ior
    from .parametrization import (
        f0_from_ior,
        f82_from_ior,
        gulbrandsen_to_ior,
        ior_to_gulbrandsen,
    )
    from .recipes import RECIPES
    from .representations import Curve, LinearTint, MetallicBase, NodeColours
    from .spectra import list_materials, load_material
    from .table import AlbedoTable

_HOMES = {
    "_check": ["InputError"],
    "albedo": ["directional_albedo"],
    "area_light": ["AreaLight", "AreaMaterial", "shade_area_light"],
    "basis": ["Basis", "FitErrors", "load_basis"],
    "basis_table": ["BasisTable"],
    "closed_form": ["ClosedForm"],
    "colour": ["delta_e_2000", "gamut_excess", "linear_to_srgb", "rgb_weights"],
    "converters": ["Converted", "Loss", "convert"],
    "curves": ["CurveSet"],
    "energy": ["EnergyTable"],
    "extraction": ["extract_basis"],
    "fresnel": [
        "conductor",
        "dielectric",
        "polarized",
        "reflectance_components",
        "refracted_cosine",
        "transmittance",
    ],
    "ltc": ["LobeTable", "load_lobes"],
    "models": [
        "F82",
        "Decomposition",
        "Exact",
        "Gulbrandsen",
        "Lazanyi",
        "Schlick",
        "model_from_ior",
    ],
    "parametrization": [
        "f0_from_ior",
        "f82_from_ior",
        "gulbrandsen_to_ior",
        "ior_to_gulbrandsen",
    ],
    "recipes": ["RECIPES"],
    "representations": ["Curve", "LinearTint", "MetallicBase", "NodeColours"],
    "material": ["Material"],
    "spectra": ["list_materials", "load_material"],
    "table": ["AlbedoTable"],
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}
_SUBMODULES = {
    *_HOMES,
    "accuracy",
    "albedo_estimates",
    "albedo_refined",
    "anisotropy",
    "bench",
    "doctor",
    "fast_curves",
    "images",
    "inverse_curves",
    "inverse_fit",
    "irradiance",
    "ltc_fit",
    "metallic",
    "microfacet",
    "mitsuba",
    "node_search",
    "notebook",
    "plan",
    "prediction",
    "random_walk",
    "regression",
    "regression_recipes",
    "report",
    "singular_vectors",
    "split_albedo",
    "subjects",
    "table_files",
    "table_layout",
} - {"_check"}

__all__ = [
    "F82",
    "RECIPES",
    "AlbedoTable",
    "AreaLight",
    "AreaMaterial",
    "Basis",
    "BasisTable",
    "ClosedForm",
    "Converted",
    "Curve",
    "CurveSet",
    "Decomposition",
    "EnergyTable",
    "Exact",
    "FitErrors",
    "Gulbrandsen",
    "InputError",
    "Lazanyi",
    "LinearTint",
    "LobeTable",
    "Loss",
    "Material",
    "MetallicBase",
    "NodeColours",
    "Schlick",
    "__version__",
    "conductor",
    "convert",
    "delta_e_2000",
    "dielectric",
    "directional_albedo",
    "extract_basis",
    "f0_from_ior",
    "f82_from_ior",
    "gamut_excess",
    "gulbrandsen_to_ior",
    "ior_to_gulbrandsen",
    "linear_to_srgb",
    "list_materials",
    "load_basis",
    "load_lobes",
    "load_material",
    "model_from_ior",
    "polarized",
    "reflectance_components",
    "refracted_cosine",
    "rgb_weights",
    "shade_area_light",
    "transmittance",
]


if not TYPE_CHECKING:  # a type checker would take any name for a public one

    def __getattr__(name: str) -> Any:
        if name in _HOME_OF:
            return getattr(importlib.import_module(f".{_HOME_OF[name]}", __name__), name)
        if name in _SUBMODULES:
            return importlib.import_module(f".{name}", __name__)
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*__all__, *_SUBMODULES})

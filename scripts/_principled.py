"""What the study of the principled BSDF compares: curves, energy, cost, and its pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from _figure import Job
from fresnel_decomp import (
    F82,
    RECIPES,
    AlbedoTable,
    Gulbrandsen,
    delta_e_2000,
    directional_albedo,
    load_basis,
    load_material,
)
from fresnel_decomp._schlick import schlick
from fresnel_decomp.converters import LARGEST_R
from fresnel_decomp.fresnel import dielectric
from fresnel_decomp.images import compare, write_exr
from fresnel_decomp.metallic import default_edge_colour, dielectric_eta, metal_coefficients
from fresnel_decomp.parametrization import F82_COSINE

COSINES = np.sin(np.radians(np.linspace(0.0, 90.0, 181)))
COPPER = (0.955, 0.638, 0.538)
METALLIC = (0.0, 0.25, 0.5, 0.75, 1.0)
ROUGHNESS = (0.1, 0.3, 0.5, 0.7, 1.0)
CARD = 0.3
"""Roughness of the pictures of edges and of the comparison."""

Array = np.ndarray
Results = Mapping[str, Any]


def rgb(colour: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(channel) for channel in colour]}


# --- curves --------------------------------------------------------------------------------------


def exact_metal(name: str) -> tuple[Array, Array, Array, Array]:
    """A measured metal in D65: curve (angles, 3); base, edge, (nodes, 3) colours in [0, 1]."""
    material, nodes = load_material(name), np.cos(load_basis().nodes)
    curve = material.rgb_reflectance(COSINES)
    colours = material.rgb_reflectance(np.array([1.0, F82_COSINE, *nodes])).clip(0.0, 1.0)
    return curve, colours[0], colours[1], colours[2:]


def metal_curves(base: Array, edge: Array, nodes: Array) -> dict[str, Array]:
    """What the plugin makes of a metal, by its Fresnel term and what it is told of the edge."""
    basis, cosines = load_basis(), COSINES[:, None]
    usual = default_edge_colour(base)
    at_nodes = basis.coefficients_from_reflectance(base, nodes.T)
    return {
        "decomposition": basis.evaluate(metal_coefficients(base, usual, basis), cosines),
        "decomposition, edge colour": basis.evaluate(
            metal_coefficients(base, edge, basis), cosines
        ),
        "decomposition, node colours": basis.evaluate(at_nodes, cosines),
        "exact, g = 0.5": Gulbrandsen(np.minimum(base, LARGEST_R), 0.5)(cosines),
        "schlick": schlick(base, cosines),
        "f82": F82(base, usual)(cosines),
        "f82, edge colour": F82(base, edge)(cosines),
    }


def dielectric_curves(eta: float) -> dict[str, Array]:
    basis, f0 = load_basis(), float(dielectric(1.0, eta))
    found = {
        "decomposition": basis.evaluate(basis.coefficients(eta, 0.0), COSINES),
        "exact, g = 0.5": dielectric(COSINES, eta),
        "schlick": schlick(f0, COSINES),
        "f82": F82(f0, float(dielectric(F82_COSINE, eta)))(COSINES),
    }
    found = {name: np.repeat(curve[:, None], 3, axis=1) for name, curve in found.items()}
    found["decomposition, edge colour"] = found["decomposition, node colours"] = found[
        "decomposition"
    ]
    found["f82, edge colour"] = found["f82"]
    return found


def curve_errors() -> dict[str, dict[str, dict[str, float]]]:
    """RMSE, largest error and mean ΔE00, by material and Fresnel term."""
    truth: dict[str, tuple[Array, dict[str, Array]]] = {}
    for label, name in {"copper": "Cu", "gold": "Au", "aluminium": "Al"}.items():
        curve, *colours = exact_metal(name)
        truth[label] = curve, metal_curves(*colours)
    for label, eta in {"plastic, η = 1.5": 1.5, "lacquer, η = 1.8": 1.8}.items():
        exact = np.repeat(dielectric(COSINES, eta)[:, None], 3, axis=1)
        truth[label] = exact, dielectric_curves(eta)
    copper, plastic = truth["copper"], truth["plastic, η = 1.5"]
    truth["copper and plastic, halves"] = (
        0.5 * (copper[0] + plastic[0]),
        {name: 0.5 * (copper[1][name] + plastic[1][name]) for name in copper[1]},
    )
    return {
        label: {name: measured(curve, exact) for name, curve in curves.items()}
        for label, (exact, curves) in truth.items()
    }


def measured(curve: Array, exact: Array) -> dict[str, float]:
    error = np.abs(curve - exact)
    return {
        "rmse": float(np.sqrt((error**2).mean())),
        "largest": float(error.max()),
        "delta_e": float(delta_e_2000(curve, exact).mean()),
    }


def recipe_errors() -> dict[str, dict[str, float]]:
    """Of plastic, by recipe: of the curve, and of its albedo at roughness 0.5, seen at 60°."""
    exact, alpha = dielectric(COSINES, 1.5), 0.25
    true = directional_albedo(lambda c: dielectric(c, 1.5)[..., None], 0.5, alpha)[..., 0]
    found = {}
    for recipe in RECIPES:
        basis = load_basis(recipe)
        c = basis.coefficients(1.5, 0.0)
        lobe = directional_albedo(basis, 0.5, alpha) @ c
        error = np.abs(basis.evaluate(c, COSINES) - exact)
        found[recipe] = {
            "largest": float(error.max()),
            "rmse": float(np.sqrt((error**2).mean())),
            "albedo": float(lobe / true - 1.0),
        }
    return found


def mixing_errors() -> dict[str, dict[str, float]]:
    """Largest difference of mixing F0 first, for a curve afterwards, from mixing the curves."""
    basis, cosines, found = load_basis(), COSINES[:, None], {}
    c_plastic = basis.coefficients(1.5, 0.0)
    ways: dict[str, Callable[[Array], Array]] = {
        "index, k = 0": lambda f0: Gulbrandsen(np.minimum(f0, LARGEST_R), 0.0)(cosines),
        "usual edge": lambda f0: basis.evaluate(
            metal_coefficients(f0, default_edge_colour(f0), basis), cosines
        ),
        "Schlick": lambda f0: schlick(f0, cosines),
    }
    for label, name in {"copper": "Cu", "aluminium": "Al"}.items():
        _, base, _, _ = exact_metal(name)
        c_metal = metal_coefficients(base, default_edge_colour(base), basis)
        for way, curve in ways.items():
            row = {}
            for metallic in METALLIC:
                mixed = basis.evaluate((1.0 - metallic) * c_plastic + metallic * c_metal, cosines)
                if way == "Schlick":  # both ways by its own curve
                    mixed = (1.0 - metallic) * schlick(0.04, cosines) + metallic * schlick(
                        base, cosines
                    )
                first = curve(0.04 * (1.0 - metallic) + base * metallic)
                row[f"{metallic:g}"] = float(np.abs(first - mixed).max())
            found[f"{label}, {way}"] = row
    return found


# --- energy --------------------------------------------------------------------------------------


def furnace() -> dict[str, dict[str, float]]:
    """What a white plastic lacks or has too much, by roughness, without any sampling.

    Lobe and base reflect E + (1 - E') where E is the lobe's albedo by quadrature and E' what the
    table gives; the base's own integral is 1 because the average fits the table.
    """
    basis, mu = load_basis(), np.concatenate([np.geomspace(1e-3, 0.1, 40), np.linspace(0.1, 1, 46)])
    c = basis.coefficients(1.5, 0.0)
    closed = basis.closed_form
    table = AlbedoTable.bake(closed)
    six = load_basis("talk", 6)
    table_six, c_six = AlbedoTable.bake(six.closed_form), six.coefficients(1.5, 0.0)
    found = {}
    for roughness in ROUGHNESS:
        alpha = roughness**2
        lobe = directional_albedo(closed, mu, alpha, quadrature=(48, 48))
        missing = lobe @ c - table.lookup(mu, alpha) @ c
        exact = directional_albedo(
            lambda x: dielectric(x, 1.5)[..., None], mu, alpha, quadrature=(48, 48)
        )[..., 0]
        missing_exact = exact - table_six.lookup(mu, alpha) @ c_six
        steep = mu < 0.1
        found[f"{roughness:g}"] = {
            "decomposition": float(np.abs(missing[~steep]).max()),
            "decomposition, beyond 84°": float(np.abs(missing[steep]).max()),
            "exact": float(np.abs(missing_exact[~steep]).max()),
            "exact, beyond 84°": float(np.abs(missing_exact[steep]).max()),
            "lost by a white metal at 0°": float(1.0 - lobe[-1, 0]),
            "lost by a white metal at 60°": float(1.0 - lobe[np.argmin(np.abs(mu - 0.5)), 0]),
            "kept from a plastic's lobe at 0°": float((1.0 - lobe[-1, 0]) * dielectric(1.0, 1.5)),
        }
    return found


INDICES = {
    **{f"η = {eta:g}": eta for eta in (1.0, 1.0003, 1.001, 1.003, 1.01, 1.1, 1.5, 2.4)},
    "F0 = 0.8": float(dielectric_eta(0.8)),
    "F0 = 0.99": float(dielectric_eta(0.99)),
}


def furnace_of_indices() -> dict[str, dict[str, float]]:
    """How far white plastics of other indices are from giving back all light, with `exact`.

    At cosines from 0.02, over three roughnesses.
    """
    from fresnel_decomp.mitsuba.principled import LEAST_ROOT

    mu, six = np.geomspace(0.02, 1.0, 40), load_basis("talk", 6)
    table, found = AlbedoTable.bake(six.closed_form), {}
    for name, eta in INDICES.items():
        root = (eta - 1.0) / (eta + 1.0)
        c = six.coefficients(eta, 0.0) * min(root / LEAST_ROOT, 1.0)
        row = {}
        for roughness in (0.1, 0.3, 0.6):
            alpha = roughness**2

            def exact(x: Any, eta: float = eta) -> Any:
                return dielectric(x, eta)[..., None]

            albedo = directional_albedo(exact, mu, alpha, quadrature=(48, 48))[..., 0]
            missing = albedo - table.lookup(mu, alpha) @ c
            row[f"roughness {roughness:g}"] = float(missing[np.argmax(np.abs(missing))])
        found[name] = row
    return found


# --- cost ----------------------------------------------------------------------------------------

PLUGINS: dict[str, dict[str, Any]] = {
    "Mitsuba's principled": {"type": "principled"},
    **{
        f"decomposed_principled, {fresnel}": {"type": "decomposed_principled", "fresnel": fresnel}
        for fresnel in ("decomposition", "exact", "schlick", "f82")
    },
}


def costs(variant: str, quick: bool) -> dict[str, dict[str, list[float]]]:
    """Ratio to Mitsuba's principled and its spread: of `eval`, `sample` and whole renders."""
    from fresnel_decomp.mitsuba.timing import kernel_times, ratio_and_spread
    from fresnel_decomp.mitsuba.variants import variant_scope

    look = {"base_color": rgb(COPPER), "metallic": 0.5, "roughness": 0.5}
    bsdfs = {name: {**bsdf, **look} for name, bsdf in PLUGINS.items()}
    size, spp, runs = (16, 1, 7) if quick else (160, 16, 15)
    first = next(iter(bsdfs))
    with variant_scope(variant):
        import mitsuba as mi

        mi.set_log_level(mi.LogLevel.Error)
        renders = kernel_times(bsdfs, size=size, spp=spp, runs=runs, reference=first)
        alone = alone_times(bsdfs, 2000 if quick else 1_000_000, runs)
    found = {}
    for name in bsdfs:
        found[name] = {"render": [renders[name].ratio, renders[name].spread]}
        for method, times in alone.items():
            found[name][method] = list(ratio_and_spread(times[name], times[first]))
    return found


def alone_times(
    bsdfs: Mapping[str, Any], points: int, runs: int
) -> dict[str, dict[str, list[float]]]:
    """Kernel milliseconds of `eval` and `sample` on random directions, taking turns."""
    import drjit as dr
    import mitsuba as mi

    from fresnel_decomp.mitsuba.timing import interleaved_times
    from fresnel_decomp.mitsuba.workloads import bsdf_evaluation, directions

    if str(mi.variant()).startswith("scalar"):
        return {}
    si, wo = directions(points)
    sampler = mi.PCG32(size=points, initseq=1)
    lobe = sampler.next_float32()
    place = mi.Point2f(sampler.next_float32(), sampler.next_float32())
    dr.eval(lobe, place)
    ctx = mi.BSDFContext()

    def sampling(plugin: Any) -> Callable[[], None]:
        return lambda: dr.eval(plugin.sample(ctx, si, lobe, place, True))

    plugins = {name: mi.load_dict(bsdf) for name, bsdf in bsdfs.items()}
    return interleaved_times(
        {
            "eval": {name: bsdf_evaluation(plugin, si, wo) for name, plugin in plugins.items()},
            "sample": {name: sampling(plugin) for name, plugin in plugins.items()},
        },
        runs,
    )


# --- pictures ------------------------------------------------------------------------------------


def ours(**parameters: Any) -> dict[str, Any]:
    return {"type": "decomposed_principled", "recipe": "talk", "terms": 4, **parameters}


def theirs(**parameters: Any) -> dict[str, Any]:
    return {"type": "principled", **parameters}


def edge_bsdfs(name: str) -> dict[str, dict[str, Any]]:
    """A metal exactly, and by what the metallic workflow knows of it."""
    _, base, edge, nodes = exact_metal(name)
    spectral = {"type": "decomposed_conductor", "recipe": "talk", "terms": 6}
    spectral |= {"material": name, "illuminant": "D65", "distribution": "ggx"}
    shared = {"metallic": 1.0, "roughness": CARD, "base_color": rgb(base)}
    known = {f"edge_color_{i + 1}": rgb(node) for i, node in enumerate(nodes)}
    return {
        "exact": {**spectral, "alpha": CARD**2},
        "schlick": ours(**shared, fresnel="schlick"),
        "usual": ours(**shared),
        "edge": ours(**shared, edge_color=rgb(edge)),
        "nodes": ours(**shared, **known),
    }


def compared_bsdfs(metallic: float) -> dict[str, dict[str, Any]]:
    shared = {"base_color": rgb(COPPER), "metallic": metallic, "roughness": CARD}
    return {"theirs": theirs(**shared, eta=1.5), "ours": ours(**shared, eta=1.5)}


def textured(folder: Path) -> dict[str, Any]:
    """Worn paint on copper: base colour, metallic and roughness from images."""
    size = 256
    y, x = np.mgrid[:size, :size] / size
    rng = np.random.default_rng(3)
    waves = sum(
        np.cos(2.0 * np.pi * (i * x + j * y) + rng.uniform(0.0, 6.3)) / (i + j)
        for i in range(1, 9)
        for j in range(1, 9)
    )
    worn = np.clip(0.5 + 1.6 * (waves / np.abs(waves).max() - 0.05), 0.0, 1.0)[..., None]
    paint = np.where(np.floor(8.0 * y)[..., None] % 2 == 0, (0.05, 0.16, 0.32), (0.62, 0.6, 0.55))
    images = {
        "base_color": (1.0 - worn) * paint + worn * np.array(COPPER),
        "metallic": np.repeat(worn, 3, axis=2),
        "roughness": 0.5 - 0.25 * np.repeat(worn, 3, axis=2),
    }
    textures = {}
    for name, image in images.items():
        path = folder / f"texture_{name}.exr"
        write_exr(path, image.astype(np.float32))  # also over that of an older version
        textures[name] = {"type": "bitmap", "filename": str(path), "raw": True}
    return ours(**textures)


def render(job: Job) -> dict[str, Any]:
    """All pictures; the numbers of those that are compared."""
    from fresnel_decomp.mitsuba.comparison import render_bsdfs

    options = {name: job.settings[name] for name in ("scene", "spp", "seed", "variant")}
    size = job.settings["size"]
    small = max(16, size // 2)
    for metallic in METALLIC:
        bsdfs = {
            f"{roughness:g}": ours(base_color=rgb(COPPER), metallic=metallic, roughness=roughness)
            for roughness in ROUGHNESS
        }
        render_bsdfs(bsdfs, size=small, folder=job.folder, stem=f"grid_{metallic:g}", **options)
        job.report(f"metallic {metallic:g}", 0.5 * (1.0 + metallic) - 0.3)
    render_bsdfs({"textured": textured(job.folder)}, size=size, folder=job.folder,
                 stem="images", **options)  # fmt: skip
    numbers: dict[str, Any] = {}
    for metal in ("Au", "Cu"):
        images = render_bsdfs(
            edge_bsdfs(metal), size=size, folder=job.folder, stem=f"edge_{metal}", **options
        )
        numbers[metal] = {
            name: compare(images["exact"], image).summary()
            for name, image in images.items()
            if name != "exact"
        }
        job.report(f"edges of {metal}", 0.8)
    for metallic in (0.0, 0.5, 1.0):
        images = render_bsdfs(compared_bsdfs(metallic), size=size, folder=job.folder,
                              stem=f"mitsuba_{metallic:g}", **options)  # fmt: skip
        numbers[f"{metallic:g}"] = compare(images["theirs"], images["ours"]).summary()
    return numbers


def compute(job: Job) -> dict[str, Any]:
    numbers = {
        "curves": curve_errors(),
        "recipes": recipe_errors(),
        "mixing": mixing_errors(),
        "furnace": furnace(),
        "indices": furnace_of_indices(),
    }
    job.report("renders", 0.2)
    numbers["renders"] = render(job)
    job.report("times", 0.9)
    numbers["cost"] = costs(job.settings["variant"], "quick" in job.settings)
    return numbers

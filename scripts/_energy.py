"""What the energy study compares: walks, closed forms, furnaces, pictures of spheres."""

from __future__ import annotations

from typing import Any

import numpy as np

import _kept
from _figure import Job
from fresnel_decomp import conductor, directional_albedo, load_basis, load_material
from fresnel_decomp.energy import EnergyTable, fdez_aguera, kulla_conty, missing, turquin
from fresnel_decomp.images import nrmse
from fresnel_decomp.microfacet import DISTRIBUTIONS, SMITH
from fresnel_decomp.random_walk import random_walk_albedo

METALS = {"Be": "Beryllium", "Au": "Gold", "Al": "Aluminium"}
ALPHAS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 1.0)
MU = (0.01, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
FORMS = {
    "single": "single bounce",
    "turquin": "Turquin, F₀",
    "fdez_aguera": "Fdez-Agüera",
    "kulla_conty": "Kulla–Conty, F_avg",
    "ours": "ours, F₁",
}
SHADING = "correlated"
"""Shadowing of the pictures, which the plugin has with compensation."""
BOUND = 0.03
"""On errors of the albedo up to alpha = .6."""
SPHERES = (0.1, 0.3, 0.6, 1.0)
KINDS = {
    "none": "single bounce",
    "lobe": "lobe",
    "scaling": "scaling",
    "split": "split-sum, scaled",
    "split_none": "split-sum, single",
}


def indices() -> tuple[np.ndarray, np.ndarray]:
    """(9,) eta and k: three channels of each metal."""
    found = [load_material(name).rgb_indices() for name in METALS]
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])


def walk(job: Job, alpha: float, paths: int) -> dict[str, np.ndarray]:
    """Albedos of one roughness: columns mu, a and e (its standard error) by channel; kept."""

    def make() -> dict[str, np.ndarray]:
        eta, k = indices()

        def f(cos_theta: Any) -> np.ndarray:
            return conductor(np.asarray(cos_theta)[..., None], eta, k)

        rows = [random_walk_albedo(f, mu, alpha, paths, seed=i) for i, mu in enumerate(MU)]
        columns = {"mu": np.array(MU)}
        for i in range(len(eta)):
            columns[f"a{i}"] = np.array([row.albedo[i] for row in rows])
            columns[f"e{i}"] = np.array([row.standard_error[i] for row in rows])
        return columns

    return _kept.table(job, walk_stem(alpha, paths), make)


def walk_stem(alpha: float, paths: int) -> str:
    """Of the file of a roughness."""
    return f"walk_alpha{alpha:g}_{paths}"


def closed_forms(energy: EnergyTable, alpha: float) -> dict[str, np.ndarray]:
    """(mu, channels) albedo of every form."""
    basis, mu = load_basis(), np.array(MU)
    c = basis.coefficients(*indices())
    functions = energy.table.lookup(mu, np.full(mu.shape, alpha))
    single, white = functions @ c.T, functions[:, :1]
    average = energy.average_fresnel(c)
    loss = energy.losses.lookup(alpha, alpha)[0]
    share = missing(white) / white
    return {
        "single": single,
        "turquin": turquin(single, white, c[:, 0]),
        "fdez_aguera": fdez_aguera(single, white, average),
        "kulla_conty": kulla_conty(single, white, loss, average),
        "ours": single * (1.0 + energy.factor(c, np.full(len(c), alpha)) * share),
    }


def furnace(distribution: Any, smith: Any) -> dict[str, float]:
    """Largest loss of a perfect reflector, before and after, off the nodes of the table too."""
    basis = load_basis()
    energy = EnergyTable.bake(basis, smith=smith, distribution=distribution)
    worst = {"single": 0.0, "compensated": 0.0, "mu >= .05": 0.0}
    mu = np.array([0.002, 0.005, *MU, 0.037, 0.33, 0.71])
    for alpha in (0.004, 0.013, *ALPHAS, 0.37, 0.77):
        exact = directional_albedo(
            lambda c: 1.0 + 0.0 * c, mu, alpha, smith=smith, distribution=distribution
        )
        white = energy.table.lookup(mu, np.full(mu.shape, alpha))[:, 0]
        error = np.abs(exact + missing(white) - 1.0)
        worst["single"] = max(worst["single"], float((1.0 - exact).max()))
        worst["compensated"] = max(worst["compensated"], float(error.max()))
        worst["mu >= .05"] = max(worst["mu >= .05"], float(error[mu >= 0.05].max()))
    return worst


def pictures(job: Job) -> dict[str, Any]:
    """Gold spheres by all kinds, and how far they are apart."""
    import mitsuba as mi

    from fresnel_decomp.mitsuba.comparison import conductor_bsdf, render_scene
    from fresnel_decomp.mitsuba.prefilter import prefilter
    from fresnel_decomp.mitsuba.scenes import lit_object
    from fresnel_decomp.mitsuba.skies import city
    from fresnel_decomp.mitsuba.split_sum import SplitMaterial, render_split_sum
    from fresnel_decomp.mitsuba.variants import variant_scope
    from fresnel_decomp.mitsuba.visible_surface import visible_surface
    from fresnel_decomp.split_albedo import SplitAlbedo, compensated_albedo

    size, spp, seed = (job.settings[name] for name in ("size", "spp", "seed"))
    basis = load_basis()
    eta, k = load_material("Au").rgb_indices()
    energy = EnergyTable.bake(basis, smith=SHADING)
    coefficients = basis.coefficients(eta, k)
    found: dict[str, Any] = {}
    with variant_scope(job.settings["variant"]):
        sky = city(512 if size > 64 else 64)
        light = prefilter(sky)
        bare = conductor_bsdf(eta, k, fresnel="decomposition")
        plain = mi.load_dict(lit_object(bare, sky.emitter(), size, background=False))
        _kept.image(job, "coverage", lambda: visible_surface(plain, 64, seed).coverage())
        for i, alpha in enumerate(SPHERES):
            images = {}

            def scene(kind: str, alpha: float = alpha) -> Any:
                bsdf = conductor_bsdf(eta, k, alpha=alpha, fresnel="decomposition")
                # both as the plugin has it with compensation, so that they differ by that alone
                bsdf |= {"smith": SHADING}
                if kind != "none":
                    bsdf |= {"energy_compensation": True, "compensation": kind}
                return mi.load_dict(lit_object(bsdf, sky.emitter(), size, background=False))

            for kind in KINDS:
                if kind.startswith("split"):

                    def make(kind: str = kind, alpha: float = alpha) -> np.ndarray:
                        albedo = (
                            SplitAlbedo(energy.table, coefficients)
                            if kind == "split_none"
                            else compensated_albedo(energy, coefficients)
                        )
                        surface = visible_surface(scene("none"), 16, seed)
                        material = SplitMaterial(albedo, alpha)
                        image = render_split_sum(surface, light, material, background=False)
                        return np.array(image)
                else:

                    def make(kind: str = kind) -> np.ndarray:
                        return render_scene(scene(kind), spp, seed)

                stem = f"au_alpha{alpha:g}_{kind}"
                images[kind] = _kept.image(job, stem, make, smith=SHADING)
            inside = images["none"].sum(axis=-1) > 0.0
            inside[1:-1] &= inside[2:] & inside[:-2]
            inside[:, 1:-1] &= inside[:, 2:] & inside[:, :-2]
            means = {kind: image[inside].mean(axis=0).tolist() for kind, image in images.items()}
            pairs = {
                "lobe": ("lobe", "split"),
                "scaling": ("scaling", "split"),
                "single": ("none", "split_none"),
                "uncompensated": ("lobe", "split_none"),
            }
            found[f"{alpha:g}"] = {
                "means": means,
                "nrmse": {
                    name: nrmse(images[a][inside][None], images[b][inside][None])
                    for name, (a, b) in pairs.items()
                },
            }
            job.report(f"spheres, alpha {alpha:g}", 0.5 + 0.5 * (i + 1) / len(SPHERES))
    return found


def compute(job: Job) -> dict[str, Any]:
    paths = 1 << (11 if job.settings.get("quick") else 16)
    basis = load_basis()
    tables = {s: EnergyTable.bake(basis, smith=s) for s in SMITH}
    errors: dict[str, Any] = {}
    for i, alpha in enumerate(ALPHAS):
        found = walk(job, alpha, paths)
        walked = np.stack([found[f"a{j}"] for j in range(9)], axis=-1)
        spread = np.stack([found[f"e{j}"] for j in range(9)], axis=-1)
        rows: dict[str, Any] = {"standard_error": float(spread.max())}
        for smith, energy in tables.items():
            for form, values in closed_forms(energy, alpha).items():
                error = np.abs(values - walked)
                rows[f"{smith} {form}"] = {
                    "metals": [float(error[:, 3 * m : 3 * m + 3].max()) for m in range(3)],
                    "away": float(error[np.array(MU) >= 0.2].max()),
                }
        errors[f"{alpha:g}"] = rows
        job.report(f"walk, alpha {alpha:g}", 0.5 * (i + 1) / len(ALPHAS))
    return {
        "paths": paths,
        "errors": errors,
        "furnace": {f"{d} {s}": furnace(d, s) for d in DISTRIBUTIONS for s in SMITH},
        "pictures": pictures(job),
        "operations": operations(job.settings["variant"]),
    }


def operations(variant: str) -> dict[str, int]:
    """Floating-point operations of a split-sum albedo in three channels, fetch included."""
    from fresnel_decomp.mitsuba.operations import count_operations
    from fresnel_decomp.mitsuba.variants import variant_scope
    from fresnel_decomp.split_albedo import SplitAlbedo, compensated_albedo

    if variant.startswith("scalar"):
        return {}
    basis = load_basis()
    energy = EnergyTable.bake(basis)
    c = basis.coefficients(*load_material("Au").rgb_indices())
    single, scaled = SplitAlbedo(energy.table, c), compensated_albedo(energy, c)
    factors = energy.factor(c, np.full(3, 0.3)).tolist()

    def constant(mu: Any, alpha: Any) -> list[Any]:
        white = energy.table.lookup(mu, alpha)[0]
        share = missing(white) / white
        return [f * (1.0 + k * share) for f, k in zip(single(mu, alpha), factors, strict=True)]

    with variant_scope(variant):
        kinds = {"single bounce": single, "scaled, K of the material": constant,
                 "scaled, K of the pixel": scaled}  # fmt: skip
        return {name: count_operations(f, 0.5, 0.3).total() for name, f in kinds.items()}

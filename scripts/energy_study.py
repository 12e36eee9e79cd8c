"""Energy compensation against a random walk over microfacets, and in pictures.

    python scripts/energy_study.py --page docs/energy.md
    python scripts/energy_study.py --quick    # few paths, tiny images

Interrupt it when you like: finished walks and images are kept, and the same command goes on.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from _figure import (
    Figure,
    Job,
    main,
    read_sidecar,
    read_table,
    study,
    write_table,
)
from _markdown import markdown
from _page import Page
from fresnel_decomp import conductor, directional_albedo, load_basis, load_material
from fresnel_decomp.energy import EnergyTable, fdez_aguera, kulla_conty, missing, turquin
from fresnel_decomp.images import nrmse, read_exr, read_exr_attributes, write_exr
from fresnel_decomp.microfacet import DISTRIBUTIONS, SMITH
from fresnel_decomp.random_walk import random_walk_albedo
from fresnel_decomp.report import style

NAME = "energy_study"
MARKS = ("<!-- energy study -->\n", "<!-- end of energy study -->\n")
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
    path = job.folder / f"walk_alpha{alpha:g}_{paths}.csv"
    if not path.is_file():
        eta, k = indices()

        def f(cos_theta: Any) -> np.ndarray:
            return conductor(np.asarray(cos_theta)[..., None], eta, k)

        rows = [random_walk_albedo(f, mu, alpha, paths, seed=i) for i, mu in enumerate(MU)]
        columns = {"mu": np.array(MU)}
        for i in range(len(eta)):
            columns[f"a{i}"] = np.array([row.albedo[i] for row in rows])
            columns[f"e{i}"] = np.array([row.standard_error[i] for row in rows])
        write_table(path, columns)
    return read_table(path)


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


def kept(job: Job, stem: str, make: Callable[[], np.ndarray]) -> np.ndarray:
    path = job.folder / f"{stem}.exr"
    settings = {k: v for k, v in job.settings.items() if k != "parameters"}
    text = json.dumps(settings | {"smith": SHADING}, sort_keys=True)
    with contextlib.suppress(ValueError):  # not an EXR file: make it anew
        if path.is_file() and read_exr_attributes(path).get("energyStudy") == text:
            return read_exr(path)
    write_exr(path, make(), {"energyStudy": text})
    return read_exr(path)


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
        kept(job, "coverage", lambda: visible_surface(plain, 64, seed).coverage())
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

                images[kind] = kept(job, f"au_alpha{alpha:g}_{kind}", make)
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


# --- tables --------------------------------------------------------------------------------------


def within(errors: Mapping[str, Any]) -> str:
    """What remains at alpha <= .6 with either shadowing, against the bound, in a sentence."""
    found = {
        smith: max(max(errors[f"{a:g}"][f"{smith} ours"]["metals"]) for a in ALPHAS if a <= 0.6)
        for smith in ("correlated", "separable")
    }
    words = ", ".join(
        f"{error:.3f} with {smith} Smith ({'within' if error <= BOUND else 'above'} {BOUND:g})"
        for smith, error in found.items()
    )
    return f"Largest error of ours up to α = 0.6: {words}."


def report(results: Mapping[str, Any]) -> str:
    """The tables of the page."""
    errors = results["errors"]
    parts = []
    for smith in ("correlated", "separable"):
        rows = []
        for form, label in FORMS.items():
            cells = [max(errors[f"{a:g}"][f"{smith} {form}"]["metals"]) for a in ALPHAS]
            rows.append([label, *(f"{cell:.3f}" for cell in cells)])
        head = [f"{smith} Smith, α =", *(f"{a:g}" for a in ALPHAS)]
        parts.append(markdown(head, rows))
    parts.append(within(errors))
    noise = max(errors[f"{a:g}"]["standard_error"] for a in ALPHAS)
    parts.insert(
        0,
        f"Largest error of the albedo against the random walk ({results['paths']} paths, standard "
        f"error at most {noise:.4f}) over {len(MU)} view angles with cosines from {MU[0]:g} to 1, "
        "three metals and three channels:",
    )
    rows = []
    upto = [f"{a:g}" for a in ALPHAS if a <= 0.6]
    for smith in ("correlated", "separable"):
        for i, metal in enumerate(METALS.values()):
            values = [
                max(errors[a][f"{smith} {form}"]["metals"][i] for a in group)
                for form in ("single", "kulla_conty", "ours")
                for group in (upto, ["1"])
            ]
            rows.append([f"{metal}, {smith}", *(f"{value:.3f}" for value in values)])
    parts.append("By metal:")
    head = ["", "single, α ≤ .6", "α = 1", "Kulla–Conty, α ≤ .6", "α = 1", "ours, α ≤ .6", "α = 1"]
    parts.append(markdown(head, rows))
    parts.append("White furnace, the largest distance from 1 over all angles and roughnesses:")
    rows = [
        [name, *(f"{found[key]:.4f}" for key in ("single", "compensated", "mu >= .05"))]
        for name, found in results["furnace"].items()
    ]
    parts.append(markdown(["", "single bounce", "compensated", "there of μ ≥ .05"], rows))
    parts.append("Gold spheres, path traced against split-sum, NRMSE in percent over the object:")
    rows = [
        [
            f"α = {alpha}",
            *(
                f"{100.0 * found['nrmse'][key]:.1f}"
                for key in ("single", "lobe", "scaling", "uncompensated")
            ),
            f"{found['means']['lobe'][2] / found['means']['none'][2]:.3f}",
            f"{found['means']['split'][2] / found['means']['split_none'][2]:.3f}",
        ]
        for alpha, found in results["pictures"].items()
    ]
    head = ["", "both single", "lobe, scaled", "scaling, scaled", "lobe, single"]
    parts.append(markdown([*head, "blue gains, path traced", "split-sum"], rows))
    counted = ", ".join(f"{name} {n}" for name, n in results["operations"].items())
    parts.append(f"Floating-point operations of a split-sum albedo, fetch included: {counted}.")
    return "\n\n".join(parts)


# --- pictures ------------------------------------------------------------------------------------


def draw(folder: Path, pictures: Path) -> None:
    results = read_sidecar(NAME, folder)["results"]
    draw_spheres(folder, pictures / FIGURE.pictures[0])
    draw_curves(folder, results["paths"], pictures / FIGURE.pictures[1])


def draw_spheres(folder: Path, path: Path) -> None:
    """A row per kind, a column per roughness."""
    rows = {k: KINDS[k] for k in ("none", "lobe", "scaling", "split")}
    titles = {
        "none": "path traced,\nsingle bounce",
        "lobe": "path traced,\nlobe",
        "scaling": "path traced,\nscaling",
        "split": "split-sum,\nscaling",
    }
    side, gap, left, top = 1.45, 0.06, 0.95, 0.34
    with style.styled():
        page = Page(left + len(SPHERES) * (side + gap) + 0.04, top + len(rows) * (side + gap))
        for j, alpha in enumerate(SPHERES):
            page.write(left + j * (side + gap) + side / 2, 0.18, f"α = {alpha:g}", size=10)
            white = 1.0 - read_exr(folder / "coverage.exr")[..., :1]
            for i, kind in enumerate(rows):
                image = read_exr(folder / f"au_alpha{alpha:g}_{kind}.exr")
                image = image + white
                y = top + i * (side + gap)
                page.picture(left + j * (side + gap), y, side, image)
                if j == 0:
                    page.write(left - 0.08, y + side / 2, titles[kind], size=8.5, ha="right")
        page.save(path, dpi=120)


def draw_curves(folder: Path, paths: int, path: Path) -> None:
    """Albedo over the cosine: random walk, single bounce, Kulla–Conty and ours."""
    basis = load_basis()
    energy = EnergyTable.bake(basis)
    channels = {"Beryllium, green": 1, "Gold, blue": 5, "Aluminium, green": 7}
    looks: dict[str, Any] = {
        "single": {"color": "#909090", "ls": (0, (1, 1.2))},
        "kulla_conty": {"color": style.MODEL_COLOURS["schlick"], "ls": (0, (4, 1.2))},
        "ours": {"color": style.MODEL_COLOURS["decomposition"], "ls": "-"},
    }
    names = {"single": "single bounce", "kulla_conty": "Kulla–Conty, $F_{avg}$",
             "ours": "ours, $F_1$"}  # fmt: skip
    with style.styled():
        page = Page(7.6, 4.6)
        for i, alpha in enumerate((0.1, 0.6)):
            found, forms = read_table(folder / f"walk_alpha{alpha:g}_{paths}.csv"), {}
            forms = closed_forms(energy, alpha)
            for j, (label, channel) in enumerate(channels.items()):
                axes = page.axes(0.62 + 2.36 * j, 0.3 + 2.0 * i, 2.0, 1.5)
                for form, look in looks.items():
                    axes.plot(MU, forms[form][:, channel], label=names[form], lw=1.4, **look)
                axes.plot(MU, found[f"a{channel}"], "o", ms=3.5, color="black",
                          label="random walk", mfc="none")  # fmt: skip
                axes.set_title(f"{label}, α = {alpha:g}", size=9)
                if i == 1:
                    axes.set_xlabel("cosine of the view angle")
                if j == 0:
                    axes.set_ylabel("directional albedo")
                if (i, j) == (0, 0):
                    handles = axes.get_legend_handles_labels()
        page.figure.legend(*handles, loc="lower center", ncol=4, bbox_to_anchor=(0.5, 0.0))
        page.save(path, dpi=130)


FIGURE = Figure(
    name=NAME,
    title="Energy compensation against a random walk, and in pictures",
    minutes=4.0,
    compute=compute,
    draw=draw,
    pictures=("energy_spheres.png", "energy_albedo.png"),
    parameters={
        "metals": list(METALS),
        "alphas": ALPHAS,
        "mu": MU,
        "spheres": SPHERES,
        "kinds": list(KINDS),
        "smith": SHADING,
    },
    scene="lit object",
    size=160,
    spp=144,
)


command = study(FIGURE, lambda results: {"study": report(results)}, {"study": MARKS})


if __name__ == "__main__":
    main(command)

"""Energy compensation against a random walk over microfacets, and in pictures.

    python scripts/energy_study.py --page docs/energy.md
    python scripts/energy_study.py --quick    # few paths, tiny images

Interrupt it when you like: finished walks and images are kept, and the same command goes on.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from _energy import (
    ALPHAS,
    BOUND,
    FORMS,
    KINDS,
    METALS,
    MU,
    SHADING,
    SPHERES,
    closed_forms,
    compute,
    walk_stem,
)
from _figure import Figure, read_sidecar, read_table
from _figure_commands import main, study
from _markdown import markdown, marks
from _page import Page
from fresnel_decomp import load_basis
from fresnel_decomp.energy import EnergyTable
from fresnel_decomp.images import read_exr
from fresnel_decomp.report import style

NAME = "energy_study"
MARKS = marks("energy study")
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
            found = read_table(folder / f"{walk_stem(alpha, paths)}.csv")
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
    minutes=2.0,
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

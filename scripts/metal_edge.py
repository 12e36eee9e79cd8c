"""From a base colour to the curve of a metal: fit the numbers that ship, compare with other ways.

    python scripts/metal_edge.py
    python scripts/metal_edge.py --write

Colours of measured metals under D65, and how far each way from their base colour (or from base and
edge colour) comes to their curves over 0° to 90°. What is fitted to the metals is fitted to all but
the one that it is tried on. With --write the fit to all of them goes into the package.
`principled_study.py` puts the tables into its page.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from pathlib import Path

import click
import numpy as np

import fresnel_decomp
from _command_line import main, script
from _markdown import markdown
from fresnel_decomp import F82, delta_e_2000, gulbrandsen_to_ior, load_basis, load_material
from fresnel_decomp import metallic as shipped
from fresnel_decomp._files import write_json
from fresnel_decomp._schlick import schlick
from fresnel_decomp.converters import LARGEST_R
from fresnel_decomp.fresnel import conductor, dielectric
from fresnel_decomp.metallic import MetalEdge, fit_metal_edge
from fresnel_decomp.parametrization import F82_COSINE

DATA = Path(fresnel_decomp.__file__).parent / "data" / "metal_edge.json"
METALS = (
    *("Ag", "Al", "Au", "Be", "Cr", "Cu", "Hg", "Ir", "Li", "Mo", "Na_palik", "Nb", "Ni_palik"),
    *("Rh", "Ta", "TiC", "TiN", "VC", "VN", "V_palik", "W"),
)
"""Mitsuba's metals and metallic carbides and nitrides with usable data, one data set each."""

NOBLE = ("Ag", "Au", "Cu")
"""Whose edges are brighter than those of the others."""

ROOTS = np.linspace(0.0, 1.0, 33)
NODES = np.sort(np.append(ROOTS[np.abs(ROOTS**2 - F82_COSINE) > 5e-3] ** 2, F82_COSINE))
"""Cosines of the fit, dense at grazing incidence."""

COSINES = np.sin(np.radians(np.linspace(0.0, 90.0, 181)))
"""Angles of the comparison."""

Array = np.ndarray
Way = Callable[[Array, Array, Array, MetalEdge], Array]
"""From base colour, edge colour, (nodes, 3) and a fit to (angles, 3)."""


@functools.cache
def colours(name: str) -> tuple[Array, Array]:
    """(fit cosines, 3) and (angles, 3): the metal's colours."""
    material = load_material(name)
    return material.rgb_reflectance(NODES), material.rgb_reflectance(COSINES)


def fit(names: Iterable[str]) -> MetalEdge:
    return fit_metal_edge(NODES, np.concatenate([colours(n)[0] for n in names], axis=1))


# --- ways from colours to curves -----------------------------------------------------------------


def gulbrandsen(g: float) -> Way:
    def way(base: Array, edge: Array, nodes: Array, fitted: MetalEdge) -> Array:
        r = np.clip(base, 0.0, LARGEST_R)
        return conductor(COSINES[:, None], *gulbrandsen_to_ior(r, g))

    return way


def linear_tint(beta: float) -> Way:
    def way(*given: Array | MetalEdge) -> Array:
        ends = (gulbrandsen(g)(*given) for g in (0.0, 1.0))  # type: ignore[arg-type]
        return np.tensordot([1.0 - beta, beta], np.stack(list(ends)), axes=1)

    return way


def through(base: Array, edge: Array, fitted: MetalEdge) -> Array:
    """The curve through base and edge colour, in the default basis."""
    basis = load_basis()
    c = shipped.metal_coefficients(base, edge, basis, fitted)
    return basis.evaluate(c, COSINES[:, None])


def by_nodes(base: Array, edge: Array, nodes: Array, fitted: MetalEdge) -> Array:
    basis = load_basis()
    return basis.evaluate(basis.coefficients_from_reflectance(base, nodes.T), COSINES[:, None])


WAYS: dict[str, tuple[str, Way]] = {
    "Schlick": ("base colour", lambda b, e, n, f: schlick(b, COSINES[:, None])),
    "index, k = 0 (g = 0)": ("base colour", gulbrandsen(0.0)),
    "index, g = 0.5": ("base colour", gulbrandsen(0.5)),
    "index, g = 0.75": ("base colour", gulbrandsen(0.75)),
    "index, g = 1": ("base colour", gulbrandsen(1.0)),
    "linear tint, β = 0.25": ("base colour", linear_tint(0.25)),
    "linear tint, β = 0.75": ("base colour", linear_tint(0.75)),
    "usual edge, F82": ("base colour", lambda b, e, n, f: F82(b, f.edge_colour(b))(
        COSINES[:, None])),
    "usual edge, 4 terms": ("base colour", lambda b, e, n, f: through(b, f.edge_colour(b), f)),
    "F82": ("and edge colour", lambda b, e, n, f: F82(b, e)(COSINES[:, None])),
    "4 terms through both": ("and edge colour", lambda b, e, n, f: through(b, e, f)),
    "4 terms through nodes": ("and node colours", by_nodes),
}  # fmt: skip


def compare() -> dict[str, dict[str, float]]:
    """Mean RMSE, largest error, mean and largest ΔE00 of each way, over all metals."""
    basis = load_basis()
    found: dict[str, list[list[float]]] = {name: [] for name in WAYS}
    for metal in METALS:
        exact = colours(metal)[1]
        fitted = fit(name for name in METALS if name != metal)
        material = load_material(metal)
        edge = material.rgb_reflectance(F82_COSINE)
        nodes = material.rgb_reflectance(np.cos(basis.nodes))
        for name, (_, way) in WAYS.items():
            curve = way(exact[-1], edge, nodes, fitted)
            error, delta_e = np.abs(curve - exact), delta_e_2000(curve, exact)
            found[name].append(
                [np.sqrt((error**2).mean()), error.max(), delta_e.mean(), delta_e.max()]
            )
    results = {}
    for name, rows in found.items():
        values = np.array(rows)
        chosen = [METALS.index(metal) for metal in NOBLE]
        results[name] = {
            "rmse": float(values[:, 0].mean()),
            "rmse_noble": float(values[chosen, 0].mean()),
            "largest": float(values[:, 1].max()),
            "delta_e": float(values[:, 2].mean()),
            "delta_e_largest": float(values[:, 3].max()),
        }
    return results


def table(results: dict[str, dict[str, float]]) -> str:
    head = ["curve", "from", "RMSE", "of Ag, Au, Cu", "largest error", "ΔE00, mean", "largest"]
    rows = [
        [
            name,
            WAYS[name][0],
            f"{row['rmse']:.4f}",
            f"{row['rmse_noble']:.4f}",
            f"{row['largest']:.3f}",
            f"{row['delta_e']:.2f}",
            f"{row['delta_e_largest']:.2f}",
        ]
        for name, row in results.items()
    ]
    return markdown(head, rows)


def verdicts(results: dict[str, dict[str, float]]) -> str:
    """What the table says of guessed edges, in words."""

    def over(name: str, other: str, column: str = "rmse") -> str:
        return f"{results[name][column] / results[other][column]:.2f}"

    usual, four = "usual edge, 4 terms", "4 terms through both"
    index = min(
        (name for name in results if name.startswith(("index", "linear tint"))),
        key=lambda name: results[name]["rmse"],
    )
    return (
        f"RMSE relative to Schlick's curve: the usual edge {over(usual, 'Schlick')} over all "
        f"metals and {over(usual, 'Schlick', 'rmse_noble')} over Ag, Au and Cu; the best of the "
        f"indices ({index}) {over(index, 'Schlick')}; four terms through base and edge colour "
        f"{over(four, 'Schlick')} and {over(four, 'Schlick', 'rmse_noble')}. Relative to F82 of "
        f"the same two colours these have {over(four, 'F82')} over all and "
        f"{over(four, 'F82', 'rmse_noble')} over the three."
    )


def range_table() -> str:
    """Lowest and highest reflectance of the fits, over all colours, edges and angles."""
    basis, steps = load_basis(), np.linspace(0.0, 1.0, 41)
    base, edge = (c.ravel() for c in np.meshgrid(steps, steps, indexing="ij"))
    cosines = np.linspace(0.0, 1.0, 401)[:, None]

    def four(first: Array, second: Array) -> Array:
        return basis.evaluate(shipped.metal_coefficients(first, second, basis), cosines)

    def f82(first: Array, second: Array) -> Array:
        return F82(first, second)(cosines)

    def dielectrics(f0: Array) -> dict[str, Array]:
        eta = shipped.dielectric_eta(f0)
        exact = [dielectric(c, eta) for c in (F82_COSINE, *np.cos(basis.nodes))]
        c = basis.coefficients_from_reflectance(f0, np.stack(exact[1:], axis=-1))
        return {"four terms": basis.evaluate(c, cosines), "f82": F82(f0, exact[0])(cosines)}

    usual = shipped.default_edge_colour(steps)
    near, far = np.geomspace(1e-12, 2e-3, 60), np.linspace(2e-3, 0.99, 200)
    rows: dict[str, dict[str, Array]] = {
        "metals, usual edge": {"four terms": four(steps, usual), "f82": f82(steps, usual)},
        "metals, any edge colour": {"four terms": four(base, edge), "f82": f82(base, edge)},
        "dielectrics, F0 ≥ 0.002": dielectrics(far),
        "dielectrics, F0 < 0.002": dielectrics(near),
    }
    return markdown(
        ["lowest and highest reflectance", "decomposition", "f82"],
        [
            [name, *(f"{v.min():.3f} … {v.max():.3f}" for v in values.values())]
            for name, values in rows.items()
        ],
    )


def colour_table() -> str:
    """What to type for metals: base and edge colours in linear sRGB."""

    def cell(cos_theta: float, name: str) -> str:
        colour = load_material(name).rgb_reflectance(cos_theta).clip(0.0, 1.0)
        return ", ".join(f"{channel:.3f}" for channel in colour)

    return markdown(
        ["metal", "base_color", "edge_color"],
        [[name, cell(1.0, name), cell(F82_COSINE, name)] for name in METALS],
    )


def tables() -> dict[str, str]:
    """What the page shows, by the names of its marks."""
    edge = shipped.load_metal_edge()
    black = 1.0 - edge.edge_colour(0.0)
    least = min(float(colours(name)[0][-1].min()) for name in METALS)
    usual = (
        f"Over {len(METALS)} metals, whose darkest channel is {least:.2f}; the usual edge colour "
        f"is 1 − (1 − F0)({black:.3f} + {edge.q:.3f} F0 + {edge.s:.3f} F0²)."
    )
    results = compare()
    return {
        "metals": f"{table(results)}\n\n{usual}\n\n{verdicts(results)}",
        "ranges": range_table(),
        "colours": colour_table(),
    }


@script()
@click.option("--write", is_flag=True, help="Write the fit into the package.")
def metal_edge(write: bool) -> None:
    """From a base colour to the curve of a metal: the fit that ships, beside other ways."""
    if write:
        fitted = fit(METALS)
        columns = {name: getattr(fitted, name).round(6).tolist() for name in ("u", "v")}
        write_json(
            DATA,
            {
                "cos_theta": fitted.cos_theta.tolist(),
                **columns,
                "q": round(fitted.q, 6),
                "s": round(fitted.s, 6),
                "metals": list(METALS),
                "illuminant": "D65",
            },
        )
        shipped.load_metal_edge.cache_clear()
    click.echo("\n\n".join(tables().values()))


if __name__ == "__main__":
    main(metal_edge)

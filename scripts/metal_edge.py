"""From a base colour to the curve of a metal: fit the numbers that ship, compare with other ways.

    python scripts/metal_edge.py --page docs/principled.md
    python scripts/metal_edge.py --write

Colours of measured metals under D65, and how far each way from their base colour (or from base and
edge colour) comes to their curves over 0° to 90°. What is fitted to the metals is fitted to all but
the one that it is tried on. With --write the fit to all of them goes into the package.
"""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

import fresnel_decomp
from _markdown import insert, markdown, page_with
from fresnel_decomp import F82, delta_e_2000, gulbrandsen_to_ior, load_basis, load_material
from fresnel_decomp import metallic as shipped
from fresnel_decomp._files import write_json
from fresnel_decomp._schlick import schlick
from fresnel_decomp.converters import LARGEST_R
from fresnel_decomp.fresnel import conductor
from fresnel_decomp.metallic import MetalEdge, fit_metal_edge
from fresnel_decomp.parametrization import F82_COSINE

DATA = Path(fresnel_decomp.__file__).parent / "data" / "metal_edge.json"
MARKS = ("<!-- metals -->\n", "<!-- end of metals -->\n")
COLOUR_MARKS = ("<!-- colours -->\n", "<!-- end of colours -->\n")
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
    u, v = fitted.weights(np.cos(basis.nodes))
    nodes = 1.0 - np.outer(1.0 - base, u) - np.outer(1.0 - edge, v)
    return basis.evaluate(basis.coefficients_from_reflectance(base, nodes), COSINES[:, None])


def usual_edge(base: Array, fitted: MetalEdge) -> Array:
    return 1.0 - (1.0 - base) * (fitted.p + fitted.q * base)


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
    "usual edge, F82": ("base colour", lambda b, e, n, f: F82(b, usual_edge(b, f))(
        COSINES[:, None])),
    "usual edge, 4 terms": ("base colour", lambda b, e, n, f: through(b, usual_edge(b, f), f)),
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


def colour_table() -> str:
    """What to type for metals: base and edge colours in linear sRGB."""

    def cell(cos_theta: float, name: str) -> str:
        colour = load_material(name).rgb_reflectance(cos_theta).clip(0.0, 1.0)
        return ", ".join(f"{channel:.3f}" for channel in colour)

    return markdown(
        ["metal", "base_color", "edge_color"],
        [[name, cell(1.0, name), cell(F82_COSINE, name)] for name in METALS],
    )


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write the fit into the package")
    parser.add_argument(
        "--page", type=page_with(MARKS, COLOUR_MARKS), help="replace the tables of a page"
    )
    options = parser.parse_args(arguments)
    fitted = fit(METALS)
    if options.write:
        columns = {name: getattr(fitted, name).round(6).tolist() for name in ("u", "v")}
        write_json(
            DATA,
            {
                "cos_theta": fitted.cos_theta.tolist(),
                **columns,
                "p": round(fitted.p, 6),
                "q": round(fitted.q, 6),
                "metals": list(METALS),
                "illuminant": "D65",
            },
        )
        shipped.load_metal_edge.cache_clear()
        shipped._weights_at.cache_clear()
    text = table(compare())
    edge = shipped.load_metal_edge()
    text += (
        f"\n\nOver {len(METALS)} metals; the usual edge colour is "
        f"1 − (1 − F0)({edge.p:.3f} + {edge.q:.3f} F0)."
    )
    print(f"{text}\n\n{colour_table()}")
    if options.page:
        insert(options.page, text, MARKS)
        insert(options.page, colour_table(), COLOUR_MARKS)


if __name__ == "__main__":
    main()

"""Figure 1a of the talk: the first four basis functions, extracted anew from exact curves.

First compute, then draw:

    python scripts/fig01a_basis.py compute
    python scripts/fig01a_basis.py draw
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from _figure import Figure, Job, read_sidecar, read_table, write_table
from _figure_commands import commands, main
from _page import GREY, Page
from fresnel_decomp import RECIPES, load_basis
from fresnel_decomp.report import style
from fresnel_decomp.report.basis import FUNCTION_COLOURS
from fresnel_decomp.singular_vectors import extract

NAME = "fig01a_basis"
SHOWN = ("talk", "notebook")
TERMS = 4
LOW, HIGH = -0.72, 1.06


def compute(job: Job) -> dict[str, Any]:
    """Extract both bases; write their functions every .05°, and how far the shipped ones are."""
    degrees = np.linspace(0.0, 90.0, 1801)
    cos_theta = np.clip(np.cos(np.radians(degrees)), 0.0, 1.0)
    results = {}
    for index, recipe in enumerate(SHOWN):
        job.report(f"extracting '{recipe}'", index / len(SHOWN))
        rule = RECIPES[recipe]
        basis = extract(rule.training(), TERMS, rule.rule, rule.nodes, rule.grid)
        values = basis.functions(cos_theta)
        columns = {"theta_deg": degrees, "cos_theta": cos_theta, "b0": np.ones_like(degrees)}
        columns |= {f"b{i}": values[:, i - 1] for i in range(1, TERMS)}
        write_table(job.folder / f"{recipe}.csv", columns)
        shipped = load_basis(recipe, TERMS)
        results[recipe] = {
            "nodes_rad": basis.nodes.tolist(),
            "condition": shipped.condition,
            "largest_difference_from_shipped": float(
                np.abs(shipped(cos_theta)[:, 1:] - values).max()
            ),
        }
    return results


def draw(folder: Path, pictures: Path) -> None:
    """Both bases over the angle and over the cosine; the notebook's in thin lines."""
    tables = {recipe: read_table(folder / f"{recipe}.csv") for recipe in SHOWN}
    nodes = np.array(read_sidecar(NAME, folder)["results"]["talk"]["nodes_rad"])
    with style.styled():
        page = Page(8.8, 4.1)
        panels = {
            "theta_deg": page.axes(0.72, 0.72, 3.8, 2.8),
            "cos_theta": page.axes(4.82, 0.72, 3.8, 2.8),
        }
        places = {"theta_deg": np.degrees(nodes), "cos_theta": np.cos(nodes)}
        for abscissa, axes in panels.items():
            talk, notebook = tables["talk"], tables["notebook"]
            for i in range(TERMS):
                colour = FUNCTION_COLOURS[i]
                axes.plot(talk[abscissa], talk[f"b{i}"], color=colour, lw=1.8, label=f"$b_{i}$")
                if i:
                    axes.plot(notebook[abscissa], notebook[f"b{i}"], color=colour, lw=0.8, ls="--")
            for node, place in zip(nodes, places[abscissa], strict=True):
                axes.axvline(place, color=GREY, lw=0.9, ls=":", zorder=0)
                axes.plot(place, LOW, marker="^", ms=6, color=GREY, clip_on=False)
                axes.annotate(
                    f"{node:g}", (place, HIGH), xytext=(0, 6), textcoords="offset points",
                    size=7.5, color=GREY, ha="center",
                )  # fmt: skip
            axes.set_ylim(LOW, HIGH)
            axes.set_yticks(np.arange(-0.5, 1.01, 0.25))
        panels["theta_deg"].set_xlim(0, 90)
        panels["theta_deg"].set_xticks(range(0, 91, 15))
        panels["theta_deg"].set_xlabel("angle of incidence (degrees)")
        panels["theta_deg"].set_ylabel("basis function")
        panels["cos_theta"].set_xlim(0, 1)
        panels["cos_theta"].set_xlabel("cosine of the angle of incidence")
        panels["cos_theta"].tick_params(labelleft=False)
        page.write(0.72, 0.22, "The first four basis functions", ha="left", size=11)
        handles, labels = panels["theta_deg"].get_legend_handles_labels()
        thin = panels["theta_deg"].plot([], [], color=GREY, lw=0.8, ls="--")
        marks = panels["theta_deg"].plot([], [], color=GREY, lw=0, marker="^", ms=6)
        page.figure.legend(
            [*handles, *thin, *marks],
            [*labels, "of the ‘notebook’ recipe", "nodes (rad)"],
            loc="upper right",
            ncols=TERMS + 2,
            bbox_to_anchor=(8.7 / 8.8, 1.0 - 0.04 / 4.1),
            handlelength=1.6,
            columnspacing=1.2,
        )
        page.save(pictures / FIGURE.pictures[0], dpi=170)


FIGURE = Figure(
    name=NAME,
    title="Talk, Figure 1a: the first four basis functions",
    minutes=0.1,
    compute=compute,
    draw=draw,
    pictures=(f"{NAME}.png",),
    parameters={"recipes": SHOWN, "terms": TERMS},
)

command = commands(FIGURE)

if __name__ == "__main__":
    main(command)

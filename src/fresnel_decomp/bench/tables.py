"""What a benchmark found, in tables, and as files.

Everything is made of the rows alone, so that a page can be checked against the file of numbers
beside it. `verdicts` says in sentences what the numbers say.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .._files import write_json, write_text
from .._markdown import markdown_table
from .pareto import best_within, front
from .run import KINDS, Bench, Row
from .verdicts import STEADY, caution, drift, verdicts
from .words import (
    COSTS,
    ERRORS,
    LIMITS,
    ROUGH,
    count,
    error_text,
    pair,
    ratio,
    short,
    span,
)

__all__ = [
    "COSTS",
    "ERRORS",
    "LIMITS",
    "STEADY",
    "about_line",
    "budget_table",
    "caution",
    "cost_table",
    "document",
    "drift",
    "error_table",
    "read_csv",
    "recipe_table",
    "size_table",
    "to_csv",
    "verdicts",
    "write",
]

NOT_IN_PLUGIN = "not in the plugin"


def about_line(about: dict[str, Any]) -> str:
    """On what, and how, the times were taken."""
    from .machine import describe_machine

    backend = {"llvm": "CPU (LLVM)", "cuda": "GPU (CUDA)"}[about["backend"]]
    return (
        f"{backend}: {describe_machine(about)}. Medians of {about['rounds']} rounds ± half the "
        f"distance between quartiles, seed {about['seed']}."
    )


def recipe_table(rows: Sequence[Row]) -> str:
    """Times, arithmetic and errors of all models but those in tables."""
    head = [
        "model", "compute-bound, RGB", "BSDF only", "arithmetic", "a: largest / RMSE", "cp", "d",
        "low", "ΔE00, mean / largest",
    ]  # fmt: skip
    lines = []
    for row in _without_tables(rows):
        cells = [row["model"], ratio(row, "compute"), ratio(row, "bsdf"), count(row["arithmetic"])]
        cells += [pair(row, f"{name}_max", f"{name}_rmse") for name in ("a", "cp", "d", "low")]
        cells += [pair(row, "delta_e_mean", "delta_e_max", 3)]
        lines.append(cells)
    return _with_note(markdown_table(head, lines))


def cost_table(rows: Sequence[Row]) -> str:
    """All costs of all models but those in tables."""
    head = ["model", *KINDS.values(), "bytes shared + a material", "arithmetic", "all operations"]
    lines = []
    for row in _without_tables(rows):
        missing = "–" if row["in_plugin"] else NOT_IN_PLUGIN
        cells = [row["model"], *(ratio(row, kind, missing) for kind in KINDS)]
        cells += [f"{row['shared_bytes']} + {row['material_bytes']}"]
        cells += [count(row["arithmetic"]), count(row["operations"])]
        lines.append(cells)
    return _with_note(markdown_table(head, lines))


def error_table(rows: Sequence[Row]) -> str:
    """What `recipe_table` leaves out: the worst of all sets, p99 and mean, and the albedo."""
    head = ["model", "all sets: largest"]
    for name in ("a", "cp", "d", "low"):
        head += [f"{name}: p99 / mean", f"{name}, albedo: largest / p99 / mean / RMSE"]
    head += ["ΔE00, p99 / RMSE"]
    lines = []
    for row in _without_tables(rows):
        worst = row.get("worst_max")
        cells = [row["model"], "–" if worst is None else short(worst)]
        for name in ("a", "cp", "d", "low"):
            cells += [pair(row, f"{name}_p99", f"{name}_mean")]
            albedo = [row[f"{name}_albedo_{error}"] for error in ("max", "p99", "mean", "rmse")]
            cells += ["–" if None in albedo else " / ".join(map(short, albedo))]
        lines.append([*cells, pair(row, "delta_e_p99", "delta_e_rmse", 3)])
    return markdown_table(head, lines)


def size_table(rows: Sequence[Row]) -> str:
    """Tables by terms, size and format: ranges over the recipes."""
    forms = {row["model"]: row for row in rows if row["form"] == "closed form"}
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        if row["form"] == "table":
            groups.setdefault((row["terms"], row["size"], row["storage"]), []).append(row)
    kinds = ("compute", "streaming", "compute_one", "streaming_one")
    lines = []
    for (terms, size, storage), members in groups.items():
        added = []
        for row in members:
            form = forms.get(f"{row['family']}, {terms} terms")
            if form is not None and None not in (row["d_max"], form["d_max"]):
                added.append(row["d_max"] / form["d_max"] - 1.0)
        cells = [f"{terms} terms, {size} samples, {storage}", str(members[0]["shared_bytes"])]
        cells += [span(row[f"{kind}_ratio"] for row in members) for kind in kinds]
        cells += [count(members[0][column]) for column in ("arithmetic", "operations", "gathers")]
        cells.append(span((row["d_max"] for row in members), 4))
        cells.append(f"{100 * max(added):+.1f} %" if added else "–")
        lines.append(cells)
    head = [
        "table", "bytes", *(KINDS[kind] for kind in kinds), "arithmetic", "all operations", "loads",
        "d: largest error", "at most, against the closed form",
    ]  # fmt: skip
    return markdown_table(head, lines)


def budget_table(rows: Sequence[Row], cost: str) -> str:
    """For budgets of one kind, the models with the least errors that can be integrated ahead.

    They are read off the fronts (`pareto.front`) that figures draw.
    """
    fronts = {error: front(rows, cost, error, integrates=True) for error in ERRORS}
    lines = []
    for limit in LIMITS[cost]:
        cells = [f"≤ {limit:g}"]
        for error, steps in fronts.items():
            best = best_within(steps, cost, limit)
            cells.append("none" if best is None else f"{best['model']} ({error_text(best[error])})")
        lines.append(cells)
    return markdown_table([COSTS[cost], *ERRORS.values()], lines)


def _with_note(table: str) -> str:
    if "†" not in table:
        return table
    return f"{table}\n\n† The spread is more than {ROUGH:g} of the ratio."


def document(bench: Bench) -> str:
    """Everything, for a file of its own."""
    rows = bench.rows
    parts = [
        "# Speed against error",
        about_line(bench.about),
        verdicts(rows),
        recipe_table(rows),
        *(f"## Best within a budget: {COSTS[cost]}\n\n{budget_table(rows, cost)}"
          for cost in LIMITS),
        f"## Costs\n\n{cost_table(rows)}",
        f"## Errors\n\n{error_table(rows)}",
    ]  # fmt: skip
    if any(row["form"] == "table" for row in rows):
        parts.append(f"## Tables\n\n{size_table(rows)}")
    return "\n\n".join(parts) + "\n"


def write(bench: Bench, folder: str | os.PathLike[str], stem: str = "speed_vs_error") -> list[Path]:
    """CSV, JSON and Markdown; the paths."""
    paths = [Path(folder) / f"{stem}.{suffix}" for suffix in ("csv", "json", "md")]
    write_text(paths[0], to_csv(bench.rows))
    write_json(paths[1], {"about": bench.about, "rows": bench.rows})
    write_text(paths[2], document(bench))
    return paths


def to_csv(rows: Sequence[Row]) -> str:
    """Numbers with six digits, those of rounds with four; empty where there is none."""
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: _cell(value) for key, value in row.items()})
    return text.getvalue()


def read_csv(path: str | os.PathLike[str]) -> list[Row]:
    """Rows as `to_csv` wrote them."""
    with open(path, encoding="utf-8", newline="") as file:
        return [
            {key: _rounds(text) if key.endswith("_ratios") else _value(text)
             for key, text in row.items()}
            for row in csv.DictReader(file)
        ]  # fmt: skip


def _cell(value: Any) -> Any:
    if isinstance(value, list):
        return " ".join(f"{number:.4g}" for number in value)
    return f"{value:.6g}" if isinstance(value, float) else value


def _value(text: str) -> Any:
    if text in ("", "True", "False"):
        return {"": None, "True": True, "False": False}[text]
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _rounds(text: str) -> list[float] | None:
    return [float(number) for number in text.split()] or None


def _without_tables(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row["form"] != "table"]

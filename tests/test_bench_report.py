"""Fronts, tables and sentences of the benchmark, on rows whose answers can be seen."""

from __future__ import annotations

from typing import Any

import pytest

from fresnel_decomp.bench import figures, tables
from fresnel_decomp.bench.pareto import best_within, clearly_less, counted, front, tied
from fresnel_decomp.bench.run import KINDS
from fresnel_decomp.bench.verdicts import _against_built_in, classes, drift
from fresnel_decomp.bench.words import (
    BUILT_IN,
    COSTS,
    ERRORS,
    LIMITS,
    error_text,
    ratio,
    span,
)

SETS = ("a", "cp", "d", "low")


def made_up(model: str, cost: float | None, error: float, **changes: Any) -> dict[str, Any]:
    """A row all of whose times are one number, and all of whose errors another."""
    form = "table" if " float" in model else "closed form" if "terms" in model else "formula"
    family, terms = model.partition(",")[0], int(model.split()[1]) if "terms" in model else None
    family = "Mitsuba" if model.startswith("mi.") else family
    row: dict[str, Any] = {
        "model": model, "family": family, "form": form, "terms": terms, "integrates": True,
        "in_plugin": form != "table", "size": 32 if form == "table" else None,
        "storage": model.split()[-1] if form == "table" else None, "shared_bytes": 0,
        "material_bytes": 12, "bytes": 12, "arithmetic": 10, "gathers": 0, "operations": 10,
    }  # fmt: skip
    row |= dict.fromkeys(ERRORS, error)
    for name in SETS:
        for kind in ("max", "p99", "mean", "rmse"):
            row |= {f"{name}_{kind}": error, f"{name}_albedo_{kind}": error}
    row |= {f"delta_e_{kind}": error for kind in ("max", "p99", "mean", "rmse")}
    for kind in KINDS:
        row |= {f"{kind}_ratio": cost, f"{kind}_spread": None if cost is None else 0.01}
        row |= {f"{kind}_built_in_ns": None if cost is None else 1.0}
    return row | changes


ROWS = [
    made_up(BUILT_IN, 1.0, 1e-6, integrates=False),
    made_up("Schlick", 0.1, 0.3),
    made_up("balanced, 3 terms", 0.3, 0.05),
    made_up("talk, 3 terms", 0.304, 0.04),
    made_up("robust, 3 terms", 0.45, 0.045),
    made_up("balanced, 4 terms", 0.6, 0.02),
    made_up("balanced, 4 terms, 32 float16", 2.0, 0.021),
]


def names(rows: Any) -> list[str]:
    return [row["model"] for row in rows]


def test_front_counts_what_is_printed():
    """0.304 is printed as 0.30, so that the better one of the two at this price stands for both."""
    steps = front(ROWS, "bsdf_ratio", "d_rmse", integrates=True)
    assert names(steps) == ["Schlick", "talk, 3 terms", "balanced, 4 terms"]
    every = front(ROWS, "bsdf_ratio", "d_rmse", integrates=False)
    assert names(every) == [*names(steps), BUILT_IN]
    bought = [best_within(steps, "bsdf_ratio", budget) for budget in (0.05, 0.1, 0.3, 0.59, 9.0)]
    assert [row and row["model"] for row in bought] == [
        None, "Schlick", "talk, 3 terms", "talk, 3 terms", "balanced, 4 terms",
    ]  # fmt: skip


def test_numbers_count_as_they_are_printed():
    row = {"bsdf_ratio": 0.0451, "d_max": 0.0995, "render_ratio": 1.006, "bytes": 131}
    assert counted(row, "bsdf_ratio") == 0.045
    assert (counted(row, "d_max"), error_text(row["d_max"])) == (0.1, "0.10")
    assert (counted(row, "render_ratio"), counted(row, "bytes")) == (1.01, 131.0)
    assert counted({"d_max": float("nan")}, "d_max") is None
    assert span([None, 0.1, 0.304]) == "0.10–0.30"
    assert ratio(made_up("Schlick", 0.015, 0.3), "bsdf") == "0.01 ± 0.01 †"


def test_ties_are_what_noise_may_have_made():
    """By the spreads where there are no rounds, else by a sign test on rounds in pairs."""
    near = made_up("minimax, 3 terms", 0.315, 0.04)
    assert names(tied([*ROWS, near], "bsdf_ratio", "d_rmse", True)) == [
        "balanced, 3 terms", "minimax, 3 terms",
    ]  # fmt: skip
    assert tied([*ROWS, near], "bytes", "d_rmse", True) == []
    rounds = [0.2, 0.5, 0.3, 0.4, 0.25, 0.35]
    first = made_up("a", 0.325, 0.1, bsdf_ratios=rounds, bsdf_spread=0.1)
    dearer = made_up("b", 0.335, 0.1, bsdf_ratios=[r + 0.01 for r in rounds], bsdf_spread=0.1)
    assert clearly_less(first, dearer, "bsdf_ratio")  # six of six, though both spread widely
    assert not clearly_less(dearer, first, "bsdf_ratio")
    mixed = [r + 0.01 * (-1) ** i for i, r in enumerate(rounds)]
    assert not clearly_less(first, dearer | {"bsdf_ratios": mixed}, "bsdf_ratio")
    assert not clearly_less(first, dearer | {"bsdf_ratios": None}, "bsdf_ratio")


@pytest.mark.parametrize("cost", COSTS)
def test_budget_tables_are_read_off_the_front(cost: str):
    """As a reader does with a ruler, and without the code that makes either."""
    text = tables.budget_table(ROWS, cost).splitlines()[2:]
    for limit, line in zip(LIMITS[cost], text, strict=True):
        within = [
            row for row in ROWS
            if row["integrates"] and round(row[cost], 2) <= limit
        ]  # fmt: skip
        for cell in line.strip("| ").split(" | ")[1:]:
            if within:
                least = min(row["d_rmse"] for row in within)
                assert f"({error_text(least)})" in cell
            else:
                assert cell.strip() == "none"


def test_time_is_said_in_three_classes():
    closed = [row for row in ROWS if row["form"] == "closed form"]
    closed += [made_up("minimax, 6 terms", 1.5, 0.001), made_up("talk, 6 terms", 1.01, 0.001)]
    assert [names(group) for group in classes(closed, ROWS[0], "bsdf_ratio")] == [
        names(ROWS[2:6]), ["talk, 6 terms"], ["minimax, 6 terms"],
    ]  # fmt: skip
    times, errors = _against_built_in([*ROWS, *closed[-2:]], closed)
    assert "BSDF only 4 / 1 / 1 (more: minimax with 6 terms), ratios 0.30–1.50" in times
    assert "RMSE, measured materials, 0 of 6" in errors
    worse = [ROWS[0] | {"delta_e_mean": 0.03}, *ROWS[1:]]
    assert "mean ΔE00, measured materials, 1 of 4" in _against_built_in(worse, ROWS[2:6])[1]


def test_a_machine_that_was_not_quiet_is_said():
    quiet = [row | {"bsdf_built_in_ns": ns} for row, ns in zip(ROWS, (2.0, 2.9), strict=False)]
    assert tables.caution(quiet) == ""
    busy = [*quiet, ROWS[2] | {"bsdf_built_in_ns": 8.0}]
    assert drift(busy)["bsdf"] == 4.0
    assert "up to 4.0 times" in tables.caution(busy)


def test_sizes_of_tables_are_ranges_over_recipes():
    rows = [*ROWS, made_up("talk, 4 terms, 32 float16", 3.0, 0.03, gathers=6, operations=55)]
    (line,) = tables.size_table(rows).splitlines()[2:]
    cells = [cell.strip() for cell in line.strip("| ").split("|")]
    assert cells[0] == "4 terms, 32 samples, float16"
    assert cells[2:6] == ["2.00–3.00"] * 4
    assert cells[-2:] == ["0.0210–0.0300", "+5.0 %"]  # balanced; talk's closed form is not there


def test_what_another_backend_does_not_count(tmp_path):
    """On a GPU neither operations on packets nor loads are counted, and a run may lack pictures."""
    rows = [
        row | {"operations": None, "gathers": None, "render_ratio": None, "render_spread": None}
        for row in ROWS
    ]
    about = {"backend": "cuda", "variant": "cuda_ad_rgb", "machine": "x", "gpu": "y"}
    about |= {"threads": None, "llvm": None, "mitsuba": "3", "drjit": "1", "rounds": 9, "seed": 0}
    bench = tables.Bench(about, rows)
    text = tables.document(bench)
    assert "None" not in text
    assert "GPU (CUDA)" in text
    drawn = figures.write_figures(rows, tmp_path, tables.about_line(about))
    assert {path.stem.rpartition("_")[2] for path in drawn} == {
        "error", "compute", "streaming", "bsdf", "bytes",
    }  # fmt: skip

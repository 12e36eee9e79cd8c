"""Speed against error: the figures and tables of README and documentation, in one command.

    python scripts/speed_vs_error.py --page docs/speed_vs_error.md --readme README.md

measures every model as `fresnel-decomp bench` does, goes on where an earlier run stopped, draws the
figures into docs/figures and puts tables and verdicts into the two pages, between their marks. What
was measured is also written to docs/figures/speed_vs_error.csv, of which everything on the pages is
made: with --from that file, pages and figures are made again without measuring.

Pages are for whole measurements: they are refused for --quick, some of the models, or fewer than
nine rounds, and after a run on a machine that did other things, unless --noisy says to have it so.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from _command_line import ROOT, main, page_option, script
from _markdown import insert, marks
from fresnel_decomp import doctor
from fresnel_decomp._check import input_error
from fresnel_decomp._files import write_text
from fresnel_decomp.cli.bench import run_bench

FIGURES = ROOT / "docs" / "figures"
STEM = "speed_vs_error"


PAGE_PARTS = ("verdicts", "recipe table", "budgets", "costs", "errors", "tables")
README_PARTS = ("speed against error",)
LEAST_ROUNDS = 9


def page_texts(about: dict[str, Any], rows: list[dict[str, Any]]) -> dict[str, str]:
    """What stands between the marks of the page of the documentation."""
    from fresnel_decomp.bench import tables

    budgets = "\n\n".join(tables.budget_table(rows, cost) for cost in tables.LIMITS)
    return {
        "verdicts": f"{tables.about_line(about)}\n\n{tables.verdicts(rows)}",
        "recipe table": tables.recipe_table(rows),
        "budgets": budgets,
        "costs": tables.cost_table(rows),
        "errors": tables.error_table(rows),
        "tables": tables.size_table(rows),
    }


def readme_texts(about: dict[str, Any], rows: list[dict[str, Any]]) -> dict[str, str]:
    """What stands between the marks of README: the figure, where it was measured, the table."""
    from fresnel_decomp.bench import tables

    figure = f"![Cost against error of Fresnel models](docs/figures/{STEM}.png)"
    parts = [figure, tables.about_line(about), tables.caution(rows), tables.recipe_table(rows)]
    return {"speed against error": "\n\n".join(part for part in parts if part)}


@script()
@click.option("--variant", help="Mitsuba variant.  [default: the fastest that works here]")
@click.option("--rounds", type=int, help="That count.  [default: 11; with --quick 3]")
@click.option("--models", multiple=True, default=("*",), help="As for `fresnel-decomp bench`.")
@click.option("--quick", is_flag=True, help="Tiny kernels; not for the pages.")
@click.option("--noisy", is_flag=True, help="Write pages though the machine was not quiet.")
@click.option("--force", is_flag=True, help="Measure again what is finished.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for the results.  [default: out/bench; with --quick out/bench-quick]",
)
@page_option(*map(marks, PAGE_PARTS), text="Put tables there.")
@page_option(*map(marks, README_PARTS), text="And there.", name="--readme")
@click.option("--figures", type=click.Path(path_type=Path), default=FIGURES)
@click.option(
    "--from",
    "source",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Numbers of an earlier run, a CSV file with its JSON beside it; nothing is measured.",
)
def speed_vs_error(
    variant: str | None,
    rounds: int | None,
    models: tuple[str, ...],
    quick: bool,
    noisy: bool,
    force: bool,
    out: Path | None,
    page: Path | None,
    readme: Path | None,
    figures: Path,
    source: Path | None,
) -> None:
    """Measure, draw, and write README and documentation."""
    targets = [
        (path, texts) for path, texts in ((page, page_texts), (readme, readme_texts)) if path
    ]
    if targets and source is None:
        _check_whole(models, rounds, quick)
    from fresnel_decomp.bench import tables
    from fresnel_decomp.bench.figures import write_figures

    if source is None:
        from fresnel_decomp.bench.run import Settings

        changes: dict[str, Any] = {"variant": variant or doctor.best_variant(), "models": models}
        changes |= {} if rounds is None else {"rounds": rounds}
        out = out or ROOT / "out" / ("bench-quick" if quick else "bench")
        run_bench(Settings.quick(**changes) if quick else Settings(**changes), out, force)
        source = out / f"{STEM}.csv"
    if not targets:
        return
    # of the numbers in the file, so that pages can be checked against it
    rows = tables.read_csv(source)
    about = json.loads(source.with_suffix(".json").read_text(encoding="utf-8"))
    about = about.get("about", about)
    if tables.caution(rows) and not noisy:
        raise input_error(
            f"times of a machine that was not quiet, in {source}: the built-in's own time varies "
            f"by up to {max(tables.drift(rows).values()):.1f}",
            f"at most {tables.STEADY}",
            "Measure with --force while nothing else runs, or say --noisy to publish them.",
        )
    if source.parent.resolve() != figures.resolve():
        write_text(figures / f"{STEM}.csv", source.read_text(encoding="utf-8"))
        write_text(figures / f"{STEM}.json", json.dumps(about, indent=2) + "\n")
    write_figures(rows, figures, tables.about_line(about))
    for path, texts in targets:
        for name, text in texts(about, rows).items():
            insert(path, text, marks(name))
        click.echo(f"Wrote {path}")


def _check_whole(models: tuple[str, ...], rounds: int | None, quick: bool) -> None:
    """Refuse to publish less than a whole measurement."""
    given = ["--quick"] if quick else []
    given += [f"--models {' --models '.join(models)}"] if models != ("*",) else []
    given += [f"--rounds {rounds}"] if rounds is not None and rounds < LEAST_ROUNDS else []
    if given:
        raise input_error(
            f"{' '.join(given)} together with --page or --readme",
            f"pages of all models, with at least {LEAST_ROUNDS} rounds",
            "Leave the pages out; results are in the folder of --out.",
        )


if __name__ == "__main__":
    main(speed_vs_error, interrupted="Interrupted. The same command goes on from what is finished.")

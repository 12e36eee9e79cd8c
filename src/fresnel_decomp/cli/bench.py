"""`fresnel-decomp bench`: speed against error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ._options import variant_option
from ._terminal import progress_bar, resumable

__all__ = ["bench", "run_bench"]


@click.command()
@click.option(
    "--models",
    multiple=True,
    default=("*",),
    show_default=True,
    help='Name or pattern, such as Schlick or "balanced*". Repeatable.',
)
@variant_option
@click.option("--rounds", type=int, help="That count, at least 3.  [default: 11]")
@click.option("--seed", type=int, default=0, show_default=True, help="0 to 2^32 - 1.")
@click.option("--quick", is_flag=True, help="Tiny kernels, to see that everything runs.")
@click.option("--force", is_flag=True, help="Measure again what is finished.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for the results.  [default: out/bench; with --quick out/bench-quick]",
)
def bench(
    models: tuple[str, ...],
    variant: str | None,
    rounds: int | None,
    seed: int,
    quick: bool,
    force: bool,
    out: Path | None,
) -> None:
    """Measure every Fresnel model: error and cost, and draw which are the best.

    Writes speed_vs_error.csv, .json, .md and a figure for each kind of cost. Answers are checked
    before anything is timed. All models take about ten minutes on a quiet machine; Ctrl-C is
    welcome, the same command goes on.

    \b
    fresnel-decomp bench
    fresnel-decomp bench --models Schlick --models F82 --models "balanced, ? terms"
    """
    from .. import doctor
    from ..bench.run import Settings

    changes: dict[str, Any] = {"variant": variant or doctor.best_variant(), "models": models}
    changes |= {"seed": seed} | ({} if rounds is None else {"rounds": rounds})
    settings = Settings.quick(**changes) if quick else Settings(**changes)
    folder = out or Path("out") / ("bench-quick" if quick else "bench")
    run_bench(settings, folder, force)


def run_bench(settings: Any, folder: Path, force: bool = False) -> Any:
    """Run a benchmark with a progress bar, write its files, and say what they are."""
    from ..bench import figures, tables
    from ..bench.candidates import WrongAnswerError
    from ..bench.run import run

    settings.check()
    try:
        with resumable(folder), progress_bar() as progress:
            result = run(settings, folder, force=force, progress=progress)
    except WrongAnswerError as error:
        raise click.ClickException(str(error)) from error
    about = tables.about_line(result.about)
    written = tables.write(result, folder)
    written += figures.write_figures(result.rows, folder, about)
    click.echo(about)
    click.echo(tables.recipe_table(result.rows))
    click.echo(f"Wrote {', '.join(path.name for path in written)} to {folder}")
    return result

"""The command lines of figures: `compute` and `draw` of one, a study in one go, options of all."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

import _command_line
from _command_line import HELP, ROOT, page_option, script, shown
from _figure import DATA, PICTURES, QUICK_DATA, Figure, compute, draw, read_sidecar
from _markdown import Marks, insert
from fresnel_decomp import doctor
from fresnel_decomp._check import input_error


def computing(
    out: str = "Folder for data and pictures.  [default: out/figures and docs/figures; with "
    "--quick out/figures-quick]",
) -> Callable[[Any], Any]:
    """Options of all that computes figures; `out` is the help of the last."""
    options = (
        click.option("--quick", is_flag=True, help="Tiny images, to see that everything runs."),
        click.option("--force", is_flag=True, help="Compute again what is finished."),
        click.option("--variant", help="Mitsuba variant.  [default: the fastest that works here]"),
        click.option("--out", type=click.Path(path_type=Path), help=out),
    )

    def decorate(function: Any) -> Any:
        for option in reversed(options):
            function = option(function)
        return function

    return decorate


def folders(quick: bool, out: Path | None) -> tuple[Path, Path]:
    """Those for data and for pictures: throw-away pictures stay beside their data."""
    data = out or (QUICK_DATA if quick else DATA)
    return data, data if out or quick else PICTURES


def say_if_reduced(variant: str | None) -> None:
    """One line where there is neither a usable LLVM nor a GPU."""
    if variant is None and (best := doctor.best_variant()).startswith("scalar"):
        click.echo(f"No usable LLVM or GPU: rendering in {best} at a reduced size.", err=True)


def commands(figure: Figure) -> click.Group:
    """The command line of one figure's script: `compute` and `draw`."""

    @click.group(help=f"{figure.title}.", context_settings=HELP)
    def group() -> None:
        pass

    @group.command("compute")
    @computing(
        f"Data go to a folder {figure.name} in this one.  [default: out/figures; with --quick "
        "out/figures-quick]"
    )
    def compute_command(quick: bool, force: bool, variant: str | None, out: Path | None) -> None:
        """Compute the data, unless they are finished."""
        folder = folders(quick, out)[0] / figure.name
        if figure.scene is not None:
            say_if_reduced(variant)
        seconds = compute(figure, folder, quick=quick, force=force, variant=variant)
        state = "was finished" if seconds is None else f"took {seconds:.1f} s"
        click.echo(f"{figure.name} {state}: {shown(folder)}")

    @group.command("draw")
    @click.option(
        "--data",
        type=click.Path(path_type=Path),
        help="What --out of `compute` was.  [default: out/figures]",
    )
    @click.option(
        "--out",
        type=click.Path(path_type=Path),
        help="Folder for the pictures.  [default: docs/figures]",
    )
    def draw_command(data: Path | None, out: Path | None) -> None:
        """Draw from the data of `compute`."""
        for path in draw(figure, (data or DATA) / figure.name, out or PICTURES):
            click.echo(f"Wrote {shown(path)}")

    return group


def study(
    figure: Figure,
    texts: Callable[[dict[str, Any]], Mapping[str, str]],
    marks: Mapping[str, Marks],
) -> click.Command:
    """The command line of a study: compute what is missing, draw, print, and fill in a page.

    Parameters
    ----------
    figure : Figure
    texts : callable
        From the results in the sidecar to what is printed, by name.
    marks : mapping
        Lines between which texts stand on a page, for those that do.
    """

    @script(help=f"{figure.title}.")
    @computing()
    @page_option(*marks.values(), text="Replace the tables of a page.")
    def command(
        quick: bool, force: bool, variant: str | None, out: Path | None, page: Path | None
    ) -> None:
        if quick and page is not None and page.resolve().is_relative_to(ROOT):
            raise input_error(
                f"--quick together with '{page}'", "pages of whole studies", "Leave one out."
            )
        data, pictures = folders(quick, out)
        if figure.scene is not None:
            say_if_reduced(variant)
        folder = data / figure.name
        seconds = compute(figure, folder, quick=quick, force=force, variant=variant)
        state = "was finished" if seconds is None else f"took {seconds:.0f} s"
        click.echo(f"{figure.name} {state}: {shown(folder)}")
        for path in draw(figure, folder, pictures):
            click.echo(f"Wrote {shown(path)}")
        for name, text in texts(read_sidecar(figure.name, folder)["results"]).items():
            click.echo(f"\n{text}")
            if page is not None and name in marks:
                insert(page, text, marks[name])

    return command


main = functools.partial(
    _command_line.main,
    interrupted="Interrupted. Finished images are kept: the same command (without --force) goes on "
    "from them.",
)

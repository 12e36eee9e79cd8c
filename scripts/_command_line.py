"""The command line of every script: one kind of command, one way to end, one `--page`."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

import click

from _markdown import Marks, check_page
from fresnel_decomp import doctor
from fresnel_decomp._check import input_error
from fresnel_decomp.cli import run_and_exit

ROOT = Path(__file__).resolve().parents[1]
HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}

script = functools.partial(click.command, context_settings=HELP)
"""Makes a command of a function whose docstring is the help."""

json_option = click.option(
    "--out", type=click.Path(path_type=Path), help="Also write the numbers to this JSON file."
)


def page_option(
    *marks: Marks, text: str = "Also put the tables into this Markdown file.", name: str = "--page"
) -> Callable[[Any], Any]:
    """A file with these pairs of marks, which is looked at before anything is done."""

    def checked(context: click.Context, option: click.Parameter, page: Path | None) -> Path | None:
        if page is not None:
            check_page(page, *marks)
        return page

    return click.option(name, type=click.Path(path_type=Path), callback=checked, help=text)


def check_suffixes(paths: Sequence[Path]) -> None:
    """Refuse results that are neither JSON nor CSV, before they are computed."""
    for path in paths:
        if path.suffix not in (".json", ".csv"):
            raise input_error(f"--out {path}", "files that end in .json or .csv", "Rename it.")


def shown(path: Path) -> str:
    """A path as short as it can be given."""
    path = path.resolve()
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path)


def main(
    command: click.Command,
    arguments: Sequence[str] | None = None,
    interrupted: str = "Interrupted; nothing was written.",
) -> NoReturn:
    """Run a command and exit: 0 done, 1 failed, 2 bad input, 130 interrupted."""
    doctor.prepare()  # before anything imports Dr.Jit
    run_and_exit(command, arguments, Path(sys.argv[0]).name, interrupted)

"""Options that several commands have, and the check of one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from .._check import input_error
from .._files import writable_folder

__all__ = ["check_picture", "permission_options", "terms_option", "variant_option"]

terms_option = click.option(
    "--terms", type=int, help="Of the basis, 3 to 6.  [default: 4, or what the file has]"
)
variant_option = click.option(
    "--variant", help="Mitsuba variant.  [default: the fastest that works here]"
)


def permission_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """`--allow-partial` and `--allow-broken`, for measured materials."""
    broken = click.option(
        "--allow-broken", is_flag=True, help="Accept data that contradict themselves."
    )
    partial = click.option(
        "--allow-partial", is_flag=True, help="Accept spectra that do not cover 400-700 nm."
    )
    return partial(broken(command))


def check_picture(path: Path) -> None:
    """Refuse names that are none of a picture, and folders that cannot be written to."""
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise input_error(f"--out {path}", "a file ending in .png, .pdf or .svg", "Rename it.")
    writable_folder(path.parent)

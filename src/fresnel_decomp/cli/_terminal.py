"""What commands show in a terminal: a progress bar, tables, and how to go on after Ctrl-C."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import click

__all__ = ["print_table", "progress_bar", "resumable"]


@contextlib.contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """A progress bar on stderr that appears after a second and leaves nothing behind."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description:<24}"),
        BarColumn(bar_width=40),
        TextColumn("{task.percentage:3.0f}%"),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    task = bar.add_task("starting", total=1.0)
    begun = time.monotonic()
    started = False

    def progress(stage: str, fraction: float) -> None:
        nonlocal started
        if not started and time.monotonic() - begun > 1.0:
            bar.start()
            started = True
        bar.update(task, description=stage, completed=fraction)

    try:
        yield progress
    finally:
        bar.stop()


@contextlib.contextmanager
def resumable(folder: Path) -> Iterator[None]:
    """After Ctrl-C, say where the work is that was finished."""
    try:
        yield
    except KeyboardInterrupt:
        raise click.Abort(
            f"Interrupted. What was finished is in {folder}; the same command continues there."
        ) from None


def print_table(rows: Sequence[Sequence[str]], right: Sequence[int] | None = None) -> None:
    """Print rows, the first of them the header, in columns; numbers to the right."""
    from rich.cells import cell_len

    widths = [max(cell_len(row[i]) for row in rows) for i in range(len(rows[0]))]
    if right is None:
        right = [i for i in range(len(widths)) if rows[-1][i][:1].isdigit()]
    for row in rows:
        cells = [
            " " * (widths[i] - cell_len(cell)) + cell
            if i in right
            else cell + " " * (widths[i] - cell_len(cell))
            for i, cell in enumerate(row)
        ]
        click.echo("  ".join(cells).rstrip())

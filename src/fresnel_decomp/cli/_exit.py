"""How every command of this project ends: one message on stderr, one set of exit codes."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import NoReturn

import click

from .._check import InputError

__all__ = ["run_and_exit"]


def run_and_exit(
    command: click.Command,
    arguments: Sequence[str] | None,
    name: str,
    interrupted: str = "Interrupted.",
) -> NoReturn:
    """Run a click command and exit: 0 done, 1 failed, 2 bad input, 130 interrupted.

    Parameters
    ----------
    command : click.Command
    arguments : the command line without the program's name; None for this process's own
    name : the program's name, for usage messages
    interrupted : what to say after Ctrl-C, where the command does not say it with `click.Abort`
    """
    code = 0
    try:
        command.main(arguments, prog_name=name, standalone_mode=False)
    except InputError as error:
        click.echo(f"Error: {error}", err=True)
        code = 2
    except click.ClickException as error:
        error.show()
        code = error.exit_code
    except (click.Abort, KeyboardInterrupt) as error:
        click.echo(str(error) or interrupted, err=True)
        code = 130
    except (ImportError, OSError) as error:
        click.echo(f"Error: {error}", err=True)
        code = 1
    sys.stdout.flush()
    sys.exit(code)

"""The command `fresnel-decomp`: a module for each of its commands.

Exit codes: 0 done, 1 something failed, 2 bad input, 130 interrupted. Commands import what they need
when they run, so that `--help` is quick and an LLVM is chosen before Dr.Jit is there.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import NoReturn

import click

from .._version import __version__
from . import basis, bench, compare, doctor, materials, plan
from ._exit import run_and_exit
from ._numbers import join_numbers

__all__ = ["cli", "main", "run_and_exit"]


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="fresnel-decomp")
def cli() -> None:
    """Accurate Fresnel reflectance for real-time rendering.

    The preintegrable decomposition of Belcour, Bati and Barla (SIGGRAPH 2020 Talks), compared with
    Monte-Carlo references in Mitsuba 3.
    """
    from .. import doctor as health

    health.prepare()  # before anything imports Dr.Jit


for _command in (
    compare.compare,
    materials.materials,
    materials.material,
    basis.basis,
    plan.plan,
    bench.bench,
    doctor.doctor,
):
    cli.add_command(_command)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command and exit; errors are one message on stderr, without a traceback."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    run_and_exit(cli, join_numbers(given), "fresnel-decomp")

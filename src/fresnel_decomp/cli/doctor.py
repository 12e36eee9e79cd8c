"""`fresnel-decomp doctor`: what works here."""

from __future__ import annotations

import sys

import click

__all__ = ["doctor"]


@click.command()
@click.option("--fix", is_flag=True, help="Get a working LLVM if there is none, without root.")
def doctor(fix: bool) -> None:
    """Say which Mitsuba variants work here, and what to do about those that do not."""
    from .. import doctor as health

    fixed = health.fix(lambda text: click.echo(text, err=True)) if fix else None
    click.echo(health.format_report(health.report()))
    if fixed is not None and not fixed.usable:
        click.echo(f"{fixed.reason}. {fixed.remedy}", err=True)
        sys.exit(1)

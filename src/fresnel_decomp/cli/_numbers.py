"""Options that take lists of numbers, as in `--eta 0.2 0.92 1.1`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import click

__all__ = ["Numbers", "join_numbers"]

_NUMBER_OPTIONS = ("--eta", "--k", "--rg")


class Numbers(click.ParamType):
    """One or more numbers, separated by blanks or commas."""

    name = "numbers"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[float]:
        if not isinstance(value, str):
            return list(value)
        try:
            numbers = [float(text) for text in value.replace(",", " ").split()]
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers", param, ctx)
        if not numbers:
            self.fail("a number is missing", param, ctx)
        return numbers


def join_numbers(arguments: Sequence[str]) -> list[str]:
    """`--eta 1 2 3` as one argument, `--eta=1 2 3`, so that options take lists of numbers."""
    joined: list[str] = []
    collecting = False
    for argument in arguments:
        first = collecting and joined[-1].endswith("=")
        if argument in _NUMBER_OPTIONS:
            joined.append(f"{argument}=")
            collecting = True
        elif collecting and (first or _is_number_list(argument)):
            joined[-1] += argument if first else f" {argument}"
        else:
            joined.append(argument)
            collecting = False
    return joined


def _is_number_list(text: str) -> bool:
    try:
        [float(part) for part in text.split(",")]
    except ValueError:
        return False
    return True

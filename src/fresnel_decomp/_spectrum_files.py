"""Spectra in text files: tables of wavelength, eta and k in any of their usual layouts."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ._check import input_error

__all__ = ["Table", "read_spectrum", "sorted_table"]

Table = NDArray[np.float64]

_UNITS = {
    "nm": r"nm|nanomet(?:er|re)s?",
    "um": r"[uµμ]m|microns?|micromet(?:er|re)s?",
}


def read_spectrum(*paths: Path) -> tuple[Table, Table]:
    """(wavelength, eta) and (wavelength, k), two tables of shape (n, 2), wavelengths in nm.

    `paths` hold one table of three columns, or two of two columns: eta first, then k. Each comes
    back sorted by wavelength, without repeated lines.
    """
    names = " and ".join(f"'{path}'" for path in paths)
    tables = [table for path in paths for table in _tables(path)]
    match [table.shape[1] for table in tables]:
        case [3]:
            eta, k = tables[0][:, [0, 1]], tables[0][:, [0, 2]]
        case [2, 2]:
            eta, k = tables
        case columns:
            raise input_error(
                f"{names}: {f'tables of {columns} columns' if columns else 'no numbers'}",
                "wavelength, eta, k in three columns, or two tables of two columns, eta and k",
                "Put eta and k into one file, or into X.eta.spd and X.k.spd.",
            )
    return sorted_table(names, eta), sorted_table(names, k)


def _tables(path: Path) -> list[Table]:
    """The tables in a file; a line of words is a header and begins a new one."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise input_error(
            f"cannot read '{path}' ({reason})", "a text file", "Check its path and its format."
        ) from error
    found: list[tuple[str, list[list[float]]]] = [("", [])]
    for number, line in enumerate(lines, start=1):
        fields = [text for text in re.split(r"[,;\s]+", line.partition("#")[0]) if text]
        values = list(_numbers(fields))
        if fields and not values:
            found.append((" ".join(fields).lower(), []))
        elif fields:
            rows = found[-1][1]
            expected = len(rows[0]) if rows else len(fields)
            if not (len(values) == len(fields) == expected and np.isfinite(values).all()):
                raise input_error(
                    f"line {number} of '{path}' is {line.strip()!r}",
                    f"{expected} finite numbers",
                    "Correct or remove it.",
                )
            rows.append(values)
    return [_ordered(header, np.array(rows)) for header, rows in found if rows]


def _numbers(fields: list[str]) -> Iterator[float]:
    for text in fields:
        try:
            yield float(text)
        except ValueError:
            continue


def _ordered(header: str, table: Table) -> Table:
    """Wavelengths in nm, and eta before k, by what the header says."""
    says = {
        unit: re.search(rf"(?<![^\W_])(?:{names})(?![^\W_])", header)
        for unit, names in _UNITS.items()
    }
    if says["um"] or (not says["nm"] and (table[:, 0] < 50.0).all()):
        table[:, 0] *= 1000.0
    k_first = table.shape[1] == 3 and header.split()[-2:-1] == ["k"]
    return table[:, [0, 2, 1]] if k_first else table


def sorted_table(names: str, table: Table) -> Table:
    """Sorted by wavelength, without repeated lines; an error for two values at one wavelength."""
    table = np.unique(table, axis=0)
    repeated = table[1:, 0][np.diff(table[:, 0]) == 0.0]
    if repeated.size:
        raise input_error(
            f"{names}: two different values at {repeated[0]:g} nm",
            "one value at each wavelength",
            "Remove those that do not belong.",
        )
    return table

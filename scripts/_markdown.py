"""Where scripts put their tables in the pages of the documentation."""

from __future__ import annotations

from pathlib import Path

from fresnel_decomp._check import input_error
from fresnel_decomp._files import write_text


def insert(page: Path, text: str, marks: tuple[str, str]) -> None:
    """Replace what stands between two marks in a Markdown file.

    Raises
    ------
    InputError
        If they are not there once each.
    """
    before, *rest = page.read_text(encoding="utf-8").split(marks[0])
    after = rest[0].split(marks[1])[1:] if len(rest) == 1 else []
    if len(after) != 1:
        raise input_error(
            f"'{page}' without a place for the tables",
            f"lines '{marks[0].strip()}' and '{marks[1].strip()}' in it",
            "Add them.",
        )
    write_text(page, f"{before}{marks[0]}\n{text}\n\n{marks[1]}{after[0]}")

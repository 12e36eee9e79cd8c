"""Tables in Markdown, and where scripts put them in the pages of the documentation."""

from __future__ import annotations

from pathlib import Path

from fresnel_decomp._check import input_error
from fresnel_decomp._files import write_text
from fresnel_decomp._markdown import markdown_table as markdown

__all__ = ["Marks", "check_page", "insert", "markdown", "marks"]

Marks = tuple[str, str]
"""The lines between which a text stands on a page."""


def marks(name: str) -> Marks:
    """Those of a text of that name."""
    return f"<!-- {name} -->\n", f"<!-- end of {name} -->\n"


def insert(page: Path, text: str, marks: Marks) -> None:
    """Replace what stands between two marks in a Markdown file.

    Raises
    ------
    InputError
        If they are not there once each.
    """
    before, after = _around(page, marks)
    write_text(page, f"{before}{marks[0]}\n{text}\n\n{marks[1]}{after}")


def check_page(page: Path, *marks: Marks) -> None:
    """Make sure that `insert` finds these pairs of marks.

    So a long run does not end with a page that has no place for its tables.

    Raises
    ------
    InputError
        If it does not.
    """
    if not page.is_file():
        raise input_error(f"no file '{page}'", "a Markdown file", "Check the path.")
    for pair in marks:
        _around(page, pair)


def _around(page: Path, marks: Marks) -> tuple[str, str]:
    """What stands before and after two marks."""
    before, *rest = page.read_text(encoding="utf-8").split(marks[0])
    after = rest[0].split(marks[1]) if len(rest) == 1 else []
    if len(after) != 2:
        raise input_error(
            f"'{page}' without a place for the tables",
            f"lines '{marks[0].strip()}' and '{marks[1].strip()}' in it",
            "Add them.",
        )
    return before, after[1]

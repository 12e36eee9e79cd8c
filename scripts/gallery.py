"""Every picture of the documentation with the command that makes it, as the page docs/gallery.md.

    python scripts/gallery.py          # writes the page
    python scripts/gallery.py --check  # only says what is missing

Pictures of scripts that `reproduce.py` runs are known from there; the others are listed here. What
a picture shows is said once, as its alternative text on the page that explains it. It is an error
if docs/figures holds a picture that nothing makes, or lacks one that something does.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import click

from _command_line import ROOT, main, script
from _figure import PICTURES
from fresnel_decomp._check import input_error
from fresnel_decomp._files import write_text
from reproduce import FIGURES

PAGE = ROOT / "docs" / "gallery.md"
FIGURES_FOLDER = "docs/figures"

_SPEED = (
    "python scripts/speed_vs_error.py --page docs/speed_vs_error.md --readme README.md",
    "speed_vs_error",
)

OTHERS = {
    "recipes.png": (
        "How accurate each recipe is, with 3 to 6 terms",
        "python scripts/accuracy_table.py --out errors.json && "
        "python scripts/recipe_tradeoffs.py figure errors.json",
        "recipes",
    ),
    "colour_models.png": (
        "Metals by every model under D65",
        "python scripts/colour_report.py --pictures docs/figures",
        "colour",
    ),
    "colour_materials.png": (
        "All measured materials, and how far each model is from them",
        "python scripts/colour_report.py --pictures docs/figures",
        "colour",
    ),
    "card_Au.png": (
        "A card of a material, for artists and engines",
        "fresnel-decomp material Au --out docs/figures/card_Au.png",
        "command_line",
    ),
    "plans.png": (
        "Planned scenes: what is predicted and what is measured",
        "python scripts/plan_study.py --page docs/plans.md --picture docs/figures/plans.png",
        "plans",
    ),
    "stability.png": (
        "Errors of the exact equations on hostile input",
        "python scripts/stability.py --picture docs/figures/stability.png",
        "stability",
    ),
    "screen_pass.png": (
        "A full-screen split-sum pass, and colour differences to the exact Fresnel",
        "python scripts/bench_gpu.py --figure docs/figures/screen_pass.png",
        "speed_gpu",
    ),
    "speed_vs_error.png": ("Every model's error over three kinds of cost", *_SPEED),
    "speed_vs_error_compute.png": ("Error against kernel time, compute-bound", *_SPEED),
    "speed_vs_error_streaming.png": ("Error against kernel time, streaming", *_SPEED),
    "speed_vs_error_bsdf.png": ("Error against the BSDF's time", *_SPEED),
    "speed_vs_error_render.png": ("Error against the time of a render", *_SPEED),
    "speed_vs_error_bytes.png": ("Error against bytes of storage", *_SPEED),
    "speed_vs_error_operations.png": ("Error against operations in the kernel", *_SPEED),
}
"""Title, command, and the page that shows the picture."""

INTRODUCTION = """# Gallery

<!-- Made by scripts/gallery.py -->

All pictures of this documentation, each with the command that makes it and the page that explains
it. `python scripts/reproduce.py` makes most of them at once; it keeps what is finished and goes on
after an interruption.
"""


@dataclass(frozen=True)
class Entry:
    """A picture.

    Attributes
    ----------
    name : str
        Of its file.
    title : str
        The caption.
    command : str
        That makes it.
    page : str
        That explains it.
    alt : str
        What it shows.
    """

    name: str
    title: str
    command: str
    page: str
    alt: str


def entries() -> list[Entry]:
    """All pictures: those that `reproduce.py` makes in its order, then the others."""
    found = []
    for figure in FIGURES.values():
        pictures = [name for name in figure.pictures if name.endswith(".png")]  # no tables
        for picture in pictures:
            page = page_of(picture)
            alt = alt_of(picture, page)
            title = figure.title if len(pictures) == 1 else alt
            command = f"python scripts/reproduce.py --only {figure.name}"
            found.append(Entry(picture, title, command, page, alt))
    for name, (title, command, page) in OTHERS.items():
        found.append(Entry(name, title, command, page, alt_of(name, page)))
    return found


def page_of(picture: str) -> str:
    """The first page that shows a picture and is neither this one nor the landing page."""
    for path in sorted((ROOT / "docs").glob("*.md")):
        shown = f"figures/{picture}" in path.read_text(encoding="utf-8")
        if shown and path.stem not in ("gallery", "index"):
            return path.stem
    raise input_error(
        f"no page shows '{picture}'",
        "pictures that a page explains",
        "Add it to one, or delete it.",
    )


def alt_of(picture: str, page: str) -> str:
    """The alternative text that a page gives a picture, as one line.

    Raises
    ------
    InputError
        If it gives none.
    """
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    figure = rf"\{{figure\}} figures/{re.escape(picture)}\n"
    shown = re.search(figure + r":alt: (.+(?:\n +.+)*)", text)
    if shown is None:
        raise input_error(
            f"docs/{page}.md does not say what '{picture}' shows", "a figure with :alt:", "Add it."
        )
    return " ".join(shown[1].split()).removesuffix(".")


def check(found: list[Entry]) -> None:
    """Compare with the folder.

    Raises
    ------
    InputError
        For a picture without a command, a command without its picture, or a script that is not
        there.
    """
    made, there = {e.name for e in found}, {path.name for path in PICTURES.glob("*.png")}
    if made != there:
        raise input_error(
            f"pictures in {FIGURES_FOLDER} that nothing makes: {sorted(there - made) or 'none'}, "
            f"that are missing: {sorted(made - there) or 'none'}",
            "one entry for each picture",
            "Add it to OTHERS in scripts/gallery.py, or run its command.",
        )
    for entry in found:
        script = re.search(r"scripts/\S+\.py", entry.command)
        if script and not (ROOT / script[0]).is_file():
            raise input_error(f"no {script[0]}", "a script that exists", "Correct the command.")


def text(found: list[Entry]) -> str:
    """The page."""
    parts = [INTRODUCTION]
    for entry in found:
        parts.append(
            f"```{{figure}} figures/{entry.name}\n:alt: {entry.alt}\n:width: 70%\n\n"
            f"{entry.title}. [More]({entry.page}.md)\n\n`{entry.command}`\n```\n"
        )
    return "\n".join(parts)


@script()
@click.option("--check", "only_check", is_flag=True, help="Write nothing.")
def gallery(only_check: bool) -> None:
    """Write docs/gallery.md: every picture with its command."""
    found = entries()
    check(found)
    if not only_check:
        write_text(PAGE, text(found))
        click.echo(f"Wrote {PAGE.relative_to(ROOT)}: {len(found)} pictures")
    elif not PAGE.is_file() or PAGE.read_text(encoding="utf-8") != text(found):
        raise input_error(
            "docs/gallery.md is not what this script writes",
            "the page as written",
            "Run: python scripts/gallery.py",
        )


if __name__ == "__main__":
    main(gallery)

"""What the figure scripts share: computing once, sidecars, resuming, the command line.

A `Figure` has two steps. *Computing* writes CSV and EXR files and, last of all, `<name>.json`,
which says what they were made from: its presence with the same settings means finished. *Drawing*
reads these files and nothing else.
"""

from __future__ import annotations

import contextlib
import datetime
import json
import platform
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import click
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from _markdown import check_page, insert
from fresnel_decomp import __version__, doctor, load_basis
from fresnel_decomp._check import input_error
from fresnel_decomp._files import replacing, writable_folder, write_json
from fresnel_decomp.cli import run_and_exit

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = Path(__file__).resolve().parent
PICTURES = ROOT / "docs" / "figures"
DATA = ROOT / "out" / "figures"
QUICK_DATA = ROOT / "out" / "figures-quick"

Report = Callable[[str, float], None]
"""Told the name of a step and the fraction of all work that is done."""


@dataclass(frozen=True)
class Job:
    """One computation: where its files go and what they are made from."""

    folder: Path
    settings: dict[str, Any]
    report: Report


@dataclass(frozen=True)
class Figure:
    """A figure of the talk, or of this project.

    Attributes
    ----------
    name : str
        Of its script, its data folder, its sidecar and its pictures.
    title : str
        One line.
    minutes : float
        That computing takes on two cores.
    compute : callable
        Writes files into the folder of a `Job`; what it returns goes into the sidecar.
    draw : callable
        Reads a data folder; writes `pictures` into the folder that is its second argument.
    pictures : tuple of str
    parameters : mapping
        What is shown: materials, roughnesses.
    scene, size, spp
        Of the renders; `scene` is None for a figure without any.
    """

    name: str
    title: str
    minutes: float
    compute: Callable[[Job], dict[str, Any]]
    draw: Callable[[Path, Path], None]
    pictures: tuple[str, ...]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    scene: str | None = None
    size: int = 320
    spp: int = 144
    seed: int = 0

    def settings(self, quick: bool, variant: str | None) -> dict[str, Any]:
        """All that the result depends on, as JSON reads it back.

        Raises
        ------
        InputError
            For a variant that cannot run here or does not render RGB.
        """
        basis = load_basis()
        settings: dict[str, Any] = {
            "parameters": dict(self.parameters),
            "basis": {
                "recipe": basis.recipe,
                "terms": basis.terms,
                "sha256": basis.provenance["sha256"],
            },
            "fresnel_decomp": __version__,
        }
        if quick:
            settings["quick"] = True
        if self.scene is not None:
            chosen = variant or doctor.best_variant()
            doctor.require_variant(chosen)
            if "_rgb" not in chosen:
                raise input_error(
                    f"variant '{chosen}'", "a variant that renders RGB", "Try llvm_ad_rgb."
                )
            size, spp = self.size, self.spp
            if quick:
                size, spp = 32, 4
            elif chosen.startswith("scalar"):
                size, spp = 96, 16
            settings |= {
                "scene": self.scene,
                "size": size,
                "spp": spp,
                "seed": self.seed,
                "variant": chosen,
                "mitsuba": _versions()["mitsuba"],
            }
        return json.loads(json.dumps(settings))


# --- computing -----------------------------------------------------------------------------------


def compute(
    figure: Figure,
    folder: Path,
    *,
    quick: bool = False,
    force: bool = False,
    variant: str | None = None,
    console: Console | None = None,
) -> float | None:
    """Compute a figure unless it is finished.

    Parameters
    ----------
    figure : Figure
    folder : Path
        For its data and nothing else: with `force` all tables and images in it are removed.
    quick : bool
        Tiny images and few sizes, to see that everything runs.
    force : bool
        Compute again what is finished.
    variant : str, optional
        Of Mitsuba; the fastest that works here if none is given.
    console : Console, optional
        For the progress bar.

    Returns
    -------
    float or None
        Seconds it took, None if it was finished.
    """
    settings = figure.settings(quick, variant)
    if not force and is_finished(figure, folder, settings):
        return None
    writable_folder(folder)
    sidecar_path(figure.name, folder).unlink(missing_ok=True)
    if force:
        for path in [*folder.glob("*.exr"), *folder.glob("*.csv")]:
            path.unlink()
    resumed = sorted(path.name for path in folder.glob("*.exr"))
    begun = time.monotonic()
    with _progress(figure.name, console or Console(stderr=True)) as report:
        results = figure.compute(Job(folder, settings, report))
    seconds = time.monotonic() - begun
    write_json(
        sidecar_path(figure.name, folder),
        {
            "figure": figure.name,
            "title": figure.title,
            "settings": settings,
            "results": results,
            "files": sorted(p.name for p in folder.iterdir() if p.suffix in (".exr", ".csv")),
            "runtime_s": round(seconds, 2),
            "images_of_an_earlier_run": resumed,
            "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "commit": _commit(),
            "versions": _versions(),
            "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        },
    )
    return seconds


def sidecar_path(name: str, folder: Path) -> Path:
    return folder / f"{name}.json"


def is_finished(figure: Figure, folder: Path, settings: dict[str, Any]) -> bool:
    """Whether the folder holds this figure, whole, made from these settings."""
    try:
        sidecar = json.loads(sidecar_path(figure.name, folder).read_text(encoding="utf-8"))
        files = [folder / name for name in sidecar["files"]]
        return sidecar["settings"] == settings and all(path.is_file() for path in files)
    except (OSError, ValueError, KeyError, TypeError):
        return False


def read_sidecar(name: str, folder: Path) -> dict[str, Any]:
    """What `compute` wrote last.

    Raises
    ------
    InputError
        If it did not finish.
    """
    path = sidecar_path(name, folder)
    if not path.is_file():
        raise input_error(
            f"no finished results in '{folder}'",
            f"a folder with '{path.name}'",
            f"Run: python scripts/{name}.py compute",
        )
    return json.loads(path.read_text(encoding="utf-8"))


def write_table(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns of numbers as CSV with a header line, whole or not at all."""
    with replacing(path) as temporary:
        np.savetxt(
            temporary,
            np.stack(list(columns.values()), axis=1),
            fmt="%.9g",
            delimiter=",",
            header=",".join(columns),
            comments="",
            encoding="utf-8",
        )


def read_table(path: Path) -> dict[str, np.ndarray]:
    """Read what `write_table` wrote."""
    with path.open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        return dict(zip(names, np.loadtxt(file, delimiter=",", ndmin=2).T, strict=True))


@contextlib.contextmanager
def _progress(name: str, console: Console) -> Iterator[Report]:
    """A bar that is gone when the work is done."""
    bar = Progress(
        TextColumn(f"{name:<18} {{task.description:<26}}"),
        BarColumn(bar_width=30),
        TextColumn("{task.percentage:3.0f}%"),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    with bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda step, fraction: bar.update(task, description=step, completed=fraction)


def _versions() -> dict[str, str]:
    found = doctor.report()
    llvm = ".".join(map(str, found.llvm.version or ())) if found.llvm.usable else "none"
    return {
        **found.versions,
        "numpy": np.__version__,
        "llvm": llvm,
        "platform": f"{found.platform}, {platform.python_implementation()}",
    }


def _commit() -> str | None:
    """The commit this was made from, with "+ changes" if files differ; None outside Git."""

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(ROOT), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    if not (ROOT / ".git").exists():
        return None
    try:
        changed = git("status", "--porcelain", "--", "src", "scripts")
        return git("rev-parse", "HEAD") + (" + changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return None


# --- drawing -------------------------------------------------------------------------------------


def draw(figure: Figure, folder: Path, pictures: Path) -> list[Path]:
    """Draw a finished figure; return the files."""
    read_sidecar(figure.name, folder)
    figure.draw(folder, writable_folder(pictures))
    return [pictures / name for name in figure.pictures]


def is_drawn(figure: Figure, folder: Path, pictures: Path) -> bool:
    """Whether all pictures are newer than the data and the code that draws them."""
    sources = [
        sidecar_path(figure.name, folder),
        SCRIPTS / f"{figure.name}.py",
        SCRIPTS / "_page.py",
    ]
    newest = max(path.stat().st_mtime for path in sources)
    paths = [pictures / name for name in figure.pictures]
    return all(path.is_file() and path.stat().st_mtime >= newest for path in paths)


# --- command line --------------------------------------------------------------------------------


def say_if_reduced(variant: str | None) -> None:
    """One line where there is neither a usable LLVM nor a GPU."""
    if variant is None and (best := doctor.best_variant()).startswith("scalar"):
        click.echo(f"No usable LLVM or GPU: rendering in {best} at a reduced size.", err=True)


def commands(figure: Figure) -> click.Group:
    """The command line of one figure's script: `compute` and `draw`."""

    @click.group(help=f"{figure.title}.", context_settings={"help_option_names": ["-h", "--help"]})
    def group() -> None:
        pass

    @group.command("compute")
    @click.option("--quick", is_flag=True, help="Tiny images, to see that everything runs.")
    @click.option("--force", is_flag=True, help="Compute again what is finished.")
    @click.option("--variant", help="Mitsuba variant.  [default: the fastest that works here]")
    @click.option(
        "--out",
        type=click.Path(path_type=Path),
        help=f"Data go to a folder {figure.name} in this one.  [default: out/figures; "
        "with --quick out/figures-quick]",
    )
    def compute_command(quick: bool, force: bool, variant: str | None, out: Path | None) -> None:
        """Compute the data, unless they are finished."""
        folder = (out or (QUICK_DATA if quick else DATA)) / figure.name
        if figure.scene is not None:
            say_if_reduced(variant)
        seconds = compute(figure, folder, quick=quick, force=force, variant=variant)
        state = "was finished" if seconds is None else f"took {seconds:.1f} s"
        click.echo(f"{figure.name} {state}: {shown(folder)}")

    @group.command("draw")
    @click.option(
        "--data",
        type=click.Path(path_type=Path),
        help="What --out of `compute` was.  [default: out/figures]",
    )
    @click.option(
        "--out",
        type=click.Path(path_type=Path),
        help="Folder for the pictures.  [default: docs/figures]",
    )
    def draw_command(data: Path | None, out: Path | None) -> None:
        """Draw from the data of `compute`."""
        for path in draw(figure, (data or DATA) / figure.name, out or PICTURES):
            click.echo(f"Wrote {shown(path)}")

    return group


Marks = tuple[str, str]


def study(
    figure: Figure,
    texts: Callable[[dict[str, Any]], Mapping[str, str]],
    marks: Mapping[str, Marks],
) -> click.Command:
    """The command line of a study: compute what is missing, draw, print, and fill in a page.

    Parameters
    ----------
    figure : Figure
    texts : callable
        From the results in the sidecar to what is printed, by name.
    marks : mapping
        Lines between which texts stand on a page, for those that do.
    """

    @click.command(
        help=f"{figure.title}.", context_settings={"help_option_names": ["-h", "--help"]}
    )
    @click.option("--quick", is_flag=True, help="Tiny images, to see that everything runs.")
    @click.option("--force", is_flag=True, help="Compute again what is finished.")
    @click.option("--variant", help="Mitsuba variant.  [default: the fastest that works here]")
    @click.option("--page", type=click.Path(path_type=Path), help="Replace the tables of a page.")
    @click.option(
        "--out",
        type=click.Path(path_type=Path),
        help="Folder for data and pictures.  [default: out/figures and docs/figures; "
        "with --quick out/figures-quick]",
    )
    def command(
        quick: bool, force: bool, variant: str | None, page: Path | None, out: Path | None
    ) -> None:
        if page is not None:
            check_page(page, *marks.values())
            if quick and page.resolve().is_relative_to(ROOT):
                raise input_error(
                    f"--quick together with '{page}'", "pages of whole studies", "Leave one out."
                )
        data = out or (QUICK_DATA if quick else DATA)
        if figure.scene is not None:
            say_if_reduced(variant)
        folder = data / figure.name
        seconds = compute(figure, folder, quick=quick, force=force, variant=variant)
        state = "was finished" if seconds is None else f"took {seconds:.0f} s"
        click.echo(f"{figure.name} {state}: {shown(folder)}")
        for path in draw(figure, folder, data if out or quick else PICTURES):
            click.echo(f"Wrote {shown(path)}")
        for name, text in texts(read_sidecar(figure.name, folder)["results"]).items():
            click.echo(f"\n{text}")
            if page is not None and name in marks:
                insert(page, text, marks[name])

    return command


def shown(path: Path) -> str:
    """A path as short as it can be given."""
    path = path.resolve()
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path)


def main(command: click.Command, arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit: 0 done, 1 failed, 2 bad input, 130 interrupted."""
    doctor.prepare()  # before anything imports Dr.Jit
    run_and_exit(
        command,
        arguments,
        Path(sys.argv[0]).name,
        "Interrupted. Finished images are kept: the same command (without --force) goes on from "
        "them.",
    )

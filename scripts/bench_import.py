"""What importing the package and its parts costs, in fresh interpreters.

    python scripts/bench_import.py --page docs/contributing.md

Each row is the median over rounds, ± half the distance between the quartiles, of the time that a
fresh interpreter takes for the statement alone, by the clock and of the processor. The
interpreter's own start is not in it. *Heavy* are those of Mitsuba, Dr.Jit, colour-science,
matplotlib, SciPy and NumPy that were loaded. Below it is what `python -X importtime` finds slowest
under the import of the package itself.
"""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress

from _command_line import json_option, main, page_option, script
from _markdown import insert, markdown, marks
from fresnel_decomp._files import write_json
from fresnel_decomp._spread import median_and_spread
from fresnel_decomp.bench.machine import processor

MARKS = marks("import times")
LIMIT_S = 0.3
HEAVY = ("mitsuba", "drjit", "colour", "matplotlib", "scipy", "numpy")
PREPARED = "from fresnel_decomp import doctor; doctor.prepare()"
STATEMENTS = {
    "import fresnel_decomp": "",
    "from fresnel_decomp import conductor": "",
    "from fresnel_decomp import load_basis, load_material, AlbedoTable": "",
    "import fresnel_decomp.mitsuba": PREPARED,
    "import mitsuba": PREPARED,
}
"""What is timed, and what goes before it untimed."""

_PROGRAM = """
import json, sys, time
{before}
wall, cpu = time.perf_counter(), time.process_time()
{statement}
wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
mitsuba = sys.modules.get("mitsuba")
print(json.dumps({{
    "wall": wall, "cpu": cpu, "modules": len(sys.modules),
    "heavy": [n for n in {heavy!r} if n in sys.modules],
    "variant": mitsuba.variant() if mitsuba else None,
}}))
"""


def fresh(statement: str, before: str) -> dict[str, Any]:
    """One run in a new interpreter."""
    program = _PROGRAM.format(statement=statement, before=before, heavy=HEAVY)
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    return json.loads(result.stdout)


def slowest(count: int = 5) -> list[dict[str, Any]]:
    """Modules with the largest time of their own under `import fresnel_decomp`."""
    result = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", "import fresnel_decomp"],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = []
    for line in result.stderr.splitlines():
        match = re.match(r"import time:\s+(\d+) \|\s+(\d+) \| ( *)(\S+)$", line)
        if match:
            rows.append(
                {
                    "module": match[4],
                    "own_us": int(match[1]),
                    "total_us": int(match[2]),
                    "depth": len(match[3]) // 2,
                }
            )
    # a module's imports stand before it, one level deeper
    last = next(i for i, row in enumerate(rows) if row["module"] == "fresnel_decomp")
    first = last
    while first > 0 and rows[first - 1]["depth"] > rows[last]["depth"]:
        first -= 1
    return sorted(rows[first : last + 1], key=lambda row: -row["own_us"])[:count]


def report(results: dict[str, Any]) -> str:
    """Markdown."""
    rows = []
    for statement, runs in results["statements"].items():
        cells = []
        for clock in ("wall", "cpu"):
            middle, half = median_and_spread([1e3 * run[clock] for run in runs])
            cells.append(f"{middle:.0f} ± {half:.0f}")
        rows.append([f"`{statement}`", *cells, ", ".join(runs[0]["heavy"]) or "none"])
    table = markdown(("fresh interpreter", "ms by the clock", "ms of the processor", "heavy"), rows)
    wall, _ = median_and_spread(
        [run["wall"] for run in results["statements"]["import fresnel_decomp"]]
    )
    verdict = "met" if wall <= LIMIT_S else "missed"
    listed = ", ".join(f"`{r['module']}` {r['own_us'] / 1e3:.1f}" for r in results["slowest"])
    return (
        f"{table}\n\nTarget: `import fresnel_decomp` in {LIMIT_S} s: {verdict}. None of these sets "
        f"a variant. Slowest by `-X importtime`, in ms of their own: {listed}. Medians of "
        f"{results['rounds']} runs, {results['machine']}."
    )


@script()
@click.option("--rounds", default=15, show_default=True, type=click.IntRange(5))
@json_option
@page_option(MARKS)
def bench(rounds: int, out: Path | None, page: Path | None) -> None:
    """Import times of the package and its parts."""
    runs: dict[str, list[dict[str, Any]]] = {statement: [] for statement in STATEMENTS}
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("importing", total=(rounds + 1) * len(STATEMENTS))
        for number in range(rounds + 1):  # the first fills the caches of the file system
            for statement, before in STATEMENTS.items():
                run = fresh(statement, before)
                if run["variant"] is not None:
                    raise RuntimeError(f"'{statement}' set variant {run['variant']}")
                if number:
                    runs[statement].append(run)
                progress.advance(task)
    results = {
        "statements": runs,
        "slowest": slowest(),
        "rounds": rounds,
        "machine": f"{processor()}, {os.cpu_count()} cores, Python {platform.python_version()}",
    }
    click.echo(report(results))
    if out:
        write_json(out, results)
    if page:
        insert(page, report(results), MARKS)
        click.echo(f"Wrote {page}", err=True)


if __name__ == "__main__":
    main(bench)

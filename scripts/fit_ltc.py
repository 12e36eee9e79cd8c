"""Fit the linearly transformed cosines that ship with the package and write them to its data.

    python scripts/fit_ltc.py                                   # a few minutes
    python scripts/fit_ltc.py --smith correlated --out my.npz   # engines' masking and shadowing

Needed only after a change of `ltc_fit`: `load_lobes` reads the file, and a test fits some columns
anew and compares. Columns of the table (view angles) are kept in out/ltc as they are finished:
interrupt it when you like, the same command goes on from them. The result is the same every time.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
import numpy as np
import scipy
from rich.console import Console
from rich.progress import Progress

import fresnel_decomp
from _command_line import ROOT, main, script, shown
from fresnel_decomp import __version__
from fresnel_decomp._files import writable_folder, write_json
from fresnel_decomp.ltc import LEAST_ALPHA, LobeTable
from fresnel_decomp.ltc_fit import MEASURE, NODES, TIE, fit_column
from fresnel_decomp.microfacet import SMITH
from fresnel_decomp.table_layout import Layout

DATA = Path(fresnel_decomp.__file__).parent / "data"
PARTS = ROOT / "out" / "ltc"


@script()
@click.option("--smith", type=click.Choice(SMITH), default="separable", show_default=True)
@click.option("--size", type=click.IntRange(2, 256), default=64, show_default=True)
@click.option("--nodes", type=click.IntRange(16), default=NODES, show_default=True)
@click.option("--force", is_flag=True, help="Fit again what is finished.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="The table, .npz.  [default: the data folder of the package]",
)
def fit(smith: str, size: int, nodes: int, force: bool, out: Path | None) -> None:
    """Fit a table of linearly transformed cosines to GGX."""
    layout = Layout(size, size)
    settings = {
        "smith": smith,
        "size": size,
        "nodes": nodes,
        "tie": TIE,
        "measure": MEASURE,
        "least_alpha": LEAST_ALPHA,
        "fresnel_decomp": __version__,
    }
    folder = writable_folder(PARTS / f"ggx-{smith}-{size}")
    columns = []
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(f"GGX, {smith}", total=size * size)
        for j, mu in enumerate(layout.mu):
            path = folder / f"column_{j:03}.json"
            column = None if force else finished(path, settings)
            if column is None:
                fits = fit_column(
                    float(mu), layout.alpha, smith, nodes, lambda done: progress.advance(task)
                )
                column = {
                    "settings": settings,
                    "residual": [list(f.residual) for f in fits],
                    "distance": [f.distance for f in fits],
                    "converged": all(f.converged for f in fits),
                }
                write_json(path, column)
            else:
                progress.advance(task, size)
            columns.append(column)
    values = np.stack([column["residual"] for column in columns], axis=1)
    distance = np.stack([column["distance"] for column in columns], axis=1)
    metadata: dict[str, Any] = {
        "measure": MEASURE,
        "nodes": f"{nodes} mirrored at visible normals, {nodes} near the mirror direction",
        "all_converged": all(column["converged"] for column in columns),
        "distance": {
            "what": "half the integral of |f - D|",
            "mean": round(float(distance.mean()), 6),
            "max": round(float(distance.max()), 6),
        },
        "software": f"fresnel_decomp {__version__}, SciPy {scipy.__version__}",
    }
    table = LobeTable(values, layout, smith, "ggx", metadata)  # type: ignore[arg-type]
    target = out or DATA / f"ltc-ggx-{smith}.npz"
    table.save(target)
    click.echo(
        f"Wrote {shown(target)}: {target.stat().st_size:,} bytes, sha256 {table.sha256[:16]}"
    )
    click.echo(
        f"distance mean {distance.mean():.4f}, max {distance.max():.4f}; "
        f"for mu >= 0.2 mean {distance[:, layout.mu >= 0.2].mean():.4f}, "
        f"max {distance[:, layout.mu >= 0.2].max():.4f}; "
        f"all converged: {metadata['all_converged']}"
    )


def finished(path: Path, settings: dict[str, Any]) -> dict[str, Any] | None:
    """A column that was fitted with these settings."""
    try:
        column = json.loads(path.read_text(encoding="utf-8"))
        return column if column["settings"] == settings else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


if __name__ == "__main__":
    main(fit, interrupted="Interrupted. The same command goes on from finished columns.")

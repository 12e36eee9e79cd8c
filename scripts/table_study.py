"""How small a preintegrated table may be: error against size, axes and storage format.

    python scripts/table_study.py --page docs/preintegration.md

The error is that of the table alone: |sum_i c_i (bbar_i looked up - bbar_i integrated)|, for the
coefficients of `INDICES`, over a grid of view angles and roughnesses that is dense where tables are
coarse and does not coincide with texels. It is largest in the corner mu -> 0, alpha -> 0, where the
albedo itself has no limit, so it is given three times: anywhere; for alpha >= .002, which is where
Filament clamps the roughness (.045² for 32-bit floats); and outside the corner, that is where
mu >= .05 or alpha >= .02.

Interrupt it when you like: finished tables are kept, and the same command goes on from them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter

import _kept
from _figure import Figure, Job, read_sidecar, read_table, write_table
from _figure_commands import main, study
from _markdown import markdown, marks
from _page import GREY, Page
from fresnel_decomp import AlbedoTable, directional_albedo, load_basis
from fresnel_decomp._schlick import schlick_functions
from fresnel_decomp.fast_curves import FastCurves
from fresnel_decomp.report import style
from fresnel_decomp.table_layout import Layout

NAME = "table_study"
MARKS = marks("table study")

INDICES = {
    "n = 1.33": (1.33, 0.0),
    "n = 1.5": (1.5, 0.0),
    "n = 2": (2.0, 0.0),
    "n = 3": (3.0, 0.0),
    "gold, red": (0.18, 3.4),
    "gold, blue": (1.4, 1.9),
    "copper, green": (1.0, 2.6),
    "aluminium": (1.0, 6.6),
    "beryllium": (3.4, 3.2),
    "chromium": (3.1, 3.3),
    "tungsten": (3.5, 2.7),
}
"""About what these materials have at one wavelength each: curves of every kind."""

SIZES = (16, 24, 32, 48, 64, 96, 128, 192, 256)
AXES = {
    "default": ("sqrt_mu", "perceptual_roughness"),
    "mu": ("mu", "perceptual_roughness"),
    "theta": ("theta", "perceptual_roughness"),
    "alpha": ("sqrt_mu", "alpha"),
}
AXIS_LABELS = {
    "default": r"$\sqrt{\mu},\ \sqrt{\alpha}$ (default)",
    "mu": r"$\mu,\ \sqrt{\alpha}$",
    "theta": r"$\theta,\ \sqrt{\alpha}$",
    "alpha": r"$\sqrt{\mu},\ \alpha$",
}
AXIS_WORDS = {
    "default": "√μ, √α",
    "mu": "μ, √α",
    "theta": "θ, √α",
    "alpha": "√μ, α",
}
SMOOTHEST = 0.002
CORNER = (0.05, 0.02)  # in mu and alpha


def _unorm(bits: int, low: float = 0.0, high: float = 1.0) -> Callable[[np.ndarray], np.ndarray]:
    steps = 2**bits - 1

    def quantize(values: np.ndarray) -> np.ndarray:
        stored = np.round(np.clip((values - low) / (high - low), 0.0, 1.0) * steps)
        return low + stored / steps * (high - low)

    return quantize


def _half(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float16).astype(np.float64)


def _each(*channels: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    return lambda v: np.stack([f(v[..., i]) for i, f in enumerate(channels)], axis=-1)


# b_3 alone is signed: v is stored as (v + 1) / 2
FORMATS: dict[str, tuple[int, Callable[[np.ndarray], np.ndarray]]] = {
    "float": (16, lambda v: v),
    "half": (8, _half),
    "16-bit unorm": (8, _each(*[_unorm(16)] * 3, _unorm(16, -1.0))),
    "8-bit unorm": (4, _each(*[_unorm(8)] * 3, _unorm(8, -1.0))),
    "RGB10A2": (4, _each(*[_unorm(10)] * 3, _unorm(2, -1.0))),
}
"""Bytes per texel, and what comes out of what is put in."""


def grid() -> tuple[np.ndarray, np.ndarray]:
    """(m,) cosines and (n,) roughnesses at which errors are measured."""
    x = np.concatenate([[0.0], (np.arange(230) + 0.37) / 230, [1.0]])
    y = np.concatenate([[0.0], (np.arange(110) + 0.41) / 110, [1.0]])
    mu = np.unique(np.concatenate([x**2, np.geomspace(1e-5, 0.02, 25)]))
    alpha = np.unique(np.concatenate([y**2, np.geomspace(1e-4, 0.02, 15), [SMOOTHEST]]))
    return mu, alpha


# --- computing -----------------------------------------------------------------------------------


def compute(job: Job) -> dict[str, Any]:
    """Every table, its errors, and a map of them for the default one."""
    basis = load_basis()
    quick = job.settings.get("quick", False)
    sizes = SIZES[:3] if quick else SIZES
    coefficients = basis.coefficients(*np.array(list(INDICES.values())).T)
    mu, alpha = (values[:: 6 if quick else 1] for values in grid())
    job.report("integrals", 0.0)
    exact = _kept_rows(job, "exact", lambda: _exact(basis, mu, alpha)).reshape(
        len(alpha), len(mu), -1
    )
    layouts = [(axes, size) for axes in AXES for size in sizes]
    total = sum(size**2 for _, size in layouts)
    done, results = 0, {}
    for axes, size in layouts:
        job.report(f"{size} x {size}, {axes}", 0.1 + 0.85 * done / total)
        table = _table(job, basis, axes, size)
        done += size**2
        errors = _errors(table.lookup(mu, alpha[:, None]) - exact, coefficients, mu, alpha)
        results[f"{axes}-{size}"] = {"bytes": 8 * size**2, **errors}
    job.report("formats", 0.97)
    table = _table(job, basis, "default", 64)
    formats = {}
    for name, (size, quantize) in FORMATS.items():
        stored = AlbedoTable(quantize(table.values.astype(np.float64)), table.layout)
        looked_up = stored.lookup(mu, alpha[:, None])
        plain = table.lookup(mu, alpha[:, None])
        formats[name] = {
            "bytes": size * 64**2,
            **_errors(looked_up - exact, coefficients, mu, alpha),
            "added": float(np.abs((looked_up - plain) @ coefficients.T).max()),
        }
    error = np.abs((table.lookup(mu, alpha[:, None]) - exact) @ coefficients.T).max(axis=-1)
    columns = np.meshgrid(mu, alpha)
    write_table(
        job.folder / "map.csv",
        {"mu": columns[0].ravel(), "alpha": columns[1].ravel(), "error": error.ravel()},
    )
    job.report("Schlick's two terms", 0.98)
    two = AlbedoTable.bake(schlick_functions, 64)  # the pair that Karis 2013 preintegrates
    integrals = _kept_rows(job, "exact-schlick", lambda: _exact(schlick_functions, mu, alpha))
    difference = two.lookup(mu, alpha[:, None]) - integrals.reshape(len(alpha), len(mu), -1)
    f0 = coefficients[:, :1]
    schlick = _errors(difference, np.concatenate([f0, 1.0 - f0], axis=1), mu, alpha)
    return {"layouts": results, "formats": formats, "schlick": {"bytes": 4 * 64**2, **schlick}}


def _exact(basis: Any, mu: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    curves = FastCurves.of(basis)
    return np.concatenate([directional_albedo(curves, mu, a + 0.0 * mu) for a in alpha])


def _table(job: Job, basis: Any, axes: str, size: int) -> AlbedoTable:
    mu_axis, alpha_axis = AXES[axes]
    layout = Layout(size, size, mu_axis, alpha_axis)

    def bake() -> np.ndarray:
        table = AlbedoTable.bake(basis, size, mu_axis=mu_axis, alpha_axis=alpha_axis)
        return table.values.reshape(-1, table.terms)

    return AlbedoTable(_kept_rows(job, f"{axes}-{size}", bake).reshape(size, size, -1), layout)


def _kept_rows(job: Job, stem: str, make: Callable[[], np.ndarray]) -> np.ndarray:
    """(m, n) numbers that `_kept.table` keeps."""
    columns = _kept.table(job, stem, lambda: {f"b{i}": column for i, column in enumerate(make().T)})
    return np.stack(list(columns.values()), axis=-1)


def _errors(
    difference: np.ndarray, coefficients: np.ndarray, mu: np.ndarray, alpha: np.ndarray
) -> dict[str, Any]:
    """Errors of Fbar over all materials, and of the functions; `difference` is (alpha, mu, 4)."""
    error = np.abs(difference @ coefficients.T)
    corner = (mu < CORNER[0]) & (alpha[:, None] < CORNER[1])
    # the view direction as a picture has it: uniform in mu and in roughness
    weight = np.gradient(mu) * np.gradient(np.sqrt(alpha))[:, None]
    squares = (error**2).mean(axis=-1)
    return {
        "max": float(error.max()),
        "max_rough": float(error[alpha >= SMOOTHEST].max()),
        "max_outside_corner": float(error[~corner].max()),
        "p99": float(np.quantile(error, 0.99)),
        "rms": float(np.sqrt((squares * weight).sum() / weight.sum())),
        "max_functions": np.abs(difference).max(axis=(0, 1)).tolist(),
        "max_functions_rough": np.abs(difference[alpha >= SMOOTHEST]).max(axis=(0, 1)).tolist(),
    }


# --- drawing -------------------------------------------------------------------------------------


COLOURS = {"default": "#0072b2", "mu": "#d55e00", "theta": "#009e73", "alpha": "#cc79a7"}
MARKERS = {"default": "o", "mu": "s", "theta": "^", "alpha": "D"}


def draw(folder: Path, pictures: Path) -> None:
    """Error against size for each pair of axes; of storage formats; where the default one errs."""
    results = read_sidecar(NAME, folder)["results"]
    layouts, formats = results["layouts"], results["formats"]
    sizes = sorted({int(name.split("-")[1]) for name in layouts})
    with style.styled():
        page = Page(10.2, 3.75)
        axes = page.axes(0.7, 0.6, 3.0, 2.6)
        for name, label in AXIS_LABELS.items():
            options = {"color": COLOURS[name], "marker": MARKERS[name], "ms": 4}
            largest = [layouts[f"{name}-{n}"]["max_rough"] for n in sizes]
            axes.plot(sizes, largest, label=label, **options)
            outside = [layouts[f"{name}-{n}"]["max_outside_corner"] for n in sizes]
            axes.plot(sizes, outside, ls=":", mfc="white", **options)
        axes.set_xscale("log", base=2)
        axes.set_yscale("log")
        axes.set_xticks(sizes[::2], [str(n) for n in sizes[::2]])
        axes.set_xticks(sizes, minor=True, labels=[""] * len(sizes))
        axes.set_ylim(2e-5, 2.0)
        axes.axvline(64, color=GREY, lw=0.8, zorder=0)
        axes.set_xlabel("texels along each axis")
        axes.set_ylabel(r"largest error of $\bar F$")
        axes.legend(loc="upper right", ncols=2, fontsize=7.5, handlelength=1.4, columnspacing=0.9)
        page.write(0.7, 0.32, "Size and axes", ha="left", size=10)
        axes.annotate(
            f"solid: $\\alpha$ ≥ {SMOOTHEST:g}\n"
            f"dotted: $\\mu$ ≥ {CORNER[0]:g} or $\\alpha$ ≥ {CORNER[1]:g}",
            (0.03, 0.04), xycoords="axes fraction", size=7.5, color=GREY,
        )  # fmt: skip

        bars = page.axes(4.9, 0.6, 1.75, 2.6)
        names = list(formats)
        added = [formats[name]["added"] for name in names]
        floor = 2e-6
        bars.set_axisbelow(True)
        bars.barh(names, [max(a, floor) for a in added], color="#0072b2", height=0.55)
        for i, value in enumerate(added):
            text = f"{value:.1g}" if value else "0"
            bars.annotate(
                text, (max(value, floor), i), xytext=(3, 0), textcoords="offset points",
                va="center", size=7.5,
            )  # fmt: skip
        bars.set_xscale("log")
        bars.set_xlim(floor, 0.2)
        bars.set_xticks([1e-5, 1e-4, 1e-3, 1e-2])
        bars.minorticks_off()
        bars.invert_yaxis()
        bars.grid(axis="y", visible=False)
        bars.set_xlabel(r"added to $\bar F$ at most")
        page.write(4.9, 0.32, "Storage, 64 × 64", ha="left", size=10)

        table = read_table(folder / "map.csv")
        mu, alpha = np.unique(table["mu"]), np.unique(table["alpha"])
        # the largest nearby: at texels' centres it is 0, which would be all one sees
        error = maximum_filter(table["error"].reshape(len(alpha), len(mu)), size=7)
        where = page.axes(7.35, 0.6, 2.1, 2.6)
        mesh = where.pcolormesh(
            np.sqrt(mu), np.sqrt(alpha), np.log10(np.maximum(error, 1e-7)),
            cmap=style.SEQUENTIAL, vmin=-5, vmax=-1, shading="nearest", rasterized=True,
        )  # fmt: skip
        where.set_xlabel(r"$\sqrt{\mu}$")
        where.set_ylabel(r"perceptual roughness $\sqrt{\alpha}$")
        where.grid(visible=False)
        bar = page.figure.colorbar(mesh, cax=page.axes(9.55, 0.6, 0.1, 2.6), extend="both")
        bar.set_ticks([-5, -4, -3, -2, -1], labels=["1e-5", "1e-4", "1e-3", ".01", ".1"])
        bar.outline.set_linewidth(0.5)
        bar.ax.grid(visible=False)
        page.write(7.35, 0.32, r"Error of $\bar F$, default", ha="left", size=10)
        page.save(pictures / FIGURE.pictures[0], dpi=170)


def tables(results: Mapping[str, Any]) -> str:
    """The study in Markdown."""
    rows = []
    for name, errors in results["layouts"].items():
        axes, size = name.split("-")
        if axes == "default" or size == "64":
            rows.append((f"{size} × {size}, {AXIS_WORDS[axes]}", errors))
    rows.append(("64 × 64, √μ, √α, Schlick's two terms", results["schlick"]))
    regions = ("anywhere", f"α ≥ {SMOOTHEST:g}", "outside the corner", "RMS")
    first = markdown(
        ("size and axes", "bytes", *regions, f"b̄₀, b̄₁, b̄₂, b̄₃ for α ≥ {SMOOTHEST:g}"),
        [
            [
                name,
                f"{errors['bytes']:,}",
                *_by_region(errors),
                ", ".join(short(e) for e in errors["max_functions_rough"]),
            ]
            for name, errors in rows
        ],
    )
    second = markdown(
        ("64 × 64 stored as", "bytes", *regions, "added at most"),
        [
            [name, f"{errors['bytes']:,}", *_by_region(errors), short(errors["added"])]
            for name, errors in results["formats"].items()
        ],
    )
    return f"{first}\n\n{second}"


def _by_region(errors: Mapping[str, Any]) -> list[str]:
    return [short(errors[name]) for name in ("max", "max_rough", "max_outside_corner", "rms")]


def short(value: float) -> str:
    """Two digits."""
    if value == 0.0:
        return "0"
    if value < 1e-3:
        return f"{value:.1e}".replace("e-0", "e-")
    return f"{value:.4f}".lstrip("0")


FIGURE = Figure(
    name=NAME,
    title="The preintegrated table: error against size, axes and storage format",
    minutes=1.0,
    compute=compute,
    draw=draw,
    pictures=(f"{NAME}.png",),
    parameters={
        "indices": INDICES,
        "axes": AXES,
        "sizes": SIZES,
        "formats": list(FORMATS),
        "layout": asdict(Layout()),
        "smoothest": SMOOTHEST,
        "corner": CORNER,
    },
)

command = study(FIGURE, lambda results: {"study": tables(results)}, {"study": MARKS})


if __name__ == "__main__":
    main(command)

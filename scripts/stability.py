"""How wrong Fresnel formulas in common use get, in value and in derivative, where it is hard.

    python scripts/stability.py --picture docs/figures/stability.png --page docs/stability.md

For each formula and each region of hostile arguments: the worst error of R in units in the last
place and absolute, how many values are not finite or outside [0, 1], and the share of partial
derivatives that are off by more than 1 %. Arguments and exact answers are made in high precision;
a table of hard cases (--hard-cases) joins them where one is given.

float32 formulas get the arguments that are exact in float32, float64 formulas get all. Dr.Jit's
LLVM threads flush denormals, so formulas that run there are not asked about denormal arguments or
results. A derivative counts as off if it is not finite or its error exceeds 1 % of the exact one
(where that is 0: exceeds 1e-6); those that do not exist or do not fit the type are left out.
"""

from __future__ import annotations

import csv
import io
import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NoReturn

import click
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

# not Dr.Jit or Mitsuba: `main` has to choose an LLVM first
from _hard_cases import (
    GRADIENTS,
    REGIONS,
    VALUES,
    Points,
    generate,
    join,
    read,
)
from _markdown import insert, markdown
from _peer_formulas import FORMULAS, Formula
from fresnel_decomp import __version__, doctor
from fresnel_decomp._files import write_json, write_text
from fresnel_decomp.cli import run_and_exit
from fresnel_decomp.report import style

MARKS = ("<!-- tables -->\n", "<!-- end of tables -->\n")

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Result:
    """One formula on one region, or on all of them (`region` "all")."""

    formula: str
    region: str
    points: int
    worst_ulp: float
    """Of R, in units in the last place of the exact value; over finite values, as the next."""
    worst_absolute: float
    worst_at: tuple[float, float, float]
    """cos_theta, eta, k of the largest absolute error."""
    not_finite: int
    outside: int
    """Values below 0 or above 1."""
    gradients: int
    """Partial derivatives that were compared; 0 where there is no automatic differentiation."""
    gradients_off: int
    component_ulp: dict[str, float]
    """The same for every other output that the formula has."""

    @property
    def gradient_share(self) -> float | None:
        return self.gradients_off / self.gradients if self.gradients else None


# --- measuring -----------------------------------------------------------------------------------


def collect(
    regions: Sequence[str],
    count: int,
    table: Path | None,
    advance: Callable[[int], object] = lambda n: None,
) -> Points:
    """Half `count` float32 and half float64 points of each region, and the rows of `table`."""
    made = [
        generate(region, single, count // 2, advance=advance)
        for region in regions
        for single in (True, False)
    ]
    return join(*made, *([read(table, regions)] if table else []))


def measure(formula: Formula, points: Points, variant: str) -> list[Result]:
    """A result for all regions together, and one for each; none where nothing can be asked."""
    points = points.where(_askable(formula, points))
    if not len(points):
        return []
    outputs, gradients = _evaluate(formula, points, variant)
    dtype = np.dtype(np.float32 if formula.single else np.float64)
    seen = {
        name: np.ones(len(points), bool) if formula.numpy else _normal(points.exact[name][0], dtype)
        for name in (*VALUES, *GRADIENTS)
    }
    errors = {name: _errors(value, points.exact[name], dtype) for name, value in outputs.items()}
    off, compared = _gradients_off(gradients, points, seen, dtype)
    if not formula.absorbing:
        off[2] = compared[2] = False  # no k to differentiate by

    def result(region: str, mask: NDArray[np.bool_]) -> Result:
        R, mask_R = outputs["R"], mask & seen["R"]
        absolute, ulp = errors["R"]
        finite = mask_R & np.isfinite(R)
        worst = int(np.argmax(np.where(finite, absolute, -1.0)))
        return Result(
            formula=formula.name,
            region=region,
            points=int(mask_R.sum()),
            worst_ulp=float(np.max(ulp[finite], initial=0.0)),
            worst_absolute=float(np.max(absolute[finite], initial=0.0)),
            worst_at=tuple(map(float, points.inputs[:, worst])),
            not_finite=int((~np.isfinite(R) & mask_R).sum()),
            outside=int((((R < 0.0) | (R > 1.0)) & finite).sum()),
            gradients=int(compared[:, mask].sum()),
            gradients_off=int(off[:, mask].sum()),
            component_ulp={
                name: float(np.nanmax(errors[name][1][mask & seen[name]], initial=0.0))
                for name in outputs
                if name != "R"
            },
        )

    present = [region for region in REGIONS if (points.region == region).any()]
    return [
        result("all", np.ones(len(points), bool)),
        *(result(region, points.region == region) for region in present),
    ]


def _askable(formula: Formula, points: Points) -> NDArray[np.bool_]:
    mask = points.single.copy() if formula.single else np.ones(len(points), bool)
    if not formula.absorbing:
        mask &= points.inputs[2] == 0.0
    if not formula.numpy:
        dtype = np.dtype(np.float32 if formula.single else np.float64)
        mask &= _normal(points.inputs, dtype).all(axis=0)
    return mask


def _normal(values: Array, dtype: np.dtype[Any]) -> NDArray[np.bool_]:
    """Not denormal in that type."""
    return (values == 0.0) | (np.abs(values) >= np.finfo(dtype).tiny) | np.isnan(values)


def _evaluate(
    formula: Formula, points: Points, variant: str
) -> tuple[dict[str, Array], Array | None]:
    """Outputs, and dR/d(cos_theta, eta, k) or None."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant(variant)
    arguments: list[Any]
    if formula.numpy:
        arguments = list(points.inputs.astype(np.float32 if formula.single else np.float64))
        return {n: np.asarray(v, float) for n, v in formula.run(*arguments).items()}, None
    if variant.startswith("scalar"):
        import drjit.scalar

        kind = drjit.scalar.ArrayXf if formula.single else drjit.scalar.ArrayXf64
        arguments = [kind(row) for row in points.inputs]
        return {n: np.array(v, float) for n, v in formula.run(*arguments).items()}, None
    kind = dr.float32_array_t(mi.Float) if formula.single else dr.float64_array_t(mi.Float)
    arguments = [kind(row) for row in points.inputs]
    dr.make_opaque(arguments)  # literals would be folded at compile time, in another precision
    outputs = {n: np.array(v, float) for n, v in formula.run(*arguments).items()}
    dr.enable_grad(arguments)
    dr.backward(formula.run(*arguments)["R"])
    return outputs, np.stack([np.array(dr.grad(argument), float) for argument in arguments])


def _errors(value: Array, exact: Array, dtype: np.dtype[Any]) -> tuple[Array, Array]:
    """Absolute errors, and the same in units in the last place of the exact value."""
    high, low = exact
    error = np.abs((value - high) - low)
    unit = np.spacing(np.abs(high).astype(dtype)).astype(float)
    return error, np.where((high == 0.0) & (error > 0.0), np.inf, error / np.maximum(unit, 1e-300))


def _gradients_off(
    gradients: Array | None,
    points: Points,
    seen: dict[str, NDArray[np.bool_]],
    dtype: np.dtype[Any],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(3, n) masks: off by more than 1 %, and compared at all."""
    if gradients is None:
        return np.zeros((3, len(points)), bool), np.zeros((3, len(points)), bool)
    exact = np.stack([points.exact[name][0] for name in GRADIENTS])
    compared = np.abs(exact) <= np.finfo(dtype).max  # False for NaN, too
    compared &= np.stack([seen[name] for name in GRADIENTS])
    with np.errstate(invalid="ignore"):
        allowed = np.where(exact == 0.0, 1e-6, 0.01 * np.abs(exact))
        right = np.abs(gradients - exact) <= allowed  # False for NaN
    return compared & ~right, compared


# --- tables --------------------------------------------------------------------------------------


def summary(results: Sequence[Result]) -> str:
    """One row for each formula, over all regions."""
    rows = [
        [
            r.formula,
            str(r.points),
            short(r.worst_ulp),
            short(r.worst_absolute),
            str(r.not_finite),
            str(r.outside),
            share(r.gradient_share),
        ]
        for r in results
        if r.region == "all"
    ]
    head = ["formula", "points", "worst ulp", "worst absolute", "NaN, infinite", "outside [0, 1]"]
    return markdown([*head, "gradients off > 1 %"], rows)


def by_region(results: Sequence[Result], title: str, cell: Callable[[Result], str]) -> str:
    """One row for each formula, one column for each region."""
    formulas, regions = _axes(results)
    found = {(r.formula, r.region): r for r in results}
    rows = [
        [f, *(cell(found[f, region]) if (f, region) in found else "" for region in regions)]
        for f in formulas
    ]
    return markdown([title, *map(label, regions)], rows)


def components(results: Sequence[Result]) -> str:
    """Worst error in units in the last place of every output, over all regions."""
    rows = [
        [r.formula, short(r.worst_ulp), *(short(r.component_ulp.get(n)) for n in VALUES[1:])]
        for r in results
        if r.region == "all" and r.component_ulp
    ]
    return markdown(["worst ulp of", *VALUES], rows)


def _axes(results: Sequence[Result]) -> tuple[list[str], list[str]]:
    formulas = list(dict.fromkeys(r.formula for r in results))
    present = {r.region for r in results}
    return formulas, [region for region in REGIONS if region in present]


def label(region: str) -> str:
    name = region.replace("brewster", "Brewster").replace("_absorbing", ", k > 0")
    return name.replace("_", " ")


def short(value: float | None) -> str:
    """Two digits."""
    if value is None:
        return ""
    if value == 0.0 or value == float("inf"):
        return "0" if value == 0.0 else "∞"
    if 0.01 <= value < 100.0:
        return f"{value:.2g}"
    mantissa, exponent = f"{value:.0e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def share(value: float | None) -> str:
    if value is None:
        return ""
    percent = 100.0 * value
    if 0.0 < percent < 0.05:
        return "< 0.1 %"
    return f"{percent:.0f} %" if percent == 0.0 or percent >= 9.95 else f"{percent:.1f} %"


# --- the picture ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Panel:
    """One heat map."""

    title: str
    value: Callable[[Result], float | None]
    colour: Callable[[float], float]
    """From a value to [0, 1]."""
    text: Callable[[float], str]
    marks: bool = False


def _decades(low: float, high: float) -> Callable[[float], float]:
    def colour(value: float) -> float:
        return float(np.clip((np.log10(max(value, 1e-300)) - low) / (high - low), 0.0, 1.0))

    return colour


PANELS = (
    Panel(
        "Worst absolute error of R",
        lambda r: r.worst_absolute,
        _decades(-8.0, 0.0),
        short,
        marks=True,
    ),
    Panel(
        "Worst error of R in units in the last place",
        lambda r: r.worst_ulp,
        _decades(0.0, 8.0),
        short,
    ),
    Panel(
        "Share of partial derivatives off by more than 1 %",
        lambda r: r.gradient_share,
        lambda value: value,
        share,
    ),
)


def draw(results: Sequence[Result], path: Path) -> None:
    """Heat maps of `results`: a row for each formula, a column for each region."""
    formulas, regions = _axes(results)
    found = {(r.formula, r.region): r for r in results}
    cell_width, cell_height, left, top, gap = 0.52, 0.235, 1.75, 1.2, 0.42
    width = left + max(cell_width * len(regions), 5.0) + 0.6  # the last column's slanted name
    panel_height = cell_height * len(formulas)
    height = top + len(PANELS) * panel_height + (len(PANELS) - 1) * gap + 0.45
    with style.styled():
        fig = style.figure(width, height)
        for i, panel in enumerate(PANELS):
            y = top + i * (panel_height + gap)
            axes = fig.add_axes(
                (
                    left / width,
                    1.0 - (y + panel_height) / height,
                    cell_width * len(regions) / width,
                    panel_height / height,
                )
            )
            _heat_map(axes, panel, formulas, regions, found)
            axes.set_yticks(range(len(formulas)), formulas)
            fig.text(left / width, 1.0 - (y - 0.08 if i else 0.25) / height, panel.title, size=9.5)
            if i == 0:
                names = [label(region) for region in regions]
                axes.set_xticks(range(len(regions)), names, rotation=40, ha="left")
                axes.xaxis.tick_top()
            else:
                axes.set_xticks([])
            axes.tick_params(length=0, labelsize=8)
        fig.text(
            0.12 / width,
            0.16 / height,
            "Red dot: some values are NaN or infinite.  Blue dot: some are outside [0, 1].  "
            "Grey: not defined there, or not differentiable.",
            fontsize=8,
        )
        style.save(fig, path, dpi=115)


def _heat_map(
    axes: Any,
    panel: Panel,
    formulas: Sequence[str],
    regions: Sequence[str],
    found: dict[tuple[str, str], Result],
) -> None:
    import matplotlib

    colours = matplotlib.colormaps[style.SEQUENTIAL + "_r"]
    axes.set(xlim=(-0.5, len(regions) - 0.5), ylim=(len(formulas) - 0.5, -0.5))
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    image = np.full((len(formulas), len(regions), 3), 0.88)
    for row, formula in enumerate(formulas):
        for column, region in enumerate(regions):
            result = found.get((formula, region))
            value = panel.value(result) if result else None
            if value is None:
                continue
            # the ends of the map are nearly white and nearly black: leave them out
            colour = colours(0.05 + 0.8 * panel.colour(value))[:3]
            image[row, column] = colour
            light = float(np.dot(colour, (0.299, 0.587, 0.114))) > 0.55
            axes.text(
                column,
                row + 0.03,
                panel.text(value),
                ha="center",
                va="center",
                fontsize=7.5,
                color="black" if light else "white",
            )
            if panel.marks and result:
                for count, x, mark in (
                    (result.not_finite, 0.4, "#d62728"),
                    (result.outside, -0.4, "#1f77ff"),
                ):
                    if count:
                        axes.plot(
                            column + x,
                            row - 0.26,
                            "o",
                            ms=4,
                            color=mark,
                            mec="white",
                            mew=0.6,
                        )
    axes.imshow(image, aspect="auto", interpolation="nearest")
    axes.set_xticks(np.arange(0.5, len(regions) - 1), minor=True)
    axes.set_yticks(np.arange(0.5, len(formulas) - 1), minor=True)
    axes.grid(True, which="minor", color="white", linewidth=0.8)
    axes.tick_params(which="minor", length=0)


# --- command line --------------------------------------------------------------------------------


def write(path: Path, results: Sequence[Result], about: dict[str, Any]) -> None:
    """Everything, as JSON (infinite: null) or as CSV with one row for each formula and region."""
    rows = [asdict(r) | {"gradient_share": r.gradient_share} for r in results]
    if path.suffix == ".json":
        write_json(path, {"about": about, "results": _without_infinity(rows)})
        return
    for row in rows:
        row["worst_cos_theta"], row["worst_eta"], row["worst_k"] = row.pop("worst_at")
        ulps = row.pop("component_ulp")
        row |= {f"worst_ulp_{name}": ulps.get(name) for name in VALUES[1:]}
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())


def _without_infinity(value: Any) -> Any:
    """Infinite numbers, which JSON does not have, as None."""
    if isinstance(value, dict):
        return {name: _without_infinity(v) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [_without_infinity(v) for v in value]
    return None if value == float("inf") else value


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--region", "regions", multiple=True, type=click.Choice(list(REGIONS)), help="Only this one."
)
@click.option("--points", default=300, show_default=True, type=click.IntRange(4), help="A region.")
@click.option(
    "--hard-cases",
    type=click.Path(path_type=Path, dir_okay=False),
    help="A table of further points.  [default: none]",
)
@click.option("--variant", help="Mitsuba variant.  [default: llvm_ad_rgb where LLVM works]")
@click.option(
    "--out", multiple=True, type=click.Path(path_type=Path), help="Also write .json and .csv."
)
@click.option("--picture", type=click.Path(path_type=Path), help="Also draw the heat maps.")
@click.option(
    "--page",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Also put the short tables into this Markdown file.",
)
def stability(
    regions: tuple[str, ...],
    points: int,
    hard_cases: Path | None,
    variant: str | None,
    out: tuple[Path, ...],
    picture: Path | None,
    page: Path | None,
) -> None:
    """Errors of Fresnel formulas, ours and others', where they are hard to evaluate."""
    for path in out:
        if path.suffix not in (".json", ".csv"):
            raise click.BadParameter(f"'{path}' does not end in .json or .csv", param_hint="--out")
    if hard_cases is not None and not hard_cases.is_file():
        raise click.BadParameter(f"there is no file '{hard_cases}'", param_hint="--hard-cases")
    console = Console(stderr=True)
    if variant is None:
        usable = doctor.usable_variants()["llvm_ad_rgb"]
        variant = "llvm_ad_rgb" if usable.usable else "scalar_rgb"
        if not usable.usable:
            console.print(f"No LLVM ({usable.reason}): values only, no gradients.")
    doctor.require_variant(variant)
    chosen = regions or tuple(REGIONS)
    results: list[Result] = []
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("exact answers", total=len(chosen) * (points // 2) * 2)
        cases = collect(chosen, points, hard_cases, lambda n: progress.advance(task, n))
        task = progress.add_task("formulas", total=len(FORMULAS))
        for formula in FORMULAS:
            results += measure(formula, cases, variant)
            progress.advance(task)
    click.echo(report(results))
    if out:
        about = {
            "points": len(cases),
            "table": hard_cases.name if hard_cases else None,
            "variant": variant,
            "versions": doctor.report().versions | {"numpy": np.__version__},
            "machine": platform.machine(),
            "fresnel_decomp": __version__,
            "formulas": {f.name: f.source for f in FORMULAS},
        }
        for path in out:
            write(path, results, about)
    if picture:
        draw(results, picture)
        click.echo(f"Wrote {picture}", err=True)
    if page:
        rows = len(read(hard_cases, chosen)) if hard_cases else 0
        insert(
            page,
            f"{summary(results)}\n\n{components(results)}\n\n{origin(len(cases), rows)}",
            MARKS,
        )
        click.echo(f"Wrote {page}", err=True)


def origin(points: int, rows: int) -> str:
    """Where the points come from: `rows` of them from a table of hard cases."""
    made = f"{points - rows} points made by this script"
    return f"Of {made} and {rows} rows of a table of hard cases." if rows else f"Of {made}."


def report(results: Sequence[Result]) -> str:
    """All tables."""
    return "\n\n".join(
        (
            by_region(results, "worst absolute error of R", lambda r: short(r.worst_absolute)),
            by_region(results, "worst ulp of R", lambda r: short(r.worst_ulp)),
            by_region(
                results,
                "NaN or infinite / outside [0, 1]",
                lambda r: f"{r.not_finite} / {r.outside}" if r.not_finite or r.outside else "",
            ),
            by_region(results, "gradients off > 1 %", lambda r: share(r.gradient_share)),
            components(results),
            summary(results),
        )
    )


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run and exit: 0 done, 1 failed, 2 bad input, 130 interrupted."""
    doctor.prepare()  # before anything imports Dr.Jit
    run_and_exit(stability, arguments, "stability.py", "Interrupted; nothing was written.")


if __name__ == "__main__":
    main()

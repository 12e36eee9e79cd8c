"""The report of a comparison in words: Markdown, and the short table for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .._markdown import markdown_table

__all__ = ["markdown", "summary_rows", "times_line"]


def summary_rows(report: dict[str, Any]) -> list[list[str]]:
    """The short table: a header, then a row per material, roughness and model."""
    head = ["material", "α", "model", "max error", "RMSE", "ΔE00 curve", "ΔE00 image", "FLIP"]
    rows = [head]
    by_name = {entry["name"]: entry for entry in report["materials"]}
    for render in report["renders"]:
        for model, image in render["models"].items():
            error = by_name[render["material"]]["curve_errors"][model]
            rows.append(
                [
                    render["material"],
                    f"{render['alpha']:g}",
                    model,
                    f"{error['max']:.4f}",
                    f"{error['rmse']:.4f}",
                    f"{error['delta_e_mean']:.2f}",
                    f"{image['delta_e']:.2f}",
                    f"{image['flip']:.4f}",
                ]
            )
    return rows


def times_line(report: dict[str, Any]) -> str:
    """How long whole renders take, relative to the exact model."""
    times = report["times"]
    ratios = ", ".join(
        f"{name} {row['ratio_to_exact']:.2f} ± {row['spread']:.2f}"
        for name, row in times["models"].items()
        if name != "exact"
    )
    return f"Render time relative to exact ({times['clock']} time): {ratios}"


def markdown(report: dict[str, Any]) -> str:
    """`report.md`: the report in words and tables."""
    settings, times = report["settings"], report["times"]
    lines = [
        "# Fresnel models compared",
        "",
        f"`{report['command']}`" if report["command"] else "",
        "",
        f"Basis `{settings['recipe']}` with {settings['terms']} terms, nodes at "
        f"{', '.join(f'{node:.4f}' for node in report['basis']['nodes_rad'])} rad. "
        f"Rendered with `{settings['variant']}`, {settings['size']} × {settings['size']} pixels, "
        f"{settings['spp']} samples per pixel, seed {settings['seed']}; the reference is path "
        "traced with the exact Fresnel equations, and all models share its indices, paths and "
        "samples.",
        "",
        _table(summary_rows(report)),
        "",
        "Errors of curves are of the reflectance over all angles and channels (RMSE uniform in the "
        "cosine), ΔE00 curve is the mean over the angles 0–89° under D65; ΔE00 image and FLIP are "
        "means over the pixels.",
        "",
        "![curves](curves.png)",
        "",
        "![renders](renders.png)",
        "",
        "## Coefficients",
        "",
    ]
    for entry in report["materials"]:
        lines += [f"### {entry['name']}", "", _table(_coefficient_rows(entry)), ""]
        if "spectral" in entry:
            spectral = entry["spectral"]
            lines += [
                f"From the spectrum under {spectral['illuminant']}, against which they err by "
                f"ΔE00 {spectral['delta_e_mean']:.3f} on average and {spectral['delta_e_max']:.3f} "
                "at most:",
                "",
                _table(_coefficient_rows(spectral)),
                "",
                f"Data: {entry['source']}.",
                "",
            ]
        head = ["model", "max", "mean", "RMSE", "ΔE00 mean", "ΔE00 max"]
        errors = [
            [name, *(f"{value:.2g}" for value in error.values())]
            for name, error in entry["curve_errors"].items()
        ]
        lines += [_table([head, *errors]), ""]
    lines += [
        "## Times",
        "",
        f"{times['what'][0].upper()}{times['what'][1:]}; {times['clock']} time, "
        f"{times['threads']} threads, median of {times['runs']} warm, interleaved rounds; ratios "
        "are medians over rounds, ± half the distance between quartiles.",
        "",
        _table(
            [
                ["model", "median (ms)", "range (ms)", "ratio to exact"],
                *(
                    [
                        name,
                        f"{row['median_ms']:.1f}",
                        f"{row['min_ms']:.1f}–{row['max_ms']:.1f}",
                        f"{row['ratio_to_exact']:.3f} ± {row['spread']:.3f}",
                    ]
                    for name, row in times["models"].items()
                ),
            ]
        ),
        "",
        "## Versions",
        "",
        ", ".join(f"{name} {version}" for name, version in report["versions"].items())
        + f"; finished {report['finished']}.",
    ]
    return "\n".join(lines) + "\n"


def _coefficient_rows(entry: dict[str, Any]) -> list[list[str]]:
    table = entry["coefficients_rgb"]
    rows = [["channel", *(f"c{i}" for i in range(len(table[0])))]]
    for i, channel in enumerate("RGB"):
        rows.append([channel, *(f"{value:.6f}" for value in table[i])])
    if "eta_rgb" in entry:
        rows[0] += ["η", "k"]
        for i, row in enumerate(rows[1:]):
            row += [f"{entry['eta_rgb'][i]:.5g}", f"{entry['k_rgb'][i]:.5g}"]
    return rows


def _table(rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table whose first row is the header."""
    return markdown_table(rows[0], rows[1:])

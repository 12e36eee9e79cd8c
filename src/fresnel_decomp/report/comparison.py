"""The main job: curves, renders and errors of Fresnel models for given materials, in one folder.

`run` computes and writes everything; `summary_rows` and `markdown` say it in words. All outputs
are written whole, and images that an interrupted run had finished are used by the next one.
"""

from __future__ import annotations

import datetime
import os
import platform
import shlex
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .. import doctor
from .._check import choose, input_error
from .._files import writable_folder, write_json, write_text
from .._version import __version__
from ..basis import Basis, load_basis
from ..colour import delta_e_2000
from ..mitsuba.comparison import Timing, kernel_times, model_bsdfs, render_bsdfs
from ..mitsuba.scenes import SCENES
from ..subjects import Subject
from .curves import curve_errors, draw_curves
from .images import RenderRow, draw_renders

__all__ = [
    "RENDER_MODELS",
    "TIMED_MODELS",
    "Settings",
    "default_folder",
    "markdown",
    "run",
    "summary_rows",
]

RENDER_MODELS = ("exact", "decomposition", "schlick")
TIMED_MODELS = ("exact", "decomposition", "schlick", "f82")

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Settings:
    """What `run` compares, and how.

    Attributes
    ----------
    subjects : the materials
    alphas : roughnesses in (0, 1]
    recipe, terms : the basis
    variant : a Mitsuba variant that works here, with colour; default `doctor.best_variant()`
    size, spp : pixels along each side, samples per pixel; by default what the variant renders in
        seconds (256 and 64, in scalar variants 64 and 16)
    seed : of the sampler
    scene : "studio" or "shader-ball"
    """

    subjects: Sequence[Subject]
    alphas: Sequence[float] = (0.1,)
    recipe: str = "talk"
    terms: int = 4
    variant: str = field(default_factory=doctor.best_variant)
    size: int | None = None
    spp: int | None = None
    seed: int = 0
    scene: str = "studio"

    def resolution(self) -> tuple[int, int]:
        """(size, spp) with the defaults filled in."""
        size, spp = (64, 16) if self.variant.startswith("scalar") else (256, 64)
        return self.size or size, self.spp or spp

    def check(self) -> Basis:
        """The basis, if everything can be run.

        Raises
        ------
        InputError
            For settings out of range, variants that cannot run here or have no colour, and indices
            that the decomposition cannot represent.
        """
        basis = load_basis(self.recipe, self.terms)
        if not self.subjects:
            raise input_error("no material", "at least one", "For example: Be")
        for alpha in self.alphas:
            if not 0.0 < alpha <= 1.0:
                raise input_error(f"alpha={alpha:g}", "a roughness in (0, 1]", "Try 0.1.")
        for name, value in (("size", self.size), ("spp", self.spp)):
            if value is not None and not 1 <= value <= 65536:
                raise input_error(f"{name}={value}", "an integer in 1..65536", "Leave it out.")
        if not 0 <= self.seed < 2**32:
            raise input_error(f"seed={self.seed}", "an integer in 0..2^32 - 1", "Leave it out.")
        choose("scene", self.scene, SCENES)
        doctor.require_variant(self.variant)
        if "mono" in self.variant:
            raise input_error(
                f"variant '{self.variant}' has no colour", "RGB and spectral variants",
                f"Try --variant {doctor.best_variant()}.",
            )  # fmt: skip
        for subject in self.subjects:
            basis.coefficients(subject.eta, subject.k)
            if "spectral" in self.variant and subject.material is None and not subject.grey:
                raise input_error(
                    f"RGB indices ({subject.label}) with variant '{self.variant}'",
                    "measured spectra and grey indices in spectral variants",
                    "Choose an RGB variant, or give a file of wavelength, n, k.",
                )
        return basis


def run(
    settings: Settings,
    folder: str | os.PathLike[str],
    command: Sequence[str] = (),
    progress: Progress = lambda stage, fraction: None,
) -> dict[str, Any]:
    """Compare the models and write `curves.png`, `renders.png`, EXR images and the reports.

    Parameters
    ----------
    settings : Settings
    folder : path, created if needed
    command : the command line, for the report
    progress : called with the stage and the fraction of all work that is done

    Returns
    -------
    dict
        What is in `report.json`.

    Raises
    ------
    InputError
        Before anything is written, as `Settings.check`, and for a folder without write permission.
    """
    basis = settings.check()
    target = writable_folder(folder)
    size, spp = settings.resolution()
    jobs = [(subject, alpha) for subject in settings.subjects for alpha in settings.alphas]
    progress("curves", 0.0)
    errors = {subject.name: curve_errors(subject, basis) for subject in settings.subjects}
    draw_curves(settings.subjects, basis, target / "curves.png")

    steps = len(jobs) * len(RENDER_MODELS)
    rows = []
    for number, (subject, alpha) in enumerate(jobs):

        def rendering(model: str, fraction: float, done: int = number * len(RENDER_MODELS)) -> None:
            step = done + RENDER_MODELS.index(model) + fraction
            progress(f"rendering {model}", 0.05 + 0.65 * step / steps)

        images = render_bsdfs(
            _bsdfs(settings, subject, alpha, RENDER_MODELS),
            scene=settings.scene,
            size=size,
            spp=spp,
            seed=settings.seed,
            variant=settings.variant,
            folder=target,
            stem=f"{subject.name}_alpha{alpha:g}",
            progress=rendering,
        )
        rows.append(RenderRow.compute(f"{subject.label}, α = {alpha:g}", images))
    progress("drawing", 0.7)
    draw_renders(rows, target / "renders.png")

    progress("timing", 0.75)
    subject, alpha = jobs[0]
    times = kernel_times(
        _bsdfs(settings, subject, alpha, TIMED_MODELS),
        scene=settings.scene,
        size=size,
        spp=min(spp, 4 if settings.variant.startswith("scalar") else 16),
        seed=settings.seed,
        variant=settings.variant,
    )
    progress("reporting", 0.98)
    report = {
        "command": shlex.join(command),
        "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "settings": {
            "recipe": settings.recipe,
            "terms": settings.terms,
            "variant": settings.variant,
            "alphas": list(settings.alphas),
            "size": size,
            "spp": spp,
            "seed": settings.seed,
            "scene": settings.scene,
        },
        "versions": _versions(),
        "basis": {
            "nodes_rad": basis.nodes.tolist(),
            "condition": basis.condition,
            "closed_form_error": basis.closed_form.error,
            "provenance": basis.provenance,
        },
        "materials": [
            _material(subject, basis, errors[subject.name]) for subject in settings.subjects
        ],
        "renders": [
            {
                "material": subject.name,
                "alpha": alpha,
                "reference": "exact",
                "models": {name: d.summary() for name, d in row.differences.items()},
            }
            for (subject, alpha), row in zip(jobs, rows, strict=True)
        ],
        "times": _times(times, jobs[0], size),
    }
    write_json(target / "report.json", report)
    write_text(target / "report.md", markdown(report))
    progress("done", 1.0)
    return report


def _bsdfs(
    settings: Settings, subject: Subject, alpha: float, models: Sequence[str]
) -> dict[str, dict[str, Any]]:
    options: dict[str, Any] = {
        "alpha": alpha,
        "recipe": settings.recipe,
        "terms": settings.terms,
    }
    material = subject.material
    if material is not None and "spectral" in settings.variant:
        options["wavelength_nm"] = material.wavelength_nm
        return model_bsdfs(material.eta, material.k, models, **options)
    if subject.grey:
        return model_bsdfs(subject.eta[0], subject.k[0], models, **options)
    return model_bsdfs(subject.eta, subject.k, models, **options)


def _material(subject: Subject, basis: Basis, errors: dict[str, Any]) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "name": subject.name,
        "eta_rgb": subject.eta.tolist(),
        "k_rgb": subject.k.tolist(),
        "coefficients_rgb": basis.coefficients(subject.eta, subject.k).tolist(),
        "curve_errors": {name: asdict(error) for name, error in errors.items()},
    }
    material = subject.material
    if material is None:
        return entry
    cos_theta = np.cos(np.radians(np.arange(0.0, 89.5, 0.5)))
    truth = material.rgb_reflectance(cos_theta)
    spectral = material.rgb_coefficients(basis)
    delta_e = delta_e_2000(basis.evaluate(spectral, cos_theta[:, None]), truth)
    entry["source"] = material.source
    entry["spectral"] = {
        "illuminant": "D65",
        "coefficients_rgb": spectral.tolist(),
        "delta_e_mean": float(np.mean(delta_e)),
        "delta_e_max": float(np.max(delta_e)),
    }
    return entry


def _times(times: dict[str, Timing], job: tuple[Subject, float], size: int) -> dict[str, Any]:
    reference = times["exact"].median_ms
    first = times["exact"]
    return {
        "what": f"whole renders of {job[0].name} at alpha {job[1]:g}, {size} x {size} pixels",
        "clock": first.clock,
        "threads": first.threads,
        "runs": len(first.runs_ms),
        "models": {
            name: {
                "median_ms": timing.median_ms,
                "min_ms": min(timing.runs_ms),
                "max_ms": max(timing.runs_ms),
                "ratio_to_exact": timing.median_ms / reference,
            }
            for name, timing in times.items()
        },
    }


def _versions() -> dict[str, str]:
    import drjit
    import mitsuba

    llvm = doctor.prepare()
    return {
        "fresnel_decomp": __version__,
        "mitsuba": mitsuba.__version__,
        "drjit": drjit.__version__,
        "llvm": ".".join(map(str, llvm.version or ())) or "none",
        "numpy": np.__version__,
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
    }


def summary_rows(report: dict[str, Any]) -> list[list[str]]:
    """The short table: a header, then a row per material, roughness and model."""
    head = [
        "material",
        "α",
        "model",
        "max error",
        "RMSE",
        "ΔE00 curve",
        "ΔE00 image",
        "FLIP",
        "time",
    ]
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
                    f"{report['times']['models'][model]['ratio_to_exact']:.2f}×",
                ]
            )
    return rows


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
        *_table(summary_rows(report)),
        "",
        "Errors of curves are of the reflectance over all angles and channels (RMSE uniform in the "
        "cosine), ΔE00 curve is the mean over the angles 0–89° under D65; ΔE00 image and FLIP are "
        "means over the pixels. Times are ratios to the exact model.",
        "",
        "![curves](curves.png)",
        "",
        "![renders](renders.png)",
        "",
        "## Coefficients",
        "",
    ]
    for entry in report["materials"]:
        lines += [f"### {entry['name']}", "", *_table(_coefficient_rows(entry)), ""]
        if "spectral" in entry:
            spectral = entry["spectral"]
            lines += [
                f"From the spectrum under {spectral['illuminant']}, against which they err by "
                f"ΔE00 {spectral['delta_e_mean']:.3f} on average and {spectral['delta_e_max']:.3f} "
                "at most:",
                "",
                *_table(_coefficient_rows(spectral)),
                "",
                f"Data: {entry['source']}.",
                "",
            ]
        head = ["model", "max", "mean", "RMSE", "ΔE00 mean", "ΔE00 max"]
        errors = [
            [name, *(f"{value:.2g}" for value in error.values())]
            for name, error in entry["curve_errors"].items()
        ]
        lines += [*_table([head, *errors]), ""]
    lines += [
        "## Times",
        "",
        f"{times['what'][0].upper()}{times['what'][1:]}; {times['clock']} time, "
        f"{times['threads']} threads, median of {times['runs']} warm, interleaved runs.",
        "",
        *_table(
            [
                ["model", "median (ms)", "range (ms)", "ratio to exact"],
                *(
                    [
                        name,
                        f"{row['median_ms']:.1f}",
                        f"{row['min_ms']:.1f}–{row['max_ms']:.1f}",
                        f"{row['ratio_to_exact']:.3f}",
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


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Markdown lines of a table whose first row is the header."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    lines.insert(1, "|" + " --- |" * len(rows[0]))
    return lines


def default_folder(subjects: Sequence[Subject]) -> Path:
    """Where results go if no folder is named."""
    return Path("out") / "+".join(subject.name for subject in subjects[:4])

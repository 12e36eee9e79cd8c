"""The main job: curves, renders and errors of Fresnel models for given materials, in one folder.

`run` computes and writes everything; `comparison_words` says it in words. All outputs are written
whole, and images that an interrupted run had finished are used by the next one.
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
from ..colour import WAVELENGTH_NM, delta_e_2000
from ..mitsuba.comparison import MODELS, model_bsdfs, render_bsdfs
from ..mitsuba.scenes import SCENES
from ..mitsuba.timing import Timing, kernel_times
from ..subjects import Subject
from .comparison_words import markdown
from .curves import COLOUR_COSINES, curve_errors, draw_curves
from .renders import RenderRow, draw_renders

__all__ = [
    "TIMED_MODELS",
    "Settings",
    "default_folder",
    "run",
]

TIMED_MODELS = (*MODELS, "f82")

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Settings:
    """What `run` compares, and how.

    Attributes
    ----------
    subjects : the materials
    alphas : roughnesses in (0, 1]
    recipe, terms : the basis, see `load_basis`
    variant : a Mitsuba variant that works here, with colour; default `doctor.best_variant()`
    size, spp : pixels along each side, samples per pixel; by default what the variant renders in
        seconds (256 and 64, in scalar variants 64 and 16)
    seed : of the sampler
    scene : "studio" or "shader-ball"
    """

    subjects: Sequence[Subject]
    alphas: Sequence[float] = (0.1,)
    recipe: str = "talk"
    terms: int | None = None
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
        names = [subject.name for subject in self.subjects]
        if len(set(names)) < len(names):
            raise input_error(
                f"two materials of one name among {', '.join(names)}",
                "different names, which files are called by",
                "Rename one of the files, or compare them one after the other.",
            )
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
            if "spectral" not in self.variant:
                continue
            if subject.material is not None:  # every nanometre that Mitsuba may sample
                basis.coefficients(*subject.material.at(WAVELENGTH_NM))
            elif not subject.grey:
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

    steps = len(jobs) * len(MODELS)
    rows = []
    for number, (subject, alpha) in enumerate(jobs):

        def rendering(model: str, fraction: float, done: int = number * len(MODELS)) -> None:
            step = done + MODELS.index(model) + fraction
            progress(f"rendering {model}", 0.05 + 0.57 * step / steps)

        images = render_bsdfs(
            _bsdfs(settings, subject, alpha, MODELS),
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
    progress("drawing", 0.62)
    draw_renders(rows, target / "renders.png")

    progress("timing", 0.7)
    subject, alpha = jobs[0]
    scalar = settings.variant.startswith("scalar")
    times = kernel_times(
        _bsdfs(settings, subject, alpha, TIMED_MODELS),
        scene=settings.scene,
        size=min(size, 32 if scalar else 128),
        spp=4 if scalar else 16,
        seed=settings.seed,
        variant=settings.variant,
        progress=lambda fraction: progress("timing", 0.7 + 0.28 * fraction),
    )
    progress("reporting", 0.98)
    report = {
        "command": shlex.join(command),
        "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "settings": {
            "recipe": settings.recipe,
            "terms": basis.terms,
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
            "provenance": dict(basis.provenance),
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
        "times": _times(times, subject, alpha),
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
    truth = material.rgb_reflectance(COLOUR_COSINES)
    spectral = material.rgb_coefficients(basis)
    delta_e = delta_e_2000(basis.evaluate(spectral, COLOUR_COSINES[:, None]), truth)
    entry["source"] = material.source
    entry["spectral"] = {
        "illuminant": "D65",
        "coefficients_rgb": spectral.tolist(),
        "delta_e_mean": float(np.mean(delta_e)),
        "delta_e_max": float(np.max(delta_e)),
    }
    return entry


def _times(times: dict[str, Timing], subject: Subject, alpha: float) -> dict[str, Any]:
    first = times["exact"]
    return {
        "what": f"whole renders of {subject.name} at alpha {alpha:g}",
        "clock": first.clock,
        "threads": first.threads,
        "runs": len(first.runs_ms),
        "models": {
            name: {
                "median_ms": timing.median_ms,
                "min_ms": min(timing.runs_ms),
                "max_ms": max(timing.runs_ms),
                "ratio_to_exact": timing.ratio,
                "spread": timing.spread,
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


def default_folder(subjects: Sequence[Subject]) -> Path:
    """Where results go if no folder is named."""
    return Path("out") / "+".join(subject.name for subject in subjects[:4])

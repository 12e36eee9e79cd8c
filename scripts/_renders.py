"""Renders and curves that the figures compare: exact, decomposition, Schlick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from _figure import Job, read_sidecar, write_table
from fresnel_decomp.images import read_exr, write_exr
from fresnel_decomp.models import model_from_ior
from fresnel_decomp.report.renders import RenderRow
from fresnel_decomp.subjects import Subject

MODELS = ("exact", "decomposition", "schlick")
CHANNELS = "RGB"


@dataclass(frozen=True)
class Case:
    """One material at one roughness."""

    stem: str
    """Of its files."""
    subject: Subject
    alpha: float


@dataclass(frozen=True)
class Rendered:
    """What is read back of a `Case`."""

    images: dict[str, np.ndarray]
    """Linear RGB by model."""
    flip_maps: dict[str, np.ndarray]
    """FLIP per pixel by model, the reference left out."""
    numbers: dict[str, dict[str, float]]
    """Mean `flip`, mean `delta_e`, `rmse` and `nrmse` by model."""


def render_cases(job: Job, cases: Sequence[Case]) -> dict[str, dict[str, dict[str, float]]]:
    """Render each case with each model and compare with the exact one.

    Images are written as they are finished, and used again by the next run.

    Returns
    -------
    dict
        The `numbers` of `Rendered`, by the case's stem.
    """
    from fresnel_decomp.mitsuba.comparison import render_models  # imports the renderer

    options = {name: job.settings[name] for name in ("scene", "size", "spp", "seed", "variant")}
    numbers = {}
    for index, case in enumerate(cases):

        def report(model: str, fraction: float, case: Case = case, index: int = index) -> None:
            done = index + (MODELS.index(model) + fraction) / len(MODELS)
            job.report(f"{case.subject.name}, α {case.alpha:g}, {model}"[:26], done / len(cases))

        images = render_models(
            case.subject.eta,
            case.subject.k,
            MODELS,
            alpha=case.alpha,
            recipe=job.settings["basis"]["recipe"],
            terms=job.settings["basis"]["terms"],
            folder=job.folder,
            stem=case.stem,
            progress=report,
            **options,
        )
        differences = RenderRow.compute(case.stem, images).differences
        for model, difference in differences.items():
            write_exr(job.folder / f"{case.stem}_{model}_flip.exr", difference.flip_map)
        numbers[case.stem] = {model: d.summary() for model, d in differences.items()}
    return numbers


def read_case(name: str, folder: Path, stem: str) -> Rendered:
    """Read what `render_cases` wrote for one case of the figure called `name`."""
    numbers = read_sidecar(name, folder)["results"]["renders"][stem]
    return Rendered(
        {model: read_exr(folder / f"{stem}_{model}.exr") for model in MODELS},
        {model: read_exr(folder / f"{stem}_{model}_flip.exr")[..., 0] for model in MODELS[1:]},
        numbers,
    )


def write_curves(path: Path, subject: Subject) -> dict[str, float]:
    """Write the reflectance of each channel by each model every .1°; return maximum errors."""
    degrees = np.linspace(0.0, 90.0, 901)
    cos_theta = np.clip(np.cos(np.radians(degrees)), 0.0, 1.0)[:, None]
    values = {m: model_from_ior(m, subject.eta, subject.k)(cos_theta) for m in MODELS}
    columns = {"theta_deg": degrees}
    for model, curves in values.items():
        columns |= {f"{model}_{c}": curves[:, i] for i, c in enumerate(CHANNELS)}
    write_table(path, columns)
    return {m: float(np.abs(values[m] - values["exact"]).max()) for m in MODELS[1:]}

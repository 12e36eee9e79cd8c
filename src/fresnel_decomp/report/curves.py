"""Errors of Fresnel models against the exact curve, per material and channel, and their figure."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..basis import Basis
from ..colour import delta_e_2000
from ..curves import error_cosines
from ..fresnel import conductor
from ..models import model_from_ior
from ..subjects import Subject
from . import style

__all__ = ["COLOUR_COSINES", "CURVE_MODELS", "CurveErrors", "curve_errors", "draw_curves"]

CURVE_MODELS = ("decomposition", "schlick", "f82")

COLOUR_COSINES = np.cos(np.radians(np.arange(0.0, 89.5, 0.5)))
"""Where colours are compared: every half degree, but for 90 degrees, where all are white."""

_RESIDUAL_LINEAR = 1e-3  # residual panels are linear up to here and logarithmic beyond


@dataclass(frozen=True)
class CurveErrors:
    """Error of one model against the exact curves of a material's three channels.

    `max`, `mean` and `rmse` are of the reflectance, over `curves.error_cosines` and all channels;
    `delta_e_mean` and `delta_e_max` of its colour under D65, over the angles 0..89 degrees.
    """

    max: float
    mean: float
    rmse: float
    delta_e_mean: float
    delta_e_max: float


def curve_errors(
    subject: Subject, basis: Basis, models: Sequence[str] = CURVE_MODELS
) -> dict[str, CurveErrors]:
    """Errors of the models, fitted to the subject's indices, by name."""
    everywhere, uniform = error_cosines()
    by_angle = COLOUR_COSINES[:, None]
    exact = conductor(everywhere[:, None], subject.eta, subject.k)
    exact_colour = conductor(by_angle, subject.eta, subject.k)
    errors = {}
    for name in models:
        model = model_from_ior(name, subject.eta, subject.k, basis)
        error = np.abs(model(everywhere[:, None]) - exact)
        on_uniform = error[: len(uniform)]
        delta_e = delta_e_2000(model(by_angle), exact_colour)
        errors[name] = CurveErrors(
            float(error.max()),
            float(on_uniform.mean()),
            float(np.sqrt((on_uniform**2).mean())),
            float(np.mean(delta_e)),
            float(np.max(delta_e)),
        )
    return errors


def draw_curves(
    subjects: Sequence[Subject],
    basis: Basis,
    path: str | os.PathLike[str],
    models: Sequence[str] = CURVE_MODELS,
) -> None:
    """Write a figure: a row per material, a column per channel, residuals under each.

    Residual axes are linear within ±1e-3 and logarithmic beyond, so that an error of 1e-3 and one
    of .1 can both be read. Dotted lines are nodes of the basis, where its curve is exact.
    """
    degrees = np.linspace(0.0, 90.0, 901)
    cos_theta = np.clip(np.cos(np.radians(degrees)), 0.0, 1.0)[:, None]
    with style.styled():
        fig = style.figure(9.6, 0.75 + 3.55 * len(subjects))
        rows = fig.add_gridspec(
            len(subjects), 3, left=0.1, right=0.985, hspace=0.26, wspace=0.16,
            top=1 - 0.62 / fig.get_figheight(), bottom=0.48 / fig.get_figheight(),
        )  # fmt: skip
        for row, subject in enumerate(subjects):
            exact = conductor(cos_theta, subject.eta, subject.k)
            fits = {m: model_from_ior(m, subject.eta, subject.k, basis)(cos_theta) for m in models}
            largest = max(float(np.abs(fit - exact).max()) for fit in fits.values())
            for channel, colour in enumerate(style.CHANNEL_COLOURS):
                cell = rows[row, channel].subgridspec(2, 1, height_ratios=(1.7, 1), hspace=0.06)
                above = fig.add_subplot(cell[0])
                below = fig.add_subplot(cell[1], sharex=above)
                above.plot(degrees, exact[:, channel], **_line("exact", 2.2))
                for name, fit in fits.items():
                    above.plot(degrees, fit[:, channel], **_line(name, 1.3))
                    below.plot(degrees, (fit - exact)[:, channel], **_line(name, 1.3))
                _finish(above, below, basis, largest)
                eta, k = subject.eta[channel], subject.k[channel]
                above.set_title(
                    f"{colour}   $\\eta$ = {eta:.4g}, $k$ = {k:.4g}",
                    color=style.CHANNEL_COLOURS[colour],
                )
                if channel == 0:
                    above.set_ylabel("reflectance")
                    below.set_ylabel("model − exact")
                    below.yaxis.set_label_coords(-0.19, 0.5)
                    above.yaxis.set_label_coords(-0.19, 0.5)
                    middle = rows[row, 0].get_position(fig)
                    fig.text(
                        0.014, (middle.y0 + middle.y1) / 2, subject.label,
                        rotation=90, ha="center", va="center", size=11,
                    )  # fmt: skip
                else:
                    below.tick_params(labelleft=False)
                if row == len(subjects) - 1:
                    below.set_xlabel("angle of incidence (degrees)")
        handles, labels = fig.axes[0].get_legend_handles_labels()
        fig.legend(
            handles,
            labels,
            loc="upper center",
            ncols=len(labels),
            frameon=False,
            bbox_to_anchor=(0.5, 1.0),
        )
        style.save(fig, path, dpi=150)


def _line(model: str, width: float) -> dict[str, Any]:
    return {
        "color": style.MODEL_COLOURS[model],
        "ls": style.MODEL_LINES[model],
        "lw": width,
        "label": style.MODEL_LABELS[model],
    }


def _finish(above: Any, below: Any, basis: Basis, largest: float) -> None:
    above.tick_params(labelbottom=False)
    above.set_xlim(0.0, 90.0)
    above.set_xticks(range(0, 91, 15))
    low = min(float(np.min(line.get_ydata())) for line in above.lines)
    above.set_ylim(low - 0.08 * (1.0 - low) - 1e-3, 1.0 + 0.06 * (1.0 - low) + 1e-3)
    below.set_yscale("symlog", linthresh=_RESIDUAL_LINEAR, linscale=1.0)
    limit = max(1.4 * largest, 2e-3)
    decades = [10.0**e for e in range(-3, 1) if 10.0**e <= limit]
    below.set_ylim(-limit, limit)
    below.set_yticks([-d for d in decades[::-1]] + [0.0] + decades)
    below.set_yticklabels(
        [f"−$10^{{{round(np.log10(d))}}}$" for d in decades[::-1]]
        + ["0"]
        + [f"$10^{{{round(np.log10(d))}}}$" for d in decades]
    )
    below.minorticks_off()
    below.axhspan(-_RESIDUAL_LINEAR, _RESIDUAL_LINEAR, color="#f1f1f1", lw=0)
    for node in np.degrees(basis.nodes):
        below.axvline(node, color="#808080", lw=0.9, ls=":", zorder=0)

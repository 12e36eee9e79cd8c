"""How near linearly transformed cosines are to GGX under lights of all places and sizes.

    python scripts/ltc_accuracy.py                                # the table that ships
    python scripts/ltc_accuracy.py --page docs/area_lights.md
    python scripts/ltc_accuracy.py --published RectAreaLightUniformsLib.js

RMS error of the light that a white surface reflects, over its mean, for 600 squares whose centres
are uniform over the elevation and whose half openings are uniform from 5° to 50°. Lights and lobe
are sums over the same directions. --published also measures matrices that others have fitted, from
the file in which three.js keeps them (`npm pack three@0.160.0`, examples/jsm/lights); these are for
correlated Smith, and are compared with our own fit to that.
"""

from __future__ import annotations

import re
from pathlib import Path

import click
import numpy as np

from _command_line import main, page_option, script
from _markdown import insert, markdown, marks
from fresnel_decomp._check import input_error
from fresnel_decomp.ltc import Lobe, load_lobes
from fresnel_decomp.ltc_fit import Samples, fit_column, lobe_samples

MARKS = marks("ltc accuracy")
ROUGHNESSES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
COSINES = (0.9, 0.7, 0.5, 0.3, 0.15)
LIGHTS = 600


def whole(samples: Samples) -> Samples:
    """With the mirrored directions."""
    direction = np.concatenate(
        [samples.direction, samples.direction * [[1.0], [-1.0], [1.0]]], axis=1
    )
    weight = 0.5 * np.tile(samples.weight, 2)
    return Samples(direction, np.tile(samples.lobe, 2), weight, samples.albedo)


def squares(direction: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """(LIGHTS, n) truth values: which directions see which light."""
    seen = []
    for _ in range(LIGHTS):
        z, turn = random.random(), 2.0 * np.pi * random.random()
        radius = np.sqrt(1.0 - z * z)
        towards = np.array([radius * np.cos(turn), radius * np.sin(turn), z])
        size = np.tan(np.radians(random.uniform(5.0, 50.0)))
        side = np.cross(towards, random.normal(size=3))
        side /= np.linalg.norm(side)
        depth = towards @ direction
        far = np.maximum(np.abs(side @ direction), np.abs(np.cross(towards, side) @ direction))
        seen.append((depth > 0.0) & (far < size * depth))
    return np.array(seen)


def error(samples: Samples, lights: np.ndarray, lobe: np.ndarray) -> float:
    """RMS error over the mean; `lobe` includes its albedo."""
    exact = lights @ (samples.weight * samples.lobe * samples.albedo)
    found = lights @ (samples.weight * lobe)
    return float(np.sqrt(np.mean((found - exact) ** 2)) / exact.mean())


def wrong_share(samples: Samples, lobe: np.ndarray) -> float:
    """Half the integral of |f - D| over that of f, whatever the light: what other reports average;
    `lobe` includes its albedo."""
    exact = samples.lobe * samples.albedo
    return float(0.5 * samples.weight @ np.abs(exact - lobe) / samples.albedo)


def read_published(path: Path) -> list[np.ndarray]:
    """Both textures of three.js, (64, 64, 4): inverse matrices, and amplitudes in channel 0."""
    text = path.read_text(encoding="utf-8")
    textures = []
    for name in ("LTC_MAT_1", "LTC_MAT_2"):
        found = re.search(rf"{name}\s*=\s*\[(.*?)\]", text, re.S)
        if found is None:
            raise input_error(f"'{path}' without {name}", "the file of three.js", "See --help.")
        numbers = re.sub(r"\s", "", found.group(1)).split(",")
        textures.append(np.array([float(n) for n in numbers if n]).reshape(64, 64, 4))
    return textures


def published_lobe(textures: list[np.ndarray], mu: float, roughness: float, w: tuple) -> np.ndarray:
    """Albedo times density; cut off at the horizon, what lies below is not given back above."""
    x, y = 63.0 * roughness, 63.0 * np.sqrt(1.0 - mu)
    i, j = min(int(x), 62), min(int(y), 62)
    x, y = x - i, y - j
    (a, b, c, d), (albedo, *_) = (
        (t[j, i] * (1 - x) + t[j, i + 1] * x) * (1 - y)
        + (t[j + 1, i] * (1 - x) + t[j + 1, i + 1] * x) * y
        for t in textures
    )
    lobe = Lobe((a, c, 1.0, b, d))
    return albedo * lobe.density(w) * lobe.above


def fitted(mu: float, roughness: float) -> Lobe:
    """Our own fit to correlated Smith, from rough to smooth."""
    alphas = np.linspace(roughness, 1.0, 17) ** 2
    return Lobe.from_residual(mu, roughness**2, fit_column(mu, alphas, "correlated")[0].residual)


def measure(
    smith: str, published: Path | None
) -> tuple[list[list[str]], list[float], list[float], list[float]]:
    """A row of percentages per roughness, and three means; ours | published if there is a file.

    The means: over all cells, over those of mu >= .5, and over all cells of `wrong_share`.
    """
    textures = None if published is None else read_published(published)
    rows, everything, steep, wrong = [], [], [], []
    for roughness in ROUGHNESSES:
        cells = []
        for mu in COSINES:
            random = np.random.default_rng(0)
            samples = whole(lobe_samples(mu, roughness**2, smith, 8192))  # type: ignore[arg-type]
            lights = squares(samples.direction, random)
            w = tuple(samples.direction)
            lobe = (
                load_lobes().lobe(mu, roughness**2) if textures is None else fitted(mu, roughness)
            )
            candidates = [samples.albedo * lobe.density(w)]
            if textures is not None:
                candidates.append(published_lobe(textures, mu, roughness, w))
            found = [error(samples, lights, values) for values in candidates]
            everything.append(found)
            wrong.append([wrong_share(samples, values) for values in candidates])
            if mu >= 0.5:
                steep.append(found)
            cells.append(" / ".join(f"{100.0 * value:.1f}" for value in found))
        rows.append([f"{roughness:g}", *cells])
    return rows, *(np.mean(values, axis=0).tolist() for values in (everything, steep, wrong))


@script()
@click.option(
    "--published",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="RectAreaLightUniformsLib.js of three.js.",
)
@page_option(MARKS)
def accuracy(published: Path | None, page: Path | None) -> None:
    """How near linearly transformed cosines are to GGX under lights of all places and sizes."""
    head = ["perceptual roughness", *(f"μ = {mu:g}" for mu in COSINES)]
    parts = []
    for smith, others in (("separable", None), ("correlated", published)):
        if smith == "correlated" and others is None:
            continue
        rows, *means = measure(smith, others)
        parts.append(markdown([f"error in %, {smith} Smith", *head[1:]], rows))
        mean, steep, wrong = (
            " / ".join(f"{100.0 * value:.1f}" for value in values) for values in means
        )
        parts.append(
            f"Mean: {mean} %{' (ours / published)' if others else ''}; of μ ≥ 0.5: {steep} %; "
            f"mean share of light that goes the wrong way, half the integral of |f − D|: {wrong} %."
        )
    text = "\n\n".join(parts)
    click.echo(text)
    if page:
        insert(page, text, MARKS)


if __name__ == "__main__":
    main(accuracy)

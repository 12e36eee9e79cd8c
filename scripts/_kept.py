"""What an interrupted figure has finished: kept in its folder, and read by the next run.

Tables and numbers are those of the folder's settings, since `_figure.compute` removes them when
these change. Images take long: they say in their headers what they were made from, so that those
of a study survive a change that does not concern them.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from _figure import Job, read_table, write_table
from fresnel_decomp._files import write_json
from fresnel_decomp.images import read_exr, read_exr_attributes, write_exr

_MADE_FROM = "madeFrom"  # attribute of the EXR files


class Scene(Protocol):
    """What a study renders; its files begin with the stem."""

    @property
    def stem(self) -> str: ...


def image(job: Job, stem: str, make: Callable[[], np.ndarray], **what: Any) -> np.ndarray:
    """The image called `stem`, read if it was made from the same settings and `what`, else made."""
    path = job.folder / f"{stem}.exr"
    settings = {k: v for k, v in job.settings.items() if k not in ("parameters", "scene")}
    text = json.dumps(settings | what, sort_keys=True)
    with contextlib.suppress(ValueError):  # not an EXR file: make it anew
        if path.is_file() and read_exr_attributes(path).get(_MADE_FROM) == text:
            return read_exr(path)
    write_exr(path, make(), {_MADE_FROM: text})
    return read_exr(path)


def image_of(folder: Path, scene: Scene, name: str) -> np.ndarray:
    """An image of a finished study, linear."""
    return read_exr(folder / f"{scene.stem}_{name}.exr")


def table(
    job: Job, stem: str, make: Callable[[], Mapping[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Columns of numbers, in a CSV file."""
    path = job.folder / f"{stem}.csv"
    if not path.is_file():
        write_table(path, make())
    return read_table(path)


def numbers(job: Job, stem: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What JSON can hold; what it cannot, NaN and infinity, becomes None."""
    path = job.folder / f"{stem}.part"
    if not path.is_file():
        write_json(path, json.loads(json.dumps(make()), parse_constant=lambda _: None))
    return json.loads(path.read_text(encoding="utf-8"))

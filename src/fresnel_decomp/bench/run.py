"""Speed against error: every model judged and timed in one run, which may be interrupted.

Before anything is timed, all models, as functions, in BSDFs and in the scene of the picture, are
compared with independent answers (`bench.candidates.check`), in every run. Then each is judged on
sets of curves and measured materials by what its kernel evaluates, in float32, and timed. A model's
record is written after each of these two stages, so that the same command goes on where it stopped.
Records are those of one version of the package and one set of settings: any other has its own.
`tables` and `figures` make of the records what people read.

Times are kernel times relative to those of `mi.fresnel_conductor` (of a BSDF and a picture:
`roughconductor`). Some models at a time take turns with it, round by round; a ratio is the median
over rounds of (model / built-in in the same round), its spread half the distance between quartiles.
"""

from __future__ import annotations

import datetime
import fnmatch
import hashlib
import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import doctor
from .._array import drjit_constant
from .._check import input_error, is_whole
from .._files import writable_folder, write_json
from ..accuracy import COLOUR_DEGREES, SETS, colour_errors, measure, usable_materials
from ..fresnel import conductor

if TYPE_CHECKING:
    from .candidates import Candidate

__all__ = ["KINDS", "Bench", "Settings", "run"]

KINDS = {
    "compute": "compute-bound kernel",
    "streaming": "streaming kernel",
    "compute_one": "compute-bound kernel, one channel",
    "streaming_one": "streaming kernel, one channel",
    "bsdf": "BSDF only",
    "render": "whole render",
}
"""What is timed; kernels evaluate RGB unless they say otherwise."""

_GROUP = 8
"""Models that take turns with the built-in."""

_LOOK = {"distribution": "ggx", "alpha": 0.2}
"""Of all surfaces."""

_CHUNK = 1024  # curves at a time: 34 MB for each array

Progress = Callable[[str, float], None]
Row = dict[str, Any]


@dataclass(frozen=True)
class Settings:
    """How much is measured, and where.

    Attributes
    ----------
    variant : an llvm_ad or cuda_ad variant with RGB that works here
    models : names, with * and ?, of what to measure; all of them by default
    rounds : that count, at least 3; a median that is to be quoted needs 9
    points : cosines of the streaming kernels
    elements, turns : of the compute-bound kernels, eight evaluations a turn
    bsdf_points : pairs of directions
    size, spp : of the picture
    thin : take every so-manieth curve of each set; 1 for all
    table_sizes : samples of each function
    seed : of cosines, directions and pictures
    """

    variant: str = field(default_factory=doctor.best_variant)
    models: tuple[str, ...] = ("*",)
    rounds: int = 11
    points: int = 4_000_000
    elements: int = 65_536
    turns: int = 16
    bsdf_points: int = 2_000_000
    size: int = 256
    spp: int = 16
    thin: int = 1
    table_sizes: tuple[int, ...] = (32, 128, 512)
    seed: int = 0

    @classmethod
    def quick(cls, **changes: Any) -> Settings:
        """Small enough to see that everything runs, too small for times to mean anything."""
        small: dict[str, Any] = {
            "rounds": 3, "points": 20_000, "elements": 256, "turns": 2, "bsdf_points": 20_000,
            "size": 16, "spp": 1, "thin": 50, "table_sizes": (32,),
        }  # fmt: skip
        return cls(**(small | changes))

    def check(self) -> None:
        """Raise `InputError` for what cannot be run."""
        least = {"rounds": 3, "seed": 0, **dict.fromkeys(_SIZES, 1)}
        for name, limit in least.items():
            if not is_whole(getattr(self, name), limit, 2**32 - 1):
                raise input_error(
                    f"{name}={getattr(self, name)}",
                    f"a whole number from {limit}",
                    "11 is the default; medians that are to be quoted need 9."
                    if name == "rounds"
                    else "Leave it out for the default.",
                )
        doctor.require_variant(self.variant)
        if self.variant.startswith("scalar"):
            raise input_error(
                f"variant '{self.variant}'",
                "an llvm_ad or cuda_ad variant",
                "Scalar variants have no kernels to time; `fresnel-decomp doctor` says what works.",
            )
        if not self.variant.endswith("_rgb"):
            raise input_error(f"variant '{self.variant}'", "one with RGB", "Try llvm_ad_rgb.")


_SIZES = ("points", "elements", "turns", "bsdf_points", "size", "spp", "thin")


@dataclass(frozen=True)
class Bench:
    """What a run found.

    Attributes
    ----------
    about : machine, versions, a hash of the package, and settings
    rows : one for each model: `model`, `family`, `form`, ..., errors as "{set}_{error}", times as
        "{kind}_ratio", "{kind}_spread" and, round by round, "{kind}_ratios"; None where there is
        none
    """

    about: dict[str, Any]
    rows: list[Row]


def run(
    settings: Settings,
    folder: str | os.PathLike[str],
    *,
    force: bool = False,
    progress: Progress = lambda stage, fraction: None,
) -> Bench:
    """Judge and time the models, or take from `folder` what an earlier run finished.

    Parameters
    ----------
    settings : Settings
    folder : path, created if needed
        Records go to a folder in it whose name tells versions and settings apart, one file for
        each model.
    force : bool
        Measure again what is finished.
    progress : called with the stage and the fraction of all work that is done

    Raises
    ------
    InputError
        For settings that cannot be run, and patterns that match no model.
    WrongAnswerError
        If a model does not evaluate to what it claims to be.
    """
    settings.check()
    from ..mitsuba.variants import variant_scope

    with variant_scope(settings.variant):
        from .candidates import candidates
        from .machine import machine_facts, source_hash

        chosen = _select(candidates(settings.table_sizes), settings.models)
        about = {
            **machine_facts(settings.variant),
            **{k: v for k, v in asdict(settings).items() if k not in ("models", "variant")},
            "source": source_hash(),
        }
        about = json.loads(json.dumps(about))  # as it is read back
        stem = hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:8]
        target = writable_folder(Path(folder) / f"models-{stem}")
        records = {c.name: _Record(target, c, about, force) for c in chosen}
        work = _Work(settings, records, progress)
        work.check(chosen)
        for start in range(0, len(chosen), _GROUP):
            work.finish(chosen[start : start + _GROUP])
    return Bench(about | {"finished": _now()}, [records[c.name].row for c in chosen])


def _select(everything: Sequence[Candidate], patterns: Sequence[str]) -> list[Candidate]:
    """The built-in, and all whose name matches."""
    names = [candidate.name for candidate in everything]
    for pattern in patterns:
        if not fnmatch.filter(names, pattern):
            raise input_error(
                f"no model is called '{pattern}'",
                "names and patterns, such as Schlick, 'balanced*', '*, 4 terms'",
                f"There are {'; '.join(n for n in names if ' float' not in n)}; and tables, such "
                f"as '{names[-1]}'.",
            )
    return [
        candidate
        for place, candidate in enumerate(everything)
        if place == 0 or any(fnmatch.fnmatchcase(candidate.name, p) for p in patterns)
    ]


class _Record:
    """What is known of a model, as it is kept in a file."""

    def __init__(
        self, folder: Path, candidate: Candidate, about: Mapping[str, Any], force: bool
    ) -> None:
        self.path = folder / f"{re.sub(r'[^A-Za-z0-9]+', '-', candidate.name)}.json"
        basis = candidate.basis
        self.made_from = dict(about) | {
            "model": candidate.name,
            "basis": dict(basis.provenance) if basis is not None else None,
        }
        self.made_from = json.loads(json.dumps(self.made_from, default=str))
        self.row: Row = {}
        self.finished: list[str] = []
        if self.path.is_file() and not force:
            found = json.loads(self.path.read_text(encoding="utf-8"))
            if found["made_from"] == self.made_from:
                self.row, self.finished = found["row"], found["finished"]

    def add(self, stage: str, values: Row) -> None:
        self.row |= values
        self.finished.append(stage)
        write_json(
            self.path,
            {
                "made_from": self.made_from,
                "finished": self.finished,
                "at": _now(),
                "row": self.row,
            },
        )


class _Work:
    """Checks of all models, then group by group errors and times, with records of these two."""

    def __init__(
        self, settings: Settings, records: Mapping[str, _Record], progress: Progress
    ) -> None:
        self.settings, self.records, self._progress = settings, records, progress
        self.done, self.total = 0.0, float(len(records))
        self.distances: dict[str, float] = {}
        self.sets = {name: _thinned(make(), settings.thin) for name, make in SETS.items()}
        self.materials = usable_materials()[:: settings.thin]
        cosines = np.clip(np.cos(np.radians(COLOUR_DEGREES)), 0.0, 1.0)
        self.cosines = cosines.astype(np.float32).astype(np.float64)
        self.colours = [m.rgb_reflectance(self.cosines) for m in self.materials]

    def progress(self, stage: str, share: float) -> None:
        """`share` in models more are done."""
        self.done += share
        self._progress(stage, min(1.0, self.done / self.total))

    def check(self, chosen: Sequence[Candidate]) -> None:
        """Compare all answers, those of finished models too; raises `WrongAnswerError`."""
        import mitsuba as mi

        from ..mitsuba import workloads
        from . import candidates

        s = self.settings
        si, wo = workloads.directions(min(s.bsdf_points, 20_000), s.seed + 1)
        mirror = mi.load_dict({"type": "roughconductor", "material": "none", **_LOOK})
        for candidate in chosen:
            self.distances[candidate.name] = candidates.check(candidate)
            if candidate.bsdf is not None:
                material = {**candidate.bsdf, **_LOOK}
                candidates.check_bsdf(candidate, mi.load_dict(material), mirror, si, wo)
                picture = workloads.picture(material, s.size, s.spp, s.seed)
                candidates.check_picture(candidate, picture, mirror, s.seed)
            self.progress("checking answers", 0.1)

    def finish(self, group: Sequence[Candidate]) -> None:
        pending = [c for c in group if "times" not in self.records[c.name].finished]
        self.progress("finished before", 0.9 * (len(group) - len(pending)))
        unjudged = [c for c in pending if "errors" not in self.records[c.name].finished]
        errors = self.errors(unjudged) if unjudged else {}
        for candidate in unjudged:
            row = self.identity(candidate) | errors[candidate.name] | self.colours_of(candidate)
            row["worst_max"] = _worst(row)
            self.records[candidate.name].add("errors", row)
        self.progress(f"errors of {group[-1].family}", 0.2 * len(pending))
        if pending:
            self.times(pending)

    def identity(self, candidate: Candidate) -> Row:
        """Everything but errors and times."""
        from .candidates import operation_counts

        material = candidate.material_bytes()
        return {
            "model": candidate.name,
            "family": candidate.family,
            "form": candidate.form,
            "terms": candidate.terms,
            "size": candidate.size,
            "storage": candidate.storage,
            "integrates": candidate.integrates,
            "in_plugin": candidate.bsdf is not None,
            "distance_to_answer": self.distances[candidate.name],
            "shared_bytes": candidate.shared_bytes,
            "material_bytes": material,
            "bytes": candidate.shared_bytes + material,
            **operation_counts(candidate),
        }

    def errors(self, group: Sequence[Candidate]) -> dict[str, Row]:
        """On every set, of what the kernels evaluate."""
        rows: dict[str, Row] = {candidate.name: {} for candidate in group}
        for name, members in self.sets.items():
            able = [c for c in group if name == "a" or not c.dielectric]
            found = measure(members, models=_kernels(able), exact=_exact, chunk=_CHUNK)
            for model, row in rows.items():
                errors = found.get(model)
                row |= {f"{name}_{error}": getattr(errors, error, None) for error in _ERRORS}
        return rows

    def colours_of(self, candidate: Candidate) -> Row:
        """Errors of the colours of measured materials."""
        from .candidates import reflectances

        if candidate.store_colour is None:
            return {f"delta_e_{error}": None for error in _COLOUR_ERRORS}
        stored = [candidate.store_colour(material) for material in self.materials]
        columns = [
            np.concatenate([np.asarray(s[i]) for s in stored]) for i in range(len(stored[0]))
        ]
        fit = reflectances(candidate, columns, self.cosines, channels=3)
        fit = fit.reshape(len(stored), 3, -1).swapaxes(1, 2)
        errors = asdict(colour_errors(list(fit), self.colours))
        return {f"delta_e_{error}": errors[error] for error in _COLOUR_ERRORS}

    def times(self, group: Sequence[Candidate]) -> None:
        """Of the models of a group, in turns with the built-in."""
        from ..mitsuba.timing import interleaved_times, ratio_and_spread
        from .candidates import BASE, candidates

        others = [candidate for candidate in group if candidate.name != BASE]
        runs = self.runs([candidates(())[0], *others])
        share = 0.7 * len(group) / (self.settings.rounds + 2)
        label = f"times of {group[-1].family}"
        times = interleaved_times(runs, self.settings.rounds, lambda: self.progress(label, share))
        for candidate in group:
            row: Row = {}
            for kind in KINDS:
                found = times[kind].get(candidate.name)
                ratio, spread = (
                    ratio_and_spread(found, times[kind][BASE]) if found else (None, None)
                )
                base = float(np.median(times[kind][BASE])) if found else None
                row |= {f"{kind}_ratio": ratio, f"{kind}_spread": spread}
                row[f"{kind}_ratios"] = (
                    [a / b for a, b in zip(found, times[kind][BASE], strict=True)]
                    if found
                    else None
                )
                row[f"{kind}_ns"] = (
                    1e6 * float(np.median(found)) / self.count(kind) if found else None
                )
                row[f"{kind}_built_in_ns"] = 1e6 * base / self.count(kind) if base else None
            self.records[candidate.name].add("times", row)

    def count(self, kind: str) -> int:
        """Evaluations of a run; pixels times samples of a picture."""
        from ..mitsuba.workloads import UNROLL

        s = self.settings
        if kind.startswith("compute"):
            return s.elements * s.turns * UNROLL
        return {"bsdf": s.bsdf_points, "render": s.size * s.size * s.spp}.get(kind, s.points)

    def runs(self, group: Sequence[Candidate]) -> dict[str, dict[str, Callable[[], Any]]]:
        """For each kind and model, what runs it."""
        import drjit as dr
        import mitsuba as mi

        from ..mitsuba import workloads as work

        s = self.settings
        many, few = (work.random_cosines(size, s.seed) for size in (s.points, s.elements))
        index = [np.array(values) for values in work.BERYLLIUM.values()]
        runs: dict[str, dict[str, Callable[[], Any]]] = {kind: {} for kind in KINDS}
        for candidate in group:
            for suffix, channels, kind in (("", 3, mi.Color3f), ("_one", 1, mi.Float)):
                values = candidate.store(*(values[:channels] for values in index))
                # opaque, or the material would be compiled into the kernel
                stored = [
                    dr.opaque(kind, v.tolist() if channels > 1 else float(v[0])) for v in values
                ]
                evaluate = _bound(candidate, stored)
                runs[f"streaming{suffix}"][candidate.name] = work.streaming(evaluate, many)
                runs[f"compute{suffix}"][candidate.name] = work.compute_bound(
                    evaluate, kind, few, s.turns
                )
        surfaces = [candidate for candidate in group if candidate.bsdf is not None]
        if len(surfaces) == 1 and len(group) > 1:  # the built-in alone: nothing to compare
            return runs
        si, wo = work.directions(s.bsdf_points, s.seed)
        for candidate in surfaces:
            material = {**(candidate.bsdf or {}), **_LOOK}
            runs["bsdf"][candidate.name] = work.bsdf_evaluation(mi.load_dict(material), si, wo)
            runs["render"][candidate.name] = work.picture(material, s.size, s.spp, s.seed)
        return runs


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


_ERRORS = (
    "max", "p99", "mean", "rmse", "albedo_max", "albedo_p99", "albedo_mean", "albedo_rmse",
)  # fmt: skip
_COLOUR_ERRORS = ("max", "p99", "mean", "rmse")


def _worst(row: Row) -> float | None:
    """The largest error over all sets, of models that are for all of them."""
    largest = [row[f"{name}_max"] for name in SETS]
    return None if None in largest else max(largest)


def _thinned(members: Any, step: int) -> Any:
    return members.take(slice(None, None, step))


def _bound(candidate: Candidate, stored: Sequence[Any]) -> Callable[[Any], Any]:
    return lambda cosine: candidate.evaluate(cosine, *stored)


def _kernels(group: Sequence[Candidate]) -> Callable[[Any], dict[str, Any]]:
    """As `accuracy.fits`, by what the kernels of candidates evaluate."""
    from .candidates import reflectances

    def fit(candidate: Candidate, cos_theta: Any) -> Callable[[Any, Any], Any]:
        return lambda eta, k: reflectances(candidate, candidate.store(eta, k), cos_theta)

    return lambda cos_theta: {candidate.name: fit(candidate, cos_theta) for candidate in group}


def _exact(members: Any, cos_theta: Any) -> Any:
    """(n, m) exact reflectances in float64, where kernels get the nearest float32 cosines."""
    import drjit as dr
    import mitsuba as mi

    kind = dr.float64_array_t(mi.Float)
    m, n = len(cos_theta), len(members)
    cosines = dr.tile(kind(drjit_constant(mi.Float, cos_theta)), n)
    eta, k = (dr.repeat(drjit_constant(kind, v), m) for v in (members.eta, members.k))
    return np.array(conductor(cosines, eta, k)).reshape(n, m)

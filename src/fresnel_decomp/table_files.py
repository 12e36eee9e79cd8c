"""Files of albedo tables: OpenEXR for engines, NumPy archives, and half floats without a header.

- `.exr`: channels R, G, B, A, and for more than four terms `second.R`, ...; half or float.
- `.npz`: `values`, (height, width, terms), and `metadata`, JSON text.
- `.half`: little-endian half floats and nothing else: RGBA by texel, row by row from the smoothest,
  one texture after the other.

The metadata say what was integrated, on which axes, from which basis and with which error, and hold
a hash of the values, so that nothing truncated, changed or of another layout is taken for a table.
In an EXR header they are text attributes, beside `.half` the file `.half.json`.
"""

from __future__ import annotations

import json
import os
import zipfile
import zlib
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ._check import InputError, choose, input_error
from ._files import replacing
from .images import read_exr_attributes, read_exr_planes, write_exr
from .table import AlbedoTable
from .table_layout import Layout

__all__ = ["FORMATS", "load", "save"]

FORMATS = (".exr", ".npz", ".half")
"""Suffixes that `save` and `load` know."""

_KIND = "fresnel_decomp albedo table"
_ATTRIBUTE = "fresnelDecomp"
_CHANNELS = ("R", "G", "B", "A", "second.R", "second.G", "second.B", "second.A")


def save(table: AlbedoTable, path: str | os.PathLike[str], *, half: bool | None = None) -> None:
    """Write a table; see `AlbedoTable.save`."""
    path = Path(path)
    suffix = choose("format", path.suffix.lower(), FORMATS)
    if half is None:
        half = suffix != ".npz"
    if suffix == ".half" and not half:
        raise input_error("half=False for a '.half' file", "half floats", "Write an .exr or .npz.")
    if table.terms > len(_CHANNELS) and suffix != ".npz":
        raise input_error(
            f"{table.terms} terms", f"up to {len(_CHANNELS)} in a '{suffix}' file", "Write an .npz."
        )
    values = _stored(table.values, half)
    description = _describe(replace(table, values=values), "half" if half else "float")
    _write(path, suffix, values, description)


def _write(path: Path, suffix: str, values: np.ndarray, description: dict[str, Any]) -> None:
    if suffix == ".exr":
        planes = dict(zip(_CHANNELS, np.moveaxis(values, 2, 0), strict=False))
        write_exr(path, planes, _attributes(description))
    elif suffix == ".npz":
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, values=values, metadata=np.array(json.dumps(description)))
    else:
        padded = np.pad(values, ((0, 0), (0, 0), (0, -values.shape[2] % 4)))
        textures = np.split(padded, padded.shape[2] // 4, axis=2)
        data = b"".join(texture.astype("<f2").tobytes() for texture in textures)
        text = json.dumps(description, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
        # both are written before either is renamed
        with replacing(path) as temporary, replacing(_sidecar(path)) as beside:
            temporary.write_bytes(data)
            beside.write_text(text, encoding="utf-8")


def load(path: str | os.PathLike[str]) -> AlbedoTable:
    """Read a table; see `AlbedoTable.load`."""
    path = Path(path)
    suffix = choose("format", path.suffix.lower(), FORMATS)
    if not path.is_file():
        raise input_error(f"no file '{path}'", "an albedo table", "Check the path.")
    readers = {".exr": _read_exr, ".npz": _read_npz, ".half": _read_half}
    values, description = readers[suffix](path)
    try:
        layout = Layout(**description["layout"])
        terms, expected = int(description["terms"]), str(description["sha256"])
        smith, distribution = description["smith"], description["distribution"]
        metadata = dict(description["metadata"])
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise _not_a_table(path, f"metadata without {error}") from error
    shape = (layout.height, layout.width, terms)
    if values.shape != shape:
        raise input_error(
            f"'{path}' with {_size(values.shape)}",
            f"{_size(shape)}, as its metadata say",
            "Someone resized it or changed its channels: bake it anew.",
        )
    table = AlbedoTable(values, layout, smith, distribution, metadata)
    if table.sha256 != expected:
        raise input_error(
            f"'{path}' with values that do not match the hash in its metadata",
            "a table as it was written",
            "It was truncated or changed: bake it anew.",
        )
    return table


# --- reading -------------------------------------------------------------------------------------


def _read_exr(path: Path) -> tuple[np.ndarray, dict[str, Any]]:
    try:
        text = read_exr_attributes(path).get(_ATTRIBUTE)
    except UnicodeDecodeError as error:
        raise _damaged(path, f"header: {error}") from error
    if text is None:
        raise _not_a_table(path, f"no attribute '{_ATTRIBUTE}'")
    description = _parse(path, text)
    planes = read_exr_planes(path)
    names = _CHANNELS[: _terms(path, description)]
    if set(planes) != set(names):
        raise input_error(
            f"'{path}' with channels {', '.join(sorted(planes))}",
            f"{', '.join(names)}, as its metadata say",
            "Someone changed its channels: bake it anew.",
        )
    return np.stack([planes[name] for name in names], axis=-1), description


def _read_npz(path: Path) -> tuple[np.ndarray, dict[str, Any]]:
    try:
        with path.open("rb") as stream:
            file = np.load(stream, allow_pickle=False)
            if isinstance(file, np.ndarray):
                raise _not_a_table(path, "a single array without a name")
            if not {"values", "metadata"} <= set(file.files):
                raise _not_a_table(path, f"arrays {', '.join(file.files)}")
            values, text = file["values"], str(file["metadata"])
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise _damaged(path, str(error)) from error
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise _damaged(path, str(error)) from error
    if values.ndim != 3 or values.dtype.kind != "f":
        raise _not_a_table(path, f"values of shape {values.shape}, type {values.dtype}")
    return values, _parse(path, text)


def _read_half(path: Path) -> tuple[np.ndarray, dict[str, Any]]:
    sidecar = _sidecar(path)
    if not sidecar.is_file():
        raise input_error(
            f"'{path}' without '{sidecar.name}' beside it",
            "both files, as they were written",
            "Half floats alone do not tell their layout; np.fromfile(path, '<f2') reads them.",
        )
    try:
        text = sidecar.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise _damaged(sidecar, str(error)) from error
    description = _parse(path, text)
    terms = _terms(path, description)
    try:
        layout = Layout(**description["layout"])
    except (KeyError, TypeError) as error:
        raise _not_a_table(path, f"metadata without {error}") from error
    count = -(-terms // 4)
    expected = 2 * 4 * count * layout.width * layout.height
    data = path.read_bytes()
    if len(data) != expected:
        raise input_error(
            f"'{path}' with {len(data):,} bytes",
            f"{expected:,} bytes: {count} RGBA half-float texture{'s' * (count > 1)} of "
            f"{layout.width} x {layout.height}",
            "It was truncated, or is of another layout: bake it anew.",
        )
    textures = np.frombuffer(data, "<f2").reshape(count, layout.height, layout.width, 4)
    return np.concatenate(list(textures), axis=-1)[..., :terms], description


def _parse(path: Path, text: str) -> dict[str, Any]:
    try:
        description = json.loads(text)
    except ValueError as error:
        raise _damaged(path, f"metadata: {error}") from error
    if not isinstance(description, dict) or description.get("kind") != _KIND:
        raise _not_a_table(path, "metadata of something else")
    return description


def _terms(path: Path, description: dict[str, Any]) -> int:
    terms = description.get("terms")
    if not isinstance(terms, int) or not 1 <= terms <= len(_CHANNELS):
        raise _not_a_table(path, f"terms={terms!r}")
    return terms


# --- writing -------------------------------------------------------------------------------------


def _stored(values: np.ndarray, half: bool) -> np.ndarray:
    if not half:
        return values
    with np.errstate(over="ignore"):
        stored = values.astype(np.float16)
    if not np.isfinite(stored).all():
        raise input_error(
            f"values up to {np.abs(values).max():g}",
            "finite values up to 65504 in half floats",
            "Store floats: half=False.",
        )
    return stored


def _describe(table: AlbedoTable, storage: str) -> dict[str, Any]:
    layout = table.layout
    return {
        "kind": _KIND,
        "version": 1,
        "terms": table.terms,
        "layout": asdict(layout),
        "axes": _axes(layout),
        "smith": table.smith,
        "distribution": table.distribution,
        "storage": storage,
        "sha256": table.sha256,
        "metadata": dict(table.metadata),
    }


def _axes(layout: Layout) -> str:
    across = {"sqrt_mu": "sqrt(mu)", "mu": "mu", "theta": "1 - 2 theta/pi"}[layout.mu_axis]
    down = {"perceptual_roughness": "sqrt(alpha)", "alpha": "alpha"}[layout.alpha_axis]
    where = {"centres": "centres of the outer texels", "edges": "edges of the texture"}
    return (
        f"x = {across}, y = {down}, row 0 smoothest; 0 and 1 on the {where[layout.addressing]}; "
        "mu = cos theta of the view"
    )


def _attributes(description: dict[str, Any]) -> dict[str, str]:
    """Header of an EXR file: for people one by one, for `load` all at once."""
    metadata = description["metadata"]
    basis, error = (
        value if isinstance(value, dict) else {}
        for value in (metadata.get("basis"), metadata.get("measured_error"))
    )
    largest = error.get("max")
    return {
        "comments": "Directional albedo of basis functions; Fbar = sum c_i bbar_i",
        "axes": description["axes"],
        "channelNames": ", ".join(
            f"{name} = bbar_{i}" for i, name in enumerate(_CHANNELS[: description["terms"]])
        ),
        "smith": description["smith"],
        "distribution": description["distribution"],
        "recipe": str(basis.get("recipe", "unknown")),
        "basisSha256": str(basis.get("sha256", "unknown")),
        "quadrature": str(metadata.get("quadrature", "unknown")),
        "measuredError": f"{largest:.2g}" if isinstance(largest, int | float) else "not measured",
        "sha256": description["sha256"],
        _ATTRIBUTE: json.dumps(description),
    }


def _sidecar(path: Path) -> Path:
    return path.with_name(path.name + ".json")


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]} texels of {shape[2]} terms"


def _not_a_table(path: Path, why: str) -> InputError:
    return input_error(
        f"'{path}' is no albedo table ({why})",
        "what AlbedoTable.save writes",
        "Pictures without its metadata can be wrapped: AlbedoTable(values, Layout(...)).",
    )


def _damaged(path: Path, why: str) -> InputError:
    return input_error(
        f"cannot read '{path}' ({why})", "a whole file", "It is truncated: bake it anew."
    )

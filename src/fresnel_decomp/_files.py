"""Whole files or none: everything is written beside its target and renamed into place."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ._check import input_error

__all__ = ["replacing", "writable_folder", "write_json", "write_text"]


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path of the same suffix; rename it to `path` if the block succeeds.

    On any error, Ctrl-C included, the temporary file is removed and `path` stays as it was.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    target = Path(path)
    try:
        with _beside(target) as temporary:
            yield temporary
    except OSError as error:
        raise input_error(
            f"cannot write '{target}' ({error.strerror or error})",
            "a file in a folder that exists and can be written to",
            "Create the folder, or choose another.",
        ) from error


@contextlib.contextmanager
def _beside(target: Path) -> Iterator[Path]:
    handle, name = tempfile.mkstemp(
        prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent
    )
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)  # mkstemp gives 0600: honour the user's umask instead
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` as UTF-8, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: str | os.PathLike[str], value: Any) -> None:
    """Write `value` as indented JSON, whole or not at all; NaN and infinity are refused."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False, ensure_ascii=False) + "\n")


def writable_folder(path: str | os.PathLike[str]) -> Path:
    """Create `path` if needed and return it.

    Raises
    ------
    InputError
        If it is not a folder, or nothing can be written to it.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise input_error(
            f"cannot write to folder '{folder}' ({error.strerror or error})",
            "a folder that exists or can be created, with write permission",
            "Choose another with --out.",
        ) from error
    return folder

"""Finding an LLVM library that Dr.Jit can work with, without loading it into this process.

Dr.Jit chooses its LLVM once, while it is imported: the file named by ``DRJIT_LIBLLVM_PATH``,
else ``libLLVM.so`` by the loader's search path, else the highest version in ``/usr/lib``. It then
accepts LLVM 15 and 16, whose first kernel aborts the interpreter. So the choice is made here,
before that import, and handed over through the environment variable.
"""

from __future__ import annotations

import glob
import json
import os
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = [
    "MINIMUM",
    "NONE",
    "VARIABLE",
    "Library",
    "cache_folder",
    "cached",
    "candidates",
    "examine",
    "find",
    "import_error",
    "missing_library",
    "preload",
    "run_kernel",
    "runtime",
    "spell",
    "version_in_name",
]

MINIMUM = 17
"""Oldest major version whose kernels run: Dr.Jit 1.5 refuses 14 and aborts on 15 and 16."""

VARIABLE = "DRJIT_LIBLLVM_PATH"

NONE = "no usable LLVM, see: fresnel-decomp doctor"
"""Value of VARIABLE where there is no usable LLVM. Dr.Jit then does without, and `mi.set_variant`
raises ImportError, instead of taking one whose first kernel aborts. It names no file on purpose.
"""

MANIFEST = "manifest.json"

# What a library says of itself. It runs in another process, because a broken one may crash it and
# a good one takes .1 to .3 s and 120 MB to load, which a scalar variant should not have to pay.
# Libraries before LLVM 16 lack LLVMGetVersion; all that matters of those is that they are too old.
_PROBE = """
import ctypes, json, sys
for path in sys.argv[2:]:
    ctypes.CDLL(path)
library = ctypes.CDLL(sys.argv[1])
library.LLVMContextCreate
version = [ctypes.c_uint() for _ in range(3)]
try:
    library.LLVMGetVersion(*map(ctypes.byref, version))
except AttributeError:
    version = [ctypes.c_uint(0)]
print(json.dumps([v.value for v in version]))
"""

# A kernel with the operation that LLVM 15 and 16 cannot compile (dr.maximum), and its answer.
_KERNEL = """
import ctypes, os, sys
for path in sys.argv[2:]:
    ctypes.CDLL(path)
os.environ["DRJIT_LIBLLVM_PATH"] = sys.argv[1]
import drjit as dr
if not dr.has_backend(dr.JitBackend.LLVM):
    sys.exit("Dr.Jit does not accept this library")
if dr.detail.llvm_version()[0] < int(os.environ["FRESNEL_DECOMP_MINIMUM"]):
    sys.exit("Dr.Jit took another LLVM: {}.{}.{}".format(*dr.detail.llvm_version()))
from drjit.llvm import Float
got = list(dr.maximum(dr.sqrt(dr.opaque(Float, 4, 3)) * Float([1, -2, 3]), 0))
if got != [2, 0, 6]:
    sys.exit(f"a kernel returned {got} in place of [2, 0, 6]")
"""

_IMPORT = """
import ctypes, sys
for path in sys.argv[1:]:
    ctypes.CDLL(path)
import mitsuba
mitsuba.set_variant("scalar_rgb")
mitsuba.load_dict({"type": "sphere"})
"""


@dataclass(frozen=True)
class Library:
    """An LLVM library that loads and is recent enough."""

    path: Path
    version: tuple[int, ...]
    preload: tuple[Path, ...] = ()
    """Libraries it needs and the system lacks, in the order in which they must be loaded."""


def spell(version: tuple[int, ...] | None) -> str:
    """Return ``"19.1.7"`` for ``(19, 1, 7)`` and ``"unknown"`` for None."""
    return ".".join(map(str, version)) if version else "unknown"


def cache_folder() -> Path:
    """Return the folder for what we download: it may not exist yet.

    ``$FRESNEL_DECOMP_CACHE``, else ``$XDG_CACHE_HOME/fresnel_decomp``, else
    ``~/.cache/fresnel_decomp``.
    """
    if own := os.environ.get("FRESNEL_DECOMP_CACHE"):
        return Path(own).absolute()
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(base).absolute() / "fresnel_decomp"


def version_in_name(path: str | os.PathLike[str]) -> tuple[int, ...] | None:
    """Read the version off a file name such as ``libLLVM-15.so.1`` or ``libLLVM.so.19.1``."""
    real = Path(os.path.realpath(path))
    pattern = r"libLLVM(?:-(?P<old>\d[\d.]*?))?\.(?:so|dylib)(?:\.(?P<new>\d[\d.]*))?"
    match = re.fullmatch(pattern, real.name)
    text = match and (match["old"] or match["new"])
    if not text and (keg := re.search(r"/Cellar/llvm[^/]*/(\d+(?:\.\d+)*)", real.as_posix())):
        text = keg[1]
    return tuple(map(int, text.split("."))) if text else None


def candidates() -> list[Path]:
    """List the LLVM libraries of this system, the highest version first, each file once."""
    folders = [str(Path(p, "lib")) for p in (os.environ.get("CONDA_PREFIX"), sys.prefix) if p]
    folders += filter(None, os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep))
    name = "libLLVM*.so*"
    if sys.platform == "darwin":
        name = "libLLVM*.dylib"
        folders += [f"{root}/opt/llvm*/lib" for root in ("/opt/homebrew", "/usr/local")]
    elif sys.platform == "win32":
        name = "LLVM-C.dll"
        folders += os.environ.get("PATH", "").split(os.pathsep)
        folders += [str(Path(os.environ.get("PROGRAMFILES", "C:/Program Files"), "LLVM", "bin"))]
    else:
        multiarch = f"{os.uname().machine}-linux-gnu"
        folders += [f"/usr/lib/{multiarch}", "/usr/lib64", "/usr/lib", "/usr/local/lib"]
        folders += ["/usr/lib/llvm-*/lib", "/usr/lib64/llvm*/lib*", "/usr/lib/llvm*/lib64"]
    found: dict[str, Path] = {}
    for folder in folders:
        for path in sorted(glob.glob(os.path.join(folder, name))):
            found.setdefault(os.path.realpath(path), Path(path))
    return sorted(found.values(), key=lambda path: version_in_name(path) or (), reverse=True)


def cached() -> list[Library]:
    """List the LLVM copies in our cache folder, the highest version first."""
    found = []
    for folder, entry in _manifests("llvm-*"):
        version = tuple(entry.get("version", ()))
        path = folder / entry.get("library", "")
        needed = tuple(folder / name for name in entry["preload"])
        if version[:1] >= (MINIMUM,) and all(p.is_file() for p in (path, *needed)):
            found.append(Library(path, version, needed))
    return sorted(found, key=lambda library: library.version, reverse=True)


def runtime() -> list[Path]:
    """List the copies in our cache folder of what Mitsuba itself needs and the system lacks."""
    return [folder / name for folder, entry in _manifests("lib-*") for name in entry["preload"]]


def preload(paths: Iterable[Path]) -> None:
    """Load libraries that others need and the system does not have.

    The loader reads LD_LIBRARY_PATH only when a process starts, so setting it now is of no use.
    But it takes any library that is already loaded under the wanted name (its SONAME) as found,
    so loading the few missing ones by path, each after those that it needs itself, is enough.
    """
    for path in paths:
        import ctypes

        ctypes.CDLL(str(path))


def examine(path: str | os.PathLike[str]) -> tuple[Library | None, str]:
    """Return the library at `path` if it is usable, else None and why not."""
    text = os.fspath(path)
    for library in cached():
        if os.path.realpath(library.path) == os.path.realpath(text):
            return library, ""
    version = version_in_name(text)
    error = ""
    if os.path.dirname(text) and not os.path.isfile(text):
        return None, f"'{text}' is not a file"
    if version is None or version[0] >= MINIMUM:  # else it need not be asked
        version, error = _probe(text)
    if version is None:
        return None, f"'{text}' cannot be loaded as LLVM ({error})"
    if version[0] < MINIMUM:
        kind = f"LLVM {spell(version)}" if version[0] else "LLVM"
        return None, f"{kind} ('{text}') is older than {MINIMUM} and aborts Dr.Jit's kernels"
    return Library(Path(text), version), ""


def find() -> tuple[Library | None, list[str]]:
    """Return the best usable library, our own copy first, and why others were passed over."""
    for copy in cached():
        return copy, []
    reasons: list[str] = []
    for path in candidates():
        library, reason = examine(path)
        if library:
            return library, reasons
        reasons.append(reason)
    return None, reasons


def run_kernel(library: Library, timeout: float = 120) -> str:
    """Compile and run a small kernel with `library` in another process; return the error or ""."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        environment = dict(
            os.environ,
            DRJIT_CACHE_DIR=folder,  # a kernel from an earlier run would hide a broken compiler
            FRESNEL_DECOMP_MINIMUM=str(MINIMUM),
        )
        arguments = [str(p) for p in (library.path, *runtime(), *library.preload)]
        return _python(_KERNEL, arguments, timeout, environment)[1]


def import_error() -> str:
    """Import Mitsuba in another process, with what is in our cache folder; return the error."""
    environment = {**os.environ, VARIABLE: NONE}
    return _python(_IMPORT, list(map(str, runtime())), 120, environment)[1]


def missing_library(error: str) -> str:
    """Return the file name in the loader's complaint about a missing library, else ""."""
    match = re.search(r"(\S+\.so[\d.]*): cannot open shared object file", error)
    return match[1] if match else ""


def _manifests(pattern: str) -> Iterator[tuple[Path, dict[str, Any]]]:
    for manifest in sorted(cache_folder().glob(f"{pattern}/{MANIFEST}")):
        try:
            entry = json.loads(manifest.read_text(encoding="utf-8"))
            if isinstance(entry["preload"], list):
                yield manifest.parent, entry
        except (OSError, ValueError, KeyError, TypeError):
            continue  # being removed, or not of our making


def _probe(text: str) -> tuple[tuple[int, ...] | None, str]:
    """Ask the library its version, or remember the answer for an unchanged file."""
    memory = cache_folder() / "probes.json"
    try:
        stat = os.stat(text)
        stamp = [os.path.realpath(text), stat.st_size, stat.st_mtime_ns]
    except OSError:
        stamp = []  # a bare name, which the loader looks up
    try:
        known = json.loads(memory.read_text(encoding="utf-8"))
        if stamp and known[text][0] == stamp:
            return tuple(known[text][1]), ""
    except (OSError, ValueError, KeyError, TypeError, IndexError):
        known = {}
    output, error = _python(_PROBE, [text], 30)
    if error:
        return None, error  # not remembered: a missing dependency can be installed any time
    version = tuple(json.loads(output))
    if stamp:
        from .._check import InputError
        from .._files import write_json

        try:
            memory.parent.mkdir(parents=True, exist_ok=True)
            write_json(memory, {**known, text: [stamp, version]})
        except (OSError, InputError):
            pass  # nowhere to remember it: the next process asks again
    return version, ""


def _python(
    code: str, arguments: list[str], timeout: float, environment: dict[str, str] | None = None
) -> tuple[str, str]:
    """Run `code` in another interpreter; return its output and its error, "" if none."""
    import subprocess

    flags = ["-P"] if environment else ["-I", "-S"]  # the probe needs no packages, so starts fast
    command = [sys.executable, *flags, "-c", code, *arguments]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=timeout,
            env=environment, stdin=subprocess.DEVNULL, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        return "", str(error)
    if done.returncode == 0:
        return done.stdout, ""
    if missing := missing_library(done.stderr):
        return "", f"{missing}: cannot open shared object file"
    last = (done.stderr.strip().splitlines() or ["no message"])[-1]
    if done.returncode < 0:
        last = f"the process died of signal {-done.returncode}: {last}"
    return "", last[:300]

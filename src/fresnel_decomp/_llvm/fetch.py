"""Private copies of the distribution's libraries, unpacked into our cache folder, without root."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from .search import MANIFEST, Library, _python, cache_folder, run_kernel, spell

__all__ = ["FetchError", "can_fetch", "fetch_library", "fetch_llvm", "package_of"]

T = TypeVar("T")

PACKAGES = ["libllvm19", "libllvm20", "libllvm18", "libllvm17", "libllvm17t64", "libllvm21"]
"""Names on Debian and Ubuntu, in the order in which they are tried."""

# Never taken from a package: a second C library in one process is fatal, and where the system's
# own C++ runtime is too old for a package, another LLVM must be tried.
_NEVER = re.compile(r"libc6|libc-bin|libgcc-s1|libstdc\+\+6|gcc-\d+-base|.*-(dev|bin|common)")

# Loads the library and, first, whatever it needs and the system lacks: the loader names the missing
# file in its error message. Prints the files in the order that worked.
_RESOLVE = """
import ctypes, json, os, sys
library, root = sys.argv[1:]
files = {name: os.path.join(folder, name) for folder, _, names in os.walk(root) for name in names}
order, tried = [], set()
def load(path):
    while True:
        try:
            return ctypes.CDLL(path)
        except OSError as error:
            missing = str(error).split(":")[0]
            if missing in tried or missing not in files:
                raise
            tried.add(missing)
            load(files[missing])
            order.append(files[missing])
loaded = load(library)
version = [ctypes.c_uint() for _ in range(3)]
if hasattr(loaded, "LLVMGetVersion"):
    loaded.LLVMGetVersion(*map(ctypes.byref, version))
print(json.dumps([order, [v.value for v in version]]))
"""


class FetchError(RuntimeError):
    """No working LLVM could be fetched; the message says why."""


def can_fetch() -> bool:
    """Tell whether this system has the two tools that are used here."""
    return bool(shutil.which("apt-get") and shutil.which("dpkg-deb"))


def package_of(library: str) -> str:
    """Return the package that by Debian's rule holds a library: libatomic1 for libatomic.so.1."""
    stem, _, version = library.partition(".so.")
    return f"{stem}{'-' if stem[-1:].isdigit() and version else ''}{version}".lower()


def fetch_llvm(progress: Callable[[str], None]) -> Library:
    """Download, unpack, try and install an LLVM into the cache folder; return it.

    The folder appears whole, under its final name, only after a kernel ran with it.

    Raises
    ------
    FetchError
        If there is no package, no network, no space, or none of the packages works.
    """

    def install(root: Path, work: Path) -> Library:
        found = [p for p in root.rglob("libLLVM*.so*") if p.is_file() and not p.is_symlink()]
        if not found:
            raise FetchError("the package holds no libLLVM")
        order, version = _resolve(found[0], root)
        library = Library(found[0], version, order)
        progress("running a kernel")
        if error := run_kernel(library):
            raise FetchError(f"LLVM {spell(version)} does not work here ({error})")
        name = library.path.relative_to(root)
        entry = {"library": str(name), "version": version}
        target, needed = _publish(root, work, f"llvm-{spell(version)}", order, entry)
        return Library(target / name, version, needed)

    return _fetch(PACKAGES, install, progress)


def fetch_library(name: str, progress: Callable[[str], None]) -> None:
    """Install a system library such as "libatomic.so.1" into the cache folder.

    Raises
    ------
    FetchError
        As `fetch_llvm`.
    """

    def install(root: Path, work: Path) -> None:
        found = list(root.rglob(name))
        if not found:
            raise FetchError(f"the package holds no {name}")
        order, _ = _resolve(found[0], root)
        _publish(root, work, f"lib-{package}", (*order, found[0]), {})

    package = package_of(name)
    _fetch([package], install, progress)


def _fetch(
    packages: list[str], install: Callable[[Path, Path], T], progress: Callable[[str], None]
) -> T:
    """Unpack the first of `packages` that `install` accepts, in a folder that is then removed."""
    cache = cache_folder()
    try:
        cache.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=".fetch-", dir=cache))
    except OSError as error:
        raise FetchError(
            f"cannot write to '{cache}' ({error.strerror}); "
            "FRESNEL_DECOMP_CACHE can name another folder"
        ) from error
    failures: list[str] = []
    try:
        options = _options(work)
        for update in (False, True):
            if update:  # the system's package lists are empty or out of date: read our own
                progress("reading the distribution's package lists")
                (work / "lists" / "partial").mkdir(parents=True)
                options += ["-o", f"Dir::State::lists={work / 'lists'}"]
                # A third party's repository that is out of reach makes this fail; the packages
                # that we want may be there all the same, so only their absence counts.
                done = _run(["apt-get", *options, "update"], work)
                failures += done.stderr.strip().splitlines()[-1:] if done.returncode else []
            for package in _available(packages, options, work):
                try:
                    return install(_unpack(package, options, work, progress), work)
                except FetchError as error:
                    progress(f"{package}: {error}")
                    failures.insert(0, f"{package}: {error}")
        names = " or ".join(packages[:4])
        raise FetchError("; ".join(failures[:2]) or f"no package {names} is offered")
    except subprocess.TimeoutExpired as error:
        raise FetchError(f"'{error.cmd[0]}' took longer than {error.timeout:.0f} s") from error
    except OSError as error:
        raise FetchError(f"{error.strerror or error} ('{error.filename or cache}')") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)  # on Ctrl-C too


def _unpack(package: str, options: list[str], work: Path, progress: Callable[[str], None]) -> Path:
    """Download a package, and those that it needs and are not installed, into one new folder."""
    wanted = _closure(package, options, work)
    progress(f"downloading {', '.join(wanted)}")
    debs = Path(tempfile.mkdtemp(prefix="debs-", dir=work))
    done = _run(["apt-get", *options, "download", *wanted], debs)  # checks the signed hashes
    files = sorted(debs.glob("*.deb"))
    if done.returncode or len(files) < len(wanted):
        raise FetchError((done.stderr.strip().splitlines() or ["the download failed"])[-1])
    progress("unpacking")
    root = Path(tempfile.mkdtemp(prefix="root-", dir=work))
    for file in files:
        done = _run(["dpkg-deb", "-x", str(file), str(root)], work)
        if done.returncode:
            raise FetchError((done.stderr.strip().splitlines() or ["cannot be unpacked"])[-1])
    return root


def _resolve(library: Path, root: Path) -> tuple[tuple[Path, ...], tuple[int, ...]]:
    """Which files of `root` must be loaded before `library`, in order, and its LLVM version."""
    output, error = _python(_RESOLVE, [str(library), str(root)], 60)
    if error:
        raise FetchError(error)
    order, version = json.loads(output)
    return tuple(map(Path, order)), tuple(version)


def _publish(
    root: Path, work: Path, name: str, order: tuple[Path, ...], entry: dict[str, Any]
) -> tuple[Path, tuple[Path, ...]]:
    """Give the folder its manifest and its final name; return it and the files to preload."""
    needed = [path.relative_to(root) for path in order]
    text = json.dumps({**entry, "preload": list(map(str, needed))}, indent=2)
    (root / MANIFEST).write_text(text + "\n", encoding="utf-8")
    root.chmod(0o755)
    target = work.parent / name
    if target.exists():  # one that no longer works, or a second process was quicker
        target.rename(work / "previous")
    root.rename(target)
    return target, tuple(target / path for path in needed)


def _options(work: Path) -> list[str]:
    """Settings with which apt works for anyone: its own state and cache folders, no locks."""
    (work / "cache" / "archives" / "partial").mkdir(parents=True)
    settings = {
        "Dir::Cache": work / "cache",
        "Debug::NoLocking": "true",
        "APT::Sandbox::User": "root",  # as root: our folder may be closed to the user _apt
        "Acquire::Languages": "none",
        "Acquire::IndexTargets::deb::DEP-11::DefaultEnabled": "false",
        "Acquire::IndexTargets::deb::Contents-deb::DefaultEnabled": "false",
        "Acquire::Retries": "1",
        "Acquire::http::Timeout": "30",
        "Acquire::https::Timeout": "30",
    }
    return [part for key, value in settings.items() for part in ("-o", f"{key}={value}")]


def _available(packages: list[str], options: list[str], work: Path) -> list[str]:
    """Those of `packages` that the package lists offer, in order."""
    text = _run(["apt-cache", *options, "policy", *packages], work).stdout
    offered = re.findall(r"^(\S+):\n(?:.*\n)?\s+Candidate: (?!\(none\))", text, re.MULTILINE)
    return [package for package in packages if package in offered]


def _closure(package: str, options: list[str], work: Path) -> list[str]:
    """`package` and what it needs that is not installed, by a simulated installation."""
    simulated = _run(
        ["apt-get", *options, "-s", "--no-install-recommends", "install", package], work
    )
    # "Inst NAME (VERSION ...)"; an upgrade reads "Inst NAME [OLD] (NEW ...)" and is not for us.
    new = re.findall(r"^Inst (\S+) \(", simulated.stdout, re.MULTILINE)
    extra = [name for name in new if name != package and not _NEVER.fullmatch(name)]
    return [package, *extra]


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    environment = dict(os.environ, LC_ALL="C", DEBIAN_FRONTEND="noninteractive")
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, errors="replace",
        stdin=subprocess.DEVNULL, timeout=900, check=False,
    )  # fmt: skip

"""The decision which LLVM Dr.Jit gets, taken before Dr.Jit is imported."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import search

__all__ = ["LLVM", "fix", "import_mitsuba", "prepare"]

_log = logging.getLogger(__name__)

_RESTART = "Call fresnel_decomp.doctor.prepare() before `import mitsuba` or `import drjit`"
_OFF = "LLVM is switched off by FRESNEL_DECOMP_LLVM=off"
_FIX = "fresnel-decomp doctor --fix"


@dataclass(frozen=True)
class LLVM:
    """What is known of the LLVM that Dr.Jit uses, or will use, in this process."""

    usable: bool
    path: Path | None = None
    """The library; None where there is none, or where Dr.Jit found it by itself."""
    version: tuple[int, ...] | None = None
    reason: str = ""
    """Why it is not usable."""
    remedy: str = ""
    """What to do about that."""


_decided: LLVM | None = None  # by `prepare`, before Dr.Jit was imported


def prepare(*, download: bool = False) -> LLVM:
    """Make a working LLVM visible to Dr.Jit, before Dr.Jit is imported.

    Looks at ``DRJIT_LIBLLVM_PATH``, then at our own copy in the cache folder, then at the system,
    takes the first that is LLVM 17 or newer, and sets the variable to it. Where there is none it
    keeps Dr.Jit from using an older one. It runs no kernel and never aborts. Once Dr.Jit is
    imported the choice is made: it is then only reported.

    Parameters
    ----------
    download : bool
        Call `fix` if no usable LLVM is found.

    Returns
    -------
    LLVM
        With `usable`, and a `reason` and `remedy` where it is not.

    Examples
    --------
    >>> from fresnel_decomp import doctor
    >>> llvm = doctor.prepare()
    >>> isinstance(llvm.usable, bool)
    True
    """
    drjit = sys.modules.get("drjit")
    if hasattr(drjit, "detail"):
        llvm = _settled(drjit)
    else:
        _preload_runtime()
        llvm = _decide()
    return fix() if download and not llvm.usable else llvm


def fix(progress: Callable[[str], None] | None = None) -> LLVM:
    """Get a working LLVM if there is none, without root, where the system allows it.

    On Debian and Ubuntu the distribution's package, with what it needs and the system lacks, is
    downloaded by apt and unpacked into the cache folder, from where `prepare` takes it. Elsewhere
    nothing is done, and `remedy` is the one command to run. Call it before Dr.Jit is imported.

    Parameters
    ----------
    progress : callable, optional
        Called with a short text at each step, some of which take several seconds.

    Returns
    -------
    LLVM
        As from `prepare`, and tried: a kernel was compiled and run with it in another process.
        Failure is told by `usable`, `reason` and `remedy`.
    """
    from . import fetch

    def tell(text: str) -> None:
        _log.info("%s", text)
        if progress:
            progress(text)

    if failure := _complete(tell):
        return failure
    _preload_runtime()
    if _switched_off():
        return _decide()
    library, reasons = _found()
    if library:
        tell(f"trying LLVM {search.spell(library.version)} ({library.path})")
        if not (error := search.run_kernel(library)):
            return _adopt(library)
        reasons = [f"LLVM {search.spell(library.version)} ('{library.path}') fails: {error}"]
    if not fetch.can_fetch():
        return _nothing(reasons, f"Run: {_install_command()}")
    try:
        return _adopt(fetch.fetch_llvm(tell))
    except fetch.FetchError as error:
        _log.info("no LLVM could be fetched: %s", error)
        return _nothing([*reasons, f"fetching one failed: {error}"], f"Run: {_install_command()}")


def _complete(tell: Callable[[str], None]) -> LLVM | None:
    """Get the system libraries without which Mitsuba does not even import, such as libatomic."""
    from . import fetch

    missing, before = "", None
    while error := search.import_error():
        missing = search.missing_library(error)
        if not missing:
            return _nothing([f"Mitsuba does not import: {error}"], "Install it again with pip")
        reason, remedy = _lacking(missing)
        if missing == before or not fetch.can_fetch():
            return _nothing([reason], remedy)
        before = missing
        try:
            fetch.fetch_library(missing, tell)
        except fetch.FetchError as failure:
            return _nothing([reason, f"fetching it failed: {failure}"], remedy)
    return None


def _lacking(library: str) -> tuple[str, str]:
    """Return the reason and the remedy for a system library that Mitsuba needs and is not there."""
    from . import fetch

    remedy = f"Install the package that provides {library}"
    if fetch.can_fetch():
        install = f"sudo apt-get install {fetch.package_of(library)}"
        remedy = f"Run: {_FIX} (or {install})"
    return f"Mitsuba does not import: this system lacks {library}", remedy


def _preload_runtime() -> None:
    """Load what `fix` fetched for Mitsuba itself; should that fail, the import says so."""
    with contextlib.suppress(OSError):
        search.preload(search.runtime())


def _decide() -> LLVM:
    """Choose an LLVM for Dr.Jit, which is not yet imported."""
    if _switched_off():
        return _nothing([_OFF], "Unset it")
    before = os.environ.get(search.VARIABLE)
    library, reasons = _found()
    if library:
        return _adopt(library)
    if _decided and before == search.NONE and _decided.reason not in ("", _OFF):
        return _decided  # still nothing: its reason may name what the user had set the variable to
    from . import fetch

    remedy = f"Run: {_FIX}" if fetch.can_fetch() else f"Run: {_install_command()}"
    return _nothing(reasons, remedy)


def _found() -> tuple[search.Library | None, list[str]]:
    """Look for a usable library: the one that the user names, ours, the system's."""
    given = os.environ.get(search.VARIABLE, "")
    if not given or given == search.NONE:
        return search.find()
    named, reason = search.examine(given)
    if named:
        return named, []
    library, reasons = search.find()
    if library:
        _log.warning("%s=%s; using '%s' instead", search.VARIABLE, reason, library.path)
    return library, [f"{search.VARIABLE}: {reason}", *reasons]


def _adopt(library: search.Library) -> LLVM:
    """Have Dr.Jit use `library`, or say that it is too late for that."""
    global _decided
    if "drjit" in sys.modules:
        now = prepare()
        if now.usable:
            return now
        return LLVM(
            False, library.path, library.version,
            f"LLVM {search.spell(library.version)} is ready, but Dr.Jit was imported without it",
            "Start Python again",
        )  # fmt: skip
    try:
        search.preload(library.preload)
    except OSError as error:
        reason = f"'{library.path}' needs a library that does not load ({error})"
        return _nothing([reason], f"Run: {_FIX}")
    os.environ[search.VARIABLE] = str(library.path)
    _decided = LLVM(True, library.path, library.version)
    return _decided


def _nothing(reasons: list[str], remedy: str) -> LLVM:
    """Keep Dr.Jit from using any LLVM, and say why."""
    global _decided
    if "drjit" not in sys.modules:
        os.environ[search.VARIABLE] = search.NONE
    reason = "; ".join(reasons[:3]) or "no LLVM was found"
    _decided = LLVM(False, reason=reason, remedy=remedy)
    return _decided


def _settled(drjit: Any) -> LLVM:
    """Report on the LLVM that Dr.Jit chose when it was imported."""
    version = tuple(drjit.detail.llvm_version())
    if _switched_off():
        return LLVM(False, None, None, _OFF, "Unset it")
    if not drjit.has_backend(drjit.JitBackend.LLVM):
        if _decided is None:
            reason = "Dr.Jit was imported before prepare() and found no LLVM that it accepts"
            return LLVM(False, None, None, reason, f"{_RESTART}, or run: {_FIX}")
        if not _decided.usable:
            return _decided
        reason = f"Dr.Jit does not accept LLVM {search.spell(_decided.version)} ('{_decided.path}')"
        return LLVM(False, _decided.path, _decided.version, reason, f"Run: {_FIX}")
    given = os.environ.get(search.VARIABLE, "")
    path = Path(given) if given and given != search.NONE else None
    if version[0] >= search.MINIMUM:
        return LLVM(True, path, version)
    reason = (
        f"Dr.Jit was imported before prepare() and has taken LLVM {search.spell(version)}, "
        f"which aborts its kernels (below {search.MINIMUM})"
    )
    return LLVM(False, None, version, reason, f"{_RESTART}, or set {search.VARIABLE}")


def _switched_off() -> bool:
    return os.environ.get("FRESNEL_DECOMP_LLVM", "").lower() in ("off", "0", "no")


def _install_command() -> str:
    """Return the one command that installs an LLVM on this system."""
    if os.environ.get("CONDA_PREFIX"):
        return "conda install -c conda-forge libllvm19"
    import shutil

    commands = {
        "apt-get": "sudo apt-get install libllvm19",
        "dnf": "sudo dnf install llvm-libs",
        "zypper": "sudo zypper install libLLVM19",
        "pacman": "sudo pacman -S llvm-libs",
        "brew": "brew install llvm",
        "winget": "winget install LLVM.LLVM",
    }
    for tool, command in commands.items():
        if shutil.which(tool):
            return command
    return f"install LLVM {search.MINIMUM} or newer, or point {search.VARIABLE} at its libLLVM"


def import_mitsuba() -> tuple[Any, Any]:
    """Import Dr.Jit and Mitsuba after `prepare`; return both.

    Raises
    ------
    ImportError
        With the reason and the remedy, if a system library is missing.
    """
    prepare()
    try:
        with _quiet():
            import drjit
            import mitsuba
    except (ImportError, NameError) as error:
        # drjit/__init__.py hides the loader's complaint behind a NameError
        cause: BaseException | None = error
        while cause and not (missing := search.missing_library(str(cause))):
            cause = cause.__context__
        if cause is None:
            raise
        raise ImportError("{}. {}".format(*_lacking(missing))) from error
    return drjit, mitsuba


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence the two lines that Dr.Jit writes to stderr where we gave it no LLVM on purpose."""
    if os.environ.get(search.VARIABLE) != search.NONE or "drjit" in sys.modules:
        yield
        return
    try:
        saved = os.dup(2)
    except OSError:  # there is no stderr to silence
        yield
        return
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(sink)

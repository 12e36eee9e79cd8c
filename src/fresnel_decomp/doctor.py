"""Which Mitsuba variants work on this machine, and a working LLVM for those that need one.

Dr.Jit chooses its LLVM when it is imported, and kernels compiled with LLVM 15 or 16 end the
interpreter. So `prepare` comes before the first ``import drjit`` or ``import mitsuba``::

    from fresnel_decomp import doctor

    doctor.prepare()
    import mitsuba as mi

    mi.set_variant(doctor.best_variant())

Two environment variables matter: ``FRESNEL_DECOMP_CACHE`` names the folder for a downloaded LLVM
(default ``~/.cache/fresnel_decomp``), and ``FRESNEL_DECOMP_LLVM=off`` has LLVM treated as absent.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ._check import choose, input_error
from ._llvm import search
from ._llvm.choice import LLVM, fix, import_mitsuba, prepare
from ._version import __version__

__all__ = [
    "LLVM",
    "Report",
    "Variant",
    "best_variant",
    "fix",
    "format_report",
    "prepare",
    "report",
    "require_variant",
    "usable_variants",
]


@dataclass(frozen=True)
class Variant:
    """Whether a Mitsuba variant works here, and if not, why and what to do."""

    name: str
    usable: bool
    reason: str = ""
    remedy: str = ""


@dataclass(frozen=True)
class Report:
    """Everything `report` finds out."""

    versions: dict[str, str]
    """Of Python, this package, Mitsuba and Dr.Jit."""
    platform: str
    cache: Path
    llvm: LLVM
    variants: dict[str, Variant] = field(default_factory=dict)
    best: str = ""
    """The variant that is chosen by default; empty if Mitsuba does not import."""
    error: str = ""
    """Why Mitsuba does not import; empty if it does."""


def usable_variants() -> dict[str, Variant]:
    """Tell for every variant of the installed Mitsuba whether it works here.

    Returns
    -------
    dict of str to Variant
        In the order of ``mitsuba.variants()``.

    Raises
    ------
    ImportError
        If Mitsuba does not import; with reason and remedy where a system library is missing.

    Examples
    --------
    >>> from fresnel_decomp import doctor
    >>> doctor.usable_variants()["scalar_rgb"].usable
    True
    """
    dr, mi = import_mitsuba()
    llvm = prepare()  # again: now with Dr.Jit's own word on it
    variants = {}
    for name in mi.variants():
        kind = name.split("_")[0]
        if kind == "scalar":
            variants[name] = Variant(name, True)
        elif kind == "llvm":
            variants[name] = Variant(name, llvm.usable, llvm.reason, llvm.remedy)
        else:
            label = {"cuda": "CUDA", "metal": "Metal"}.get(kind, kind)
            backend = getattr(dr.JitBackend, label, None)
            if backend is not None and dr.has_backend(backend):
                variants[name] = Variant(name, True)
            else:
                remedy = "Update the GPU driver, if there is a GPU, or choose another variant"
                variants[name] = Variant(name, False, f"Dr.Jit finds no usable {label} GPU", remedy)
    return variants


def best_variant(colour: str = "rgb") -> str:
    """Return the fastest variant that works here: CUDA, else LLVM, else scalar.

    Parameters
    ----------
    colour : str
        The last part of the name: "rgb" or "spectral".

    Returns
    -------
    str
        Such as "llvm_ad_rgb".

    Raises
    ------
    InputError
        If Mitsuba has no such variant.
    """
    variants = usable_variants()
    for name in (f"cuda_ad_{colour}", f"llvm_ad_{colour}", f"scalar_{colour}"):
        if name in variants and variants[name].usable:
            return name
    suffixes = [n.removeprefix("scalar_") for n in variants if n.startswith("scalar_")]
    choose("colour", colour, suffixes)
    return f"scalar_{colour}"


def require_variant(name: str) -> None:
    """Do nothing if the variant works here.

    Parameters
    ----------
    name : str
        One of ``mitsuba.variants()``.

    Raises
    ------
    InputError
        If this Mitsuba does not have it, or it cannot run here, with the reason and the remedy.
    """
    variants = usable_variants()
    choose("variant", name, variants)
    if not (variant := variants[name]).usable:
        working = ", ".join(repr(v.name) for v in variants.values() if v.usable)
        raise input_error(
            f"variant '{name}' cannot run here: {variant.reason}", working, variant.remedy
        )


def report() -> Report:
    """Find out what works on this machine; imports Mitsuba, runs no kernel, never aborts."""
    import platform
    from importlib import metadata

    versions = {"python": platform.python_version(), "fresnel_decomp": __version__}
    for package in ("mitsuba", "drjit"):
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    where = f"{platform.system()} {platform.machine()}"
    cache, llvm = search.cache_folder(), prepare()
    try:
        variants, best = usable_variants(), best_variant()
    except ImportError as error:
        return Report(versions, where, cache, llvm, error=str(error))
    return Report(versions, where, cache, prepare(), variants, best)


def format_report(result: Report) -> str:
    """Return a `Report` as text for a terminal, what to do next at its end."""
    llvm = result.llvm
    found = f"{search.spell(llvm.version)}  {llvm.path or ''}".rstrip() if llvm.usable else "none"
    rows = {**result.versions, "platform": result.platform, "LLVM": found}
    lines = [f"{name:<16}{text}" for name, text in rows.items()]
    if result.error:
        return "\n".join([*lines, "", result.error])
    width = max(map(len, result.variants), default=0)
    lines += ["", "variants"]
    for v in result.variants.values():
        lines.append(f"  {v.name:<{width}}  {'works' if v.usable else 'does not work'}")
    lines.append(f"default: {result.best}")
    reasons = {v.reason: v for v in result.variants.values() if not v.usable}
    for reason, variant in reasons.items():
        kind = variant.name.split("_")[0]
        lines += ["", f"{kind}_*: {reason}.", f"  {variant.remedy}"]
    return "\n".join(lines)

"""On what times were taken: processor or GPU, threads, versions."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

from .._version import __version__

__all__ = ["describe_machine", "graphics_card", "machine_facts", "processor", "source_hash"]


def machine_facts(variant: str) -> dict[str, Any]:
    """What runs the kernels of a variant, and the versions, as JSON takes it.

    Examples
    --------
    >>> from fresnel_decomp.bench.machine import machine_facts
    >>> facts = machine_facts("scalar_rgb")
    >>> facts["backend"], facts["threads"]
    ('scalar', None)
    """
    import drjit as dr
    import mitsuba as mi

    backend = variant.partition("_")[0]
    llvm = backend == "llvm"
    return {
        "variant": variant,
        "backend": backend,
        "machine": processor(),
        "cpus": os.cpu_count(),
        "gpu": graphics_card() if backend == "cuda" else None,
        "threads": dr.thread_count() if llvm else None,
        "llvm": ".".join(map(str, dr.detail.llvm_version() or ())) if llvm else None,
        "mitsuba": mi.__version__,
        "drjit": dr.__version__,
        "fresnel_decomp": __version__,
    }


def describe_machine(facts: dict[str, Any]) -> str:
    """The same in a line."""
    device = f", {facts['gpu']}" if facts.get("gpu") else ""
    threads = f", {facts['threads']} threads, LLVM {facts['llvm']}" if facts["threads"] else ""
    return (
        f"{facts['variant']}, {facts['machine']}{device}{threads}, Mitsuba {facts['mitsuba']}, "
        f"Dr.Jit {facts['drjit']}"
    )


def source_hash() -> str:
    """A hash of all of this package's files, code and data: the same for the same results.

    Examples
    --------
    >>> from fresnel_decomp.bench.machine import source_hash
    >>> len(source_hash())
    64
    """
    package = Path(__file__).parent.parent
    found = hashlib.sha256()
    for path in sorted(package.rglob("*")):
        if path.is_file() and path.suffix != ".pyc":
            found.update(f"{path.relative_to(package).as_posix()}\0".encode())
            found.update(hashlib.sha256(path.read_bytes()).digest())
    return found.hexdigest()


def processor() -> str:
    """The processor's name where the system tells it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def graphics_card() -> str:
    """Name of the first NVIDIA GPU, which Dr.Jit takes, and of its driver."""
    query = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"]
    try:
        found = subprocess.run(query, capture_output=True, text=True, check=True, timeout=30)
        name, driver = found.stdout.splitlines()[0].rsplit(",", 1)
        return f"{name.strip()}, driver {driver.strip()}"
    except (OSError, subprocess.SubprocessError, ValueError, IndexError):
        return "a GPU whose name nvidia-smi does not tell"

"""On what times were taken: processor or GPU, threads, versions."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from pathlib import Path
from typing import Any

from .._version import __version__

__all__ = ["describe_machine", "machine_facts"]


def machine_facts(variant: str) -> dict[str, Any]:
    """What runs the kernels of a variant, and the versions, as JSON takes it.

    Examples
    --------
    >>> from fresnel_decomp.mitsuba.machine import machine_facts
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
        "gpu": _gpu() if backend == "cuda" else None,
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


def processor() -> str:
    """The processor's name where the system tells it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _gpu() -> str:
    """The name of the first GPU where its driver tells it."""
    command = shutil.which("nvidia-smi")
    if command is None:
        return "a GPU"
    result = subprocess.run(
        [command, "--query-gpu=name", "--format=csv,noheader"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return result.stdout.strip().partition("\n")[0] or "a GPU"

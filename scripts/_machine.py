"""What a benchmark ran on."""

from __future__ import annotations

import platform
import subprocess
from pathlib import Path

__all__ = ["graphics_card", "processor"]


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

"""What a computer is, as far as speed depends on it; and the memory of a process. No names of computers or users."""

import os
import platform
import sys
from pathlib import Path

_PROC_CPU, _PROC_STATUS = Path("/proc/cpuinfo"), Path("/proc/self/status")


def machine() -> dict[str, str | int | float]:
    """Processor, cores, memory and system."""
    return {
        "processor": _processor(),
        "cores": cores(),
        "memory GiB": _memory(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def cores() -> int:
    """That this process may use, where the system tells."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _processor() -> str:
    if _PROC_CPU.is_file():
        lines = _PROC_CPU.read_text(errors="replace").splitlines()
        names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
        if names:
            return names[0]
    return platform.processor() or platform.machine()


def _memory() -> float:
    """Of the computer; 0 where the system does not tell."""
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1)
    except (AttributeError, ValueError, OSError):
        return 0.0


def peak_memory() -> float | None:
    """MiB that this process has held at most; None where the system does not tell."""
    if _PROC_STATUS.is_file():  # getrusage counts what the parent held when it started this process
        peak = [line for line in _PROC_STATUS.read_text().splitlines() if line.startswith("VmHWM:")]
        if peak:
            return int(peak[0].split()[1]) / 2**10
    if sys.platform == "win32":
        return None
    import resource

    peak_size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak_size / (2**20 if sys.platform == "darwin" else 2**10)

"""What a measurement must carry to be believed: machine, versions, commit, date, spread, and who
else was busy.
"""

import os
import platform
import resource
import statistics
import subprocess
import time
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from dronecombat_jax.machine import backend

ROOT = Path(__file__).parents[1]
PACKAGES = ("numpy", "jax", "jaxlib", "flax", "mujoco", "mujoco-mjx")
# variables that change speed
PREFIXES = ("XLA_", "JAX_", "OPENBLAS_", "OMP_", "MKL_", "DRONECOMBAT_")
SCHEMA = 1


def provenance() -> dict[str, Any]:
    """Where, when and of what: the head of every record."""
    return {
        "schema": SCHEMA,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "machine": {
            "name": backend.machine(),
            "cores": backend.cores(),
            "system": platform.platform(),
        },
        "versions": {
            "python": platform.python_version(),
            **{name: metadata.version(name) for name in PACKAGES},
        },
        "environment": {
            key: value for key, value in sorted(os.environ.items()) if key.startswith(PREFIXES)
        },
    }


def commit() -> str:
    """The checkout's commit, with a + where files differ from it; "unknown" outside a repository."""
    git = lambda *words: (
        subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    )
    try:
        return git("rev-parse", "--short=12", "HEAD").strip() + (
            "+" if git("status", "--porcelain", "-uno") else ""
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def summary(values: list[float]) -> dict[str, Any]:
    """Minimum, median, maximum and the values themselves, in order of time."""
    return {
        "median": statistics.median(values),
        "min": min(values),
        "max": max(values),
        "values": values,
    }


class Load:
    """How many cores others took while we measured: other processes, and the hypervisor ("steal"),
    as Linux tells.
    """

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._before = self._clocks()

    def cores(self) -> dict[str, float] | None:
        """Since the start, in cores; None where it cannot be told. Call it after our own processes
        have ended.
        """
        after = self._clocks()
        if self._before is None or after is None:
            return None
        busy, stolen, own = (now - then for now, then in zip(after, self._before, strict=True))
        seconds = time.monotonic() - self._start
        return {"other_processes": max(0.0, busy - own) / seconds, "hypervisor": stolen / seconds}

    def _clocks(self) -> tuple[float, float, float] | None:
        """Seconds of all cores busy, stolen, and ours and our children's."""
        try:
            words = Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:]
        except OSError:
            return None
        ticks = [int(word) / os.sysconf("SC_CLK_TCK") for word in words]
        usages = [
            resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        ]
        own = sum(usage.ru_utime + usage.ru_stime for usage in usages)
        user, nice, system, _, _, irq, softirq, steal = ticks[:8]
        return user + nice + system + irq + softirq, steal, own

"""What a command does before JAX is imported: it chooses the device and the number of threads.

What does not live here: the choices themselves (`machine.backend`), and those of a training
(`machine.start`).
"""

import os


def rate_on_one_core() -> None:
    """Ratings solve small systems: OpenBLAS's second thread waits a hundred times their length on a
    busy machine.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when NumPy is imported


def prepare(device: str) -> None:
    """Choose the device of a command that does not train: must come before JAX is imported."""
    from dronecombat_jax.machine import backend

    backend.prepare(device, 1)

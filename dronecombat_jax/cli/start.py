"""What a command does before JAX is imported: it chooses the device and the number of threads.

What does not live here: the choices themselves (`machine.backend`), and those of a training
(`machine.start`).
"""

import os


def rate_on_one_core() -> None:
    """Use one thread for ratings: their systems are small, and on a busy machine OpenBLAS's second
    thread waits a hundred times longer than it computes.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when NumPy is imported


def prepare(device: str) -> None:
    """Choose the device of a command that does not train: must come before JAX is imported."""
    from dronecombat_jax.machine import backend

    backend.prepare(device, 1)

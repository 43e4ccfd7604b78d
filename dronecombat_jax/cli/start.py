"""What a command does before JAX is imported: it chooses the device and the number of threads.

What does not live here: the choices themselves (`machine.backend`).
"""

import os

from dronecombat_jax.config import devices
from dronecombat_jax.config.fields import Config


def rate_on_one_core() -> None:
    """Ratings solve small systems: OpenBLAS's second thread waits a hundred times their length on a
    busy machine.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when NumPy is imported


def prepare(device: str, config: Config | None = None) -> None:
    """Choose the device and set XLA's flags: must come before JAX is imported."""
    from dronecombat_jax.machine import backend

    if config is None:
        return backend.prepare(device, 1)
    if config.run.matmul_precision != "default":
        backend.set_matmul_precision(config.run.matmul_precision)
    if config.run.distributed:
        from dronecombat_jax.machine import processes

        return backend.prepare(device, 1, lambda: processes.join(config.run.join_seconds))
    seeds, environments = devices.mesh_shape(
        config.train.num_seeds, config.run.devices, backend.cores()
    )
    backend.prepare(device, seeds * environments)

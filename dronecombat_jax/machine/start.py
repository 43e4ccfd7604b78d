"""What a training needs of JAX and XLA, settled before JAX is imported.

What does not live here: how each of it is settled (`backend`, `processes`).
"""

from dronecombat_jax.config import devices
from dronecombat_jax.config.fields import Config


def prepare_training(config: Config) -> None:
    """Choose devices, precision and, with `run.distributed`, meet the other processes.

    Raises UserError 2 for what cannot be had.
    """
    from dronecombat_jax.machine import backend

    run = config.run
    if run.matmul_precision != "default":
        backend.set_matmul_precision(run.matmul_precision)
    if run.distributed:
        from dronecombat_jax.machine import processes

        return backend.prepare(run.device, 1, lambda: processes.join(run.join_seconds))
    seeds, environments = devices.mesh_shape(config.train.num_seeds, run.devices, backend.cores())
    backend.prepare(run.device, seeds * environments)

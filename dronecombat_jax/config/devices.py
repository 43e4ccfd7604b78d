"""How seeds and environments are spread over devices. Nothing imports JAX.

What does not live here: the mesh itself (`selfplay.mesh`), and whether the devices exist
(`machine.backend`).
"""

import math

from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.opponents import SIDES, live_part

MAX_DEVICES = 1024


def spread(num_seeds: int, wanted: int, available: int) -> int:
    """How many devices share `num_seeds` seeds evenly: `wanted` of them, or as many as possible
    (0).
    """
    most = min(num_seeds, available if wanted == 0 else wanted)
    return next(count for count in range(max(most, 1), 0, -1) if num_seeds % count == 0)


def mesh_shape(num_seeds: int, wanted: int, available: int) -> tuple[int, int]:
    """The number of devices along the seeds, and along the environments of each seed: `wanted` in
    all, or as many as help (0).

    Seeds come first, the same number on each device: they never wait for each other. Environments
    of one seed are spread only where more devices are asked for: on two cores one device does as
    well (docs/scaling.md).
    """
    if wanted == 0:
        return spread(num_seeds, 0, available), 1
    seeds = math.gcd(num_seeds, wanted)
    return seeds, wanted // seeds


def uneven_devices(config: Config, devices: int) -> str:
    """Why `devices` cannot share the work evenly, with the numbers that can; "" where they do."""
    seeds, envs = config.train.num_seeds, config.train.num_envs
    minibatch = config.steps_per_iteration // config.learn.minibatches
    live = [live_part(config, side) for side in range(len(SIDES))]
    steps, cuts = config.learn.rollout_steps, config.learn.minibatches
    if config.learn.memory == "gru":  # mini-batches are environments, whole
        minibatch, steps = envs // cuts, 1
    batches = {(part.stop - part.start) * steps // cuts for part in live}

    def fits(devices: int) -> bool:
        _, each = mesh_shape(seeds, devices, devices)
        return envs % each == 0 and all(batch % each == 0 for batch in (minibatch, *batches))

    if fits(devices):
        return ""
    shared, each = mesh_shape(seeds, devices, devices)
    others = ", ".join(str(batch) for batch in sorted(batches - {minibatch, 0}))
    text = f"{minibatch} (where others fly, too: {others})" if others else f"{minibatch}"
    counts = [str(count) for count in range(1, MAX_DEVICES + 1) if fits(count)]
    near = [count for count in counts if int(count) < devices][-2:] + [
        count for count in counts if int(count) > devices
    ][:2]
    return (
        f"run.devices = {devices}: {shared} for the seeds (train.num_seeds = {seeds}) leave {each} for the environments "
        f"of each, which must divide train.num_envs = {envs} and a mini-batch of {text}; nearest that fit: {', '.join(near)}"
    )

"""What the paper's experiment costs at a scale: time, memory, disk. Estimates, before it starts.

The rates are those of docs/performance.md. Nothing imports JAX; NumPy measures the machine.
"""

import time
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from dronecombat_jax.config.estimates import (
    ACTION_SIZE,
    SIDES,
    bytes_in_words,
    estimated_bytes,
    estimated_disk_bytes,
    free_bytes,
    observation_floats,
)
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.scales import Scale
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError

SHARE_OF_FLOOR = 0.64  # of the matrix products' rate that a whole training reaches on a CPU
OTHER_FLOPS = 0.35e6  # of a step: flight and all that is no product, as so many operations
ITERATION_SECONDS = 0.02  # of a small one: calls, metrics
CHUNK_SECONDS = 0.5  # to save
START_SECONDS = 45.0  # of a step: imports, compilation
FIGHTS_PER_GFLOP = 90.0  # tournament fights a second for each GFLOP/s of the CPU
SEED_FLOPS, DEVICE_FLOPS = 7e12, 30e12  # of a GPU (H100, H200): one seed, and sixteen or more
DEVICE_FIGHTS = 80_000.0  # a second
REPORT_SECONDS_PER_ENTRANT = 0.05
CELL_BYTES = 3.0  # of a fight's outcome on the disk, in its cell and in the result
# In memory while the tournament is rated (a planted one of 1600 x 1600 players x 5: 1.6 GB).
FIGHT_BYTES = 40  # of a fight, played or not
PAIR_BYTES = 80  # of two players: covariances of their ratings
START_BYTES = 400_000_000
CUBE = 1024  # of the product that measures a core


class Cost(NamedTuple):
    """What the whole experiment costs."""

    trainings: Mapping[str, float]  # s, by run
    tournament: float  # s
    report: float  # s
    memory: int  # bytes, at its largest
    disk: int  # bytes, at its end
    steps: int  # environment steps of all runs and seeds
    fights: int

    @property
    def seconds(self) -> float:
        """Seconds for all steps."""
        return sum(self.trainings.values()) + self.tournament + self.report


def cost_of(scale: Scale, configs: Mapping[str, Config], gflops: float, gpu: bool) -> Cost:
    """Estimate from the settings of both runs. `gflops`: of this machine's matrix products, all
    cores; `gpu`: whether a large GPU computes instead.
    """
    config = next(iter(configs.values()))
    seeds, iterations = scale.seeds, scale.chunks * scale.iterations
    steps = config.steps_per_iteration * iterations * seeds
    rate = min(SEED_FLOPS * seeds, DEVICE_FLOPS) if gpu else SHARE_OF_FLOOR * gflops * 1e9
    overhead = iterations * ITERATION_SECONDS * (1 if gpu else seeds)
    trainings = {
        name: START_SECONDS
        + scale.chunks * CHUNK_SECONDS
        + max(steps * (step_flops(run_config) + OTHER_FLOPS) / rate, overhead)
        for name, run_config in configs.items()
    }
    runs = len(configs) * seeds
    entrants, seats = runs * scale.chunks, runs * -(-scale.chunks // scale.every)
    cells = runs * scale.chunks**2 + seats**2 * (runs - 1) // runs
    fights = cells * scale.episodes
    flying = fights / (DEVICE_FIGHTS if gpu else FIGHTS_PER_GFLOP * gflops)
    memory = max(estimated_bytes(run_config) for run_config in configs.values())
    rated = entrants**2 * scale.episodes * FIGHT_BYTES + (2 * entrants) ** 2 * PAIR_BYTES
    disk = sum(estimated_disk_bytes(run_config) for run_config in configs.values())
    return Cost(
        trainings=trainings,
        tournament=START_SECONDS + flying,
        report=START_SECONDS + REPORT_SECONDS_PER_ENTRANT * 2 * entrants,
        memory=max(memory, START_BYTES + rated),
        disk=disk + int(fights * CELL_BYTES),
        steps=len(configs) * steps,
        fights=fights,
    )


def step_flops(config: Config) -> float:
    """Floating-point operations of matrix products for one environment step, the mean of a run.

    A product of n x m weights takes 2 n m; a pass forward in the rollout, and in each epoch one
    forward and two backward, but for the observations, which have no gradient.
    """
    flown, learnt = 0, 0
    for last in (ACTION_SIZE, 1):
        sizes = (observation_floats(config), *config.learn.hidden_sizes, last)
        layers = [2 * rows * columns for rows, columns in pairwise(sizes)]
        flown += sum(layers)
        learnt += config.learn.epochs * (3 * sum(layers) - layers[0])
    return SIDES * flown + sum(learning_shares(config)) * learnt


def learning_shares(config: Config) -> tuple[float, float]:
    """The share of a run's steps that defender and attacker each learn from. The attacker does not
    learn in a chunk in which a past attacker flies; the defender learns neither in a head start nor
    where the attacker flies alone.
    """
    chunks = config.num_chunks
    late = 1.0 - config.head_start_chunks / chunks
    frozen = config.selfplay.probability * late * (chunks - 1) / chunks
    return late * (1.0 - config.train.solo_share), 1.0 - frozen


def measured_gflops(cores: int) -> float:
    """GFLOP/s of single-precision products on all `cores`: that of one core times their number.

    In seconds of its own: what others do on the machine now is not in it.
    """
    import numpy as np

    matrix = np.ones((CUBE, CUBE), np.float32)
    product = np.empty_like(matrix)
    best = float("inf")
    for _ in range(4):
        start = time.thread_time()
        np.matmul(matrix, matrix, out=product)
        best = min(best, time.thread_time() - start)
    return 2e-9 * CUBE**3 / best * cores


def require_disk(cost: Cost, folder: Path) -> None:
    """UserError 73 where the disk of `folder` has less than the experiment needs."""
    free = free_bytes(folder)
    if free is not None and free < cost.disk:
        raise UserError(
            f"{folder}: the experiment needs about {bytes_in_words(cost.disk)} of disk, and "
            f"{bytes_in_words(free)} are free; a smaller --scale, or another folder, needs less",
            EXIT_CANNOT_WRITE,
        )

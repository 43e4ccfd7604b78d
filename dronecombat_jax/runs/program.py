"""The training program of a run on this machine: environment, devices, iterations per call.

What does not live here: what an iteration does (`selfplay.chunk`), the loop over calls
(`training`).
"""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from dronecombat_jax.config import devices
from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.machine import processes
from dronecombat_jax.runs.lowered import compiled

if TYPE_CHECKING:
    import jax

    from dronecombat_jax.runs.opponents import Frozen

Advance = Callable[[Any], tuple[Any, Any]]

# A program call is a few iterations: short enough to answer a signal within seconds on a laptop.
MAX_CALL_ITERATIONS = 5
# environment steps of a seed: on a CPU half a second or more, and a call of its own
LONG_ITERATION = 10_000
# rather than single iterations, whose calls a fast device would wait for
LONGEST_CALL_ITERATIONS = 15


def call_iterations(config: Config) -> int:
    """Iterations per program call: the largest divisor of a chunk up to 5; above 5 where that would
    be 1 or 2.

    On a CPU, one where it is long: progress shows and a signal is heard after each.
    """
    import jax

    if config.steps_per_iteration >= LONG_ITERATION and jax.default_backend() == "cpu":
        return 1
    chunk = config.train.chunk_iterations
    divisors = [n for n in range(1, LONGEST_CALL_ITERATIONS + 1) if chunk % n == 0]
    short, long = (
        [n for n in divisors if n <= MAX_CALL_ITERATIONS],
        [n for n in divisors if n > MAX_CALL_ITERATIONS],
    )
    return long[0] if long and short[-1] <= 2 else short[-1]


class Program:
    """The training program of one run: its environment, its devices, its iterations per call."""

    def __init__(self, config: Config, frozen: "Frozen | None" = None):
        """`frozen`: the policies of the table of opponents.

        Raises UserError 2 for devices or a scene that cannot be had.
        """
        from dronecombat_jax.combat.env import Combat

        self.config = config
        self._cast = frozen.cast(config.game) if frozen else {}
        self._cast_digests = sorted(frozen.digests.items()) if frozen else []
        self.combat = Combat(config)
        self.mesh = seed_devices(config)
        self.iterations = call_iterations(config)

    def compile(self, state: Any) -> Advance:
        """`advance(state) -> (state, metrics)`, `iterations` iterations a call, which takes the
        memory of its argument; `state` is on its devices.
        """
        from dronecombat_jax.selfplay.chunk import build_advance

        return self._compiled("advance", build_advance, state, donate_argnums=0)

    def flight_seconds(self, state: Any) -> float:
        """Measure once how many seconds of an iteration of all seeds are flying; `state` stays as
        it is.
        """
        import jax

        from dronecombat_jax.selfplay.chunk import build_flight

        fly = self._compiled("flight", build_flight, state)
        start = time.monotonic()
        jax.block_until_ready(fly(state))
        return (time.monotonic() - start) / self.iterations

    def _compiled(self, name: str, build: Any, state: Any, **options: Any) -> Any:
        make = lambda: build(self.combat, self.iterations, self.mesh, self._cast)
        return compiled(
            name, self.config, make, state, self.mesh, constants=str(self._cast_digests), **options
        )


def seed_devices(config: Config) -> "jax.sharding.Mesh | None":
    """The devices of a run, by seed and environment; None for a single one.

    Several processes use all their devices. Raises UserError 2 where there are other devices than
    asked for, or they do not divide the work.
    """
    import jax

    from dronecombat_jax.selfplay.mesh import device_mesh

    wanted, available = config.run.devices, jax.device_count()
    if wanted > available:
        raise UserError(f"run.devices = {wanted}: there are {available}", EXIT_CONFIG)
    if processes.count() > 1:
        if wanted not in (0, available):
            raise UserError(
                f"run.devices = {wanted}: the processes have {available}, all of which must take part",
                EXIT_CONFIG,
            )
        wanted = available
        if uneven := devices.uneven_devices(config, available):
            raise UserError(uneven, EXIT_CONFIG)
    seeds, environments = devices.mesh_shape(config.train.num_seeds, wanted, available)
    return device_mesh(seeds, environments) if seeds * environments > 1 else None

"""Ours, measured as the peers are.

    python -m benchmarks.peers.ours duel | one-learner | two-seeds      # asked for its turns on stdin, see `turns`

`duel`: two learners, one seed, one program. `one-learner`: the same while the defender does not
learn yet (the head start), against which brax stands, which trains one role. `two-seeds`: two seeds
on two virtual devices.
"""

import argparse
from dataclasses import replace

from benchmarks.peers.turns import Turns
from dronecombat_jax.config.fields import Config
from dronecombat_jax.machine import backend

FOREVER = 10**12  # environment steps


def main() -> None:
    """Train for ever, in turns."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("variant", choices=("duel", "one-learner", "two-seeds"))
    variant = parser.parse_args().variant
    seeds = 2 if variant == "two-seeds" else 1
    backend.prepare("cpu", cpu_devices=seeds)
    import jax

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.runs.program import seed_devices
    from dronecombat_jax.selfplay.chunk import build_advance, init_state

    config = Config()
    head_start = FOREVER if variant == "one-learner" else 0
    config = replace(
        config, train=replace(config.train, num_seeds=seeds, head_start_steps=head_start)
    )
    combat = Combat(config)
    state = jax.jit(lambda: init_state(combat))()
    program = jax.jit(build_advance(combat, 1, seed_devices(config)), donate_argnums=0)
    turns = Turns(seeds * config.steps_per_iteration)
    while True:
        state, _ = jax.block_until_ready(program(state))
        turns.done()


if __name__ == "__main__":
    main()

"""Fights per second of the round robin on this machine, and what larger tournaments would take.

    python benchmarks/tournament.py [--players 20] [--episodes 5] [--preset duel] [--json FILE]

Untrained policies of the preset's network, each with its own weights, so that nobody is flown once for all. What a
fight costs goes with its length, which training changes: the extrapolation says which length it is for. CPU seconds
are those of this process, over all threads; on idle cores the wall time is that over their number.
"""

import argparse
import json
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager

from dronecombat_jax import backend

SIZES = ((50_000, "100 x 100 x 5"), (1_000_000, "100 x 100 x 100"))


def main() -> None:
    """Read the flags, fly, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--players", type=int, default=20, help="on each side (default %(default)s)")
    parser.add_argument("--episodes", type=int, default=5, help="fights of each pair (default %(default)s)")
    parser.add_argument("--preset", default="duel", help="whose game and network (default %(default)s)")
    parser.add_argument("--json", help="write the figures to this file, too")
    flags = parser.parse_args()
    backend.prepare("cpu")
    figures = measure(flags.players, flags.episodes, flags.preset)
    print(
        f"{figures['fights']:,} fights of {figures['steps_per_fight']:.0f} control steps in {figures['wall_seconds']:.1f} s "
        f"({figures['cpu_seconds']:.1f} CPU seconds on {figures['cores']} cores): "
        f"{figures['fights'] / figures['wall_seconds']:,.0f} fights/s; compiled in {figures['compile_seconds']:.1f} s\n"
        f"{figures['cpu_us_per_step']:.1f} us of CPU per fight and control step; peak memory {figures['peak_mib']:,.0f} MiB"
    )
    lengths = (figures["steps_per_fight"], figures["time_out_steps"])
    for fights, name in SIZES:
        minutes = [fights * steps * figures["cpu_us_per_step"] / 1e6 / 60 / 2 for steps in lengths]
        print(
            f"extrapolated to {name} on 2 idle cores: {minutes[0]:.1f} min at {lengths[0]:.0f} steps a fight, "
            f"{minutes[1]:.1f} min if every fight ran to its time-out of {lengths[1]:.0f} steps"
        )
    if flags.json:
        with open(flags.json, "w") as file:
            json.dump(figures, file, indent=2)


def measure(players: int, episodes: int, preset: str) -> dict[str, float]:
    """Fly `players` x `players` x `episodes` fights, as `dronecombat tournament` does."""
    import jax
    import numpy as np

    from dronecombat_jax import settings
    from dronecombat_jax.arena.players import Player
    from dronecombat_jax.arena.rectangle import Rules
    from dronecombat_jax.arena.tournament import play
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.learn.ippo import init_learner
    from dronecombat_jax.learn.rollout import policy_of

    config = settings.load(preset)
    draw = jax.jit(jax.vmap(lambda key: policy_of(init_learner(key, config.learn))))
    drawn = jax.device_get(draw(jax.random.split(jax.random.key(0), 2 * players)))
    everybody = [Player(f"player {i}", jax.tree.map(lambda leaf, i=i: leaf[i], drawn)) for i in range(2 * players)]
    compiling: list[float] = []
    clocks: list[tuple[float, float]] = []

    @contextmanager
    def timed(what: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        compiling.append(time.perf_counter() - start)
        clocks.append((time.perf_counter(), time.process_time()))

    fights = steps = 0
    for harvest in play(Combat(config), everybody[:players], everybody[players:], Rules(episodes), compiling=timed):
        fights += int(harvest.fights.sum())
        steps += sum(int(np.sum(cell.steps)) for cell in harvest.cells)
    wall, cpu = time.perf_counter() - clocks[0][0], time.process_time() - clocks[0][1]
    return {
        "fights": fights,
        "steps_per_fight": steps / fights,
        "time_out_steps": config.game.episode_steps,
        "wall_seconds": wall,
        "cpu_seconds": cpu,
        "cpu_us_per_step": cpu / steps * 1e6,
        "compile_seconds": sum(compiling),
        "cores": backend.cores(),
        "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


if __name__ == "__main__":
    main()

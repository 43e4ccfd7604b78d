"""Fights per second of the round robin on this machine, and what larger tournaments would take.

    python benchmarks/tournament.py [--players 20] [--episodes 5] [--preset duel] [--json FILE]
    python benchmarks/tournament.py --players 100 --episodes 100            # 1,000,000 fights
    python benchmarks/tournament.py --ratings --players 100 --episodes 100  # all ratings of such a
    result, no fights

Untrained policies of the preset's network, each with its own weights, so that nobody is flown once
for all. What a fight costs goes with its length, which training changes: the extrapolation says
which length it is for. CPU seconds are those of this process, over all threads; on idle cores the
wall time is that over their number.
"""

import argparse
import json
import os
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from dronecombat_jax.machine import backend

SIZES = ((50_000, "100 x 100 x 5"), (1_000_000, "100 x 100 x 100"))


def main() -> None:
    """Read the flags, fly, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--players", type=int, default=20, help="on each side (default %(default)s)"
    )
    parser.add_argument(
        "--episodes", type=int, default=5, help="fights of each pair (default %(default)s)"
    )
    parser.add_argument(
        "--preset", default="duel", help="whose game and network (default %(default)s)"
    )
    parser.add_argument(
        "--ratings", action="store_true", help="time a report's ratings of planted outcomes instead"
    )
    parser.add_argument("--json", help="write the figures to this file, too")
    flags = parser.parse_args()
    if flags.ratings:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as `dronecombat report` does
    backend.prepare("cpu")
    figures = (
        rate(flags.players, flags.episodes)
        if flags.ratings
        else fly(flags.players, flags.episodes, flags.preset)
    )
    if flags.json:
        with open(flags.json, "w") as file:
            json.dump(figures, file, indent=2)


def fly(players: int, episodes: int, preset: str) -> dict[str, float]:
    """Measure the fights and print what they took."""
    figures = measure(players, episodes, preset)
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
    return figures


def rate(players: int, episodes: int) -> dict[str, float]:
    """Time everything that a report computes, bootstraps included, for one run of `players` chunks."""
    import numpy as np
    from scipy.special import expit

    from dronecombat_jax.analysis.result import Entrant, tournament_result
    from dronecombat_jax.analysis.study import study
    from dronecombat_jax.combat.rules import outcome_table
    from dronecombat_jax.config.fields import GameConfig
    from dronecombat_jax.types import Cause

    rng = np.random.default_rng(0)
    x = rng.normal(0, 0.75, (players, 1)) - rng.normal(0, 0.75, players)
    won = rng.random((players, players, episodes)) < expit(x)[..., None]
    cause = np.where(won, Cause.INTERCEPT, Cause.REACHED).astype(np.int8)
    entrants = [
        Entrant(f"player {i}", f"run {i}", "ippo", "run", 0, i, i) for i in range(1, players + 1)
    ]
    result = tournament_result(
        cause, np.full(cause.shape, 50), outcome_table(GameConfig()), entrants, entrants, 0.02
    )
    wall, cpu = time.perf_counter(), time.process_time()
    study(result)
    figures = {
        "fights": cause.size,
        "wall_seconds": time.perf_counter() - wall,
        "cpu_seconds": time.process_time() - cpu,
        "peak_mib": peak_mib(),
    }
    print(
        f"all ratings of {players} x {players} x {episodes} fights, bootstraps included: {figures['wall_seconds']:.1f} s "
        f"({figures['cpu_seconds']:.1f} CPU seconds); peak memory {figures['peak_mib']:,.0f} MiB"
    )
    return figures


def peak_mib() -> float:
    """The most memory that this process has had so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measure(players: int, episodes: int, preset: str) -> dict[str, float]:
    """Fly `players` x `players` x `episodes` fights, as `dronecombat tournament` does."""
    import jax
    import numpy as np

    from dronecombat_jax.arena.players import Player
    from dronecombat_jax.arena.rectangle import Rules
    from dronecombat_jax.arena.round_robin import play
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config import settings
    from dronecombat_jax.learn.ippo import init_learner
    from dronecombat_jax.learn.rollout import policy_of

    config = settings.load(preset)
    draw = jax.jit(jax.vmap(lambda key: policy_of(init_learner(key, config.learn))))
    drawn = jax.device_get(draw(jax.random.split(jax.random.key(0), 2 * players)))
    everybody = [
        Player(f"player {i}", jax.tree.map(lambda leaf, i=i: leaf[i], drawn))
        for i in range(2 * players)
    ]
    compiling: list[float] = []
    clocks: list[tuple[float, float]] = []

    @contextmanager
    def timed(what: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        compiling.append(time.perf_counter() - start)
        clocks.append((time.perf_counter(), time.process_time()))

    fights = steps = 0
    reported, total = time.perf_counter(), players**2 * episodes
    for harvest in play(
        Combat(config), everybody[:players], everybody[players:], Rules(episodes), compiling=timed
    ):
        fights += int(harvest.fights.sum())
        steps += sum(int(np.sum(cell.steps)) for cell in harvest.cells)
        if time.perf_counter() - reported > 30.0:
            reported = time.perf_counter()
            print(
                f"{fights:,} of {total:,} fights after {reported - clocks[0][0]:.0f} s",
                file=sys.stderr,
                flush=True,
            )
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
        "peak_mib": peak_mib(),
    }


if __name__ == "__main__":
    main()

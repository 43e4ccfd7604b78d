"""What a step of a fight between teams costs, beside the duel's: one run, turn by turn.

    python -m benchmarks.teams [--envs 1024] [--steps 50] [--rounds 7] [--teams 1v1 2v2 3v3 8v8]

Prints a Markdown table: steps/s of the environment (random actions, automatic reset) and of its
physics alone, the time of each over the duel's (the median over the rounds of each round's ratio),
the seconds to compile the environment, and the bytes that its program needs beside its arguments.
In each round the programs take turns, so that a machine's slow minute meets them all.
"""

import argparse
import statistics
import time
from typing import Any, NamedTuple

from benchmarks.size import Size

TEAMS = ("1v1", "2v2", "3v3", "8v8")


class Program(NamedTuple):
    """A compiled program and what its compilation took."""

    call: Any
    seconds: float
    mebibytes: float


def main() -> None:
    """Read the flags, compile, take turns, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--envs", type=int, default=1024, help="environments (%(default)s)")
    parser.add_argument("--steps", type=int, default=50, help="of a call (%(default)s)")
    parser.add_argument("--rounds", type=int, default=7, help="%(default)s")
    parser.add_argument("--teams", nargs="+", default=TEAMS, help="the first is compared with")
    flags = parser.parse_args()
    from dronecombat_jax.machine import backend

    backend.prepare("")
    import jax

    size = Size(num_envs=flags.envs, flown_steps=flags.steps)
    programs = {team: _programs(size, team) for team in flags.teams}
    keys = jax.random.split(jax.random.key(0), flags.rounds + 1)
    taken: dict[tuple[str, int], list[float]] = {}
    for turn, key in enumerate(keys):
        for team, both in programs.items():
            for part, program in enumerate(both):
                begin = time.perf_counter()
                jax.block_until_ready(program.call(key))
                if turn:  # the first call warms up
                    taken.setdefault((team, part), []).append(time.perf_counter() - begin)
    print(f"{flags.envs} environments, {flags.rounds} rounds, {jax.devices()[0].device_kind}\n")
    print("| teams | steps/s | time over | physics, steps/s | time over | compiled in | memory |")
    print("|---|---|---|---|---|---|---|")
    for team, (whole, _) in programs.items():
        cells = []
        for part in (0, 1):
            seconds, first = taken[team, part], taken[flags.teams[0], part]
            rate = flags.envs * flags.steps / statistics.median(seconds)
            ratio = statistics.median(t / f for t, f in zip(seconds, first, strict=True))
            cells.append(f"{rate:,.0f} | {ratio:.2f}")
        print(
            f"| {team} | {' | '.join(cells)} | {whole.seconds:.1f} s | {whole.mebibytes:,.0f} MiB |"
        )


def _programs(size: Size, team: str) -> tuple[Program, Program]:
    """The environment, and its physics alone."""
    from benchmarks.stepping import environment, physics
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config import settings

    defenders, attackers = team.split("v")
    given = {"game.defenders": int(defenders), "game.attackers": int(attackers)}
    combat = Combat(settings.load(None, given))
    return _compiled(environment(combat, size)), _compiled(physics(combat, size))


def _compiled(function: Any) -> Program:
    import jax

    begin = time.perf_counter()
    compiled = jax.jit(function).lower(jax.random.key(0)).compile()
    seconds = time.perf_counter() - begin
    memory = compiled.memory_analysis()
    return Program(compiled, seconds, getattr(memory, "temp_size_in_bytes", 0) / 2**20)


if __name__ == "__main__":
    main()

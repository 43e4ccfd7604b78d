"""What a step of a drone that could fly costs, beside the paper's: one run, turn by turn.

    python -m benchmarks.real_drone [--envs 1024] [--steps 100] [--rounds 7]

Prints a Markdown table: environment steps/s on this machine, random actions, automatic reset, and
the time of a step over that of `wrench`, the median over the rounds of each round's ratio. In each
round the programs take turns, so that a machine's slow minute meets them all.
"""

import argparse
import statistics
import time
from typing import Any

from benchmarks.size import Size

CRAFTS: dict[str, dict[str, Any]] = {
    "wrench": {},
    "rotors": {"sim.body": "firmware", "sim.actuation": "rotors"},
    "mixed": {"sim.body": "firmware", "sim.actuation": "mixed"},
    "ctbr": {"sim.body": "firmware", "sim.actuation": "ctbr"},
    "rotors, drag, randomisation": {
        "sim.body": "firmware",
        "sim.actuation": "rotors",
        "sim.drag": True,
        **{f"randomise.{name}": 0.1 for name in ("mass", "inertia", "thrust", "lag", "drag")},
    },
    "the same, gusts and noise": {
        "sim.body": "firmware",
        "sim.actuation": "rotors",
        "sim.drag": True,
        "sim.gust_speed": 1.0,
        "sensor.position_noise": 0.001,
        "sensor.rate_noise": 0.01,
        "sensor.latency": 1,
        **{f"randomise.{name}": 0.1 for name in ("mass", "inertia", "thrust", "lag", "drag")},
    },
}


def main() -> None:
    """Read the flags, compile, take turns, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--envs", type=int, default=1024, help="environments (%(default)s)")
    parser.add_argument("--steps", type=int, default=100, help="of a call (%(default)s)")
    parser.add_argument("--rounds", type=int, default=7, help="%(default)s")
    flags = parser.parse_args()
    from dronecombat_jax.machine import backend

    backend.prepare("")
    import jax

    size = Size(num_envs=flags.envs, flown_steps=flags.steps)
    programs = {name: _program(size, overrides) for name, overrides in CRAFTS.items()}
    keys = jax.random.split(jax.random.key(0), flags.rounds + 1)
    seconds: dict[str, list[float]] = {name: [] for name in programs}
    for turn, key in enumerate(keys):
        for name, program in programs.items():
            begin = time.perf_counter()
            jax.block_until_ready(program(key))
            if turn:  # the first call compiles
                seconds[name].append(time.perf_counter() - begin)
    print(f"{flags.envs} environments, {flags.rounds} rounds, {jax.devices()[0].device_kind}\n")
    print("| drone | steps/s | time over `wrench` |\n|---|---|---|")
    for name, taken in seconds.items():
        rate = flags.envs * flags.steps / statistics.median(taken)
        pairs = zip(taken, seconds["wrench"], strict=True)
        print(f"| {name} | {rate:,.0f} | {statistics.median(t / w for t, w in pairs):.2f} |")


def _program(size: Size, overrides: dict[str, Any]) -> Any:
    import jax

    from benchmarks.stepping import environment
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config import settings

    return jax.jit(environment(Combat(settings.load(None, overrides)), size))


if __name__ == "__main__":
    main()

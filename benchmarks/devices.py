"""One seed on one device, one seed on several, a seed on each: environment steps per second and CPU
seconds.

    python benchmarks/devices.py
    python benchmarks/devices.py --meshes 1x1 1x2 2x1 --repeats 3 --set train.num_envs=4000

Each mesh (seeds x environments) runs in processes of its own, in turns; printed are the best of all
calls, and the least CPU time that an iteration of one seed took, which other work on the machine
disturbs less.
"""

import argparse
import json
import subprocess
import sys
import time

CALLS = 6
ITERATIONS = 2  # of a call
LIMIT_SECONDS = 600.0  # of a process: one that hangs is killed


def main() -> None:
    """Measure every mesh in turn and print one line for each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--meshes", nargs="+", default=["1x1", "1x2", "2x1"])
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument(
        "--set",
        nargs="*",
        default=[],
        metavar="KEY=VALUE",
        help="settings on top of the preset duel",
    )
    parser.add_argument("--one", help=argparse.SUPPRESS)
    args = parser.parse_args()
    given = {key: json.loads(value) for key, _, value in (word.partition("=") for word in args.set)}
    if args.one:
        seeds, environments = map(int, args.one.split("x"))
        print(json.dumps(measure(seeds, environments, given)))
        return
    best: dict[str, tuple[float, float]] = {}
    for _ in range(args.repeats):
        for mesh in args.meshes:
            command = [sys.executable, __file__, "--one", mesh, "--set", *args.set]
            done = subprocess.run(
                command, check=True, stdout=subprocess.PIPE, timeout=LIMIT_SECONDS
            )
            rate, cpu = json.loads(done.stdout.splitlines()[-1])
            old = best.get(mesh, (0.0, float("inf")))
            best[mesh] = max(old[0], rate), min(old[1], cpu)
    for mesh, (rate, cpu) in best.items():
        print(f"{mesh:>6}: {rate:8,.0f} environment steps/s, {cpu:.3f} CPU s an iteration and seed")


def measure(seeds: int, environments: int, given: dict) -> tuple[float, float]:
    """The best rate of several calls, all seeds together, and CPU seconds of an iteration of one
    seed.
    """
    from dronecombat_jax.config import settings
    from dronecombat_jax.machine import backend

    backend.prepare("cpu", seeds * environments)
    import jax

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.selfplay.chunk import build_advance, init_state
    from dronecombat_jax.selfplay.mesh import device_mesh, jitted, place

    config = settings.load("duel", {"train.num_seeds": seeds, "train.head_start_steps": 0} | given)
    combat = Combat(config)
    mesh = device_mesh(seeds, environments) if seeds * environments > 1 else None
    state = place(jax.device_get(jax.jit(lambda: init_state(combat))()), mesh)
    program = (
        jitted(build_advance(combat, ITERATIONS, mesh), state, mesh, donate_argnums=0)
        .lower(state)
        .compile()
    )
    state, _ = jax.block_until_ready(program(state))
    wall, cpu = [], []
    for _ in range(CALLS):
        start, used = time.perf_counter(), time.process_time()
        state, _ = jax.block_until_ready(program(state))
        wall.append(time.perf_counter() - start)
        cpu.append(time.process_time() - used)
    steps = config.steps_per_iteration * ITERATIONS * seeds
    return steps / min(wall), min(cpu) / (ITERATIONS * seeds)


if __name__ == "__main__":
    main()

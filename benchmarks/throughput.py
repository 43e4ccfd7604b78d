"""Throughput side by side with this machine's own matrix-product rate, in one run.

    python benchmarks/throughput.py [--json FILE]

Each figure comes from a process of its own, one after the other, so that compile times are cold where
they say so and memory is that of one program. Rates are environment steps (2 physics steps) per second;
the ratio sets them against the float32 rate of a 2048-cube product, measured in the same run.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time

# Matrix products per environment step at paper settings: four networks forward in the rollout, five
# epochs forward and backward, no gradient for the first layers' input.
MFLOP_PER_STEP = 5.0
PARTS = ("matmul", "environment", "ippo")


def matmul() -> dict[str, float]:
    """float32 rate of a 2048-cube product in GFLOP/s: NumPy's BLAS and XLA, best of 10."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    size = 2048
    left = np.random.default_rng(0).standard_normal((size, size), dtype=np.float32)
    product = jax.jit(lambda a: a @ a)
    on_device = jnp.asarray(left)
    product(on_device).block_until_ready()
    gflop = 2 * size**3 / 1e9
    return {
        "numpy_gflops": gflop / best(lambda: left @ left, 10),
        "xla_gflops": gflop / best(lambda: product(on_device).block_until_ready(), 10),
    }


def environment(num_envs: int = 1000, steps: int = 200) -> dict[str, float]:
    """Environment with automatic reset and random actions, no learning."""
    import jax
    import jax.numpy as jnp

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config import Config
    from dronecombat_jax.types import EnvState

    combat = Combat(Config())

    def fly(env: EnvState, key: jax.Array) -> tuple[EnvState, jax.Array]:
        action_key, spawn_key = jax.random.split(key)
        actions = jax.random.uniform(action_key, (steps, num_envs, 2, 4), minval=-1.0, maxval=1.0)

        def step(env: EnvState, random: tuple[jax.Array, jax.Array]) -> tuple[EnvState, jax.Array]:
            action, draw = random
            after, output = jax.vmap(combat.step)(env, action)
            done = output.terminated | output.truncated
            choose = lambda new, old: jnp.where(done.reshape(-1, *[1] * (new.ndim - 1)), new, old)
            return jax.tree.map(choose, jax.vmap(combat.spawn)(draw), after), output.reward.sum()

        return jax.lax.scan(step, env, (actions, combat.draw(spawn_key, (steps, num_envs))))

    env = jax.jit(jax.vmap(combat.spawn))(combat.draw(jax.random.key(0), (num_envs,)))
    start = time.perf_counter()
    program = jax.jit(fly).lower(env, jax.random.key(1)).compile()
    compile_seconds = time.perf_counter() - start
    seconds = best(lambda: jax.block_until_ready(program(env, jax.random.key(1))), 5)
    return {"steps_per_second": steps * num_envs / seconds, "compile_seconds": compile_seconds}


def ippo(calls: int = 6) -> dict[str, float]:
    """The training program at paper settings: two learners, 256-128, 5 epochs, 1000 environments."""
    import jax

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config import Config
    from dronecombat_jax.runs.program import call_iterations
    from dronecombat_jax.selfplay.chunk import build_advance, init_state

    config = Config()
    combat = Combat(config)
    start = time.perf_counter()
    state = jax.jit(lambda: init_state(combat))()
    program = jax.jit(build_advance(combat, call_iterations(config)), donate_argnums=0).lower(state).compile()
    compile_seconds = time.perf_counter() - start
    rates = []
    for _ in range(calls):
        start = time.perf_counter()
        state, _ = jax.block_until_ready(program(state))
        rates.append(call_iterations(config) * config.steps_per_iteration / (time.perf_counter() - start))
    return {"steps_per_second": max(rates[1:]), "compile_seconds": compile_seconds}


def best(call, times: int) -> float:
    """Seconds of the fastest of `times` calls."""
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def measure(part: str) -> None:
    """Run one part in this process and print its figures as JSON."""
    from dronecombat_jax import backend

    backend.prepare("cpu")
    figures = {"matmul": matmul, "environment": environment, "ippo": ippo}[part]()
    figures["resident_mib"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps(figures))


def main() -> None:
    """Measure every part in its own process, with a cold compile cache, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", help="write the figures to this file, too")
    parser.add_argument("--part", choices=PARTS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        measure(options.part)
        return
    figures = {}
    for part in PARTS:
        with tempfile.TemporaryDirectory() as cache:
            command = [sys.executable, __file__, "--part", part]
            done = subprocess.run(
                command, env={**os.environ, "DRONECOMBAT_CACHE": cache}, capture_output=True, text=True, check=False
            )
        if done.returncode:
            sys.exit(f"{part} failed:\n{done.stderr}")
        figures[part] = json.loads(done.stdout.splitlines()[-1])
    gflops = max(figures["matmul"]["numpy_gflops"], figures["matmul"]["xla_gflops"])
    floor = 1000 * gflops / MFLOP_PER_STEP
    rate = figures["ippo"]["steps_per_second"]
    figures["ratios"] = {"matmul_bound_steps_per_second": floor, "ippo_over_bound": rate / floor}
    figures["ratios"]["ippo_at_150_gflops"] = rate * 150 / gflops
    print(
        f"2048-cube product    numpy {figures['matmul']['numpy_gflops']:.0f}, XLA {figures['matmul']['xla_gflops']:.0f} GFLOP/s"
    )
    for part in ("environment", "ippo"):
        row = figures[part]
        print(
            f"{part:<20} {row['steps_per_second']:>9,.0f} steps/s   compile {row['compile_seconds']:.1f} s cold   "
            f"peak memory {row['resident_mib']:,.0f} MiB"
        )
    print(
        f"IPPO / matmul bound  {rate / floor:.2f} of {floor:,.0f} steps/s; at 150 GFLOP/s: {rate * 150 / gflops:,.0f} steps/s"
    )
    if options.json:
        with open(options.json, "w") as file:
            json.dump(figures, file, indent=2)


if __name__ == "__main__":
    main()

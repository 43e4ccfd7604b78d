"""What the hot path is made of, and its alternatives: the numbers of docs/tuning.md.

    taskset -c 1 python -m benchmarks.tuning products | update | values | physics | environment

One core. Seconds are CPU time of this process, so that what else the machine does costs caches and
clock but is not counted; the alternatives take turns, and the best turn of each counts. Set
XLA_FLAGS to compare flags.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

BATCH, STEPS, ENVS = 4000, 24, 1000
ROUNDS = 6


def race(programs: dict[str, Callable[[], Any]], rounds: int = ROUNDS) -> dict[str, float]:
    """CPU seconds of each program: the best of `rounds`, taken in turns after one call to warm up."""
    import jax

    seconds = {name: float("inf") for name in programs}
    for turn in range(rounds + 1):
        for name, call in programs.items():
            start = time.process_time()
            jax.block_until_ready(call())
            if turn:
                seconds[name] = min(seconds[name], time.process_time() - start)
    return seconds


def normal(*shape: int) -> Any:
    """Standard normal numbers, the same in every run."""
    import jax

    return jax.random.normal(jax.random.key(len(shape)), shape)


def products() -> None:
    """Rate of one mini-batch's matrix products, batch first and features first, beside a 2048-cube."""
    import jax

    def product(
        left: tuple[int, ...], right: tuple[int, ...], axes: tuple[int, int]
    ) -> tuple[Any, float]:
        a, b = normal(*left), normal(*right)
        contract = jax.jit(
            lambda a, b: jax.lax.dot_general(a, b, (((axes[0],), (axes[1],)), ((), ())))
        )
        gflop = 2 * a.size * b.shape[1 - axes[1]] / 1e9
        return lambda: contract(a, b), gflop

    cases = {"2048-cube": product((2048, 2048), (2048, 2048), (1, 0))}
    for fan_in, fan_out in ((35, 256), (256, 128), (128, 4)):
        x, y, w = (BATCH, fan_in), (BATCH, fan_out), (fan_in, fan_out)
        name = f"{fan_in}-{fan_out}"
        cases[f"{name} forward, batch first"] = product(x, w, (1, 0))
        cases[f"{name} forward, features first"] = product(w, x[::-1], (0, 0))
        cases[f"{name} input gradient, batch first"] = product(y, w, (1, 1))
        cases[f"{name} input gradient, features first"] = product(w, y[::-1], (1, 0))
        cases[f"{name} weight gradient, batch first"] = product(x, y, (0, 0))
        cases[f"{name} weight gradient, features first"] = product(x[::-1], y[::-1], (1, 1))
    for name, seconds in race({name: call for name, (call, _) in cases.items()}, 12).items():
        print(f"{name:<42} {1e3 * seconds:8.3f} ms {cases[name][1] / seconds:6.0f} GFLOP/s")


def update() -> None:
    """One mini-batch of one learner at paper settings: loss, gradient and step, in the layouts and
    with either ELU.
    """
    import jax
    import jax.numpy as jnp

    from dronecombat_jax.config.fields import LearnConfig
    from dronecombat_jax.learn import ippo, networks, optimize
    from dronecombat_jax.types import Batch

    learn = LearnConfig()
    learner = ippo.init_learner(jax.random.key(0), learn)
    scalar = normal(STEPS, ENVS)
    action, ones = 0.3 * normal(STEPS, ENVS, 4), jnp.ones((STEPS, ENVS))
    batch = Batch(normal(STEPS, ENVS, 35), action, scalar - 5.0, scalar, scalar, scalar, ones, ones)

    def batch_first(elu: Callable[[Any], Any]) -> Callable[[Any, Any], Any]:
        def forward(mlp: Any, columns: Any) -> Any:
            x = columns.T
            for weight, bias in zip(mlp.weights[:-1], mlp.biases[:-1], strict=True):
                x = elu(x @ weight + bias)
            return (x @ mlp.weights[-1] + mlp.biases[-1]).T

        return forward

    ours = networks.forward_columns
    variants = {
        "batch first, jax.nn.elu": batch_first(jax.nn.elu),
        "batch first, our elu": batch_first(networks.elu),
        "features first, our elu": ours,
    }
    programs: dict[str, Callable[[], Any]] = {}
    for name, forward in variants.items():
        optimize.forward_columns = forward
        program = jax.jit(
            lambda state, all_of_it: optimize.optimize(learn, state, all_of_it, jax.random.key(0))
        )
        program = program.lower(learner, batch).compile()
        programs[name] = lambda program=program: program(learner, batch)
    optimize.forward_columns = ours
    square = jnp.ones((2048, 2048))
    cube = jax.jit(lambda a: a @ a)
    seconds = race({"cube": lambda: cube(square)} | programs)
    print(f"2048-cube: {2 * 2048**3 / seconds.pop('cube') / 1e9:.0f} GFLOP/s")
    gradient_steps = learn.epochs * learn.minibatches
    # forward, weight gradient and, from the second layer on, input gradient; policy (4 outputs) and
    # value (1)
    gflop = 2 * 2 * BATCH * (2 * 35 * 256 + 3 * 256 * 128 + 3 * 128 * 2.5) / 1e9
    for name, spent in seconds.items():
        each = spent / gradient_steps
        print(f"{name:<28} {1e3 * each:6.2f} ms a mini-batch {gflop / each:6.0f} GFLOP/s")


def values() -> None:
    """Values of a rollout's states, all T N at once against step by step, in us per environment
    step.
    """
    import jax

    from dronecombat_jax.config.fields import LearnConfig
    from dronecombat_jax.learn.networks import forward, init_parameters

    mlp = init_parameters(jax.random.key(0), LearnConfig()).value
    seen = normal(STEPS, ENVS, 35)
    at_once = jax.jit(lambda x: forward(mlp, x))
    by_step = jax.jit(lambda x: jax.lax.map(lambda row: forward(mlp, row), x))
    for name, spent in race(
        {"at once": lambda: at_once(seen), "step by step": lambda: by_step(seen)}
    ).items():
        print(f"{name:<14} {1e6 * spent / (STEPS * ENVS):.3f} us")


def physics(repeat: int = 100) -> None:
    """One physics step of the lean model, by `mjx.step` and as we fly it, and what the stages of
    `mjx.step` add to each other.

    In us per environment.
    """
    import jax
    import jax.numpy as jnp
    from mujoco.mjx._src import forward, smooth, support

    from dronecombat_jax.config.fields import SimConfig
    from dronecombat_jax.sim.physics import build_physics, load_mjx
    from dronecombat_jax.sim.scene import load_scene

    scene = load_scene(SimConfig())
    mjx, model, template = load_mjx(scene)
    advance = build_physics(scene)
    level = jnp.asarray([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0] * 2)
    qpos, qvel = level + 0.1 * normal(ENVS, 14), normal(ENVS, 12)
    stages = {
        "kinematics": lambda d: smooth.kinematics(model, d),
        "com_pos": lambda d: smooth.com_pos(model, d),
        "crb": lambda d: smooth.crb(model, d),
        "factor_m": lambda d: smooth.factor_m(model, d),
        "com_vel": lambda d: smooth.com_vel(model, d),
        "rne": lambda d: smooth.rne(model, d),
        "solve_m": lambda d: d.replace(qacc=smooth.solve_m(model, d, d.qfrc_applied - d.qfrc_bias)),
        "xfrc_accumulate": lambda d: d.replace(qacc=d.qacc + support.xfrc_accumulate(model, d)),
        "euler": lambda d: forward.euler(model, d),
    }

    def start(qpos: Any, qvel: Any) -> Any:
        return template.replace(qpos=qpos, qvel=qvel, qfrc_applied=0.001 * qvel)

    def whole(qpos: Any, qvel: Any) -> tuple[Any, Any]:
        data = mjx.step(model, start(qpos, qvel))
        return data.qpos, data.qvel

    def chained(count: int) -> Callable[[Any, Any], Any]:
        def stage(qpos: Any, qvel: Any) -> Any:
            data = start(qpos, qvel)
            for call in list(stages.values())[:count]:
                data = call(data)
            return jax.tree.map(lambda new, old: new if new is not old else None, data, template)

        return stage

    def repeated(step: Callable[[Any, Any], Any]) -> Callable[[], Any]:
        def loop(qpos: Any, qvel: Any) -> Any:
            def again(carry: Any, _: None) -> tuple[Any, None]:
                # the carry keeps XLA from doing it once
                out = jax.vmap(step)(qpos + carry[0], qvel + carry[0])
                return (1e-20 * jax.tree.leaves(out)[0].ravel()[0], out), None

            first = (jnp.float32(0.0), jax.vmap(step)(qpos, qvel))
            return jax.lax.scan(again, first, None, length=repeat)[0]

        program = jax.jit(loop).lower(qpos, qvel).compile()
        return lambda: program(qpos, qvel)

    steps = {
        "mjx.step": whole,
        "sim/physics.py": lambda qpos, qvel: advance(qpos, qvel, 0.001 * qvel),
    }
    steps |= {f"up to {name}": chained(i + 1) for i, name in enumerate(stages)}
    for name, spent in race({name: repeated(step) for name, step in steps.items()}, 4).items():
        print(f"{name:<22} {1e6 * spent / repeat / ENVS:.3f} us")


def environment() -> None:
    """The environment's step and the two substeps in it, each with its random numbers, in us per
    environment step.
    """
    import jax

    from benchmarks import stepping
    from benchmarks.size import Size
    from dronecombat_jax.combat.env import Combat

    size, key = Size(), jax.random.key(0)
    combat, programs = Combat(size.config()), {}
    for build in (stepping.environment, stepping.physics):
        program = jax.jit(build(combat, size)).lower(key).compile()
        programs[build.__name__] = lambda program=program: program(key)
    for name, spent in race(programs).items():
        print(f"{name:<14} {1e6 * spent / size.flown_steps / size.num_envs:.3f} us")


def main() -> None:
    """Run one of them."""
    parts = {
        "products": products,
        "update": update,
        "values": values,
        "physics": physics,
        "environment": environment,
    }
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=parts)
    chosen = parser.parse_args().part
    from dronecombat_jax.machine import backend

    backend.prepare("cpu")
    parts[chosen]()


if __name__ == "__main__":
    main()

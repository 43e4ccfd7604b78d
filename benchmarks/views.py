"""How much of the core's speed each view for another library keeps, side by side in one process.

    python -m benchmarks.views [--fights 1000] [--rounds 5] [--json FILE]

A step is one control step of one fight. The core is the environment in one compiled scan with random
actions and automatic reset. brax's and JaxMARL's views are flown in such a scan, as those libraries'
learners do, Gymnasium's one call a step, Stable-Baselines3's through its own protocol, PettingZoo's
one fight at a time. Where there is an opponent it holds one action. In every round each is flown
once, every other round in reverse order; shares are of the core's rate in the same round. A view
whose library is not installed is left out and named.
"""

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.record import Load, provenance
from dronecombat_jax.errors import UserError
from dronecombat_jax.machine import backend

CORE = "core"
ALONE = 300  # steps of the view that flies one fight
Fly = Callable[[], int]  # flies, and says how many steps of a fight that were


def main() -> int:
    """Read the flags, measure, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--fights", type=int, default=1000, help="side by side (%(default)s)")
    parser.add_argument("--steps", type=int, default=100, help="in a round (%(default)s)")
    parser.add_argument("--rounds", type=int, default=5, help="repetitions (%(default)s)")
    parser.add_argument("--json", type=Path, help="where to write the record")
    flags = parser.parse_args()
    if min(flags.fights, flags.steps, flags.rounds) < 1:
        parser.error("--fights, --steps and --rounds must be at least 1")
    backend.prepare("cpu")
    record = measure(flags.fights, flags.steps, flags.rounds)
    print(table(record))
    if flags.json:
        flags.json.parent.mkdir(parents=True, exist_ok=True)
        flags.json.write_text(json.dumps(record, indent=1) + "\n")
    return 0


def measure(fights: int, steps: int, rounds: int) -> dict[str, Any]:
    """Steps per second of every part in every round, and what was left out."""
    load, parts, left_out = Load(), {}, {}
    for name, build in BUILDERS.items():
        try:
            parts[name] = build(fights, steps)
        except UserError as error:
            left_out[name] = error.message
            continue
        parts[name]()  # compiles
    rates: dict[str, list[float]] = {name: [] for name in parts}
    for number in range(rounds):
        for name in list(parts) if number % 2 == 0 else reversed(parts):
            begun = time.perf_counter()
            flown = parts[name]()
            rates[name].append(flown / (time.perf_counter() - begun))
    size = {"fights": fights, "steps": steps, "rounds": rounds}
    return provenance() | size | {"rates": rates, "left_out": left_out, "load": load.cores()}


def table(record: dict[str, Any]) -> str:
    """Medians, and of the shares minimum and maximum over rounds."""
    rates = record["rates"]
    lines = ["| view | steps/s | share of the core's | least to most |", "|---|---|---|---|"]
    for name, values in rates.items():
        shares = [value / core for value, core in zip(values, rates[CORE], strict=True)]
        middle = statistics.median(shares)
        spread = f"{min(shares):.3g} to {max(shares):.3g}"
        lines.append(f"| {name} | {statistics.median(values):,.0f} | {middle:.3g} | {spread} |")
    lines += [f"left out: {name} ({reason})" for name, reason in record["left_out"].items()]
    return "\n".join(lines)


def game() -> Any:
    """The default duel."""
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config.fields import Config

    return Combat(Config())


def hold(state: Any, observation: Any, key: Any) -> Any:
    """An opponent that costs nothing."""
    import jax.numpy as jnp

    return jnp.zeros((state.clock.shape[0], 4))


def scanned(step: Callable, start: Any, per_step: Any, flown: int) -> Fly:
    """Flies a compiled scan of `step` from `start`."""
    import jax

    program = jax.jit(lambda carry, inputs: jax.lax.scan(step, carry, inputs))

    def fly() -> int:
        jax.block_until_ready(program(start, per_step))
        return flown

    return fly


def random_actions(shape: tuple[int, ...]) -> np.ndarray:
    """Random actions in [-1, 1]."""
    return np.random.default_rng(0).uniform(-1.0, 1.0, shape).astype(np.float32)


def core(fights: int, steps: int) -> Fly:
    """The environment itself, as a rollout flies it: the numbers of new fights are made before the scan."""
    import jax
    import jax.numpy as jnp

    combat = game()

    def step(env: Any, inputs: tuple) -> tuple:
        action, numbers = inputs
        after, output = jax.vmap(combat.step)(env, action)
        done = output.terminated | output.truncated
        choose = lambda new, old: jnp.where(done.reshape(-1, *[1] * (new.ndim - 1)), new, old)
        following = jax.tree.map(choose, jax.vmap(combat.spawn)(numbers), after)
        seen = jax.vmap(combat.observe)(following)
        return following, output.reward.sum() + output.observation.sum() + seen.sum()

    @jax.jit
    def program(start: Any, actions: jax.Array, key: jax.Array) -> tuple:
        return jax.lax.scan(step, start, (actions, combat.start_numbers(key, (steps, fights))))

    start = jax.vmap(combat.spawn)(combat.start_numbers(jax.random.key(0), (fights,)))
    actions = random_actions((steps, fights, 2, 4))

    def fly() -> int:
        jax.block_until_ready(program(start, actions, jax.random.key(1)))
        return fights * steps

    return fly


def brax(fights: int, steps: int) -> Fly:
    """Through the wrapper that brax's learners use."""
    import jax

    from dronecombat_jax.adapters.brax_env import CombatEnv, wrap

    combat = game()
    env = wrap(CombatEnv(combat, 1, hold), combat.config.game.episode_steps)
    start = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(0), fights))

    def step(state: Any, action: Any) -> tuple:
        state = env.step(state, action)
        return state, state.reward.sum() + state.obs.sum()

    return scanned(step, start, random_actions((steps, fights, 4)), fights * steps)


def jaxmarl(fights: int, steps: int) -> Fly:
    """`jax.vmap(env.step)` with a key for each fight."""
    import jax

    from dronecombat_jax.adapters.jaxmarl_env import CombatMultiAgentEnv

    env = CombatMultiAgentEnv(game())
    _, start = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), fights))

    def step(carry: tuple, action: Any) -> tuple:
        state, key = carry
        key, step_key = jax.random.split(key)
        keys = jax.random.split(step_key, fights)
        actions = {"defender": action[:, 0], "attacker": action[:, 1]}
        seen, state, reward, _, infos = jax.vmap(env.step)(keys, state, actions)
        shown = jax.tree.leaves((seen, reward, infos["final_observation"]))
        return (state, key), sum(leaf.sum() for leaf in shown)

    actions = random_actions((steps, fights, 2, 4))
    return scanned(step, (start, jax.random.key(1)), actions, fights * steps)


def gymnasium_in(mode: str) -> Callable[[int, int], Fly]:
    """The vector environment in one of its autoreset modes."""

    def build(fights: int, steps: int) -> Fly:
        from dronecombat_jax.adapters.gymnasium_env import CombatVectorEnv

        env, actions = (
            CombatVectorEnv(game(), 1, hold, fights, mode),
            random_actions((steps, fights, 4)),
        )
        env.reset(seed=0)

        def fly() -> int:
            for action in actions:
                env.step(action)
            return fights * steps

        return fly

    return build


def sb3(fights: int, steps: int) -> Fly:
    """The vector environment through Stable-Baselines3's protocol."""
    from dronecombat_jax.adapters.gymnasium_env import CombatVectorEnv
    from dronecombat_jax.adapters.sb3_env import to_sb3  # may raise before the view is built

    env = to_sb3(CombatVectorEnv(game(), 1, hold, fights, "SAME_STEP"))
    actions = random_actions((steps, fights, 4))
    env.reset()

    def fly() -> int:
        for action in actions:
            env.step(action)
        return fights * steps

    return fly


def pettingzoo(fights: int, steps: int) -> Fly:
    """One fight after the other; `fights` and `steps` say nothing here."""
    from dronecombat_jax.adapters.pettingzoo_env import CombatParallelEnv

    env, actions = CombatParallelEnv(game()), random_actions((ALONE, 2, 4))
    env.reset(seed=0)

    def fly() -> int:
        for defender, attacker in actions:
            env.step({"defender": defender, "attacker": attacker})
            if not env.agents:
                env.reset()
        return ALONE

    return fly


BUILDERS: dict[str, Callable[[int, int], Fly]] = {
    CORE: core,
    "brax": brax,
    "JaxMARL": jaxmarl,
    "Gymnasium VectorEnv, SAME_STEP": gymnasium_in("SAME_STEP"),
    "Gymnasium VectorEnv, NEXT_STEP": gymnasium_in("NEXT_STEP"),
    "Stable-Baselines3 VecEnv": sb3,
    "PettingZoo, one fight": pettingzoo,
}


if __name__ == "__main__":
    sys.exit(main())

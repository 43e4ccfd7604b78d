"""Do the peers play our game? One control step from the same states with the same actions, beside
`Combat.step`.

    python -m benchmarks.peers.check

The states are 512 fights after up to 40 random steps, some put where something is about to happen:
two drones close by, an attacker near the target, drones near the ground, clocks near the end. Exits
with 1 where anything differs by more than float32 explains: an observation by 2e-4 (a rate of 50
rad/s is known to 4e-6), a reward by 2e-3 of up to 300, an end.
"""

import sys

from dronecombat_jax.machine import backend

backend.prepare("cpu")

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

from benchmarks.peers.c_mujoco import QPOS, QVEL, Duel  # noqa: E402
from benchmarks.peers.full_data import FullCombat, FullState  # noqa: E402
from dronecombat_jax.combat.env import Combat  # noqa: E402
from dronecombat_jax.config.fields import Config  # noqa: E402
from dronecombat_jax.types import Cause, EnvState, StepOutput  # noqa: E402

NUM_FIGHTS, RANDOM_STEPS = 512, 40
OBSERVATION_TOLERANCE, REWARD_TOLERANCE = 2e-4, 2e-3


def situations(combat: Combat) -> tuple[EnvState, np.ndarray]:
    """Fights [N] in every phase, and the actions [N, 2, 4] to step them with."""
    random = np.random.default_rng(0)
    keys = jax.random.split(jax.random.key(0), NUM_FIGHTS)
    state = jax.jit(jax.vmap(combat.reset))(keys)
    step = jax.jit(jax.vmap(combat.step))
    flown_steps = random.integers(0, RANDOM_STEPS, NUM_FIGHTS)
    for t in range(RANDOM_STEPS):
        action = random.uniform(-1, 1, (NUM_FIGHTS, 2, 4)).astype(np.float32)
        action[..., 0] = random.uniform(-0.2, 0.5, (NUM_FIGHTS, 2))  # most stay in the air
        after, output = step(state, action)
        on = (t < flown_steps) & (np.asarray(output.cause) == Cause.NONE)
        state = jax.tree.map(
            lambda new, old, on=on: np.where(on.reshape(-1, *[1] * (new.ndim - 1)), new, old),
            after,
            state,
        )
    qpos, quarter = np.array(state.qpos), NUM_FIGHTS // 8
    near = random.uniform(-0.5, 0.5, (quarter, 3))
    qpos[:quarter, :3] = qpos[:quarter, 7:10] + near  # in and about the interception radius
    qpos[quarter : 2 * quarter, 7:10] = np.asarray(state.target)[quarter : 2 * quarter] + near
    qpos[2 * quarter : 4 * quarter, 2] = random.uniform(0.15, 0.3, 2 * quarter)
    qpos[3 * quarter : 5 * quarter, 9] = random.uniform(0.15, 0.3, 2 * quarter)
    clock = np.array(state.clock)
    clock[1::4] = combat.config.game.episode_steps - random.integers(1, 3, len(clock[1::4]))
    state = state.replace(qpos=jnp.asarray(qpos), clock=jnp.asarray(clock))
    return state, random.uniform(-1.3, 1.3, (NUM_FIGHTS, 2, 4)).astype(np.float32)


def differences(
    name: str, ours: StepOutput, observation, reward, terminated, truncated
) -> list[str]:
    """Lines that say what differs; `observation` [N, 35] counts where no fight ended."""
    over = np.asarray(ours.terminated | ours.truncated)
    apart = {
        "observation": (
            np.abs(observation - ours.observation[:, 0])[~over].max(),
            OBSERVATION_TOLERANCE,
        ),
        "reward": (np.abs(reward - ours.reward).max(), REWARD_TOLERANCE),
        "terminated": (np.sum(terminated != ours.terminated), 0),
        "truncated": (np.sum(truncated != ours.truncated), 0),
    }
    print(
        f"{name}: " + ", ".join(f"{what} {float(value):.2g}" for what, (value, _) in apart.items())
    )
    return [
        f"{name}: {what} differs by {value}, {most} allowed"
        for what, (value, most) in apart.items()
        if not value <= most
    ]


def main() -> None:
    """Compare both, and say what was compared."""
    config = Config()
    combat = Combat(config)
    state, action = situations(combat)
    ours = jax.tree.map(np.asarray, jax.jit(jax.vmap(combat.step))(state, action)[1])
    causes = {
        Cause(int(cause)).name.lower(): int(count)
        for cause, count in zip(*np.unique(ours.cause, return_counts=True), strict=True)
    }
    print(f"{NUM_FIGHTS} fights: {causes}")
    missing = {
        "intercept",
        "reached",
        "defender_crash",
        "attacker_crash",
        "both_crash",
        "timeout",
    } - causes.keys()
    faults = (
        [f"no fight ended by {', '.join(sorted(missing))}: nothing is proved"] if missing else []
    )

    duel = Duel(config, NUM_FIGHTS, threads=2)
    duel.state[:, QPOS], duel.state[:, QVEL], duel.target[:], duel.clock[:] = (
        state.qpos,
        state.qvel,
        state.target,
        state.clock,
    )
    out = duel.step(action)
    faults += differences("C MuJoCo", ours, *out)

    full = FullCombat(combat)
    keys = jax.random.split(jax.random.key(1), NUM_FIGHTS)
    start: FullState = jax.vmap(full.reset)(keys)[1]
    start = start.replace(
        data=start.data.replace(qpos=state.qpos, qvel=state.qvel),
        target=state.target,
        clock=state.clock,
    )
    _, reward, cause = jax.jit(jax.vmap(full.fly))(start, action)
    observation = jax.jit(jax.vmap(full.step))(keys, start, action)[0]
    timeout = np.asarray(cause) == Cause.TIMEOUT
    faults += differences(
        "full mjx.Data", ours, observation, reward, (cause != Cause.NONE) & ~timeout, timeout
    )
    if faults:
        sys.exit("\n".join(faults))


if __name__ == "__main__":
    main()

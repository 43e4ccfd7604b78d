"""How closely exported policies agree with the run's own on what they see in fights: NumPy, JAX,
exact sums.

python benchmarks/policy_agreement.py runs/ippo [seed index]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from dronecombat_jax.machine import backend

FIGHTS = 64


def main(path: Path, index: int) -> None:
    backend.prepare("cpu")
    import jax

    from dronecombat_jax.files.rundir import RunDirectory
    from dronecombat_jax.learn.mates import only
    from dronecombat_jax.learn.rollout import policy_mean
    from dronecombat_jax.policies.file import save_policy
    from dronecombat_jax.policies.numpy_policy import NumpyPolicy
    from dronecombat_jax.runs.evaluation import load_run, policies
    from dronecombat_jax.runs.export import policy_of_run
    from dronecombat_jax.types import ATTACKER, SIDES

    run = load_run(path)
    seen = observations(run, policies(run, index))
    solo = run.config.game.scenario == "solo"
    for role in [SIDES[ATTACKER]] if solo else SIDES:
        first = run.config.train.seed
        policy, info = policy_of_run(run, RunDirectory(path), role, first + index)
        policy = only(policy, "this comparison")
        with tempfile.TemporaryDirectory() as folder:
            save_policy(Path(folder) / "policy.safetensors", policy, info)
            alone = NumpyPolicy(Path(folder) / "policy.safetensors")
        observation = seen[:, :, SIDES.index(role)].reshape(-1, seen.shape[-1])
        ours = np.asarray(
            jax.jit(lambda x, policy=policy: policy_mean(run.config.learn, policy, x))(observation)
        )
        exact, theirs = float64_mean(alone, observation), alone(observation)
        print(
            f"{role}: {len(observation):,} observations, largest number in an action {np.abs(ours).max():.2f}"
        )
        for name, a, b in (("NumPy - JAX", theirs, ours), ("JAX - exact", ours, exact)):
            raw, flown = np.abs(a - b).max(), np.abs(np.clip(a, -1, 1) - np.clip(b, -1, 1)).max()
            print(f"  {name}: {flown:.1e} as flown, {raw:.1e} before the clip to [-1, 1]")


def observations(run, pair) -> np.ndarray:
    """[T, E, A, 35] of fights between the two policies; after a fight's end its last one repeats."""
    import jax

    from dronecombat_jax.arena.match import policy_pilot, record, start_fights

    def fly(pair, key):
        start_key, fight_key = jax.random.split(key)
        start = start_fights(run.combat, start_key, FIGHTS)
        defender, attacker = (
            policy_pilot(run.config.learn, policy, role) for role, policy in enumerate(pair)
        )
        flown = record(run.combat, defender, attacker, start, fight_key)
        see = lambda state, qpos, qvel: run.combat.observe(state.replace(qpos=qpos, qvel=qvel))
        return jax.vmap(lambda qpos, qvel: jax.vmap(see)(start, qpos, qvel))(flown.qpos, flown.qvel)

    return np.asarray(jax.jit(fly)(pair, jax.random.key(0)))


def float64_mean(policy, observation: np.ndarray) -> np.ndarray:
    """The policy's sums in float64, on what it sees after scaling in float32."""
    x = observation
    if policy.normalize:
        x = np.clip((x - policy.mean) / policy.scale, -policy.clip, policy.clip)
    for i, (weight, bias) in enumerate(policy.layers):
        x = x.astype(float) @ weight.astype(float) + bias
        x = x if i == len(policy.layers) - 1 else np.where(x > 0, x, np.expm1(np.minimum(x, 0)))
    return x


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)

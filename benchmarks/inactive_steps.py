"""Does what a drone did while it was down move its policy? One update of a run's defender, as it is
and redrawn.

    python -m benchmarks.inactive_steps RUN --chunk 6 --seeds 5

From a checkpoint of RUN one rollout is flown. Then the defender's update is computed twice: from
the rollout, and from the rollout with other actions, and their log-probabilities, in the steps in
which the defender lay on the ground. Printed is the cosine between the two steps of the policy's
parameters for each `learn.inactive_steps`; 1 is right.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from dronecombat_jax.machine import backend

backend.prepare("cpu")

import jax  # noqa: E402 - after prepare
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

from dronecombat_jax.config.fields import LearnConfig  # noqa: E402
from dronecombat_jax.learn.algorithms import without  # noqa: E402
from dronecombat_jax.learn.ippo import update_learner  # noqa: E402
from dronecombat_jax.learn.rollout import act, collect, policy_of, select  # noqa: E402
from dronecombat_jax.runs.evaluation import SavedRun, load_run, policies  # noqa: E402
from dronecombat_jax.types import DEFENDER, Learner, Transition  # noqa: E402


def rollout_of(run: SavedRun, key: jax.Array) -> Transition:
    """One rollout of the first seed's live players in the fights under way, without those that fly
    alone.
    """
    fights = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), run.state.env)
    noise, spawn = jax.random.split(key)
    fly = jax.jit(lambda fights, both: collect(run.combat, both, fights, noise, spawn)[1])
    return without(run.config.solo_envs, fly(fights, policies(run, 0)))


def redrawn(run: SavedRun, rollout: Transition, key: jax.Array) -> Transition:
    """The same with the defender's actions in idle steps drawn again, from its own policy."""
    steps, envs = rollout.clock.shape
    seen = rollout.observation.reshape(steps * envs, *rollout.observation.shape[2:])
    noise = jax.random.normal(key, (steps * envs, *rollout.action.shape[2:]))
    action, log_prob, _ = jax.jit(lambda both: act(run.config.learn, both, seen, noise))(
        policies(run, 0)
    )
    idle = rollout.idle.at[..., 1].set(False)
    return rollout._replace(
        action=jnp.where(idle[..., None], action.reshape(rollout.action.shape), rollout.action),
        log_prob=jnp.where(idle, log_prob.reshape(rollout.log_prob.shape), rollout.log_prob),
    )


def policy_step(learn: LearnConfig, learner: Learner, rollout: Transition) -> np.ndarray:
    """By how much one update moves the policy's parameters."""
    after, _ = jax.jit(
        lambda learner, flown: update_learner(learn, learner, flown, DEFENDER, jax.random.key(0))
    )(learner, rollout)
    flat = lambda learner: np.concatenate(
        [np.ravel(x) for x in jax.tree.leaves(policy_of(learner).network)]
    )
    return flat(after) - flat(learner)


def main() -> None:
    """Print one line for each seed and value of `learn.inactive_steps`."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("run", type=Path)
    parser.add_argument("--chunk", type=int, default=None)
    parser.add_argument("--seeds", type=int, default=3, help="random repetitions")
    given = parser.parse_args()
    run = load_run(given.run, given.chunk)
    learner = select(jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), run.state.learners), DEFENDER)
    print(f"{given.run}, iteration {run.iteration}")
    for seed in range(given.seeds):
        fly, draw = jax.random.split(jax.random.key(seed))
        rollout = rollout_of(run, fly)
        other = redrawn(run, rollout, draw)
        share = float(jnp.mean(rollout.idle[..., DEFENDER]))
        for steps in ("all", "value", "none"):
            learn = replace(run.config.learn, inactive_steps=steps)
            a, b = (policy_step(learn, learner, flown) for flown in (rollout, other))
            cosine = float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
            print(
                f"seed {seed}: down {share:.2f}, inactive_steps {steps:<5} cosine {cosine:.4f}",
                flush=True,
            )


if __name__ == "__main__":
    main()

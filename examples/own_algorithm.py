"""A learner of one's own: random search that keeps a change of the policy where it paid.

What it holds is its own business: here the best policy, what it earned, and the change on trial.
Self-play, checkpoints, tournaments and replays see its policy alone.

dronecombat train --preset smoke --learn.algorithm own_algorithm:RANDOM_SEARCH
"""

import jax
import jax.numpy as jnp
from flax import struct

import dronecombat_jax as dc
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn.algorithms import Algorithm
from dronecombat_jax.learn.networks import init_parameters
from dronecombat_jax.learn.normalize import init_scaler
from dronecombat_jax.types import Policy, Transition, UpdateMetrics


class Searcher(struct.PyTreeNode):
    """One side; all leaves are arrays."""

    best: Policy
    trial: Policy  # what flies
    earned: jax.Array  # [] mean reward of `best`


def init(key: jax.Array, learn: LearnConfig, observation_size: int) -> Searcher:
    """An untrained policy, and nothing earned."""
    parameters = init_parameters(key, learn, observation_size)
    scaler = init_scaler((observation_size,))
    policy = Policy(parameters.policy, parameters.log_std, scaler)
    return Searcher(best=policy, trial=policy, earned=jnp.asarray(-1e9))


def learn(
    learn: LearnConfig, searcher: Searcher, rollout: Transition, side: int, key: jax.Array
) -> tuple[Searcher, UpdateMetrics]:
    """Keep the policy on trial if it earned more, and try a new change."""
    earned = jnp.mean(rollout.reward[:, :, side])
    better = earned > searcher.earned
    best = jax.tree.map(lambda new, old: jnp.where(better, new, old), searcher.trial, searcher.best)
    leaves, structure = jax.tree.flatten(best.network)
    keys = jax.random.split(key, len(leaves))
    moved = [x + 0.02 * jax.random.normal(k, x.shape) for k, x in zip(keys, leaves, strict=True)]
    trial = best.replace(network=jax.tree.unflatten(structure, moved))
    unknown = dict.fromkeys(UpdateMetrics._fields, jnp.full((), jnp.nan))
    unknown |= {"skipped": jnp.zeros((), jnp.int32)}
    earned = jnp.maximum(earned, searcher.earned)
    return Searcher(best=best, trial=trial, earned=earned), UpdateMetrics(**unknown)


def policy(searcher: Searcher) -> Policy:
    """What flies; any leading axes."""
    return searcher.trial


def adopt(searcher: Searcher, policy: Policy) -> Searcher:
    """Go on from another policy."""
    return searcher.replace(best=policy, trial=policy)


RANDOM_SEARCH = Algorithm(init=init, learn=learn, policy=policy, adopt=adopt)


def main(preset: str = "smoke") -> None:
    """Train with it."""
    changes = {
        "run.name": "own-algorithm",
        "run.video": False,
        "learn.algorithm": "own_algorithm:RANDOM_SEARCH",
    }
    print(dc.train(preset, changes))


if __name__ == "__main__":
    main()

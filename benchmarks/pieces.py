"""The pieces of a training iteration as functions of one seed: same shapes as in training, made-up
numbers.

Each takes what it computes on as arguments: XLA would compute on constants while it compiles. What
an iteration takes besides them (observations, rules, rewards, resets, random numbers, sums) is the
rest.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.learn.algorithms import learn_from
from dronecombat_jax.learn.ippo import init_learner
from dronecombat_jax.learn.rollout import act, collect, policy_of, select
from dronecombat_jax.sim.flight import build_step
from dronecombat_jax.types import (
    ACTION_SIZE,
    ATTACKER,
    DEFENDER,
    NUM_SIDES,
    OBSERVATION_SIZE,
    Learner,
)

Piece = tuple[Callable[..., Any], tuple]  # a function, and what to call it with


def physics(combat: Combat) -> Piece:
    """A rollout's substeps, and nothing else."""
    config, fly_one = combat.config, build_step(combat.config.sim, combat.scene)
    start = jax.vmap(combat.spawn)(
        combat.start_numbers(jax.random.key(0), (config.train.num_envs,))
    )

    def fly(qpos: jax.Array, qvel: jax.Array, actions: jax.Array) -> Any:
        step = lambda carry, action: (jax.vmap(fly_one)(carry[0], carry[1], action), carry)
        return jax.lax.scan(step, (qpos, qvel), actions)

    return fly, (start.qpos, start.qvel, 0.1 * _normal(combat, ACTION_SIZE))


def policy(combat: Combat) -> Piece:
    """A rollout's actions of both agents, and nothing else."""
    learn = combat.config.learn

    def fly(learners: Learner, observation: jax.Array, noise: jax.Array) -> Any:
        policies = policy_of(select(learners, DEFENDER)), policy_of(select(learners, ATTACKER))
        step = lambda carry, seen: (carry, act(learn, policies, *seen))
        return jax.lax.scan(step, None, (observation, noise))[1]

    return fly, (_learners(combat), _normal(combat, OBSERVATION_SIZE), _normal(combat, ACTION_SIZE))


def learning(combat: Combat) -> Piece:
    """Values, advantages and the update of both learners, on a rollout in which fights end about as
    often as in training.
    """
    learners, key = _learners(combat), jax.random.key(1)
    env = jax.vmap(combat.spawn)(combat.start_numbers(key, (combat.config.train.num_envs,)))
    policies = policy_of(select(learners, DEFENDER)), policy_of(select(learners, ATTACKER))
    rollout = jax.eval_shape(lambda env: collect(combat, policies, env, key, key)[1], env)
    fill = lambda leaf: _fill(key, leaf)
    rollout = jax.tree.map(fill, rollout)
    ends = jax.random.uniform(key, rollout.terminated.shape)
    rollout = rollout._replace(
        terminated=ends < 0.01, truncated=ends > 1 - 1 / combat.config.game.episode_steps
    )

    def learn(learners: Learner, rollout: Any, seed: jax.Array) -> Any:
        return learn_from(
            combat.config.learn, learners, rollout, jax.random.key(seed), jnp.ones(NUM_SIDES, bool)
        )

    return learn, (learners, rollout, jnp.zeros((), jnp.uint32))


PIECES: dict[str, Callable[[Combat], Piece]] = {
    "physics": physics,
    "policy": policy,
    "learning": learning,
}


def for_seeds(arguments: tuple, num_seeds: int) -> tuple:
    """The same for every seed: leaves [S, ...]."""
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (num_seeds, *leaf.shape)), arguments)


def _learners(combat: Combat) -> Learner:
    return jax.vmap(lambda key: init_learner(key, combat.config.learn))(
        jax.random.split(jax.random.key(0), NUM_SIDES)
    )


def _normal(combat: Combat, width: int) -> jax.Array:
    """[T, N, A, width]."""
    shape = (
        combat.config.learn.rollout_steps,
        combat.config.train.num_envs,
        len(combat.config.game.sides),
        width,
    )
    return jax.random.normal(jax.random.key(0), shape)


def _fill(key: jax.Array, leaf: jax.ShapeDtypeStruct) -> jax.Array:
    if jnp.issubdtype(leaf.dtype, jnp.floating):
        return jax.random.normal(key, leaf.shape, leaf.dtype)
    return jnp.zeros(leaf.shape, leaf.dtype)

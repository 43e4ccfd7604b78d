"""Proximal policy optimisation of one side: advantages from a rollout, then gradient steps.

What does not live here: that both sides do it, each on its own (`algorithms`), and the steps
(`optimize`).
"""

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn import ppo
from dronecombat_jax.learn.networks import (
    forward,
    init_parameters,
    project_log_std,
)
from dronecombat_jax.learn.normalize import (
    denormalize,
    init_scaler,
    normalize,
    update_scaler,
    with_fixed_slots,
)
from dronecombat_jax.learn.optimize import optimize, optimizer
from dronecombat_jax.learn.rollout import scaled
from dronecombat_jax.types import (
    OBSERVATION_SIZE,
    Batch,
    Learner,
    Policy,
    Transition,
    UpdateMetrics,
)


def init_learner(
    key: jax.Array,
    learn: LearnConfig,
    observation_size: int = OBSERVATION_SIZE,
    critic_size: int | None = None,
) -> Learner:
    """One side before training; `critic_size`: length of what a central critic sees."""
    parameters = init_parameters(key, learn, observation_size, critic_size)
    parameters = project_log_std(parameters, learn)
    return Learner(
        parameters=parameters,
        optimizer=optimizer(learn).init(parameters),
        observation_scaler=with_fixed_slots(learn, init_scaler((observation_size,))),
        value_scaler=init_scaler(()),
        learning_rate=jnp.asarray(learn.learning_rate, jnp.float32),
        critic_scaler=None if critic_size is None else init_scaler((critic_size,)),
    )


def update_learner(
    learn: LearnConfig, learner: Learner, rollout: Transition, agent: int, key: jax.Array
) -> tuple[Learner, UpdateMetrics]:
    """Update one agent on its own part of the rollout; statistics of what is observed move
    afterwards, once.
    """
    observation = rollout.observation[:, :, agent]
    value, next_value = estimate_values(learn, learner, rollout, agent)
    weight, value_weight = step_weights(learn, rollout, agent)

    def counted(leaf: jax.Array) -> jax.Array:
        """The values that have weight, 0 elsewhere: a value without weight may be anything, such as
        an action of NaN.
        """
        return jnp.where(weight.reshape(*weight.shape, *[1] * (leaf.ndim - 2)) > 0.0, leaf, 0.0)

    learner, batch = prepare_batch(
        learn,
        learner,
        observation=scaled(learn, learner.observation_scaler, observation),
        action=counted(rollout.action[:, :, agent]),
        log_prob=counted(rollout.log_prob[:, :, agent]),
        reward=rollout.reward[:, :, agent],
        value=value,
        next_value=next_value,
        terminated=rollout.terminated,
        truncated=rollout.truncated,
        weight=weight,
        value_weight=value_weight,
    )
    if learner.critic_scaler is not None:
        assert rollout.whole is not None
        whole = rollout.whole[:, :, agent]
        batch = batch._replace(whole=scaled(learn, learner.critic_scaler, whole))
        scaler = update_scaler(learner.critic_scaler, whole, value_weight)
        learner = learner.replace(critic_scaler=scaler)
    learner, metrics = optimize(learn, learner, batch, key)
    scaler = update_scaler(learner.observation_scaler, observation, weight)
    scaler = with_fixed_slots(learn, scaler)
    return learner.replace(observation_scaler=scaler), metrics


def step_weights(
    learn: LearnConfig, rollout: Transition, agent: int
) -> tuple[jax.Array, jax.Array]:
    """What each step weighs for one agent's policy and for its value function, both [T, N] and 0 or
    1.

    A step in which its action had no effect teaches a policy nothing. But the return of the step in
    which a drone goes down holds what comes later, as the value function sees it; so that goes on
    learning (`learn.inactive_steps`). A step with an action that was not finite, or whose physics
    diverged, teaches neither.
    """
    active, idle = rollout.active[:, :, agent], rollout.idle[:, :, agent]
    policy = active | idle if learn.inactive_steps == "all" else active
    value = active if learn.inactive_steps == "none" else active | idle
    return policy.astype(jnp.float32), value.astype(jnp.float32)


def estimate_values(
    learn: LearnConfig, learner: Learner, rollout: Transition, agent: int
) -> tuple[jax.Array, jax.Array]:
    """Value of every state and of every state's successor, both [T, N] on the reward's scale.

    The successor of a truncated step is its final observation; else the next step's value serves.
    A central critic values whole states in the place of observations.
    """
    seen, final, scaler = rollout.observation, rollout.final_observation, learner.observation_scaler
    if learner.critic_scaler is not None:
        assert rollout.whole is not None and rollout.final_whole is not None
        seen, final, scaler = rollout.whole, rollout.final_whole, learner.critic_scaler

    def evaluate(seen: jax.Array) -> jax.Array:
        value = forward(learner.parameters.value, scaled(learn, scaler, seen))[..., 0]
        return denormalize(learner.value_scaler, value) if learn.normalize_values else value

    # Step by step: activations of N fights stay in the cache, those of T N do not (3 x faster on a
    # CPU).
    value = jax.lax.map(evaluate, seen[:, :, agent])
    final = final[:, :, agent]
    following = jnp.concatenate([value[1:], evaluate(final[-1])[None]])
    if not learn.bootstrap_timeout:
        return value, following

    # An environment is truncated once in a rollout, or never, unless fights are shorter than
    # rollouts: one pass over the environments for each time that one of them was.
    times = jnp.cumsum(rollout.truncated, axis=0)

    def bootstrap(time: jax.Array, following: jax.Array) -> jax.Array:
        here = rollout.truncated & (times == time + 1)
        step = jnp.argmax(here, axis=0)
        seen = jnp.take_along_axis(final, step[None, :, None], axis=0)[0]
        return jnp.where(here, evaluate(seen), following)

    return value, jax.lax.fori_loop(0, jnp.max(times[-1]), bootstrap, following)


def prepare_batch(
    learn: LearnConfig,
    learner: Learner,
    *,
    observation: jax.Array,
    action: jax.Array,
    log_prob: jax.Array,
    reward: jax.Array,
    value: jax.Array,
    next_value: jax.Array,
    terminated: jax.Array,
    truncated: jax.Array,
    weight: jax.Array,
    value_weight: jax.Array,
) -> tuple[Learner, Batch]:
    """Advantages and normalised value targets; all arguments [T, N, ...], `observation` already
    scaled.

    The value scaler takes in the old values, then the returns, and normalises each right after, as
    skrl does. Without `bootstrap_timeout` a truncated step counts as an end.
    """
    ends = terminated if learn.bootstrap_timeout else terminated | truncated
    done = terminated | truncated
    advantage = ppo.generalized_advantages(
        reward, value, next_value, ends, done, learn.discount, learn.gae_lambda
    )
    target = advantage + value
    if learn.normalize_values:
        scaler = update_scaler(learner.value_scaler, value, value_weight)
        value = normalize(scaler, value)
        scaler = update_scaler(scaler, target, value_weight)
        target = normalize(scaler, target)
        learner = learner.replace(value_scaler=scaler)
    advantage = ppo.normalize_advantages(advantage, weight)
    return learner, Batch(
        observation, action, log_prob, advantage, value, target, weight, value_weight
    )


def adopt(learner: Learner, policy: Policy) -> Learner:
    """The learner with another policy and its observation scaler; critic, optimiser and rate
    stay.
    """
    parameters = learner.parameters.replace(policy=policy.network, log_std=policy.log_std)
    return learner.replace(parameters=parameters, observation_scaler=policy.observation_scaler)

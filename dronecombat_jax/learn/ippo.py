"""Proximal policy optimisation of one side: advantages from a rollout, then gradient steps.

What does not live here: that both sides do it, each on its own (`algorithms`), and the steps
(`optimize`).
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn import ppo
from dronecombat_jax.learn.memory import remember
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
from dronecombat_jax.learn.rollout import policy_of, scaled
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

    seen = scaled(learn, learner.observation_scaler, observation)
    recall = None if rollout.recall is None else rollout.recall[:, :, agent]
    recurrent = learner.parameters.gru is not None
    inputs = seen if recurrent else remember(policy_of(learner), seen, recall)[0]
    learner, batch = prepare_batch(
        learn,
        learner,
        observation=inputs,
        action=counted(rollout.action[:, :, agent]),
        log_prob=counted(rollout.log_prob[:, :, agent]),
        reward=_taught(rollout)[:, :, agent],
        value=value,
        next_value=next_value,
        terminated=rollout.terminated,
        truncated=rollout.truncated,
        weight=weight,
        value_weight=value_weight,
    )
    if learn.teachers[agent] and learn.teacher_scale and rollout.lesson is not None:
        batch = batch._replace(lesson=counted(rollout.lesson[:, :, agent]))
    if recurrent:
        batch = batch._replace(recall=recall, fresh=_begins(rollout))
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


def _taught(rollout: Transition) -> jax.Array:
    """The reward that is learnt from, [T, N, A]."""
    return rollout.reward if rollout.progress is None else rollout.reward + rollout.progress


def _begins(rollout: Transition) -> jax.Array:
    """Where a step is the first of a fight that began within the rollout, [T, N] bool."""
    done = rollout.terminated | rollout.truncated
    return jnp.concatenate([jnp.zeros_like(done[:1]), done[:-1]])


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
    """
    seen, final, recall = _shown(learner, rollout, agent)
    evaluate = partial(_value, learn, learner)

    def succeeding(pick: Callable[[jax.Array], jax.Array]) -> jax.Array:
        """The value of what steps led to, picked out of leaves [T, N, ...]."""
        now, then, before = jax.tree.map(pick, (seen, final, recall))
        return evaluate(then, _after(learn, learner, now, before))

    # Step by step: activations of N fights stay in the cache, those of T N do not (3 x faster on a
    # CPU).
    value = jax.lax.map(lambda step: evaluate(*step), (seen, recall))
    following = jnp.concatenate([value[1:], succeeding(lambda leaf: leaf[-1])[None]])
    if not learn.bootstrap_timeout:
        return value, following

    # An environment is truncated once in a rollout, or never, unless fights are shorter than
    # rollouts: one pass over the environments for each time that one of them was.
    times = jnp.cumsum(rollout.truncated, axis=0)

    def bootstrap(time: jax.Array, following: jax.Array) -> jax.Array:
        here = rollout.truncated & (times == time + 1)
        step = jnp.argmax(here, axis=0)
        pick = lambda leaf: jnp.take_along_axis(leaf, step[None, :, None], axis=0)[0]
        return jnp.where(here, succeeding(pick), following)

    return value, jax.lax.fori_loop(0, jnp.max(times[-1]), bootstrap, following)


def _shown(
    learner: Learner, rollout: Transition, agent: int
) -> tuple[jax.Array, jax.Array, jax.Array | None]:
    """What one agent's value function is shown before and after each step, [T, N, ...], and what is
    remembered before it.

    A central critic is shown whole states, and needs no memory.
    """
    if learner.critic_scaler is None:
        shown = rollout.observation, rollout.final_observation, rollout.recall
    else:
        shown = rollout.whole, rollout.final_whole, None
    return jax.tree.map(lambda leaf: leaf[:, :, agent], shown)


def _value(
    learn: LearnConfig, learner: Learner, seen: jax.Array, recall: jax.Array | None
) -> jax.Array:
    """Value [...] on the reward's scale of what is shown, `seen` [..., size], and remembered."""
    if learner.critic_scaler is None:
        inputs, _ = remember(
            policy_of(learner), scaled(learn, learner.observation_scaler, seen), recall
        )
    else:
        inputs = scaled(learn, learner.critic_scaler, seen)
    value = forward(learner.parameters.value, inputs)[..., 0]
    return denormalize(learner.value_scaler, value) if learn.normalize_values else value


def _after(
    learn: LearnConfig, learner: Learner, seen: jax.Array, recall: jax.Array | None
) -> jax.Array | None:
    """What is remembered after a step in which `seen` [..., size] was observed."""
    if recall is None:
        return None
    return remember(policy_of(learner), scaled(learn, learner.observation_scaler, seen), recall)[1]


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
    parameters = learner.parameters.replace(
        policy=policy.network, log_std=policy.log_std, gru=policy.gru
    )
    return learner.replace(parameters=parameters, observation_scaler=policy.observation_scaler)

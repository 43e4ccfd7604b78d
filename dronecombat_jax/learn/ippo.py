"""Learning from a rollout by IPPO: estimate advantages, update each learner on its own."""

from typing import Any

import jax
import jax.numpy as jnp
import optax

from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn import ppo
from dronecombat_jax.learn.networks import (
    forward,
    forward_columns,
    gaussian_entropy,
    gaussian_log_prob,
    init_parameters,
    project_log_std,
)
from dronecombat_jax.learn.normalize import denormalize, init_scaler, normalize, update_scaler
from dronecombat_jax.learn.rollout import scaled, select
from dronecombat_jax.learn.sharding import along_environments
from dronecombat_jax.types import (
    DEFENDER,
    NUM_AGENTS,
    OBSERVATION_SIZE,
    Batch,
    Learner,
    Parameters,
    Transition,
    UpdateMetrics,
)


def optimizer(learn: LearnConfig) -> Any:
    """Joint global-norm clip, then Adam's direction (an optax transformation); `optimize` applies the rate."""
    return optax.chain(optax.clip_by_global_norm(learn.max_grad_norm), optax.scale_by_adam(eps=1e-8))


def init_learner(key: jax.Array, learn: LearnConfig) -> Learner:
    """One agent before training."""
    parameters = project_log_std(init_parameters(key, learn), learn)
    return Learner(
        parameters=parameters,
        optimizer=optimizer(learn).init(parameters),
        observation_scaler=init_scaler((OBSERVATION_SIZE,)),
        value_scaler=init_scaler(()),
        learning_rate=jnp.asarray(learn.learning_rate, jnp.float32),
    )


def learn_from(
    learn: LearnConfig,
    learners: Learner,
    rollout: Transition,
    key: jax.Array,
    learning: jax.Array,
    solo_envs: int = 0,
) -> tuple[Learner, UpdateMetrics]:
    """Update each agent that is `learning` [A] bool on its own part of the rollout; leaves [A, ...].

    An agent that does not learn keeps every bit of its state. One that learns must have flown itself; in the
    first `solo_envs` environments the defender has not.
    """
    results = []
    for agent in range(NUM_AGENTS):
        shuffle_key = jax.random.fold_in(key, agent)
        own = without(solo_envs, rollout) if agent == DEFENDER else rollout
        results.append(_update_if(learning[agent], learn, select(learners, agent), own, agent, shuffle_key))
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *results)


def without(solo_envs: int, rollout: Any) -> Any:
    """The environments of `rollout`, leaves [T, N, ...], in which both fly: all but the first `solo_envs`."""
    return jax.tree.map(lambda leaf: leaf[:, solo_envs:], rollout) if solo_envs else rollout


def _update_if(
    learning: jax.Array, learn: LearnConfig, learner: Learner, rollout: Transition, agent: int, key: jax.Array
) -> tuple[Learner, UpdateMetrics]:
    def update(learner: Learner) -> tuple[Learner, UpdateMetrics]:
        return update_learner(learn, learner, rollout, agent, key)

    def skip(learner: Learner) -> tuple[Learner, UpdateMetrics]:
        blank = dict.fromkeys(UpdateMetrics._fields, jnp.zeros(()))
        return learner, UpdateMetrics(**blank | {"skipped": jnp.zeros((), jnp.int32)})

    return jax.lax.cond(learning, update, skip, learner)


def update_learner(
    learn: LearnConfig, learner: Learner, rollout: Transition, agent: int, key: jax.Array
) -> tuple[Learner, UpdateMetrics]:
    """Update one agent on its own part of the rollout; observation statistics move afterwards, once."""
    observation = rollout.observation[:, :, agent]
    value, next_value = estimate_values(learn, learner, rollout, agent)
    weight, value_weight = step_weights(learn, rollout, agent)

    def counted(leaf: jax.Array) -> jax.Array:
        """0 where there is no weight: what stands there may be anything, such as an action of NaN."""
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
    learner, metrics = optimize(learn, learner, batch, key)
    scaler = update_scaler(learner.observation_scaler, observation, weight)
    return learner.replace(observation_scaler=scaler), metrics


def step_weights(learn: LearnConfig, rollout: Transition, agent: int) -> tuple[jax.Array, jax.Array]:
    """What each step weighs for one agent's policy and for its value function, both [T, N] and 0 or 1.

    A step in which its action had no effect teaches a policy nothing. But the return of the step in which a drone
    goes down holds what comes later, as the value function sees it; so that goes on learning
    (`learn.inactive_steps`). A step with an action that was not finite, or whose physics diverged, teaches neither.
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

    def evaluate(observation: jax.Array) -> jax.Array:
        value = forward(learner.parameters.value, scaled(learn, learner.observation_scaler, observation))[..., 0]
        return denormalize(learner.value_scaler, value) if learn.normalize_values else value

    # Step by step: activations of N fights stay in the cache, those of T N do not (3 x faster on a CPU).
    value = jax.lax.map(evaluate, rollout.observation[:, :, agent])
    final = rollout.final_observation[:, :, agent]
    following = jnp.concatenate([value[1:], evaluate(final[-1])[None]])
    if not learn.bootstrap_timeout:
        return value, following

    # An environment is truncated once in a rollout, or never, unless fights are shorter than rollouts: one pass over the
    # environments for each time that one of them was.
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
    """Advantages and normalised value targets; all arguments [T, N, ...], `observation` already scaled.

    The value scaler takes in the old values, then the returns, and normalises each right after, as
    skrl does. Without `bootstrap_timeout` a truncated step counts as an end.
    """
    ends = terminated if learn.bootstrap_timeout else terminated | truncated
    done = terminated | truncated
    advantage = ppo.generalized_advantages(reward, value, next_value, ends, done, learn.discount, learn.gae_lambda)
    target = advantage + value
    if learn.normalize_values:
        scaler = update_scaler(learner.value_scaler, value, value_weight)
        value = normalize(scaler, value)
        scaler = update_scaler(scaler, target, value_weight)
        target = normalize(scaler, target)
        learner = learner.replace(value_scaler=scaler)
    advantage = ppo.normalize_advantages(advantage, weight)
    return learner, Batch(observation, action, log_prob, advantage, value, target, weight, value_weight)


def optimize(learn: LearnConfig, learner: Learner, batch: Batch, key: jax.Array) -> tuple[Learner, UpdateMetrics]:
    """`epochs` passes of `minibatches` steps over `batch` [T, N, ...]; the rate adapts after each pass."""
    flat = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), batch)
    adam = optimizer(learn)

    def step(carry: tuple, minibatch: Batch):
        parameters, state, learning_rate = carry
        gradients, metrics = jax.grad(loss, argnums=1, has_aux=True)(learn, parameters, minibatch)
        norm = optax.tree.norm(gradients)
        direction, stepped = adam.update(gradients, state, parameters)
        moved = optax.apply_updates(parameters, jax.tree.map(lambda leaf: -learning_rate * leaf, direction))
        # A step whose gradient is not finite is skipped: parameters and moments stay as they are. So is one
        # that nothing was learnt for: momentum alone would move the parameters.
        finite = jnp.isfinite(norm)
        taken = finite & jnp.any(minibatch.weight + minibatch.value_weight > 0.0)
        keep = lambda new, old: jnp.where(taken, new, old)
        moved = project_log_std(moved, learn)  # pyright: ignore[reportArgumentType] - as they came
        carry = (jax.tree.map(keep, moved, parameters), jax.tree.map(keep, stepped, state), learning_rate)
        weights = jnp.sum(minibatch.weight), jnp.sum(minibatch.value_weight)
        return carry, (metrics, weights, norm, ~finite)

    def epoch(carry: tuple, key: jax.Array):
        carry, metrics = jax.lax.scan(step, carry, cut(learn, flat, key))
        parameters, state, learning_rate = carry
        (*_, divergence, _), (weight, _), _, skipped = metrics
        # Skipped steps moved nothing: their divergence of 0 would drive the rate up. All skipped: NaN, no change.
        kl = jnp.sum(divergence * weight, where=~skipped) / jnp.sum(weight, where=~skipped)
        return (parameters, state, ppo.adapt_learning_rate(learn, learning_rate, kl)), (metrics, kl)

    carry = (learner.parameters, learner.optimizer, learner.learning_rate)
    carry, (metrics, kl) = jax.lax.scan(epoch, carry, jax.random.split(key, learn.epochs))
    parameters, state, learning_rate = carry
    learner = learner.replace(parameters=parameters, optimizer=state, learning_rate=learning_rate)
    (policy_loss, value_loss, entropy, _, clip_fraction), (weight, value_weight), norm, skipped = metrics
    return learner, UpdateMetrics(
        policy_loss=ppo.weighted_mean(policy_loss, weight),
        value_loss=ppo.weighted_mean(value_loss, value_weight),
        entropy=ppo.weighted_mean(entropy, weight),
        kl=kl[-1],
        clip_fraction=ppo.weighted_mean(clip_fraction, weight),
        grad_norm=jnp.mean(norm),
        skipped=jnp.sum(skipped, dtype=jnp.int32),
        learning_rate=learning_rate,
        explained_variance=ppo.explained_variance(batch.target, batch.value, batch.value_weight),
        log_std=jnp.mean(parameters.log_std),
        active_share=jnp.mean(batch.weight),
    )


def cut(learn: LearnConfig, batch: Batch, key: jax.Array) -> Batch:
    """Cut a flat batch [B, ...] into mini-batches [M, ..., B / M], features first: contiguous, or shuffled by `key`."""
    size = batch.log_prob.shape[0]
    if learn.minibatch_order == "shuffled":
        order = jax.random.permutation(key, size)
        batch = jax.tree.map(lambda leaf: leaf[order], batch)
    pieces = lambda leaf: leaf.reshape(learn.minibatches, -1, *leaf.shape[1:])
    return along_environments(jax.tree.map(lambda leaf: jnp.moveaxis(pieces(leaf), 1, -1), batch), axis=-1)


def loss(learn: LearnConfig, parameters: Parameters, batch: Batch) -> tuple[jax.Array, tuple]:
    """The loss of eq. 18 on one mini-batch [..., B], features first, and what it is made of."""
    mean = forward_columns(parameters.policy, batch.observation)
    weight, log_std = batch.weight, parameters.log_std
    log_ratio = gaussian_log_prob(batch.action.T, mean.T, log_std) - batch.log_prob
    log_ratio = jnp.where(weight > 0.0, log_ratio, 0.0)  # elsewhere exp(log_ratio) could be infinite
    value = forward_columns(parameters.value, batch.observation)[0]

    policy_loss = ppo.policy_loss(log_ratio, batch.advantage, weight, learn.clip_ratio)
    value_loss = ppo.value_loss(
        value, batch.value, batch.target, batch.value_weight, learn.clip_value, learn.value_loss
    )
    entropy = jnp.mean(gaussian_entropy(log_std)) * jnp.any(weight > 0.0)  # the same at every step
    total = policy_loss + learn.value_loss_scale * value_loss - learn.entropy_scale * entropy
    clipped = ppo.weighted_mean(jnp.abs(jnp.expm1(log_ratio)) > learn.clip_ratio, weight)
    kl = ppo.approximate_kl(log_ratio, weight)
    return total, (policy_loss, value_loss, entropy, kl, clipped)

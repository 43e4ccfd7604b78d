"""Gradient steps of one learner on its batch: mini-batches, the loss of eq. 18, Adam, the adaptive rate."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import optax

from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn import ppo
from dronecombat_jax.learn.networks import (
    forward_columns,
    gaussian_entropy,
    gaussian_log_prob,
    project_log_std,
)
from dronecombat_jax.learn.recurrent import unroll
from dronecombat_jax.learn.sharding import along_environments
from dronecombat_jax.types import (
    Batch,
    Learner,
    Parameters,
    UpdateMetrics,
)


def optimizer(learn: LearnConfig) -> Any:
    """Joint global-norm clip, then Adam's direction (an optax transformation); `optimize` applies
    the rate.
    """
    return optax.chain(
        optax.clip_by_global_norm(learn.max_grad_norm), optax.scale_by_adam(eps=1e-8)
    )


def optimize(
    learn: LearnConfig, learner: Learner, batch: Batch, key: jax.Array
) -> tuple[Learner, UpdateMetrics]:
    """`epochs` passes of `minibatches` steps over `batch` [T, N, ...]; the rate adapts after each
    pass.
    """
    pieces = partial(cut_fights, learn, batch)
    if batch.recall is None:
        flat = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), batch)
        pieces = partial(cut, learn, flat)
    adam = optimizer(learn)

    def step(carry: tuple[Any, ...], minibatch: Batch):
        parameters, state, learning_rate = carry
        gradients, metrics = jax.grad(loss, argnums=1, has_aux=True)(learn, parameters, minibatch)
        norm = optax.tree.norm(gradients)
        direction, stepped = adam.update(gradients, state, parameters)
        moved = optax.apply_updates(
            parameters, jax.tree.map(lambda leaf: -learning_rate * leaf, direction)
        )
        # A step whose gradient is not finite is skipped: parameters and moments stay as they are.
        # So is one that nothing was learnt for: momentum alone would move the parameters.
        finite = jnp.isfinite(norm)
        taken = finite & jnp.any(minibatch.weight + minibatch.value_weight > 0.0)
        keep = lambda new, old: jnp.where(taken, new, old)
        moved = project_log_std(moved, learn)  # pyright: ignore[reportArgumentType] - as they came
        carry = (
            jax.tree.map(keep, moved, parameters),
            jax.tree.map(keep, stepped, state),
            learning_rate,
        )
        weights = jnp.sum(minibatch.weight), jnp.sum(minibatch.value_weight)
        return carry, (metrics, weights, norm, ~finite)

    def epoch(carry: tuple[Any, ...], key: jax.Array):
        carry, metrics = jax.lax.scan(step, carry, pieces(key))
        parameters, state, learning_rate = carry
        (*_, divergence, _), (weight, _), _, skipped = metrics
        # Skipped steps moved nothing: their divergence of 0 would drive the rate up. All skipped:
        # NaN, no change.
        kl = jnp.sum(divergence * weight, where=~skipped) / jnp.sum(weight, where=~skipped)
        return (parameters, state, ppo.adapt_learning_rate(learn, learning_rate, kl)), (metrics, kl)

    carry = (learner.parameters, learner.optimizer, learner.learning_rate)
    carry, (metrics, kl) = jax.lax.scan(epoch, carry, jax.random.split(key, learn.epochs))
    parameters, state, learning_rate = carry
    learner = learner.replace(parameters=parameters, optimizer=state, learning_rate=learning_rate)
    (policy_loss, value_loss, entropy, _, clip_fraction), (weight, value_weight), norm, skipped = (
        metrics
    )
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
    """Cut a flat batch [B, ...] into mini-batches [M, ..., B / M], features first: contiguous, or
    shuffled by `key`.
    """
    size = batch.log_prob.shape[0]
    if learn.minibatch_order == "shuffled":
        order = jax.random.permutation(key, size)
        batch = jax.tree.map(lambda leaf: leaf[order], batch)
    pieces = lambda leaf: leaf.reshape(learn.minibatches, -1, *leaf.shape[1:])
    return along_environments(
        jax.tree.map(lambda leaf: jnp.moveaxis(pieces(leaf), 1, -1), batch), axis=-1
    )


def cut_fights(learn: LearnConfig, batch: Batch, key: jax.Array) -> Batch:
    """Cut a batch [T, N, ...] by environments into mini-batches [M, ..., T, N / M], features first:
    neighbours, or shuffled by `key`. A GRU is trained on the steps of an environment in order.
    """
    steps, environments = batch.log_prob.shape
    if learn.minibatch_order == "shuffled":
        order = jax.random.permutation(key, environments)
        batch = jax.tree.map(lambda leaf: leaf[:, order], batch)

    def pieces(leaf: jax.Array) -> jax.Array:
        parts = leaf.reshape(steps, learn.minibatches, -1, *leaf.shape[2:])
        return jnp.moveaxis(parts, (1, 0, 2), (0, -2, -1))

    return along_environments(jax.tree.map(pieces, batch), axis=-1)


def recalled(parameters: Parameters, batch: Batch) -> Batch:
    """A mini-batch of `cut_fights`, leaves [..., T, B], as one of `cut`, leaves [..., T B]: with the
    states of the GRU beside the observations.
    """
    if parameters.gru is None:
        return batch
    assert batch.recall is not None and batch.fresh is not None
    states = unroll(parameters.gru, batch.observation, batch.recall[:, 0], batch.fresh)
    seen = jnp.concatenate([batch.observation, states])
    flat = batch._replace(observation=seen, recall=None, fresh=None)
    return jax.tree.map(lambda leaf: leaf.reshape(*leaf.shape[:-2], -1), flat)


def loss(
    learn: LearnConfig, parameters: Parameters, batch: Batch
) -> tuple[jax.Array, tuple[Any, ...]]:
    """The loss of eq. 18 on one mini-batch [..., B], features first, and what it is made of."""
    batch = recalled(parameters, batch)
    mean = forward_columns(parameters.policy, batch.observation)
    weight, log_std = batch.weight, parameters.log_std
    log_ratio = gaussian_log_prob(batch.action.T, mean.T, log_std) - batch.log_prob
    # elsewhere exp(log_ratio) could be infinite
    log_ratio = jnp.where(weight > 0.0, log_ratio, 0.0)
    seen = batch.observation if batch.whole is None else batch.whole
    value = forward_columns(parameters.value, seen)[0]

    policy_loss = ppo.policy_loss(log_ratio, batch.advantage, weight, learn.clip_ratio)
    value_loss = ppo.value_loss(
        value, batch.value, batch.target, batch.value_weight, learn.clip_value, learn.value_loss
    )
    entropy = jnp.mean(gaussian_entropy(log_std)) * jnp.any(weight > 0.0)  # the same at every step
    total = policy_loss + learn.value_loss_scale * value_loss - learn.entropy_scale * entropy
    if batch.lesson is not None:
        total += learn.teacher_scale * ppo.teacher_loss(mean, batch.lesson, weight)
    clipped = ppo.weighted_mean(jnp.abs(jnp.expm1(log_ratio)) > learn.clip_ratio, weight)
    kl = ppo.approximate_kl(log_ratio, weight)
    return total, (policy_loss, value_loss, entropy, kl, clipped)

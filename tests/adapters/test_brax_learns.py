"""brax's own learners learn through the view."""

import functools

import jax
import numpy as np
import pytest
from brax.training.agents.ppo import networks as ppo_networks
from brax.training.agents.ppo import train as ppo
from brax.training.agents.sac import networks as sac_networks
from brax.training.agents.sac import train as sac
from brax_views import LENGTH, SIZE, make, wander

from dronecombat_jax.adapters.brax_env import mend_brax, wrap
from dronecombat_jax.types import ATTACKER


def test_mended_jax_replicates_over_devices():
    mend_brax()
    devices = jax.local_devices()
    tree = {"a": np.arange(3.0), "b": 2}
    replicated = jax.device_put_replicated(tree, devices)  # pyright: ignore
    for name, leaf in tree.items():
        np.testing.assert_array_equal(replicated[name], np.stack([leaf] * len(devices)))
    before = jax.device_put_replicated  # pyright: ignore
    mend_brax()
    assert jax.device_put_replicated is before  # pyright: ignore


@pytest.mark.slow
def test_braxs_ppo_learns_through_it():
    mend_brax()
    networks = functools.partial(
        ppo_networks.make_ppo_networks,
        policy_hidden_layer_sizes=(8, 8),
        value_hidden_layer_sizes=(8, 8),
    )
    seen = []
    _, (scaler, policy, value), metrics = ppo.train(
        make(ATTACKER, wander), num_timesteps=300, episode_length=LENGTH, wrap_env_fn=wrap, num_envs=SIZE,
        unroll_length=6, batch_size=SIZE, num_minibatches=2, num_updates_per_batch=2, num_eval_envs=SIZE,
        network_factory=networks, normalize_observations=True,
        policy_params_fn=lambda step, _, params: seen.append((step, params)),
    )  # fmt: skip
    assert [step for step, _ in seen] == [0, 384]  # 4 rollouts of 2 x 8 fights and 6 steps
    assert int(scaler.count) == 384
    _, *before = seen[0][1]
    for after, untrained in zip((policy, value), before, strict=True):
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(after))
        moved = jax.tree.map(lambda a, b: bool(np.any(a != b)), after, untrained)
        assert all(jax.tree.leaves(moved))
    assert sum(metrics[f"eval/episode_{end}"] for end in ("win", "draw", "loss")) == pytest.approx(
        1.0
    )
    assert 1 <= metrics["eval/avg_episode_length"] <= LENGTH


@pytest.mark.slow
def test_braxs_sac_learns_through_it():
    mend_brax()
    networks = functools.partial(sac_networks.make_sac_networks, hidden_layer_sizes=(8, 8))
    _, _, metrics = sac.train(
        make(ATTACKER, wander), num_timesteps=512, episode_length=LENGTH, wrap_env_fn=wrap, num_envs=SIZE, batch_size=8,
        min_replay_size=64, num_eval_envs=SIZE, network_factory=networks,
    )  # fmt: skip
    assert (
        np.isfinite(metrics["training/critic_loss"])
        and metrics["training/buffer_current_size"] > 64
    )
    assert sum(metrics[f"eval/episode_{end}"] for end in ("win", "draw", "loss")) == pytest.approx(
        1.0
    )

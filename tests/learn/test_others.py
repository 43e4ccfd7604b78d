"""The mean over slots of others: a slow loop, what it must not depend on, and a training with it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import toy
from policies import make_info

from dronecombat_jax.combat.observe import observation_of
from dronecombat_jax.config.fields import Config, GameConfig, LearnConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.learn.ippo import init_learner
from dronecombat_jax.learn.networks import encode, forward, init_parameters
from dronecombat_jax.learn.rollout import policy_mean, policy_of, select
from dronecombat_jax.policies.c_header import save_c
from dronecombat_jax.policies.file import load_policy, save_policy
from dronecombat_jax.policies.info import PolicyInfo
from dronecombat_jax.policies.numpy_policy import NumpyPolicy
from dronecombat_jax.types import Encoder

SIZE = 5
LEARN = LearnConfig(others="mean", others_size=SIZE, hidden_sizes=(8, 6))
GAME = GameConfig(observation="nearest", nearest_k=3)
INPUTS = 19 + 2 * 3 * 10
PARAMETERS = jax.jit(lambda: init_parameters(jax.random.key(1), LEARN, INPUTS))()


def some(rows: int = 20, seed: int = 0) -> np.ndarray:
    """Observations [rows, 79] of three slots a group, about half of them seen."""
    random = np.random.default_rng(seed)
    slots = random.normal(size=(rows, 6, 10))
    slots[..., 9] = random.random((rows, 6)) < 0.5
    slots *= slots[..., 9:]
    return np.concatenate([random.normal(size=(rows, 19)), slots.reshape(rows, -1)], axis=1).astype(
        np.float32
    )


def by_hand(others: Encoder, x: np.ndarray) -> list[float]:
    """One observation, slot by slot."""
    told = list(x[:19])
    for group in range(2):
        weight, bias = np.asarray(others.weights[group]), np.asarray(others.biases[group])
        seen = [slot for slot in x[19:].reshape(2, -1, 10)[group] if slot[9] == 1.0]
        units = [slot[:9] @ weight + bias for slot in seen]
        units = [np.where(unit > 0.0, unit, np.exp(unit) - 1.0) for unit in units]
        told += [*(np.mean(units, axis=0) if units else np.zeros(SIZE)), float(bool(units))]
    return told


def encoder() -> Encoder:
    others = PARAMETERS.policy.others
    assert others is not None
    biases = jax.random.normal(jax.random.key(2), others.biases.shape)
    return others.replace(biases=biases)


def of(state, role: int):
    """One side's learner of a training of one seed."""
    return select(jax.tree.map(lambda leaf: leaf[0], state.learners), role)


def test_it_is_the_mean_over_those_who_are_seen():
    others, seen = encoder(), some()
    assert others.weights.shape == (2, 9, SIZE)
    ours = np.asarray(jax.jit(encode)(others, jnp.asarray(seen.T))).T
    assert ours.shape == (20, 19 + 2 * (SIZE + 1))
    np.testing.assert_allclose(ours, [by_hand(others, x) for x in seen], atol=1e-5)
    flags = ours[:, [19 + SIZE, 19 + 2 * SIZE + 1]]
    assert set(np.unique(flags)) == {0.0, 1.0}


def test_neither_order_nor_number_of_slots_nor_what_is_hidden_matters():
    network, seen = PARAMETERS.policy.replace(others=encoder()), some()
    fly = jax.jit(forward)
    own, slots = seen[:, :19], seen[:, 19:].reshape(20, 2, 3, 10)
    joined = lambda slots: np.concatenate([own, slots.reshape(20, -1)], axis=1)
    action = np.asarray(fly(network, seen))
    assert action.shape == (20, 4) and np.abs(action).max() > 0.1
    np.testing.assert_allclose(fly(network, joined(slots[:, :, [2, 0, 1]])), action, atol=1e-5)
    more = np.concatenate([slots, np.zeros((20, 2, 2, 10), np.float32)], axis=2)
    np.testing.assert_allclose(fly(network, joined(more)), action, atol=1e-5)
    hidden = np.where(slots[..., 9:] == 0.0, np.float32([7.0] * 9 + [0.0]), slots)
    assert np.abs(hidden - slots).max() == 7.0
    np.testing.assert_array_equal(fly(network, joined(hidden)), action)


@pytest.mark.long
def test_slots_are_scaled_alike_whatever_was_seen_in_them():
    learner = init_learner(jax.random.key(0), LEARN, INPUTS)
    variance = np.asarray(learner.observation_scaler.variance)
    np.testing.assert_array_equal(variance[19:], np.tile([25.0] * 6 + [1.0] * 4, 6))
    flat = init_learner(jax.random.key(0), replace(LEARN, others="flat"), INPUTS)
    assert (np.asarray(flat.observation_scaler.variance) == 1.0).all()
    assert flat.parameters.policy.others is None


@pytest.fixture(scope="module")
def trained():
    """A toy training of two chunks and its settings."""
    learn = replace(toy.CONFIG.learn, others="mean", others_size=SIZE)
    game = replace(toy.CONFIG.game, observation="nearest", nearest_k=3)
    config = replace(toy.CONFIG, learn=learn, game=game)
    program = toy.build(config, toy.CHUNK)
    first, _ = program.run(program.start)
    second, _ = program.run(first)
    return config, program.start, second


@pytest.mark.slow
def test_a_training_moves_encoder_and_own_scale_alone(trained):
    _, start, end = trained
    for role in range(2):
        before, after = of(start, role), of(end, role)
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(after.parameters))
        assert toy.differs(before.parameters.policy.others, after.parameters.policy.others)
        scaler = after.observation_scaler
        assert np.abs(np.asarray(scaler.mean[:19])).max() > 0.0 and not np.any(scaler.mean[19:])
    before, after = of(start, 1), of(end, 1)
    assert toy.differs(before.parameters.value.others, after.parameters.value.others)


@pytest.mark.long
def test_the_file_and_numpy_alone_fly_it_and_others_refuse_it(trained, tmp_path):
    config, _, end = trained
    policy = jax.tree.map(np.asarray, policy_of(of(end, 1)))
    full = replace(Config(), game=GAME)
    info = make_info(full, layer_sizes=(INPUTS, 8, 8, 4))._replace(others_size=SIZE)
    path = tmp_path / "mine.safetensors"
    save_policy(path, policy, info)
    loaded = load_policy(path)
    assert loaded.info == info and observation_of(full).size == INPUTS
    toy.assert_same_bits(loaded.policy, policy)
    seen = some(50, seed=3)
    ours = np.asarray(policy_mean(config.learn, policy, jnp.asarray(seen)))
    np.testing.assert_allclose(NumpyPolicy(path)(seen), ours, rtol=2e-6, atol=2e-6)
    np.testing.assert_allclose(NumpyPolicy(path)(seen[0]), ours[0], rtol=2e-6, atol=2e-6)
    with pytest.raises(UserError, match=r"a.h: a policy with learn.others = mean is exported as"):
        save_c(tmp_path / "a.h", policy, info)


@pytest.mark.long
def test_a_file_whose_encoder_does_not_fit_is_refused(trained, tmp_path):
    _, _, end = trained
    policy = jax.tree.map(np.asarray, policy_of(of(end, 0)))
    info: PolicyInfo = make_info(replace(Config(), game=GAME), layer_sizes=(INPUTS, 8, 8, 4))
    for size in (0, SIZE + 1):
        with pytest.raises(UserError, match="its arrays are not those of layer_sizes"):
            save_policy(tmp_path / "bad.safetensors", policy, info._replace(others_size=size))

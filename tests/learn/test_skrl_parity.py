"""One whole update from the golden file's weights and rollout ends where skrl 1.4.3's torch IPPO
ends.

`tests/golden/make_skrl_golden.py` made the file. Its networks are smaller than ours: parameters are
plain pytrees, so any size will do. Two variants (the learning rate rises, or falls) of two agents.
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn.ippo import prepare_batch
from dronecombat_jax.learn.networks import forward, gaussian_log_prob
from dronecombat_jax.learn.normalize import denormalize, init_scaler
from dronecombat_jax.learn.optimize import optimize, optimizer
from dronecombat_jax.types import MLP, Batch, Learner, Parameters, Scaler, UpdateMetrics

GOLDEN = np.load(Path(__file__).parents[1] / "golden" / "skrl_update.npz", allow_pickle=False)
HYPER = {
    name.split("/")[1]: GOLDEN[name].item() for name in GOLDEN.files if name.startswith("hyper/")
}
LEARN = LearnConfig(
    rollout_steps=HYPER["rollouts"],
    epochs=HYPER["learning_epochs"],
    minibatches=HYPER["mini_batches"],
    discount=HYPER["discount_factor"],
    gae_lambda=HYPER["lambda"],
    learning_rate=HYPER["learning_rate"],
    max_grad_norm=HYPER["grad_norm_clip"],
    clip_ratio=HYPER["ratio_clip"],
    clip_value=HYPER["value_clip"],
    entropy_scale=HYPER["entropy_loss_scale"],
    value_loss_scale=HYPER["value_loss_scale"],
    kl_target=HYPER["kl_target"],
    bootstrap_timeout=HYPER["time_limit_bootstrap"],
)
CASES = [f"{variant}/{agent}" for variant in ("up", "down") for agent in ("defender", "attacker")]


def read(case: str, name: str) -> jax.Array:
    return jnp.asarray(GOLDEN[f"{case}/{name}"])


def read_parameters(case: str, when: str) -> Parameters:
    def mlp(name: str) -> MLP:
        weights, biases = (
            tuple(read(case, f"{when}/{name}/{kind}{i}") for i in range(3)) for kind in "wb"
        )
        return MLP(weights, biases)

    return Parameters(mlp("policy"), read(case, f"{when}/log_std"), mlp("value"))


def read_scaler(case: str, when: str) -> Scaler:
    statistics = (
        GOLDEN[f"{case}/value_scaler_{when}/{name}"] for name in ("mean", "variance", "count")
    )
    return Scaler(*(jnp.asarray(x.reshape(()), jnp.float32) for x in statistics))


def start(case: str) -> Learner:
    parameters = read_parameters(case, "initial")
    return Learner(
        parameters=parameters,
        optimizer=optimizer(LEARN).init(parameters),
        observation_scaler=init_scaler((7,)),
        value_scaler=read_scaler(case, "before"),
        learning_rate=jnp.float32(LEARN.learning_rate),
    )


@jax.jit
def update(learner: Learner, rollout: dict[str, jax.Array]) -> tuple[Learner, Batch, UpdateMetrics]:
    last = forward(learner.parameters.value, rollout.pop("last_observation"))[..., 0]
    last = denormalize(learner.value_scaler, last)
    following = jnp.concatenate([rollout["value"][1:], last[None]])
    ones = jnp.ones_like(following)
    weights = {"weight": ones, "value_weight": ones}
    learner, batch = prepare_batch(LEARN, learner, next_value=following, **rollout, **weights)
    learner, metrics = optimize(LEARN, learner, batch, jax.random.key(0))
    return learner, batch, metrics


@pytest.fixture(scope="module", params=CASES)
def updated(request) -> tuple[str, Learner, Batch, UpdateMetrics]:
    names = (
        "observation",
        "action",
        "log_prob",
        "reward",
        "value",
        "terminated",
        "truncated",
        "last_observation",
    )
    return request.param, *update(
        start(request.param), {name: read(request.param, f"rollout/{name}") for name in names}
    )


@pytest.mark.parametrize("case", CASES)
def test_stored_values_and_log_probabilities_are_those_of_our_networks(case):
    learner, observation = start(case), read(case, "rollout/observation")
    mean = forward(learner.parameters.policy, observation)
    log_prob = gaussian_log_prob(read(case, "rollout/action"), mean, learner.parameters.log_std)
    np.testing.assert_allclose(log_prob, read(case, "rollout/log_prob"), rtol=1e-5, atol=1e-5)
    value = denormalize(
        learner.value_scaler, forward(learner.parameters.value, observation)[..., 0]
    )
    np.testing.assert_allclose(value, read(case, "rollout/value"), rtol=1e-5, atol=1e-4)


def test_advantages_and_normalised_targets(updated):
    case, _, batch, _ = updated
    np.testing.assert_allclose(batch.advantage, read(case, "update/advantage"), atol=2e-6)
    np.testing.assert_allclose(batch.value, read(case, "update/value_normalized"), atol=2e-6)
    np.testing.assert_allclose(batch.target, read(case, "update/return_normalized"), atol=2e-6)


def test_value_scaler(updated):
    case, learner, _, _ = updated
    expected = read_scaler(case, "after")
    np.testing.assert_allclose(learner.value_scaler.mean, expected.mean, rtol=1e-6)
    np.testing.assert_allclose(learner.value_scaler.variance, expected.variance, rtol=1e-6)
    assert learner.value_scaler.count == expected.count


def test_learning_rate_and_divergence(updated):
    case, learner, _, metrics = updated
    assert learner.learning_rate == pytest.approx(
        GOLDEN[f"{case}/schedule/learning_rate"][-1], rel=1e-6
    )
    assert metrics.kl == pytest.approx(GOLDEN[f"{case}/schedule/kl"][-1], rel=1e-3)
    before, after = GOLDEN[f"{case}/schedule/learning_rate"][-2:]
    # the two variants are what they say
    assert after > before if case.startswith("up") else after < before


def test_parameters(updated):
    case, learner, _, metrics = updated
    before, after = read_parameters(case, "initial"), read_parameters(case, "final")
    differ = jax.tree.map(lambda x, y: np.abs(x - y).max(), learner.parameters, after)
    moved = jax.tree.map(lambda x, y: np.abs(x - y).max(), before, after)
    assert max(jax.tree.leaves(differ)) < 2e-6
    assert min(jax.tree.leaves(moved)) > 5e-4  # so that agreement means something
    assert metrics.skipped == 0


def test_losses(updated):
    case, _, _, metrics = updated
    # skrl tracks the mean over all gradient steps, and its entropy loss carries scale and sign
    assert metrics.policy_loss == pytest.approx(GOLDEN[f"{case}/loss/policy"], rel=1e-4, abs=2e-6)
    assert metrics.value_loss == pytest.approx(GOLDEN[f"{case}/loss/value"], rel=1e-5)
    assert -LEARN.entropy_scale * metrics.entropy == pytest.approx(
        GOLDEN[f"{case}/loss/entropy"], rel=1e-5
    )

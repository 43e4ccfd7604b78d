"""PPO's mathematics against numbers worked by hand (the formula is in the comment), slow loops and
skrl's schedule.
"""

from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn import ppo

GOLDEN = Path(__file__).parents[1] / "golden" / "skrl_update.npz"
LEARN = LearnConfig()


def advantages(
    reward, value, next_value, terminated, done, discount=0.5, gae_lambda=0.5
) -> np.ndarray:
    reward, value, next_value = (jnp.asarray(x, jnp.float32) for x in (reward, value, next_value))
    ends, done = jnp.asarray(terminated, bool), jnp.asarray(done, bool)
    return np.asarray(
        ppo.generalized_advantages(reward, value, next_value, ends, done, discount, gae_lambda)
    )


# reward 1 2 3, value 0.5 1 1.5, the successors' values 1 1.5 2; discount and lambda 0.5, so the
# trace decays by 0.25. delta = r + 0.5 v' - v = 1, 1.75, 2.5.  A2 = 2.5;  A1 = 1.75 + 0.25 * 2.5 =
# 2.375;  A0 = 1 + 0.25 * 2.375 = 1.59375 terminated at 1: delta1 = 2 - 1 = 1 = A1;  A0 = 1 + 0.25 *
# 1 = 1.25 truncated at 1, its final observation worth 4: delta1 = 2 + 0.5 * 4 - 1 = 3 = A1;  A0 = 1
# + 0.25 * 3 = 1.75
@pytest.mark.parametrize(
    ("terminated", "truncated", "next_value", "expected"),
    [
        ([0, 0, 0], [0, 0, 0], [1.0, 1.5, 2.0], [1.59375, 2.375, 2.5]),
        ([0, 1, 0], [0, 0, 0], [1.0, 99.0, 2.0], [1.25, 1.0, 2.5]),
        ([0, 0, 0], [0, 1, 0], [1.0, 4.0, 2.0], [1.75, 3.0, 2.5]),
    ],
    ids=["goes on", "terminated", "truncated"],
)
def test_advantages_worked_by_hand(terminated, truncated, next_value, expected):
    done = np.logical_or(terminated, truncated)
    assert (
        advantages([1.0, 2.0, 3.0], [0.5, 1.0, 1.5], next_value, terminated, done).tolist()
        == expected
    )


def test_advantages_equal_the_sum_that_defines_them():
    rng = np.random.default_rng(0)
    reward, value, next_value = rng.normal(size=(3, 17, 5))
    terminated = rng.random((17, 5)) < 0.15
    done = terminated | (rng.random((17, 5)) < 0.15)
    expected = np.zeros((17, 5))
    for n in range(5):
        for t in range(17):  # A_t = sum of (gamma lambda)^k delta_{t+k} up to the fight's end
            for k in range(17 - t):
                i = t + k, n
                delta = reward[i] + 0.99 * next_value[i] * (not terminated[i]) - value[i]
                expected[t, n] += (0.99 * 0.95) ** k * delta
                if done[i]:
                    break
    result = advantages(reward, value, next_value, terminated, done, 0.99, 0.95)
    np.testing.assert_allclose(result, expected, rtol=2e-6, atol=2e-6)


def test_lambda_one_gives_returns_and_lambda_zero_gives_the_temporal_difference():
    rng = np.random.default_rng(1)
    reward, value = rng.normal(size=(2, 6, 1))
    following = np.concatenate([value[1:], [[0.7]]])
    never = np.zeros((6, 1), bool)
    returns = [
        sum(0.9**k * reward[t + k, 0] for k in range(6 - t)) + 0.9 ** (6 - t) * 0.7
        for t in range(6)
    ]
    full = advantages(reward, value, following, never, never, 0.9, 1.0)
    np.testing.assert_allclose((full + value)[:, 0], returns, rtol=1e-6)
    short = advantages(reward, value, following, never, never, 0.9, 0.0)
    np.testing.assert_allclose(short, reward + 0.9 * following - value, rtol=1e-6, atol=1e-7)


def test_advantage_normalisation():
    # mean 2, deviation with ddof 1: sqrt((1 + 0 + 1) / 2) = 1
    np.testing.assert_allclose(
        ppo.normalize_advantages(jnp.asarray([1.0, 2.0, 3.0]), jnp.ones(3)),
        [-1.0, 0.0, 1.0],
        atol=1e-7,
    )
    scaled = ppo.normalize_advantages(jnp.arange(12.0).reshape(3, 4) * 50.0 - 7.0, jnp.ones((3, 4)))
    assert np.mean(scaled) == pytest.approx(0.0, abs=1e-6) and np.std(
        scaled, ddof=1
    ) == pytest.approx(1.0)
    assert (
        ppo.normalize_advantages(jnp.full((4, 2), 3.0), jnp.ones((4, 2))).tolist()
        == [[0.0] * 2] * 4
    )  # no deviation: no NaN


def policy_loss(ratio: list[float], advantage: list[float]) -> jax.Array:
    return ppo.policy_loss(
        jnp.log(jnp.asarray(ratio)), jnp.asarray(advantage), jnp.ones(len(ratio)), 0.2
    )


def test_policy_loss_worked_by_hand():
    # min(r A, clip(r, 0.8, 1.2) A): min(1.5, 1.2) = 1.2, min(0.5, 0.8) = 0.5, min(-1.1, -1.1),
    # min(-0.5, -0.8) = -0.8, min(-3, -2.4) = -3; minus their mean: -(1.2 + 0.5 - 1.1 - 0.8 - 3) / 5
    # = 0.64
    assert policy_loss([1.5, 0.5, 1.1, 0.5, 1.5], [1.0, 1.0, -1.0, -1.0, -2.0]) == pytest.approx(
        0.64, rel=1e-6
    )


def test_policy_gradient_is_that_of_the_surrogate_and_stops_where_it_is_clipped():
    def slope(ratio: float, advantage: float) -> float:
        gradient = jax.grad(
            lambda log_ratio: ppo.policy_loss(
                log_ratio[None], jnp.asarray([advantage]), jnp.ones(1), 0.2
            )
        )
        return float(gradient(jnp.log(ratio)))

    assert slope(1.0, 2.0) == pytest.approx(-2.0)  # d/d(log r) of -r A at r = 1
    assert slope(1.1, 2.0) == pytest.approx(-2.2)
    assert slope(1.3, 2.0) == 0.0 and slope(0.7, -2.0) == 0.0  # far enough: clipped
    # the wrong way: not
    assert slope(0.7, 2.0) == pytest.approx(-1.4) and slope(1.3, -2.0) == pytest.approx(2.6)


# value, old value, target: 1, 0, 2: plain (1 - 2)^2 = 1, clipped (0 + 0.2 - 2)^2 = 3.24
#                           1, 0, 0.1: plain 0.81, clipped (0.2 - 0.1)^2 = 0.01
#                           0.1, 0, 1: inside the clip, both 0.81
@pytest.mark.parametrize(
    ("form", "expected"),
    [
        ("plain", (1.0 + 0.81 + 0.81) / 3),
        ("skrl", (3.24 + 0.01 + 0.81) / 3),
        ("ppo2_max", (3.24 + 0.81 + 0.81) / 3),
        ("paper_min", (1.0 + 0.01 + 0.81) / 3),
    ],
)
def test_value_losses_worked_by_hand(form, expected):
    value, old, target = jnp.asarray([1.0, 1.0, 0.1]), jnp.zeros(3), jnp.asarray([2.0, 0.1, 1.0])
    assert ppo.value_loss(value, old, target, jnp.ones(value.shape), 0.2, form) == pytest.approx(
        expected, rel=1e-6
    )


def test_kl_estimate():
    ratio = np.array([2.0, 0.5, 1.0])
    expected = np.mean((ratio - 1.0) - np.log(ratio))  # (1 - 0.6931 + -0.5 + 0.6931 + 0) / 3 = 1/6
    assert expected == pytest.approx(1 / 6)
    assert ppo.approximate_kl(jnp.log(jnp.asarray(ratio)), jnp.ones(len(ratio))) == pytest.approx(
        expected, rel=1e-6
    )
    # small ratios: x^2 / 2; `exp(x) - 1 - x` in float32 would be off by a factor here
    assert ppo.approximate_kl(jnp.full(5, 1e-3), jnp.ones(5)) == pytest.approx(0.5e-6, rel=2e-3)


def rate_after(kl: float, rate: float, learn: LearnConfig = LEARN) -> float:
    return float(ppo.adapt_learning_rate(learn, jnp.float32(rate), jnp.float32(kl)))


@pytest.mark.parametrize(
    ("kl", "rate", "expected"),
    [
        (0.0161, 3e-4, 2e-4),  # above 2 * 0.008: divided by 1.5
        (0.0159, 3e-4, 3e-4),
        (0.0041, 3e-4, 3e-4),
        (0.0039, 3e-4, 4.5e-4),  # below 0.008 / 2: times 1.5
        (1.0, 1.2e-6, 1e-6),
        (0.0, 8e-3, 1e-2),
        (float("inf"), 3e-4, 2e-4),
        (float("nan"), 3e-4, 3e-4),  # a skipped epoch says nothing about the rate
    ],
)
def test_learning_rate_schedule(kl, rate, expected):
    assert rate_after(kl, rate) == pytest.approx(expected, rel=1e-6)
    assert rate_after(kl, rate, replace(LEARN, learning_rate_schedule="constant")) == pytest.approx(
        rate, rel=1e-6
    )


def test_learning_rate_schedule_is_that_of_skrl():
    golden = np.load(GOLDEN, allow_pickle=False)
    edges = (np.float32(0.004), np.float32(0.016))
    checked = 0
    for group in ("inside", "outside"):
        names = ("kl", "learning_rate_before", "learning_rate_after")
        for kl, before, after in np.stack(
            [golden[f"kl_schedule/{group}/{name}"] for name in names], axis=1
        ):
            if np.float32(kl) not in edges:
                # exactly at an edge the roundings of float32 and float64 decide
                assert rate_after(kl, before) == pytest.approx(after, rel=1e-6), (kl, before)
                checked += 1
    assert checked > 40


def test_explained_variance():
    target = jnp.asarray([1.0, -2.0, 4.0, 0.5])
    assert ppo.explained_variance(target, target, jnp.ones(4)) == pytest.approx(1.0)
    # an offset is no variance
    assert ppo.explained_variance(target, target + 9.0, jnp.ones(4)) == pytest.approx(1.0)
    assert ppo.explained_variance(
        target, jnp.full(4, jnp.mean(target)), jnp.ones(4)
    ) == pytest.approx(0.0, abs=1e-6)
    # 1 - Var(2 R) / Var(R)
    assert ppo.explained_variance(target, -target, jnp.ones(4)) == pytest.approx(-3.0)
    assert ppo.explained_variance(jnp.ones(4), target, jnp.ones(4)) == 0.0

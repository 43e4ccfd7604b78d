"""Where fights start."""

from types import SimpleNamespace

import jax
import numpy as np
import pytest

from dronecombat_jax.combat import starts
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config, GameConfig, TrainConfig
from dronecombat_jax.types import EnvState

NEVER = np.zeros(1000, bool)  # alone


@pytest.fixture(scope="module")
def thousand(arena: SimpleNamespace) -> dict[str, EnvState]:
    """A thousand starts of each kind."""
    keys, drawn = jax.random.split(jax.random.key(3), 1000), {}
    games = {
        "fixed": GameConfig(),
        "uniform": GameConfig(spawn="uniform"),
        "spread": GameConfig(spawn_spread=1.5),
        "wide": GameConfig(spawn_spread=1.0, defender_spread=4.0),
    }
    for name, game in games.items():
        combat = Combat(Config(game=game), arena.combat.scene)
        drawn[name] = jax.jit(jax.vmap(combat.reset))(keys)
    return drawn


def places(state: EnvState) -> np.ndarray:
    """Positions [N, 3, 3] of defender, attacker, target."""
    return np.stack([state.qpos[:, 0:3], state.qpos[:, 7:10], state.target], axis=1)


def test_start_is_the_papers(thousand: dict[str, EnvState]):
    state = thousand["fixed"]
    where = places(state)
    np.testing.assert_array_equal(where[:, :, :2], np.tile([[0, 5], [0, 0], [5, 5]], (1000, 1, 1)))
    assert_uniform(where[:, :, 2], 0.5, 1.5)
    for leaf, expected in (
        (state.qpos[:, 3:7], [1, 0, 0, 0]),
        (state.qpos[:, 10:], [1, 0, 0, 0]),
        (state.qvel, 0),
    ):
        np.testing.assert_array_equal(leaf, np.broadcast_to(expected, leaf.shape))
    assert not np.any(state.clock) and not np.any(state.down)


def test_exploring_starts_move_over_ground_and_change_nothing_else(arena: SimpleNamespace):
    """In training alone: `spawn`, by which evaluations and tournaments start, stays at rest."""
    train = TrainConfig(start_speed=4.0)
    combat = Combat(Config(train=train), arena.combat.scene)
    numbers = combat.exploring_numbers(jax.random.key(5), (len(NEVER),))
    moving, at_rest = (
        jax.vmap(combat.explore)(numbers, NEVER),
        jax.vmap(combat.spawn)(numbers[:, :9]),
    )
    velocity = np.asarray(moving.qvel).reshape(1000, 2, 2, 3)
    assert_uniform(velocity[:, :, 0, :2].reshape(1000, 4), -4.0, 4.0)
    assert not np.any(velocity[:, :, 0, 2]) and not np.any(velocity[:, :, 1])
    jax.tree.map(np.testing.assert_array_equal, moving.replace(qvel=at_rest.qvel), at_rest)
    assert not np.any(at_rest.qvel)

    solo = Combat(Config(game=GameConfig(scenario="solo"), train=train), arena.combat.scene)
    alone = jax.vmap(solo.explore)(numbers, NEVER)  # the absent defender stands still
    np.testing.assert_array_equal(alone.qvel, moving.qvel.at[:, :6].set(0.0))


@pytest.mark.long
def test_a_share_of_the_trainings_fights_starts_anywhere(arena: SimpleNamespace):
    train = TrainConfig(start_speed=4.0, start_anywhere=0.5)
    combat, plain = (
        Combat(Config(train=train), arena.combat.scene),
        Combat(Config(train=TrainConfig(start_speed=4.0)), arena.combat.scene),
    )
    numbers = combat.exploring_numbers(jax.random.key(6), (4000,))
    alone = np.arange(4000) % 4 == 0  # these defenders are absent and stay where they are
    state, usual = (
        jax.vmap(combat.explore)(numbers, alone),
        jax.vmap(plain.explore)(numbers[:, : 9 + 4], alone),
    )
    elsewhere = np.any(state.qpos[:, 7:10] != usual.qpos[:, 7:10], axis=1)
    assert 0.45 < elsewhere.mean() < 0.55
    jax.tree.map(
        lambda here, there: np.testing.assert_array_equal(here[~elsewhere], there[~elsewhere]),
        state,
        usual,
    )
    both = elsewhere & ~alone
    box = np.asarray(starts.ANYWHERE_LOW), np.asarray(starts.ANYWHERE_HIGH)
    where = (np.asarray(places(state))[both, :2] - box[0]) / (box[1] - box[0])
    assert_uniform(where.reshape(-1, 6), 0.0, 1.0)
    velocity = np.asarray(state.qvel)[both].reshape(-1, 2, 2, 3)
    assert_uniform(velocity[:, :, 0].reshape(-1, 6), -4.0, 4.0)
    assert not np.any(velocity[:, :, 1])
    np.testing.assert_array_equal(state.target, usual.target)
    np.testing.assert_array_equal(state.qpos[alone, :7], usual.qpos[alone, :7])


@pytest.mark.long
def test_a_share_of_the_trainings_fights_starts_at_rest(arena: SimpleNamespace):
    train = TrainConfig(start_speed=4.0, start_anywhere=0.5, start_at_rest=0.25)
    combat = Combat(Config(train=train), arena.combat.scene)
    usual = Combat(
        Config(train=TrainConfig(start_speed=4.0, start_anywhere=0.5)), arena.combat.scene
    )
    numbers = combat.exploring_numbers(jax.random.key(7), (1000,))
    state, moving = (
        jax.vmap(combat.explore)(numbers, NEVER),
        jax.vmap(usual.explore)(numbers[:, :-1], NEVER),
    )
    rests = ~np.any(state.qvel, axis=1)
    assert 0.2 < rests.mean() < 0.3
    for which, wanted in ((rests, jax.vmap(combat.spawn)(numbers[:, :9])), (~rests, moving)):
        jax.tree.map(
            lambda one, other, which=which: np.testing.assert_array_equal(one[which], other[which]),
            state,
            wanted,
        )


def test_without_start_speed_training_starts_as_the_game_does(arena: SimpleNamespace):
    key = jax.random.key(5)
    numbers = arena.combat.exploring_numbers(key, (8,))
    np.testing.assert_array_equal(numbers, arena.combat.start_numbers(key, (8,)))
    np.testing.assert_array_equal(numbers, arena.combat.draw(key, (8,)))  # its older name
    jax.tree.map(
        np.testing.assert_array_equal,
        jax.vmap(arena.combat.explore)(numbers, NEVER[:8]),
        jax.vmap(arena.combat.spawn)(numbers),
    )


def test_uniform_start_fills_the_arena(thousand: dict[str, EnvState]):
    where = places(thousand["uniform"])
    assert_uniform(where[:, :, :2].reshape(1000, -1), -5.0, 5.0)
    assert_uniform(where[:, :, 2], 0.5, 1.5)


def test_a_spread_start_fills_a_square_around_each_of_the_papers_points(
    thousand: dict[str, EnvState],
):
    offset = places(thousand["spread"]) - [[0, 5, 0], [0, 0, 0], [5, 5, 0]]
    assert_uniform(offset[:, :, :2].reshape(1000, -1), -1.5, 1.5)
    assert_uniform(offset[:, :, 2], 0.5, 1.5)


def test_the_defender_alone_may_start_in_a_wider_square(thousand: dict[str, EnvState]):
    offset = places(thousand["wide"]) - [[0, 5, 0], [0, 0, 0], [5, 5, 0]]
    assert_uniform(offset[:, 0, :2], -4.0, 4.0)
    assert_uniform(offset[:, 1:, :2].reshape(1000, -1), -1.0, 1.0)


def assert_uniform(columns: np.ndarray, low: float, high: float) -> None:
    """Each of `columns` [N, K] is uniform and independent of the others."""
    unit = (columns - low) / (high - low)
    assert unit.min() >= 0.0 and unit.max() < 1.0
    np.testing.assert_allclose(unit.mean(axis=0), 0.5, atol=0.05)  # 5 standard errors
    np.testing.assert_allclose(
        np.quantile(unit, [0.1, 0.9], axis=0).T, [[0.1, 0.9]] * unit.shape[1], atol=0.05
    )
    assert np.abs(np.corrcoef(unit.T) - np.eye(unit.shape[1])).max() < 0.16

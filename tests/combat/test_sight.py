"""What a drone sees of others that may be hidden: directions alone, limits of the sensor, nothing of
who is hidden.
"""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.observe import OBSERVATIONS, Observation, layout_of
from dronecombat_jax.combat.sensors import in_sight, see
from dronecombat_jax.combat.sight import (
    bearing_fields,
    nearest_fields,
    observe_bearing,
    observe_nearest,
    others_of,
)
from dronecombat_jax.config.fields import Config, GameConfig, SensorConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import Craft, Drones, EnvState

HALF = np.sqrt(0.5)
TEAM = (0, 0, 1)  # two defenders, one attacker
SIZES = {"world": 35, "ego": 35, "engagement": 60, "tracks": 50, "bearing": 23, "nearest": 59}
# Where each layout tells of the other drone, by observer.
TELLS = {
    "world": (np.r_[7:14, 23:29, 32:35], np.r_[0:7, 17:23, 29:32]),
    "ego": (np.r_[7:14, 23:29, 32:35],) * 2,
    "engagement": (np.r_[7:14, 23:29, 32:35, 35:47, 59],) * 2,
    "tracks": (np.r_[7:10, 19:22, 25:37, 49],) * 2,
    "bearing": (np.r_[19:23],) * 2,
    "nearest": (np.r_[39:49],) * 2,  # the first of two slots for opponents, after two for mates
}


def place(*positions, quaternions=None) -> Drones:
    """Drones at rest; level, where no quaternions are given."""
    position = np.asarray(positions, np.float32)
    level = np.tile(np.float32([1, 0, 0, 0]), (len(position), 1))
    turned = level if quaternions is None else np.asarray(quaternions, np.float32)
    return Drones(position, turned, np.zeros_like(position), np.zeros_like(position))


def sight(sensor: SensorConfig, drones: Drones, word: int = 0) -> np.ndarray:
    return np.asarray(in_sight(sensor, drones, jnp.uint32(word), jnp.int32(0)))


def test_engagement_by_hand():
    """The defender is yawed by 90 degrees to the left: its x is world y, its y world -x. The attacker
    lies at (0, 4, 3) and falls at 5 m/s: closing at 3 m/s, nearest after 0.6 s, then 4 m ahead. The
    target lies 2 m to the right; flying past it at 1 m/s, the defender is nearest now.
    """
    drones = place((0, 0, 1), (0, 4, 4), quaternions=[(HALF, 0, 0, HALF), (1, 0, 0, 0)])
    drones = drones._replace(velocity=np.float32([[0, 1, 0], [0, 1, -5]]))
    observation = layout_of("engagement", GameConfig())
    row = np.asarray(observation.observe(drones, jnp.float32([2, 0, 1])))[0]
    other = [5, 3, *(0, 20 / 25.25, 0), 0.6, *(4, 0, 0), *(0.8, 0, 0.6)]
    goal = [2, 0, *(0, 0, -2 / 4.25), 0, *(0, -2, 0), *(0, -1, 0)]
    np.testing.assert_allclose(row[35:], [*other, *goal, np.sqrt(29)], atol=1e-6)
    ego = layout_of("ego", GameConfig())
    np.testing.assert_array_equal(row[:35], ego.observe(drones, jnp.float32([2, 0, 1]))[0])
    assert [name for name, _ in observation.fields[11:]] == [
        *("r_other", "c_other", "l_other", "n_other", "m_other", "u_other"),
        *("r_t", "c_t", "l_t", "n_t", "m_t", "u_t", "e_other"),
    ]


def test_tracks_are_the_engagement_without_how_the_other_is_turned():
    drones = place((0, 0, 1), (0, 4, 4), quaternions=[(HALF, 0, 0, HALF), (1, 0, 0, 0)])
    drones = drones._replace(velocity=np.float32([[0, 1, 0], [0, 1, -5]]))
    observation, whole = (layout_of(name, GameConfig()) for name in ("tracks", "engagement"))
    assert [name for name, _ in observation.fields[:8]] == [
        *("p_self", "q_self", "p_other", "p_t", "v_self", "w_self", "v_other", "g_self"),
    ]
    row, all_of_it = (np.asarray(it.observe(drones, jnp.ones(3))) for it in (observation, whole))
    np.testing.assert_array_equal(row[:, 25:], all_of_it[:, 35:])
    np.testing.assert_array_equal(row[:, :10], all_of_it[:, :10])
    turned = drones._replace(
        quaternion=np.float32([drones.quaternion[0], [0, 1, 0, 0]]),
        rate=np.float32([[0, 0, 0], [9, 9, 9]]),
    )
    np.testing.assert_array_equal(observation.observe(turned, jnp.ones(3))[0], row[0])


def test_engagement_stays_within_bounds_where_drones_meet():
    drones = place((1, 1, 1), (1, 1, 1))._replace(velocity=np.float32([[9, 0, 0], [-9, 0, 0]]))
    row = np.asarray(layout_of("engagement", GameConfig()).observe(drones, jnp.ones(3)))
    assert np.isfinite(row).all() and np.abs(row).max() < 20
    still = place((0, 0, 1), (0, 0, 1.5))
    seen = np.asarray(layout_of("engagement", GameConfig()).observe(still, jnp.ones(3)))
    np.testing.assert_allclose(seen[0, 35:47], [0.5, *[0] * 5, 0, 0, 0.5, 0, 0, 1], atol=1e-6)


def test_bearing_by_hand():
    """The attacker is yawed by 90 degrees to the left: its x is world y, its y world -x. To the
    defender it lies at (0, 4, 3), to itself the defender at (0, -4, -3): (-4, 0, -3) in its frame.
    The target, 2 m along world x, lies 2 m to its right.
    """
    drones = place((0, 0, 1), (0, 4, 4), quaternions=[(1, 0, 0, 0), (HALF, 0, 0, HALF)])
    drones = drones._replace(
        velocity=np.float32([[1, 2, 3], [4, 5, 6]]), rate=np.float32([[7, 8, 9], [-1, -2, -3]])
    )
    rows = [
        [*(0, 0, 1), *(1, 0, 0, 0), *(2, 4, 3), *(1, 2, 3), *(7, 8, 9), *(0, 0, -1), *(0, 0.8, 0.6), 1],
        [*(0, 4, 4), *(HALF, 0, 0, HALF), *(0, -2, 0), *(5, -4, 6), *(-1, -2, -3), *(0, 0, -1),
         *(-0.8, 0, -0.6), 1],
    ]  # fmt: skip
    seen = jax.jit(partial(observe_bearing, (0, 1)))(drones, jnp.float32([2, 4, 4]))
    assert sum(size for _, size in bearing_fields((0, 1))) == 23
    np.testing.assert_allclose(seen, rows, atol=1e-6)


def test_bearing_of_a_team_names_team_mates_first():
    drones = place((0, 0, 0), (3, 0, 0), (0, 0, 2))
    np.testing.assert_array_equal(others_of(TEAM), [[1, 2], [0, 2], [0, 1]])
    rows = np.asarray(observe_bearing(TEAM, drones, jnp.zeros(3)))[:, 19:]
    along = lambda x, z: (x / np.hypot(x, z), 0, z / np.hypot(x, z), 1)
    wanted = [
        [*(1, 0, 0, 1), *(0, 0, 1, 1)],
        [*(-1, 0, 0, 1), *along(-3, 2)],
        [*(0, 0, -1, 1), *along(3, -2)],
    ]
    np.testing.assert_allclose(rows, wanted, atol=1e-6)
    assert [name for name, _ in bearing_fields(TEAM)[6:]] == [
        *("d_other1", "seen_other1", "d_other2", "seen_other2")
    ]


def test_bearing_knows_no_distance(arena: SimpleNamespace):
    near, far = place((0, 0, 1), (1, 1, 1.5)), place((0, 0, 1), (3, 3, 2.5))
    look = layout_of("bearing", GameConfig()).observe
    np.testing.assert_allclose(look(near, jnp.ones(3))[0], look(far, jnp.ones(3))[0], atol=1e-6)


def slots_of(rows: np.ndarray, k: int) -> np.ndarray:
    """Slots [A, 2 groups, k, 10] of `observe_nearest`."""
    return np.asarray(rows)[:, 19:].reshape(len(rows), 2, k, 10)


def test_nearest_by_hand():
    """Three defenders and an attacker on a line, yawed by 90 degrees to the left: ahead is world y.

    The attacker is rolled by 90 degrees to the right, its thrust along world -y. Two slots each.
    """
    left = (HALF, 0, 0, HALF)
    drones = place(
        (0, 0, 1),
        (0, 3, 1),
        (0, -0.5, 1),
        (0, 1, 2),
        quaternions=[left, left, left, (HALF, HALF, 0, 0)],
    )
    drones = drones._replace(velocity=np.float32([[0, 0, 0], [0, 2, 0], [0, 0, 0], [1, 0, 5]]))
    rows = jax.jit(partial(observe_nearest, (0, 0, 0, 1), 2))(drones, jnp.zeros(3))
    assert rows.shape == (4, sum(size for _, size in nearest_fields(2))) == (4, 59)
    mates, opponents = slots_of(rows, 2)[0]
    wanted = [[-0.5, 0, 0, 0, 0, 0, 0, 0, 1, 1], [3, 0, 0, 2, 0, 0, 0, 0, 1, 1]]
    np.testing.assert_allclose(mates, wanted, atol=1e-6)
    attacker = [1, 0, 1, 0, -1, 5, -1, 0, 0, 1]  # to its right is world x
    np.testing.assert_allclose(opponents, [attacker, [0] * 10], atol=1e-6)
    mates, opponents = slots_of(rows, 2)[3]
    assert not mates.any()
    # of three the two nearest; in its frame world y is -z, world z is y
    wanted = [[0, -1, 1, 0, 0, 0], [0, -1, 1.5, 0, 0, 0]]
    np.testing.assert_allclose(opponents[:, :6], wanted, atol=1e-6)
    names = [name for name, _ in nearest_fields(2)]
    assert names[6:10] == ["p_mate1", "v_mate1", "z_mate1", "seen_mate1"]
    assert names[-1] == "seen_opponent2" and len(names) == 6 + 4 * 4


def test_nearest_of_any_team_has_one_length_and_swapping_team_mates_changes_nothing():
    random = np.random.default_rng(4)
    drones = attacker_near(2.0, random)
    more = Drones(
        *(np.concatenate([a, b]) for a, b in zip(drones, attacker_near(3.0, random), strict=True))
    )
    look = lambda sides, drones: np.asarray(observe_nearest(sides, 3, drones, jnp.zeros(3)))
    duel, four = look((0, 1), drones), look((0, 0, 1, 1), more)
    assert duel.shape[1] == four.shape[1] == 79
    swapped = Drones(*(field[[1, 0, 2, 3]] for field in more))
    np.testing.assert_array_equal(look((0, 0, 1, 1), swapped), four[[1, 0, 2, 3]])


def test_nearest_passes_over_who_is_hidden():
    """The nearest opponent is not seen: the next one takes its slot."""
    drones = place((0, 0, 0), (1, 0, 0), (4, 0, 0))
    seen = jnp.ones((3, 3), bool).at[0, 1].set(False)
    rows = observe_nearest((0, 1, 1), 1, drones, jnp.zeros(3), seen)
    np.testing.assert_allclose(slots_of(rows, 1)[0, 1, 0, :3], (4, 0, 0), atol=1e-6)


def test_range_and_field_of_view_by_hand():
    """Along x at 2 m; 45 degrees to the left at 2.83 m; behind at 1 m."""
    drones = place((0, 0, 0), (2, 0, 0), (2, 2, 0), (-1, 0, 0))
    of_first = lambda **limits: sight(SensorConfig(**limits), drones)[0].tolist()
    assert of_first(range=2.5) == [True, True, False, True]
    assert of_first(range=1.5) == [True, False, False, True]
    assert of_first(field_of_view=89.0) == [True, True, False, False]
    assert of_first(field_of_view=91.0) == [True, True, True, False]
    assert of_first(field_of_view=359.0) == [True, True, True, False]
    assert of_first(range=2.5, field_of_view=91.0) == [True, True, False, False]
    assert of_first() == [True] * 4
    up = drones._replace(quaternion=np.tile(np.float32([HALF, 0, -HALF, 0]), (4, 1)))  # x looks up
    assert sight(SensorConfig(field_of_view=170.0), up)[0].tolist() == [True, False, False, False]


def test_dropout_misses_its_share_for_each_pair_on_its_own():
    drones, words = place((0, 0, 0), (1, 0, 0)), jnp.arange(4000, dtype=jnp.uint32)
    look = lambda word: in_sight(SensorConfig(dropout=0.3), drones, word, jnp.int32(5))
    seen = np.asarray(jax.jit(jax.vmap(look))(words))
    assert seen[:, 0, 0].all() and seen[:, 1, 1].all()
    mine, its = seen[:, 0, 1], seen[:, 1, 0]
    assert mine.mean() == pytest.approx(0.7, abs=0.03) and its.mean() == pytest.approx(
        0.7, abs=0.03
    )
    assert abs(np.corrcoef(mine, its)[0, 1]) < 0.05
    assert not sight(SensorConfig(dropout=1.0), drones)[0, 1]


def limited_combat(arena: SimpleNamespace, name: str, **limits) -> Combat:
    config = replace(Config(), game=GameConfig(observation=name), sensor=SensorConfig(**limits))
    return Combat(config, arena.combat.scene)


def state_of(drones: Drones, down: tuple[bool, ...] = (False, False)) -> EnvState:
    pose = np.concatenate([drones.position, drones.quaternion], axis=1).reshape(-1)
    twist = np.concatenate([drones.velocity, drones.rate], axis=1).reshape(-1)
    return EnvState(
        qpos=jnp.asarray(pose), qvel=jnp.asarray(twist), target=jnp.float32([5, 5, 1]),
        clock=jnp.int32(3), down=jnp.asarray(down), craft=Craft(word=jnp.uint32(7)),
    )  # fmt: skip


def attacker_near(x: float, random: np.random.Generator) -> Drones:
    """The defender at the origin, the attacker somewhere around (x, 0, 0), turning and moving."""
    other = random.normal(size=10)
    turned = other[3:7] / np.linalg.norm(other[3:7])
    drones = place((0, 0, 1), (x, *other[1:3]), quaternions=[(1, 0, 0, 0), turned])
    moving = np.float32([[1, 2, 3], random.normal(size=3)])
    return drones._replace(velocity=moving, rate=np.float32([[3, 2, 1], random.normal(size=3)]))


@pytest.mark.parametrize("name", SIZES)
def test_who_is_hidden_is_zero_and_changes_nobody_by_a_bit(name: str, arena: SimpleNamespace):
    combat = limited_combat(arena, name, range=3.0, position_noise=0.1)
    random, look = np.random.default_rng(2), jax.jit(combat.observe)
    far, farther, near = (look(state_of(attacker_near(x, random))) for x in (20.0, 30.0, 1.0))
    far, farther, near = np.asarray(far), np.asarray(farther), np.asarray(near)
    assert far.shape == (2, SIZES[name])
    np.testing.assert_array_equal(far[0], farther[0])
    assert np.abs(far[1] - farther[1]).max() > 1.0  # itself the attacker sees
    for side, columns in enumerate(TELLS[name]):
        rest = np.setdiff1d(np.arange(SIZES[name]), columns)
        assert not far[side, columns].any() and np.count_nonzero(far[side, rest]) >= 12
        assert np.count_nonzero(near[side, columns]) >= 4


def test_a_drone_that_is_down_is_flagged_as_hidden(arena: SimpleNamespace):
    """And the other's numbers stay what they are; without limits, without errors."""
    combat = Combat(Config(game=GameConfig(observation="bearing")), arena.combat.scene)
    drones = attacker_near(1.0, np.random.default_rng(3))
    both = combat.observe(state_of(drones).replace(craft=None))
    alone = combat.observe(state_of(drones, down=(True, False)).replace(craft=None))
    assert both[0, 22] == both[1, 22] == alone[0, 22] == 1.0
    np.testing.assert_array_equal(alone[1, 19:], 0.0)
    np.testing.assert_array_equal(alone[0], both[0])
    np.testing.assert_array_equal(alone[1, :19], both[1, :19])


@pytest.mark.long
def test_noise_does_not_decide_who_is_seen(arena: SimpleNamespace):
    """At 2.9 m of 3 m, with a deviation of 1 m: always."""
    combat = limited_combat(arena, "bearing", range=3.0, position_noise=1.0)
    state = state_of(place((0, 0, 1), (2.9, 0, 1)))
    look = lambda word: see(
        combat.config, combat.observation, state.replace(craft=Craft(word=word))
    )
    seen = np.asarray(jax.vmap(look)(jnp.arange(100, dtype=jnp.uint32)))
    assert (seen[..., 22] == 1.0).all() and np.abs(seen[:, 0, 19:22].std(axis=0)).min() > 0.05


@pytest.mark.long
def test_a_missed_measurement_stays_missed_until_the_next(arena: SimpleNamespace):
    """A period of 4 steps: the flag is that of the measurement, and comes late with it."""
    combat = limited_combat(arena, "bearing", dropout=0.5, period=4, latency=1)
    state, step = combat.reset(jax.random.key(5)), jax.jit(combat.step)
    hover, flags = jnp.zeros((2, 4)).at[:, 0].set(2 / 1.9 - 1), []
    for _ in range(49):
        state, output = step(state, hover)
        flags.append(np.asarray(output.observation[:, 22]))
    held = np.asarray(flags[4:48]).reshape(11, 4, 2)  # clock 5 is the first that knows that of 4
    assert (held == held[:, :1]).all() and 0 < held.sum() < held.size
    assert set(np.unique(held)) == {0.0, 1.0}


def test_what_cannot_hide_refuses_limits(arena: SimpleNamespace, monkeypatch):
    own = Observation((("v", 3),), lambda drones, target: drones.velocity)
    monkeypatch.setitem(OBSERVATIONS, "world", own)
    Combat(replace(Config(), sensor=SensorConfig(latency=2)), arena.combat.scene)
    with pytest.raises(UserError, match=r"world cannot hide a drone .*must be left out"):
        limited_combat(arena, "world", field_of_view=90.0)

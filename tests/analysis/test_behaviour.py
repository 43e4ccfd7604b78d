"""How fights end and are flown."""

import numpy as np
from tournaments import CONTROL_DT, build

from dronecombat_jax.analysis.behaviour import endings, flight
from dronecombat_jax.types import ATTACKER, DEFENDER, EnvState, FightRecord, FightResult

NAN = np.nan


def test_endings_counted_by_hand():
    cause = np.array([[[1, 1], [6, 2]], [[0, 0], [2, 2]]], np.int8)
    steps = np.array([[[10, 30], [100, 50]], [[0, 0], [40, 60]]])
    by_defender = endings(build(cause, steps=steps), DEFENDER)
    assert by_defender.fights.tolist() == [4, 2]
    np.testing.assert_allclose(by_defender.share[0, [1, 2, 6]], [0.5, 0.25, 0.25])
    np.testing.assert_allclose(by_defender.share[1, [1, 2, 6]], [0, 1, 0])
    np.testing.assert_allclose(by_defender.time[:, 1], [20 * CONTROL_DT, NAN])
    np.testing.assert_allclose(by_defender.time[:, 2], [50 * CONTROL_DT, 50 * CONTROL_DT])
    np.testing.assert_allclose(by_defender.duration[1], np.array([45, 50, 55]) * CONTROL_DT)
    by_attacker = endings(build(cause, steps=steps), ATTACKER)
    np.testing.assert_allclose(by_attacker.time[:, 2], [NAN, 50 * CONTROL_DT])
    assert by_attacker.fights.tolist() == [2, 4]
    np.testing.assert_allclose(by_attacker.duration[0], np.array([15, 20, 25]) * CONTROL_DT)


def test_an_entrant_that_never_played_has_no_endings():
    none = endings(build(np.array([[[1]], [[0]]], np.int8)), DEFENDER)
    assert none.fights.tolist() == [1, 0]
    assert np.isnan(none.share[1]).all() and np.isnan(none.duration[1]).all()


def record(defender, attacker, velocities, steps):
    """One fight of drones at the given positions [T + 1, 3] with the same final velocities [2, 3]
    throughout.
    """
    qpos = np.zeros((len(defender), 1, 14))
    qpos[:, 0, :3], qpos[:, 0, 7:10] = defender, attacker
    qvel = np.tile(
        np.concatenate([[*one, 9, 9, 9] for one in velocities]), (len(defender) - 1, 1, 1)
    )
    action = np.full((len(defender) - 1, 1, 2, 4), 0.5)
    action[steps:] = 1.0  # after the end: must not count
    start = EnvState(qpos=qpos[0], qvel=qvel[0], target=None, clock=None, down=None)
    return FightRecord(
        qpos[1:], qvel, action, start, FightResult(np.array([1]), np.array([steps]), None)
    )


def test_a_flight_described_by_hand():
    # The defender flies an L, 3 m east and 4 m north, in two steps, then its last state repeats;
    # the attacker waits at (3, 10, 2) with a velocity of 1 m/s towards it. So 5 m lie between the
    # defender's ends and 7 m were flown, 6 m lie between the drones and shrink by 2 + 1 m/s, and
    # the velocities are opposite.
    defender = [[0, 0, 1], [3, 0, 2], [3, 4, 2], [3, 4, 2]]
    attacker = [[3, 10, 2]] * 4
    told = flight(
        record(np.array(defender), np.array(attacker), [[0, 2, 0], [0, -1, 0]], steps=2), CONTROL_DT
    )
    assert told.time.tolist() == [2 * CONTROL_DT]
    np.testing.assert_allclose(told.closing_speed, [3.0])
    np.testing.assert_allclose(told.approach_angle, [np.pi])
    np.testing.assert_allclose(told.altitude, [[2.0, 2.0]])  # after each step: 2 and 2
    np.testing.assert_allclose(told.lowest, [[1.0, 2.0]])
    length = np.sqrt(10) + 4
    np.testing.assert_allclose(told.path_ratio, [[length / np.sqrt(26), NAN]])
    np.testing.assert_allclose(told.control_effort, [[1.0, 1.0]])


def test_a_chase_from_behind_closes_slowly_and_a_drone_at_rest_has_no_angle():
    behind, ahead = np.array([[0, 0, 1]] * 2), np.array([[0, 5, 1]] * 2)
    told = flight(record(behind, ahead, [[0, 3, 0], [0, 1, 0]], steps=1), CONTROL_DT)
    np.testing.assert_allclose(told.closing_speed, [2.0])
    np.testing.assert_allclose(told.approach_angle, [0.0])
    still = flight(record(behind, ahead, [[0, 3, 0], [0, 0, 0]], steps=1), CONTROL_DT)
    assert np.isnan(still.approach_angle).all()


def test_a_team_is_the_mean_over_its_drones_each_as_long_as_it_flies():
    """Two defenders, the second down after one step of two at full thrust, one attacker that rests;
    the second is nearest to it at the end and lies still there.
    """
    position = np.zeros((3, 1, 3, 3))
    position[:, 0, 0] = [[0, 0, 1], [0, 0, 3], [0, 0, 5]]
    position[:, 0, 1] = [[9, 3, 2], [9, 0, 2], [9, 9, 9]]  # must not count once it is down
    position[:, 0, 2] = [[9, 5, 4]] * 3
    qpos = np.concatenate([position, np.zeros((3, 1, 3, 4))], axis=-1).reshape(3, 1, 21)
    qvel = np.zeros((2, 1, 3, 6))
    qvel[:, 0, 0, 2], qvel[:, 0, 1, 1] = 4.0, 2.0
    qvel = qvel.reshape(2, 1, 18)
    action = np.full((2, 1, 3, 4), 0.5)
    action[0, 0, 1], action[1, 0, 1] = 1.0, 9.0
    down = np.array([[[False, True, False]], [[False, True, False]]])
    start = EnvState(qpos=qpos[0], qvel=qvel[0], target=None, clock=None, down=down[0] & False)
    result = FightResult(np.array([1]), np.array([2]), None)
    fights = FightRecord(qpos[1:], qvel, action, start, result, down, down & False)
    seen = flight(fights, CONTROL_DT, (0, 0, 1))
    np.testing.assert_allclose(seen.altitude, [[(4.0 + 2.0) / 2, 4.0]])
    np.testing.assert_allclose(seen.lowest, [[1.0, 4.0]])
    np.testing.assert_allclose(seen.path_ratio, [[1.0, NAN]])
    np.testing.assert_allclose(seen.control_effort, [[(1.0 + 4.0) / 2, 1.0]])
    # From the second defender, at the end, (0, -4, -5) m to the attacker, and it flies 2 m/s along y.
    np.testing.assert_allclose(seen.closing_speed, [-2.0 * 4.0 / np.sqrt(41.0)])

"""Scripted teams: who minds whom, by an exhaustive search, and where they want to go, by hand."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from toy import Coasting

from dronecombat_jax.arena.match import fight, scripted_team, start_fights
from dronecombat_jax.arena.players import Player, alike, kind_of, names_flown, scripted_numbers
from dronecombat_jax.combat.autopilot import Airframe, airframe
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.guidance import NAVIGATION_CONSTANT, dash, proportional_navigation
from dronecombat_jax.combat.scripted import PILOTS, build_pilot, names_of
from dronecombat_jax.combat.teamwork import (
    PINCER_END,
    TEAMWORK,
    Field,
    assign,
    assigned_navigation,
    decoy,
    minded,
    pincer,
    situation,
    times_to_go,
)
from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.tournaments.contenders import find
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, Drones

TARGET = (5.0, 5.0, 1.0)


@pytest.fixture(scope="module")
def combat() -> Coasting:
    return Coasting(Config(game=GameConfig(defenders=2, attackers=2)))


@pytest.fixture(scope="module")
def body(combat: Coasting) -> Airframe:
    return airframe(combat.config, combat.scene, 0)


def drones(places, velocities=None) -> Drones:
    """One fight; level, and at rest where no velocities are given."""
    position = jnp.asarray([places], jnp.float32)
    speed = jnp.zeros_like(position) if velocities is None else jnp.asarray([velocities])
    level = jnp.broadcast_to(jnp.asarray([1.0, 0.0, 0.0, 0.0]), (*position.shape[:2], 4))
    return Drones(position, level, speed, jnp.zeros_like(position))


def field(own, others, own_fly=None, others_fly=None, target=TARGET) -> Field:
    flags = lambda given, places: jnp.asarray([given or [True] * len(places)])
    return Field(
        drones(own), drones(others), flags(own_fly, own), flags(others_fly, others),
        jnp.asarray([target]), jnp.zeros(1),
    )  # fmt: skip


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (1, 5), (2, 2), (3, 5), (6, 8), (8, 8)])
def test_an_assignment_has_the_least_sum(rows: int, columns: int):
    """By scipy's Jonker-Volgenant."""
    costs = np.random.default_rng(rows).uniform(0, 3, (5, rows, columns)).astype(np.float32)
    for cost, found in zip(costs, np.asarray(jax.jit(jax.vmap(assign))(costs)), strict=True):
        assert len(set(found.tolist())) == rows
        np.testing.assert_array_equal(found, linear_sum_assignment(cost)[1])


def test_ties_have_one_answer_of_the_least_sum():
    """Costs 0 or 1, so that many assignments are as good; by all permutations."""
    costs = np.random.default_rng(0).integers(0, 2, (20, 4, 4)).astype(np.float32)
    for cost in costs:
        least = min(cost[range(4), way].sum() for way in itertools.permutations(range(4)))
        found = np.asarray(assign(jnp.asarray(cost)))
        assert len(set(found.tolist())) == 4 and cost[range(4), found].sum() == least


@pytest.mark.parametrize(
    ("cost", "expected"),
    [
        ([[1.0, 2.0], [1.1, 5.0]], [1, 0]),  # both would reach opponent 0 first: they share
        ([[3.0, 1.0, 2.0]], [1]),  # alone against three: the nearest
        ([[1.0], [0.5]], [0, 0]),  # who is left over helps
        ([[1.0, 4.0], [2.0, 9.0], [3.0, 3.5]], [0, 0, 1]),  # 1 + 3.5; drone 1 helps with 0
        ([[1.0, 1e3], [2.0, 1e3]], [0, 0]),  # opponent 1 is down: nobody minds it
        ([[1e3, 1e3], [2.0, 1.0]], [0, 1]),  # drone 0 is down: the other takes the nearest
    ],
)
def test_who_minds_whom(cost: list, expected: list):
    assert minded(jnp.asarray([cost]))[0].tolist() == expected


def test_the_time_to_go_is_that_of_full_thrust(body: Airframe):
    """4 m apart, closing at 2 + 1 m/s: c t + a t^2 / 2 = d; and never with who is down."""
    told = field([(0.0, 0.0, 1.0)], [(4.0, 0.0, 1.0), (4.0, 0.0, 1.0)], others_fly=[True, False])
    told = told._replace(
        own=drones([(0.0, 0.0, 1.0)], [(2.0, 0.0, 0.0)]),
        others=drones([(4.0, 0.0, 1.0)] * 2, [(-1.0, 0.0, 0.0)] * 2),
    )
    first, second = times_to_go(body, told)[0, 0]
    assert float(3.0 * first + 0.5 * body.max_force * first**2) == pytest.approx(4.0, rel=1e-5)
    assert second == 1e3


def test_defenders_fly_the_navigation_against_their_own(body: Airframe):
    """Both are nearer to attacker 0; defender 1 is the one for which attacker 1 costs less."""
    told = field([(0, 4, 1), (2, 4, 1)], [(0.5, 0, 1), (5, 0, 1)])
    for number, other in ((0, 0), (1, 1)):
        seen = situation(told, number, jnp.asarray([other]))
        expected = proportional_navigation(body, seen, NAVIGATION_CONSTANT)
        np.testing.assert_allclose(assigned_navigation(body, told, number), expected, rtol=1e-6)


@pytest.mark.parametrize(("count", "angles"), [(1, [0]), (2, [45, -45]), (3, [45, 0, -45])])
def test_a_pincer_comes_from_several_sides(count: int, angles: list[int], body: Airframe):
    """From 6 m over ground, twice PINCER_END and more: in degrees to the left of the way."""
    told = field([(-1, 5, 1)] * count, [(0, 0, 1)])
    for number, angle in enumerate(angles):
        x, y, _ = np.asarray(pincer(body, told, number))[0]
        assert np.degrees(np.arctan2(y, x)) == pytest.approx(angle, abs=0.01)


def test_a_pincer_flies_straight_at_the_end(body: Airframe):
    told = field([(5 - PINCER_END, 5, 1)] * 2, [(0, 0, 1)])
    seen = situation(told, 0, jnp.asarray([0]))
    np.testing.assert_allclose(pincer(body, told, 0), dash(body, seen), atol=1e-4)


def test_a_decoy_turns_away_from_who_chases_it_and_the_others_dash(body: Airframe):
    """The defender is 1 m from attacker 0, on its way, and 3 m from attacker 1."""
    own, others = [(0, 5, 1), (0, 2, 1)], [(1, 5, 1.5)]
    told = field(own, others)
    straight = [np.asarray(dash(body, situation(told, n, jnp.asarray([0])))) for n in (0, 1)]
    x, y, _ = np.asarray(decoy(body, told, 0))[0]
    assert x < -1.0 and abs(y) < 1e-3
    np.testing.assert_array_equal(decoy(body, told, 1), straight[1])
    alone = field(own, others, own_fly=[True, False])  # the last one flies on
    np.testing.assert_array_equal(decoy(body, alone, 0), straight[0])
    calm = field(own, others, others_fly=[False])  # a defender that is down draws nobody
    np.testing.assert_array_equal(decoy(body, calm, 0), straight[0])
    far = field(own, [(2.1, 5, 1)])
    np.testing.assert_array_equal(decoy(body, far, 0), straight[0])


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("assigned_navigation", "proportional_navigation"),
        ("pincer", "dash"),
        ("decoy", "dash"),
    ],
)
def test_in_a_duel_they_fly_as_the_plain_ones(name: str, plain: str):
    combat = Coasting(Config())
    start = jax.vmap(combat.reset)(jax.random.split(jax.random.key(1), 4))
    actions = [
        build_pilot(word, combat.config, combat.scene)(start, start.qpos, jax.random.key(0))
        for word in (name, plain)
    ]
    np.testing.assert_allclose(actions[0], actions[1], atol=1e-5)


@pytest.mark.parametrize("name", [name for laws in TEAMWORK.values() for name in laws])
def test_who_is_down_changes_nobodys_action(name: str, combat: Coasting):
    """A drone of each side lies down, and may lie anywhere."""
    side = DEFENDER if name in TEAMWORK[DEFENDER] else ATTACKER
    pilot = build_pilot(name, combat.config, combat.scene, side, 2 * side)
    start = jax.vmap(combat.reset)(jax.random.split(jax.random.key(2), 6))
    start = start.replace(down=start.down.at[:, jnp.asarray([1, 3])].set(True))
    act = jax.jit(lambda state: pilot(state, state.qpos, jax.random.key(0)))
    moved = start.qpos.reshape(6, 4, 7).at[:, jnp.asarray([1, 3]), :2].add(1.5)
    there, elsewhere = act(start), act(start.replace(qpos=moved.reshape(6, 28)))
    np.testing.assert_array_equal(there, elsewhere)


@pytest.mark.slow
def test_who_shares_the_work_stops_more_attackers():
    """Preset 2v2 in MJX, the same 32 starts: two that each take the nearest, against two that share."""
    combat = Combat(settings.load("2v2"))
    start = start_fights(combat, jax.random.key(0), 32)
    attack = scripted_team(combat, "pincer", ATTACKER)

    def stopped(name: str) -> int:
        defend = scripted_team(combat, name, DEFENDER)
        fly = jax.jit(lambda start: fight(combat, defend, attack, start, jax.random.key(1)))
        return int(np.sum(np.asarray(fly(start).cause) == Cause.INTERCEPT))

    shared, alone = stopped("assigned_navigation"), stopped("proportional_navigation")
    print(f"stopped of 32: {shared} sharing, {alone} each on its own")
    assert shared > alone


def test_they_stand_beside_the_plain_ones_and_have_a_program_of_their_own():
    assert names_of(DEFENDER)[-2] == "assigned_navigation"
    assert {"pincer", "decoy"} <= set(names_of(ATTACKER)) - set(PILOTS[ATTACKER])
    plain = {contender.entrant.label for contender in find("scripted:all").contenders}
    assert not plain & {name for laws in TEAMWORK.values() for name in laws}
    (contender,) = find("scripted:pincer").contenders
    assert contender.role == ATTACKER
    players = [Player(name, name) for name in ("dash", "pincer", "weave", "decoy")]
    assert alike(players) == [[0, 2], [1, 3]]
    kind = kind_of(players[1::2])
    assert kind.teams and not kind_of(players[::2]).teams
    assert names_flown(kind, ATTACKER) == ["pincer", "decoy"]
    assert scripted_numbers(players[1::2], ATTACKER).tolist() == [0, 1]
    assert scripted_numbers(players[::2], ATTACKER).tolist() == [0, 1]

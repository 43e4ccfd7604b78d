"""The rules: every cause under every switch, precedence, tunnelling, and who has won."""

from functools import partial
from typing import NamedTuple

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dronecombat_jax.combat.games import GAMES
from dronecombat_jax.combat.rules import (
    closest_approach,
    detect,
    outcome_table,
    timeout_decides,
)
from dronecombat_jax.config.fields import GameConfig
from dronecombat_jax.types import Cause, Outcome

CRASH_RULES = ("ends", "out", "grounded")
NONE, INTERCEPT, REACHED, DEFENDER_CRASH, ATTACKER_CRASH, BOTH_CRASH, TIMEOUT, *_ = Cause
TARGET = (5.0, 5.0, 1.0)
HOME, AWAY = (0.0, 5.0, 1.0), (0.0, 0.0, 1.0)  # defender's and attacker's start
LAST = 500


class Scenario(NamedTuple):
    """One control step and the cause expected of it under `ends`, `out`, `grounded`, and in `solo`."""

    name: str
    defender: tuple  # one place, or a pair: before and after the step
    attacker: tuple
    expected: tuple[Cause, Cause, Cause]
    solo: Cause
    clock: int = 7
    down: tuple[bool, bool] = (False, False)


SCENARIOS = [
    Scenario("nothing", HOME, AWAY, (NONE,) * 3, NONE),
    Scenario("interception", HOME, (0, 4.6, 1), (INTERCEPT,) * 3, NONE),
    Scenario("at the radius is not within it", HOME, (0, 4.5, 1), (NONE,) * 3, NONE),
    Scenario("target reached", HOME, (5, 5, 0.6), (REACHED,) * 3, REACHED),
    Scenario("at the target's radius", HOME, (5, 4.5, 1), (NONE,) * 3, NONE),
    Scenario("a defender at the target is nothing", TARGET, AWAY, (NONE,) * 3, NONE),
    Scenario("defender crashes", (0, 5, 0.19), AWAY, (DEFENDER_CRASH, NONE, NONE), NONE),
    Scenario("attacker crashes", HOME, (0, 0, 0.19), (ATTACKER_CRASH, ATTACKER_CRASH, NONE), ATTACKER_CRASH),
    Scenario("just above the ground", (0, 5, 0.21), (0, 0, 0.21), (NONE,) * 3, NONE),
    Scenario("both crash at once", (0, 5, 0.1), (0, 0, -3), (BOTH_CRASH,) * 3, ATTACKER_CRASH),
    Scenario("time-out", HOME, AWAY, (TIMEOUT,) * 3, TIMEOUT, LAST),
    Scenario("one step before", HOME, AWAY, (NONE,) * 3, NONE, LAST - 1),
    # Simultaneous events: the first of intercept, reached, crash, time-out counts.
    Scenario("caught at the target", (5, 4.8, 1), (5, 4.7, 1), (INTERCEPT,) * 3, REACHED),
    Scenario("caught while both crash", (0, 0, 0.1), (0, 0.3, 0.1), (INTERCEPT,) * 3, ATTACKER_CRASH),
    Scenario("reached while the defender crashes", (0, 5, 0), TARGET, (REACHED,) * 3, REACHED),
    Scenario("everything at once", (5, 5, 0.1), ((5, 5, 1), (5, 5, 0.1)), (INTERCEPT,) * 3, REACHED, LAST),
    Scenario("reached at the last step", HOME, TARGET, (REACHED,) * 3, REACHED, LAST),
    Scenario("defender crashes at the last step", (0, 5, 0), AWAY, (DEFENDER_CRASH, TIMEOUT, TIMEOUT), TIMEOUT, LAST),
    Scenario(
        "attacker crashes at the last step", HOME, (0, 0, 0), (ATTACKER_CRASH, ATTACKER_CRASH, TIMEOUT), ATTACKER_CRASH,
        LAST,
    ),
    # Fast drones: 3 m in a step.
    Scenario("flies through the defender", HOME, ((-1.5, 5.3, 1), (1.5, 5.3, 1)), (INTERCEPT,) * 3, NONE),
    Scenario("flies through the target", HOME, ((5, 3.5, 1.2), (5, 6.5, 1.2)), (REACHED,) * 3, REACHED),
    Scenario("paths cross, at different times", ((0, 5, 1), (2, 5, 1)), ((1, 5, 1), (1, 9, 1)), (NONE,) * 3, NONE),
    Scenario("side by side at 3 m a step", ((0, 0, 1), (3, 0, 1)), ((0, 1, 1), (3, 1, 1)), (NONE,) * 3, NONE),
    Scenario("head on, past each other", ((0, 0, 1), (3, 0, 1)), ((3, 0, 1), (0, 0, 1)), (INTERCEPT,) * 3, NONE),
    Scenario("within reach already at the start", HOME, ((5, 4.7, 1), (5, 4.4, 1)), (REACHED,) * 3, REACHED),
    # A drone that is down neither strikes, is struck nor crashes again; a downed attacker lies only
    # under `grounded`.
    Scenario("through a downed defender", (0, 5, 0.1), (0, 5, 0.4), (NONE,) * 3, NONE, down=(True, False)),
    Scenario("reached past a downed defender", (5, 5, 0.1), TARGET, (REACHED,) * 3, REACHED, down=(True, False)),
    Scenario("a downed attacker at the target", HOME, (5, 5, 0.9), (NONE,) * 3, NONE, down=(False, True)),
    Scenario("a downed attacker and the clock", HOME, (0, 0, 0), (TIMEOUT,) * 3, TIMEOUT, LAST, down=(False, True)),
    Scenario("the attacker follows", (0, 5, 0), (0, 0, 0), (ATTACKER_CRASH, ATTACKER_CRASH, BOTH_CRASH), ATTACKER_CRASH, down=(True, False)),
    Scenario("the defender follows", (0, 5, 0), (0, 0, 0), (DEFENDER_CRASH, NONE, BOTH_CRASH), NONE, down=(False, True)),
]  # fmt: skip


def causes(game: GameConfig) -> list[str]:
    """Name of the cause of every scenario under `game`."""

    @jax.jit
    @jax.vmap
    def judged(before, after, down, clock):
        return GAMES[game.scenario].judge(
            game, detect(game, before, after, np.array(TARGET, np.float32), down, clock)
        )

    paths = np.array([[path_of(s.defender), path_of(s.attacker)] for s in SCENARIOS], np.float32)
    absent = GAMES[game.scenario].absent()
    down = np.array([s.down for s in SCENARIOS]) | absent
    found = judged(
        paths[:, :, 0], paths[:, :, 1], down, np.array([s.clock for s in SCENARIOS], np.int32)
    )
    return [Cause(int(cause)).name for cause in found]


def path_of(places: tuple) -> tuple:
    """Before and after the step; the crash altitude is crossed in the step, so before it all was
    well.
    """
    if isinstance(places[0], tuple):
        return places
    return (*places[:2], max(places[2], 0.5)), places


def named(expected: list[Cause]) -> dict[str, str]:
    return {s.name: cause.name for s, cause in zip(SCENARIOS, expected, strict=True)}


def found(game: GameConfig) -> dict[str, str]:
    return {s.name: cause for s, cause in zip(SCENARIOS, causes(game), strict=True)}


@pytest.mark.parametrize("timeout_rule", ["draw", "defender"])
@pytest.mark.parametrize("crash_rule", CRASH_RULES)
def test_cause_of_every_scenario(crash_rule, timeout_rule):
    game = GameConfig(crash_rule=crash_rule, timeout_rule=timeout_rule)
    assert found(game) == named([s.expected[CRASH_RULES.index(crash_rule)] for s in SCENARIOS])


@pytest.mark.parametrize("crash_rule", CRASH_RULES)
def test_cause_of_every_scenario_without_a_defender(crash_rule):
    assert found(GameConfig(scenario="solo", crash_rule=crash_rule)) == named(
        [s.solo for s in SCENARIOS]
    )


def test_only_the_swept_check_sees_what_happens_between_two_samples():
    swept, ends = found(GameConfig()), found(GameConfig(swept_events=False))
    assert {name for name in swept if swept[name] != ends[name]} == {
        "flies through the defender",
        "flies through the target",
        "head on, past each other",
        "within reach already at the start",
    }
    assert ends["flies through the target"] == ends["head on, past each other"] == "NONE"


def test_a_margin_widens_or_narrows_the_reach_of_the_defender_alone():
    def events(margin: float, *places: tuple[float, float, float]) -> tuple[bool, bool]:
        stand = np.asarray(places)
        on_air = np.zeros(2, bool)
        seen = detect(GameConfig(), stand, stand, np.asarray(TARGET), on_air, np.int32(7), margin)
        return bool(seen.intercept), bool(seen.reached)

    near = HOME, (0.0, 4.4, 1.0)  # 0.6 m apart
    assert [events(margin, *near)[0] for margin in (0.0, 0.05, 0.15)] == [False, False, True]
    near = HOME, (0.0, 4.6, 1.0)
    assert [events(margin, *near)[0] for margin in (0.0, -0.05, -0.15)] == [True, True, False]
    assert events(-0.3, HOME, (5.0, 5.0, 0.6)) == (False, True)


def test_radii_and_clock_are_settings():
    touch = found(
        GameConfig(intercept_radius=0.1, reach_radius=0.1, crash_altitude=0.05, episode_steps=7)
    )
    assert touch["interception"] == touch["target reached"] == "TIMEOUT"
    assert touch["defender crashes"] == "TIMEOUT"
    assert touch["caught at the target"] == "TIMEOUT"  # 0.1 m apart, to the last bit not within it
    assert touch["reached at the last step"] == "REACHED"


@pytest.mark.parametrize("timeout_rule", ["draw", "defender"])
def test_who_has_won(timeout_rule):
    table = outcome_table(GameConfig(timeout_rule=timeout_rule))
    won = {cause.name: table[cause].name for cause in Cause}
    assert won == {
        "NONE": "DRAW",
        "INTERCEPT": "DEFENDER",
        "REACHED": "ATTACKER",
        "DEFENDER_CRASH": "ATTACKER",
        "ATTACKER_CRASH": "DEFENDER",
        "BOTH_CRASH": "DRAW",
        "TIMEOUT": "DEFENDER" if timeout_rule == "defender" else "DRAW",
        "DIVERGED": "DRAW",
        "DEFENDER_INVALID": "ATTACKER",
        "ATTACKER_INVALID": "DEFENDER",
        "BOTH_INVALID": "DRAW",
    }
    assert timeout_decides(GameConfig(timeout_rule=timeout_rule)) == (
        table[TIMEOUT] == Outcome.DEFENDER
    )


places = st.lists(st.floats(-8, 8, width=32), min_size=3, max_size=3).map(
    partial(np.array, dtype=np.float32)
)
approach = jax.jit(closest_approach)


@settings(max_examples=150, deadline=None)
@given(start=places, end=places)
def test_closest_approach_against_sampling(start, end):
    samples = start + np.linspace(0, 1, 4001)[:, None] * (end - start)
    nearest = np.linalg.norm(samples, axis=-1).min()
    spacing = np.linalg.norm(end - start) / 4000
    assert nearest - spacing - 1e-4 <= approach(start, end) <= nearest + 1e-4


def test_closest_approach_of_one_that_stands_still():
    place = np.array([3.0, 0.0, 4.0], np.float32)
    assert approach(place, place) == 5.0
    assert approach(np.zeros(3, np.float32), np.zeros(3, np.float32)) == 0.0

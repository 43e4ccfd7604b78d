"""What replay pages, pictures and films are told of a fight of teams."""

import base64

import numpy as np
import pytest
from duels import RULES, duel, two_against_two

from dronecombat_jax.config.sides import DUEL, sides_of
from dronecombat_jax.report.drawn_fight import aim, finite_part, interpolate, numbers, watched
from dronecombat_jax.report.endings import shown_names, verdict
from dronecombat_jax.report.fight_events import strikers
from dronecombat_jax.report.replay_data import MOST_STATES, Fight, replay_data
from dronecombat_jax.types import Cause, Outcome

REACHED = RULES._replace(
    winners=tuple(Outcome.ATTACKER if c == Cause.REACHED else Outcome.DRAW for c in Cause)
)


def data_of(flown, rules=REACHED) -> dict:
    return replay_data("", "", [Fight(flown, "fight", ("d", "a"))], rules)["fights"][0]


def test_a_duel_says_nothing_of_teams():
    assert {"sides", "names"} & set(data_of(duel())) == set()


def test_all_drones_are_packed_in_order():
    flown, fight = two_against_two(), data_of(two_against_two())
    packed = np.frombuffer(base64.b64decode(fight["states"]), "<i2").reshape(101, 4, 14) / 32767
    assert fight["sides"] == (0, 0, 1, 1)
    assert fight["names"] == ("defender 1", "defender 2", "attacker 1", "attacker 2")
    places = flown.qpos.reshape(101, 4, 7)[..., :3]
    np.testing.assert_allclose(packed[..., :3] * fight["extent"], places, atol=2e-4)
    np.testing.assert_allclose(packed[..., 10:], flown.action, atol=2e-5)


def test_the_states_of_a_page_do_not_grow_with_the_teams():
    """Four drones keep half as many states as two."""
    fight = data_of(two_against_two(MOST_STATES))
    assert fight["frames"] <= MOST_STATES // 2


def test_events_tell_who_struck_whom_who_crashed_and_who_arrived():
    events = data_of(two_against_two())["events"]
    told = [
        (event["kind"], event["text"], event["roles"], round(event["time"], 2)) for event in events
    ]
    assert told == [
        ("strike", "Defender 2 strikes attacker 2", [3], 0.8),
        ("crash", "Defender 1 crashes", [0], 1.2),
        ("end", "Attacker 1 reaches the target", [], 2.0),
    ]
    assert [event["colour"] for event in events] == ["defender", "defender", "attacker"]


def test_of_several_defenders_within_the_radius_all_struck():
    flown = two_against_two()
    assert strikers(flown, 40, 3, REACHED) == [1]
    places = flown.qpos.reshape(101, 4, 7)
    places[39:41, 0, :3] = places[39:41, 3, :3] + np.array([0.0, 0.4, 0.0])
    assert strikers(flown, 40, 3, REACHED) == [0, 1]
    flown.down[39, 0] = True  # who was down struck nobody
    assert strikers(flown, 40, 3, REACHED) == [1]
    far = REACHED._replace(intercept_radius=0.01)  # the nearest, where rounding leaves none
    assert strikers(flown, 40, 3, far) == [1]


def test_a_pass_between_two_states_counts_only_where_the_rules_sweep():
    """0.3 m before and after, straight through: 0 m on the way; the other stays 0.2 m away."""
    flown = two_against_two()
    places = flown.qpos.reshape(101, 4, 7)[..., :3]
    places[39:41, 0] = places[39:41, 3] + np.array([[0.3, 0.0, 0.0], [-0.3, 0.0, 0.0]])
    places[39:41, 1] = places[39:41, 3] + np.array([0.0, 0.2, 0.0])
    near = REACHED._replace(intercept_radius=0.1)
    assert strikers(flown, 40, 3, near) == [0]
    assert strikers(flown, 40, 3, near._replace(swept=False)) == [1]


def test_a_defender_that_goes_down_with_its_strike():
    flown = two_against_two()
    flown.down[40:, 1] = flown.struck[40:, 1] = True
    texts = [event["text"] for event in data_of(flown)["events"][:2]]
    assert texts == ["Defender 2 goes down with its strike", "Defender 2 strikes attacker 2"]


@pytest.mark.parametrize(
    ("sides", "cause", "winner", "sentence"),
    [
        ((2, 2), Cause.INTERCEPT, Outcome.DEFENDER, "Defenders win: the last attacker is struck"),
        ((2, 1), Cause.INTERCEPT, Outcome.DEFENDER, "Defenders win: the attacker is struck"),
        ((1, 2), Cause.REACHED, Outcome.ATTACKER, "Attackers win: an attacker reaches the target"),
        ((3, 1), Cause.REACHED, Outcome.ATTACKER, "Attacker wins: the attacker reaches the target"),
        ((1, 2), Cause.ATTACKER_CRASH, Outcome.DEFENDER, "Defender wins: no attacker flies any more"),
        ((2, 2), Cause.TIMEOUT, Outcome.DRAW, "Nobody wins: time runs out"),
    ],
)  # fmt: skip
def test_ends_of_teams_in_words(sides, cause: Cause, winner: Outcome, sentence: str):
    assert verdict(cause, winner, 1.5, sides_of(*sides)) == f"{sentence} after 1.50\u00a0s"


def test_names_for_people():
    assert shown_names(DUEL) == ("defender", "attacker")
    assert shown_names(sides_of(2, 1)) == ("defender 1", "defender 2", "attacker")


def test_a_film_watches_who_decided_and_counts_who_flies():
    """Attacker 1 (drone 2) arrives; defender 1 (drone 0) was nearest to it."""
    fight = finite_part(two_against_two())
    assert watched(fight) == (0, 2)
    assert numbers(fight, 100).startswith("1 of 2 defenders fly   1 of 2 attackers fly   ")
    assert numbers(fight, 100).endswith("attacker 0.00 m from the target")
    # attacker 2 is nearer to defender 2 until it is down
    qpos = fight.qpos.reshape(101, 4, 7)
    np.testing.assert_array_equal(aim(fight, 10, fight.qpos[10], 1), qpos[10, 3, :3])
    np.testing.assert_array_equal(aim(fight, 90, fight.qpos[90], 1), qpos[90, 2, :3])
    assert interpolate(fight, 0.37).shape == (28,)

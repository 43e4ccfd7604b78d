"""What a replay page is told about its fights: states to a thousandth, events, who wins and why."""

import base64
import json

import jax
import numpy as np
import pytest
from duels import CONTROL_DT, RULES, duel, fights

from dronecombat_jax.arena.match import drawn_numbers
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.fields import Config, GameConfig, RandomiseConfig, SimConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.report.endings import verdict
from dronecombat_jax.report.replay_data import MOST_STATES, Fight, replay_data
from dronecombat_jax.report.shown_rules import rules_of
from dronecombat_jax.sim.scene import load_scene
from dronecombat_jax.types import Cause, Outcome


def data_of(*trajectories, rules=RULES) -> list[dict]:
    shown = [Fight(flown, "fight", ("d", "a")) for flown in trajectories]
    return replay_data("title", "about", shown, rules)["fights"]


def unpacked(fight: dict) -> np.ndarray:
    """The states [T, A, 14] as `viewer/src/flight.js` reads them."""
    numbers = np.frombuffer(base64.b64decode(fight["states"]), "<i2").reshape(-1, 2, 14) / 32767
    scales = [fight["extent"]] * 3 + [1.0] * 4 + [fight["fastest"]] * 3 + [1.0] * 4
    return numbers * scales


def test_states_survive_packing_to_a_fraction_of_a_millimetre():
    flown = duel()
    (fight,) = data_of(flown)
    states = unpacked(fight)
    qpos, qvel = flown.qpos.reshape(-1, 2, 7), flown.qvel.reshape(-1, 2, 6)
    assert states.shape == (101, 2, 14) and fight["frames"] == 101 and fight["dt"] == CONTROL_DT
    np.testing.assert_allclose(states[..., :3], qpos[..., :3], atol=2e-4)  # m
    np.testing.assert_allclose(states[..., 3:7], qpos[..., 3:], atol=2e-5)
    np.testing.assert_allclose(states[..., 7:10], qvel[..., :3], atol=2e-4)  # m/s
    np.testing.assert_allclose(states[..., 10:], flown.action, atol=2e-5)


@pytest.mark.parametrize(
    ("count", "steps", "every"), [(1, 8191, 1), (1, 8192, 2), (16, 500, 1), (16, 30_000, 59)]
)
def test_long_fights_are_thinned_out_and_keep_their_end(count: int, steps: int, every: int):
    """16 fights may keep 512 states each: of 30,001 every 59th are 509, and the last."""
    thinned = replay_data("", "", fights(count, steps), RULES)["fights"]
    assert all(fight["dt"] == pytest.approx(every * CONTROL_DT) for fight in thinned)
    assert sum(fight["frames"] for fight in thinned) <= MOST_STATES
    assert unpacked(thinned[0])[-1, 1, :3] == pytest.approx(
        fights(1, steps)[0].trajectory.qpos[-1, 7:10], abs=1e-3
    )
    assert thinned[0]["result"]["time"] == pytest.approx(steps * CONTROL_DT)


def test_what_was_drawn_for_the_drones_is_written_down():
    """For each fight and drone, over the nominal numbers; nothing where nothing was drawn."""
    config = Config(randomise=RandomiseConfig(mass=0.2, lag=0.4), sim=SimConfig(actuation="rotors"))
    combat = Combat(config)
    start = jax.vmap(combat.spawn)(combat.start_numbers(jax.random.key(0), (3,)))
    assert start.craft is not None and start.craft.drawn is not None
    drawn = drawn_numbers(config, start, 1)
    assert drawn.keys() == {"mass", "lag"}
    np.testing.assert_array_equal(drawn["lag"], np.asarray(start.craft.drawn.lag)[1])
    first, second = data_of(duel(), duel()._replace(drawn=drawn))
    assert "drawn" not in first
    assert second["drawn"] == {name: each.round(4).tolist() for name, each in drawn.items()}
    assert drawn_numbers(Config(), start.replace(craft=None), 1) == {}


@pytest.mark.parametrize(
    ("sim", "full"),
    [
        (SimConfig(), 1.9 * 0.0282 * 9.81),
        (SimConfig(body="brushless", actuation="ctbr"), 4 * 0.2),
        (SimConfig(body="brushless", actuation="mixed", thrust_to_weight=1.5), 1.5 * 0.0393 * 9.81),
    ],
)
def test_a_page_knows_the_full_thrust(sim: SimConfig, full: float):
    rules = rules_of(Config(sim=sim), load_scene(sim))
    assert rules.thrust == pytest.approx((full, full), rel=1e-6)


def test_a_diverged_flight_is_shown_up_to_its_last_number():
    flown = duel(cause=Cause.DIVERGED)
    flown.qpos[60:, 3] = np.nan
    (fight,) = data_of(flown)
    assert fight["frames"] == 60 and np.isfinite(unpacked(fight)).all()
    flown.qpos[:] = np.nan
    with pytest.raises(UserError, match="no finite state"):
        data_of(flown)


def test_a_fight_of_one_state():
    (fight,) = data_of(duel(steps=0))
    assert fight["frames"] == 1 and fight["result"]["time"] == 0.0


def test_a_drone_that_went_down_on_the_way_is_an_event_and_the_end_comes_last():
    flown = duel(cause=Cause.REACHED)
    flown.qpos[40:, 2] = 0.1
    first, last = data_of(flown)[0]["events"]
    assert first == {"kind": "crash", "time": pytest.approx(0.8), "text": "Defender crashes", "colour": "defender",
                     "place": pytest.approx(flown.qpos[40, :3], abs=1e-3), "roles": [0]}  # fmt: skip
    assert (last["kind"], last["text"], last["time"]) == (
        "end",
        "Attacker reaches the target",
        pytest.approx(2.0),
    )


def test_the_crash_that_ends_a_fight_is_told_once():
    flown = duel(cause=Cause.ATTACKER_CRASH)
    flown.qpos[-1, 9] = 0.1
    (event,) = data_of(flown)[0]["events"]
    assert (event["kind"], event["roles"], event["text"]) == ("crash", [1], "Attacker crashes")


def test_an_absent_defender_has_no_events():
    flown = duel(cause=Cause.REACHED)
    flown.qpos[:, 2] = 0.0
    (fight,) = data_of(flown, rules=RULES._replace(alone=True))
    assert fight["alone"] and [event["text"] for event in fight["events"]] == [
        "Attacker reaches the target"
    ]


def test_every_end_is_one_sentence_that_names_the_winner():
    """The winner of every cause by the rules of the game, not by the page."""
    winners = outcome_table(GameConfig(timeout_rule="defender"))
    sentences = {cause.name: verdict(cause, winners[cause], 1.5) for cause in Cause}
    begins = {
        Outcome.DEFENDER: "Defender wins: ",
        Outcome.ATTACKER: "Attacker wins: ",
        Outcome.DRAW: "Nobody wins: ",
    }
    assert sentences.pop("NONE") == "No result: the fight was cut short"
    assert all(text.startswith(begins[winners[Cause[name]]]) for name, text in sentences.items())
    assert sentences["INTERCEPT"] == "Defender wins: it intercepts the attacker after 1.50\u00a0s"
    assert sentences["TIMEOUT"].startswith("Defender wins: time runs out")
    assert verdict(Cause.TIMEOUT, Outcome.DRAW, 4.0).startswith("Nobody wins: time runs out")


def test_the_data_are_plain_json():
    json.dumps(replay_data("title", "about", fights(2), RULES), allow_nan=False)

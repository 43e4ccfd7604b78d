"""The gaps as settings: which there are in a game, and whose drones they change."""

from dataclasses import replace
from pathlib import Path

import pytest
from drones import write

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, SensorConfig, SimConfig
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.tournaments.reality import GAPS, changes_of, chosen

PAPER = Config()
REAL = replace(
    PAPER,
    sim=SimConfig(body="brushless", actuation="ctbr", drag=True, timestep=0.005),
    sensor=SensorConfig(position_noise=0.02, latency=1),
)


def made(config: Config, together: bool = False) -> dict:
    changes, _ = changes_of(config, chosen(""), together)
    return {(change.gap.name, change.side): change.changes for change in changes}


def test_gaps_of_the_papers_game():
    """Two sides apart where that can be; one step is 20 ms."""
    changes = made(PAPER)
    assert changes["other_starts", "both"] == {}
    assert changes["mass_plus", "defender"] == {"defender.mass": 1.2}
    assert changes["mass_minus", "attacker"] == {"attacker.mass": 0.8}
    assert changes["thrust_minus", "attacker"] == {"attacker.thrust": 0.8}
    assert changes["lag", "both"] == {"sim.actuation": "mixed"}
    assert changes["limits", "both"]["attacker.lag"] == 0.01
    assert changes["drag", "defender"] == {"sim.drag": True, "attacker.drag": 0.0}
    assert changes["latency_40", "defender"] == {"sensor.latency": 2, "sensor.side": "defender"}
    assert changes["noise", "attacker"]["sensor.side"] == "attacker"
    (lag,) = changes_of(PAPER, chosen("lag"), together=False)[0]
    assert lag.about == "rotors, with limits and lag"
    assert len(changes) == 1 + 3 * 2 + 2 + 2 + 4 * 2


def test_gaps_of_a_real_drone():
    """Rotors, drag and sensors that are there already get worse; one step is 10 ms."""
    changes, left_out = changes_of(REAL, chosen(""), together=False)
    by = {(change.gap.name, change.side): change.changes for change in changes}
    abouts = {change.gap.name: change.about for change in changes}
    assert (abouts["lag"], abouts["drag"]) == ("lag of the rotors x 2", "drag + 50 %")
    assert by["lag", "attacker"] == {"attacker.lag": 2.0}
    assert by["drag", "defender"] == {"defender.drag": 1.5}
    assert by["latency_20", "both"] == {"sensor.latency": 3}
    assert by["noise", "both"]["sensor.position_noise"] == 0.04
    assert by["noise", "both"]["sensor.rate_noise"] == 0.05
    assert left_out == ["limits: left out: this game has no such thing"]


def test_together_gives_both_sides_each_gap():
    changes = made(PAPER, together=True)
    assert {side for _, side in changes} == {"both"} and len(changes) == len(GAPS)
    assert changes["mass_plus", "both"] == {"defender.mass": 1.2, "attacker.mass": 1.2}
    assert changes["drag", "both"] == {"sim.drag": True}


def test_every_change_is_a_sound_game_that_differs_in_what_it_says():
    for config in (PAPER, REAL):
        for together in (True, False):
            for change in changes_of(config, chosen(""), together)[0]:
                differ = {key: new for key, _, new in settings.diff(config, change.config)}
                assert differ == change.changes
                assert settings.checked(change.config) == change.config


def test_what_a_game_cannot_have_is_left_out_with_the_reason(tmp_path: Path):
    own = replace(PAPER, sim=SimConfig(mjcf=str(write(tmp_path))))
    changes, left_out = changes_of(own, chosen("mass_plus,drag,lag"), together=False)
    assert [(change.gap.name, change.side) for change in changes] == [
        ("mass_plus", "defender"),
        ("mass_plus", "attacker"),
    ]
    assert [line.split(":")[0] for line in left_out] == ["drag", "lag"]
    assert all("says no rotor_positions" in line for line in left_out)
    slow = replace(PAPER, sim=SimConfig(timestep=0.05))  # a control step of 100 ms
    assert changes_of(slow, chosen("latency_20,latency_80"), False)[1] == [
        "latency_20: left out: this game has no such thing"
    ]


def test_an_unknown_gap_is_one_line():
    with pytest.raises(UserError) as raised:
        chosen("mass_plus, mas_minus")
    assert raised.value.exit_code == EXIT_CONFIG
    assert "'mas_minus' is no gap; did you mean mass_minus?" in raised.value.message
    assert [gap.name for gap in chosen("lag,lag, drag")] == ["lag", "drag"]

"""The table of final policies against strangers."""

import numpy as np
import strangers

from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, Trajectory
from dronecombat_jax.watch.flyers import Flyer

STRIKES = {"near": 1.0, "far": 4.0}


def flyer(name: str) -> Flyer:
    return Flyer(name, name, LearnConfig(), name)


def fight(cause: Cause, away: float) -> Trajectory:
    """One that ends with the defender `away` m from the target."""
    qpos = np.zeros((3, 14))
    qpos[-1, 0] = away
    return Trajectory(np.arange(3), qpos, None, None, np.zeros(3), int(cause), 0.02)


def fly(defender: Flyer, attacker: Flyer) -> list[Trajectory]:
    """Four fights; `fast` reaches the target in one of them, `lost` in none."""
    first = Cause.REACHED if attacker.label == "fast" else Cause.TIMEOUT
    return [fight(first, 9.0), *(fight(Cause.INTERCEPT, STRIKES[defender.label]),) * 3]


def test_shares_that_end_at_the_target_and_where_the_defender_strikes():
    defenders, attackers = (
        {name: flyer(name) for name in names} for names in (("near", "far"), ("fast", "lost"))
    )
    heads, _, near, far = strangers.table(defenders, attackers, fly)
    assert heads == ["defender", "strikes, m from the target", "`fast`", "`lost`"]
    assert near == ["`near`", "1.0 to 1.0", "0.25", "0.00"]
    assert far == ["`far`", "4.0 to 4.0", "0.25", "0.00"]


def test_a_scripted_pilot_and_a_policy_fly_on_their_side_alone():
    assert strangers.sides_of("goalkeeper") == (0,) and strangers.sides_of("dash") == (1,)
    assert strangers.sides_of("pilots:strong-attacker-67") == (1,)
    assert strangers.sides_of("runs/duel") == (0, 1)


def test_policies_and_scripted_pilots_are_found_without_a_run():
    words = [("pilots:strong-defender-67", "ours"), ("dash", "dash"), ("goalkeeper", "goalkeeper")]
    defenders = strangers.field(words[0][0], words, DEFENDER)
    assert list(defenders) == ["ours", "goalkeeper"] and defenders["ours"].chunk == 67
    assert list(strangers.field(words[0][0], words, ATTACKER)) == ["dash"]

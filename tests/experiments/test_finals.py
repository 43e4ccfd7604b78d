"""Ratings of final policies, and their scores against their own past."""

import finals
import numpy as np
from tournaments import build, entrants

from dronecombat_jax.types import Cause

WINS, LOSES = Cause.INTERCEPT, Cause.REACHED


def test_the_finals_are_rated_and_looked_at_against_their_own_past():
    """One training of two checkpoints a side, a scripted pilot beside them. The final defender beats
    the final attacker alone, the first one both; the scripted attacker beats everybody.
    """
    cause = np.full((3, 3, 4), WINS, np.int8)
    cause[1, 0], cause[:, 2], cause[2] = LOSES, LOSES, LOSES
    result = build(
        cause,
        defenders=entrants("d", runs=1, chunks=2, scripted=1),
        attackers=entrants("a", runs=1, chunks=2, scripted=1),
    )
    assert finals.finals(result.defenders) == [1] and finals.scripted(result.defenders) == [2]
    (defender, own, plain), (attacker, theirs, best) = finals.ratings(result)
    assert (defender, attacker) == ("defender", "attacker")
    points = [float(text.split()[0]) for text in (own, theirs)]
    pilots = [float(text.split()[-1]) for text in (plain, best)]
    assert plain.startswith("`pilot 0` ") and points[0] > pilots[0] and points[1] < pilots[1]
    # Defenders: 0 against the first attacker, where the first defender had 1 against both. The
    # attackers: both lose to the first defender.
    assert list(finals.past(result)) == [
        ["defender", "-1.00 (-1.00 to -1.00)"],
        ["attacker", "+0.00 (+0.00 to +0.00)"],
    ]

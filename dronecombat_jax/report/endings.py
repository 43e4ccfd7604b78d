"""How a fight ends, in words: captions, who wins and why. Of duels, and of teams.

What does not live here: which event ends a fight (`combat.rules`), what happened on the way
(`fight_events`).
"""

from dronecombat_jax.config.sides import DUEL, Sides, drone_names
from dronecombat_jax.report.stage import TEAM_COLOURS
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES, Cause, Outcome

WINNERS = {Outcome.DEFENDER: "defender", Outcome.ATTACKER: "attacker", Outcome.DRAW: "nobody"}
_NEUTRAL = (0.85, 0.87, 0.90)

# What happened, in whose colour. Who wins by it is a matter of the rules of the run.
CAPTIONS: dict[Cause, tuple[str, tuple[float, ...]]] = {
    Cause.NONE: ("Fight cut short", _NEUTRAL),
    Cause.INTERCEPT: ("Defender intercepts the attacker", TEAM_COLOURS[DEFENDER]),
    Cause.REACHED: ("Attacker reaches the target", TEAM_COLOURS[ATTACKER]),
    Cause.DEFENDER_CRASH: ("Defender crashes", TEAM_COLOURS[ATTACKER]),
    Cause.ATTACKER_CRASH: ("Attacker crashes", TEAM_COLOURS[DEFENDER]),
    Cause.BOTH_CRASH: ("Both drones crash", _NEUTRAL),
    Cause.TIMEOUT: ("Time runs out", _NEUTRAL),
    Cause.DIVERGED: ("The simulation diverged", _NEUTRAL),
    Cause.DEFENDER_INVALID: ("Defender's action is not a number", TEAM_COLOURS[ATTACKER]),
    Cause.ATTACKER_INVALID: ("Attacker's action is not a number", TEAM_COLOURS[DEFENDER]),
    Cause.BOTH_INVALID: ("Both actions are not numbers", _NEUTRAL),
}
_REASONS = {
    Cause.NONE: "the fight was cut short",
    Cause.INTERCEPT: "it intercepts the attacker",
    Cause.REACHED: "it reaches the target",
    Cause.DEFENDER_CRASH: "the defender crashes",
    Cause.ATTACKER_CRASH: "the attacker crashes",
    Cause.BOTH_CRASH: "both drones crash",
    Cause.TIMEOUT: "time runs out",
    Cause.DIVERGED: "the simulation diverges",
    Cause.DEFENDER_INVALID: "the defender's action is not a number",
    Cause.ATTACKER_INVALID: "the attacker's action is not a number",
    Cause.BOTH_INVALID: "no action is a number",
}
# Of teams, in place of both: a side has several drones, and a strike need not end the fight.
_TEAM_REASONS = {
    Cause.INTERCEPT: "the last attacker is struck",
    Cause.REACHED: "an attacker reaches the target",
    Cause.DEFENDER_CRASH: "no defender flies any more",
    Cause.ATTACKER_CRASH: "no attacker flies any more",
    Cause.BOTH_CRASH: "nobody flies any more",
    Cause.DEFENDER_INVALID: "a defender's action is not a number",
    Cause.ATTACKER_INVALID: "an attacker's action is not a number",
    Cause.BOTH_INVALID: "actions of both sides are not numbers",
}


def caption(cause: Cause, sides: Sides = DUEL) -> tuple[str, tuple[float, ...]]:
    """What ended the fight, and in whose colour, RGB in [0, 1]."""
    text, colour = CAPTIONS[cause]
    if sides != DUEL and cause in _TEAM_REASONS:
        text = sentence_case(_reason(cause, sides))
    return text, colour


def verdict(cause: Cause, winner: Outcome, end: float, sides: Sides = DUEL) -> str:
    """Who wins and why, as one sentence; `end` in s."""
    reason = who_and_why(cause, winner, sides)
    return reason if cause == Cause.NONE else f"{reason} after {end:.2f}\u00a0s"


def who_and_why(cause: Cause, winner: Outcome, sides: Sides = DUEL) -> str:
    """The same without the time."""
    reason = _reason(cause, sides)
    if cause == Cause.NONE:
        return f"No result: {reason}"
    if winner == Outcome.DRAW:
        return f"Nobody wins: {reason}"
    name = WINNERS[winner]
    many = sides.count(SIDES.index(name)) > 1
    return f"{name.capitalize()}{'s win' if many else ' wins'}: {reason}"


def shown_names(sides: Sides) -> tuple[str, ...]:
    """The drones' names for people: `defender` where it flies alone, else `defender 1`, ..."""
    return drone_names(sides, gap=" ")


def sentence_case(text: str) -> str:
    """`text` with a capital at its beginning, and otherwise as it is."""
    return text[:1].upper() + text[1:]


def _reason(cause: Cause, sides: Sides) -> str:
    if sides == DUEL:
        return _REASONS[cause]
    reason = _TEAM_REASONS.get(cause, _REASONS[cause])
    if sides.count(ATTACKER) == 1:
        for many in ("the last attacker", "an attacker"):
            reason = reason.replace(many, "the attacker")
    return reason.replace("a defender", "the defender") if sides.count(DEFENDER) == 1 else reason

"""The gaps between the game and a drone that flies: each a small change of the game's settings.

Players do not know of them, and commands keep the nominal scale. What does not live here: flying
under them (`robustness`), what they did (`analysis.robustness`).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from dronecombat_jax.config import preflight
from dronecombat_jax.config.fields import Config, SensorConfig
from dronecombat_jax.config.schema import build, flatten, one_line
from dronecombat_jax.config.settings import suggestion
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim.source import flown_of
from dronecombat_jax.types import SIDES

BOTH = "both"
OTHER_STARTS = "other_starts"  # the control: nothing but luck
NO_LAG = 0.01  # of the rotors' lag: they answer within the first physics step
NOISE = SensorConfig(position_noise=0.01, attitude_noise=0.01, velocity_noise=0.05, rate_noise=0.05)

Changes = dict[str, Any]  # settings by dotted key
# (nominal game, sides that differ) -> changes; None: these sides alone cannot differ so
Make = Callable[[Config, Sequence[str]], Changes | None]


class Gap(NamedTuple):
    """One change of the game."""

    name: str  # as `--gaps` names it
    about: str  # for a table
    make: Make
    worse: str = ""  # the same in a game that has such a thing already

    def about_in(self, config: Config) -> str:
        """What it is in the game of `config`."""
        present = config.sim.drag if self.name == "drag" else config.sim.actuation != "wrench"
        return self.worse if self.worse and present else self.about


class Change(NamedTuple):
    """A gap as it is flown."""

    gap: Gap
    side: str  # whose drones or sensors: of `SIDES`, or `BOTH`
    changes: Changes
    config: Config
    about: str  # for a table


def chosen(words: str) -> list[Gap]:
    """The gaps that `words`, names with commas between, ask for; all for "". UserError 2."""
    if not words:
        return list(GAPS.values())
    names = [word.strip() for word in words.split(",")]
    for name in names:
        if name not in GAPS:
            meant = suggestion(name, GAPS)
            raise UserError(f"--gaps {one_line(words)}: {one_line(name)!r} is no gap; {meant}")
    return [GAPS[name] for name in dict.fromkeys(names)]


def changes_of(
    config: Config, gaps: Sequence[Gap], together: bool
) -> tuple[list[Change], list[str]]:
    """Every gap in the game of `config`: for each side apart where that can be, for both otherwise
    or with `together`; and one line for each gap that this game cannot have.
    """
    flown, left_out = [], []
    for gap in gaps:
        apart = None if together else [(side, gap.make(config, (side,))) for side in SIDES]
        if apart is None or any(changes is None for _, changes in apart):
            apart = [(BOTH, gap.make(config, SIDES))]
        for side, changes in apart:
            reason = "this game has no such thing" if changes is None else ""
            if changes is not None:
                other = _with(config, changes)
                reason = _fault(other)
                if not reason:
                    flown.append(Change(gap, side, changes, other, gap.about_in(config)))
            if reason:
                left_out.append(f"{gap.name}: left out: {reason}")
                break
    return flown, left_out


def _with(config: Config, changes: Mapping[str, Any]) -> Config:
    return build(Config, flatten(config) | dict(changes))


def _fault(config: Config) -> str:
    """Why this game cannot be flown; "" where it can."""
    if faults := preflight.problems(config):
        return "; ".join(problem.message for problem in faults)
    try:
        flown_of(config.sim)  # a drone of one's own may say too little
    except UserError as error:
        return "; ".join(error.message.splitlines())
    return ""


def _factor(name: str, factor: float) -> Make:
    """This multiple of a number of the drones of `sides`."""

    def make(config: Config, sides: Sequence[str]) -> Changes:
        own = {side: getattr(getattr(config, side), name) for side in sides}
        return {f"{side}.{name}": factor * value for side, value in own.items()}

    return make


def _drag(config: Config, sides: Sequence[str]) -> Changes | None:
    """Half as much again, or that of the body where the game has none."""
    if config.sim.drag:
        return _factor("drag", 1.5)(config, sides)
    others = [side for side in SIDES if side not in sides]
    return {"sim.drag": True, **{f"{side}.drag": 0.0 for side in others}}


def _lag(config: Config, sides: Sequence[str]) -> Changes | None:
    """Twice the rotors', or real rotors behind the wrench of the paper."""
    if config.sim.actuation != "wrench":
        return _factor("lag", 2.0)(config, sides)
    return {"sim.actuation": "mixed"} if len(sides) == len(SIDES) else None


def _limits(config: Config, sides: Sequence[str]) -> Changes | None:
    """Rotors without lag behind the wrench: their limits alone."""
    if config.sim.actuation != "wrench" or len(sides) < len(SIDES):
        return None
    return {"sim.actuation": "mixed", **{f"{side}.lag": NO_LAG for side in SIDES}}


def _sensed(changes: Callable[[Config], Changes | None]) -> Make:
    """Changes of what is observed; of one side alone where the game's sensors are exact."""

    def make(config: Config, sides: Sequence[str]) -> Changes | None:
        made, alone = changes(config), len(sides) < len(SIDES)
        if made is None or not alone:
            return made
        return None if config.sensor != SensorConfig() else made | {"sensor.side": sides[0]}

    return make


def _noise(config: Config) -> Changes:
    """The deviations of `NOISE`, or twice the game's own where those are more."""
    names = ("position_noise", "attitude_noise", "velocity_noise", "rate_noise")
    more = lambda name: max(getattr(NOISE, name), 2.0 * getattr(config.sensor, name))
    return {f"sensor.{name}": more(name) for name in names}


def _late(milliseconds: float) -> Make:
    """Measurements that arrive so much later, in whole control steps."""

    def changes(config: Config) -> Changes | None:
        steps = round(milliseconds / 1000.0 / config.control_dt)
        return {"sensor.latency": config.sensor.latency + steps} if steps else None

    return _sensed(changes)


def _nothing(config: Config, sides: Sequence[str]) -> Changes | None:
    return {} if len(sides) == len(SIDES) else None


GAPS: dict[str, Gap] = {
    gap.name: gap
    for gap in (
        Gap(OTHER_STARTS, "nothing but other starts", _nothing),
        Gap("mass_plus", "mass + 20 %", _factor("mass", 1.2)),
        Gap("mass_minus", "mass - 20 %", _factor("mass", 0.8)),
        Gap("thrust_minus", "thrust and moments - 20 %", _factor("thrust", 0.8)),
        Gap("limits", "rotors, with limits alone", _limits),
        Gap("lag", "rotors, with limits and lag", _lag, "lag of the rotors x 2"),
        Gap("drag", "drag", _drag, "drag + 50 %"),
        Gap("noise", "noisy sensors", _sensed(_noise)),
        Gap("latency_20", "20 ms of latency", _late(20.0)),
        Gap("latency_40", "40 ms of latency", _late(40.0)),
        Gap("latency_80", "80 ms of latency", _late(80.0)),
    )
}

"""Scripted pilots: plain opponents that fly the game's own wrench, to measure learnt policies
against.

A pilot is a pure function `(state [E, ...], observation [E, A, 35], key) -> action [E, 4]`, as
everywhere in a match; these read the state alone, draw nothing and remember nothing. In here: their
names. Not in here: what each one wants (`guidance`, `teamwork`, `planner`), the controller that flies it
(`autopilot`) and the fights (`arena`).
"""

from collections.abc import Callable, Iterable, Sequence

import jax
import jax.numpy as jnp

from dronecombat_jax.combat import guidance
from dronecombat_jax.combat.autopilot import Airframe, airframe, attainable, steer
from dronecombat_jax.combat.guidance import Guidance, situation_of
from dronecombat_jax.combat.planner import build_plan
from dronecombat_jax.combat.teamwork import TEAMWORK, Field, TeamLaw
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.sides import Sides, team
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim.flight import split
from dronecombat_jax.sim.scene import Scene
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES, Drones, EnvState

Pilot = Callable[[EnvState, jax.Array, jax.Array], jax.Array]


def build_pilot(
    name: str, config: Config, scene: Scene, role: int | None = None, drone: int | None = None
) -> Pilot:
    """The scripted pilot `name` of `PILOTS`, `TEAMWORK` or `PLANNERS`, for this body and clock, at the
    controls of `drone` (None: the first of its side).

    In a team each drone flies on its own, against the nearest opponent that flies, but those of
    `TEAMWORK`, who share the work. Raises UserError for an unknown name, or one that flies the other
    `role`.
    """
    for side in PILOTS:
        if name in names_of(side) and role in (None, side):
            sides = config.game.sides
            drone = sides.index(side) if drone is None else drone
            body = airframe(config, scene, drone)
            if name in PILOTS[side]:
                return guided_pilot(sides, drone, PILOTS[side][name], body, config.control_dt)
            if name in TEAMWORK[side]:
                return _team_pilot(sides, drone, TEAMWORK[side][name], body, config.control_dt)
            other = airframe(config, scene, sides.index(1 - side))
            plan = build_plan(side, config.game, body, other)
            return guided_pilot(sides, drone, plan, body, config.control_dt)
    raise _unknown(name, PILOTS if role is None else (role,))


def check_teachers(config: Config) -> None:
    """UserError, which names the setting, for a teacher who is no scripted pilot of its side."""
    for role, name in enumerate(config.learn.teachers):
        if name and name not in names_of(role):
            raise UserError(f"learn.{SIDES[role]}_teacher {_unknown(name, (role,)).message}")


def _unknown(name: str, roles: Iterable[int]) -> UserError:
    names = "; ".join(f"{SIDES[side]}s: {', '.join(names_of(side))}" for side in roles)
    return UserError(f"{one_line(name)}: no scripted pilot has this name ({names})")


def names_of(role: int) -> tuple[str, ...]:
    """All scripted pilots of a side: the plain ones, those of teams, then the planner."""
    return (*PILOTS[role], *TEAMWORK[role], PLANNERS[role])


def one_per_fight(pilots: Sequence[Pilot], which: jax.Array) -> Pilot:
    """Fight e is flown by `pilots[which[e]]`, `which` [E] int: many pairs in one program. All get
    the same key.
    """

    def act(state: EnvState, observation: jax.Array, key: jax.Array) -> jax.Array:
        actions = jnp.stack([pilot(state, observation, key) for pilot in pilots])
        return actions[which, jnp.arange(which.shape[0])]

    return act


def guided_pilot(sides: Sides, drone: int, law: Guidance, body: Airframe, step: float) -> Pilot:
    """The pilot of `drone` that flies what `law` wants, against the opponent it minds; `step`: of its
    clock, s.
    """

    def act(state: EnvState, observation: jax.Array, key: jax.Array) -> jax.Array:
        drones = split(state.qpos, state.qvel)
        other = _opponent(sides, drone, drones, state.down)
        own = Drones(*(field[:, drone] for field in drones))
        situation = situation_of(own, other, state.target, state.clock * step)
        return _flown(body, state, drone, own, law(body, situation))

    return act


def _team_pilot(sides: Sides, drone: int, law: TeamLaw, body: Airframe, step: float) -> Pilot:
    mates, others = team(sides, sides[drone]), team(sides, 1 - sides[drone])

    def act(state: EnvState, observation: jax.Array, key: jax.Array) -> jax.Array:
        drones, fly = split(state.qpos, state.qvel), ~state.down
        of_team = lambda place: Drones(*(leaf[:, place] for leaf in drones))
        field = Field(
            of_team(mates), of_team(others), fly[:, mates], fly[:, others], state.target,
            state.clock * step,
        )  # fmt: skip
        wanted = law(body, field, drone - mates.start)
        return _flown(body, state, drone, of_team(drone), wanted)

    return act


def _flown(
    body: Airframe, state: EnvState, drone: int, own: Drones, wanted: jax.Array
) -> jax.Array:
    """The action [E, 4] that flies `wanted` [E, 3] m/s^2 as near as the drone can."""
    force = attainable(body, own.position[:, 2], own.velocity[:, 2], wanted)
    speeds = None if state.craft is None else state.craft.speeds
    mine = None if speeds is None else speeds[:, drone]
    return steer(body, own.quaternion, own.rate, force, mine)


def _opponent(sides: Sides, drone: int, drones: Drones, down: jax.Array) -> Drones:
    """The opponent that the pilot of `drone` minds, fields [E, ...]: the only one, or the nearest
    that flies, or the nearest of all where none does.
    """
    others = team(sides, 1 - sides[drone])
    if others.stop - others.start == 1:
        return Drones(*(field[:, others.start] for field in drones))
    way = drones.position[:, others] - drones.position[:, drone, None]
    flies = ~down[:, others]
    minded = flies | ~jnp.any(flies, axis=1, keepdims=True)
    nearest = jnp.argmin(jnp.where(minded, jnp.sum(way**2, axis=-1), jnp.inf), axis=1)
    fights = jnp.arange(nearest.shape[0])
    return Drones(*(field[fights, others.start + nearest] for field in drones))


PILOTS: dict[int, dict[str, Guidance]] = {
    DEFENDER: {
        "hover": guidance.hover,
        "hover_guard": guidance.hover_guard,
        "pure_pursuit": guidance.pure_pursuit,
        "proportional_navigation": guidance.proportional_navigation,
        "goalkeeper": guidance.goalkeeper,
    },
    ATTACKER: {"dash": guidance.dash, "weave": guidance.weave, "high_dive": guidance.high_dive},
}
# They look ahead, in a model of the flight: far dearer than the plain ones, and no part of `scripted:all`.
PLANNERS = {DEFENDER: "interception_planner", ATTACKER: "evasion_planner"}

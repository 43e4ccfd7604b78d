"""Scripted pilots: plain opponents that fly the game's own wrench, to measure learnt policies
against.

A pilot is a pure function `(state [E, ...], observation [E, A, 35], key) -> action [E, 4]`, as
everywhere in a match; these read the state alone, draw nothing and remember nothing. In here: their
names. Not in here: what each one wants (`guidance`, `planner`), the controller that flies it
(`autopilot`) and the fights (`arena`).
"""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp

from dronecombat_jax.combat import guidance
from dronecombat_jax.combat.autopilot import Airframe, airframe, attainable, steer
from dronecombat_jax.combat.guidance import Guidance, Situation
from dronecombat_jax.combat.planner import build_plan
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import UserError
from dronecombat_jax.sim.flight import split
from dronecombat_jax.sim.rotation import body_z
from dronecombat_jax.sim.scene import Scene
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES, Drones, EnvState

Pilot = Callable[[EnvState, jax.Array, jax.Array], jax.Array]


def build_pilot(name: str, config: Config, scene: Scene, role: int | None = None) -> Pilot:
    """The scripted pilot `name` of `PILOTS` or `PLANNERS`, for this body and clock.

    Raises UserError for an unknown name, or one that flies the other `role`.
    """
    for side in PILOTS:
        if name in names_of(side) and role in (None, side):
            bodies = (airframe(config, scene, DEFENDER), airframe(config, scene, ATTACKER))
            plans = name == PLANNERS[side]
            law = build_plan(side, config.game, bodies) if plans else PILOTS[side][name]
            return _pilot(side, law, bodies[side], config.control_dt)
    roles = PILOTS if role is None else (role,)
    names = "; ".join(f"{SIDES[side]}s: {', '.join(names_of(side))}" for side in roles)
    raise UserError(f"{one_line(name)}: no scripted pilot has this name ({names})")


def names_of(role: int) -> tuple[str, ...]:
    """All scripted pilots of a side: the plain ones, then the planner."""
    return (*PILOTS[role], PLANNERS[role])


def one_per_fight(pilots: Sequence[Pilot], which: jax.Array) -> Pilot:
    """Fight e is flown by `pilots[which[e]]`, `which` [E] int: many pairs in one program. All get
    the same key.
    """

    def act(state: EnvState, observation: jax.Array, key: jax.Array) -> jax.Array:
        actions = jnp.stack([pilot(state, observation, key) for pilot in pilots])
        return actions[which, jnp.arange(which.shape[0])]

    return act


def _pilot(role: int, law: Guidance, body: Airframe, step: float) -> Pilot:
    def act(state: EnvState, observation: jax.Array, key: jax.Array) -> jax.Array:
        drones = split(state.qpos, state.qvel)
        situation = _situation(drones, role, state.target, state.clock * step)
        wanted = law(body, situation)
        force = attainable(body, situation.position[:, 2], situation.velocity[:, 2], wanted)
        speeds = None if state.craft is None else state.craft.speeds
        mine = None if speeds is None else speeds[:, role]
        return steer(body, drones.quaternion[:, role], drones.rate[:, role], force, mine)

    return act


def _situation(drones: Drones, role: int, target: jax.Array, time: jax.Array) -> Situation:
    position, velocity, up = drones.position, drones.velocity, body_z(drones.quaternion)
    both = [x[:, side] for side in (role, 1 - role) for x in (position, velocity, up)]
    return Situation(*both, target, time)


PILOTS: dict[int, dict[str, Guidance]] = {
    DEFENDER: {
        "hover": guidance.hover,
        "hover_guard": guidance.hover_guard,
        "pure_pursuit": guidance.pure_pursuit,
        "proportional_navigation": guidance.proportional_navigation,
    },
    ATTACKER: {"dash": guidance.dash, "weave": guidance.weave, "high_dive": guidance.high_dive},
}


# They look ahead, in a model of the flight: far dearer than the plain ones, and no part of `scripted:all`.
PLANNERS = {DEFENDER: "interception_planner", ATTACKER: "evasion_planner"}

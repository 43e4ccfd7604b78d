"""Pilots that look ahead: their model against the exact flight, whom they expect, and their fights."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.arena.match import fight
from dronecombat_jax.arena.players import Player, alike, kind_of, scripted_numbers
from dronecombat_jax.combat.autopilot import airframe
from dronecombat_jax.combat.choices import OTHER, Choices, plain, slip
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.guidance import (
    Situation,
    dash,
    hover,
    hover_guard,
    proportional_navigation,
)
from dronecombat_jax.combat.planner import STEP, _likeness, imagine
from dronecombat_jax.combat.scripted import PILOTS, PLANNERS, build_pilot, names_of
from dronecombat_jax.config import settings
from dronecombat_jax.sim.flight import split
from dronecombat_jax.sim.rotation import body_z
from dronecombat_jax.tournaments.contenders import find
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, EnvState

KEY = jax.random.key(3)


def seen_by(role: int, state: EnvState) -> Situation:
    """The situation of one side in fights [E]."""
    drones = split(state.qpos, state.qvel)
    up = body_z(drones.quaternion)
    of = lambda side: (drones.position[:, side], drones.velocity[:, side], up[:, side])
    return Situation(*of(role), *of(1 - role), state.target, state.clock * 0.02)


def bodies(arena: SimpleNamespace, role: int):
    config, scene = arena.combat.config, arena.combat.scene
    return airframe(config, scene, role), airframe(config, scene, 1 - role)


@pytest.mark.long
def test_the_model_flies_a_dash_as_long_as_mjx_does(arena: SimpleNamespace, fresh: EnvState):
    """Past a defender that hovers: within a model step of what the exact flight takes."""
    combat = arena.combat
    pilots = [build_pilot(name, combat.config, combat.scene) for name in ("hover", "dash")]
    flown = jax.jit(lambda start: fight(combat, pilots[0], pilots[1], start, KEY))(fresh)
    assert (np.asarray(flown.cause) == Cause.REACHED).all()
    game, both = combat.config.game, bodies(arena, ATTACKER)
    ends = imagine(ATTACKER, game, both, (plain(dash),), (plain(hover),), seen_by(ATTACKER, fresh))
    assert ends.won.all() and ends.won.shape == (1, 1, 8) and not ends.lost.any()
    np.testing.assert_allclose(ends.when[0, 0] * STEP, flown.steps * 0.02, atol=0.06)


def test_choices_differ_and_time_is_what_they_say(arena: SimpleNamespace, fresh: EnvState):
    """A slip of 50 degrees for 0.2 s comes later than a dash, to the left as to the right."""
    slips = np.float32([(0, 0, 0, 0), (0.9, 0, 0.2, 0), (0.9, np.pi, 0.2, 0)])
    own, now = (Choices(slip, slips),), seen_by(ATTACKER, fresh)
    game, both = arena.combat.config.game, bodies(arena, ATTACKER)
    ends = imagine(ATTACKER, game, both, own, (plain(hover),), now)
    straight, left, right = np.asarray(ends.when[:, 0])
    assert ends.won.all() and (left > straight).all() and (right > straight).all()
    assert np.abs(left - right).max() <= 2


@pytest.mark.long
def test_a_model_is_told_by_the_thrust_axis(arena: SimpleNamespace, fresh: EnvState):
    """A defender that flies what a law wants is taken for one that follows the law."""
    own, its = bodies(arena, ATTACKER)
    models, now = OTHER[ATTACKER], seen_by(ATTACKER, fresh)
    mine = seen_by(DEFENDER, fresh)
    for index, law in enumerate((proportional_navigation, hover_guard)):
        wanted = law(its, mine) + jnp.asarray([0.0, 0.0, its.gravity])
        up = wanted / jnp.linalg.norm(wanted, axis=-1, keepdims=True)
        weights = np.asarray(_likeness(its, models, now._replace(other_up=up)))
        assert weights.shape == (2, 8) and (weights.argmax(axis=0) == index).all()
        np.testing.assert_allclose(weights.sum(axis=0), 1.0, atol=1e-5)
    assert own.max_force == its.max_force


def test_planners_stand_beside_the_plain_ones_and_fly_on_their_own():
    assert names_of(ATTACKER) == (*PILOTS[ATTACKER], "pincer", "decoy", "evasion_planner")
    plain_ones = [contender.entrant.label for contender in find("scripted:all").contenders]
    assert set(plain_ones) == {name for pilots in PILOTS.values() for name in pilots}
    (contender,) = find("scripted:interception_planner").contenders
    assert contender.role == DEFENDER
    players = [Player(name, name) for name in ("hover", "interception_planner", "hover_guard")]
    assert alike(players) == [[0, 2], [1]] and alike(players[1:2]) == [[0]]
    kind = kind_of(players[1:2])
    assert kind.plans and kind.scripted and not kind_of(players[:1]).plans
    assert scripted_numbers(players[1:2], DEFENDER).tolist() == [0]
    assert scripted_numbers(players[::2], DEFENDER).tolist() == [0, 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("role", "other"),
    [
        (ATTACKER, "proportional_navigation"),
        (ATTACKER, "hover_guard"),
        (DEFENDER, "high_dive"),
        (DEFENDER, "weave"),
    ],
)
def test_planners_beat_the_best_of_the_other_side(role: int, other: str, arena: SimpleNamespace):
    """Whom nobody of the plain ones beats; from the starts of preset duel."""
    combat = Combat(settings.load("duel"), arena.combat.scene)
    names = (other, PLANNERS[role]) if role == ATTACKER else (PLANNERS[role], other)
    pilots = [build_pilot(name, combat.config, combat.scene) for name in names]
    start = jax.vmap(combat.reset)(jax.random.split(KEY, 8))
    cause = jax.jit(lambda start: fight(combat, pilots[0], pilots[1], start, KEY).cause)(start)
    wins = Cause.REACHED if role == ATTACKER else Cause.INTERCEPT
    assert np.sum(np.asarray(cause) == wins) >= 6

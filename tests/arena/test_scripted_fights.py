"""Fights of the scripted pilots in MJX: what each is for, it does. Shares:
benchmarks/scripted_pilots.py.
"""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.arena.match import fight, start_fights
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.scripted import PILOTS, build_pilot, one_per_fight
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES, Cause

FIGHTS = 32  # per pair
DEFENDERS, ATTACKERS = ["absent", *PILOTS[DEFENDER]], list(PILOTS[ATTACKER])


def fight_all(arena: SimpleNamespace, game: GameConfig, seed: int) -> SimpleNamespace:
    """Every attacker against every defender from the same starts, as one program: NumPy leaves [D,
    A, E, ...].
    """
    combat = Combat(Config(game=game), arena.combat.scene)
    pilots = {
        role: [build_pilot(name, combat.config, combat.scene) for name in names]
        for role, names in ((DEFENDER, ["hover", *PILOTS[DEFENDER]]), (ATTACKER, ATTACKERS))
    }
    shape = (len(DEFENDERS), len(ATTACKERS), FIGHTS)
    defender, attacker, _ = (jnp.asarray(index.reshape(-1)) for index in np.indices(shape))
    once = start_fights(combat, jax.random.key(seed), FIGHTS)
    start = jax.tree.map(
        lambda leaf: jnp.tile(leaf, (shape[0] * shape[1],) + (1,) * (leaf.ndim - 1)), once
    )
    start = start.replace(
        down=start.down.at[:, DEFENDER].set(defender == DEFENDERS.index("absent"))
    )
    match = lambda start: fight(
        combat,
        one_per_fight(pilots[DEFENDER], defender),
        one_per_fight(pilots[ATTACKER], attacker),
        start,
        jax.random.key(seed),
    )
    result = jax.tree.map(
        lambda leaf: np.asarray(leaf).reshape(*shape, *leaf.shape[1:]), jax.jit(match)(start)
    )
    return SimpleNamespace(**result._asdict())


def share(fought: SimpleNamespace, defender: str, attacker: str, cause: Cause) -> float:
    """Share of a pair's fights that ended so."""
    return float(
        np.mean(fought.cause[DEFENDERS.index(defender), ATTACKERS.index(attacker)] == cause)
    )


@pytest.fixture(scope="module", params=[0, 1])
def fought(request: pytest.FixtureRequest, arena: SimpleNamespace) -> SimpleNamespace:
    return fight_all(arena, GameConfig(episode_steps=250), request.param)


@pytest.mark.long
def test_dash_alone_is_there_within_seconds(fought: SimpleNamespace):
    assert share(fought, "absent", "dash", Cause.REACHED) >= 0.98
    # At full thrust and level flight 6.6 m take 0.91 s from rest, and turning the body some more.
    assert 0.9 < np.max(fought.steps[0, ATTACKERS.index("dash")]) * 0.02 < 1.2


@pytest.mark.long
def test_every_attacker_beats_hover(fought: SimpleNamespace):
    for attacker in ATTACKERS:
        assert share(fought, "absent", attacker, Cause.REACHED) >= 0.95
        assert share(fought, "hover", attacker, Cause.REACHED) >= 0.95
    assert np.max(fought.steps[DEFENDERS.index("hover")]) * 0.02 < 2.5


def test_defenders_intercept(fought: SimpleNamespace):
    """Loosely below what was measured; pure pursuit starts level with dash and chases its tail."""
    for attacker in ATTACKERS:
        assert share(fought, "proportional_navigation", attacker, Cause.INTERCEPT) >= 0.8
        assert share(fought, "goalkeeper", attacker, Cause.INTERCEPT) >= 0.9
    assert share(fought, "hover_guard", "dash", Cause.INTERCEPT) >= 0.9
    assert share(fought, "hover_guard", "high_dive", Cause.INTERCEPT) >= 0.9
    assert 0.3 <= share(fought, "hover_guard", "weave", Cause.INTERCEPT) <= 0.9
    assert share(fought, "pure_pursuit", "dash", Cause.INTERCEPT) <= 0.1


def test_nobody_crashes_and_all_fights_are_decided(fought: SimpleNamespace):
    assert not np.any(fought.down[1:]) and not np.any(fought.down[..., ATTACKER])
    assert np.all((fought.cause == Cause.INTERCEPT) | (fought.cause == Cause.REACHED))


@pytest.mark.long
def test_no_pilot_crashes_in_a_long_low_chase(arena: SimpleNamespace):
    """Nothing but a millimetre ends these 6 s: pilots overshoot, turn and come again, from
    anywhere, low.
    """
    game = GameConfig(
        episode_steps=300,
        intercept_radius=1e-3,
        reach_radius=1e-3,
        spawn="uniform",
        spawn_altitude_high=0.7,
    )
    chased = fight_all(arena, game, 2)
    for role, name in enumerate(SIDES):
        down = chased.down[1:, ..., role]  # the first defender is absent and out from the start
        assert not np.any(down), name
    assert np.mean(chased.cause == Cause.TIMEOUT) > 0.3  # or it was no long chase

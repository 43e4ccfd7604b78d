"""The round robin against a plain loop of single fights, and under every way of cutting it into
batches.

Drones coast here instead of being stepped by MJX, but for one test.
"""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from round_robins import grid, one_by_one, player, remembering
from toy import CONFIG, Coasting

from dronecombat_jax.arena.lanes import Layout, start_states
from dronecombat_jax.arena.match import fight, policy_pilot
from dronecombat_jax.arena.players import Player
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.arena.round_robin import play
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause

# so that fights are of very different lengths
GAME = replace(CONFIG.game, episode_steps=60, crash_rule="out")
EPISODES = 4
SMALL = Layout(lanes=64, block=8, blocks=16, steps=5)


DEFENDERS = [*map(player, range(4)), Player("hover", "hover"), player(7, (35, 8, 4))]
ATTACKERS = [*map(player, range(10, 15)), Player("dash", "dash")]


@pytest.fixture(scope="module")
def combat() -> Coasting:
    return Coasting(replace(CONFIG, game=GAME))


@pytest.fixture(scope="module")
def flown(combat: Coasting) -> SimpleNamespace:
    """Everybody: two sizes of networks and scripted pilots."""
    rules = Rules(EPISODES, seed=3)
    return SimpleNamespace(
        rules=rules, grid=grid(combat, DEFENDERS, ATTACKERS, rules, layout=SMALL)
    )


@pytest.fixture(scope="module")
def drawn(combat: Coasting) -> SimpleNamespace:
    """The first policies with drawn actions."""
    rules = Rules(EPISODES, seed=3, stochastic=True)
    return SimpleNamespace(
        rules=rules, grid=grid(combat, DEFENDERS[:4], ATTACKERS[:5], rules, layout=SMALL)
    )


@pytest.mark.long
def test_a_cell_is_what_a_plain_loop_of_single_fights_gives(
    combat: Coasting, flown: SimpleNamespace
):
    expected = one_by_one(combat, DEFENDERS, ATTACKERS, flown.rules)
    # all but policy against scripted pilot, which are no program of their own
    looped = expected[0] > Cause.NONE
    assert np.sum(looped) == (5 * 5 + 1) * EPISODES
    np.testing.assert_array_equal(flown.grid[:, looped], expected[:, looped])
    assert (
        len(np.unique(flown.grid[0])) >= 4
        and flown.grid[1].min() < 10
        and flown.grid[1].max() == 60
    )


@pytest.mark.long
def test_drawn_actions_are_those_of_the_same_loop(
    combat: Coasting, drawn: SimpleNamespace, flown: SimpleNamespace
):
    np.testing.assert_array_equal(
        one_by_one(combat, DEFENDERS[:4], ATTACKERS[:5], drawn.rules), drawn.grid
    )
    assert np.mean(drawn.grid[1] != flown.grid[1, :4, :5]) > 0.3


@pytest.mark.parametrize("stochastic", [False, True])
@pytest.mark.long
def test_policies_with_memory_fly_as_in_single_fights(combat: Coasting, stochastic: bool):
    """Against others with more, with less and without; each forgets when another fight begins."""
    rules = Rules(EPISODES, seed=3, stochastic=stochastic)
    defenders = [remembering(1, 3), player(2)]
    recurrent, framed = range(14, 20), range(20, 26)
    attackers = [
        *(remembering(seed, state=12) for seed in recurrent),
        *(remembering(seed, 2) for seed in framed),
        player(13),
    ]
    out = grid(combat, defenders, attackers, rules, layout=SMALL)
    np.testing.assert_array_equal(out, one_by_one(combat, defenders, attackers, rules))
    if not stochastic:
        blind = [
            *(remembering(seed, state=12, blind=True) for seed in recurrent),
            *(remembering(seed, 2, blind=True) for seed in framed),
        ]
        other = grid(combat, defenders, blind, rules, layout=SMALL) != out[:, :, :12]
        assert np.any(other[:, :, :6]) and np.any(other[:, :, 6:])


@pytest.mark.long
def test_no_outcome_depends_on_batches(
    combat: Coasting, flown: SimpleNamespace, drawn: SimpleNamespace
):
    for reference, how in (
        (flown, {"layout": Layout(96, 8, 24, 7), "batches": 3}),
        (flown, {"layout": Layout(32, 8, 5, 60), "batches": 1}),
        (drawn, {"layout": Layout(96, 8, 24, 7), "batches": 3}),
    ):
        out = grid(combat, DEFENDERS[:4], ATTACKERS[:5], reference.rules, **how)
        np.testing.assert_array_equal(out, reference.grid[:, :4, :5])


@pytest.mark.long
def test_no_outcome_depends_on_who_else_takes_part(combat: Coasting, flown: SimpleNamespace):
    """In another order, without some players, and with some of the cells alone."""
    rows, columns = [5, 3, 0, 4], [4, 5, 1]
    wanted = np.random.default_rng(0).random((4, 3)) < 0.6
    some = [DEFENDERS[row] for row in rows], [ATTACKERS[column] for column in columns]
    out = grid(combat, *some, flown.rules, wanted=wanted, layout=SMALL)
    np.testing.assert_array_equal(out[:, wanted], flown.grid[:, rows][:, :, columns][:, wanted])
    assert np.all(out[:, ~wanted] == -1)


@pytest.mark.long
def test_episode_e_starts_alike_in_every_cell_and_for_any_number_of_episodes(combat: Coasting):
    """Two players of one content play alike but for what they draw."""
    twins = [player(1), player(1)._replace(identity="twin")]
    rules = Rules(EPISODES, seed=3)
    out = grid(combat, twins, [player(10)], rules, layout=SMALL)
    np.testing.assert_array_equal(out[:, 0], out[:, 1])
    np.testing.assert_array_equal(
        grid(combat, twins, [player(10)], Rules(9, seed=3), layout=SMALL)[..., :EPISODES], out
    )
    apart = grid(combat, twins, [player(10)], rules._replace(stochastic=True), layout=SMALL)
    assert np.any(apart[:, 0] != apart[:, 1])
    starts = start_states(combat, 3, 9)
    assert len(np.unique(starts.qpos[:, 2])) == 9
    assert np.all(starts.qpos[:, 2] != start_states(combat, 4, 9).qpos[:, 2])


@pytest.mark.long
def test_a_policy_of_nan_loses_its_own_fights_alone(combat: Coasting, flown: SimpleNamespace):
    broken = player(3)._replace(identity="broken")
    broken = broken._replace(
        pilot=jax.tree.map(lambda leaf: np.full_like(leaf, np.nan), broken.pilot)
    )
    out = grid(combat, [*DEFENDERS[:2], broken], ATTACKERS[:2], flown.rules, layout=SMALL)
    assert np.all(out[0, 2] == Cause.DEFENDER_INVALID) and np.all(out[1, 2] == 1)
    np.testing.assert_array_equal(out[:, :2], flown.grid[:, :2, :2])


@pytest.mark.long
def test_a_policy_flies_in_the_frame_that_it_names(combat: Coasting, flown: SimpleNamespace):
    """In a game of world frames one that sees "ego" flies as in a game of that frame."""
    ego = Coasting(replace(CONFIG, game=replace(GAME, observation="ego")))
    there = grid(ego, DEFENDERS[:2], ATTACKERS[:3], flown.rules, layout=SMALL)
    seeing = [
        [one._replace(observation="ego") for one in side[:3]] for side in (DEFENDERS, ATTACKERS)
    ]
    here = grid(combat, seeing[0][:2], seeing[1], flown.rules, layout=SMALL)
    np.testing.assert_array_equal(here, there)
    world = flown.grid[:, :2, :3]
    assert np.any(here != world)
    mixed = grid(combat, [DEFENDERS[0], seeing[0][0]], ATTACKERS[:3], flown.rules, layout=SMALL)
    np.testing.assert_array_equal(mixed[:, 0], world[:, 0])


def test_closing_the_tournament_ends_it(combat: Coasting):
    harvests = play(combat, DEFENDERS[:1], ATTACKERS[:1], Rules(200), layout=SMALL, batches=2)
    next(harvests)
    harvests.close()
    assert next(harvests, None) is None


ON_TWO_DEVICES = """
import sys, json
sys.path[:0] = json.loads(sys.argv[1])
from dronecombat_jax.machine import backend
backend.prepare("cpu")
import jax
from dataclasses import replace
import test_round_robin as t
assert jax.local_device_count() == 2
combat = t.Coasting(replace(t.CONFIG, game=t.GAME))
rules = t.Rules(t.EPISODES, seed=3)
print(json.dumps(t.grid(combat, t.DEFENDERS[:4], t.ATTACKERS[:5], rules, layout=t.SMALL, batches=1).tolist()))
"""


@pytest.mark.long
def test_two_devices_give_the_same_outcomes(flown: SimpleNamespace):
    tests = Path(__file__).parents[1]
    paths = json.dumps([str(tests / "arena"), str(tests / "support")])
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2"
    environment = os.environ | {"XLA_FLAGS": flags, "PYTHONPATH": str(tests.parent)}
    command = [sys.executable, "-W", "ignore", "-c", ON_TWO_DEVICES, paths]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(np.asarray(json.loads(done.stdout)), flown.grid[:, :4, :5])


@pytest.mark.long
def test_in_mjx_cells_are_what_plain_matches_give(arena: SimpleNamespace):
    """Eight fights at once there, blocks of other policies' fights here."""
    config = replace(arena.combat.config, game=replace(arena.combat.config.game, episode_steps=60))
    combat, rules, learn = Combat(config, arena.combat.scene), Rules(8, seed=1), LearnConfig()
    defenders, attackers = (
        [player(i, steer=1.0) for i in range(4)],
        [player(10 + i, steer=1.0) for i in range(4)],
    )
    out = grid(combat, defenders, attackers, rules, layout=SMALL, batches=1)
    again = grid(combat, defenders[::-1], attackers[::-1], rules, layout=SMALL, batches=2)
    np.testing.assert_array_equal(again[:, ::-1, ::-1], out)
    starts = start_states(combat, rules.seed, rules.episodes)

    @jax.jit
    def match(defender, attacker):
        pilots = policy_pilot(learn, defender, DEFENDER), policy_pilot(learn, attacker, ATTACKER)
        return fight(combat, *pilots, starts, jax.random.key(0))

    for row, defender in enumerate(defenders):
        for column, attacker in enumerate(attackers):
            result = match(*jax.tree.map(jnp.asarray, (defender.pilot, attacker.pilot)))
            np.testing.assert_array_equal(out[0, row, column], result.cause)
            np.testing.assert_array_equal(out[1, row, column], result.steps)

"""Training teams: every drone flies and teaches its side's policy, and a run stays a pure function
of its settings.
"""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import CHUNK, CONFIG, agent, build, differs, two_chunks

from dronecombat_jax.arena.lanes import fight_key, start_states
from dronecombat_jax.arena.match import fight, policy_team, scripted_team
from dronecombat_jax.arena.players import Player, content_words
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.arena.round_robin import play
from dronecombat_jax.combat.scripted import build_pilot
from dronecombat_jax.config.fields import SelfPlayConfig
from dronecombat_jax.config.sides import sides_of, team
from dronecombat_jax.learn.algorithms import of_team
from dronecombat_jax.runs.records import records
from dronecombat_jax.runs.saved_policies import policies_of
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, RewardTerms, Transition

SIDES = sides_of(2, 1)
TEAMS = replace(
    CONFIG,
    game=replace(CONFIG.game, defenders=2, crash_rule="out"),
    selfplay=SelfPlayConfig(probability=1.0, roles="both"),
)


@pytest.fixture(scope="module")
def run() -> SimpleNamespace:
    """Two chunks of two against one; in the second, one side is a past player."""
    return two_chunks(TEAMS)


@pytest.mark.long
def test_both_sides_learn_something_finite(run: SimpleNamespace):
    first, last = run.states[0], run.states[-1]
    for side in (DEFENDER, ATTACKER):
        assert differs(agent(first, side), agent(last, side))
    leaves = jax.tree.leaves(jax.device_get(last.learners))
    assert all(np.all(np.isfinite(leaf)) for leaf in leaves)
    assert run.reports[-1].crashes.shape[-1] == run.reports[-1].returns.shape[-1] == 3


@pytest.mark.long
def test_a_record_has_means_of_the_side_and_each_team_mates_own(run: SimpleNamespace):
    report, fights = run.reports[-1], 4
    report = report._replace(
        causes=np.eye(len(Cause), dtype=int)[None, None, Cause.REACHED] * fights,
        crashes=np.array([[[1, 4, 2]]]),
    )
    record = records(TEAMS, report, 2 * CHUNK - 1)[0]
    each = [record[f"crash/defender{number}"] for number in (1, 2)]
    np.testing.assert_allclose(each, report.crashes[0, 0, :2] / fights, rtol=1e-6)
    assert record["crash/defender"] == pytest.approx(np.mean(each))
    assert record["return/attacker"] == pytest.approx(report.returns[0, 0, 2] / fights)
    assert "crash/attacker1" not in record
    wanted = report.reward_terms.approach[0, 0, :2].mean()
    assert record["reward/defender/approach"] == pytest.approx(wanted)


def test_a_learner_finds_its_team_mates_as_so_many_more_environments():
    """By a slow loop: step t of drone d in fight n is step t of environment 2 n + d."""
    shape = (3, 4)
    numbers = np.arange(np.prod(shape) * 3, dtype=np.float32).reshape(*shape, 3)
    of_fight = np.arange(np.prod(shape)).reshape(shape)
    blank = dict.fromkeys(Transition._fields, jnp.asarray(numbers))
    blank |= dict.fromkeys(("terminated", "truncated", "cause", "clock"), jnp.asarray(of_fight))
    blank["observation"] = jnp.asarray(numbers[..., None] * np.ones(5))
    blank["reward_terms"] = RewardTerms(*[jnp.asarray(numbers)] * len(RewardTerms._fields))
    folded = of_team(Transition(**blank), team(SIDES, DEFENDER))
    assert folded.observation.shape == (3, 8, 2, 5) and folded.clock.shape == (3, 8)
    for t, n, d in np.ndindex(3, 4, 2):
        assert np.all(folded.observation[t, 2 * n + d] == numbers[t, n, d])
        assert np.all(folded.reward[t, 2 * n + d] == numbers[t, n, d])
        assert folded.clock[t, 2 * n + d] == of_fight[t, n]


@pytest.mark.slow
def test_a_round_robin_flies_teams_as_match_does(run: SimpleNamespace):
    """Policies, drawn actions, a scripted pilot and a scripted team: the same ends as one fight at a
    time.
    """
    combat, rules = run.program.combat, Rules(2, seed=3, stochastic=True)
    each = policies_of(run.states[-1].learners, TEAMS)
    pick = lambda side: jax.tree.map(lambda leaf: np.asarray(leaf)[0], each[side])
    scripted = [Player(name, name) for name in ("hover", "assigned_navigation")]
    defenders = [Player("d", pick(DEFENDER)), *scripted]
    attackers = [Player("a", pick(ATTACKER))]
    cells = {}
    for harvest in play(combat, defenders, attackers, rules):
        for row, column, cause, steps in harvest.cells:
            cells[row, column] = list(zip(cause.tolist(), steps.tolist(), strict=True))
    starts = start_states(combat, rules.seed, rules.episodes)
    for row, defender in enumerate(defenders):
        for episode in range(rules.episodes):
            start = jax.tree.map(lambda leaf, e=episode: leaf[e : e + 1], starts)
            words = np.concatenate([content_words(defender.identity), content_words("a")])
            key = fight_key(np.uint32(rules.seed), words, np.int32(episode))
            attack = policy_team(TEAMS, TEAMS.learn, pick(ATTACKER), ATTACKER, True)
            defend = (
                scripted_team(combat, defender.identity, DEFENDER)
                if row
                else policy_team(TEAMS, TEAMS.learn, pick(DEFENDER), DEFENDER, True)
            )
            result = jax.jit(lambda s, k, d=defend, a=attack: fight(combat, d, a, s, k))(start, key)
            assert cells[row, 0][episode] == (int(result.cause[0]), int(result.steps[0]))
            assert result.cause[0] != Cause.NONE and result.down.shape == (1, 3)


@pytest.mark.long
def test_a_scripted_pilot_of_a_team_minds_the_nearest_opponent_that_flies():
    game = replace(TEAMS.game, defenders=1, attackers=2)
    combat = build(replace(TEAMS, game=game, selfplay=SelfPlayConfig()), 1).combat
    pilot = jax.jit(build_pilot("pure_pursuit", combat.config, combat.scene))
    state = jax.tree.map(lambda leaf: leaf[None], combat.reset(jax.random.key(0)))
    places = jnp.array([[0, 5, 1], [0, 3, 1], [0, 9, 1]], jnp.float32)
    set_to = lambda where: state.qpos.reshape(1, 3, 7).at[:, :, :3].set(where).reshape(1, -1)
    act = lambda where, *down: pilot(
        state.replace(qpos=set_to(where), down=jnp.array([down])), None, jax.random.key(0)
    )
    alone = places.at[2].set(places[1])
    near = act(places, False, False, False)
    np.testing.assert_array_equal(near, act(alone, False, False, False))
    away = act(places, False, True, False)
    np.testing.assert_array_equal(away, act(places.at[1].set(places[2]), False, False, False))
    assert not np.allclose(near, away)

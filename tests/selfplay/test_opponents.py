"""The table of opponents in the training program: who acts where, who learns from it, what is counted."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from toy import CHUNK, CONFIG, Coasting, agent, assert_same_bits, build, differs

from dronecombat_jax.combat.scripted import build_pilot
from dronecombat_jax.combat.sensors import view_of
from dronecombat_jax.config.fields import Config, SelfPlayConfig
from dronecombat_jax.learn.algorithms import ALL, learn_from
from dronecombat_jax.learn.ippo import init_learner
from dronecombat_jax.learn.rollout import act, collect, policy_mean, policy_of, select
from dronecombat_jax.selfplay import opponents, tally
from dronecombat_jax.selfplay.chunk import reset_fights
from dronecombat_jax.selfplay.pool import FIXED, NOBODY, choose, init_selfplay
from dronecombat_jax.types import ATTACKER, DEFENDER, NUM_SIDES, Cause, Outcome, Policy

# Of eight environments: 0 nobody, 1 and 2 a scripted defender, 3 and 4 live, 5 and 6 a past
# attacker, 7 a frozen one.
TABLE = (
    "defender=nobody 0.125, defender=scripted:hover_guard 0.25, "
    "attacker=past:latest_and_hard 0.25, attacker=a.safetensors 0.125"
)
FROZEN = "attacker=a.safetensors"
CHUNKS = 4


def with_table(text: str, **selfplay) -> Config:
    """The toy run with another table, without a head start."""
    return replace(
        CONFIG,
        selfplay=SelfPlayConfig(opponents=text, memory=1.0, **selfplay),
        train=replace(
            CONFIG.train, head_start_steps=0, total_steps=CHUNKS * CONFIG.steps_per_chunk, seed=6
        ),
    )


def some_policy(seed: int) -> Policy:
    return jax.device_get(policy_of(init_learner(jax.random.key(seed), CONFIG.learn)))


@pytest.fixture(scope="module")
def flown() -> SimpleNamespace:
    """A run with the whole table: the states at the chunks' ends and the reports."""
    config = with_table(TABLE)
    program = build(config, CHUNK, {FROZEN: opponents.Guest(some_policy(1))})
    states, reports = [program.start], []
    for _ in range(CHUNKS):
        state, report = program.run(states[-1])
        states.append(state)
        reports.append(jax.device_get(report))
    return SimpleNamespace(config=config, states=states, reports=reports, traces=program.traces)


@pytest.mark.long
def test_one_program_for_all_and_the_state_keeps_its_types(flown):
    assert len(flown.traces) == 1
    for before, after in zip(*map(jax.tree.leaves, flown.states[-2:]), strict=True):
        assert (before.shape, before.dtype) == (after.shape, after.dtype)


def test_a_defender_that_learns_alone_has_to_come_nearer():
    config = with_table(TABLE)
    config = replace(config, game=replace(config.game, intercept_radius=30.0))
    config = replace(config, train=replace(config.train, strike_margin=30.0))
    combat = Coasting(config)
    env = reset_fights(combat, jnp.uint32(5), jnp.int32(0))
    keys = jax.random.split(jax.random.key(1))
    _, rollout = collect(combat, (some_policy(0), some_policy(1)), env, *keys)
    struck = np.asarray(rollout.cause) == Cause.INTERCEPT  # [T, N]
    assert np.all(struck[:, 1:5])  # the attacker learns there, too: 30 m reach everybody
    assert not np.any(struck[:, 5:])


@pytest.mark.long
def test_both_sides_learn_and_past_players_are_met_in_their_places_alone(flown):
    for chunk, (before, after) in enumerate(zip(flown.states, flown.states[1:], strict=False)):
        for side in (DEFENDER, ATTACKER):
            assert differs(agent(after, side).parameters, agent(before, side).parameters)
        met = np.asarray(after.selfplay.opponent[0])
        assert np.all(met[[0, 1, 2, 3, 4, 7]] == NOBODY)
        assert np.all((met[5:7] >= 0) & (met[5:7] <= chunk))
        assert int(after.selfplay.frozen[0]) == NOBODY
        assert after.selfplay.pools[DEFENDER] is None


def test_fights_are_counted_by_opponent(flown):
    rows = opponents.counted_rows(flown.config)
    names = [row.name if row else "live" for row in rows]
    assert names == [
        "live",
        "defender=scripted:hover_guard",
        "attacker=past:latest_and_hard",
        "attacker=a.safetensors",
    ]
    met = np.sum([report.met[0].sum(0) for report in flown.reports], axis=0)  # [R, 3]
    causes = sum(report.causes[0].sum() for report in flown.reports)
    assert met.shape == (4, 3) and met.sum() == causes and np.all(met.sum(1) > 0)
    past = flown.states[-1].selfplay.pools[ATTACKER]
    assert float(past.games.sum()) == met[2].sum()
    expected = met[2, Outcome.DEFENDER] + 0.5 * met[2, Outcome.DRAW]
    assert float(past.wins.sum()) == expected


@pytest.mark.long
def test_each_place_is_flown_by_whom_the_table_says(flown):
    """Actions of all eight environments at once against each one's pilot alone."""
    combat, config = Coasting(flown.config), flown.config
    state = jax.tree.map(lambda leaf: leaf[0], flown.states[-1])
    frozen = some_policy(1)
    guest = opponents.Guest(frozen, "ego")  # it was trained with another view than this run's
    flying = opponents.seats(combat, state.learners, state.selfplay, {FROZEN: guest})
    env = reset_fights(combat, jnp.uint32(5), jnp.int32(0))
    seen = jax.vmap(combat.observe)(env)
    seen_by_guest = view_of(config, "ego")(env, seen)
    assert np.abs(seen_by_guest - seen).max() > 1.0
    noise = jax.random.normal(jax.random.key(2), (8, NUM_SIDES, 4))
    action, log_prob, _ = act(config.learn, flying, seen, noise, env)
    live = [policy_of(select(state.learners, side)) for side in range(NUM_SIDES)]

    def drawn(policy: Policy, side: int, at: int) -> jax.Array:
        mean = policy_mean(config.learn, policy, seen[at, side])
        return mean + jnp.exp(policy.log_std) * noise[at, side]

    hover = build_pilot("hover_guard", config, combat.scene, DEFENDER)
    guard = hover(env, seen, jax.random.key(0))
    pool = state.selfplay.pools[ATTACKER].policies
    past = lambda at: jax.tree.map(lambda leaf: leaf[state.selfplay.opponent[at]], pool)
    defenders = [jnp.zeros(4), guard[1], guard[2], *(drawn(live[0], 0, at) for at in range(3, 8))]
    attackers = [
        *(drawn(live[1], 1, at) for at in range(5)),
        *(drawn(past(at), 1, at) for at in (5, 6)),
        policy_mean(config.learn, frozen, seen_by_guest[7, 1]),
    ]
    expected = np.stack([np.stack(defenders), np.stack(attackers)], axis=1)
    np.testing.assert_allclose(action, expected, rtol=1e-5, atol=1e-6)
    assert np.all(np.asarray(log_prob)[:3, 0] == 0.0) and float(log_prob[7, 1]) == 0.0
    assert np.all(np.asarray(log_prob)[3:, 0] != 0.0) and np.all(np.asarray(log_prob)[:7, 1] != 0.0)


@pytest.mark.slow
def test_nobody_in_a_table_is_the_share_that_flies_alone():
    table = with_table("defender=nobody 0.25")
    share = with_table("")
    share = replace(share, train=replace(share.train, solo_share=0.25))
    first, second = build(table, CHUNK), build(share, CHUNK)
    assert_same_bits(first.run(first.start)[0], second.run(second.start)[0])


@pytest.mark.long
def test_the_papers_self_play_in_a_table_has_the_same_bits():
    chunks = with_table("attacker=past 0.5 of chunks")
    paper = with_table("", probability=0.5)
    programs = [build(config, 2 * CHUNK * CHUNKS // 2) for config in (chunks, paper)]
    (first, counts), (second, report) = (program.run(program.start) for program in programs)
    assert_same_bits(first, second)
    assert_same_bits(counts._replace(met=None), report)
    frozen = np.asarray(report.frozen[0]) == ATTACKER
    assert 0 < frozen.sum() < len(frozen)
    met = np.asarray(counts.met[0]).sum(-1)  # [I, R]
    assert not np.any(met[frozen, 0]) and not np.any(met[~frozen, 1]) and met[frozen, 1].sum() > 0


@pytest.fixture(scope="module")
def chunks() -> SimpleNamespace:
    """A run in which chunks are live, or against a scripted defender, a frozen or a past attacker."""
    text = (
        "defender=scripted:hover 0.3 of chunks, attacker=a.safetensors 0.3 of chunks, "
        "attacker=past 0.3 of chunks"
    )
    config = with_table(text)
    program = build(config, CHUNK, {FROZEN: opponents.Guest(some_policy(1))})
    states, reports = [program.start], []
    for _ in range(8):
        state, report = program.run(states[-1])
        states.append(state)
        reports.append(jax.device_get(report))
    return SimpleNamespace(config=config, states=states, reports=reports)


@pytest.mark.long
def test_in_a_chunk_against_somebody_the_other_side_alone_learns(chunks):
    drawn = set()
    for before, after, report in zip(
        chunks.states, chunks.states[1:], chunks.reports, strict=False
    ):
        frozen = int(after.selfplay.frozen[0])
        met = np.unique(after.selfplay.opponent[0])
        assert len(met) == 1
        drawn.add((frozen, min(int(met[0]), 0)))
        for side in (DEFENDER, ATTACKER):
            if side == frozen:
                assert_same_bits(agent(after, side), agent(before, side))
            else:
                assert differs(agent(after, side).parameters, agent(before, side).parameters)
        counted = report.met[0].sum((0, 2)) > 0  # live, hover, the file, the past
        row = {NOBODY: 0, FIXED: 1, FIXED - 1: 2}.get(int(met[0]), 3)
        assert [bool(flag) for flag in counted] == [number == row for number in range(4)]
    assert len(drawn) >= 3


@pytest.mark.long
def test_rows_of_chunks_are_drawn_by_their_shares(chunks):
    config = with_table("defender=scripted:hover 0.1 of chunks, attacker=a 0.4 of chunks")
    learners = jax.tree.map(lambda leaf: leaf[0], chunks.states[0].learners)
    state = init_selfplay(config, learners)
    assert state is not None
    pick = jax.jit(jax.vmap(lambda key: choose(config, state, jnp.int32(3), key)))
    chosen = pick(jax.random.split(jax.random.key(8), 2000))
    met = np.asarray(chosen.opponent)[:, 0]
    counts = [int(np.sum(met == code)) for code in (NOBODY, FIXED, FIXED - 1)]
    assert sum(counts) == 2000 and tally.MIXED not in met
    assert stats.chisquare(counts, [1000, 200, 800]).pvalue > 1e-3
    sides = np.asarray(chosen.frozen)
    assert np.all(sides[met == FIXED] == DEFENDER) and np.all(sides[met == FIXED - 1] == ATTACKER)


def test_a_side_that_is_nowhere_live_has_no_learning_in_the_program():
    config = with_table("defender=scripted:hover")
    parts = opponents.parts(config)
    assert parts[DEFENDER].start == parts[DEFENDER].stop and parts[ATTACKER] == ALL
    combat, key = Coasting(config), jax.random.key(0)
    learners = jax.vmap(lambda key: init_learner(key, config.learn))(jax.random.split(key))
    steps, envs = config.learn.rollout_steps, config.train.num_envs

    env = reset_fights(combat, jnp.uint32(0), jnp.int32(0))
    policies = policy_of(select(learners, DEFENDER)), policy_of(select(learners, ATTACKER))
    shapes = jax.eval_shape(lambda: collect(combat, policies, env, key, key)[1])
    assert shapes.clock.shape == (steps, envs)

    def flops(parts) -> float:
        program = lambda rollout: learn_from(
            config.learn, learners, rollout, key, jnp.ones(2, bool), parts
        )
        cost = jax.jit(program).lower(shapes).cost_analysis()
        assert cost is not None
        return cost["flops"]

    assert flops(parts) < 0.6 * flops((ALL, ALL))


@pytest.mark.long
def test_against_one_opponent_the_other_side_keeps_every_bit():
    config = with_table("defender=scripted:hover_guard")
    program = build(config, CHUNK)
    assert program.start.selfplay is None
    state, report = program.run(program.start)
    assert_same_bits(agent(state, DEFENDER), agent(program.start, DEFENDER))
    assert differs(agent(state, ATTACKER).parameters, agent(program.start, ATTACKER).parameters)
    met = np.asarray(report.met[0]).sum((0, 2))
    assert met[0] == 0 and met[1] == np.asarray(report.causes).sum() > 0

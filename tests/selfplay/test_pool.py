"""Self-play against the past: who is saved, met, counted, and that nobody else is touched."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from toy import CHUNK, CONFIG, UNOPTIMISED, agent, assert_same_bits, build, differs

from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.fields import Config, LearnConfig, SelfPlayConfig, TrainConfig
from dronecombat_jax.learn.ippo import init_learner
from dronecombat_jax.learn.rollout import act, policy_of, select
from dronecombat_jax.selfplay.pool import (
    NOBODY,
    choose,
    count_wins,
    init_selfplay,
    lose_live,
    players,
    resize,
    save_players,
)
from dronecombat_jax.selfplay.samplers import GRADES
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, Outcome, SelfPlay

CHUNKS = 6
SIPPO = replace(
    CONFIG,
    selfplay=SelfPlayConfig(probability=0.5, roles="both"),
    train=replace(
        CONFIG.train, head_start_steps=0, total_steps=CHUNKS * CONFIG.steps_per_chunk, seed=9
    ),
)
TOY = Config(
    learn=LearnConfig(hidden_sizes=(4,)),
    selfplay=SelfPlayConfig(probability=0.2),
    train=TrainConfig(num_envs=6, chunk_iterations=1, total_steps=5 * 6 * 24),
)


@pytest.fixture(scope="module")
def flown() -> SimpleNamespace:
    """A run in which either side meets the past of the other: the states at the chunks' ends and
    the reports.
    """
    program = build(SIPPO, CHUNK)
    states, reports = [program.start], []
    for _ in range(CHUNKS):
        state, report = program.run(states[-1])
        states.append(state)
        reports.append(report)
    return SimpleNamespace(
        states=states, reports=reports, frozen=[int(s.selfplay.frozen[0]) for s in states[1:]]
    )


@pytest.mark.long
def test_the_run_has_live_and_both_kinds_of_frozen_chunks_and_starts_live(flown):
    assert set(flown.frozen) == {NOBODY, DEFENDER, ATTACKER} and flown.frozen[0] == NOBODY
    for state, report, frozen in zip(flown.states[1:], flown.reports, flown.frozen, strict=True):
        assert np.all(report.frozen == frozen)
        assert np.all(report.opponent == state.selfplay.opponent[0, 0])


@pytest.mark.long
def test_the_live_player_is_untouched_by_a_frozen_chunk_and_the_other_learns(flown):
    for before, after, frozen in zip(flown.states, flown.states[1:], flown.frozen, strict=False):
        for role in (DEFENDER, ATTACKER):
            if role == frozen:  # every leaf: weights, critic, optimiser, scalers, learning rate
                assert_same_bits(agent(after, role), agent(before, role))
            else:
                assert differs(agent(after, role).parameters, agent(before, role).parameters)


def test_the_pools_hold_the_players_of_every_chunks_start_and_nothing_else(flown):
    last = flown.states[-1]
    for role in (DEFENDER, ATTACKER):
        policies = last.selfplay.pools[role].policies
        for slot, state in enumerate(flown.states[:-1]):
            assert_same_bits(
                jax.tree.map(lambda leaf, slot=slot: leaf[:, slot], policies),
                policy_of(agent(state, role)),
            )
        early = flown.states[2].selfplay.pools[role].policies
        assert not any(np.any(leaf[:, 2:]) for leaf in jax.tree.leaves(early))


def test_only_past_players_are_met(flown):
    for chunk, (state, frozen) in enumerate(zip(flown.states[1:], flown.frozen, strict=True)):
        met = np.asarray(state.selfplay.opponent)
        assert np.all(met == NOBODY) if frozen == NOBODY else np.all((met >= 0) & (met <= chunk))


def test_fights_of_frozen_chunks_are_counted_for_the_member_that_was_met(flown):
    for chunk, frozen in enumerate(flown.frozen):
        before, after = (flown.states[chunk + i].selfplay.pools for i in (0, 1))
        for role in (DEFENDER, ATTACKER):
            # old records fade by half
            new = np.asarray(after[role].games - 0.5 * before[role].games)[0]
            expected = np.zeros(CHUNKS)
            if role == frozen:
                expected[flown.states[chunk + 1].selfplay.opponent[0, 0]] = flown.reports[
                    chunk
                ].causes.sum()
            np.testing.assert_array_equal(new, expected)


@pytest.mark.long
def test_a_probability_that_never_strikes_gives_the_numbers_of_ippo_bit_for_bit():
    ippo = build(replace(SIPPO, selfplay=SelfPlayConfig(probability=0.0)), CHUNK)
    never = build(replace(SIPPO, selfplay=SelfPlayConfig(probability=1e-12)), CHUNK)
    plain, pooled = ippo.start, never.start
    assert plain.selfplay is None
    for _ in range(2):
        plain, first = ippo.run(plain)
        pooled, second = never.run(pooled)
        assert_same_bits(pooled.replace(selfplay=None), plain)
        assert_same_bits(first, second)


@pytest.fixture(scope="module")
def toy() -> SimpleNamespace:
    """Pools of both roles with five different members, without flying."""
    config = replace(TOY, selfplay=replace(TOY.selfplay, roles="both"))
    generations = [
        jax.vmap(lambda key: init_learner(key, TOY.learn))(jax.random.split(jax.random.key(i)))
        for i in range(6)
    ]
    state = init_selfplay(config, generations[0])
    for slot, learners in enumerate(generations[:5]):
        state = save_players(config, state, learners, jnp.int32(slot))
    return SimpleNamespace(config=config, live=generations[5], generations=generations, state=state)


@pytest.mark.long
def test_over_2000_chunk_starts_a_fifth_is_frozen_and_members_are_drawn_alike(toy):
    pick = jax.jit(jax.vmap(lambda key: choose(TOY, toy.state, jnp.int32(3), key)))
    chosen = pick(jax.random.split(jax.random.key(8), 2000))
    frozen = np.asarray(chosen.frozen) == ATTACKER
    assert set(np.unique(chosen.frozen)) == {NOBODY, ATTACKER}
    assert stats.binomtest(int(frozen.sum()), 2000, 0.2).pvalue > 1e-3
    met = np.asarray(chosen.opponent)
    # one for all environments
    assert np.all(met[~frozen] == NOBODY) and np.all(met[frozen] == met[frozen][:, :1])
    counts = np.bincount(met[frozen][:, 0], minlength=5)
    # slots 0 to 3 are filled in chunk 3
    assert counts[4] == 0 and stats.chisquare(counts[:4]).pvalue > 1e-3


@pytest.mark.parametrize(
    ("roles", "past"), [("defender", {ATTACKER}), ("attacker", {DEFENDER}), ("both", {0, 1})]
)
def test_who_meets_whose_past(toy, roles, past):
    config = replace(TOY, selfplay=SelfPlayConfig(probability=1.0, roles=roles))
    keys = jax.random.split(jax.random.key(9), 50)
    assert (
        set(
            np.unique(
                jax.vmap(lambda key: choose(config, toy.state, jnp.int32(2), key))(keys).frozen
            )
        )
        == past
    )


def test_neither_the_first_chunk_nor_the_head_start_is_frozen(toy):
    always = replace(
        TOY,
        selfplay=SelfPlayConfig(probability=1.0),
        train=replace(TOY.train, head_start_steps=3 * 144),
    )
    frozen = [
        int(choose(always, toy.state, jnp.int32(chunk), jax.random.key(chunk)).frozen)
        for chunk in range(5)
    ]
    assert frozen == [NOBODY, NOBODY, NOBODY, ATTACKER, ATTACKER]
    no_start = replace(always, train=TOY.train)
    assert int(choose(no_start, toy.state, jnp.int32(0), jax.random.key(0)).frozen) == NOBODY


def frozen(state: SelfPlay, role: int, opponent) -> SelfPlay:
    return state.replace(frozen=jnp.int32(role), opponent=jnp.asarray(opponent, jnp.int32))


def test_the_frozen_role_is_flown_by_its_past_with_its_own_scaler(toy):
    defender, attacker = players(toy.config, toy.live, frozen(toy.state, ATTACKER, [2] * 6))
    assert_same_bits(defender, policy_of(select(toy.live, DEFENDER)))
    assert_same_bits(attacker, policy_of(select(toy.generations[2], ATTACKER)))
    nobody = players(toy.config, toy.live, frozen(toy.state, NOBODY, [NOBODY] * 6))
    assert_same_bits(nobody, players(toy.config, toy.live, None))


@pytest.mark.long
def test_with_scope_environment_each_one_meets_its_own(toy):
    config = replace(toy.config, selfplay=replace(toy.config.selfplay, scope="environment"))
    slots = [0, 3, 3, 1, 2, 4]
    flying = players(config, toy.live, frozen(toy.state, DEFENDER, slots))
    observation = jax.random.normal(jax.random.key(1), (6, 2, 35))
    action, *_ = act(TOY.learn, flying, observation, jnp.zeros((6, 2, 4)))
    for env, slot in enumerate(slots):
        past = (
            policy_of(select(toy.generations[slot], DEFENDER)),
            policy_of(select(toy.live, ATTACKER)),
        )
        alone, *_ = act(TOY.learn, past, observation[env : env + 1], jnp.zeros((1, 2, 4)))
        np.testing.assert_allclose(action[env], alone[0], rtol=1e-5, atol=1e-6)
    drawn = choose(
        replace(config, selfplay=replace(config.selfplay, probability=1.0)),
        toy.state,
        jnp.int32(4),
        jax.random.key(0),
    )
    assert len(np.unique(drawn.opponent)) > 1


@pytest.mark.long
def test_a_run_with_scope_environment_leaves_the_live_attacker_alone():
    selfplay = SelfPlayConfig(probability=1.0, scope="environment", sampler="pfsp_variance")
    program = build(replace(SIPPO, selfplay=selfplay), CHUNK)
    first, _ = program.run(program.start)
    second, _ = program.run(first)
    assert_same_bits(agent(second, ATTACKER), agent(first, ATTACKER))
    assert differs(agent(second, DEFENDER).parameters, agent(first, DEFENDER).parameters)
    assert float(second.selfplay.pools[ATTACKER].games.sum()) > 0


def test_the_authors_slip_loses_the_live_attacker(toy):
    lost = lose_live(toy.config, toy.live, frozen(toy.state, ATTACKER, [1] * 6))
    assert_same_bits(
        policy_of(select(lost, ATTACKER)), policy_of(select(toy.generations[1], ATTACKER))
    )
    assert_same_bits(select(lost, DEFENDER), select(toy.live, DEFENDER))
    assert_same_bits(select(lost, ATTACKER).optimizer, select(toy.live, ATTACKER).optimizer)


def record_of(state: SelfPlay, role: int) -> tuple[list[float], list[float]]:
    """Wins and games against each member."""
    pool = state.pools[role]
    assert pool is not None
    return pool.wins.tolist(), pool.games.tolist()


def test_wins_are_counted_by_the_member_met_and_ties_half(toy):
    outcomes = jnp.asarray([[Outcome.DEFENDER, Outcome.ATTACKER, Outcome.DRAW, 0, 0, 0]] * 2)
    rho = jnp.full((2, 6), 0.25)
    done = jnp.asarray([[True] * 3 + [False] * 3, [True] + [False] * 5])
    state = count_wins(frozen(toy.state, ATTACKER, [0, 1, 1, 2, 3, 4]), outcomes, done, rho)
    # The live defender won twice against member 0, and tied once against member 1.
    assert record_of(state, ATTACKER) == ([2.0, 0.5, 0.0, 0.0, 0.0], [2.0, 2.0, 0.0, 0.0, 0.0])
    assert record_of(state, DEFENDER) == ([0.0] * 5, [0.0] * 5)
    other = count_wins(frozen(toy.state, DEFENDER, [0, 1, 1, 2, 3, 4]), outcomes, done, rho)
    assert record_of(other, DEFENDER)[0] == [0.0, 1.5, 0.0, 0.0, 0.0]
    live = count_wins(frozen(toy.state, NOBODY, [NOBODY] * 6), outcomes, done, rho)
    assert_same_bits(live.pools, toy.state.pools)
    soon = count_wins(
        frozen(toy.state, ATTACKER, [0, 1, 1, 2, 3, 4]), outcomes, done, rho, GRADES["rho"]
    )
    assert record_of(soon, ATTACKER) == ([0.5, 0.0, 0.0, 0.0, 0.0], [2.0, 2.0, 0.0, 0.0, 0.0])


@pytest.mark.slow
def test_records_of_a_run_can_be_graded_by_how_soon_it_won():
    """A win is worth the time that was left, which is never all of it."""
    selfplay = SelfPlayConfig(probability=1.0, memory=1.0, record="rho")
    program = build(replace(SIPPO, selfplay=selfplay), 2 * CHUNK)
    state, report = program.run(program.start)
    pool = state.selfplay.pools[ATTACKER]
    outcomes = np.asarray(outcome_table(SIPPO.game))[np.asarray(Cause)]
    frozen = np.asarray(report.frozen[0]) == ATTACKER
    won = np.asarray(report.causes)[0][frozen][:, outcomes == Outcome.DEFENDER].sum()
    assert 0.0 < float(pool.wins.sum()) < won <= float(pool.games.sum())


def test_a_longer_run_has_more_slots_and_the_same_members(toy):
    state = jax.tree.map(lambda leaf: leaf[None], toy.state)
    longer = resize(state, 8)
    assert all(leaf.shape[:2] == (1, 8) for leaf in jax.tree.leaves(longer.pools))
    assert_same_bits(resize(longer, 5), state)
    assert not any(np.any(leaf[:, 5:]) for leaf in jax.tree.leaves(longer.pools))


def test_choosing_is_one_program_for_every_chunk(toy):
    """The chunk is data: nothing compiles again as the pool fills."""
    traces = []

    def counted(chunk):
        traces.append(1)
        return choose(TOY, toy.state, chunk, jax.random.key(0)).opponent

    program = jax.jit(counted, compiler_options=UNOPTIMISED)
    for chunk in range(5):
        program(jnp.int32(chunk))
    assert len(traces) == 1

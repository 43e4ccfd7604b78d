"""Which fights count: those flown from start to end by the same two, for as long as they were
flown.
"""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import CONFIG, build

from dronecombat_jax.config.fields import SelfPlayConfig
from dronecombat_jax.selfplay import tally
from dronecombat_jax.selfplay.pool import NOBODY, met
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, SelfPlay


def rollout(done, reward, clock) -> SimpleNamespace:
    """What `follow` and `counted` read of one; [T, N]."""
    done = jnp.asarray(done, bool)
    reward = jnp.broadcast_to(jnp.asarray(reward, jnp.float32)[..., None], (*done.shape, 2))
    return SimpleNamespace(
        terminated=done,
        truncated=jnp.zeros_like(done),
        reward=reward,
        clock=jnp.asarray(clock, jnp.int32),
    )


def test_steps_and_returns_are_of_what_was_flown():
    # one environment whose clock began at 7: its fight ends after 2 steps, the next after 3
    clock = [[8], [9], [1], [2], [3]]
    flown = tally.fresh(1, 2)
    made = rollout([[0], [1], [0], [0], [1]], [[1.0], [10.0], [2.0], [3.0], [4.0]], clock)
    after, at = tally.follow(flown, made, jnp.asarray([NOBODY]))  # pyright: ignore
    assert at.steps[:, 0].tolist() == [1, 2, 1, 2, 3] and at.returns[:, 0, 0].tolist() == [
        1.0,
        11.0,
        2.0,
        5.0,
        9.0,
    ]
    assert tally.counted(at, made)[:, 0].tolist() == [False, False, False, False, True]  # pyright: ignore
    assert after.steps.tolist() == [0] and after.returns.tolist() == [[0.0, 0.0]]


def test_a_fight_counts_for_the_opponent_that_flew_all_of_it():
    """60 steps flown by the live attacker, one by slot 0: nobody's fight."""
    flown = tally.fresh(2, 2)
    quiet = rollout(np.zeros((60, 2)), np.zeros((60, 2)), np.arange(1, 61)[:, None] * [1, 1])
    flown, _ = tally.follow(flown, quiet, jnp.full(2, NOBODY))  # pyright: ignore
    end = rollout([[1, 0], [0, 0], [1, 1]], np.zeros((3, 2)), [[61, 61], [1, 62], [2, 63]])
    slot_0 = jnp.full(2, 1)  # the attacker of slot 0, as `met` spells it
    flown, at = tally.follow(flown, end, slot_0)  # pyright: ignore
    assert (
        at.met[:, 0].tolist() == [tally.MIXED, 1, 1] and at.met[:, 1].tolist() == [tally.MIXED] * 3
    )
    counts = tally.counted(at, end)  # pyright: ignore
    assert counts.tolist() == [[False, False], [False, False], [True, False]]  # the one begun since
    assert flown.met.tolist() == [1, 1]  # and what begins now is slot 0's again


def test_a_fight_under_way_of_which_nothing_is_known_never_counts():
    flown = tally.unknown(1, 2)
    clock = 40
    for _ in range(3):
        step = rollout([[0]], [[0.0]], [[clock + 1]])
        flown, _ = tally.follow(flown, step, jnp.full(1, NOBODY))  # pyright: ignore
        clock += 1
    end = rollout([[1]], [[0.0]], [[clock + 1]])
    assert not tally.counted(tally.follow(flown, end, jnp.full(1, NOBODY))[1], end).any()  # pyright: ignore


def test_who_is_met_is_role_and_slot():
    state = SelfPlay(pools=(None, None), frozen=jnp.int32(ATTACKER), opponent=jnp.asarray([0, 3]))
    assert met(None, 2).tolist() == [NOBODY, NOBODY]
    assert met(state, 2).tolist() == [1, 7]
    assert met(state.replace(frozen=jnp.int32(DEFENDER)), 2).tolist() == [0, 6]
    assert met(state.replace(frozen=jnp.int32(NOBODY)), 2).tolist() == [NOBODY, NOBODY]


@pytest.fixture(scope="module")
def run() -> SimpleNamespace:
    """Self-play in which fights go on over chunks: 6 chunks of 2 iterations of 6 steps, time-out
    after 9.
    """
    config = replace(
        CONFIG,
        game=replace(CONFIG.game, episode_steps=9),
        selfplay=SelfPlayConfig(probability=0.5, memory=1.0),
        train=replace(CONFIG.train, total_steps=576, head_start_steps=0, seed=5),
    )
    program = build(config, 12)
    state, report = program.run(program.start)
    return SimpleNamespace(config=config, state=state, report=jax.device_get(report))


@pytest.mark.long
def test_a_run_counts_no_fight_that_it_did_not_fly_whole(run):
    report, steps = run.report, run.config.learn.rollout_steps
    fights = report.causes[0].sum(-1)
    most = steps * (1 + np.arange(12))
    assert np.all(report.episode_steps[0] <= most * fights)
    # no fight can have lasted 9 steps yet, whatever its clock says
    assert report.causes[0, 0, Cause.TIMEOUT] == 0
    assert report.causes[0, :, Cause.TIMEOUT].sum() > 0
    frozen = report.frozen[0].reshape(6, 2)[:, 0]
    assert set(frozen) == {NOBODY, ATTACKER}
    changes = np.flatnonzero(np.diff(frozen) != 0) + 1
    # those were begun against somebody else
    assert np.all(report.causes[0, 2 * changes, Cause.TIMEOUT] == 0)
    _, attackers = run.state.selfplay.pools
    assert attackers.games.sum() == report.causes[0].sum(-1)[report.frozen[0] == ATTACKER].sum()

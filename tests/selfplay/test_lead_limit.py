"""A side that is too far ahead rests until the other has caught up (`train.lead_limit`)."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from toy import CONFIG, agent, build, differs

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, SelfPlayConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.runs.records import records
from dronecombat_jax.selfplay.chunk import rests
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause

BOTH = np.ones(2, bool)


def limited(limit: float, **selfplay) -> Config:
    train = replace(CONFIG.train, lead_limit=limit, head_start_steps=0)
    return replace(CONFIG, train=train, selfplay=SelfPlayConfig(**selfplay))


def ends(**counts: int) -> np.ndarray:
    causes = np.zeros(len(Cause), np.int32)
    for name, count in counts.items():
        causes[Cause[name]] = count
    return causes


def test_who_rests():
    config = limited(0.75)
    who = lambda learning=BOTH, config=config, **counts: rests(
        config, ends(**counts), learning
    ).tolist()
    assert who(REACHED=8, INTERCEPT=2) == [False, True]
    assert who(REACHED=2, INTERCEPT=6, ATTACKER_CRASH=2) == [True, False]
    assert who(REACHED=3, INTERCEPT=1) == [False, False]  # exactly the limit
    # in double precision 0.57 * 100 is below 57: the record would say what the program did not do
    assert who(config=limited(0.57), REACHED=57, TIMEOUT=43) == [False, False]
    assert who(REACHED=7, TIMEOUT=3) == [False, False]  # a tie is nobody's
    assert who() == [False, False]
    assert who(np.asarray([False, True]), REACHED=9) == [False, False]  # the other waits itself
    against = limited(0.75, opponents="defender=scripted:hover")
    assert who(config=against, REACHED=9) == [False, False]  # nobody to wait for


def test_arrays_of_both_kinds_and_many_iterations():
    causes = np.stack([ends(REACHED=9), ends(INTERCEPT=9), ends(TIMEOUT=9)])
    learning = np.broadcast_to(BOTH, (3, 2))
    wanted = [[False, True], [True, False], [False, False]]
    assert rests(limited(0.75), causes, learning).tolist() == wanted
    traced = jax.jit(lambda *given: rests(limited(0.75), *given))
    assert traced(jnp.asarray(causes), jnp.asarray(learning)).tolist() == wanted


@pytest.mark.long
def test_a_side_ahead_keeps_every_bit_and_the_other_learns():
    config = limited(0.5)
    program = build(config, 1)
    state, rested = program.start, []
    for iteration in range(12):
        after, report = program.run(state)
        numbers = jax.tree.map(np.asarray, report)
        (resting,) = rests(config, numbers.causes[0], BOTH[None])
        (record,) = records(config, numbers, iteration)
        for side, name in ((DEFENDER, "defender"), (ATTACKER, "attacker")):
            moved = differs(agent(state, side), agent(after, side))
            assert moved == (not resting[side])
            assert (record[f"policy_loss/{name}"] is None) == resting[side]
        rested.append(resting)
        state = after
    assert np.any(rested) and not np.all(np.any(rested, axis=1))


@pytest.mark.parametrize("limit", ["0.4", "1.5"])
def test_a_limit_that_makes_no_sense_is_refused(limit: str):
    with pytest.raises(UserError, match=f"--train.lead-limit {limit}: .*0.5.*1"):
        settings.load("smoke", {"train.lead_limit": float(limit)})

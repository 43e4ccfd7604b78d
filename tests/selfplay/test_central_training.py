"""Training with a critic that sees the whole state, at toy size."""

from dataclasses import replace

import numpy as np
import pytest
from toy import CONFIG, agent, assert_same_bits, build, differs

from dronecombat_jax.learn.rollout import policy_of
from dronecombat_jax.types import ATTACKER, DEFENDER


@pytest.mark.slow
def test_the_critic_changes_what_is_learnt_and_nothing_of_what_is_flown_before():
    central = replace(CONFIG, learn=replace(CONFIG.learn, critic="central"))
    own, whole = build(CONFIG, 1), build(central, 1)
    assert_same_bits(policy_of(own.start.learners), policy_of(whole.start.learners))
    first, (seeing, _) = own.run(own.start)[0], whole.run(whole.start)
    assert_same_bits(first.env, seeing.env)  # flown before anything was learnt
    assert differs(policy_of(agent(first, ATTACKER)), policy_of(agent(seeing, ATTACKER)))
    # its statistics took in the attacker's steps; the defender waits out the head start
    steps = CONFIG.steps_per_iteration
    counts = np.asarray(seeing.learners.critic_scaler.count)[0]
    assert 1.0 < counts[ATTACKER] <= 1.0 + steps and counts[DEFENDER] == 1.0
    assert first.learners.critic_scaler is None

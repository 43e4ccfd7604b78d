"""Recorded fights: the starts and the outcomes of a tournament, whoever flies."""

from functools import partial

import jax
import numpy as np
import pytest
from policies import make_policy
from saved_runs import TOY
from toy import Coasting

from dronecombat_jax.arena.lanes import fight_key, start_states
from dronecombat_jax.arena.match import fight, policy_pilot, record
from dronecombat_jax.arena.players import content_words
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.watch import recording
from dronecombat_jax.watch.flyers import Flyer
from dronecombat_jax.watch.recording import Filming, recorder

LEARN = LearnConfig(hidden_sizes=(16, 8))
POLICIES = [
    Flyer(f"policy {seed}", make_policy(seed=seed), LEARN, f"{seed}" * 64) for seed in range(2)
]
HOVER = Flyer("hover", "hover", LEARN, "hover")


@pytest.fixture(scope="module")
def combat() -> Coasting:
    return Coasting(TOY)


@pytest.mark.long
def test_a_fight_is_that_of_a_tournament_however_many_are_recorded(combat: Coasting):
    """By `match.fight` of that fight alone, with the key that gives a tournament's random numbers."""
    two, three = (
        recorder(combat, Filming(count, 7, stochastic=True))(*POLICIES) for count in (2, 3)
    )
    starts = start_states(combat, 7, 3)
    words = np.concatenate([content_words(flyer.identity) for flyer in POLICIES])
    pilots = [policy_pilot(LEARN, flyer.pilot, role, True) for role, flyer in enumerate(POLICIES)]
    alone = jax.jit(partial(fight, combat, *pilots))
    for episode, flown in enumerate(three):
        start = jax.tree.map(lambda leaf, e=episode: leaf[e : e + 1], starts)
        result = alone(start, fight_key(np.uint32(7), words, np.int32(episode)))
        assert (flown.cause, len(flown.time) - 1) == (int(result.cause[0]), int(result.steps[0]))
        np.testing.assert_array_equal(flown.qpos[0], starts.qpos[episode])
    for flown, again in zip(two, three, strict=False):
        np.testing.assert_allclose(flown.qpos, again.qpos, atol=1e-5)


@pytest.mark.long
def test_drawn_actions_are_others_than_the_mean(combat: Coasting):
    mean, drawn = (
        recorder(combat, Filming(1, 0, stochastic))(*POLICIES)[0] for stochastic in (False, True)
    )
    assert np.abs(mean.action[0] - drawn.action[0]).max() > 0.01


def test_policies_of_one_shape_share_a_program(combat: Coasting, monkeypatch: pytest.MonkeyPatch):
    traced = []
    monkeypatch.setattr(recording, "record", lambda *given: (traced.append(1), record(*given))[1])
    fly = recorder(combat, Filming(1))
    first, second = (fly(*pair) for pair in (POLICIES, POLICIES[::-1]))
    assert len(traced) == 1 and np.abs(first[0].action[0] - second[0].action[0]).max() > 0.01


def test_a_scripted_pilot_flies_beside_a_policy(combat: Coasting):
    (flown,) = recorder(combat, Filming(1))(HOVER, POLICIES[1])
    assert np.isfinite(flown.qpos).all() and len(flown.time) > 1

"""Team mates that learn a policy each (`learn.mates`), beside those that share one."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from policies import make_policy
from toy import CHUNK, CONFIG, UNOPTIMISED, Coasting, agent, assert_same_bits, differs, two_chunks

from dronecombat_jax.arena.match import policy_team
from dronecombat_jax.config.fields import Config, SelfPlayConfig
from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.learn.algorithms import learn_from, live_policy
from dronecombat_jax.learn.rollout import act, collect
from dronecombat_jax.runs.guards import SKIPPED_ITERATIONS, Watch
from dronecombat_jax.runs.past_players import Players, filled_slots
from dronecombat_jax.runs.provenance import describe
from dronecombat_jax.runs.records import records
from dronecombat_jax.runs.resume import find_start, read_start, restored_state
from dronecombat_jax.selfplay.chunk import build_advance, init_state
from dronecombat_jax.selfplay.opponents import Guest, of_drones
from dronecombat_jax.types import DEFENDER, TeamPolicy, TrainState, UpdateMetrics

KEY = jax.random.key(0)
FIRST, SECOND, ALONE = range(3)  # two defenders, one attacker


def with_mates(mates: str, config: Config = CONFIG) -> Config:
    return replace(config, learn=replace(config.learn, mates=mates))  # pyright: ignore[reportArgumentType]


OWN = with_mates(
    "own",
    replace(
        CONFIG,
        game=replace(CONFIG.game, defenders=2, crash_rule="out"),
        train=replace(CONFIG.train, head_start_steps=0),
        selfplay=SelfPlayConfig(probability=1.0, roles="attacker", scope="environment"),
    ),
)


@pytest.fixture(scope="module")
def run() -> SimpleNamespace:
    """Two chunks of two defenders, a policy each, against one; in the second, past teams defend."""
    return two_chunks(OWN)


@pytest.mark.long
def test_each_mate_begins_and_learns_on_its_own_and_sharers_are_one(run: SimpleNamespace):
    first, live = run.states[0], run.states[CHUNK]
    assert differs(agent(first, FIRST).parameters, agent(first, SECOND).parameters)
    changes = [
        jax.tree.map(
            lambda a, b: a - b, agent(live, index).parameters, agent(first, index).parameters
        )
        for index in (FIRST, SECOND, ALONE)
    ]
    assert all(any(np.any(leaf) for leaf in jax.tree.leaves(change)) for change in changes)
    assert differs(changes[FIRST], changes[SECOND])
    assert live.learners.value_scaler.mean.shape == (1, 3)
    together = jax.eval_shape(lambda: init_state(Coasting(with_mates("shared", OWN))))
    assert together.learners.value_scaler.mean.shape == (1, 2)


@pytest.mark.long
def test_a_past_player_is_a_whole_team(run: SimpleNamespace):
    pool = run.states[-1].selfplay.pools[DEFENDER].policies
    assert isinstance(pool, TeamPolicy) and len(pool.mates) == 2
    for slot, state in enumerate((run.states[0], run.states[CHUNK])):
        for number, mate in enumerate(pool.mates):
            saved = jax.tree.map(lambda leaf, slot=slot: leaf[:, slot], mate.network)
            assert_same_bits(saved, agent(state, number).parameters.policy)
    assert_same_bits(agent(run.states[-1], SECOND), agent(run.states[CHUNK], SECOND))
    assert differs(agent(run.states[-1], ALONE), agent(run.states[CHUNK], ALONE))


def test_a_run_goes_on_from_a_checkpoint_bit_for_bit(run: SimpleNamespace, tmp_path: Path):
    """Inside the chunk in which past teams fly: the pool comes back, too."""
    directory, state, done = RunDirectory(tmp_path), run.states[CHUNK + 1], CHUNK + 1
    directory.checkpoints.mkdir()
    apart, roster = Players(directory.checkpoints).store(jax.device_get(state), 2)
    checkpoint.save(directory.checkpoints, done, apart, describe(OWN, done), players=roster)
    back = restored_state(read_start(directory, done), OWN, run.program.combat)
    assert_same_bits(back, state)
    assert_same_bits(run.program.run(back)[0], run.states[2 * CHUNK])


def test_a_damaged_past_team_is_made_again(run: SimpleNamespace, tmp_path: Path):
    directory = RunDirectory(tmp_path)
    directory.checkpoints.mkdir()
    players = Players(directory.checkpoints)
    for done in (CHUNK, CHUNK + 1):
        slots = filled_slots(done, CHUNK)
        apart, roster = players.store(jax.device_get(run.states[done]), slots)
        checkpoint.save(directory.checkpoints, done, apart, describe(OWN, done), players=roster)
    file = directory.checkpoints / "players" / "1.safetensors"
    sound = file.read_bytes()
    file.write_bytes(sound[:-1] + bytes([sound[-1] ^ 1]))
    start = find_start(directory, OWN)
    assert start is not None and start.iteration == CHUNK + 1 and file.read_bytes() == sound


def test_a_record_has_the_mean_of_the_mates_and_each_ones_own(run: SimpleNamespace):
    report = run.reports[CHUNK - 1]
    record = records(OWN, report, CHUNK - 1)[0]
    for name in UpdateMetrics._fields:
        each = [record[f"{name}/defender{number}"] for number in (1, 2)]
        np.testing.assert_allclose(each, getattr(report.learners, name)[0, 0, :2], rtol=1e-6)
        assert record[f"{name}/defender"] == pytest.approx(np.mean(each))
        assert f"{name}/attacker1" not in record
    assert record["kl/attacker"] == pytest.approx(report.learners.kl[0, 0, ALONE])
    waiting = records(OWN, run.reports[-1], 2 * CHUNK - 1)[0]
    assert waiting["kl/defender"] is waiting["kl/defender2"] is None
    assert waiting["kl/attacker"] is not None


def test_a_training_that_stops_names_the_drone_whose_gradients_are_lost(run: SimpleNamespace):
    lost = np.array([[[0, OWN.learn.epochs * OWN.learn.minibatches, 0]]])
    report = run.reports[0]._replace(
        learners=run.reports[0].learners._replace(skipped=lost), diverged=np.zeros((1, 1))
    )
    watch = Watch(OWN)
    verdicts = [watch.verdict(report, iteration) for iteration in range(SKIPPED_ITERATIONS)]
    assert not any(verdicts[:-1])
    assert verdicts[-1].startswith("not one finite gradient for the defender2 of seed 4")


@pytest.mark.long
def test_mates_that_change_places_with_their_learners_learn_the_same(run: SimpleNamespace):
    """Each learns from its own drone's steps: with the drones of the rollout exchanged, and the
    learners, every number is the other's.
    """
    learn = replace(OWN.learn, minibatch_order="sequential")  # no random numbers
    combat = Coasting(replace(OWN, learn=learn))
    state: TrainState = jax.tree.map(lambda leaf: leaf[0], run.states[CHUNK])
    numbers = lambda leaf: np.random.default_rng(0).standard_normal(leaf.shape).astype(leaf.dtype)
    flying = tuple(jax.tree.map(np.asarray, make_policy((51, 8, 4), seed)) for seed in range(3))
    shapes = jax.eval_shape(lambda: collect(combat, flying, state.env, KEY, KEY)[1])
    rollout: Any = jax.tree.map(numbers, shapes)
    rollout = rollout._replace(active=np.ones_like(rollout.active))
    everybody = jnp.ones(2, bool)
    update = jax.jit(
        lambda learners, rollout: learn_from(
            learn, learners, rollout, KEY, everybody, sides=OWN.game.sides
        ),
        compiler_options=UNOPTIMISED,
    )
    exchange = [SECOND, FIRST, ALONE]
    of_learners = lambda tree: jax.tree.map(lambda leaf: leaf[jnp.array(exchange)], tree)
    of_drones = lambda leaf: leaf[:, :, exchange] if leaf.ndim > 2 else leaf
    plain, metrics = update(state.learners, rollout)
    swapped = update(of_learners(state.learners), jax.tree.map(of_drones, rollout))
    assert_same_bits(of_learners((plain, metrics)), swapped)
    assert differs(select(plain, FIRST).parameters, select(state.learners, FIRST).parameters)
    assert differs(metrics.policy_loss[FIRST], metrics.policy_loss[SECOND])


def select(learners: Any, index: int) -> Any:
    return jax.tree.map(lambda leaf: leaf[index], learners)


def test_actions_change_places_with_policies_and_drones():
    """In training and in a match; not one that both drones could fly by the first's policy."""
    size = 3 * 16 + 3
    one, other, alone = (make_policy((size, 8, 4), seed) for seed in range(3))
    seen = np.random.default_rng(1).standard_normal((5, 3, size)).astype(np.float32)
    noise = np.random.default_rng(2).standard_normal((5, 3, 4)).astype(np.float32)
    exchange = [SECOND, FIRST, ALONE]

    def trained(*mates: Any, seen: np.ndarray, noise: np.ndarray) -> np.ndarray:
        flying = of_drones(OWN, (TeamPolicy(mates), alone))
        return np.asarray(act(OWN.learn, flying, jnp.asarray(seen), jnp.asarray(noise))[0])

    def matched(*mates: Any, seen: np.ndarray) -> np.ndarray:
        pilots: Any = policy_team(OWN, OWN.learn, TeamPolicy(mates), DEFENDER)
        return np.stack([pilot(None, jnp.asarray(seen), KEY) for pilot in pilots], axis=1)

    plain = trained(one, other, seen=seen, noise=noise)
    swapped = trained(other, one, seen=seen[:, exchange], noise=noise[:, exchange])
    np.testing.assert_allclose(swapped, plain[:, exchange], rtol=1e-6, atol=1e-6)
    plain = matched(one, other, seen=seen)
    swapped = matched(other, one, seen=seen[:, exchange])
    np.testing.assert_allclose(swapped, plain[:, [1, 0]], rtol=1e-6, atol=1e-6)
    assert not np.allclose(plain, matched(one, one, seen=seen))


@pytest.mark.parametrize("probability", [0.0, pytest.param(1.0, marks=pytest.mark.slow)])
@pytest.mark.long
def test_one_drone_a_side_has_the_very_same_program(probability: float):
    texts = []
    for mates in ("shared", "own"):
        selfplay = SelfPlayConfig(probability=probability, roles="both", restore_live=False)
        combat = Coasting(with_mates(mates, replace(CONFIG, selfplay=selfplay)))
        start = jax.jit(lambda combat=combat: init_state(combat))
        shapes = jax.eval_shape(start)
        advance = jax.jit(build_advance(combat, 1)).lower(shapes)
        texts.append((start.lower().as_text(), advance.as_text()))
    assert texts[0] == texts[1]


FROZEN = "defender=team.safetensors"
TOGETHER: dict[str, Any] = {
    "a central critic, a GRU and a table": (
        {"critic": "central", "memory": "gru", "memory_size": 6},
        "world",
        {"opponents": f"defender=past 0.25, {FROZEN} 0.25, defender=scripted:hover 0.25"},
    ),
    "the mean of others and a live player that is lost": (
        {"others": "mean", "others_size": 4},
        "nearest",
        {"probability": 0.5, "restore_live": False},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", TOGETHER)
def test_an_iteration_keeps_its_states_shapes_together_with(case: str):
    learn, observation, selfplay = TOGETHER[case]
    config = replace(
        OWN,
        learn=replace(OWN.learn, **learn),
        game=replace(OWN.game, observation=observation),
        selfplay=SelfPlayConfig(**selfplay),
    )
    combat = Coasting(config)
    before = jax.eval_shape(lambda: init_state(combat))
    of_seed = jax.tree.map(lambda leaf: np.zeros(leaf.shape[1:], leaf.dtype), before.learners)
    cast = {FROZEN: Guest(live_policy(config, of_seed, DEFENDER))}
    after, report = jax.eval_shape(build_advance(combat, 1, cast=cast), before)
    assert jax.tree.structure(before) == jax.tree.structure(after)
    for old, new in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
        assert (old.shape, old.dtype) == (new.shape, new.dtype)
    assert report.learners.kl.shape == (1, 1, 3) and isinstance(cast[FROZEN].policy, TeamPolicy)

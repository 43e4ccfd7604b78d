"""Fights of drones that are more than ideal rigid bodies: what is carried, drawn and kept."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.combat import scripted
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import (
    Config,
    DroneConfig,
    RandomiseConfig,
    SimConfig,
    TrainConfig,
)
from dronecombat_jax.sim import noise
from dronecombat_jax.types import DEFENDER, Cause, Drawn, EnvState

KEY = jax.random.key(0)
SIZE = 8
REAL = Config(
    sim=SimConfig(body="firmware", actuation="rotors", drag=True, gust_speed=1.0, battery=3.8),
    randomise=RandomiseConfig(mass=0.2, inertia=0.2, thrust=0.1, lag=0.5, drag=0.5, battery=0.05),
)


@pytest.fixture(scope="module")
def real() -> SimpleNamespace:
    combat = Combat(REAL)
    return SimpleNamespace(
        combat=combat,
        start=jax.vmap(combat.spawn)(combat.start_numbers(KEY, (SIZE,))),
        step=jax.jit(jax.vmap(combat.step)),
    )


def drawn_in(state: EnvState) -> Drawn:
    assert state.craft is not None and state.craft.drawn is not None
    return state.craft.drawn


def test_the_default_carries_nothing_more(arena: SimpleNamespace):
    state = arena.combat.reset(KEY)
    assert state.craft is None and len(jax.tree.leaves(state)) == 5


@pytest.mark.long
def test_shapes_and_types_are_stable(real: SimpleNamespace):
    described = lambda tree: jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype.name), tree)
    single = jax.eval_shape(real.combat.reset, KEY)
    after, _ = jax.eval_shape(real.combat.step, single, jnp.zeros((2, 4)))
    assert described(after) == described(single)
    assert not [leaf for leaf in jax.tree.leaves((single, after)) if leaf.weak_type]
    moving = Combat(
        Config(sim=REAL.sim, randomise=REAL.randomise, train=TrainConfig(start_speed=4.0)),
        real.combat.scene,
    )
    numbers = moving.exploring_numbers(KEY, (SIZE,))
    explored = jax.vmap(moving.explore)(numbers, jnp.zeros(SIZE, bool))
    assert described(explored) == described(real.start)
    speed = jnp.abs(explored.qvel.reshape(SIZE, 2, 6)[..., :2])
    assert speed.max() > 1.0 and speed.max() <= 4.0


@pytest.mark.long
def test_numbers_fill_their_ranges_by_fight_and_side(real: SimpleNamespace):
    start = jax.vmap(real.combat.spawn)(real.combat.start_numbers(KEY, (500,)))
    for name in ("mass", "inertia", "thrust", "lag", "drag", "battery"):
        factor, share = (
            np.asarray(getattr(start.craft.drawn, name)),
            getattr(REAL.randomise, name),
        )
        assert factor.shape == (500, 2) and np.all(np.abs(factor - 1) <= share)
        assert factor.min() < 1 - 0.9 * share and factor.max() > 1 + 0.9 * share
        assert abs(np.corrcoef(factor.T)[0, 1]) < 0.15  # one side knows nothing of the other
    pairs = np.corrcoef(
        np.concatenate([np.asarray(x) for x in jax.tree.leaves(start.craft.drawn)], 1).T
    )
    assert np.abs(pairs - np.eye(12)).max() < 0.2
    assert len(np.unique(start.craft.word)) == 500


@pytest.mark.long
def test_commands_keep_the_nominal_scale():
    """Trap: the action that hovers the nominal drone lets a heavier one sink, (1/k - 1) g."""
    combat = Combat(Config(randomise=RandomiseConfig(mass=0.3)))
    start = jax.vmap(combat.spawn)(combat.start_numbers(KEY, (SIZE,)))
    hover = jnp.zeros((SIZE, 2, 4)).at[..., 0].set(2 / 1.9 - 1)
    after, _ = jax.jit(jax.vmap(combat.step))(start, hover)
    climb = after.qvel.reshape(SIZE, 2, 6)[..., 2]
    np.testing.assert_allclose(climb, 0.02 * 9.81 * (1 / drawn_in(start).mass - 1), atol=1e-5)


def test_one_sides_drone_may_differ_in_every_fight(arena: SimpleNamespace, real: SimpleNamespace):
    """Factors alone; random numbers lie around them. Fights start in the same places."""
    heavy = replace(Config(), defender=DroneConfig(mass=1.5), attacker=DroneConfig(thrust=0.5))
    combat = Combat(heavy, arena.combat.scene)
    start = jax.vmap(combat.spawn)(combat.start_numbers(KEY, (SIZE,)))
    exact = jax.vmap(arena.combat.spawn)(arena.combat.start_numbers(KEY, (SIZE,)))
    np.testing.assert_array_equal(start.qpos, exact.qpos)
    np.testing.assert_array_equal(drawn_in(start).mass, [[1.5, 1.0]] * SIZE)
    np.testing.assert_array_equal(drawn_in(start).thrust, [[1.0, 0.5]] * SIZE)
    both = Combat(replace(REAL, defender=DroneConfig(mass=2.0, drag=0.0)), real.combat.scene)
    other = jax.vmap(both.spawn)(both.start_numbers(KEY, (SIZE,)))
    np.testing.assert_array_equal(other.qpos, exact.qpos)
    expected = np.asarray(drawn_in(real.start).mass) * [2.0, 1.0]
    np.testing.assert_allclose(drawn_in(other).mass, expected, rtol=1e-6)
    assert not np.any(np.asarray(drawn_in(other).drag)[:, 0])


@pytest.mark.long
def test_a_scaled_inertia_turns_less(real: SimpleNamespace):
    """From rest, a moment m gives h m / (k I) in each of two substeps; products of rates are small."""
    combat = Combat(Config(randomise=RandomiseConfig(inertia=0.5)))
    start = jax.vmap(combat.spawn)(combat.start_numbers(KEY, (SIZE,)))
    action = jnp.zeros((SIZE, 2, 4)).at[..., 2].set(0.3)
    after, _ = jax.jit(jax.vmap(combat.step))(start, action)
    rate = after.qvel.reshape(SIZE, 2, 6)[..., 4]
    wanted = 0.02 * 0.003 / (2.1320e-5 * drawn_in(start).inertia)
    np.testing.assert_allclose(rate, wanted, rtol=1e-5)


@pytest.mark.long
def test_a_fight_is_repeated_and_does_not_depend_on_its_neighbours(real: SimpleNamespace):
    random = np.random.default_rng(4)
    forwards = backwards = real.start
    flip = lambda tree: jax.tree.map(lambda leaf: leaf[::-1], tree)
    for _ in range(5):
        action = random.uniform(-1, 1, (SIZE, 2, 4)).astype(np.float32)
        forwards, _ = real.step(forwards, action)
        backwards = flip(real.step(flip(backwards), action[::-1])[0])
    jax.tree.map(np.testing.assert_array_equal, forwards, backwards)
    assert np.ptp(np.asarray(forwards.craft.wind)) > 0.1


@pytest.mark.long
def test_a_broken_action_loses_and_leaves_rotors_finite(real: SimpleNamespace):
    action = jnp.zeros((SIZE, 2, 4)).at[0, 0, 1].set(jnp.nan)
    after, output = real.step(real.start, action)
    assert int(output.cause[0]) == Cause.DEFENDER_INVALID
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(after))


def test_gusts_have_their_deviation_and_memory():
    """An Ornstein-Uhlenbeck process: deviation 2 m/s, correlation exp(-0.1 / 0.5) after 0.1 s."""
    from dronecombat_jax.sim.craft import _gust
    from dronecombat_jax.types import Craft

    sim = SimConfig(gust_speed=2.0, gust_time=0.5)

    def path(word: jax.Array) -> jax.Array:
        step = lambda craft, clock: (_gust(sim, craft, clock),) * 2
        return jax.lax.scan(step, Craft(wind=jnp.zeros(3), word=word), jnp.arange(400))[1].wind

    wind = np.asarray(jax.jit(jax.vmap(path))(jnp.arange(256, dtype=jnp.uint32)))[:, 150:]
    np.testing.assert_allclose(wind.std(axis=(0, 1)), 2.0, rtol=0.08)
    np.testing.assert_allclose(wind.mean(axis=(0, 1)), 0.0, atol=0.2)
    kept = np.mean(wind[:, 5:] * wind[:, :-5]) / np.mean(wind**2)
    assert kept == pytest.approx(np.exp(-0.2), abs=0.05)


def test_hashed_numbers_are_normal_and_independent():
    words, clocks = jnp.arange(200, dtype=jnp.uint32), jnp.arange(50)
    hashed = lambda stream: jax.vmap(
        lambda word: jax.vmap(lambda clock: noise.normals(word, clock, stream, 6))(clocks)
    )(words)
    numbers, others = np.asarray(hashed(noise.NOISE)), np.asarray(hashed(noise.BIAS))
    assert abs(numbers.mean()) < 0.02 and abs(numbers.std() - 1) < 0.02
    assert abs(np.mean(numbers**4) - 3) < 0.15 and np.abs(numbers).max() < 6
    for one, two in (
        (numbers[1:], numbers[:-1]),
        (numbers[:, 1:], numbers[:, :-1]),
        (numbers[..., 1:], numbers[..., :-1]),
        (numbers, others),
    ):
        assert abs(np.mean(one * two)) < 0.02


@pytest.mark.parametrize("actuation", ["rotors", "mixed", "ctbr"])
@pytest.mark.long
def test_the_hover_pilot_holds_a_place_on_rotors(actuation: str):
    config = Config(sim=SimConfig(body="firmware", actuation=actuation))  # pyright: ignore
    combat = Combat(config)
    pilot = scripted.build_pilot("hover", config, combat.scene, DEFENDER)
    start = jax.vmap(combat.spawn)(combat.start_numbers(KEY, (2,)))
    start = start.replace(qvel=start.qvel.at[:, 3:6].set(jnp.asarray([3.0, -2.0, 1.0])))

    def step(state, _):
        action = pilot(state, jnp.zeros((2, 2, 35)), KEY)
        state, _ = jax.vmap(combat.step)(state, jnp.stack([action, action], axis=1))
        return state, state.qpos[:, :7]

    path = np.asarray(jax.jit(lambda s: jax.lax.scan(step, s, None, 150)[1])(start))
    away = np.linalg.norm(path[..., :3] - np.asarray(start.qpos)[:, :3], axis=-1)
    assert away.max() < 0.5 and away[-1].max() < 0.1

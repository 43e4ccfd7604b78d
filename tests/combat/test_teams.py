"""Teams: who goes down and who wins, what it is worth, where they start, and that team mates are
alike.
"""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.observe import Observation, layout_of
from dronecombat_jax.combat.reward import reward_terms
from dronecombat_jax.combat.rules import Events, detect, forfeit, judge, struck_out
from dronecombat_jax.combat.starts import apart, start_positions
from dronecombat_jax.combat.team_views import ego_order, world_order
from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, GameConfig, RewardConfig
from dronecombat_jax.config.sides import sides_of
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import Cause, Drones

NONE, INTERCEPT, REACHED, DEFENDER_CRASH, ATTACKER_CRASH, BOTH_CRASH, TIMEOUT, *_ = Cause
TARGET = np.array([5.0, 5.0, 1.0], np.float32)
D1, D2, A1, A2 = (0, 5, 1), (2, 5, 1), (0, 0, 1), (2, 0, 1)  # nobody near anybody
TWO = GameConfig(defenders=2, attackers=2)


class Step(NamedTuple):
    """Where four drones are after a step, the cause under `ends` and `out`, and who was struck."""

    name: str
    places: tuple
    ends: Cause
    out: Cause
    struck: str = ""  # of "12", the attackers
    down: str = ""  # before the step, of "abcd": both defenders, both attackers
    clock: int = 7


STEPS = [
    Step("nothing", (D1, D2, A1, A2), NONE, NONE),
    Step("one attacker is taken out", (D1, D2, (0, 4.7, 1), A2), NONE, NONE, "1"),
    Step("the last one is taken out", (D1, D2, A1, (2, 4.7, 1)), INTERCEPT, INTERCEPT, "2", "c"),
    Step("one defender takes both", (D1, D2, (0, 4.7, 1), (0, 5.3, 1)), INTERCEPT, INTERCEPT, "12"),
    Step("one is taken, one crashes", (D1, D2, (0, 4.7, 1), (2, 0, 0)), INTERCEPT, INTERCEPT, "1"),
    Step("one is taken, one reaches", (D1, D2, (0, 4.7, 1), (5, 5, 1)), REACHED, REACHED, "1"),
    Step("taken at the target", ((5, 5, 1), D2, (5, 4.8, 1), A2), NONE, NONE, "1"),
    Step("one reaches", (D1, D2, A1, (5, 4.8, 1)), REACHED, REACHED),
    Step("one attacker crashes", (D1, D2, A1, (2, 0, 0)), NONE, NONE),
    Step("the last crashes", (D1, D2, A1, (2, 0, 0)), ATTACKER_CRASH, ATTACKER_CRASH, "", "c"),
    Step("both attackers crash", (D1, D2, (0, 0, 0), (2, 0, 0)), ATTACKER_CRASH, ATTACKER_CRASH),
    Step("one defender crashes", ((0, 5, 0), D2, A1, A2), NONE, NONE),
    Step("the last defender crashes", (D1, (2, 5, 0), A1, A2), DEFENDER_CRASH, NONE, "", "a"),
    Step("all crash", ((0, 5, 0), (2, 5, 0), (0, 0, 0), (2, 0, 0)), BOTH_CRASH, BOTH_CRASH),
    Step("a downed defender strikes nobody", (D1, D2, (0, 4.7, 1), A2), NONE, NONE, "", "a"),
    Step("a downed attacker reaches nothing", (D1, D2, (5, 5, 1), A2), NONE, NONE, "", "c"),
    Step("time is up", (D1, D2, A1, A2), TIMEOUT, TIMEOUT, clock=500),
]


def events_of(step: Step, game: GameConfig) -> Events:
    down = np.array([letter in step.down for letter in "abcd"])
    after = np.array(step.places, np.float32)
    before = after.copy()
    before[:, 2] = np.maximum(before[:, 2], 0.5)  # a crash is of this step
    return detect(game, before, after, TARGET, down, np.int32(step.clock))


@pytest.mark.parametrize("step", STEPS, ids=[step.name for step in STEPS])
def test_who_goes_down_and_what_ends_the_fight(step: Step):
    events = events_of(step, TWO)
    taken = [letter in step.struck for letter in "12"]
    assert struck_out(TWO, events).tolist() == [False, False, *taken]
    for rule, cause in (("ends", step.ends), ("out", step.out)):
        game = replace(TWO, crash_rule=rule)
        assert Cause(int(judge(game, events))) == cause


def test_a_striker_goes_down_with_what_it_strikes_where_it_is_so_set():
    """Then the last defender's strike leaves the other attacker alone: `ends` ends it there."""
    kamikaze = replace(TWO, striker_down=True)
    step = Step("", (D1, D2, (2, 4.7, 1), A2), DEFENDER_CRASH, NONE, "1", "a")
    events = events_of(step, kamikaze)
    assert struck_out(kamikaze, events).tolist() == [False, True, True, False]
    assert Cause(int(judge(kamikaze, events))) == DEFENDER_CRASH
    assert Cause(int(judge(replace(kamikaze, crash_rule="out"), events))) == NONE


def test_one_invalid_action_loses_for_its_side():
    sides = sides_of(2, 2)
    lost = lambda *invalid: Cause(int(forfeit(np.array(invalid), sides))).name
    assert lost(False, False, False, False) == "NONE"
    assert lost(False, True, False, False) == "DEFENDER_INVALID"
    assert lost(False, False, True, False) == "ATTACKER_INVALID"
    assert lost(True, False, False, True) == "BOTH_INVALID"


def terms_of(step: Step, cause: Cause, game: GameConfig = TWO, **weights: float):
    config = Config(game=game, reward=RewardConfig(**weights))
    events = events_of(step, game)
    down = np.array([letter in step.down for letter in "abcd"])
    still = np.zeros((4, 3), np.float32)
    level = np.tile(np.array([1, 0, 0, 0], np.float32), (4, 1))
    drones = Drones(np.array(step.places, np.float32), level, still, still)
    return reward_terms(config, drones, TARGET, events, down, np.int32(cause))


def test_a_strike_pays_the_striker_and_a_share_of_it_its_team_mates():
    step = STEPS[1]  # the first defender takes out the first attacker
    terms = terms_of(step, NONE)
    assert terms.win.tolist() == [300, 150, 0, 0] and terms.lose.tolist() == [0, 0, -300, -150]
    alone = terms_of(step, NONE, team_share=0.0)
    assert alone.win.tolist() == [300, 0, 0, 0] and alone.lose.tolist() == [0, 0, -300, 0]
    together = terms_of(step, NONE, team_share=1.0)
    assert together.win.tolist() == [300, 300, 0, 0]
    assert together.lose.tolist() == [0, 0, -300, -300]


def test_strikes_of_one_step_add_up():
    each = Step("each takes one", (D1, D2, (0, 4.7, 1), (2, 4.7, 1)), INTERCEPT, INTERCEPT)
    assert terms_of(each, INTERCEPT).win.tolist() == [450, 450, 0, 0]
    assert terms_of(each, INTERCEPT).lose.tolist() == [0, 0, -450, -450]
    both = terms_of(STEPS[3], INTERCEPT)  # the first takes both
    assert both.win.tolist() == [600, 300, 0, 0]


def test_target_and_time_concern_the_whole_side():
    reached = terms_of(STEPS[7], REACHED)
    assert reached.win.tolist() == [0, 0, 300, 300] and reached.lose.tolist() == [-300, -300, 0, 0]
    late = terms_of(STEPS[-1], TIMEOUT, replace(TWO, timeout_rule="defender"))
    assert late.timeout.tolist() == [300, 300, -300, -300]
    crash = terms_of(STEPS[8], NONE)  # a crash is its own affair
    assert crash.crash.tolist() == [0, 0, 0, -10] and not np.any(crash.win)


def test_a_defender_approaches_the_nearest_attacker_that_flies():
    """1 - tanh(|way| / 5) times 50 dt: ways by hand, the attacker at 3 m being down."""
    step = Step("", ((0, 5, 1), (0, 1, 1), (0, 2, 1), (0, -3, 1)), NONE, NONE, "", "c")
    approach = terms_of(step, NONE).approach
    ways = np.array([8.0, 4.0, np.hypot(5, 3), np.hypot(5, 8)])
    wanted = 1.0 - np.tanh(ways / 5.0)
    wanted[2] = 0.0  # it lies there
    np.testing.assert_allclose(approach, wanted, rtol=1e-5)


def test_team_mates_start_in_a_row_and_never_inside_each_other():
    random, game = np.random.default_rng(0), GameConfig(defenders=3, attackers=2, spawn_spread=1.0)
    numbers = random.uniform(size=(500, 6, 3)).astype(np.float32)
    places = np.asarray(jax.vmap(lambda each: start_positions(game, each))(numbers))
    for team in (slice(0, 3), slice(3, 5)):
        assert np.diff(np.sort(places[:, team, 0], axis=1), axis=1).min() > 0.5 - 1e-5
    assert np.abs(places[:, :3, 1] - 5).max() <= 1 and np.abs(places[:, 3:5, 1]).max() <= 1
    assert places[..., 2].min() >= 0.5 and places[..., 2].max() <= 1.5
    middle = jnp.full((6, 3), 0.5)
    row = start_positions(replace(game, spawn_spread=0.0), middle)
    assert row[:, 0].tolist() == [-0.5, 0, 0.5, -0.25, 0.25, 5] and set(row[:3, 1].tolist()) == {5}


def test_apart_moves_only_who_is_too_near():
    assert apart(jnp.array([3.0, 0.0, 0.2, 1.0]), 0.5).tolist() == [3.0, 0.0, 0.5, 1.0]
    assert apart(jnp.zeros(3), 0.5).tolist() == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("name", ["world", "ego", "engagement", "tracks", "nearest", "bearing"])
def test_permuting_team_mates_permutes_observations_and_nothing_else(name: str):
    """The rows change places; in a row, drones change the places that they stand in."""
    game, random = GameConfig(defenders=3, attackers=2), np.random.default_rng(1)
    observation = layout_of(name, game)
    place, velocity, rate = random.normal(size=(3, 5, 3))
    axis = random.normal(size=(5, 4))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    drones = Drones(*(np.float32(field) for field in (place, axis, velocity, rate)))
    swap = np.array([2, 0, 1, 4, 3])
    before = np.asarray(observation.observe(drones, TARGET))
    after = observation.observe(Drones(*(field[swap] for field in drones)), TARGET)
    for row, was in enumerate(swap):
        np.testing.assert_allclose(
            parts(name, game, after[row], row, lambda drone: swap[drone]),
            parts(name, game, before[was], was, lambda drone: drone),
            atol=1e-6,
        )


def parts(name: str, game: GameConfig, row, observer: int, original) -> np.ndarray:
    """The row with the parts of each drone in the order of the drones' original numbers."""
    if name == "nearest":  # by distance, whoever it is
        return np.asarray(row)
    orders = {"world": world_order}
    order = orders.get(name, ego_order)(game.sides)[observer]
    places = np.argsort([original(drone) for drone in order])
    fields = layout_of(name, game).fields
    ends = np.cumsum([length for _, length in fields])
    pieces = dict(
        zip([field for field, _ in fields], np.split(np.asarray(row), ends[:-1]), strict=True)
    )
    names = list(
        dict.fromkeys(field.split("_")[1] for field in pieces if field[:2] in ("p_", "d_"))
    )
    names.remove("t")
    ranked = [names[place] for place in places]
    kinds = list(dict.fromkeys(field.split("_")[0] for field in pieces))
    flat = [pieces.get(f"{kind}_{who}", np.zeros(0)) for kind in kinds for who in ranked]
    return np.concatenate([*flat, pieces["p_t"]])


def test_permuting_team_mates_permutes_a_step_of_the_game():
    combat = Combat(Config(game=replace(TWO, attackers=3)))
    swap, random = np.array([1, 0, 4, 2, 3]), np.random.default_rng(2)
    step, state = jax.jit(combat.step), jax.jit(combat.reset)(jax.random.key(5))
    action = random.uniform(-1, 1, (5, 4)).astype(np.float32)
    state = state.replace(qpos=state.qpos.at[7 * 3 : 7 * 3 + 3].set(state.qpos[:3] - 0.1))  # struck
    swapped = state.replace(
        qpos=state.qpos.reshape(5, 7)[swap].reshape(-1),
        qvel=state.qvel.reshape(5, 6)[swap].reshape(-1),
    )
    after, output = step(state, action)
    other, others = step(swapped, action[swap])
    assert output.reward.shape == (5,) and np.any(after.struck)
    np.testing.assert_allclose(output.reward[swap], others.reward, rtol=1e-5)
    np.testing.assert_allclose(after.qpos.reshape(5, 7)[swap], other.qpos.reshape(5, 7), atol=1e-6)
    np.testing.assert_array_equal(after.down[swap], other.down)
    np.testing.assert_array_equal(after.struck[swap], other.struck)
    assert output.cause == others.cause and after.clock == other.clock


def test_what_cannot_be_is_one_line():
    with pytest.raises(UserError, match=r"crash_rule = grounded .* not 2 against 1: ends or out"):
        settings.load("smoke", {"game.defenders": 2, "game.crash_rule": "grounded"})
    with pytest.raises(UserError, match=r"--game\.attackers 9: must be an integer from 1 to 8"):
        settings.load("smoke", {"game.attackers": 9})


def row_of_two(drones: Drones, target: jax.Array) -> jax.Array:
    return jnp.zeros((2, 3))


OWN = Observation((("x", 3),), row_of_two)


def test_what_is_made_for_other_numbers_of_drones_is_one_line():
    duel = Combat(Config())
    with pytest.raises(UserError, match=r"^the scene is made for 1 against 1 drones, and the game"):
        Combat(Config(game=TWO), duel.scene)
    own = replace(TWO, observation=f"{__name__}:OWN")
    with pytest.raises(UserError, match=r"OWN gives \[2, 3\] numbers for 2 against 2 drones, not"):
        Combat(Config(game=own))

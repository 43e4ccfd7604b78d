"""The Gymnasium views: each step is the core's own, in every autoreset mode, and Gymnasium's own
checker passes.
"""

import re
import warnings

import jax
import numpy as np
import pytest
from brax_views import LENGTH, hold, wander
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from side_views import Core, compare
from toy import UNOPTIMISED, Coasting

from dronecombat_jax.adapters.gymnasium_env import CombatEnv, CombatVectorEnv
from dronecombat_jax.adapters.opponents import pilots_of
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.scripted import PILOTS, build_pilot
from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, GameConfig, TrainConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause

SIZE = 6
MODES = ["SAME_STEP", "NEXT_STEP"]


def coasting(**game) -> Combat:
    return Coasting(Config(game=GameConfig(**{"episode_steps": LENGTH} | game)))


@pytest.fixture(scope="module")
def duel() -> Combat:
    return coasting()


def actions(steps: int, size: int = SIZE, spread: float = 1.0, lift: float = 0.5) -> np.ndarray:
    """Half of the fights wander until they crash, half coast until time runs out."""
    drawn = np.random.default_rng(3).normal(scale=spread, size=(steps, size, 4)).astype(np.float32)
    drawn[:, ::2] = [lift, 0.0, 0.0, 0.0]
    return drawn


def until_an_end(env, plan: np.ndarray) -> tuple:
    """The action after which a fight of `env` was over, and what that step gave."""
    for action in plan:
        flown = env.step(action)
        if np.any(flown[2] | flown[3]):
            return action, flown
    raise AssertionError("no fight ended")


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("role", [DEFENDER, ATTACKER])
@pytest.mark.long
def test_each_step_is_the_cores(duel: Combat, role: int, mode: str):
    env = CombatVectorEnv(duel, role, hold, SIZE, mode)
    count = compare(env, Core(duel, role, hold, UNOPTIMISED), actions(3 * LENGTH))
    assert count.terminated > 3 and count.truncated >= SIZE


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("role", [DEFENDER, ATTACKER])
def test_each_step_of_1000_fights_is_the_cores(role: int, mode: str):
    combat = Combat(Config(game=GameConfig(episode_steps=40, spawn="uniform")))
    name = ("dash", "hover_guard")[role]
    pilot = build_pilot(name, combat.config, combat.scene)
    env = CombatVectorEnv(combat, role, f"scripted:{name}", 1000, mode)
    count = compare(env, Core(combat, role, pilot), actions(90, 1000, 0.3, 0.0526))
    assert count.terminated > 500 and count.truncated > 100
    assert {Cause.INTERCEPT, Cause.TIMEOUT, (Cause.DEFENDER_CRASH, Cause.ATTACKER_CRASH)[role]} <= (
        count.causes
    )


@pytest.mark.long
def test_the_opponent_draws_by_each_fights_own_key(duel: Combat):
    env = CombatVectorEnv(duel, ATTACKER, wander, SIZE)
    env.reset(seed=1)
    step = jax.jit(jax.vmap(duel.step), compiler_options=UNOPTIMISED)
    for action in actions(3):
        bout, pair = env.bout, np.stack([action, action], axis=1)
        for i in range(SIZE):
            fight = jax.tree.map(lambda leaf, i=i: leaf[i : i + 1], bout.fight)
            key = jax.random.split(bout.key[i])[1]
            pair[i, DEFENDER] = wander(fight, jax.vmap(duel.observe)(fight), key)[0]
        _, output = step(bout.fight, pair)
        np.testing.assert_allclose(env.step(action)[0], output.observation[:, ATTACKER], atol=1e-5)


@pytest.mark.parametrize("mode", [*MODES, "DISABLED"])
@pytest.mark.long
def test_the_fights_of_a_seed_are_the_same_in_every_mode_and_number(duel: Combat, mode: str):
    """Fight 0 of SAME_STEP with SIZE fights is that of one fight alone in any other mode."""
    first = CombatVectorEnv(duel, ATTACKER, wander, SIZE, "SAME_STEP")
    other = CombatVectorEnv(duel, ATTACKER, wander, 1, mode)
    push = np.tile(np.float32([0.7, 0.1, -0.2, 0.0]), (SIZE, 1))

    def starts(env) -> list[np.ndarray]:
        seen, over = [env.reset(seed=9)[0][0]], False
        while len(seen) < 4:
            begin = over and env.autoreset_mode is AutoresetMode.DISABLED
            if begin:
                seen.append(env.reset(options={"reset_mask": np.ones(1, bool)})[0][0])
            observation, _, terminated, truncated, _ = env.step(push[: env.num_envs])
            ended = bool(terminated[0] | truncated[0])
            if ended if env.autoreset_mode is AutoresetMode.SAME_STEP else over and not begin:
                seen.append(observation[0])
            over = ended
        return seen

    np.testing.assert_allclose(starts(first)[:4], starts(other)[:4], rtol=1e-6)
    assert len({float(start[2]) for start in starts(first)}) == 4


def test_seeds(duel: Combat):
    env = CombatVectorEnv(duel, ATTACKER, hold, SIZE)
    first = env.reset(seed=1)[0]
    np.testing.assert_array_equal(env.reset(seed=1)[0], first)
    drawn = [first, env.reset(seed=2)[0], env.reset()[0], env.reset()[0], env.reset(seed=2**70)[0]]
    assert len({row.tobytes() for batch in drawn for row in batch}) == 5 * SIZE
    listed = env.reset(seed=[1, 2, 1, 3, 4, 5])[0]
    np.testing.assert_array_equal(listed[[0, 2]], first[[0, 0]])
    assert len({row.tobytes() for row in listed}) == SIZE - 1


def test_a_masked_reset_begins_only_those_fights(duel: Combat):
    env = CombatVectorEnv(duel, ATTACKER, hold, SIZE, "DISABLED")
    env.reset(seed=1)
    action, (observation, _, terminated, truncated, _) = until_an_end(env, actions(LENGTH))
    mask = terminated | truncated
    assert 0 < mask.sum() < SIZE
    with pytest.raises(UserError, match=r"over: reset them"):
        env.step(action)
    begun = env.reset(options={"reset_mask": mask})[0]
    np.testing.assert_array_equal(begun[~mask], observation[~mask])
    np.testing.assert_array_equal(np.asarray(env.bout.fight.clock) == 0, mask)
    assert np.any(begun[mask] != observation[mask], axis=1).all()
    env.step(action)


def test_an_opponent_is_drawn_for_each_fight(duel: Combat):
    left = lambda state, observation, key: hold(state, observation, key).at[:, 1].set(0.3)
    right = lambda state, observation, key: hold(state, observation, key).at[:, 1].set(-0.3)
    env = CombatVectorEnv(duel, ATTACKER, [left, right], 64, "SAME_STEP")
    env.reset(seed=0)
    seen = []
    for _ in range(2 * LENGTH):
        who, clock = np.asarray(env.bout.opponent), np.asarray(env.bout.fight.clock)
        env.step(np.tile(np.float32([0.5, 0, 0, 0]), (64, 1)))
        flown = np.asarray(env.bout.fight.clock) == clock + 1
        pushed = np.asarray(env.bout.fight.qvel)[:, 0]
        np.testing.assert_array_equal(np.sign(pushed)[flown], np.where(who == 0, 1, -1)[flown])
        seen.append(who)
    assert 0.3 < np.mean(seen[0]) < 0.7 and 0.3 < np.mean(seen[-1]) < 0.7
    assert np.any(seen[0] != seen[-1])


@pytest.mark.long
def test_opponents_are_named_as_in_a_tournament():
    combat = Coasting(settings.load("duel", {}))
    named = ["pilots:sippo-defender", "scripted:hover", "scripted:all"]
    env = CombatVectorEnv(combat, "attacker", named, 4)
    assert len(pilots_of(combat, ATTACKER, named)) == 2 + len(PILOTS[DEFENDER])
    env.reset(seed=0)
    assert np.isfinite(env.step(np.zeros((4, 4)))[0]).all()


@pytest.mark.long
def test_exploring_fights_begin_in_motion():
    combat = Coasting(Config(game=GameConfig(episode_steps=3), train=TrainConfig(start_speed=4.0)))
    push = np.tile(np.float32([0.5, 0, 0, 0]), (64, 1))
    for exploring in (False, True):
        env = CombatVectorEnv(combat, ATTACKER, hold, 64, "SAME_STEP", exploring)
        env.reset(seed=0)
        starts = [np.asarray(env.bout.fight.qvel)]
        for _ in range(3):
            env.step(push)
        starts.append(np.asarray(env.bout.fight.qvel))
        assert np.all(env.bout.fight.clock == 0)
        for start in starts:
            fastest = np.abs(start).max(axis=0).reshape(2, 6)
            assert not np.any(fastest[:, 2:])
            assert np.all((fastest[:, :2] > 3.0) & (fastest[:, :2] <= 4.0)) == exploring


def test_what_is_given_out_is_nobody_elses(duel: Combat):
    env = CombatVectorEnv(duel, ATTACKER, hold, SIZE)
    kept = env.reset(seed=1)[0]
    copy = kept.copy()
    action = actions(2)[1]
    before = action.copy()
    out = env.step(action)[:4]
    kept_out = [array.copy() for array in out]
    env.step(action)
    np.testing.assert_array_equal(kept, copy)
    np.testing.assert_array_equal(action, before)
    for array, was in zip(out, kept_out, strict=True):
        np.testing.assert_array_equal(array, was)
        array[:] = 0  # may be written to


def test_gymnasiums_own_checker_passes(duel: Combat):
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        check_env(CombatEnv(duel, ATTACKER, hold), skip_render_check=True)
    unbounded = "A Box observation space m..imum value is -?infinity"
    texts = [str(one.message) for one in told]
    assert [text for text in texts if not re.search(unbounded, text)] == []


def test_one_fight_is_fight_0_with_pythons_own_values(duel: Combat):
    one, many = (
        CombatEnv(duel, ATTACKER, wander),
        CombatVectorEnv(duel, ATTACKER, wander, SIZE, "DISABLED"),
    )
    np.testing.assert_array_equal(one.reset(seed=4)[0], many.reset(seed=4)[0][0])
    action = np.float32([0.9, 0.2, 0.1, 0.0])
    for _ in range(LENGTH):
        observation, reward, terminated, truncated, info = one.step(action)
        batch = many.step(np.tile(action, (SIZE, 1)))
        np.testing.assert_allclose(observation, batch[0][0], rtol=1e-6)
        assert type(reward) is float and type(terminated) is bool and type(truncated) is bool
        assert reward == pytest.approx(float(batch[1][0]), rel=1e-5)
        assert (terminated, truncated) == (bool(batch[2][0]), bool(batch[3][0]))
        if terminated or truncated:
            assert info["cause"] in list(Cause) and info["outcome"] in (-1, 0, 1)
            assert info["is_success"] is (info["outcome"] == 1)
            break
        assert info == {}
    else:
        raise AssertionError("no end")
    with pytest.raises(UserError, match=r"over: call reset\(\)"):
        one.step(action)
    assert one.reset()[0][9] != observation[9]


def test_an_end_tells_its_outcome_for_that_side(duel: Combat):
    for role, expected in ((DEFENDER, -1), (ATTACKER, 1)):
        env = CombatVectorEnv(duel, role, hold, 1, "DISABLED")
        env.reset(seed=0)
        bout = env.bout
        there = bout.fight.qpos.at[:, 7:10].set(bout.fight.target)
        env._bout = bout.replace(fight=bout.fight.replace(qpos=there))
        infos = env.step(np.zeros((1, 4)))[4]
        assert infos["cause"].tolist() == [Cause.REACHED]
        assert infos["outcome"].tolist() == [expected]
        assert infos["is_success"].tolist() == [expected == 1]


def test_a_fight_is_shown(duel: Combat, capsys: pytest.CaptureFixture):
    env = CombatEnv(duel, ATTACKER, hold, render_mode="ansi")
    env.reset(seed=0)
    assert env.render().startswith("0.00 s: defender at 0.0 5.0 ")
    env = CombatEnv(duel, ATTACKER, hold, render_mode="human")
    env.reset(seed=0)
    assert env.render() is None and "attacker at 0.0 0.0 " in capsys.readouterr().out
    assert CombatEnv(duel, ATTACKER, hold).render_mode is None


def test_the_time_limit_is_the_games(duel: Combat):
    assert CombatEnv(duel, ATTACKER, hold).time_limit == LENGTH
    assert CombatEnv(coasting(timeout_rule="defender"), ATTACKER, hold).time_limit is None


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda duel: CombatVectorEnv(duel, "judge", hold), "role judge: there are 0"),
        (lambda duel: CombatVectorEnv(duel, 2, hold), "role 2: there are 0"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER), "duel needs an opponent"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER, []), "needs an opponent"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER, hold, 0), "num_envs = 0"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER, hold, 2, "later"), "NEXT_STEP, SAME_STEP"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER, "scripted:dash"), "names no defender"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER, "scripted:fly"), "no scripted pilot"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER, "pilots:sippo-defender"), "another game"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER, hold).step(np.zeros((1, 4))), "call reset"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER, hold).step(np.zeros(4)), r"\(1, 4\) is"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER, hold).reset(seed=-1), "seed = -1"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER, hold, 3).reset(seed=[1]), "1 seeds for 3"),
        (lambda duel: CombatVectorEnv(duel, ATTACKER, hold).reset(seed=[None]), "needs a seed"),
        (lambda duel: CombatEnv(duel, ATTACKER, hold, "film"), "render_mode = film"),
        (
            lambda duel: CombatVectorEnv(duel, ATTACKER, hold).reset(
                options={"reset_mask": np.zeros(1, bool)}
            ),
            "with a True in it",
        ),
        (lambda _: CombatEnv(coasting(scenario="solo"), DEFENDER), "defender is absent"),
        (lambda _: CombatEnv(coasting(scenario="solo"), ATTACKER, hold), "takes no opponent"),
    ],
)
def test_what_cannot_be_is_one_line(duel: Combat, wrong, words: str):
    with pytest.raises(UserError, match=words) as caught:
        wrong(duel)
    assert "\n" not in caught.value.message

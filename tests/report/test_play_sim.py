"""The play page's JavaScript flies, sees, steers and judges as the package does."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from browser import Tab, chromium
from drones import BIG, write
from golden_flights import CODE, as_json, in_node, numbers
from policies import SIZES, make_policy

from dronecombat_jax.combat.autopilot import airframe, attainable, steer
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.rules import detect, judge
from dronecombat_jax.combat.scripted import PILOTS, build_pilot
from dronecombat_jax.config.fields import Config, GameConfig, LearnConfig, SimConfig
from dronecombat_jax.learn.rollout import policy_mean
from dronecombat_jax.report.play_data import Opponent, game_data, opponent_data
from dronecombat_jax.report.play_page import page
from dronecombat_jax.sim.flight import split
from dronecombat_jax.types import SIDES, EnvState

pytestmark = pytest.mark.tour
HOVER = 2.0 / 1.9 - 1.0  # thrust is the weight there (eq. 7)
STEPS = 12
TWISTS = tuple(slice(first, first + 3) for first in range(14, 26, 3))


def combat_of(sim: SimConfig) -> SimpleNamespace:
    """The game with the body of `sim`, compiled, and as the page's data."""
    combat = Combat(replace(Config(), sim=sim))
    return SimpleNamespace(
        combat=combat,
        step=jax.jit(combat.step),
        data=game_data(combat.config, combat.scene),
    )


@pytest.fixture(scope="module")
def games(tmp_path_factory: pytest.TempPathFactory):
    """Each compiled once: the package's drone, MuJoCo's gyroscopic term, a drone of one's own."""
    file = write(tmp_path_factory.mktemp("mjcf"), BIG)
    settings = {
        "duel": SimConfig(),
        "explicit": SimConfig(gyroscopic="explicit"),
        # tilted principal axes, in air; its moments are a thousand times larger
        "own": SimConfig(mjcf=str(file), moment_scale=2.0, timestep=0.004, substeps=5),
    }
    return cache(lambda name: combat_of(settings[name]))


def start(seed: int = 0, rate: float = 0.0, speed: float = 0.0, height: float = 1.0) -> EnvState:
    """Drones that stand 5 m apart, or turn and fly anyhow."""
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=(2, 4)) if rate else np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    position = np.array([[0.0, 5.0, height], [0.0, 0.0, height]])
    twist = np.concatenate([rng.normal(size=(2, 3)) * speed, rng.normal(size=(2, 3)) * rate], 1)
    pose = np.concatenate([position, quaternion], axis=1)
    return EnvState(
        qpos=jnp.asarray(pose.ravel(), jnp.float32),
        qvel=jnp.asarray(twist.ravel(), jnp.float32),
        target=jnp.asarray([5.0, 5.0, 1.2]),
        clock=jnp.zeros((), jnp.int32),
        down=jnp.zeros(2, bool),
    )


def manoeuvre(name: str) -> tuple[EnvState, np.ndarray]:
    """A start and the actions [T, A, 4] from it."""
    held = lambda defender, attacker: np.tile([defender, attacker], (STEPS, 1, 1))
    hover, full, spin = [HOVER, 0.0, 0.0, 0.0], [3.0, 0.0, 0.0, 0.0], [0.0, 1.0, 1.0, 1.0]
    if name == "hover":
        return start(), held(hover, hover)
    if name == "full thrust":
        return start(), held(full, full)  # the game clips it
    if name == "tumbling":
        rng = np.random.default_rng(3)
        return start(1, rate=25.0, speed=4.0, height=3.0), rng.uniform(-1, 1, (STEPS, 2, 4))
    if name == "capped rate":
        return start(2, rate=60.0, height=3.0), held(spin, spin)
    assert name == "crash"
    return start(height=0.32), held([-1.0, 0.0, 0.0, 0.0], hover)


def flown(game: SimpleNamespace, state: EnvState, actions: np.ndarray) -> list[EnvState]:
    """The states after each step, up to the fight's end."""
    states = []
    for action in actions:
        state, out = game.step(state, jnp.asarray(action, jnp.float32))
        states.append(state)
        if out.cause:
            break
    return states


def row(state: EnvState) -> np.ndarray:
    return np.concatenate([state.qpos, state.qvel]).astype(float)


def one_by_one(game: SimpleNamespace, before: EnvState, actions: np.ndarray) -> dict[str, Any]:
    """A flight asked for as single steps, each from Python's state."""
    states = [before, *flown(game, before, actions)]
    flights = [{"start": as_json(state), "actions": [action.tolist()]}
               for state, action in zip(states[:-1], actions, strict=False)]  # fmt: skip
    return {"game": game.data, "flights": flights, "expected": states[1:]}


def largest_gap(asked: dict[str, Any], answered: dict[str, Any]) -> float:
    """The largest difference after a step: of a vector longer than 1 (m, m/s, rad/s) in shares of
    its length, since a float32 at 60 rad/s is known to 4e-6.
    """
    gaps = []
    for steps, expected in zip(answered["flown"], asked["expected"], strict=True):
        got, wanted = numbers(steps[0]), row(expected)
        for part in (slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 14), *TWISTS):
            length = max(1.0, float(np.linalg.norm(wanted[part])))
            gaps.append(np.abs(got[part] - wanted[part]).max() / length)
    return float(np.max(gaps))


def plain(asked: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in asked.items() if name != "expected"}


@pytest.mark.parametrize("body", ["duel", "explicit", "own"])
@pytest.mark.parametrize("name", ["hover", "full thrust", "tumbling", "capped rate", "crash"])
def test_a_step_agrees(games, body: str, name: str):
    game = games(body)
    asked = one_by_one(game, *manoeuvre(name))
    assert len(asked["expected"]) == STEPS or name == "crash"
    gap = largest_gap(asked, in_node(plain(asked)))
    print(f"{body}, {name}: {gap:.1e}")
    assert gap < 1e-5


def test_a_crash_ends_both_fights_in_the_same_step(games):
    game = games("duel")
    before, actions = manoeuvre("crash")
    expected = flown(game, before, actions)
    asked = {
        "game": game.data,
        "flights": [{"start": as_json(before), "actions": actions.tolist()}],
    }
    steps = in_node(asked)["flown"][0]
    causes = [step["cause"] for step in steps]
    assert 1 < len(expected) < STEPS and causes == [0] * (len(expected) - 1) + [3] * (
        STEPS - len(expected) + 1
    )
    assert steps[-1]["out"] == [True, False]
    np.testing.assert_allclose(numbers(steps[-1]), row(expected[-1]), atol=1e-5)
    assert np.all(numbers(steps[-1])[14:20] == 0.0)  # it lies there


def gentle(game: SimpleNamespace, steps: int = 200) -> tuple[EnvState, np.ndarray]:
    """Both drones fly circles at 1 m/s under the autopilot; the actions [T, A, 4] that it gave."""
    body = airframe(game.combat.config, game.combat.scene, 0)

    @jax.jit
    def act(state: EnvState) -> jax.Array:
        drones = split(state.qpos, state.qvel)
        phase = 2.0 * 0.02 * state.clock + jnp.asarray([0.0, 2.0])
        wanted = jnp.stack([jnp.cos(phase), jnp.sin(phase), 0.3 * jnp.sin(phase)], axis=-1)
        pull = 2.0 * (wanted - drones.velocity)
        force = attainable(body, drones.position[:, 2], drones.velocity[:, 2], pull)
        return steer(body, drones.quaternion, drones.rate, force)

    first, actions = start(height=1.5), []
    state = first
    for _ in range(steps):
        actions.append(act(state))
        state, _ = game.step(state, actions[-1])
    return first, np.array(actions)


def test_two_hundred_steps_of_gentle_flight_agree(games):
    game = games("duel")
    before, actions = gentle(game)
    expected = flown(game, before, actions)
    asked = {
        "game": game.data,
        "flights": [{"start": as_json(before), "actions": actions.tolist()}],
    }
    steps = in_node(asked)["flown"][0]
    assert len(expected) == len(steps) == 200 and steps[-1]["cause"] == 0
    places = lambda rows: np.array(rows)[:, [0, 1, 2, 7, 8, 9]].reshape(-1, 2, 3)
    gap = places([numbers(step) for step in steps]) - places([row(state) for state in expected])
    moved = np.ptp(places([row(state) for state in expected]), axis=0)
    worst = np.linalg.norm(gap, axis=-1).max()
    print(f"200 steps: {worst:.1e} m")
    assert worst < 1e-3 and (moved[:, :2] > 0.7).all()


def anyhow(count: int) -> list[EnvState]:
    """States of fights under way."""
    states = []
    for seed in range(count):
        rng = np.random.default_rng([9, seed])
        state = start(seed, rate=3.0, speed=3.0)
        place = np.array(state.qpos).reshape(2, 7)
        place[:, :3] = rng.uniform([-3, -3, 0.4], [3, 3, 2.5], (2, 3))
        states.append(state.replace(qpos=jnp.asarray(place.ravel()), clock=jnp.int32(7 * seed)))
    return states


@pytest.mark.parametrize("observation", ["world", "ego", "engagement", "tracks"])
@pytest.mark.parametrize("normalize", [True, False])
def test_observations_and_the_networks_actions_agree(observation: str, normalize: bool):
    config = Config(game=GameConfig(observation=observation))  # pyright: ignore
    combat, states = Combat(config), anyhow(20)
    policy = make_policy((combat.observation.size, *SIZES[1:]))
    learn = LearnConfig(normalize_observations=normalize)
    asked = {
        "game": game_data(config, combat.scene),
        "states": [as_json(state) for state in states],
        "pilots": [
            {"pilot": opponent_data(Opponent("", policy, learn)), "role": role} for role in range(2)
        ],
    }
    answered = in_node(asked)
    seen = np.array([combat.observe(state) for state in states])
    np.testing.assert_allclose(answered["observed"], seen, atol=2e-6)
    for role in range(2):
        wanted = np.array(
            policy_mean(learn, jax.tree.map(jnp.asarray, policy), jnp.asarray(seen[:, role]))
        )
        gap = np.abs(np.array(answered["acts"][role]) - wanted).max()
        print(f"{observation}, {SIDES[role]}, action: {gap:.1e}")
        assert gap < 1e-5 and 0.05 < np.abs(wanted).max() < 10.0


def test_scripted_pilots_agree(games):
    game, states = games("duel"), anyhow(30)
    config, scene = game.combat.config, game.combat.scene
    names = [(role, name) for role, pilots in PILOTS.items() for name in pilots]
    pilots = [{"pilot": {"label": name, "scripted": name}, "role": role} for role, name in names]
    asked = {"game": game.data, "states": [as_json(state) for state in states], "pilots": pilots}
    answered = in_node(asked)["acts"]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *states)
    for (role, name), acts in zip(names, answered, strict=True):
        wanted = build_pilot(name, config, scene, role)(batch, jnp.zeros(()), jax.random.key(0))
        # a weave's phase is 1000 rad per m of altitude, which a float32 knows to 1e-4 rad
        near = 2e-3 if name == "weave" else 1e-4
        np.testing.assert_allclose(acts, wanted, rtol=0.0, atol=near, err_msg=name)


@pytest.mark.parametrize("crash_rule", ["ends", "out", "grounded"])
@pytest.mark.parametrize("swept", [True, False])
def test_rules_agree(games, crash_rule: str, swept: bool):
    rules = GameConfig(crash_rule=crash_rule, swept_events=swept, episode_steps=90)  # pyright: ignore
    config, rng = Config(game=rules), np.random.default_rng(5)
    events = []
    for _ in range(400):
        before = rng.uniform([0, 0, 0.1], [1.2, 1.2, 0.8], (2, 3))
        after = before + rng.normal(size=(2, 3)) * 0.5
        events.append({
            "before": before.tolist(), "after": after.tolist(), "target": [0.9, 0.9, 0.5],
            "out": (rng.random(2) < 0.3).tolist(), "clock": int(rng.integers(80, 95)),
        })  # fmt: skip
    answered = in_node({"game": game_data(config, games("duel").combat.scene), "events": events})
    seen = set()
    for event, (cause, lying) in zip(events, answered["causes"], strict=True):
        before, after, target, down = (
            jnp.asarray(event[name]) for name in ("before", "after", "target", "out")
        )
        found = detect(rules, before, after, target, down, jnp.int32(event["clock"]))
        wanted = int(judge(rules, found))
        assert (cause, lying) == (wanted, np.asarray(found.down).tolist())
        seen.add(wanted)
    assert len(seen) > 3  # not one kind of end alone


def test_the_built_page_flies_the_same_in_a_browser(games, tmp_path: Path):
    game = games("duel")
    asked = one_by_one(game, *manoeuvre("tumbling"))
    opponents = [None, {"label": "dash", "scripted": "dash"}]
    data = {"title": "golden", "side": 0, "opponents": opponents, "game": game.data}
    path = tmp_path / "play.html"
    path.write_text(page(data))
    with chromium() as browser:
        tab = Tab(browser, path.as_uri(), (800, 600))
        code = CODE.read_text()
        answered = tab.page.evaluate(
            f"(asked) => {{ {code}\n return JSON.stringify(answer(dronecombatPlay.sim, asked)) }}",
            plain(asked),
        )
        tab.close()
    assert largest_gap(asked, json.loads(answered)) < 1e-5

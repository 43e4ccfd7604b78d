"""`dronecombat export` on a run of two seeds and two checkpoints that nobody trained."""

import hashlib
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import jax
import numpy as np
import pytest
from policies import observations

from dronecombat_jax.arena.match import policy_pilot
from dronecombat_jax.cli import commands as cli
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.fingerprint import environment, environment_digest
from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, GameConfig, LearnConfig, TrainConfig
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.files import checkpoint
from dronecombat_jax.learn.rollout import policy_mean, policy_of
from dronecombat_jax.policies.file import load_policy, require_environment
from dronecombat_jax.policies.numpy_policy import NumpyPolicy
from dronecombat_jax.runs.evaluation import load_run, policies
from dronecombat_jax.runs.provenance import describe
from dronecombat_jax.selfplay.chunk import init_state
from dronecombat_jax.tournaments.contenders import find, identity_of
from dronecombat_jax.types import Policy

KEY = jax.random.key(0)
CONFIG = Config(
    learn=LearnConfig(hidden_sizes=(8, 6), rollout_steps=6, minibatches=2),
    train=TrainConfig(num_envs=8, chunk_iterations=2, seed=5, num_seeds=2, total_steps=192),
)


def begun(path, config: Config, steps: tuple[int, ...], log_std=None, meta=None) -> SimpleNamespace:
    """A run whose checkpoints hold random numbers, and `log_std` [4] where it is given."""
    (path / "checkpoints").mkdir(parents=True)
    (path / "config.toml").write_text(settings.to_toml(config))
    shapes = jax.eval_shape(lambda: init_state(Combat(config)))
    states = {}
    for step in steps:
        rng = np.random.default_rng(step)
        states[step] = jax.tree.map(
            lambda leaf, rng=rng: (rng.random(leaf.shape) / 2).astype(leaf.dtype), shapes
        )
        if log_std is not None:
            states[step].learners.parameters.log_std[:] = log_std
        checkpoint.save(path / "checkpoints", step, states[step], meta or {})
    return SimpleNamespace(path=path, states=states)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> SimpleNamespace:
    return begun(tmp_path_factory.mktemp("runs") / "two seeds", CONFIG, (0, 2))


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def export(run: SimpleNamespace, *args: str) -> int:
    return cli.main(["export", str(run.path), *args])


def one_error(capsys) -> str:
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and len(err.splitlines()) == 1
    return err.removeprefix("error: ").strip()


@pytest.mark.parametrize(("role", "agent"), [("defender", 0), ("attacker", 1)])
def test_the_file_holds_the_policy_that_was_asked_for(run, here, capsys, role, agent):
    assert export(run, "--chunk", "1", "--role", role, "--seed", "6", "out.safetensors") == 0
    line = f"out.safetensors: {role} of two-seeds, seed 6, chunk 1 (96 environment steps), network 35-8-6-4"
    assert capsys.readouterr().out.startswith(line)
    policy, info = load_policy(here / "out.safetensors")
    assert isinstance(policy, Policy)
    wanted = policy_of(jax.tree.map(lambda leaf: leaf[1, agent], run.states[2].learners))
    for ours, saved in zip(jax.tree.leaves(wanted), jax.tree.leaves(policy), strict=True):
        assert np.asarray(ours).tobytes() == saved.tobytes() and np.shape(ours) == saved.shape
    assert (info.role, info.run, info.seed, info.chunk, info.steps) == (role, "two-seeds", 6, 1, 96)
    assert info.layer_sizes == (35, 8, 6, 4) and info.environment_sha256 == environment_digest(
        CONFIG
    )
    assert info.config_sha256 == hashlib.sha256((run.path / "config.toml").read_bytes()).hexdigest()
    assert require_environment(info, CONFIG) == []
    seen = observations(policy, 3.0)
    ours = np.asarray(policy_mean(CONFIG.learn, wanted, seen))
    assert NumpyPolicy("out.safetensors")(seen) == pytest.approx(ours, rel=1e-5, abs=1e-5)


BOUNDS = {  # of a run, its parameter, and what it draws with
    "below": ((-1.0, 2.0), [-1.0127, -1.0127, -0.9758, -1.0127], [-1.0, -1.0, -0.9758, -1.0]),
    "above": ((-20.0, 0.5), [0.6, 0.5, 0.4, -3.0], [0.5, 0.5, 0.4, -3.0]),
    "wider than the default": ((-20.0, 10.0), [5.0, 2.5, 0.0, -20.0], [5.0, 2.5, 0.0, -20.0]),
}


@pytest.mark.parametrize("case", BOUNDS)
def test_file_and_run_draw_with_the_log_std_that_was_flown(here, case):
    """Also for a parameter outside of its bounds, as older checkpoints may hold."""
    (low, high), parameter, flown = BOUNDS[case]
    config = replace(CONFIG, learn=replace(CONFIG.learn, min_log_std=low, max_log_std=high))
    run = begun(here / "run", config, (0, 2), log_std=parameter)
    assert export(run, "--role", "defender", "--seed", "6", "out.safetensors") == 0
    policy, _ = load_policy(here / "out.safetensors")
    live = policies(load_run(run.path), 1)[0]
    assert isinstance(policy, Policy) and isinstance(live, Policy)
    np.testing.assert_array_equal(policy.log_std, np.float32(flown))
    np.testing.assert_array_equal(live.log_std, np.float32(flown))
    of_run = find(str(run.path)).contenders[2]
    of_file = find("out.safetensors").contenders[0]
    assert (of_run.role, of_run.entrant.seed) == (of_file.role, of_file.entrant.seed) == (0, 6)
    assert of_run.entrant.identity == of_file.entrant.identity
    for contender in (of_run, of_file):
        assert contender.player and isinstance(contender.player.pilot, Policy)
        np.testing.assert_array_equal(contender.player.pilot.log_std, np.float32(flown))
    seen = np.zeros((1, 2, 35), np.float32)
    pilot: Any = policy_pilot
    drawn = [pilot(config.learn, policy, 0, draw)(None, seen, KEY) for draw in (False, True)]
    noise = jax.random.normal(KEY, (1, 4))
    np.testing.assert_allclose(
        drawn[1] - drawn[0], np.exp(np.float32(flown)) * noise, rtol=1e-4, atol=1e-6
    )


def test_a_policy_with_memory_says_so_in_its_file_and_in_no_other(here, capsys):
    learn = replace(CONFIG.learn, memory="frames", frames=3)
    run = begun(here / "run", replace(CONFIG, learn=learn), (0,))
    assert export(run, "--role", "attacker", "--seed", "6", "out.safetensors") == 0
    policy, info = load_policy(here / "out.safetensors")
    assert info.memory == "frames 3" and info.layer_sizes == (35, 8, 6, 4)
    wanted = policy_of(jax.tree.map(lambda leaf: leaf[1, 1], run.states[0].learners))
    for ours, theirs in zip(jax.tree.leaves(policy), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    named = find("out.safetensors").contenders[0].entrant
    assert named.identity == find(str(run.path), untrained=True).contenders[3].entrant.identity
    capsys.readouterr()
    assert export(run, "--role", "attacker", "--seed", "6", "out.h") == EXIT_CONFIG
    assert one_error(capsys).startswith("out.h: a policy with memory (frames 3)")
    assert not (here / "out.h").exists()


def test_within_its_bounds_a_player_keeps_its_identity(run):
    """Older tournaments go on: the digest is that of the parameters as they are saved."""
    saved = policy_of(jax.tree.map(lambda leaf: leaf[1, 1], run.states[2].learners))
    assert find(str(run.path)).contenders[3].entrant.identity == identity_of(saved, True)


@pytest.mark.long
def test_the_file_knows_the_game_that_was_flown_and_not_the_one_that_is_here(here, capsys):
    """The run was trained in another scene, or its MJCF has been edited since."""
    met = environment(CONFIG) | {"scene.defender.mass": 1.325}
    run = begun(here / "run", CONFIG, (0,), meta=describe(CONFIG, 0, met))
    assert export(run, "--seed", "5", "out.safetensors") == 0
    _, info = load_policy(here / "out.safetensors")
    assert info.environment == met and info.environment_sha256 != environment_digest(CONFIG)
    with pytest.raises(
        UserError, match=r"scene.defender.mass is 1.325 there, the package's own here"
    ):
        require_environment(info, CONFIG)
    capsys.readouterr()
    assert cli.main(["evaluate", str(run.path), "--fights", "1", "--device", "cpu"]) == 0
    assert (
        "note: trained in another environment than the one here: scene.defender.mass"
        in capsys.readouterr().out
    )


def test_the_newest_is_the_default_and_the_bytes_are_the_same_every_time(run, here):
    assert export(run, "--seed", "5", "--out", "a.safetensors") == 0
    assert export(run, "b.safetensors", "--chunk", "1", "--seed", "5") == 0
    assert export(run, "--seed", "5", "c.safetensors", "--chunk", "0") == 0
    newest, same, untrained = ((here / f"{name}.safetensors").read_bytes() for name in "abc")
    assert newest == same != untrained


def test_a_file_is_replaced_only_by_force(run, here, capsys):
    (here / "a.safetensors").write_text("mine")
    assert export(run, "--seed", "5", "a.safetensors") == EXIT_CANNOT_WRITE
    assert one_error(capsys) == "a.safetensors is there already; --force replaces it"
    assert (here / "a.safetensors").read_text() == "mine"
    assert export(run, "--seed", "5", "--force", "a.safetensors") == 0
    load_policy(here / "a.safetensors")


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (["a.safetensors"], EXIT_CONFIG, "has seeds 5 to 6: choose one with --seed"),
        (["a.safetensors", "--seed", "7"], EXIT_CONFIG, "has seeds 5 to 6: not --seed 7"),
        (["a.safetensors", "--seed", "5", "--chunk", "3"], EXIT_DATA, "no checkpoint 6"),
        (["a.pt"], EXIT_CONFIG, "must end in .safetensors or .onnx"),
        (["--seed", "5"], EXIT_CONFIG, "must end in .safetensors or .onnx"),
        (
            ["no/where.safetensors", "--seed", "5"],
            EXIT_CANNOT_WRITE,
            "cannot write no/where.safetensors: No such file",
        ),
        (
            ["n" * 300 + ".safetensors", "--seed", "5"],
            EXIT_CANNOT_WRITE,
            "is longer than 200 bytes",
        ),
        (["a.safetensors", "--role", "referee"], EXIT_CONFIG, "must be one of defender, attacker"),
    ],
)
def test_mistakes_are_one_line(run, here, capsys, args, code, words):
    assert export(run, *args) == code
    assert words in one_error(capsys)
    assert list(here.iterdir()) == []


def test_a_solo_run_has_no_defender(tmp_path_factory, capsys):
    config = Config(
        game=GameConfig(scenario="solo"), learn=CONFIG.learn, train=TrainConfig(num_envs=8)
    )
    solo = begun(tmp_path_factory.mktemp("runs") / "solo", config, (0,))
    assert export(solo, "--role", "defender", "a.safetensors") == EXIT_CONFIG
    assert "its defender never flew; take the other --role" in one_error(capsys)
    assert export(solo, "a.safetensors") == 0  # one seed alone need not be named


def test_the_suffix_chooses_onnx(run, here, capsys, monkeypatch):
    pytest.importorskip("onnx", reason="onnx is not installed: pip install onnx")
    assert export(run, "--seed", "5", "a.onnx") == 0
    assert capsys.readouterr().out.startswith("a.onnx: attacker of two-seeds, seed 5, chunk 1")
    monkeypatch.setitem(sys.modules, "onnx", None)
    assert export(run, "--seed", "5", "b.onnx") == EXIT_CONFIG
    assert "pip install 'dronecombat-jax[onnx]'" in one_error(capsys)
    assert [path.name for path in here.iterdir()] == ["a.onnx"]

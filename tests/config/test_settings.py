"""Presets, strict loading, messages and the round trip of the configuration; JAX is never imported."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck
from hypothesis import settings as limits
from refusals import errors_of

from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config

REPOSITORY = Path(__file__).resolve().parents[2]
# Other work may share the machine: nothing here is about time.
UNHURRIED = limits(deadline=None, suppress_health_check=[HealthCheck.too_slow], database=None)


def test_no_preset_is_the_defaults():
    assert settings.load() == Config()


def test_the_presets_that_come_with_the_package():
    wanted = {"smoke", "duel", "colab", "paper", "literal", "authors", "solo", "fast", "real"}
    wanted |= {"strong", "league", "responder", "2v1", "2v2", "3v3"}
    assert wanted <= settings.presets().keys()


@pytest.mark.parametrize("name", settings.presets())
def test_every_preset_loads_explains_itself_and_comes_back_exactly(name, toml):
    config = settings.load(name)
    text = settings.presets()[name].read_text()
    assert text.startswith(f"# {name}: ") and "dronecombat train" in text
    assert settings.load(toml(settings.to_toml(config))) == config


def test_what_the_presets_promise():
    paper, authors = settings.load("paper"), settings.load("authors")
    # the paper: 417 updates of 24,000
    assert paper.num_chunks == 100 and paper.steps_per_chunk == 10_008_000
    assert (paper.game.crash_rule, paper.reward.crash_penalty) == ("ends", 10.0)
    assert (authors.reward.approach_weight, authors.game.crash_rule) == (10.0, "grounded")
    assert authors.learn.clip_actions and not authors.learn.bootstrap_timeout
    assert not settings.load("literal").reward.time_scaled
    assert (
        settings.load("solo").game.scenario == "solo"
        and settings.load("solo").train.total_steps == 8_000_000
    )
    assert settings.load("smoke").num_chunks == 3
    colab, duel = settings.load("colab"), settings.load("duel")
    only_more = {"total_steps": 48_000_000, "chunk_iterations": 50, "num_seeds": 8}
    assert colab == dataclasses.replace(duel, train=dataclasses.replace(duel.train, **only_more))
    strong, responder = settings.load("strong"), settings.load("responder")
    alone = {"defender_post": 0.0, "defender_teacher": "", "average_share": 0.0}
    assert responder == dataclasses.replace(
        strong,
        game=dataclasses.replace(strong.game, observation="engagement"),
        learn=dataclasses.replace(strong.learn, defender_progress=30.0, **alone),
        selfplay=Config().selfplay,
        train=dataclasses.replace(
            strong.train, total_steps=responder.train.total_steps, strike_margin=0.0
        ),
    )
    assert (strong.learn.defender_teacher, strong.learn.average_share) == ("goalkeeper", 0.15)
    assert "pilots:" not in strong.selfplay.opponents
    league = settings.load("league")
    assert league == dataclasses.replace(strong, selfplay=league.selfplay)
    assert "pilots:responder-attacker-6" in league.selfplay.opponents
    assert (
        duel.game.crash_rule == "out" and duel.train.num_envs * duel.learn.rollout_steps == 24_000
    )


def test_presets_of_a_wheel_come_before_those_of_a_folder_beside_it(tmp_path, monkeypatch):
    package = tmp_path / "dronecombat_jax"
    for folder in (package / "experiments", tmp_path / "experiments"):
        folder.mkdir(parents=True)
        (folder / "mine.toml").touch()
    monkeypatch.setattr(settings, "__file__", str(package / "config" / "settings.py"))
    assert settings.presets() == {"mine": package / "experiments" / "mine.toml"}


@pytest.mark.parametrize(
    ("preset", "message"),
    [
        ("duell", "did you mean duel?"),
        ("zzz", "there are: 2v1, 2v2, 3v3, authors, colab, "),
        ("none/such.toml", "none/such.toml: no such file"),
        ("such.toml", "such.toml: no such file"),
        ("", "must be a name or a file"),
        ("a\nb", "must be a name or a file"),
        ("x" * 300 + ".toml", "xxx"),
        (REPOSITORY / "tests", "not a file"),
    ],
)
def test_a_preset_that_is_not_there(preset, message):
    (line,) = errors_of(preset)
    assert message in line


def test_defaults_then_file_then_flags(toml):
    path = toml("[train]\nnum_envs = 60\nseed = 3\n")
    config = settings.load(path, {"train.seed": 4, "learn.hidden_sizes": [8]})
    assert (config.train.num_envs, config.train.seed, config.learn.epochs) == (
        60,
        4,
        Config().learn.epochs,
    )
    assert config.learn.hidden_sizes == (8,)


def test_an_int_is_a_fine_float_and_becomes_one(toml):
    rate = settings.load(toml("[reward]\nwin = 3\n")).reward.win
    assert rate == 3.0 and isinstance(rate, float)


def test_all_mistakes_at_once_of_file_and_flags(toml):
    path = toml('[train]\nseed = -1\nfoo = 2\n\n[learn]\nlearning_rate = "1e-3"\n')
    lines = errors_of(path, {"train.num_envs": 0, "sim.nope": 1})
    assert [line.split(": ")[0] for line in lines] == [
        f"{path}:2", f"{path}:3", f"{path}:6", "--train.num-envs 0", "--sim.nope 1",
    ]  # fmt: skip


def test_a_flag_mends_what_the_file_has_wrong(toml):
    assert settings.load(toml("[train]\nseed = -1\n"), {"train.seed": 1}).train.seed == 1


@pytest.mark.parametrize(
    ("content", "place", "message"),
    [
        ("", "", "the file is empty"),
        ("# only words\n", "", "the file is empty"),
        (b"\xef\xbb\xbf[train]\nseed = 1\n", ":1", "byte-order mark"),
        ("[train]\nseed = 1\n".encode("utf-16"), ":1", "byte-order mark"),
        (b"[train]\n# \xff\n", ":2", "not UTF-8"),
        ("[train]\nseed = \n", ":2", "not valid TOML"),
        ("[train]\nseed 1\n", ":2", "not valid TOML"),
        ("[train\n", ":1", "not valid TOML"),
        ("\x00", ":1", "not valid TOML"),
        ("[train]\nseed = 1\nseed = 2\n", ":3", "the same key twice"),
        ("[train]\nseed = 1\n[train]\nnum_envs = 2\n", ":3", "twice"),
        ("[train]\nseed = " + "9" * 5000, "", "too many digits"),
        ("[train]\nseed = " + "[" * 50_000, "", "nested too deeply"),
        ("#" * 1_000_001, "", "larger than 1000000 bytes"),
    ],
    ids=lambda value: str(value)[:24].strip(),
)
def test_a_file_that_is_no_preset_is_one_line(toml, content, place, message):
    path = toml(content)
    (line,) = errors_of(path)
    assert line.startswith(f"{path}{place}: ") and message in line


def test_a_file_that_may_not_be_read(toml, monkeypatch):
    def denied(*args, **kwargs):
        raise PermissionError(13, "Permission denied")

    path = toml("[train]\nseed = 1\n")
    monkeypatch.setattr(Path, "open", denied)
    (line,) = errors_of(path)
    assert line.endswith("cannot be read: Permission denied")


def test_windows_line_ends_are_fine(toml):
    path = toml("[train]\r\nseed = 1\r\nnum_envs = 0\r\n")
    (line,) = errors_of(path)
    assert line.startswith(f"{path}:3: ")


def test_diff_names_what_differs():
    a, b = (
        Config(),
        settings.load(
            None, {"game.scenario": "solo", "learn.epochs": 3, "train.total_steps": 8_000_000}
        ),
    )
    assert settings.diff(a, b) == [
        ("game.scenario", "duel", "solo"),
        ("learn.epochs", 5, 3),
        ("train.total_steps", 20_000_000, 8_000_000),
    ]
    assert settings.diff(a, Config()) == []


@pytest.mark.parametrize(
    ("preset", "probability", "name", "expected"),
    [
        ("duel", 0.0, "", "ippo-duel"),
        ("duel", 0.2, "", "sippo-duel"),
        ("some where/my preset.toml", 0.0, "", "ippo-my-preset"),
        ("duel", 0.0, "mine", "mine"),
        ("x" * 200, 0.0, "", "ippo-" + "x" * 95),
    ],
)
def test_run_name(preset, probability, name, expected):
    config = settings.load(None, {"selfplay.probability": probability, "run.name": name})
    assert settings.run_name(config, preset) == expected


def test_a_written_configuration_explains_every_setting():
    lines = settings.to_toml(Config()).splitlines()
    for key, entry in settings.SCHEMA.items():
        at = next(i for i, line in enumerate(lines) if line.startswith(key.split(".")[1] + " = "))
        assert lines[at - 1].startswith("# ")
        assert any(line.startswith(f"# {entry.explained}") for line in lines)


def test_settings_import_neither_jax_nor_mujoco():
    program = (
        "import sys; from dronecombat_jax.config import settings; settings.load('smoke');"
        "print(sorted({'jax', 'mujoco', 'numpy'} & sys.modules.keys()))"
    )
    result = subprocess.run(
        [sys.executable, "-c", program], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert result.stdout == "[]\n"

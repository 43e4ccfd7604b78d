"""Commands, flags, messages and exit codes; training itself is replaced, and JAX is never imported."""

from pathlib import Path

import pytest
from drones import SMALL, write
from refusals import refused

from dronecombat_jax.cli import commands as cli
from dronecombat_jax.cli import train
from dronecombat_jax.config import flags, settings
from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_STOPPED

REPOSITORY = Path(__file__).resolve().parents[2]


def trained(rooms, *args: str) -> Config:
    """The configuration that `dronecombat train` hands over."""
    assert cli.main(["train", *args]) == EXIT_STOPPED
    prepared, (name, config) = rooms.calls
    assert prepared == ("prepare", config.run.device, 1) and name == "train"
    return config


# train


@pytest.mark.parametrize(
    ("role", "opponents"),
    [
        ((), "defender=pilots:ippo-defender"),
        (("--role", "defender"), "attacker=pilots:ippo-defender"),
    ],
)
def test_against_somebody_is_a_table_of_one_row(rooms, role, opponents):
    config = trained(rooms, "--against", "pilots:ippo-defender", *role)
    assert config.selfplay.opponents == opponents and config.run.name == "opponents-duel"
    assert config.head_start_chunks == 0


def test_seeds_are_spread_over_the_cores(rooms):
    assert cli.main(["train", "--train.num-seeds", "4"]) == EXIT_STOPPED
    assert rooms.calls[0] == ("prepare", "auto", 2)


def test_the_default_preset_is_duel(rooms):
    config = trained(rooms)
    assert config.run.name == "ippo-duel"
    assert settings.diff(config, settings.load("duel")) == [("run.name", "ippo-duel", "")]


def test_flags_win_over_the_preset(rooms):
    config = trained(
        rooms, "--preset", "smoke", "--train.num-envs", "96", "--learn.hidden-sizes", "8", "16",
        "--learn.learning-rate=1e-3", "--learn.initial_log_std", "-1e0", "--game.crash-rule", "out",
        "--run.video", "--game.no-swept-events", "--train.total-steps", "10_000",
    )  # fmt: skip
    assert (config.train.num_envs, config.train.total_steps, config.learn.hidden_sizes) == (
        96,
        10_000,
        (8, 16),
    )
    assert (config.learn.learning_rate, config.learn.initial_log_std) == (1e-3, -1.0)
    assert (config.game.crash_rule, config.game.swept_events) == ("out", False)
    assert config.run.video  # False in the preset and True by default: the flag was still given
    assert config.game.episode_steps == 100  # from the preset


def test_short_flags(rooms):
    config = trained(rooms, "--name", "mine", "--seed", "7", "--device", "cpu", "--steps", "123")
    assert (config.run.name, config.train.seed, config.run.device) == ("mine", 7, "cpu")
    assert config.train.total_steps == 123


def test_a_fork_is_a_new_run_from_a_named_one(rooms):
    assert cli.main(["train", "--name", "old", "--fork", "new", "--seed", "7"]) == EXIT_STOPPED
    assert cli.main(["train", "--fork-chunk", "3", "--fork", "new"]) == EXIT_STOPPED
    (_, config, *origin), (_, _, *second) = (call for call in rooms.calls if call[0] == "train")
    assert (config.run.name, config.train.seed, *origin) == ("new", 7, "old", None)
    assert second == ["ippo-duel", 3]


def test_an_own_drone_is_named_by_its_whole_path_and_read_before_there_is_a_run(
    rooms, capsys, tmp_path
):
    """A run is gone on with, and looked at, from any folder."""
    write(tmp_path)
    assert trained(rooms, "--sim.mjcf", "drone.xml").sim.mjcf == str(tmp_path / "drone.xml")
    write(tmp_path, SMALL, ("<freejoint/>", ""), name="fixed.xml")
    for name, words in (("x2.xml", "no such file (MJCF files in"), ("fixed.xml", "no free joint")):
        rooms.calls.clear()
        assert cli.main(["train", "--sim.mjcf", name]) == EXIT_CONFIG
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"error: sim.mjcf: {tmp_path / name}: {words}")
        assert [call[0] for call in rooms.calls] == ["prepare"]


def test_a_preset_may_be_a_file(rooms, tmp_path):
    (tmp_path / "mine.toml").write_text("[train]\nseed = 5\n")
    config = trained(rooms, "--preset", "mine.toml")
    assert (config.train.seed, config.run.name) == (5, "ippo-mine")


def test_what_differs_is_printed_once(rooms, capsys):
    trained(rooms, "--preset", "solo", "--seed", "4")
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "settings: preset solo; these differ from the defaults:"
    assert '  game.scenario = "solo" (default "duel")' in lines
    assert "  train.seed = 4 (default 0)" in lines
    assert "--print-config" in lines[-1]
    assert len(lines) == 2 + 8


def test_print_config_prints_all_of_it_and_trains_nothing(rooms, capsys, tmp_path):
    assert cli.main(["train", "--preset", "smoke", "--seed", "4", "--print-config"]) == 0
    text = capsys.readouterr().out
    (tmp_path / "again.toml").write_text(text)
    assert rooms.calls == []
    expected = settings.load("smoke", {"train.seed": 4, "run.name": "ippo-smoke"})
    assert settings.load(tmp_path / "again.toml") == expected


def test_every_setting_has_a_flag():
    expected, args, off = {}, [], []
    for key, entry in settings.SCHEMA.items():
        value = entry.default or {"str": "x", "bool": True}.get(entry.kind, 0)
        expected[key] = value
        words = [str(item) for item in value] if isinstance(value, tuple) else [str(value)]
        args += [settings.flag(key)] + ([] if entry.kind == "bool" else words)
        off += (
            ["--{}.no-{}".format(*settings.flag(key)[2:].split("."))]
            if entry.kind == "bool"
            else []
        )
    assert flags.parse(train.TrainFlags, args, "train", aliases=train.SHORT_FLAGS) == (expected, [])
    switches = {key: False for key, entry in settings.SCHEMA.items() if entry.kind == "bool"}
    assert flags.parse(train.TrainFlags, off, "train") == (switches, [])


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ("--train.num-envz 3", "--train.num-envz: unknown flag; did you mean --train.num-envs?"),
        ("--num-envs 5", "--num-envs: unknown flag; did you mean --train.num-envs?"),
        ("--learn.num-envs 5", "--learn.num-envs: unknown flag; did you mean --train.num-envs?"),
        ("--nam x", "--nam: unknown flag; did you mean --name?"),
        ("--prest smoke", "--prest: unknown flag; did you mean --preset?"),
        ("--zzzzzz=3", "--zzzzzz: unknown flag; --help lists them all"),
        ("-q", "-q: unknown flag; --help lists them all"),
        ("extra", '"extra": belongs to no flag'),
        (
            "--run.video false",
            '"false": an on-off flag takes no value; write --run.video or --run.no-video',
        ),
        (
            "--run.video=false",
            '"false": an on-off flag takes no value; write --run.video or --run.no-video',
        ),
        (
            "--run.no_video yes",
            '"yes": an on-off flag takes no value; write --run.video or --run.no-video',
        ),
        ("--seed", "--train.seed: the value is missing"),
        ("--seed --name x", "--train.seed: the value is missing"),
        (
            "--learn.hidden-sizes",
            "--learn.hidden-sizes []: must be a list of 1 to 16 integers from 1 to 8192",
        ),
        ("--learn.hidden-sizes 32 a", '--learn.hidden-sizes [32, "a"]: must be a list'),
        ("--seed x", "--train.seed x: must be an integer from 0 to 2147483647"),
        ("--seed -1", "--train.seed -1: must be an integer from 0 to 2147483647"),
        ("--seed=", '--train.seed "": must be an integer from 0 to 2147483647'),
        ("--seed 1.5", "--train.seed 1.5: must be an integer from 0 to 2147483647"),
        ("--seed \u0663", "--train.seed \u0663: must be an integer from 0 to 2147483647"),
        (
            "--steps 2e7",
            "--train.total-steps 2e7: must be an integer from 1 to 1000000000000; write 20000000",
        ),
        (
            "--learn.learning-rate nan",
            "--learn.learning-rate nan: must be a number above 0, at most 1",
        ),
        (
            "--learn.learning-rate inf",
            "--learn.learning-rate inf: must be a number above 0, at most 1",
        ),
        (
            "--learn.learning-rate 1e999",
            "--learn.learning-rate inf: must be a number above 0, at most 1",
        ),
        (
            "--learn.learning-rate 0",
            "--learn.learning-rate 0.0: must be a number above 0, at most 1",
        ),
        ("--game.crash-rule end", "--game.crash-rule end: must be one of ends, out, grounded"),
        ("--device cuda", "--run.device cuda: must be one of auto, cpu, gpu, tpu"),
        ("--preset duell", '--preset "duell": no such preset; did you mean duel?'),
        ("--preset none.toml", "none.toml: no such file"),
        ("--role attacker", "--role needs --against OPPONENT"),
        ("--against x --role pilot", "--role pilot: must be one of defender, attacker"),
        ("--against x --selfplay.opponents attacker=y", "say the same: write one of them"),
        ("--against x --selfplay.probability 0.2", "leave selfplay.probability out"),
        ("--selfplay.opponents attacker=nobody", "only defender=nobody SHARE"),
        ("--fork-chunk 3", "--fork-chunk needs --fork NEW_NAME"),
        (
            "--fork new --fork-chunk 1.5",
            "--fork-chunk 1.5: must be an integer from -1 to 1000000000",
        ),
        (
            "--learn.minibatches 7",
            "nearest that fit: learn.minibatches 6 or 8, train.num_envs 994 or 1001",
        ),
        ("--train.num-envs 1000000 --learn.rollout-steps 2400", "of memory, and this machine has"),
    ],
)
def test_a_wrong_command_line_is_one_line(rooms, capsys, args, message):
    (line,) = refused(capsys, "train", *args.split(" "))
    assert message in line
    assert rooms.calls == []


def test_all_wrong_flags_are_told_at_once(capsys, tmp_path):
    (tmp_path / "mine.toml").write_text("[train]\nnum_env = 3\n")
    args = "--zzz 1 --seed x --preset mine.toml --learn.epochs 0 --run.video no"
    lines = refused(capsys, "train", *args.split())
    assert [line.split(": ")[0] for line in lines] == [
        "--zzz", '"no"', "mine.toml:2", "--learn.epochs 0", "--train.seed x",
    ]  # fmt: skip


def test_the_last_of_two_equal_flags_counts(rooms):
    assert trained(rooms, "--seed", "1", "--train.seed", "2").train.seed == 2


def test_a_hostile_value_stays_on_one_line(capsys):
    (line,) = refused(capsys, "train", "--seed", "1\nerror: fake \x1b[31m" + "9" * 5000)
    assert line.startswith("--train.seed 1?error: fake ?[31m999") and len(line) < 200

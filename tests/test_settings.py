"""Presets, strict loading, messages and the round trip of the configuration; JAX is never imported."""

import dataclasses
import math
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from hypothesis import HealthCheck
from hypothesis import given as over
from hypothesis import settings as limits
from hypothesis import strategies as st

from dronecombat_jax import preflight, schema, settings
from dronecombat_jax.config import Config
from dronecombat_jax.errors import EXIT_CONFIG, UserError

REPOSITORY = Path(__file__).resolve().parents[1]
NUMBERS = [entry for entry in settings.SCHEMA.values() if entry.low is not None]
# Other work may share the machine: nothing here is about time.
UNHURRIED = limits(deadline=None, suppress_health_check=[HealthCheck.too_slow], database=None)


def by_key(entry: schema.Setting) -> str:
    """The name of a parametrised test."""
    return entry.key


def errors_of(*args, **kwargs) -> list[str]:
    """The lines of the error that loading raises."""
    with pytest.raises(UserError) as caught:
        settings.load(*args, **kwargs)
    assert caught.value.exit_code == EXIT_CONFIG
    return caught.value.message.splitlines()


@pytest.fixture
def toml(tmp_path):
    """Writes a file and gives its path."""

    def write(content: str | bytes) -> Path:
        path = tmp_path / "own.toml"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


# Presets


def test_no_preset_is_the_defaults():
    assert settings.load() == Config()


def test_the_presets_that_come_with_the_package():
    wanted = {"smoke", "duel", "colab", "paper", "literal", "authors", "solo", "fast"}
    assert wanted <= settings.presets().keys()


@pytest.mark.parametrize("name", settings.presets())
def test_every_preset_loads_explains_itself_and_comes_back_exactly(name, toml):
    config = settings.load(name)
    text = settings.presets()[name].read_text()
    assert text.startswith(f"# {name}: ") and "dronecombat train" in text
    assert settings.load(toml(settings.to_toml(config))) == config


def test_what_the_presets_promise():
    paper, authors = settings.load("paper"), settings.load("authors")
    assert paper.num_chunks == 100 and paper.steps_per_chunk == 10_008_000  # the paper: 417 updates of 24,000
    assert (paper.game.crash_rule, paper.reward.crash_penalty) == ("ends", 10.0)
    assert (authors.reward.approach_weight, authors.game.crash_rule) == (10.0, "grounded")
    assert authors.learn.clip_actions and not authors.learn.bootstrap_timeout
    assert not settings.load("literal").reward.time_scaled
    assert settings.load("solo").game.scenario == "solo" and settings.load("solo").train.total_steps == 8_000_000
    assert settings.load("smoke").num_chunks == 3
    colab, duel = settings.load("colab"), settings.load("duel")
    only_more = {"total_steps": 48_000_000, "chunk_iterations": 50, "num_seeds": 8}
    assert colab == dataclasses.replace(duel, train=dataclasses.replace(duel.train, **only_more))
    assert duel.game.crash_rule == "out" and duel.train.num_envs * duel.learn.rollout_steps == 24_000


def test_presets_of_a_wheel_come_before_those_of_a_folder_beside_it(tmp_path, monkeypatch):
    package = tmp_path / "dronecombat_jax"
    for folder in (package / "experiments", tmp_path / "experiments"):
        folder.mkdir(parents=True)
        (folder / "mine.toml").touch()
    monkeypatch.setattr(settings, "__file__", str(package / "settings.py"))
    assert settings.presets() == {"mine": package / "experiments" / "mine.toml"}


@pytest.mark.parametrize(
    ("preset", "message"),
    [
        ("duell", "did you mean duel?"),
        ("zzz", "there are: authors, colab, "),
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


# Precedence and types


def test_defaults_then_file_then_flags(toml):
    path = toml("[train]\nnum_envs = 60\nseed = 3\n")
    config = settings.load(path, {"train.seed": 4, "learn.hidden_sizes": [8]})
    assert (config.train.num_envs, config.train.seed, config.learn.epochs) == (60, 4, Config().learn.epochs)
    assert config.learn.hidden_sizes == (8,)


def test_an_int_is_a_fine_float_and_becomes_one(toml):
    rate = settings.load(toml("[reward]\nwin = 3\n")).reward.win
    assert rate == 3.0 and isinstance(rate, float)


WRONG = [
    ("train.num_envs", "true", "must be an integer from 1 to 1000000"),
    ("train.num_envs", "1e3", "must be an integer from 1 to 1000000; write 1000"),
    ("train.num_envs", '"12"', "must be an integer from 1 to 1000000; write 12"),
    ("train.num_envs", "1.5", "must be an integer"),
    ("train.num_envs", "0", "must be an integer from 1 to"),
    ("train.num_envs", "-3", "must be an integer from 1 to"),
    ("train.num_envs", "1_000_000_000", "must be an integer from 1 to 1000000"),
    ("train.num_envs", "[1]", "must be an integer"),
    ("train.num_envs", "1979-05-27", "must be an integer"),
    ("train.num_envs", "inf", "must be an integer"),
    ("train.num_envs", "nan", "must be an integer"),
    ("learn.learning_rate", '"1e-3"', "must be a number above 0, at most 1; write 1e-3 without quotes"),
    ("learn.learning_rate", "nan", "must be a number"),
    ("learn.learning_rate", "-inf", "must be a number"),
    ("learn.learning_rate", "1e999", "must be a number"),
    ("learn.learning_rate", "false", "must be a number"),
    ("learn.learning_rate", "0.0", "must be a number above 0"),
    ("learn.learning_rate", "1" + "0" * 400, "must be a number"),
    ("sim.timestep", "1", "must be a number from 0.0001 to 0.05 s"),
    ("learn.hidden_sizes", "256", "must be a list of 1 to 16 integers from 1 to 8192"),
    ("learn.hidden_sizes", "[]", "must be a list"),
    ("learn.hidden_sizes", "[32, true]", "must be a list"),
    ("learn.hidden_sizes", "[32, 0]", "must be a list"),
    ("learn.hidden_sizes", "[32, 1.0]", "must be a list"),
    ("learn.hidden_sizes", "[" + "1," * 17 + "]", "must be a list of 1 to 16"),
    ("learn.value_loss", '"ppo"', "must be one of skrl, ppo2_max, paper_min, plain"),
    ("learn.value_loss", "3", "must be one of"),
    ("run.figures", "1", "must be true or false"),
    ("run.figures", '"true"', "must be true or false"),
    ("run.name", "3", "must be text"),
    ("run.name", r'"a\nb"', "must be text on one line"),
    ("run.name", '"' + "a" * 1001 + '"', "must be text on one line"),
]


@pytest.mark.parametrize(("key", "text", "message"), WRONG, ids=lambda value: value[:20])
def test_a_wrong_value_is_one_line_with_file_line_key_and_range(toml, key, text, message):
    section, name = key.split(".")
    path = toml(f"# a comment\n\n[{section}]\n\n{name} = {text}\n")
    (line,) = errors_of(path)
    assert line.startswith(f"{path}:5: {key} = ") and message in line
    assert len(line) < len(str(path)) + 250


@pytest.mark.parametrize("entry", NUMBERS, ids=by_key)
def test_just_inside_is_fine_and_just_outside_is_not(entry):
    whole = entry.kind != "float"
    below = int(entry.low) - 1 if whole else entry.low if entry.low_open else math.nextafter(entry.low, -math.inf)
    lowest = int(entry.low) if whole else math.nextafter(entry.low, math.inf) if entry.low_open else entry.low
    highest = int(entry.high) if whole else entry.high
    above = highest + 1 if whole else math.nextafter(entry.high, math.inf)
    wrap = (lambda number: [number]) if entry.kind == "ints" else (lambda number: number)
    assert [entry.problem(wrap(number)) for number in (lowest, highest)] == [None, None]
    for number in (below, above):
        assert entry.allowed in (entry.problem(wrap(number)) or "")


@pytest.mark.parametrize("entry", settings.SCHEMA.values(), ids=by_key)
def test_defaults_are_allowed_and_every_setting_is_explained(entry):
    assert entry.problem(entry.default) is None
    assert entry.doc and entry.allowed
    assert (entry.low is None) == (entry.high is None)


JUNK = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=20), st.lists(st.integers(), max_size=3),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2), st.binary(max_size=3),
)  # fmt: skip


@UNHURRIED
@over(values=st.dictionaries(st.sampled_from(sorted(settings.SCHEMA)), JUNK, max_size=8))
def test_anything_is_either_refused_in_one_line_a_key_or_loaded_as_it_is(values):
    bad = [key for key, value in values.items() if settings.SCHEMA[key].problem(value)]
    if bad:
        lines = errors_of(None, values)
        assert [line.split()[0] for line in lines] == [settings.flag(key) for key in values if key in bad]
        return
    try:
        config = settings.load(None, values)
    except UserError:
        return  # a rule across settings
    loaded = schema.flatten(config)
    assert all(loaded[key] == (tuple(value) if isinstance(value, list) else value) for key, value in values.items())


@UNHURRIED
@over(data=st.data())
def test_any_configuration_comes_back_from_toml_exactly(data):
    values = {key: data.draw(allowed_values(entry)) for key, entry in settings.SCHEMA.items()}
    config = schema.build(Config, values)
    read_back = {f"{s}.{k}": v for s, part in tomllib.loads(settings.to_toml(config)).items() for k, v in part.items()}
    assert {key: settings.SCHEMA[key].normal(value) for key, value in read_back.items()} == schema.flatten(config)


def allowed_values(entry: schema.Setting) -> st.SearchStrategy:
    """All values of a setting."""
    if entry.choices:
        return st.sampled_from(entry.choices)
    if entry.kind == "bool":
        return st.booleans()
    if entry.kind == "str":
        return st.text(st.characters(exclude_categories=["Cs"]), max_size=30)
    assert entry.low is not None and entry.high is not None
    if entry.kind == "float":
        return st.floats(entry.low, entry.high, exclude_min=entry.low_open)
    whole = st.integers(int(entry.low), int(entry.high))
    return st.lists(whole, min_size=1, max_size=5).map(tuple) if entry.kind == "ints" else whole


# Keys


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("[train]\nnum_env = 3\n", 2, "train.num_env = 3: unknown setting; did you mean train.num_envs?"),
        ("[train]\nnum-envs = 3\n", 2, "did you mean train.num_envs?"),
        ("[train]\nNum_Envs = 3\n", 2, "did you mean train.num_envs?"),
        ("[train]\nlearning_rate = 3\n", 2, "did you mean learn.learning_rate?"),
        ("num_envs = 3\n", 1, "num_envs = 3: unknown setting; did you mean train.num_envs?"),
        ("train.num_env = 3\n", 1, "did you mean train.num_envs?"),
        ("[trian]\nseed = 3\n", 1, "trian = {seed = 3}: unknown setting; did you mean train?"),
        ("train = 3\n", 1, "train is a section; write its settings under [train]"),
        ("[[train]]\nseed = 3\n", None, "train is a section"),
        ("[train.seed]\nseed = 3\n", None, "train.seed = {seed = 3}: must be an integer"),
        ("[train]\nqqqqq = 3\n", 2, "there are: train.total_steps, train.num_envs"),
        ("qqqqq = 3\n", 1, "there are: sim, game, reward, learn, selfplay, train, run"),
        ('extends = "duel"\n', 1, "extends"),
        ('["train"]\n"num_env" = 3\n', 2, "did you mean train.num_envs?"),
        ('[run]\nname = """\nseed = 1"""\n[train]\nsed = 1', None, "did you mean train.seed?"),
    ],
)
def test_an_unknown_key_is_named_with_a_suggestion(toml, text, line, message):
    path = toml(text)
    matching = [error for error in errors_of(path) if message in error]
    assert matching and (line is None or matching[0].startswith(f"{path}:{line}: "))


@UNHURRIED
@over(key=st.sampled_from(sorted(settings.SCHEMA)), data=st.data())
def test_a_misspelt_key_is_never_accepted_and_mostly_recognised(key, data):
    section, name = key.split(".")
    at = data.draw(st.integers(0, len(name) - 1))
    wrong = name[:at] + data.draw(st.sampled_from("qxz").filter(lambda letter: letter != name[at])) + name[at + 1 :]
    (line,) = errors_of(None, {f"{section}.{wrong}": 1})
    assert "unknown setting; " in line
    assert len(name) < 6 or "did you mean" in line


def test_all_mistakes_at_once_of_file_and_flags(toml):
    path = toml('[train]\nseed = -1\nfoo = 2\n\n[learn]\nlearning_rate = "1e-3"\n')
    lines = errors_of(path, {"train.num_envs": 0, "sim.nope": 1})
    assert [line.split(": ")[0] for line in lines] == [
        f"{path}:2", f"{path}:3", f"{path}:6", "--train.num-envs 0", "--sim.nope 1",
    ]  # fmt: skip


def test_a_flag_mends_what_the_file_has_wrong(toml):
    assert settings.load(toml("[train]\nseed = -1\n"), {"train.seed": 1}).train.seed == 1


# Files


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


# Rules across settings


@pytest.mark.parametrize(
    ("overrides", "opening", "message"),
    [
        # 60 * 24 = 1440 = 7 * 205 + 5; 7 and 24 share no factor, so environments come in sevens: 56, 63.
        ({"train.num_envs": 60, "learn.minibatches": 7}, "--learn.minibatches: ", "minibatches 6 or 8, train.num_envs 56 or 63"),
        # 1001 * 24 = 24024 = 2^3 * 3 * 7 * 11 * 13: the neighbours of 9 are 8 and 11; 9 = 3 * gcd 3 wants threes.
        ({"train.num_envs": 1001, "learn.minibatches": 9}, "--learn.minibatches: ", "minibatches 8 or 11, train.num_envs 999 or 1002"),
        ({"train.num_envs": 1, "learn.minibatches": 100_000}, "--learn.minibatches: ", "minibatches 24, train.num_envs 12500"),
        ({"train.num_envs": 1, "learn.rollout_steps": 7}, "--train.num-envs: ", "minibatches 1 or 7, train.num_envs 6"),
        ({"learn.rollout_steps": 7}, "--learn.rollout-steps: ", "minibatches 5 or 7, train.num_envs 996 or 1002"),
        ({"game.spawn_altitude_low": 2.0}, "--game.spawn-altitude-low: ", "must not exceed"),
        ({"game.crash_altitude": 0.5}, "--game.crash-altitude: ", "must be below game.spawn_altitude_low = 0.5"),
        ({"game.spawn": "uniform", "game.spawn_spread": 1.0}, "--game.spawn: ", "spawn_spread = 1 widens fixed starts"),
        ({"game.spawn": "uniform", "game.defender_spread": 2.0}, "--game.spawn: ", "defender_spread = 2 widens"),
        ({"game.scenario": "solo", "train.solo_share": 0.2}, "--train.solo-share: ", 'needs game.scenario = "duel"'),
        # 8 environments, one of them for the attacker alone: 7 * 24 = 168 steps
        ({"train.num_envs": 8, "learn.minibatches": 64, "train.solo_share": 0.1}, "--train.solo-share: ", "7 environments and 168 steps"),
        ({"train.num_envs": 1, "train.solo_share": 0.6}, "--train.solo-share: ", "0 environments and 0 steps"),
        ({"sim.body": "p250", "sim.mjcf": "x2.xml"}, "--sim.body: ", "with sim.mjcf both come out of the file"),
        ({"learn.min_learning_rate": 0.1}, "--learn.min-learning-rate: ", "0.1, 0.0003, 0.01"),
        ({"learn.learning_rate": 0.1}, "--learn.learning-rate: ", "must hold"),
        ({"learn.min_log_std": 1.0}, "--learn.min-log-std: ", "must hold, but they are 1, 0, 2"),
        ({"learn.initial_log_std": 1.0, "learn.max_log_std": 0.5}, "--learn.initial-log-std: ", "must hold"),
        ({"run.name": ".hidden"}, "--run.name: ", "not start with a dot"),
        ({"run.name": "../up"}, "--run.name: ", "A-Z a-z"),
        ({"run.name": "a" * 101}, "--run.name: ", "at most 100"),
        ({"run.directory": ""}, "--run.directory: ", "must not be empty"),
        ({"train.seed": 2**31 - 1, "train.num_seeds": 2}, "--train.seed: ", "at most 2147483647"),
        # 10^12 steps of 24 * 6 are 6.9 * 10^9 iterations
        ({"train.total_steps": 10**12, "train.num_envs": 6}, "--train.total-steps: ", "at most 2147483647"),
        ({"train.num_envs": 10**6, "train.num_seeds": 1024}, "--train.num-envs: ", "of memory, and this machine has 8 GiB"),
        ({"learn.hidden_sizes": (8192,) * 16}, "--learn.hidden-sizes: ", "GiB of memory"),
    ],
)  # fmt: skip
def test_rules_across_settings(monkeypatch, overrides, opening, message):
    monkeypatch.setattr(preflight, "machine_bytes", lambda: 8 * 2**30)
    monkeypatch.setattr(preflight, "free_bytes", lambda path: None)
    (line,) = errors_of(None, overrides, check_machine=True)
    assert line.startswith(opening) and message in line


def test_broken_rules_are_all_told_and_placed_in_the_file(toml):
    path = toml("[game]\nspawn_altitude_low = 3.0\n\n[learn]\nminibatches = 7\n")
    first, second = errors_of(path)
    assert first.startswith(f"{path}:2: ") and second.startswith(f"{path}:5: ")


def test_a_constant_learning_rate_is_not_held_between_the_bounds_of_the_schedule():
    settings.load(None, {"learn.learning_rate": 0.1, "learn.learning_rate_schedule": "constant"})


@UNHURRIED
@over(envs=st.integers(1, 3000), steps=st.integers(1, 200), parts=st.integers(1, 3000))
def test_the_nearest_values_named_do_fit(envs, steps, parts):
    given = {"train.num_envs": envs, "learn.rollout_steps": steps, "learn.minibatches": parts}
    if envs * steps % parts == 0:
        settings.load(None, given)
        return
    (line,) = errors_of(None, given)
    named = line.split("nearest that fit: ")[1]
    for key, words in (part.strip().split(" ", 1) for part in named.split(",")):
        for word in words.split(" or "):
            settings.load(None, {**given, key: int(word)})


@pytest.mark.parametrize("name", settings.presets())
def test_every_preset_fits_a_small_machine(name):
    assert preflight.estimated_bytes(settings.load(name)) < 2 * 2**30


def test_the_memory_estimate_grows_with_seeds_and_counts_the_pool_only_in_self_play():
    one, two = (settings.load("smoke", {"train.num_seeds": count}) for count in (1, 2))
    assert preflight.estimated_bytes(two) == 2 * preflight.estimated_bytes(one)
    played = settings.load("smoke", {"selfplay.probability": 0.2})
    # 3 slots (the players as each of three chunks begins, the untrained one first) of 35-32-32-4 with a log-std per action, four bytes each.
    weights = 36 * 32 + 33 * 32 + 33 * 4 + 4
    assert preflight.estimated_bytes(played) - preflight.estimated_bytes(one) == 4 * 3 * weights
    spread = settings.load("smoke", {"selfplay.probability": 0.2, "selfplay.scope": "environment"})
    more = preflight.estimated_bytes(spread) - preflight.estimated_bytes(played)
    assert more == 4 * weights * spread.train.num_envs  # each environment holds a policy of its own


def test_where_memory_and_disk_cannot_be_told_nothing_is_refused(monkeypatch):
    monkeypatch.setattr(preflight, "machine_bytes", lambda: None)
    monkeypatch.setattr(preflight, "free_bytes", lambda path: None)
    settings.load(None, {"train.num_envs": 10**6, "train.num_seeds": 1024}, check_machine=True)


def test_a_run_from_a_larger_machine_can_still_be_read(monkeypatch):
    monkeypatch.setattr(preflight, "machine_bytes", lambda: 1)
    assert settings.load("smoke").train.num_envs == 64


def test_this_machine_has_memory():
    there = preflight.machine_bytes()
    assert there is None or there > 2**28


# Comparing and naming


def test_diff_names_what_differs():
    a, b = Config(), settings.load(None, {"game.scenario": "solo", "learn.epochs": 3, "train.total_steps": 8_000_000})
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


def test_a_setting_of_a_type_without_a_reader_is_noticed():
    @dataclasses.dataclass
    class Odd:
        when: complex = 1j

    with pytest.raises(TypeError, match=r"when: settings of type .* are not supported"):
        schema.settings_of(Odd)


def test_settings_import_neither_jax_nor_mujoco():
    program = (
        "import sys; from dronecombat_jax import settings; settings.load('smoke');"
        "print(sorted({'jax', 'mujoco', 'numpy', 'tyro'} & sys.modules.keys()))"
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    assert result.stdout == "[]\n"


def test_devices_must_divide_seeds_and_environments():
    assert settings.load("smoke", {"train.num_seeds": 4, "run.devices": 2}).run.devices == 2
    assert settings.load("smoke", {"train.num_seeds": 1, "run.devices": 4}).run.devices == 4
    with pytest.raises(UserError) as error:  # 64 environments, mini-batches of 256
        settings.load("smoke", {"train.num_seeds": 4, "run.devices": 12})
    message = error.value.message
    assert "run.devices = 12: 4 for the seeds (train.num_seeds = 4) leave 3 for the environments of each" in message
    assert "train.num_envs = 64 and a mini-batch of 256; nearest that fit: 4, 8, 16, 32" in message


@pytest.mark.parametrize(
    ("seeds", "wanted", "available", "expected"),
    [(1, 0, 2, 1), (2, 0, 2, 2), (3, 0, 2, 1), (8, 0, 6, 4), (8, 2, 1, 2), (5, 0, 64, 5)],
)
def test_seeds_are_spread_evenly(seeds, wanted, available, expected):
    assert preflight.spread(seeds, wanted, available) == expected
    assert preflight.mesh_shape(seeds, wanted, available) == (expected, 1)


@pytest.mark.parametrize(
    ("seeds", "wanted", "expected"), [(1, 2, (1, 2)), (2, 8, (2, 4)), (6, 4, (2, 2)), (4, 12, (4, 3))]
)
def test_more_devices_than_seeds_go_to_the_environments(seeds, wanted, expected):
    assert preflight.mesh_shape(seeds, wanted, wanted) == expected


def test_self_play_needs_two_sides():
    with pytest.raises(UserError) as error:
        settings.load("solo", {"selfplay.probability": 0.2})
    assert error.value.message.startswith("--selfplay.probability: selfplay.probability = 0.2 needs game.scenario")


def test_a_run_that_will_not_fit_on_the_disk_is_refused_with_what_needs_less(monkeypatch):
    monkeypatch.setattr(preflight, "free_bytes", lambda path: 2**30)
    long = {"train.total_steps": 1_200_000_000, "run.directory": "/somewhere"}
    with pytest.raises(UserError, match=r"2001 chunks need about 4\.\d+ GiB on the disk of /somewhere.*1 GiB are free"):
        settings.load("duel", {**long, "train.total_steps": 2001 * 600_000}, check_machine=True)
    settings.load("duel", long | {"run.keep": "every 10"}, check_machine=True)
    settings.load("duel", long | {"run.keep": "last 5"}, check_machine=True)


@pytest.mark.parametrize("text", ["", "none", "every", "every 0", "last -1", "every 2 ", "EVERY 3", "last 1.5"])
def test_which_checkpoints_stay_has_three_forms(text):
    with pytest.raises(UserError, match=r'run\.keep = .* must be "all", "every N" or "last N"'):
        settings.load("smoke", {"run.keep": text})


def test_how_many_checkpoints_are_left():
    kept = lambda keep: preflight.kept_checkpoints(settings.load("duel", {"run.keep": keep}))  # 34 chunks, 0 to 34
    # every 10: 0, 10, 20, 30, and the newest two 33, 34
    assert [kept("all"), kept("every 10"), kept("last 5"), kept("last 1"), kept("every 1")] == [35, 6, 5, 2, 35]

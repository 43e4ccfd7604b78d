"""The check of a single setting: type, range, choices and names."""

import dataclasses
import math
import tomllib

import pytest
from hypothesis import HealthCheck
from hypothesis import given as over
from hypothesis import settings as limits
from hypothesis import strategies as st
from refusals import errors_of

from dronecombat_jax.config import schema, settings
from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import UserError

# Other work may share the machine: nothing here is about time.
UNHURRIED = limits(deadline=None, suppress_health_check=[HealthCheck.too_slow], database=None)


NUMBERS = [entry for entry in settings.SCHEMA.values() if entry.low is not None]


def by_key(entry: schema.Setting) -> str:
    """The name of a parametrised test."""
    return entry.key


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
    (
        "learn.learning_rate",
        '"1e-3"',
        "must be a number above 0, at most 1; write 1e-3 without quotes",
    ),
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
    below = (
        int(entry.low) - 1
        if whole
        else entry.low
        if entry.low_open
        else math.nextafter(entry.low, -math.inf)
    )
    lowest = (
        int(entry.low)
        if whole
        else math.nextafter(entry.low, math.inf)
        if entry.low_open
        else entry.low
    )
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
        assert [line.split()[0] for line in lines] == [
            settings.flag(key) for key in values if key in bad
        ]
        return
    try:
        config = settings.load(None, values)
    except UserError:
        return  # a rule across settings
    loaded = schema.flatten(config)
    assert all(
        loaded[key] == (tuple(value) if isinstance(value, list) else value)
        for key, value in values.items()
    )


@UNHURRIED
@over(data=st.data())
def test_any_configuration_comes_back_from_toml_exactly(data):
    values = {key: data.draw(allowed_values(entry)) for key, entry in settings.SCHEMA.items()}
    config = schema.build(Config, values)
    read_back = {
        f"{s}.{k}": v
        for s, part in tomllib.loads(settings.to_toml(config)).items()
        for k, v in part.items()
    }
    assert {
        key: settings.SCHEMA[key].normal(value) for key, value in read_back.items()
    } == schema.flatten(config)


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


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (
            "[train]\nnum_env = 3\n",
            2,
            "train.num_env = 3: unknown setting; did you mean train.num_envs?",
        ),
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
        (
            "qqqqq = 3\n",
            1,
            "there are: sim, defender, attacker, randomise, sensor, game, reward, learn, selfplay, train, run",
        ),
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
    wrong = (
        name[:at]
        + data.draw(st.sampled_from("qxz").filter(lambda letter: letter != name[at]))
        + name[at + 1 :]
    )
    (line,) = errors_of(None, {f"{section}.{wrong}": 1})
    assert "unknown setting; " in line
    assert len(name) < 6 or "did you mean" in line


def test_a_setting_of_a_type_without_a_reader_is_noticed():
    @dataclasses.dataclass
    class Odd:
        when: complex = 1j

    with pytest.raises(TypeError, match=r"when: settings of type .* are not supported"):
        schema.settings_of(Odd)

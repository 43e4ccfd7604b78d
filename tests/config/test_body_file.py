"""A body's TOML: every key checked, every mistake one line with file, line, key and what is allowed."""

from pathlib import Path

import numpy as np
import pytest
from own_bodies import FIRMWARE, write_body

from dronecombat_jax.config import settings
from dronecombat_jax.config.body_file import KEYS, is_file, read_body
from dronecombat_jax.errors import EXIT_CONFIG, UserError


def refused(path: Path) -> list[str]:
    with pytest.raises(UserError) as raised:
        read_body(str(path))
    assert raised.value.exit_code == EXIT_CONFIG
    return [line.removeprefix(str(path)) for line in raised.value.message.splitlines()]


def test_every_key_is_read(tmp_path: Path):
    given = read_body(str(write_body(tmp_path)))
    assert given.keys() == KEYS.keys() and given["mass"] == 0.029
    assert given["rotor_positions"][0] == (0.046 / 2**0.5, -(0.046 / 2**0.5))
    assert given["rotor_directions"] == (-1.0, 1.0, -1.0, 1.0)


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("mass", "-1", ":1: mass = -1: must be a number above 0, at most 1000 kg"),
        ("mass", "true", ":1: mass = true: must be a number"),
        ("mass", '"1"', ':1: mass = "1": must be a number'),
        ("mass", "nan", ":1: mass = nan: must be a number"),
        ("mass", "inf", ":1: mass = inf: must be a number"),
        ("mass", "1" + 400 * "0", ": must be a number above 0, at most 1000 kg"),
        ("inertia", "[1e-5, 1e-5]", ":2: inertia = [1e-05, 1e-05]: must be a list of 3 numbers above 0"),
        ("inertia", "[1e-5, 1e-5, 3e-5]", "no body has one above the sum of the two others"),
        ("rotor_positions", "[[1, 1], [1, -1], [-1, 1]]", "must be a list of 4 lists of 2 numbers from -100 to 100 m"),
        ("rotor_positions", "[[1, 1], [1, -1], [-1, 1], [1, 2, 3]]", "must be a list of 4 lists of 2"),
        ("rotor_directions", "[1, -1, 1, 0]", "must be a list of 4 of -1 and 1"),
        ("min_thrust", "0.2", "min_thrust = 0.2: must be below max_thrust = 0.1125 N"),
        ("max_thrust", "0.07", "max_thrust = 0.07: four of it do not lift mass = 0.029 kg, 0.2845 N"),
        ("lag_up", "0", "lag_up = 0: must be a number above 0, at most 10 s"),
        ("lag_upp", "0.1", "lag_upp: no such key of a body; did you mean lag_up?"),
        ("drag", "0.1", "drag = 0.1: must be a list of 3 numbers from 0 to 1000 N s/m"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line(tmp_path: Path, key: str, value: str, line: str):
    lines = refused(write_body(tmp_path, **{key: value}))
    assert len(lines) == 1 and line in lines[0], lines


def test_all_mistakes_are_told_at_once(tmp_path: Path):
    lines = refused(write_body(tmp_path, mass="0", drag="[1, 2]", colour='"red"'))
    assert [line.split(": ")[1].split(" ")[0] for line in lines] == ["mass", "drag", "colour"]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", ": the file is empty; it may hold mass, inertia, "),
        ("mass = ", ": not valid TOML: Invalid value"),
        ("[body]\nmass = 1\n", ":1: body: no such key of a body"),
        ("\ufeffmass = 1\n", ":1: starts with a byte-order mark"),
    ],
)
def test_what_is_no_body(tmp_path: Path, text: str, line: str):
    file = tmp_path / "body.toml"
    file.write_text(text)
    (told,) = refused(file)
    assert line in told
    assert "no such file" in refused(tmp_path / "none.toml")[0]


def test_a_training_is_refused_before_jax_and_a_setting_takes_a_file(tmp_path: Path):
    good, bad = write_body(tmp_path), write_body(tmp_path, "bad.toml", mass="0", lag_up="-1")
    config = settings.load(None, {"sim.body": str(good)}, check_machine=True)
    assert settings.from_toml(settings.to_toml(config), "x") == config
    assert is_file(settings.as_run(config, "p").sim.body)
    with pytest.raises(UserError) as raised:
        settings.load(None, {"sim.body": str(bad)}, check_machine=True)
    lines = raised.value.message.splitlines()
    assert len(lines) == 2 and all(line.startswith(f"--sim.body: {bad}:") for line in lines)
    with pytest.raises(UserError, match=r"or a file of your own, NAME\.toml"):
        settings.load(None, {"sim.body": "isac"})
    assert len(FIRMWARE) == len(KEYS)


def test_the_example_in_the_documentation_is_a_body(tmp_path: Path):
    page = (Path(__file__).parents[2] / "docs" / "own_drone.md").read_text()
    file = tmp_path / "body.toml"
    file.write_text(page.split("```toml\n")[1].split("```")[0])
    given, wanted = read_body(str(file)), read_body(str(write_body(tmp_path, "firmware.toml")))
    assert given.keys() == wanted.keys()
    for key, value in given.items():
        np.testing.assert_allclose(value, wanted[key], rtol=2e-3)

"""The digest changes with what a policy meets, settings and scene, and with nothing else."""

import dataclasses
import json
import shutil

import pytest
from drones import SMALL, write

from dronecombat_jax.combat import fingerprint
from dronecombat_jax.combat.fingerprint import (
    environment,
    environment_diff,
    environment_digest,
    game_diff,
    own_view,
)
from dronecombat_jax.combat.observe import layout_of
from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import (
    Config,
    GameConfig,
    LearnConfig,
    RewardConfig,
    SimConfig,
    TrainConfig,
)
from dronecombat_jax.sim import source
from dronecombat_jax.sim.flown import package_scene
from dronecombat_jax.sim.scene import load_scene
from dronecombat_jax.types import SIDES

NOT_MET = ("game.random_clock", "sim.mjcf")  # what an MJCF says is met, wherever it lies
GAME = ("sim.", "game.", "defender.", "attacker.", "randomise.", "sensor.")
GAME_SETTINGS = [key for key in settings.SCHEMA if key.startswith(GAME) and key not in NOT_MET]
# As released with commit 87207b8: old runs resume, old policy files fly, old tournaments go on.
GOLDEN = {
    "isaac": "a0cabf39930b8c88061e05d8120d1e5c794c74a9e37e1818b2d3bceb77137d5e",
    "firmware": "e37a991a024d9bc5484e12b2276f6eefd1ecd704576420c5acb21b782504eccc",
    "menagerie": "c8fd5097b5ee755bc085b59f6b06609370116d4c4ad67e87b16c6a46dc1c622c",
    "p250": "2c1ee334b9dbeadb9965a7696c970f972a0f015ca3a3f47441e7dd8ce4432947",
}


def of_both(**values) -> dict:
    return {f"scene.{role}.{key}": value for role in SIDES for key, value in values.items()}


EDITS = {
    "mass": ('mass="0.0282"', 'mass="1.325"', of_both(mass=1.325)),
    "inertia": (
        "2.1236e-5 2.1320e-5 3.5412e-5",
        "2.2e-5 2.1320e-5 3.5412e-5",
        of_both(inertia=[2.2e-5, 2.1320e-5, 3.5412e-5]),
    ),
    "products of inertia": (
        'diaginertia="2.1236e-5 2.1320e-5 3.5412e-5"',
        'fullinertia="2.1e-5 2.2e-5 3.5e-5 1e-6 0 0"',
        of_both(inertia=[2.1e-5, 2.2e-5, 3.5e-5, 1e-6, 0, 0]),
    ),
    "gravity": ("-9.81", "-3.71", {"scene.gravity": 3.71}),
    "fluid": ("<option ", '<option density="1.2" ', {"scene.density": 1.2, "scene.viscosity": 0.0}),
    "wind": (
        "<option ",
        '<option viscosity="1e-4" wind="0 2 0" ',
        {"scene.density": 0.0, "scene.viscosity": 1e-4, "scene.wind": [0.0, 2.0, 0.0]},
    ),
    "colours alone": ('rgba="0.12 0.47 0.95 1"', 'rgba="1 0 0 1"', {}),
    "wind in a vacuum": ("<option ", '<option wind="0 2 0" ', {}),
}


@pytest.fixture
def edited(tmp_path, monkeypatch):
    """`edited(old, new)`: the package's combat.xml is edited where it stands, from now on."""
    folder = shutil.copytree(source.find_mjcf_dir(), tmp_path / "mjcf")
    monkeypatch.setattr(source, "find_mjcf_dir", lambda: folder)

    def edit(old: str, new: str):
        text = (folder / "combat.xml").read_text()
        assert old in text
        (folder / "combat.xml").write_text(text.replace(old, new))

    return edit


@pytest.mark.parametrize("body", GOLDEN)
def test_the_packages_own_scene_keeps_its_digest(body):
    assert environment_digest(Config(sim=SimConfig(body=body))) == GOLDEN[body]


def test_the_scene_says_what_its_reference_says():
    """The numbers in the code that an edited MJCF is compared with."""
    assert load_scene(SimConfig()).flown == package_scene("isaac")


@pytest.mark.parametrize("edit", EDITS)
def test_an_edited_scene_is_another_game_and_says_what_differs(edit, edited):
    old, new, wanted = EDITS[edit]
    before = environment(Config())
    edited(old, new)
    here = environment(Config())
    assert {key: value for key, value in here.items() if key.startswith("scene.")} == wanted
    assert (environment_digest(Config()) == GOLDEN["isaac"]) == (not wanted)
    lines = environment_diff(before, here)
    assert [line.split(" is ")[0] for line in lines] == sorted(wanted)
    assert all(" is the package's own there, " in line for line in lines)
    assert environment(Config(), load_scene(SimConfig())) == here
    assert json.loads(json.dumps(here)) == here


def test_an_edit_that_sim_body_replaces_is_not_met(edited):
    edited('mass="0.0282"', 'mass="1.325"')
    assert environment_digest(Config(sim=SimConfig(body="p250"))) == GOLDEN["p250"]


def test_an_own_drone_is_known_by_its_numbers_and_not_by_its_place(tmp_path):
    """Wherever it lies it is the same game; with the package's numbers it is the package's."""
    (tmp_path / "moved").mkdir()
    folders = tmp_path, tmp_path / "moved"
    first, moved = (environment(Config(sim=SimConfig(mjcf=str(write(at))))) for at in folders)
    assert first == moved
    assert first["scene.attacker.mass"] == 0.027 and first["scene.density"] == 1.225
    same = write(
        tmp_path,
        SMALL,
        ('density="1.225" viscosity="1.8e-5"', ""),
        ("0.027", "0.0282"),
        ("2.3951e-5 2.3951e-5 3.2347e-5", "2.1236e-5 2.1320e-5 3.5412e-5"),
        name="same.xml",
    )
    assert environment_digest(Config(sim=SimConfig(mjcf=str(same)))) == GOLDEN["isaac"]


def test_axes_of_drag_are_part_of_the_game(tmp_path):
    """One inertia tensor, two boxes: two equal moments, and axes turned in their plane."""
    tilted = ('pos="0 0 0" mass', 'pos="0 0 0" quat="0.9238795 0.3826834 0 0" mass')
    other = ('pos="0 0 0" mass', 'pos="0 0 0" quat="0.9238795 0.3826834 0 0.1" mass')
    met = lambda turn: environment(Config(sim=SimConfig(mjcf=str(write(tmp_path, SMALL, turn)))))
    assert "scene.defender.axes" in met(tilted) and met(tilted) != met(other)


def other_value(key: str):
    entry = settings.SCHEMA[key]
    if entry.kind == "bool":
        return not entry.default
    if entry.kind == "choice":
        return next(choice for choice in entry.choices if choice != entry.default)
    other = entry.low if entry.default == entry.high else entry.high
    return entry.high if entry.kind == "int" else (entry.default + other) / 2


@pytest.mark.parametrize("key", GAME_SETTINGS)
def test_every_setting_of_the_game_changes_the_digest(key):
    section, name = key.split(".")
    part = dataclasses.replace(getattr(Config(), section), **{name: other_value(key)})
    config = dataclasses.replace(Config(), **{section: part})
    assert environment_digest(config) != environment_digest(Config())
    changed = environment_diff(environment(config), environment(Config()))
    assert [
        line.split(" is ")[0]
        for line in changed
        if not line.startswith(("observation_fields", "rotors."))
    ] == [key]


def test_nothing_else_changes_it():
    same = Config(
        sim=SimConfig(moment_scale=0.01, max_body_rate=100),  # 100 for 100.0
        game=GameConfig(random_clock=False),
        reward=RewardConfig(win=1.0),
        learn=LearnConfig(hidden_sizes=(8,)),
        train=TrainConfig(seed=4),
    )
    assert environment_digest(same) == environment_digest(Config())
    assert environment_diff(environment(same), environment(Config())) == []


def test_a_new_version_of_the_game_changes_it(monkeypatch):
    before = environment_digest(Config())
    monkeypatch.setattr(fingerprint, "ENVIRONMENT_VERSION", 2)
    assert environment_digest(Config()) != before


def test_a_setting_that_came_later_leaves_the_game_before_it_alone():
    assert environment_digest(Config()) == environment_digest(
        Config(game=GameConfig(spawn_spread=0, defender_spread=0))
    )
    assert {"game.spawn_spread", "game.defender_spread"}.isdisjoint(
        environment(Config())
    )  # checkpoints and policies from before it go on flying
    assert environment(Config(game=GameConfig(spawn_spread=1)))["game.spawn_spread"] == 1.0


def test_what_is_missing_on_one_side_is_a_difference():
    lines = environment_diff(
        {"version": 1, "game.wind": 2.0}, {"version": 1, "game.spawn": "fixed"}
    )
    assert lines == [
        'game.spawn is nothing there, "fixed" here',
        "game.wind is 2.0 there, nothing here",
    ]


def test_fields_of_both_observations():
    world, ego = (layout_of(name, GameConfig()).fields for name in ("world", "ego"))
    assert sum(size for _, size in world) == sum(size for _, size in ego) == 35
    assert [name for name, _ in world][:5] == ["p_d", "q_d", "p_a", "q_a", "p_t"]
    assert [name for name, _ in ego][:7] == [
        "p_self",
        "q_self",
        "p_other",
        "q_other",
        "p_t",
        "v_self",
        "w_self",
    ]
    assert json.loads(json.dumps(environment(Config()))) == environment(Config())


def test_what_a_policy_sees_is_its_own_affair_as_long_as_it_is_known_and_the_same():
    game = GameConfig()
    here = environment(Config())
    saved = environment(Config(game=GameConfig(observation="ego", intercept_radius=0.3)))
    assert own_view(saved, game) == "ego" and own_view(here, game) == own_view(None, game) == ""
    (line,) = game_diff(saved, here, game)
    assert line.startswith("game.intercept_radius is 0.3 there")
    renamed = saved | {"game.intercept_radius": game.intercept_radius, "observation_fields": []}
    (line,) = game_diff(renamed, here, game)
    assert line.startswith("observation_fields is [] there")
    strange = saved | {"game.observation": "mine:look"}
    assert own_view(strange, game) == "" and len(game_diff(strange, here, game)) == 3

"""What a checkpoint says about itself, and what is refused at a resume."""

import shutil
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from drones import SMALL, write
from toy import CONFIG, Coasting

from dronecombat_jax.combat.fingerprint import digest_of, environment
from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.errors import UserError
from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.manifest import CheckpointError, Manifest
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.runs import provenance
from dronecombat_jax.runs.provenance import check_meta, describe
from dronecombat_jax.runs.resume import Start, read_start, restored_state
from dronecombat_jax.runs.saving import Saver
from dronecombat_jax.selfplay.chunk import init_state
from dronecombat_jax.sim import source
from dronecombat_jax.sim.scene import load_scene


@pytest.fixture
def start(tmp_path: Path) -> Start:
    """A checkpoint that the toy's settings were saved with."""
    return Start(tmp_path, Manifest(4, "", (), (), describe(CONFIG, 4)), CONFIG)


def with_meta(start: Start, meta: dict) -> Start:
    return start._replace(manifest=start.manifest._replace(meta=meta))


def test_the_meta_holds_settings_environment_and_versions(start):
    assert settings.from_toml(start.meta["config"], "meta") == CONFIG
    assert (
        start.meta["steps"] == 4 * CONFIG.steps_per_iteration
        and len(start.meta["environment_digest"]) == 64
    )
    assert (
        start.meta["jax"] == jax.__version__ and start.meta["random"]["generator"] == "threefry2x32"
    )
    assert check_meta(start, CONFIG) == []
    assert check_meta(with_meta(start, {}), CONFIG) == []  # an older one says nothing


def test_another_environment_under_the_same_settings_is_refused_with_what_differs(start):
    """As after an update that observes something else; other settings are a changed configuration."""
    then = start.meta["environment"] | {
        "observation_fields": [["p_d", 3]],
        "game.episode_steps": 21,
    }
    other = with_meta(start, start.meta | {"environment": then})
    with pytest.raises(CheckpointError) as caught:
        check_meta(other, CONFIG)
    assert (
        'game.episode_steps is 21 there, 20 here; observation_fields is [["p_d", 3]] there'
        in caught.value.message
    )
    assert "--fork NEW_NAME" in caught.value.message and "\n" not in caught.value.message
    assert check_meta(other._replace(changed=("no setting",)), CONFIG) == []  # a fork may


def test_an_edited_scene_is_refused_with_what_differs(start, tmp_path, monkeypatch):
    """The package's MJCF, edited where it stands: the settings are the same, the physics is not."""
    folder = shutil.copytree(source.find_mjcf_dir(), tmp_path / "mjcf")
    file = folder / "combat.xml"
    file.write_text(file.read_text().replace('mass="0.0282"', 'mass="1.325"'))
    monkeypatch.setattr(source, "find_mjcf_dir", lambda: folder)
    with pytest.raises(CheckpointError) as caught:
        check_meta(start, CONFIG)
    assert "scene.defender.mass is the package's own there, 1.325 here" in caught.value.message
    assert "--fork NEW_NAME" in caught.value.message and "\n" not in caught.value.message
    assert check_meta(start._replace(changed=("no setting",)), CONFIG) == []  # a fork may


def test_an_own_drone_that_was_moved_goes_on_and_one_that_was_edited_does_not(tmp_path):
    here = replace(CONFIG, sim=SimConfig(mjcf=str(write(tmp_path))))
    start = Start(tmp_path, Manifest(4, "", (), (), describe(here, 4)), here)
    moved = replace(CONFIG, sim=SimConfig(mjcf=str(write(tmp_path, name="moved.xml"))))
    assert check_meta(start, moved) == []
    edited = write(tmp_path, SMALL, ('density="1.225"', 'density="1"'), name="edited.xml")
    with pytest.raises(CheckpointError, match=r"scene.density is 1.225 there, 1.0 here"):
        check_meta(start, replace(CONFIG, sim=SimConfig(mjcf=str(edited))))
    with pytest.raises(
        CheckpointError, match=r"scene.attacker.mass is 0.027 there, the package's own here"
    ):
        check_meta(start, CONFIG)
    with pytest.raises(
        UserError, match=r"sim.mjcf: .*gone.xml: no such file .*drone.xml, edited.xml, moved.xml"
    ):
        check_meta(start, replace(CONFIG, sim=SimConfig(mjcf=str(tmp_path / "gone.xml"))))


@pytest.mark.long
def test_a_scene_that_is_edited_or_lost_while_it_flies_is_saved_as_it_flies(tmp_path):
    """A training flies the scene that it loaded; a lost file must not cost a checkpoint."""
    config = replace(CONFIG, sim=SimConfig(mjcf=str(write(tmp_path))))
    saver = Saver(RunDirectory(tmp_path), config, None, {})
    saver.met = environment(config, load_scene(config.sim))
    for edit in (("0.027", "0.05"), None):
        (tmp_path / "drone.xml").unlink() if edit is None else write(tmp_path, SMALL, edit)
        iteration = np.array([2 if edit else 4], np.int32)
        saver.save_now(init_state(Coasting(CONFIG)).replace(iteration=iteration))
    for iteration in (2, 4):
        meta = read_start(RunDirectory(tmp_path), iteration).meta
        assert meta["environment"]["scene.defender.mass"] == 0.027
        assert meta["environment_digest"] == digest_of(meta["environment"])


def test_other_random_numbers_are_refused_and_another_jax_is_told(start, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(provenance, "_random", lambda: {"generator": "rbg", "partitionable": True})
        with pytest.raises(CheckpointError, match=r"threefry2x32.*JAX is set to generator rbg"):
            check_meta(start, CONFIG)
    older = with_meta(start, start.meta | {"jax": "0.4.1"})
    assert check_meta(older, CONFIG) == [
        f"note: made with jax 0.4.1, goes on with {jax.__version__}: no longer the same bits"
    ]


def test_another_network_is_refused_by_its_first_tensors(tmp_path):
    wide = replace(CONFIG, learn=replace(CONFIG.learn, hidden_sizes=(4,)))
    shapes = jax.eval_shape(lambda: init_state(Coasting(wide)))
    state = jax.tree.map(lambda leaf: np.ones(leaf.shape, leaf.dtype), shapes)
    checkpoint.save(tmp_path / "checkpoints", 4, state, describe(CONFIG, 4))
    start = read_start(RunDirectory(tmp_path), 4)
    with pytest.raises(
        CheckpointError, match=r"expected float32\[1,2,35,8\], got float32\[1,2,35,4\].* more"
    ):
        restored_state(start, CONFIG, Coasting(CONFIG))

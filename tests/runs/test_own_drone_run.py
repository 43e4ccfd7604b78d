"""A run of an own drone by the command line: trained, moved, edited and lost."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from drones import SMALL, write
from tiny import finish, train

from dronecombat_jax.config.fields import Config, SimConfig
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA
from dronecombat_jax.files import checkpoint
from dronecombat_jax.runs.resume import difference


@pytest.mark.slow
def test_a_run_goes_on_with_the_drone_that_it_began_with(tmp_path: Path):
    """Moved it goes on; edited, left out or lost it is one line that says what differs."""
    root, first = tmp_path / "runs", write(tmp_path)
    longer = ("--steps", "768")

    def run(*flags: str) -> tuple[int, str, str]:
        return finish(train(root, "own", *flags))

    code, out, err = run("--sim.mjcf", str(first), "--steps", "384")
    assert code == 0, err
    meta = checkpoint.read_meta(root / "own" / "checkpoints", 4)
    assert (
        meta["environment"]["scene.defender.mass"] == 0.027
        and "sim.mjcf" not in meta["environment"]
    )

    edited = write(tmp_path, SMALL, ("0.027", "0.028"), name="edited.xml")
    code, _, err = run("--sim.mjcf", str(edited), *longer)
    assert code == EXIT_DATA and "scene.defender.mass is 0.027 there, 0.028 here" in err
    code, _, err = run(*longer)
    assert code == EXIT_DATA and "scene.attacker.mass is 0.027 there, the package's own here" in err
    first.unlink()
    code, _, err = run("--sim.mjcf", str(first), *longer)
    assert code == EXIT_CONFIG and err.count("\n") == 1
    assert err.startswith(
        f"error: sim.mjcf: {first}: no such file (MJCF files in {tmp_path}: edited.xml)"
    )

    code, out, err = run("--sim.mjcf", str(write(tmp_path, name="moved.xml")), *longer)
    assert code == 0 and "resuming after 384 environment steps" in out, err
    assert len(json.loads((root / "own" / "evaluation.json").read_text())) == 2


def test_a_bodys_file_may_have_been_moved_and_no_more():
    """What it says is compared as the environment; a body by name is another run."""
    of = lambda body: Config(sim=replace(SimConfig(), body=body))
    assert difference(of("/a/body.toml"), of("/b/moved.toml")) == []
    (line,) = difference(of("isaac"), of("/b/moved.toml"))
    assert line.startswith('sim.body was "isaac", now')
    assert len(difference(of("/a/body.toml"), of("firmware"))) == 1

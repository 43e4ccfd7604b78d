"""Killed writers, truncation, flipped bytes and planted decoys: equal, or an error, never something
else.
"""

import contextlib
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from saved_runs import newest
from saved_steps import META, equal_or_error, files_of, small_state

from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.atomic import sweep
from dronecombat_jax.files.checkpoint import CheckpointError
from dronecombat_jax.files.manifest import SCHEMA, NewerCheckpoint

# Forks children that have imported everything, so that a kill costs the saves and not the imports.
KILLER = """
import os, random, signal, sys, time
from pathlib import Path
import jax, orbax.checkpoint, numpy as np
from dronecombat_jax.files import checkpoint

directory, moments = Path(sys.argv[1]), random.Random(1)
log = directory / "acknowledged"
log.touch()
for trial in range(8):
    before = log.read_bytes().count(b"\\n")
    child = os.fork()
    if child == 0:
        acknowledged = os.open(log, os.O_WRONLY | os.O_APPEND)
        for step in range(trial * 100, trial * 100 + 100):
            state = {"a": np.random.default_rng(step).standard_normal(50_000).astype(np.float32)}
            checkpoint.save(directory / "checkpoints", step, state, {"trial": trial})
            os.write(acknowledged, b"%d\\n" % step)
        os._exit(0)
    while log.read_bytes().count(b"\\n") < before + trial % 3:
        time.sleep(0.01)
    time.sleep(moments.uniform(0.0, 0.4))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
"""


@pytest.mark.long
def test_kill_9_while_saving(tmp_path: Path):
    (tmp_path / "checkpoints").mkdir()
    environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
    subprocess.run(
        [sys.executable, "-W", "ignore", "-c", KILLER, str(tmp_path)],
        check=True,
        timeout=120,
        env=environment,
    )
    acknowledged = [int(line) for line in (tmp_path / "acknowledged").read_text().split()]
    assert len(acknowledged) >= 7  # 0 + 1 + 2 + 0 + 1 + 2 + 0 + 1
    template = {"a": np.zeros(50_000, np.float32)}
    sweep(tmp_path / "checkpoints")
    found = checkpoint.steps(tmp_path / "checkpoints")
    assert set(acknowledged) <= set(found)
    assert len(found) == len(list((tmp_path / "checkpoints").iterdir()))
    for step in found:  # whatever bears a step's name is whole, acknowledged or not
        state = checkpoint.restore(tmp_path / "checkpoints", step, template)
        expected = np.random.default_rng(step).standard_normal(50_000).astype(np.float32)
        np.testing.assert_array_equal(state["a"], expected)


@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_any_byte_flipped_inserted_or_deleted(golden: Path, data: st.DataObject):
    path = data.draw(st.sampled_from(files_of(golden / "5")))
    content = path.read_bytes()
    action = data.draw(st.sampled_from(["flip", "insert", "delete"] if content else ["insert"]))
    place = data.draw(st.integers(0, len(content) - (action != "insert")))
    value = data.draw(st.integers(1, 255))
    if action == "flip":
        changed = content[:place] + bytes([content[place] ^ value]) + content[place + 1 :]
    elif action == "insert":
        changed = content[:place] + bytes([value]) + content[place:]
    else:
        changed = content[:place] + content[place + 1 :]
    try:
        path.write_bytes(changed)
        equal_or_error(golden)
    finally:
        path.write_bytes(content)


def test_every_byte_of_the_manifest(golden: Path):
    path = golden / "5" / "manifest.json"
    content = path.read_bytes()
    for place in range(len(content)):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        with contextlib.suppress(CheckpointError):
            assert checkpoint.read_meta(golden, 5) == META
    path.write_bytes(content)
    equal_or_error(golden)


def test_every_file_truncated_at_every_twentieth(golden: Path):
    for path in files_of(golden / "5"):
        content = path.read_bytes()
        for twentieth in range(20 if content else 0):
            path.write_bytes(content[: len(content) * twentieth // 20])
            with pytest.raises(CheckpointError):
                checkpoint.restore(golden, 5, small_state())
        path.write_bytes(content)
    equal_or_error(golden)


def test_every_file_missing_and_a_foreign_one_added(golden: Path):
    for path in files_of(golden / "5"):
        content = path.read_bytes()
        path.unlink()
        with pytest.raises(CheckpointError):
            checkpoint.restore(golden, 5, small_state())
        path.write_bytes(content)
    (golden / "5" / ".nfs0001").write_text("left by the file system")
    assert newest(golden) == 5
    equal_or_error(golden)


def rewrite_manifest(directory: Path, **changes: object):
    """Change fields and sign the manifest again, as a later version or an attacker would."""
    path = directory / "5" / "manifest.json"
    body = {**json.loads(path.read_text()), **changes}
    body.pop("sha256")
    text = json.dumps(body, sort_keys=True, separators=(",", ":"))
    path.write_text(json.dumps({"sha256": hashlib.sha256(text.encode()).hexdigest(), **body}))


def test_a_newer_format_says_upgrade_and_is_not_set_aside(golden: Path, tmp_path: Path):
    directory = tmp_path / "checkpoints"
    shutil.copytree(golden, directory)
    rewrite_manifest(directory, schema=SCHEMA + 1)
    for attempt in (checkpoint.latest, lambda where: checkpoint.save(where, 5, small_state(), {})):
        with pytest.raises(NewerCheckpoint, match="upgrade dronecombat-jax"):
            attempt(directory)
    assert (directory / "5").is_dir()


# tensorstore may answer after orbax has given up and closed its event loop
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    "changes",
    [
        {"digest": "0" * 64},
        {"files": [["../../secret", 6, hashlib.sha256(b"secret").hexdigest()]]},
        {"files": [["/etc/hostname", 1, "00"]]},
        {"files": []},
        {"leaves": [["a", "float32", [3, 4]]]},
        {"leaves": [["a", "float32", [10**6, 10**6]], ["b", "int32", []]]},
        {"leaves": [["a", "object", [3, 4]], ["b", "int32", []]]},
        {"leaves": "ab"},
        {"schema": "1"},
        {"meta": 3},
        {"step": None},
    ],
)
def test_a_crafted_manifest(golden: Path, tmp_path: Path, changes: dict[str, object]):
    directory = tmp_path / "checkpoints"
    shutil.copytree(golden, directory)
    (tmp_path / "secret").write_text("secret")
    rewrite_manifest(directory, **changes)
    if changes == {"files": []}:  # the digest of the arrays still guards what is read
        path = max(files_of(directory / "5" / "state" / "d"), key=lambda path: path.stat().st_size)
        path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(CheckpointError):
        checkpoint.restore(directory, 5, small_state())
    with pytest.raises(CheckpointError):
        checkpoint.load(directory, 5)

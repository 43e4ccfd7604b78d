"""Checkpoints come back bit for bit, fit their template or say why not, and refuse what is no
state.
"""

import ast
import asyncio
import errno
import os
import resource
from pathlib import Path
from typing import Any, NamedTuple

import jax
import ml_dtypes
import numpy as np
import pytest
from saved_runs import newest

import dronecombat_jax.runs
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_DATA, EXIT_DIVERGED, UserError
from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.checkpoint import CheckpointError


class Moments(NamedTuple):
    steps: np.ndarray
    mu: dict[str, np.ndarray]


def make_state(width: int = 6, offset: float = 0.0) -> dict[str, Any]:
    kernel = np.arange(3.0 * width, dtype=np.float32).reshape(3, width) + np.float32(offset)
    return {
        "defender": {"kernel": kernel, "bias": np.full(width, -0.0, np.float32)},
        "optimiser": (Moments(np.array(7, np.int32), {"kernel": kernel * 2}), None, ()),
        "pool": [np.zeros((0, 3), np.float32), np.array([True, False])],
        "log_std": np.ones(4, ml_dtypes.bfloat16),
        "statistics": np.array([1e-300, np.finfo(np.float64).max]),
        "counter": np.array([2**32 - 1, 0], np.uint32),
        "scalar": np.float32(0.1),
    }


def assert_same(left: Any, right: Any):
    assert jax.tree_util.tree_structure(left) == jax.tree_util.tree_structure(right)
    for a, b in zip(jax.tree_util.tree_leaves(left), jax.tree_util.tree_leaves(right), strict=True):
        assert isinstance(b, np.ndarray) and b.dtype == a.dtype and b.shape == a.shape
        assert a.tobytes() == b.tobytes()


def test_round_trip_is_bit_exact(tmp_path: Path):
    meta = {"steps": 2**53 + 1, "config": {"hidden_sizes": [256, 128]}, "note": "é"}
    path = checkpoint.save(tmp_path / "checkpoints", 3, make_state(), meta)
    assert path == tmp_path / "checkpoints" / "3"
    assert_same(
        make_state(), checkpoint.restore(tmp_path / "checkpoints", 3, make_state(offset=9.0))
    )
    assert checkpoint.read_meta(tmp_path / "checkpoints", 3) == meta
    arrays, manifest = checkpoint.load(tmp_path / "checkpoints", 3)
    assert manifest.step == 3 and arrays["optimiser/0/mu/kernel"].dtype == np.float32
    assert sum(1 for file in path.rglob("*") if file.is_file()) < 20


def test_template_of_shapes_and_inside_a_running_event_loop(tmp_path: Path):
    async def notebook_cell():
        checkpoint.save(tmp_path, 0, make_state(), {})
        shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), make_state())
        return checkpoint.restore(tmp_path, 0, shapes)

    assert_same(make_state(), asyncio.run(notebook_cell()))


def test_the_newest_is_the_highest_step_whatever_the_clock_says(tmp_path: Path):
    for step in (10, 9, 2):
        checkpoint.save(tmp_path, step, make_state(offset=step), {})
    os.utime(tmp_path / "2", (4e9, 4e9))
    os.utime(tmp_path / "10", (0, 0))
    assert checkpoint.steps(tmp_path) == [2, 9, 10]
    assert newest(tmp_path) == 10
    assert checkpoint.latest(tmp_path / "absent") is None


def test_a_step_that_is_there(tmp_path: Path):
    checkpoint.save(tmp_path, 1, make_state(), {"a": 1})
    before = (tmp_path / "1" / "manifest.json").read_bytes()
    checkpoint.save(tmp_path, 1, make_state(), {"a": 1})
    with pytest.raises(CheckpointError, match="never overwritten"):
        checkpoint.save(tmp_path, 1, make_state(offset=1.0), {"a": 1})
    assert (tmp_path / "1" / "manifest.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["1"]


def test_a_damaged_step_is_set_aside_and_written_anew(tmp_path: Path):
    (tmp_path / "1").mkdir()
    checkpoint.save(tmp_path, 1, make_state(), {})
    assert newest(tmp_path) == 1
    assert sum(path.name.startswith("damaged-1-") for path in tmp_path.iterdir()) == 1


def test_another_network_size_names_five_arrays_and_the_setting(tmp_path: Path):
    small = {f"layer{i}": np.zeros((35, 64), np.float32) for i in range(7)}
    large = {f"layer{i}": np.zeros((35, 256), np.float32) for i in range(7)}
    checkpoint.save(tmp_path, 0, small, {})
    with pytest.raises(CheckpointError) as caught:
        checkpoint.restore(tmp_path, 0, large, hint="Set learn.hidden_sizes to that of the run.")
    message = caught.value.message
    assert caught.value.exit_code == EXIT_DATA
    assert "layer0: expected float32[35,256], got float32[35,64]" in message
    assert message.count("expected") == 5 and "and 2 more. Set learn.hidden_sizes" in message


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"a": np.zeros(3, np.float64)}, "a: expected float64[3], got float32[3]"),
        ({"a": np.zeros((1, 3), np.float32)}, "a: expected float32[1,3], got float32[3]"),
        (
            {"b": np.zeros(3, np.float32)},
            "b: expected float32[3], got nothing; a: expected nothing, got float32[3]",
        ),
        ({"a": {"c": np.zeros(3, np.float32)}}, "a/c: expected float32[3], got nothing"),
    ],
)
def test_nothing_is_cast_broadcast_or_dropped(
    tmp_path: Path, change: dict[str, Any], complaint: str
):
    checkpoint.save(tmp_path, 0, {"a": np.ones(3, np.float32)}, {})
    with pytest.raises(CheckpointError) as caught:
        checkpoint.restore(tmp_path, 0, change)
    assert complaint in caught.value.message


def test_an_absent_step_lists_what_is_there(tmp_path: Path):
    checkpoint.save(tmp_path, 4, make_state(), {})
    with pytest.raises(CheckpointError, match=r"no checkpoint 5 .*\(there: 4\)"):
        checkpoint.restore(tmp_path, 5, make_state())


@pytest.mark.parametrize("dtype", [np.float32, np.float64, ml_dtypes.bfloat16, np.complex64])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_nan_is_neither_written_nor_read(tmp_path: Path, dtype: Any, value: float):
    bad = {"a": np.array([0.0, value], dtype), "b": np.zeros(1, np.float32)}
    with pytest.raises(UserError, match=r"NaN or infinity in a \(1 of 2\)") as caught:
        checkpoint.save(tmp_path, 0, bad, {})
    assert caught.value.exit_code == EXIT_DIVERGED and list(tmp_path.iterdir()) == []
    if dtype is np.float32:
        checkpoint.save(tmp_path, 0, bad, {}, allow_nonfinite=True)
        with pytest.raises(CheckpointError, match="refused: NaN"):
            checkpoint.restore(tmp_path, 0, bad)
        assert_same(bad, checkpoint.restore(tmp_path, 0, bad, allow_nonfinite=True))


@pytest.mark.parametrize(
    "state",
    [
        {"a": 3},
        {"a": 0.5},
        {"a": "text"},
        {"a": np.array(["text"])},
        {"a": np.array([object()])},
        {"a": np.zeros(2, [("x", np.float32)])},
        {"a": np.zeros(2, ">f4")},
        {"a": np.zeros(2, "datetime64[s]")},
    ],
)
def test_what_is_no_plain_array_is_refused(tmp_path: Path, state: dict[str, Any]):
    with pytest.raises(TypeError):
        checkpoint.save(tmp_path, 0, state, {})
    assert list(tmp_path.iterdir()) == []


def test_meta_must_be_json_and_leaves_nothing_behind(tmp_path: Path):
    for meta in ({"a": float("nan")}, {"a": np.int32(1)}, {"a": object()}):
        with pytest.raises((TypeError, ValueError)):
            checkpoint.save(tmp_path, 0, make_state(), meta)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_keeps_the_old_and_leaves_nothing(tmp_path: Path):
    noise = np.random.default_rng(0).standard_normal(100_000).astype(np.float32)
    checkpoint.save(tmp_path, 1, {"a": noise}, {})
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    # Python ignores SIGXFSZ: writes fail with EFBIG
    resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, hard))
    try:
        with pytest.raises(UserError) as caught:
            checkpoint.save(tmp_path, 2, {"a": noise + 1}, {})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert caught.value.exit_code == EXIT_CANNOT_WRITE
    assert caught.value.message.startswith(
        f"cannot write {tmp_path / '2'}: File too large; 400,000 bytes needed, "
    )
    assert [path.name for path in tmp_path.iterdir()] == ["1"]
    assert newest(tmp_path) == 1
    checkpoint.save(tmp_path, 2, {"a": noise + 1}, {})  # the retry at the next boundary
    assert newest(tmp_path) == 2


def test_a_disk_that_fills_up_at_the_manifest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(descriptor: int, data: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr("dronecombat_jax.files.atomic.os.write", full)
        with pytest.raises(UserError, match="No space left on device"):
            checkpoint.save(tmp_path, 1, make_state(), {})
    assert list(tmp_path.iterdir()) == []


def test_a_directory_that_went_away_does_not_come_back_empty(tmp_path: Path):
    with pytest.raises(UserError) as caught:
        checkpoint.save(tmp_path / "moved-run" / "checkpoints", 1, make_state(), {})
    assert caught.value.exit_code == EXIT_CANNOT_WRITE and not (tmp_path / "moved-run").exists()


def test_the_room_never_unpickles():
    room = Path(dronecombat_jax.runs.__file__).parent
    for source in room.glob("*.py"):
        for node in ast.walk(ast.parse(source.read_text())):
            names = (
                [alias.name for alias in node.names]
                if isinstance(node, ast.Import | ast.ImportFrom)
                else []
            )
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not {"pickle", "cloudpickle", "dill", "shelve", "marshal"} & set(names), source
            if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                assert isinstance(node.value, ast.Constant) and node.value.value is False, source


def test_leaves_of_an_older_name(tmp_path: Path):
    """Who is down was called `out` up to format 2: such a checkpoint is read by today's names, and is
    the same checkpoint when its run comes by that step again.
    """
    down = np.array([[True, False]])
    checkpoint.save(tmp_path, 3, {"env": {"out": down}}, {})
    template = {"env": {"down": down}}
    np.testing.assert_array_equal(checkpoint.restore(tmp_path, 3, template)["env"]["down"], down)
    assert list(checkpoint.load(tmp_path, 3)[0]) == ["env/down"]
    checkpoint.save(tmp_path, 3, template, {})
    with pytest.raises(CheckpointError, match="other arrays"):
        checkpoint.save(tmp_path, 3, {"env": {"down": ~down}}, {})

"""The record of a run: appended line by line, cut at a resume, never torn in the middle."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_DATA, UserError
from dronecombat_jax.files.metrics import MetricsWriter, read, truncate_after


def record(iteration: int, seed: int = 0, **more: object) -> dict[str, object]:
    return {
        "iteration": iteration,
        "steps": 24_000 * iteration,
        "seed": seed,
        "chunk": iteration // 2,
        **more,
    }


def write(path: Path, iterations: range):
    with MetricsWriter(path) as writer:
        for iteration in iterations:
            writer.write(record(iteration))


def test_scalars_of_numpy_and_nan(tmp_path: Path):
    import jax.numpy as jnp

    with MetricsWriter(tmp_path / "metrics.jsonl") as writer:
        writer.write(
            record(
                1,
                a=np.float32(0.5),
                b=math.nan,
                c=np.inf,
                d=np.int64(2**40),
                e=jnp.ones(()),
                f=None,
                g=np.True_,
            )
        )
        with pytest.raises(TypeError, match="metric a has shape"):
            writer.write(record(2, a=np.zeros(2)))
        writer.sync()
    assert read(tmp_path / "metrics.jsonl") == [
        record(1, a=0.5, b=None, c=None, d=2**40, e=1.0, f=None, g=True)
    ]


def test_append_and_cut_at_the_checkpoint(tmp_path: Path):
    path = tmp_path / "metrics.jsonl"
    assert truncate_after(path, 0) == 0
    write(path, range(1, 5))
    whole = path.read_bytes()
    assert truncate_after(path, 24_000 * 4) == 4 and path.read_bytes() == whole
    assert truncate_after(path, 24_000 * 2) == 2
    write(path, range(3, 5))
    assert path.read_bytes() == whole
    assert truncate_after(path, -1) == 0 and read(path) == []


def test_a_line_torn_anywhere(tmp_path: Path):
    path = tmp_path / "metrics.jsonl"
    write(path, range(1, 4))
    lines = path.read_bytes().splitlines(keepends=True)
    for length in range(len(lines[2])):
        path.write_bytes(lines[0] + lines[1] + lines[2][:length])
        assert read(path) == [record(1), record(2)]
        assert truncate_after(path, 10**9) == 2
        assert path.read_bytes() == lines[0] + lines[1]


@pytest.mark.parametrize("bad", [b"{", b"", b"3", b'{"steps": "x"}', b"\xff", b"[" * 10_000])
def test_a_damaged_line_in_the_middle(tmp_path: Path, bad: bytes, caplog: pytest.LogCaptureFixture):
    path = tmp_path / "metrics.jsonl"
    write(path, range(1, 3))
    first, second = path.read_bytes().splitlines()
    damaged = b"\n".join([first, bad, second, b""])
    path.write_bytes(damaged)
    with pytest.raises(UserError, match="line 2: not a metrics record") as caught:
        read(path)
    assert caught.value.exit_code == EXIT_DATA
    assert truncate_after(path, 10**9) == 2 and read(path) == [record(1), record(2)]
    assert (tmp_path / "metrics.jsonl.damaged").read_bytes() == damaged and "line 2" in caplog.text


def test_a_full_disk_leaves_whole_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "metrics.jsonl"
    real = os.write

    def nearly_full(descriptor: int, data: bytes) -> int:
        if len(data) < 20:
            raise OSError(28, "No space left on device")
        return real(descriptor, data[:10])

    with MetricsWriter(path) as writer:
        writer.write(record(1))
        with monkeypatch.context() as patch:
            patch.setattr(os, "write", nearly_full)
            with pytest.raises(UserError, match="No space left on device") as caught:
                writer.write(record(2))
        writer.write(record(3))
    assert caught.value.exit_code == EXIT_CANNOT_WRITE
    assert [line["iteration"] for line in read(path)] == [1, 3]


def test_unreadable_and_unwritable(tmp_path: Path):
    with pytest.raises(UserError, match="cannot read"):
        read(tmp_path / "absent.jsonl")
    with pytest.raises(UserError) as caught:
        MetricsWriter(tmp_path / "absent" / "metrics.jsonl")
    assert caught.value.exit_code == EXIT_CANNOT_WRITE


def events(folder: Path) -> list[tuple[int, dict[str, float], int]]:
    """Step, scalars and session status of every event; the framing is TFRecord's."""
    from tensorboardX.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue] - generated

    found = []
    for path in sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime_ns):
        data, place = path.read_bytes(), 0
        while place < len(data):
            length = int.from_bytes(data[place : place + 8], "little")
            event = Event.FromString(data[place + 12 : place + 12 + length])
            found.append(
                (
                    event.step,
                    {v.tag: v.simple_value for v in event.summary.value},
                    event.session_log.status,
                )
            )
            place += 16 + length
    return [event for event in found if event[1] or event[2]]


def test_tensorboard_by_seed_and_across_a_resume(tmp_path: Path):
    with MetricsWriter(tmp_path / "metrics.jsonl", tmp_path / "tensorboard") as writer:
        for iteration in (1, 2):
            for seed in (3, 4):
                writer.write(
                    record(iteration, seed, **{"win/defender": 0.25 * seed, "win/draw": math.nan})
                )
    with MetricsWriter(
        tmp_path / "metrics.jsonl", tmp_path / "tensorboard", resume_steps=24_000
    ) as writer:
        writer.write(record(2, 3, **{"win/defender": 0.5}))
    assert sorted(path.name for path in (tmp_path / "tensorboard").iterdir()) == [
        "seed-3",
        "seed-4",
    ]
    found = events(tmp_path / "tensorboard" / "seed-3")
    assert [event[0] for event in found] == [24_000, 48_000, 24_001, 48_000]
    assert found[0][1] == {"iteration": 1.0, "chunk": 0.0, "win/defender": 0.75}
    assert found[2][2] == 1  # SessionLog.START: TensorBoard drops what lies at this step and beyond
    assert len(events(tmp_path / "tensorboard" / "seed-4")) == 2

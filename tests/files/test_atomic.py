"""Files that are there whole or not at all."""

import errno
import os
from pathlib import Path

import pytest

from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError
from dronecombat_jax.files.atomic import fsync_tree, sweep, temporary_path, write_atomic


def test_replaces_text_and_bytes(tmp_path: Path):
    path = tmp_path / "config.toml"
    write_atomic(path, "seed = 1\n")
    write_atomic(path, b"seed = 2\n")
    assert path.read_text() == "seed = 2\n"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO])
def test_a_refused_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
):
    path = tmp_path / "config.toml"
    write_atomic(path, "old")
    real = os.write

    def nearly_full(descriptor: int, data: bytes) -> int:
        if len(data) <= 3:
            raise OSError(code, os.strerror(code))
        return real(descriptor, data[:3])

    monkeypatch.setattr(os, "write", nearly_full)
    with pytest.raises(UserError) as caught:
        write_atomic(path, "longer than before")
    assert caught.value.exit_code == EXIT_CANNOT_WRITE
    assert str(path) in caught.value.message and "18 bytes needed" in caught.value.message
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_a_short_write_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    real = os.write
    monkeypatch.setattr(os, "write", lambda descriptor, data: real(descriptor, data[:2]))
    write_atomic(tmp_path / "a", "seven b")
    assert (tmp_path / "a").read_text() == "seven b"


def test_sweep_takes_only_temporary_names_and_follows_no_link(tmp_path: Path):
    outside, directory = tmp_path / "outside", tmp_path / "run"
    (outside / "keep").mkdir(parents=True)
    directory.mkdir()
    temporary_path(directory / "12").mkdir()
    (temporary_path(directory / "13")).write_text("half")
    (directory / ".tmp-link").symlink_to(outside)
    (directory / "12").mkdir()
    fsync_tree(directory / "12")
    assert len(sweep(directory)) == 3
    assert [path.name for path in directory.iterdir()] == ["12"]
    assert (outside / "keep").is_dir()
    assert sweep(tmp_path / "absent") == []


def test_a_name_too_long_is_told_as_what_cannot_be_written(tmp_path: Path):
    with pytest.raises(UserError, match="File name too long") as error:
        write_atomic(tmp_path / ("x" * 250), "text")
    assert error.value.exit_code == EXIT_CANNOT_WRITE and list(tmp_path.iterdir()) == []

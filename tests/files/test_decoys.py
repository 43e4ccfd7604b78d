"""Things that only look like a newer checkpoint."""

import logging
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from saved_runs import newest
from saved_steps import equal_or_error, files_of, small_state

from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.checkpoint import CheckpointError


def plant_half_copy(good: Path, decoy: Path):
    shutil.copytree(good, decoy)
    max(files_of(decoy / "state"), key=lambda path: path.stat().st_size).unlink()


def plant_truncated(good: Path, decoy: Path):
    shutil.copytree(good, decoy)
    path = decoy / "manifest.json"
    path.write_bytes(path.read_bytes()[:-1])


def plant_zero_bytes(good: Path, decoy: Path):
    decoy.mkdir()
    (decoy / "manifest.json").touch()


def plant_text(text: str) -> Callable[[Path, Path], None]:
    def plant(good: Path, decoy: Path):
        decoy.mkdir()
        (decoy / "manifest.json").write_text(text)

    return plant


def plant_fifo(good: Path, decoy: Path):
    decoy.mkdir()
    os.mkfifo(decoy / "manifest.json")


def plant_huge(good: Path, decoy: Path):
    decoy.mkdir()
    with open(decoy / "manifest.json", "wb") as file:
        file.truncate(1 << 40)  # sparse: refused by its size, never read


def plant_linked_file(good: Path, decoy: Path):
    shutil.copytree(good, decoy)
    (decoy / "manifest.json").unlink()
    (decoy / "manifest.json").symlink_to(good / "manifest.json")


DECOYS: dict[str, Callable[[Path, Path], object]] = {
    "empty directory": lambda good, decoy: decoy.mkdir(),
    "a file": lambda good, decoy: decoy.write_text(""),
    "complete copy": shutil.copytree,
    "link to a good one": lambda good, decoy: decoy.symlink_to(good.name),
    "dangling link": lambda good, decoy: decoy.symlink_to("nowhere"),
    "half copy": plant_half_copy,
    "truncated manifest": plant_truncated,
    "manifest of 0 bytes": plant_zero_bytes,
    "manifest is a list": plant_text("[]"),
    "manifest with NaN": plant_text('{"sha256": NaN}'),
    "nested manifest": plant_text("[" * 100_000),
    "long number": plant_text("9" * 100_000),
    "manifest is a pipe": plant_fifo,
    "manifest of 1 TiB": plant_huge,
    "manifest is a link": plant_linked_file,
}


@pytest.mark.parametrize("kind", DECOYS)
def test_a_decoy_with_the_highest_step(
    golden: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture, kind: str
):
    directory = tmp_path / "checkpoints"
    shutil.copytree(golden, directory)
    DECOYS[kind](directory / "5", directory / "99")
    with pytest.raises(CheckpointError):
        checkpoint.restore(directory, 99, small_state())
    with caplog.at_level(logging.WARNING):
        assert newest(directory, set_aside=False) == 5
        assert os.path.lexists(directory / "99") and "checkpoint 99 skipped" in caplog.text
        assert newest(directory) == 5
    assert not os.path.lexists(directory / "99") and "renamed to damaged-99-" in caplog.text
    assert sum(path.name.startswith("damaged-99-") for path in directory.iterdir()) == 1
    equal_or_error(directory)


@pytest.mark.parametrize(
    "name", ["0099", "99.tmp", "-1", "99 ", "9" * 40, "\u0669", ".tmp-99-1-aa", "damaged-99-aa"]
)
def test_names_that_are_no_step_are_left_alone(golden: Path, tmp_path: Path, name: str):
    directory = tmp_path / "checkpoints"
    shutil.copytree(golden, directory)
    (directory / name).mkdir()
    assert newest(directory) == 5 and (directory / name).is_dir()

"""A tournament that is stopped, killed or damaged."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from saved_runs import damage
from small_tournament import CHUNKS
from tournaments import assert_same, words

from dronecombat_jax.errors import (
    EXIT_DATA,
    EXIT_STOPPED,
    EXIT_TOURNAMENT,
    UserError,
)
from dronecombat_jax.tournaments import flying
from dronecombat_jax.tournaments.result_file import RESULT_NAME, load_result


@pytest.mark.long
def test_a_signal_saves_and_the_same_command_goes_on(
    runs: Path, alone, place: SimpleNamespace, monkeypatch
):
    real = flying.play

    def interrupted(*args, **how):
        for count, harvest in enumerate(real(*args, **how)):
            if count == 5:
                os.kill(os.getpid(), signal.SIGTERM)
            yield harvest

    monkeypatch.setattr(flying, "play", interrupted)
    assert place.fly(*words(runs)) == EXIT_STOPPED
    first = len(place.cells)
    assert 0 < first < 36 and not (place.folder / RESULT_NAME).exists()
    with pytest.raises(UserError, match="is it complete"):
        load_result(place.folder)
    monkeypatch.setattr(flying, "play", real)
    assert place.fly(*words(runs)) == 0 and len(place.cells) == 36 - first
    assert_same(load_result(place.folder), alone.result)


@pytest.mark.long
def test_a_signal_with_the_last_fight_is_answered(
    runs: Path, alone, place: SimpleNamespace, monkeypatch
):
    real = flying.play

    def interrupted(*args, **how):
        yield from real(*args, **how)
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(flying, "play", interrupted)
    assert place.fly(*words(runs)) == EXIT_STOPPED and len(place.cells) == 36
    monkeypatch.setattr(flying, "play", real)
    assert place.fly(*words(runs)) == 0 and place.cells == []
    assert_same(load_result(place.folder), alone.result)


KILLED = """
import json, os, signal, sys
given = json.loads(sys.argv[1])
sys.path[:0] = given["paths"]
from dronecombat_jax.machine import backend
backend.prepare("cpu")
from small_tournament import LAYOUT, RULES
from toy import Coasting
from dronecombat_jax.arena import round_robin
from dronecombat_jax.tournaments import flying, tournament
tournament.Combat, round_robin.CPU_LAYOUT = Coasting, LAYOUT
flying.SAVE_SECONDS = 0.0
real, cells = round_robin.play, []
def killed(*args, **how):
    for harvest in real(*args, **how):
        cells.extend(harvest.cells)
        yield harvest
        if len(cells) >= 0.6 * 36:
            os.kill(os.getpid(), signal.SIGKILL)
flying.play = killed
tournament.tournament(given["words"], RULES, root=given["root"], name="it")
"""


@pytest.mark.long
def test_killed_at_60_per_cent_it_comes_to_the_same_counts(
    runs: Path, alone, place: SimpleNamespace
):
    tests = Path(__file__).parents[1]
    given = json.dumps(
        {"paths": [str(tests / "support")], "words": words(runs), "root": str(place.folder.parent)}
    )
    command = [sys.executable, "-W", "ignore", "-c", KILLED, given]
    environment = os.environ | {"PYTHONPATH": str(tests.parent)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == -signal.SIGKILL, done.stdout + done.stderr
    assert place.fly(*words(runs)) == 0 and 0 < len(place.cells) <= 0.4 * 36
    assert_same(load_result(place.folder), alone.result)


def test_a_damaged_shard_is_set_aside_and_its_cells_flown_again(
    runs: Path, alone, place: SimpleNamespace, caplog
):
    shutil.copytree(alone.folder, place.folder)
    for shard in (place.folder / "cells").glob("*.npz"):  # one, or more where the machine was slow
        data = bytearray(shard.read_bytes())
        data[len(data) // 2] ^= 1
        shard.write_bytes(data)
    assert place.fly(*words(runs)) == 0 and len(place.cells) == 36
    assert "is damaged" in caplog.text and list((place.folder / "cells").glob("damaged-*"))
    assert_same(load_result(place.folder), alone.result)


def test_three_bad_checkpoints_of_five(
    runs: Path, alone, place: SimpleNamespace, tmp_path: Path, capsys
):
    run = tmp_path / "five"
    shutil.copytree(runs / "five", run)
    for chunk in (1, 3, 4):
        damage(run, chunk)
    names = [str(run), "scripted:hover", "scripted:dash"]
    with pytest.raises(UserError) as caught:
        place.fly(*names)
    assert caught.value.exit_code == EXIT_DATA and caught.value.message.count("damaged") == 3
    assert not place.folder.exists()
    assert place.fly(*names, skip_bad=True) == EXIT_TOURNAMENT
    result = load_result(place.folder)
    absent = np.isin(np.arange(CHUNKS + 1), [0, 2, 3])
    np.testing.assert_array_equal(result.played, ~(absent[:, None] | absent[None, :]))
    np.testing.assert_array_equal(result.counts[result.played], alone.result.counts[result.played])
    assert np.all(result.counts[~result.played] == 0)
    assert "27 of 36 cells are missing" in capsys.readouterr().out


def halve(data: bytes) -> bytes:
    return data[: len(data) // 2]


def flip(data: bytes) -> bytes:
    middle = data.index(b"cause.npy") + 60
    return data[:middle] + bytes([data[middle] ^ 255]) + data[middle + 1 :]


SPOILT: dict[str, Callable[[bytes], bytes]] = {
    "half": halve,
    "flipped": flip,
    "empty": lambda data: b"",
    "no archive": lambda data: b"PK\x03\x04 nonsense",
    "JSON": lambda data: b"{}",
}


@pytest.mark.parametrize("spoil", SPOILT.values(), ids=SPOILT)
def test_a_damaged_result_is_one_line_and_exit_3(
    alone: SimpleNamespace, tmp_path: Path, spoil: Callable
):
    file = tmp_path / "sent.npz"
    file.write_bytes((alone.folder / RESULT_NAME).read_bytes())
    assert_same(load_result(file), alone.result)
    file.write_bytes(spoil(file.read_bytes()))
    with pytest.raises(UserError) as caught:
        load_result(file)
    assert caught.value.exit_code == EXIT_DATA and "\n" not in caught.value.message

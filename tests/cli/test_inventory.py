"""`dronecombat runs`: what is said of runs, tournaments and policies, and what --prune removes."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import policy_files
import pytest
from saved_runs import TOY, damage, write_run
from tournaments import from_letters

from dronecombat_jax.cli import inventory as cli
from dronecombat_jax.config import settings
from dronecombat_jax.errors import EXIT_CONFIG
from dronecombat_jax.files import prune
from dronecombat_jax.files.claim import claim_run
from dronecombat_jax.files.inventory import Item, inventory
from dronecombat_jax.files.lock import exclusive_lock
from dronecombat_jax.tournaments.cells import Pair, write_shard
from dronecombat_jax.tournaments.result_file import save_result

CHUNK = TOY.steps_per_chunk
SHORT = replace(TOY, train=replace(TOY.train, total_steps=2 * CHUNK, num_seeds=2))


@pytest.fixture
def rooms():
    """Not needed here: the command imports none of the rooms that other tests of commands replace."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with everything that a listing can meet."""
    home = tmp_path_factory.mktemp("home")
    runs = home / "runs"
    write_run(runs / "stopped", chunks=3)
    write_run(runs / "finished", SHORT, chunks=2)
    for name, chunks in (("torn", (3,)), ("lost", (0, 1, 2, 3))):
        write_run(runs / name, chunks=3)
        for chunk in chunks:
            damage(runs / name, chunk)
    with claim_run(runs, "begun") as run:
        run.config.write_text(settings.to_toml(TOY))
    rows = [(1, 1, 0.0, 1.0), (2, 1, 0.5, 0.25), (2, 2, 1.0, 0.0)]
    lines = [
        {"chunk": chunk, "steps": chunk * CHUNK, "seed": seed, "win/defender": defended,
         "win/attacker": reached, "win/draw": 1.0 - defended - reached}
        for chunk, seed, defended, reached in rows
    ]  # fmt: skip
    text = "".join(json.dumps(line) + "\n" for line in lines)
    (runs / "finished" / "chunks.jsonl").write_text(text + '{"chunk": 3, "ste')
    (runs / "notes").mkdir()  # of the user's own

    result = from_letters([["www", "wdl"], ["lll", "wwl"]])
    about = {"pairs_asked": 4, "episodes": 3}
    (home / "tournaments" / "done" / "cells").mkdir(parents=True)
    save_result(home / "tournaments" / "done", result, about)
    save_result(_folder(home / "tournaments" / "broken"), result, about)
    (home / "tournaments" / "broken" / "result.npz").write_bytes(b"no archive")
    cells = _folder(home / "tournaments" / "halfway" / "cells")
    pair = Pair("a", "b", np.ones(3, np.int8), np.ones(3, np.int32))
    write_shard(cells, {"seed": 0}, [pair, pair._replace(attacker="c")])

    policy_files.write(home / "good.safetensors")
    policy_files.write(home / "bad.safetensors", metadata={"sha256": "0" * 64})
    (home / "cut.safetensors").write_bytes((home / "good.safetensors").read_bytes()[:1000])
    policy_files.write(home / "other.safetensors", metadata={"format": "a language model"})
    return home


def _folder(path: Path) -> Path:
    path.mkdir(parents=True)
    return path


def by_name(folder: Path) -> dict[str, Item]:
    return {item.path.name: item for item in inventory(folder)}


def test_states_of_runs(made: Path):
    found = by_name(made)
    states = {name: found[name].state for name in ("stopped", "finished", "torn", "lost", "begun")}
    assert states == {
        "stopped": "stopped", "finished": "finished", "torn": "damaged", "lost": "damaged",
        "begun": "empty",
    }  # fmt: skip
    iterations = TOY.train.chunk_iterations
    assert found["torn"].note.endswith(f"it goes on from {2 * iterations}")
    assert f"checkpoints/{3 * iterations}/" in found["torn"].note
    assert "goes on" not in found["lost"].note and found["lost"].done == 0
    assert "notes" not in found


def test_progress_outcomes_and_size(made: Path):
    found = by_name(made)
    stopped, finished = found["stopped"], found["finished"]
    assert (stopped.done, stopped.total) == (3 * CHUNK, -(-(10**4) // CHUNK) * CHUNK)
    assert (finished.done, finished.total, finished.note) == (2 * CHUNK, 2 * CHUNK, "2 seeds")
    # the mean over both seeds of the last whole chunk
    assert finished.outcomes == pytest.approx((0.75, 0.125, 0.125)) and stopped.outcomes == ()
    files = [path for path in stopped.path.rglob("*") if path.is_file()]
    assert stopped.size == sum(path.stat().st_size for path in files) > 10_000


def test_a_run_that_another_process_holds_is_running(made: Path):
    with exclusive_lock(made / "runs" / "stopped"):
        assert by_name(made)["stopped"].state == "running"
    assert by_name(made)["stopped"].state == "stopped"


def test_files_that_go_while_a_running_run_is_looked_at_are_no_damage(home: Path, monkeypatch):
    run, real = home / "runs" / "torn", Path.lstat
    with exclusive_lock(run):
        before = by_name(home)["torn"]
        (run / ".tmp-gone").write_bytes(b"x" * 1000)

        def lstat(path: Path) -> os.stat_result:
            if path.name == ".tmp-gone":
                raise FileNotFoundError(2, "No such file or directory")
            return real(path)

        monkeypatch.setattr(Path, "lstat", lstat)
        item = by_name(home)["torn"]
    assert (item.state, item.note) == ("running", "") and item == before


def test_tournaments(made: Path):
    found = by_name(made)
    done, halfway, broken = (found[name] for name in ("done", "halfway", "broken"))
    assert (done.state, done.done, done.total) == ("finished", 12, 12)
    # www wdl, lll wwl: 6 wins of the defender, 5 of the attacker, 1 draw
    assert done.outcomes == pytest.approx((6 / 12, 5 / 12, 1 / 12))
    assert (halfway.state, halfway.done, halfway.total) == ("stopped", 6, 0)
    assert broken.state == "damaged" and broken.note.startswith("cannot be read")


def test_policies(made: Path):
    found = by_name(made)
    assert found["good.safetensors"].state == "whole"
    assert found["good.safetensors"].note == "attacker of ippo-laptop, chunk 12"
    assert found["good.safetensors"].done == 1_200_000
    assert found["bad.safetensors"].state == found["cut.safetensors"].state == "damaged"
    assert "other.safetensors" not in found


def test_the_listing(made: Path, capsys):
    assert cli.runs([str(made)]) == 0
    blocks = capsys.readouterr().out.split("\n\n")
    assert [block.split()[0] for block in blocks] == ["runs", "tournaments", "policies"]
    (row,) = (line for line in blocks[0].splitlines() if line.startswith("finished"))
    assert row.split()[1] == "finished" and "75 % / 12 % / 12 %" in row and "100 %" in row
    # one folder of runs alone
    assert cli.runs([str(made / "runs")]) == 0
    assert capsys.readouterr().out.split("\n\n")[0].splitlines() == blocks[0].splitlines()


def test_it_loads_no_jax(made: Path):
    code = (
        "import sys; from dronecombat_jax.cli import commands\n"
        f"assert commands.main(['runs', {str(made)!r}, '--prune', '--yes', '--no-caches']) == 0\n"
        "assert not {'jax', 'flax', 'mujoco', 'orbax'} & set(sys.modules)"
    )
    home = made.parent / "copy"
    shutil.copytree(made, home, symlinks=True)
    code = code.replace(str(made), str(home))
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


def planted(home: Path) -> list[Path]:
    """Left-overs of every kind, in a run that is stopped, one that is damaged, and a tournament."""
    run, cells = home / "runs" / "stopped", home / "tournaments" / "halfway" / "cells"
    players = _folder(run / "checkpoints" / "players")
    (players / "0.safetensors").write_bytes(b"a past player")
    files = [run / ".tmp-config.toml-1-a", players / ".tmp-1.safetensors-1-b", cells / ".tmp-x-1-c",
             cells / "damaged-00-ab"]  # fmt: skip
    for path in files:
        path.write_bytes(b"x" * 100)
    folders = [run / "checkpoints" / name for name in (".tmp-9-1-d", "damaged-4-00")]
    for path in folders:
        _folder(path / "state").joinpath("d").write_bytes(b"y" * 200)
    return [*files, *folders, home / "runs" / "begun"]


def everything(home: Path) -> set[Path]:
    return set(home.rglob("*"))


@pytest.fixture
def home(made: Path, tmp_path: Path) -> Path:
    shutil.copytree(made, tmp_path / "home")
    return tmp_path / "home"


def test_prune_removes_leftovers_and_nothing_else(home: Path, monkeypatch, tmp_path: Path, capsys):
    cache = tmp_path / "cache"
    for name in ("xla", "lowered"):
        _folder(cache / name).joinpath("program").write_bytes(b"z" * 1000)
    (cache / "mine.txt").write_text("of the user's own, in the folder that DRONECOMBAT_CACHE names")
    monkeypatch.setenv("DRONECOMBAT_CACHE", str(cache))
    before = everything(home)
    doomed = planted(home)
    assert cli.runs([str(home), "--prune", "--yes"]) == 0
    out = capsys.readouterr().out
    gone = before - everything(home)
    assert gone == {path for path in before if path.is_relative_to(home / "runs" / "begun")}
    for path in doomed:
        assert not path.exists() and str(path) in out
    assert (home / "runs/stopped/checkpoints/players/0.safetensors").exists()
    assert sorted(path.name for path in cache.iterdir()) == ["mine.txt"]
    assert f"removed {len(doomed) + 2}" in out
    assert cli.runs([str(home), "--prune", "--yes"]) == 0
    assert "nothing to remove" in capsys.readouterr().out


def test_prune_asks(home: Path, monkeypatch, capsys):
    planted(home)
    before = everything(home)
    prune_it = [str(home), "--prune", "--no-caches"]
    with pytest.raises(cli.UserError, match="--yes removes all of it") as error:
        cli.runs(prune_it)
    assert error.value.exit_code == EXIT_CONFIG
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    for answer, removed in (("", False), ("no", False), ("y", True)):
        monkeypatch.setattr("builtins.input", lambda question, answer=answer: answer)
        assert cli.runs(prune_it) == 0
        assert (everything(home) != before) == removed
    assert "nothing was removed" in capsys.readouterr().out


def test_what_is_at_work_is_left_alone(home: Path):
    doomed = planted(home)
    items = inventory(home)
    with exclusive_lock(home / "runs" / "stopped"):
        left = {leftover.path for leftover in prune.leftovers(inventory(home))}
        assert left == {path for path in doomed if "stopped" not in path.parts}
        # begun after the listing
        of_it = [each for each in prune.leftovers(items) if "stopped" in each.path.parts]
        assert len(of_it) == 4 and not any(map(prune.remove, of_it))
    (empty,) = (each for each in prune.leftovers(items) if each.path.name == "begun")
    (home / "runs" / "begun" / "metrics.jsonl").write_text('{"steps": 1}\n')
    assert not prune.remove(empty) and empty.path.is_dir()


def test_a_link_is_never_followed(home: Path, tmp_path: Path):
    elsewhere = _folder(tmp_path / "elsewhere" / "checkpoints").parent
    (elsewhere / "checkpoints" / ".tmp-1").write_bytes(b"x")
    (home / "runs" / "link").symlink_to(elsewhere)
    (home / "runs" / "stopped" / ".tmp-link").symlink_to(elsewhere)
    for leftover in prune.leftovers(inventory(home)):
        prune.remove(leftover)
    assert (elsewhere / "checkpoints" / ".tmp-1").exists()
    assert not (home / "runs" / "stopped" / ".tmp-link").is_symlink()


def test_a_folder_that_is_not_there_is_one_line():
    with pytest.raises(cli.UserError, match="FOLDER nowhere: no such folder"):
        cli.runs(["nowhere"])

"""Five `kill -9` at random moments of `dronecombat reproduce --scale smoke`, which then comes to the
bits of one that was left alone.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tiny import ENVIRONMENT

from dronecombat_jax.files import checkpoint

KILLS = 5
ITERATIONS = 8
# Forks children that have imported everything. The moments are spread over the work: a child dies
# once a drawn share of the files is there, and up to a fifth of a second more has gone by. The last
# sixth of them is left out: tables are all written within a tenth of a second at the very end, and
# checkpoints differ by some files.
KILLER = """
import os, random, signal, sys, time
from pathlib import Path
from dronecombat_jax.machine import backend
backend.prepare("cpu", 2)
import orbax.checkpoint
from dronecombat_jax.arena import round_robin
from dronecombat_jax.cli import commands
from dronecombat_jax.report import tournament_report
from dronecombat_jax.runs import training
from dronecombat_jax.selfplay import chunk
from dronecombat_jax.tournaments import tournament
from dronecombat_jax.watch import finish, pairs
backend.import_mjx()

kills, files, moments = int(sys.argv[1]), int(sys.argv[2]), random.Random(5)

def begin():
    sys.stdout.flush()
    if child := os.fork():
        return child
    os._exit(commands.main(["reproduce", "--scale", "smoke"]))

def count():
    return sum(path.is_file() for path in Path("reproductions").rglob("*"))

for kill in range(kills):
    wanted, child = 5 / 6 * files * (kill + moments.uniform(0.0, 0.9)) / kills, begin()
    while count() < wanted:
        assert os.waitpid(child, os.WNOHANG) == (0, 0), "ended before it was killed"
        time.sleep(0.005)
    time.sleep(moments.uniform(0.0, 0.2))
    os.kill(child, signal.SIGKILL)
    assert os.waitpid(child, 0)[1] == signal.SIGKILL, "ended before it was killed"
    print("killed with", count(), "of", files, "files", flush=True)
assert os.waitpid(begin(), 0)[1] == 0
"""


def reproduced(folder: Path, kills: int, files: int = 0) -> Path:
    """The folder of a smoke experiment that was killed so often."""
    folder.mkdir()
    command = [sys.executable, "-W", "ignore", "-c", KILLER, str(kills), str(files)]
    done = subprocess.run(
        command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0 and done.stdout.count("killed with") == kills, (
        done.stdout + done.stderr
    )
    print([line for line in done.stdout.splitlines() if line.startswith("killed")])  # pytest -s
    return folder / "reproductions" / "smoke"


@pytest.mark.slow
@pytest.mark.timeout(2000)
def test_five_kills_at_random_moments_change_nothing(tmp_path: Path):
    alone = reproduced(tmp_path / "alone", 0)
    files = sum(path.is_file() for path in alone.rglob("*"))
    killed = reproduced(tmp_path / "killed", KILLS, files)
    for run in ("ippo", "sippo"):
        sums = [
            checkpoint.verify(folder / "runs" / run / "checkpoints", ITERATIONS).digest
            for folder in (alone, killed)
        ]
        assert sums[0] == sums[1]
        logs = [folder / "runs" / run / "metrics.jsonl" for folder in (alone, killed)]
        assert logs[0].read_bytes() == logs[1].read_bytes()
    with (
        np.load(alone / "tournaments/all/result.npz") as first,
        np.load(killed / "tournaments/all/result.npz") as second,
    ):
        for part in ("cause", "steps", "counts", "played"):
            np.testing.assert_array_equal(first[part], second[part])
    reports = [folder / "tournaments/all/report" for folder in (alone, killed)]
    names = [{path.name for path in (report / "tables").iterdir()} for report in reports]
    assert names[0] == names[1] and {"claims.json", "claims.md", "ratings.csv"} < names[0]
    for name in (*(f"tables/{name}" for name in names[0]), "report.html"):
        assert (reports[0] / name).read_bytes() == (reports[1] / name).read_bytes(), name
    assert (alone / "steps.json").read_bytes() == (killed / "steps.json").read_bytes()
    assert os.listdir(alone / "tournaments") == os.listdir(killed / "tournaments") == ["all"]

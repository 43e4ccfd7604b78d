"""The loop that counts hangs: what finishes, what fails, and what is killed at the limit, computing
or asleep.
"""

import json
import os
import sys

import pytest

from benchmarks import hangs
from benchmarks.size import TINY


@pytest.fixture
def programs(monkeypatch):
    """`mixed`: a process that finishes, one that fails, one that computes for ever, one that
    sleeps. `part`: a part.
    """
    monkeypatch.setattr(hangs, "LOOK_SECONDS", 2.0)
    loop, sleep = (
        ["timeit", "-n", "1", what]
        for what in ("while True: pass", "import time; time.sleep(1000)")
    )
    mixed = [["this"], ["no_such_module"], loop, sleep]
    monkeypatch.setitem(hangs.PROGRAMS, "mixed", lambda number, folder: mixed[number - 1])
    monkeypatch.setitem(
        hangs.PROGRAMS, "part", lambda *_: ["benchmarks.worker", "memory", TINY.to_json()]
    )


@pytest.mark.slow
def test_what_finishes_fails_and_hangs_is_counted(tmp_path, monkeypatch, capsys, programs):
    file = tmp_path / "hangs.json"
    monkeypatch.setattr(
        sys, "argv", ["hangs", "mixed", "--processes", "4", "--limit", "4", "--json", str(file)]
    )
    assert hangs.main() == 1
    loop = json.loads(file.read_text())["loops"]["mixed"]
    assert [process["verdict"] for process in loop["processes"]] == [
        "finished",
        "failed",
        "slow",
        "hung",
    ]
    assert "no_such_module" in loop["processes"][1]["stderr"]
    assert loop["processes"][3]["seconds"] >= 4.0 and loop["processes"][3]["cpu_seconds"] < 2.0
    out = capsys.readouterr().out
    assert "mixed: 1 of 4 finished, 1 failed, 1 slow, 1 hung" in out
    assert json.loads(out.splitlines()[-1]) == json.loads(file.read_text())


def test_a_part_of_the_benchmark_ends_after_its_calls(programs):
    assert hangs.loop("part", 2, sys.executable, 60.0, cold=True)["finished"] == 2


def test_seeds_of_trainings_differ_and_every_program_is_a_module_here():
    words = {
        name: [program(number, "folder") for number in (1, 2)]
        for name, program in hangs.PROGRAMS.items()
    }
    assert words["smoke"][0] != words["smoke"][1] and "2" in words["smoke-2"][0]
    for first, _ in words.values():
        path = os.path.join(hangs.ROOT, first[0].replace(".", "/"))
        assert os.path.exists(f"{path}.py") or os.path.exists(f"{path}/__main__.py")

"""A child that hangs is killed and named, and the benchmark goes on; a slow one is waited for."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from benchmarks import patience, scaling, start, throughput, worker
from benchmarks.size import TINY
from benchmarks.tables import markdown


@pytest.fixture
def impatient(monkeypatch):
    """Silence is a hang after 3 s, not 120."""
    monkeypatch.setattr(patience, "SECONDS", 3.0)


@pytest.fixture
def asleep(tmp_path, monkeypatch):
    """Children with `mujoco`, `iteration` or `train` among their words sleep; others do as they do."""
    script = tmp_path / "python"
    asleep = "case \" $* \" in *' mujoco '*|*' iteration '*|*' train '*) exec sleep 1000 ;; esac"
    script.write_text(f'#!/bin/sh\n{asleep}\nexec "{sys.executable}" "$@"\n')
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))


def child(program: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-u", "-c", program], stdout=subprocess.PIPE, text=True
    )


@pytest.mark.long
def test_a_child_that_sleeps_is_killed_and_named(impatient):
    process = child("import time; print('first'); time.sleep(1000)")
    listener = patience.Listener(process, "part x")
    assert listener.next_line() == "first\n"
    with pytest.raises(
        patience.Hung, match=r"^part x hung: silent for \d+ s, 0\.\d s of CPU in the last \d s$"
    ):
        listener.next_line()
    assert process.wait(10) == -signal.SIGKILL


@pytest.mark.slow
def test_a_child_that_computes_is_waited_for_though_not_for_ever(impatient, monkeypatch):
    busy = "import time; end = time.time() + 8\nwhile time.time() < end: pass\nprint('done')"
    assert patience.Listener(child(busy), "x").next_line() == "done\n"
    monkeypatch.setattr(patience, "MOST_SECONDS", 5.0)
    process = child("while True: pass")
    with pytest.raises(patience.Hung):
        patience.Listener(process, "x").next_line()
    assert process.wait(10) == -signal.SIGKILL


def test_a_child_that_ends_is_not_called_hung():
    listener = patience.Listener(child("print('first')"), "x")
    assert [listener.next_line(), listener.next_line()] == ["first\n", ""]


@pytest.mark.usefixtures("impatient", "asleep")
@pytest.mark.slow
def test_the_benchmark_goes_on_without_the_parts_that_hang(tmp_path, monkeypatch, capsys):
    repeat, stopped = worker.Worker.repeat, []

    def stop_numpy(self):  # it was built, and hangs in the second round
        if self.name == "numpy" and stopped.count("numpy") == 1:
            os.kill(self._process.pid, signal.SIGSTOP)
        stopped.append(self.name)
        return repeat(self)

    monkeypatch.setattr(worker.Worker, "repeat", stop_numpy)
    file = tmp_path / "bench.json"
    only = ["--only", "numpy", "memory", "mujoco", "start"]
    monkeypatch.setattr(
        sys, "argv", ["bench", "--tiny", "--rounds", "3", "--json", str(file), *only]
    )
    begun = time.monotonic()
    assert throughput.main() == 1
    assert time.monotonic() - begun < 100.0
    record = json.loads(file.read_text())
    assert record["hung"].keys() == {"numpy", "mujoco", "start"}
    assert record["hung"]["mujoco"].startswith("part mujoco hung: silent for ")
    assert record["parts"].keys() == {"memory"} and "start" not in record
    assert [rates.keys() for rates in record["rounds"]] == [{"memory/triad-1", "memory/triad"}] * 3
    assert len(record["rates"]["memory/triad"]["values"]) == 3
    out, err = capsys.readouterr()
    assert "Left out: part mujoco hung" in out and "triad" in out
    assert err.count("left out") == 3


def test_a_benchmark_without_a_hang_ends_with_0(tmp_path, monkeypatch):
    file = str(tmp_path / "bench.json")
    monkeypatch.setattr(
        sys, "argv", ["bench", "--tiny", "--rounds", "1", "--json", file, "--only", "memory"]
    )
    assert throughput.main() == 0


def test_a_record_of_before_has_nothing_that_hung():
    record = json.loads(json.dumps(throughput.measure(["memory"], TINY, 1)))
    del record["hung"]
    assert "Left out" not in markdown(record)


@pytest.mark.long
def test_a_size_that_hangs_is_left_out(impatient, asleep):
    row = scaling.measure("seeds", TINY, 1, 1)
    assert row["hung"] and row["left_out"].startswith("part iteration hung")


@pytest.mark.long
def test_a_start_that_hangs_is_ended(tmp_path, impatient, asleep):
    with pytest.raises(patience.Hung, match="the start of training hung"):
        start.first_line("smoke", tmp_path / "cache", tmp_path)


@pytest.mark.slow
def test_a_part_tells_that_it_is_alive_after_each_program(monkeypatch):
    heard, next_line = [], patience.Listener.next_line
    monkeypatch.setattr(
        patience.Listener, "next_line", lambda self: heard.append(next_line(self)) or heard[-1]
    )
    with worker.Worker("step", TINY) as part:
        assert heard.count('"alive"\n') == 6  # compiled and called, three programs
        assert len(part.repeat()) == 3
    assert heard.count('"alive"\n') == 9

"""Two processes that train one run over loopback, and what is said where processes do not meet."""

import signal

import numpy as np
import pytest
from tiny import CHUNK, STEPS, finish, interrupt, train, train_together

from dronecombat_jax.config import settings
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, EXIT_CONFIG, EXIT_STOPPED, UserError
from dronecombat_jax.files import checkpoint, metrics
from dronecombat_jax.machine import processes
from dronecombat_jax.runs import training

LAST = 8 * CHUNK
# One seed, whose environments are shared: every gradient step is a sum over both processes.
FLAGS = ("--train.num-seeds", "1", "--steps", str(LAST * STEPS), "--run.no-figures")


@pytest.mark.slow
def test_two_processes_stopped_and_resumed_come_to_the_numbers_of_two_devices_in_one(tmp_path):
    first, second = train_together(tmp_path, "two", *FLAGS)
    code, out, err = interrupt(second, tmp_path / "two", after=2 * CHUNK, number=signal.SIGTERM)
    assert code == EXIT_STOPPED and "run " not in out, err  # the other one tells of the run
    code, out, err = finish(first)  # although only the second was asked to stop
    assert code == EXIT_STOPPED and "the same command goes on" in out, err
    saved = checkpoint.steps(tmp_path / "two/checkpoints")
    assert saved[0] == 0 and 2 * CHUNK <= saved[-1] < LAST
    for code, out, err in map(finish, train_together(tmp_path, "two", *FLAGS)):
        assert code == 0, out + err
    code, _, err = finish(train(tmp_path, "one", *FLAGS, "--run.devices", "2"))
    assert code == 0, err
    (one, _), (two, _) = (
        checkpoint.load(tmp_path / name / "checkpoints", LAST) for name in ("one", "two")
    )
    assert one.keys() == two.keys()
    for path in one:
        np.testing.assert_allclose(two[path], one[path], rtol=1e-3, atol=1e-4, err_msg=path)
    rows = [metrics.read(tmp_path / name / "metrics.jsonl") for name in ("one", "two")]
    assert [row["iteration"] for row in rows[1]] == list(range(1, LAST + 1))
    assert [row["episodes"] for row in rows[0]] == [row["episodes"] for row in rows[1]]
    assert (tmp_path / "two/evaluation.json").exists()


@pytest.mark.long
def test_a_process_that_finds_nobody_says_so_in_one_line(tmp_path):
    nobody = {
        "JAX_COORDINATOR_ADDRESS": "127.0.0.1:9",
        "JAX_NUM_PROCESSES": "2",
        "JAX_PROCESS_ID": "1",
    }
    alone = train(
        tmp_path, "alone", "--run.distributed", "--run.join-seconds", "2", environment=nobody
    )
    code, _, err = finish(alone)
    lines = [line for line in err.splitlines() if line.startswith("error: ")]
    assert code == EXIT_CONFIG and len(lines) == 1 and "Traceback" not in err, err
    assert "127.0.0.1:9 within 2 s" in lines[0] and "run.join_seconds" in lines[0]
    assert not (tmp_path / "alone").exists()


def test_numbers_that_are_none_are_refused_before_anything_starts(monkeypatch):
    monkeypatch.setenv("JAX_NUM_PROCESSES", "two")
    with pytest.raises(UserError, match="JAX_NUM_PROCESSES = 'two' must be a whole number"):
        processes.join(1.0)


def test_alone_nobody_is_waited_for():
    state = {"a": np.array([-0.0, 1.0])}
    assert processes.first() and processes.count() == 1 and processes.from_first(state) is state
    assert (
        processes.anywhere(True) and not processes.anywhere(False) and processes.agreed("anything")
    )
    with pytest.raises(UserError, match="full"), processes.together():
        raise UserError("full", EXIT_CANNOT_WRITE)


def test_what_stops_one_process_stops_the_others(monkeypatch):
    others = {"codes": [0, EXIT_CANNOT_WRITE]}
    monkeypatch.setattr(processes, "_gathered", lambda number: [number, *others["codes"][1:]])
    with pytest.raises(UserError, match="process 1 has stopped") as error, processes.together():
        pass
    assert error.value.exit_code == EXIT_CANNOT_WRITE and processes.anywhere(False)
    with pytest.raises(UserError, match="my own"), processes.together():
        raise UserError("my own", EXIT_CONFIG)
    assert not processes.agreed("these settings")
    others["codes"] = [0, 0]
    with processes.together():
        pass


def test_processes_that_disagree_are_told(monkeypatch, tmp_path):
    monkeypatch.setattr(processes, "agreed", lambda text: False)
    config = settings.load("smoke", {"run.name": "mine", "run.directory": str(tmp_path)})
    with pytest.raises(UserError, match="started with different settings"):
        training.train(config)
    assert list(tmp_path.iterdir()) == []

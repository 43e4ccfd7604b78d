"""The harness runs, tiny: nothing here looks at a clock's reading."""

import json
import sys

import numpy as np
import pytest

from benchmarks import scaling, start, throughput, worker
from benchmarks.ceilings import contraction, products
from benchmarks.size import TINY
from benchmarks.tables import markdown
from dronecombat_jax.machine import backend

PROMISED = {
    "schema",
    "date",
    "commit",
    "machine",
    "versions",
    "environment",
    "size",
    "cold",
    "repetitions",
}
PROMISED |= {"parts", "rounds", "rates", "floors", "ratios", "split", "load", "seconds"}


def test_parts_take_turns_and_the_record_has_what_it_promises(monkeypatch):
    order, repeat = [], worker.Worker.repeat
    monkeypatch.setattr(
        worker.Worker, "repeat", lambda self: order.append(self.name) or repeat(self)
    )
    record = json.loads(json.dumps(throughput.measure(["numpy", "memory", "mujoco"], TINY, 2)))
    assert record.keys() >= PROMISED
    assert order == ["numpy", "memory", "mujoco", "mujoco", "memory", "numpy"]
    assert record["versions"].keys() >= {"python", "numpy", "jax", "mujoco", "mujoco-mjx"}
    assert "kernel" in record["parts"]["numpy"]["facts"]["blas"]
    for name, figure in record["rates"].items():
        assert (
            len(figure["values"]) == 2 and 0.0 < figure["min"] <= figure["median"] <= figure["max"]
        ), name
    text = markdown(record)
    assert "35x8 weight gradient" in text and "lean model" in text and "triad" in text


def test_a_part_that_dies_says_why(monkeypatch):
    monkeypatch.setitem(worker.KINDS, "broken", worker.Kind("ceilings:no_such_function"))
    with pytest.raises(
        RuntimeError, match=r"part broken died \(exit code 1\)[\s\S]*KeyError: 'broken'"
    ):
        worker.Worker("broken", TINY)


def test_numpy_is_measured_with_the_kernel_that_it_chooses(monkeypatch):
    for key in worker.OPENBLAS_OVERRIDES:
        monkeypatch.setenv(key, "1")
    alone = worker.environment(worker.KINDS["numpy-1"], "somewhere")
    assert not set(worker.OPENBLAS_OVERRIDES) & alone.keys()
    assert (alone["OPENBLAS_NUM_THREADS"], alone["DRONECOMBAT_CACHE"]) == ("1", "somewhere")
    assert (
        set(worker.OPENBLAS_OVERRIDES)
        <= worker.environment(worker.KINDS["ippo"], "somewhere").keys()
    )


def test_xla_contracts_what_numpy_multiplies():
    for product in products(TINY):
        multiply, left, right = contraction(product)
        out = np.zeros((product.left.shape[0], product.right.shape[1]), np.float32)
        np.testing.assert_allclose(
            multiply(left, right, out), product.left @ product.right, rtol=1e-4, atol=1e-5
        )


def test_a_bad_flag_is_one_line(monkeypatch, capsys):
    for module, flags in ((throughput, ["--rounds", "0"]), (scaling, ["--repetitions", "0"])):
        monkeypatch.setattr(sys, "argv", ["bench", *flags])
        with pytest.raises(SystemExit) as stop:
            module.main()
        assert stop.value.code == 2
        assert capsys.readouterr().err.splitlines()[-1].endswith("must be at least 1")


def test_what_cannot_fit_is_not_begun():
    row = scaling.measure("seeds", TINY, 10**9, 1)
    assert row == {"value": 10**9, "left_out": "would not fit into this machine's memory"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name for name, kind in worker.KINDS.items() if "ceilings" not in kind.build]
)
def test_every_part_builds_and_repeats(name):
    with worker.Worker(name, TINY, backend.cache_dir()) as part:
        rates = part.repeat()
        assert rates.keys() == part.ready["units"].keys() and all(
            rate > 0.0 for rate in rates.values()
        )
        assert part.ready["peak_mib"] > 10.0


@pytest.mark.slow
def test_the_first_line_of_training_is_found(tmp_path):
    seconds = start.first_line("smoke", backend.cache_dir(), tmp_path)
    assert 0.0 < seconds["compiling_at"] < seconds["compiled_at"] < seconds["first_line_at"]


def test_a_training_that_fails_is_told(tmp_path):
    with pytest.raises(RuntimeError, match="before its first line:\nerror: "):
        start.first_line("no-such-preset", tmp_path / "cache", tmp_path)

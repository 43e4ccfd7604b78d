"""Weights & Biases beside the metrics: a real offline run, and one line where it cannot be had."""

import json
import logging
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from toy_training import TOY, refused

from dronecombat_jax.config import preflight, settings
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.files import metrics
from dronecombat_jax.files.wandb_log import WandbLog
from dronecombat_jax.runs import training

MISSING = (
    r"run.wandb = offline: it needs the wandb package. Fix: pip install 'dronecombat-jax\[wandb\]'"
)


def asking(config, mode: str = "offline"):
    return replace(config, run=replace(config.run, wandb=mode))


@pytest.fixture
def stand_in(monkeypatch) -> SimpleNamespace:
    """The package replaced: `lines` that were logged, `asked` of init, `fault` to raise."""
    state = SimpleNamespace(lines=[], asked={}, finished=0, fault=None)

    def log(line):
        if state.fault:
            raise state.fault
        state.lines.append(line)

    def init(**how):
        if state.fault:
            raise state.fault
        state.asked = how
        finish = lambda: setattr(state, "finished", state.finished + 1)
        return SimpleNamespace(log=log, finish=finish, define_metric=lambda *a, **k: None)

    module = SimpleNamespace(init=init, Settings=lambda **how: how)
    monkeypatch.setitem(sys.modules, "wandb", module)
    monkeypatch.setattr("dronecombat_jax.files.wandb_log.has_wandb", lambda: True)
    return state


def test_off_by_default_and_then_never_imported(toy, monkeypatch):
    monkeypatch.setitem(sys.modules, "wandb", None)  # to import it is an error
    assert toy.config.run.wandb == "off" and training.train(toy.config) == 0
    assert not (toy.path / "wandb").exists()


def test_without_the_package_one_line_names_the_extra(toy, monkeypatch):
    for place in ("config.preflight", "files.wandb_log"):
        monkeypatch.setattr(f"dronecombat_jax.{place}.has_wandb", lambda: False)
    with pytest.raises(UserError, match=MISSING) as error:  # before JAX starts
        settings.load("smoke", {"run.wandb": "offline"}, check_machine=True)
    assert error.value.exit_code == EXIT_CONFIG and "\n" not in error.value.message
    settings.load("smoke", {"run.wandb": "offline"})  # to look at such a run needs nothing
    assert MISSING.replace("\\", "") in refused(asking(toy.config)).message


def test_a_folder_called_wandb_is_not_the_package(tmp_path, monkeypatch):
    (tmp_path / "wandb").mkdir()
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    monkeypatch.delitem(sys.modules, "wandb", raising=False)
    assert not preflight.has_wandb()


def test_a_mode_that_is_none_is_refused():
    with pytest.raises(UserError, match=r"run\.wandb"):
        settings.load("smoke", {"run.wandb": "on"})


def test_it_hears_the_numbers_of_every_record(toy, stand_in):
    assert training.train(asking(toy.config, "online")) == 0
    records = metrics.read(toy.path / "metrics.jsonl")
    assert [line["steps"] for line in stand_in.lines] == [record["steps"] for record in records]
    for line, record in zip(stand_in.lines, records, strict=True):
        numbers = {key: value for key, value in record.items() if isinstance(value, int | float)}
        numbers.pop("seed")
        assert line == numbers
    asked = stand_in.asked
    assert (asked["mode"], asked["name"], asked["project"]) == ("online", "toy", "dronecombat")
    assert asked["config"]["learn.epochs"] == TOY.learn.epochs and stand_in.finished == 1


def test_a_run_that_goes_on_is_the_same_one_there(toy, stand_in):
    part = replace(toy.config, train=replace(TOY.train, total_steps=20 * 60))
    assert training.train(asking(part)) == 0
    first = stand_in.asked["id"]
    assert training.train(asking(toy.config)) == 0
    assert stand_in.asked["id"] == first and stand_in.asked["resume"] == "allow"
    other = replace(toy.config, run=replace(toy.config.run, name="other"))
    assert training.train(asking(other)) == 0
    assert stand_in.asked["id"] != first


def test_several_seeds_are_told_apart(tmp_path, stand_in):
    config = asking(replace(TOY, train=replace(TOY.train, num_seeds=2)))
    log = WandbLog(tmp_path, config)
    log.add({"steps": 60, "seed": 2, "win/defender": 0.5, "frozen": None, "note": "text"})
    assert stand_in.lines == [{"steps": 60, "seed-2/win/defender": 0.5}]


def test_where_it_does_not_start_one_line_says_why(toy, stand_in):
    stand_in.fault = RuntimeError("No API key configured.\nUse `wandb login` to log in.")
    error = refused(asking(toy.config, "online"))
    assert error.exit_code == EXIT_CONFIG
    assert "did not start: No API key configured. Use `wandb login`" in error.message


def test_what_goes_wrong_later_stops_no_training(toy, stand_in, caplog):
    toy.hooks[15] = lambda: setattr(stand_in, "fault", OSError("the network has gone"))
    with caplog.at_level(logging.WARNING):
        assert training.train(asking(toy.config)) == 0
    warnings = [record.message for record in caplog.records if "Biases" in record.message]
    assert warnings == ["Weights & Biases hears no more of this run: the network has gone"]
    records = metrics.read(toy.path / "metrics.jsonl")
    assert 0 < len(stand_in.lines) < len(records) == 40


def stored(file: Path) -> Iterator[bytes]:
    """The entries of an offline run's file: LevelDB's log, blocks of 32 KiB after a header of 7."""
    data, at, entry = file.read_bytes(), 7, b""
    while at + 7 <= len(data):
        left = 32768 - at % 32768
        size, kind = int.from_bytes(data[at + 4 : at + 6], "little"), data[at + 6]
        if left < 7 or kind == 0:
            at += left
            continue
        entry += data[at + 7 : at + 7 + size]
        at += 7 + size
        if kind in (1, 4):  # whole, or a last part
            yield entry
            entry = b""


@pytest.mark.long
def test_a_real_offline_run_holds_the_same_numbers(toy):
    pytest.importorskip("wandb", reason="the extra wandb is not installed")
    from wandb.proto import wandb_internal_pb2 as proto  # pyright: ignore[reportMissingImports]

    assert training.train(asking(toy.config)) == 0
    (file,) = (toy.path / "wandb").glob("offline-run-*/*.wandb")
    parse = lambda entry: proto.Record.FromString(entry)  # pyright: ignore[reportAttributeAccessIssue]
    of = lambda kind: [
        one for one in map(parse, stored(file)) if one.WhichOneof("record_type") == kind
    ]
    # its own process writes the file, and may end after ours has asked it to
    deadline = time.monotonic() + 60.0
    while not of("exit") and time.monotonic() < deadline:
        time.sleep(0.1)
    key = lambda item: item.key or ".".join(item.nested_key)
    values = lambda one: {key(item): json.loads(item.value_json) for item in one.history.item}
    lines, records = (
        [values(one) for one in of("history")],
        metrics.read(toy.path / "metrics.jsonl"),
    )
    assert [one.run.display_name for one in of("run")] == ["toy"]
    assert len(lines) == len(records) == 40
    for line, record in zip(lines, records, strict=True):
        shown = {key: value for key, value in line.items() if not key.startswith("_")}
        numbers = {key: value for key, value in record.items() if isinstance(value, int | float)}
        numbers.pop("seed")
        assert shown == pytest.approx(numbers)

"""What is left at the end of a run whose records have gone."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from dronecombat_jax.config.fields import Config, RunConfig, TrainConfig
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError
from dronecombat_jax.runs.evaluation import Match
from dronecombat_jax.watch import finish as room


@pytest.mark.parametrize("content", [None, "", "{}\n{\n"], ids=["gone", "empty", "damaged"])
def test_metrics_that_cannot_be_read_cost_the_curves_alone(
    content: str | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    evaluated = []
    monkeypatch.setattr(room, "evaluate", lambda path, *_, **__: evaluated.append(path))
    config = Config(run=RunConfig(name="one", directory=str(tmp_path), video=False, replay=False))
    (tmp_path / "one").mkdir()
    if content is not None:
        (tmp_path / "one" / "metrics.jsonl").write_text(content)
    room.finish(config)
    assert evaluated == [tmp_path / "one"] and "no learning curves: " in capsys.readouterr().out
    evaluated.clear()
    room.finish(replace(config, run=replace(config.run, figures=False)))
    assert evaluated == [tmp_path / "one"]


FINISHED = Config(
    run=RunConfig(name="one", video=False, replay=False, figures=False, evaluation_fights=8),
    train=TrainConfig(num_seeds=2),
)
OWN = {"steps": FINISHED.num_chunks * FINISHED.steps_per_chunk, "fights": 8, "stochastic": False}
DAMAGED = [b"", b'[{"steps": 1', b"\xff\xfe", b"{}", b"[1]", b"[{}]", b"null", b"[" * 100_000]


def finish_again(content: bytes, root: Path, monkeypatch: pytest.MonkeyPatch) -> list[tuple]:
    """The arguments of each evaluation that the same command flies where `content` lies."""
    evaluated = []
    evaluate = lambda *words, **options: evaluated.append((words, options))
    monkeypatch.setattr(room, "evaluate", evaluate)
    (root / "one").mkdir()
    (root / "one" / "evaluation.json").write_bytes(content)
    room.finish(replace(FINISHED, run=replace(FINISHED.run, directory=str(root))))
    return evaluated


@pytest.mark.parametrize("content", DAMAGED, ids=[repr(one[:12]) for one in DAMAGED])
def test_a_damaged_evaluation_is_flown_anew(content: bytes, tmp_path, monkeypatch, capsys):
    (((path, match), options),) = finish_again(content, tmp_path, monkeypatch)
    assert path == tmp_path / "one" and match == Match() and options == {"own_fights": 8}
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(f"{path / 'evaluation.json'}: damaged or no evaluation: ")
    assert line.endswith("flown anew")


@pytest.mark.parametrize(
    ("rows", "flown"),
    [
        ([OWN, OWN | {"start_seed": 0}], 0),
        ([OWN], 1),  # of one seed only
        ([OWN | {"stochastic": True}] * 2, 1),  # earlier versions wrote it over the run's own
        ([OWN | {"fights": 10}] * 2, 1),
        ([OWN | {"start_seed": 3}] * 2, 1),
        ([OWN | {"steps": 48}] * 2, 1),  # the run has gone on since
        ([], 1),
    ],
)
def test_only_the_runs_own_evaluation_counts_as_done(rows, flown, tmp_path, monkeypatch, capsys):
    assert len(finish_again(json.dumps(rows).encode(), tmp_path, monkeypatch)) == flown
    assert not capsys.readouterr().out


def test_a_disk_that_refuses_is_no_missing_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: object) -> None:
        raise UserError("cannot write", EXIT_CANNOT_WRITE)

    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "metrics.jsonl").touch()
    monkeypatch.setattr(room, "learning_curves", refuse)
    with pytest.raises(UserError, match="cannot write"):
        room.finish(
            Config(run=RunConfig(name="one", directory=str(tmp_path), video=False, replay=False))
        )

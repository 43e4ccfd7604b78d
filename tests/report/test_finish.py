"""What is left at the end of a run whose records have gone."""

from dataclasses import replace
from pathlib import Path

import pytest

from dronecombat_jax.config import Config, RunConfig
from dronecombat_jax.errors import EXIT_CANNOT_WRITE, UserError
from dronecombat_jax.report import finish as room


@pytest.mark.parametrize("content", [None, "", "{}\n{\n"], ids=["gone", "empty", "damaged"])
def test_metrics_that_cannot_be_read_cost_the_curves_alone(
    content: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    evaluated = []
    monkeypatch.setattr(room, "evaluate", lambda path, *_: evaluated.append(path))
    config = Config(run=RunConfig(name="one", directory=str(tmp_path), video=False, replay=False))
    (tmp_path / "one").mkdir()
    if content is not None:
        (tmp_path / "one" / "metrics.jsonl").write_text(content)
    room.finish(config)
    assert evaluated == [tmp_path / "one"] and "no learning curves: " in capsys.readouterr().out
    evaluated.clear()
    room.finish(replace(config, run=replace(config.run, figures=False)))
    assert evaluated == [tmp_path / "one"]


def test_a_disk_that_refuses_is_no_missing_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: object) -> None:
        raise UserError("cannot write", EXIT_CANNOT_WRITE)

    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "metrics.jsonl").touch()
    monkeypatch.setattr(room, "learning_curves", refuse)
    with pytest.raises(UserError, match="cannot write"):
        room.finish(Config(run=RunConfig(name="one", directory=str(tmp_path), video=False, replay=False)))

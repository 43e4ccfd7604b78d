"""Small runs and their tournament."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from saved_runs import write_run
from small_tournament import CHUNKS, LAYOUT, RULES
from tournaments import words
from toy import Coasting

from dronecombat_jax.arena import round_robin as arena_tournament
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.tournaments import flying
from dronecombat_jax.tournaments import tournament as tournaments
from dronecombat_jax.tournaments.result_file import load_result


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("runs")
    write_run(root / "five", chunks=CHUNKS)
    return root


@pytest.fixture
def place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> SimpleNamespace:
    """`fly(words, **how)` in tournaments/ of a folder of its own; `cells`: those flown since, in
    order.
    """
    cells: list[tuple[int, int]] = []
    real = arena_tournament.play

    def counted(*args, **how):
        for harvest in real(*args, **how):
            cells.extend((cell.defender, cell.attacker) for cell in harvest.cells)
            yield harvest

    monkeypatch.setattr(tournaments, "Combat", Coasting)
    monkeypatch.setattr(flying, "play", counted)
    monkeypatch.setattr(arena_tournament, "CPU_LAYOUT", LAYOUT)
    root = tmp_path / "tournaments"

    def fly(*words, rules: Rules = RULES, **how) -> int:
        cells.clear()
        return tournaments.tournament(
            [str(word) for word in words], rules, root=str(root), name="it", **how
        )

    return SimpleNamespace(fly=fly, folder=root / "it", cells=cells)


@pytest.fixture(scope="module")
def alone(runs: Path, tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """The tournament of the run and two pilots, left alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tournaments, "Combat", Coasting)
        patch.setattr(arena_tournament, "CPU_LAYOUT", LAYOUT)
        root = tmp_path_factory.mktemp("alone")
        assert tournaments.tournament(words(runs), RULES, root=str(root)) == 0
        return SimpleNamespace(folder=root / "five", result=load_result(root / "five"))

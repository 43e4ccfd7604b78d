"""`dronecombat replay` from end to end on a toy run, and what a training leaves."""

import json
import re
import webbrowser
from dataclasses import replace
from pathlib import Path

import pytest
from saved_runs import TOY, write_run
from toy import Coasting

from dronecombat_jax.config.fields import RunConfig
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.watch import finish
from dronecombat_jax.watch import replay as room
from dronecombat_jax.watch.flyers import Named
from dronecombat_jax.watch.recording import Filming


@pytest.fixture(autouse=True)
def toy_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """runs/toy with chunks 0 to 2; its fights are flown without physics."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(room, "Combat", Coasting)
    return write_run(tmp_path / "runs" / "toy", chunks=2)


def data_in(path: Path) -> dict:
    (call,) = re.findall(
        r'^dronecombatReplay\("replay", (.*), \{"embedded"', path.read_text(), re.MULTILINE
    )
    return json.loads(call)


@pytest.mark.long
def test_the_last_runs_fights_on_one_page(toy_run: Path, capsys: pytest.CaptureFixture[str]):
    assert room.replay(Named(), Filming(3, seed=5), out=None) == 0
    page = data_in(toy_run / "replay.html")
    assert [fight["name"] for fight in page["fights"]] == ["Fight 1", "Fight 2", "Fight 3"]
    assert {(fight["defender"], fight["attacker"]) for fight in page["fights"]} == {
        ("toy chunk 2", "toy chunk 2")
    }
    assert (
        page["title"] == "toy chunk 2, both sides"
        and page["about"] == "3 fights, starts of seed 5, mean actions"
    )
    assert len({tuple(fight["target"]) for fight in page["fights"]}) == 3  # three starts
    assert "runs/toy/replay.html" in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.parametrize(("asked", "starts"), [("", "even starts"), ("as_trained", "starts")])
def test_without_a_run_shipped_pilots_fly_from_even_starts_or_from_those_asked_for(
    asked: str, starts: str, toy_run: Path, monkeypatch: pytest.MonkeyPatch
):
    (toy_run / "elsewhere").mkdir()
    monkeypatch.chdir(toy_run / "elsewhere")  # no runs/ there
    assert room.replay(Named(), Filming(1, spawn=asked), out=Path("first.html")) == 0
    assert data_in(Path("first.html"))["about"] == f"1 fight, {starts} of seed 0, mean actions"


@pytest.mark.long
def test_show_takes_what_train_returns(toy_run: Path):
    shown = room.show(toy_run, attacker=toy_run, defender="hover")  # paths, as `train` gives them
    assert shown.title == "hover (scripted) defends against toy chunk 2"


@pytest.mark.long
def test_an_evolution_is_one_start_flown_by_all_chunks(toy_run: Path):
    assert room.replay(Named(("toy",)), Filming(4), out=None, evolution=True) == 0
    fights = data_in(toy_run / "evolution.html")["fights"]
    assert [fight["name"] for fight in fights] == ["0 %", "50 %", "100 %"]
    assert [fight["note"] for fight in fights] == [
        "chunk 0, untrained",
        "chunk 1, 0 k steps",
        "chunk 2, 0 k steps",
    ]
    assert len({tuple(fight["target"]) for fight in fights}) == 1
    assert len({fight["states"] for fight in fights}) == 3


@pytest.mark.long
def test_one_side_of_an_evolution_may_stay(toy_run: Path):
    room.replay(Named(("toy",), ("hover", "")), Filming(), out=Path("hover.html"), evolution=True)
    page = data_in(Path("hover.html"))
    assert {fight["defender"] for fight in page["fights"]} == {"hover (scripted)"}
    assert "defender always hover (scripted)" in page["about"]


@pytest.mark.parametrize(
    ("named", "out", "evolution", "message"),
    [
        (
            Named(("toy",)),
            "fight.avi",
            False,
            "fight.avi: a replay ends in .html, .mp4, .gif, .webp",
        ),
        (Named((), ("hover", "dash")), None, True, "an evolution needs a RUN"),
        (Named(("toy",), ("1", "2")), None, True, "an evolution of what"),
        (Named(("toy",)), "fight.gif", True, "an evolution is a page"),
    ],
)
def test_mistakes(named: Named, out: str | None, evolution: bool, message: str):
    with pytest.raises(UserError, match=message) as raised:
        room.replay(named, Filming(), out=out and Path(out), evolution=evolution)
    assert raised.value.exit_code == EXIT_CONFIG


@pytest.mark.long
def test_a_film_is_of_the_pages_first_fight(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    filmed = []

    def render(fight, scene, picture, film, **radii) -> None:
        filmed.append((fight, picture, film, radii))
        film.touch()

    monkeypatch.setattr(room, "render_fight", render)
    room.replay(Named(("toy",)), Filming(3), out=Path("fight.gif"))
    ((fight, picture, film, radii),) = filmed
    room.replay(Named(("toy",)), Filming(3), out=Path("page.html"))
    first = data_in(Path("page.html"))["fights"][0]
    assert (picture, film, radii) == (
        None,
        Path("fight.gif"),
        {"intercept_radius": 0.5, "reach_radius": 0.5},
    )
    assert (
        fight.target.tolist() == pytest.approx(first["target"])
        and fight.time[-1] == first["result"]["time"]
    )


@pytest.mark.long
def test_show_is_for_notebooks():
    shown = room.show("toy", attacker=1, fights=2, height=300)
    assert "toy chunk 1" in shown.title and len(shown.fights) == 2
    assert "height: 300px" in shown._repr_html_()


@pytest.mark.parametrize(("display", "opened"), [("", 0), (":0", 1)])
def test_a_browser_is_opened_only_where_there_is_a_display(
    display: str, opened: int, monkeypatch, toy_run: Path
):
    addresses = []

    def open_it(address: str) -> bool:
        addresses.append(address)
        raise OSError("the browser is broken")

    monkeypatch.setattr(webbrowser, "open", open_it)
    monkeypatch.setattr(room.sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert room.replay(Named(("toy",)), Filming(1), out=None, browser=True) == 0
    assert addresses == [(toy_run / "replay.html").as_uri()] * opened


def test_a_finished_training_names_its_replay(
    toy_run: Path, monkeypatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(finish, "evaluate", lambda *_, **__: None)
    monkeypatch.setattr(room, "Filming", lambda: Filming(1))
    run = RunConfig(name="toy", directory=str(toy_run.parent), video=False, figures=False)
    finish.finish(replace(TOY, run=run))
    assert (
        toy_run / "replay.html"
    ).is_file() and f"replay: {toy_run / 'replay.html'}" in capsys.readouterr().out

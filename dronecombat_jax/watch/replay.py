"""`dronecombat replay`, and `show` for notebooks: fights flown anew, as a page, a cell or a film.

What does not live here: flying (`watch.recording`), the page (`replay_page`, `replay_data`).
"""

import contextlib
import os
import secrets
import sys
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.games import game_of
from dronecombat_jax.config.starts import AS_TRAINED, with_starts
from dronecombat_jax.errors import UserError
from dronecombat_jax.files.atomic import cannot_write, write_atomic
from dronecombat_jax.report.replay_data import Fight, replay_data
from dronecombat_jax.report.replay_page import CELL_HEIGHT, cell, page
from dronecombat_jax.report.shown_rules import Rules, rules_of
from dronecombat_jax.report.video import FILMS, render_fight
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES
from dronecombat_jax.watch.flyers import (
    Crew,
    Flyer,
    Named,
    chunks_along,
    of_run,
    read_crew,
    run_name,
)
from dronecombat_jax.watch.recording import Filming, recorder

PAGE_SUFFIX = ".html"
SUFFIXES = (PAGE_SUFFIX, *FILMS)
MOST_FIGHTS = 16  # side by side


class Replay(NamedTuple):
    """Recorded fights, ready to be shown. The last line of a notebook cell shows it."""

    title: str
    about: str
    fights: tuple[Fight, ...]
    rules: Rules
    height: int = CELL_HEIGHT  # pixels, of a notebook cell

    def page(self) -> str:
        """One self-contained HTML file."""
        return page(replay_data(self.title, self.about, self.fights, self.rules))

    def save(self, path: Path | str) -> Path:
        """Write the page. UserError 73."""
        return save_page(Path(path), self.page())

    def _repr_html_(self) -> str:
        name = f"dronecombat-replay-{secrets.token_hex(6)}"
        return cell(replay_data(self.title, self.about, self.fights, self.rules), name, self.height)


def show(
    *words: Path | str,
    defender: Path | str | int = "",
    attacker: Path | str | int = "",
    fights: int = 1,
    seed: int = 0,
    run_seed: int = -1,
    stochastic: bool = False,
    spawn: str = "",
    evolution: bool = False,
    allow_mismatch: bool = False,
    height: int = CELL_HEIGHT,
) -> Replay:
    """Fly fights and return them for a notebook's output, such as `show("ippo", defender="hover")`.

    All arguments are those of `dronecombat replay`. Raises UserError as it does.
    """
    who = tuple(str(word) for word in words)
    named = Named(who, (str(defender), str(attacker)), run_seed, allow_mismatch)
    filming = Filming(fights, seed, stochastic, spawn)
    return _fly(read_crew(named), named, filming, evolution)._replace(height=height)


def replay(
    named: Named,
    filming: Filming,
    *,
    out: Path | None,
    evolution: bool = False,
    browser: bool = False,
) -> int:
    """Fly, write and name the file; returns 0. UserError: 2 for words, 3 for data, 73 for files."""
    crew = read_crew(named)
    path = out or _place(crew, evolution)
    if path.suffix not in SUFFIXES:
        raise UserError(f"{path}: a replay ends in {', '.join(SUFFIXES)}")
    if path.suffix != PAGE_SUFFIX:
        if evolution:
            raise UserError(f"{path}: an evolution is a page; a film shows one fight")
        return _film(crew, filming, path)
    shown = _fly(crew, named, filming, evolution, say=lambda text: print(text, flush=True))
    shown.save(path)
    print(f"replay: {path} ({path.stat().st_size / 1e6:.2f} MB, opens in any browser)", flush=True)
    if browser:
        open_page(path)
    return 0


def write_replay(run: Path) -> Path:
    """Write the replay of a run's newest policies into it, as the command does without flags."""
    named = Named((str(run),))
    crew = read_crew(named)
    return _fly(crew, named, Filming(), evolution=False).save(_place(crew, evolution=False))


def open_page(path: Path) -> None:
    """Open the page where there is a browser; elsewhere its path is on the screen already."""
    displays = [os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")]
    if sys.platform == "linux" and not any(displays):
        return  # a browser for terminals would take this one over
    with contextlib.suppress(Exception):  # a browser that is broken is no fault of the replay
        webbrowser.open(path.resolve().as_uri())


def save_page(path: Path, text: str) -> Path:
    """Write a page, and the folder that it belongs in. UserError 73."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(path, error) from None
    write_atomic(path, text)
    return path


def _place(crew: Crew, evolution: bool) -> Path:
    if evolution and crew.run:
        return crew.run.path / "evolution.html"
    return crew.run.replay if crew.run else Path("replay.html")


def _fly(
    crew: Crew,
    named: Named,
    filming: Filming,
    evolution: bool,
    say: Callable[[str], None] = lambda _: None,
) -> Replay:
    filming = _from(crew, filming)
    combat = Combat(with_starts(crew.config, filming.spawn))
    rules = rules_of(combat.config, combat.scene)
    if evolution:
        return _evolution(crew, named, combat, filming, rules, say)
    title = _against(crew.flyers, rules.alone)
    say(f"flying {_counted(filming.fights)}: {title}")
    flown = recorder(combat, filming)(*crew.flyers)
    labels = _labels(crew.flyers)
    fights = tuple(Fight(fight, f"Fight {index + 1}", labels) for index, fight in enumerate(flown))
    return Replay(title, _about(filming, len(fights)), fights, rules)


def _evolution(
    crew: Crew,
    named: Named,
    combat: Combat,
    filming: Filming,
    rules: Rules,
    say: Callable[[str], None],
) -> Replay:
    """One start, flown by the policies along a run's training; a side that a flag names stays."""
    run = crew.run
    if run is None:
        raise UserError("an evolution needs a RUN: its untrained policies to its newest")
    learns = [role for role in range(len(SIDES)) if not named.wanted[role]]
    if not learns:
        raise UserError("an evolution of what? Leave out --defender, --attacker or both")
    fly = recorder(combat, filming._replace(fights=1))
    fights = []
    for percent, chunk in chunks_along(run):
        flyers = list(crew.flyers)
        for role in learns:
            flyers[role] = of_run(run, role, chunk, named.run_seed)
        say(f"flying chunk {chunk} ({percent} % of the training)")
        (flown,) = fly(*flyers)
        note = f"chunk {chunk}, {_steps(flyers[learns[-1]].steps)}"
        fights.append(Fight(flown, f"{percent} %", _labels(flyers), note))
    title = f"{run_name(run)} learns to fight"
    stay = set(range(len(SIDES))) - set(learns)
    stays = [f"{SIDES[role]} always {crew.flyers[role].label}" for role in stay]
    about = "The same start, flown by the policies along the training"
    return Replay(title, "; ".join([about, *stays, _how(filming)]), tuple(fights), rules)


def _film(crew: Crew, filming: Filming, path: Path) -> int:
    filming = _from(crew, filming)
    combat = Combat(with_starts(crew.config, filming.spawn))
    title = _against(crew.flyers, not game_of(crew.config).flies[DEFENDER])
    print(f"flying a fight and filming it: {title}", flush=True)
    (fight,) = recorder(combat, filming._replace(fights=1))(*crew.flyers)
    game = combat.config.game
    radii = {"intercept_radius": game.intercept_radius, "reach_radius": game.reach_radius}
    render_fight(fight, combat.scene, None, path, **radii)
    print(f"film: {path} ({path.stat().st_size / 1e6:.2f} MB)", flush=True)
    return 0


def _from(crew: Crew, filming: Filming) -> Filming:
    """What is filmed, from the crew's own starts where no others are asked for."""
    starts = filming.spawn or crew.starts
    return filming._replace(spawn="" if starts == AS_TRAINED else starts)


def _against(flyers: Sequence[Flyer], alone: bool) -> str:
    defender, attacker = (flyer.label for flyer in flyers)
    if alone:
        return f"{attacker} alone"
    if defender == attacker:
        return f"{attacker}, both sides"
    return f"{defender} defends against {attacker}"


def _labels(flyers: Sequence[Flyer]) -> tuple[str, str]:
    return flyers[DEFENDER].label, flyers[ATTACKER].label


def _about(filming: Filming, fights: int) -> str:
    return f"{_counted(fights)}, {_how(filming)}"


def _how(filming: Filming) -> str:
    actions = "drawn actions" if filming.stochastic else "mean actions"
    starts = f"{filming.spawn} starts" if filming.spawn else "starts"
    return f"{starts} of seed {filming.seed}, {actions}"


def _steps(steps: int) -> str:
    """Environment steps trained, for a label."""
    if steps == 0:
        return "untrained"
    return f"{steps / 1e6:.1f} M steps" if steps >= 10**6 else f"{steps / 1e3:.0f} k steps"


def _counted(fights: int) -> str:
    return f"{fights} fight{'s' * (fights != 1)}"

"""`dronecombat robustness`: a tournament's matrix, flown again under each gap between the game and
a drone that flies.

    tournaments/<name>/cells/                       beside the tournament's own cells, under their own context
    tournaments/<name>/robustness/robustness.json   and robustness.md

Killed or stopped it goes on with the same command. What does not live here: the gaps (`reality`),
the statistics (`analysis.robustness`), the picture (`report.robustness_figure`).
"""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.analysis.result import TournamentResult, tournament_result
from dronecombat_jax.analysis.robustness import Effect, effect
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.fingerprint import digest_of, environment
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, EXIT_STOPPED, EXIT_TOURNAMENT, UserError
from dronecombat_jax.files.atomic import cannot_write, write_atomic
from dronecombat_jax.files.plain import to_json
from dronecombat_jax.files.rundir import run_path
from dronecombat_jax.files.versions import package_version
from dronecombat_jax.machine import backend
from dronecombat_jax.runs.progress import printable
from dronecombat_jax.tournaments import tournament as tournaments
from dronecombat_jax.tournaments.cells import read_cells
from dronecombat_jax.tournaments.entrants import Field, read_field
from dronecombat_jax.tournaments.flying import Grid, fly
from dronecombat_jax.tournaments.reality import BOTH, OTHER_STARTS, Change, changes_of, chosen
from dronecombat_jax.tournaments.result_file import RESULT_NAME, load_about, load_result
from dronecombat_jax.tournaments.robustness_text import markdown
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES

FOLDER = "robustness"
FILE = "robustness.json"
FORMAT = 1


class Plan(NamedTuple):
    """Whose matrix is flown, and how."""

    path: Path  # of the tournament's folder
    words: Sequence[str]
    rules: Rules
    every: int
    untrained: bool
    mjcf: str
    spawn: str  # where fights start (`config.starts`)
    before: TournamentResult | None  # of a tournament that was named


def plan(
    words: Sequence[str],
    *,
    name: str = "",
    episodes: int = 0,
    every: int = 0,
    seed: int = 0,
    stochastic: bool = False,
    mjcf: str = "",
    root: str = "tournaments",
) -> Plan:
    """What to fly for `words`: one finished tournament, or entrants as a tournament takes them.

    A tournament has its own entrants, fights and seed; only `episodes` may be others. 0: its own,
    or 5 fights and every chunk. Raises UserError 2 where it is given what it has, 3 for its file.
    """
    folder = _tournament(words[0], root) if len(words) == 1 else None
    if folder is None:
        path = run_path(root, name or tournaments.default_name(words))
        rules = Rules(episodes or Rules().episodes, seed, stochastic)
        return Plan(path, words, rules, every or 1, False, mjcf, "", None)
    given = {"--name": name, "--every": every, "--seed": seed, "--stochastic": stochastic}
    if own := [flag for flag, value in given.items() if value]:
        raise UserError(f"{', '.join(own)}: the tournament {words[0]} has its own", EXIT_CONFIG)
    about = load_about(folder)
    rules = Rules(episodes or about["episodes"], about["seed"], about["stochastic"])
    every, untrained = about.get("every", 1), about.get("untrained", False)
    mjcf, spawn, before = mjcf or about.get("mjcf", ""), about.get("spawn", ""), load_result(folder)
    return Plan(folder, about["words"], rules, every, untrained, mjcf, spawn, before)


def robustness(
    planned: Plan,
    *,
    gaps: str = "",
    together: bool = False,
    skip_bad: bool = False,
    allow_mismatch: bool = False,
) -> tuple[int, dict[str, Any]]:
    """Fly, or go on with, the matrix of `planned` without a gap and under each of `gaps` ("": all).

    `together`: both sides have every gap at once. Returns an exit code as `tournament` does, and
    what was written, nothing where a signal came. Raises UserError: 2 for a gap that there is not,
    otherwise as `tournament`.
    """
    wanted = chosen(gaps)
    print("reading and verifying everybody ...", flush=True)
    field = read_field(
        planned.words,
        every=planned.every,
        untrained=planned.untrained,
        skip_bad=skip_bad,
        allow_mismatch=allow_mismatch,
        mjcf=planned.mjcf,
        spawn=planned.spawn,
    )
    changes, left_out = changes_of(field.config, wanted, together)
    flight = _Flight(planned, field)
    flight.greet(changes, left_out)
    with tournaments.claim(planned.path):
        nominal = flight.fly("nominal", field.config, planned.rules)
        if nominal is None:
            return EXIT_STOPPED, {}
        effects: list[tuple[Change, list[Effect]]] = []
        for change in changes:
            title = f"{change.gap.name} {change.side}"
            result = flight.fly(title, change.config, _rules(planned.rules, change))
            if result is None:
                return EXIT_STOPPED, {}
            roles = range(len(SIDES)) if change.side == BOTH else [SIDES.index(change.side)]
            effects.append((change, [effect(nominal, result, role) for role in roles]))
        text = to_json(_report(planned, flight.met, nominal, effects, left_out))
        report = json.loads(text)  # as a reader finds it: no NaN
        write_report(planned.path / FOLDER, text, report)
    return (EXIT_TOURNAMENT if field.bad else 0), report


def write_report(out: Path, text: str, report: Mapping[str, Any]) -> None:
    """Write and print the report. UserError 73 where `out` cannot be written."""
    try:
        out.mkdir(exist_ok=True)
    except OSError as error:
        raise cannot_write(out, error) from error
    write_atomic(out / FILE, text)
    write_atomic(out / "robustness.md", table := markdown(report))
    print(table)


class _Flight:
    """The players of a matrix and its cells on disk."""

    def __init__(self, planned: Plan, field: Field):
        self._planned, self._field = planned, field
        self._entrants = [tuple(seat.entrant for seat in side) for side in field.seats]
        self._players = [[seat.player for seat in side] for side in field.seats]
        self._combat = Combat(field.config)
        self.met = environment(field.config, self._combat.scene)
        shape = len(self._entrants[DEFENDER]), len(self._entrants[ATTACKER])
        self._asked = np.ones(shape, bool)
        if planned.before is not None:
            self._asked = _flown_in(planned.before, self._entrants)

    def greet(self, changes: Sequence[Change], left_out: Sequence[str]) -> None:
        """Say what is going to be flown."""
        print("\n".join(backend.banner()))
        field, episodes = self._field, self._planned.rules.episodes
        lines = [f"note: {line}" for line in (*field.notices, *left_out)]
        for line in (*lines, *(f"skipped: {line}" for line in field.bad)):
            print(printable(line))
        cells, matrices = int(self._asked.sum()), 1 + len(changes)
        print(
            f"robustness of {self._planned.path}: {cells:,} pairs x {episodes} fights, without a gap and under "
            f"{len(changes)}: {cells * episodes * matrices:,} fights",
            flush=True,
        )

    def fly(self, title: str, config: Config, rules: Rules) -> TournamentResult | None:
        """The matrix in the game of `config`; None where a signal came, and all is saved."""
        folder = self._planned.path / tournaments.CELLS_NAME
        combat = self._combat
        if config != self._field.config:
            combat = Combat(config)
        context = tournaments.context_of(environment(config, combat.scene), rules)
        identities = [[entrant.identity for entrant in side] for side in self._entrants]
        cause, steps = read_cells(folder, context, *identities, episodes=rules.episodes)
        grid = Grid(folder, context, cause, steps, self._asked)
        if not fly(title, combat, self._players, rules, grid):
            return None
        winner = outcome_table(config.game)
        defenders, attackers = self._entrants
        return tournament_result(
            grid.cause, grid.steps, winner, defenders, attackers, config.control_dt
        )


def _tournament(word: str, root: str) -> Path | None:
    """The folder of a tournament that `word` names, or None. UserError 3 for one not complete."""
    for path in (Path(word), Path(root, word)):
        if os.path.isfile(path / RESULT_NAME):  # False, where Path raises on a name too long
            return path
        if os.path.isdir(path / tournaments.CELLS_NAME):
            message = f"{path}: no result: the tournament is not complete; the same command as before goes on with it"
            raise UserError(message, EXIT_DATA)
    return None


def _rules(rules: Rules, change: Change) -> Rules:
    """The rules of every gap: those of the tournament, but for other starts in the control."""
    return rules._replace(seed=rules.seed + 1) if change.gap.name == OTHER_STARTS else rules


def _flown_in(before: TournamentResult, entrants: Sequence[Any]) -> NDArray[np.bool_]:
    """Which pairs [D, A] the tournament has flown."""
    sides = before.defenders, before.attackers
    known = [{entrant.identity: i for i, entrant in enumerate(side)} for side in sides]
    places = [
        np.asarray([of.get(entrant.identity, -1) for entrant in side], np.intp)
        for of, side in zip(known, entrants, strict=True)
    ]
    entered = (places[DEFENDER] >= 0)[:, None] & (places[ATTACKER] >= 0)
    return entered & before.played[np.ix_(*places)]


def _report(
    planned: Plan,
    met: dict[str, Any],
    nominal: TournamentResult,
    effects: Sequence[tuple[Change, Sequence[Effect]]],
    left_out: Sequence[str],
) -> dict[str, Any]:
    """What is written down; plain JSON."""
    rows = [
        {
            "gap": change.gap.name,
            "about": change.about,
            "drones": change.side,
            "settings": change.changes,
            **item._asdict(),
            "role": SIDES[item.role],
        }
        for change, items in effects
        for item in items
    ]
    return {
        "format": FORMAT,
        "package": package_version(),
        "jax": jax.__version__,
        "tournament": planned.path.name,
        "environment_digest": digest_of(met),
        **planned.rules._asdict(),
        "defenders": len(nominal.defenders),
        "attackers": len(nominal.attackers),
        "rows": rows,
        "left_out": list(left_out),
    }

"""`dronecombat evaluate`: the two policies of a run fight, and the outcomes are counted."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from scipy import stats

from dronecombat_jax.arena.match import Team, fight, policy_team, scripted_team, start_fights
from dronecombat_jax.arena.match import drawn_numbers as drawn_in
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.fingerprint import environment, environment_diff, own_view
from dronecombat_jax.combat.observe import layout_of
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.opponents import stands_for
from dronecombat_jax.config.preflight import problems
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.sides import drone_names, spelt, team
from dronecombat_jax.config.starts import with_starts
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files.atomic import write_atomic
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.learn.mates import Both
from dronecombat_jax.policies.file import SavedPolicy
from dronecombat_jax.runs.opponents import kept_policy
from dronecombat_jax.runs.records import ENDINGS
from dronecombat_jax.runs.resume import load_state, newest_start
from dronecombat_jax.runs.saved_policies import policies_of
from dronecombat_jax.types import (
    ATTACKER,
    DEFENDER,
    NUM_SIDES,
    SIDES,
    FightResult,
    Outcome,
    SidePolicy,
    TrainState,
)


class SavedRun(NamedTuple):
    """A run as read from disk."""

    config: Config
    combat: Combat
    iteration: int
    state: TrainState  # NumPy leaves [S, ...]
    met: dict[str, Any]  # the environment that it was trained in (`combat.fingerprint`)
    # by side: who sits in the place of one that never learns, a policy or a scripted pilot's name
    frozen: tuple[SavedPolicy | str | None, ...] = (None, None)


def load_run(path: Path, chunk: int | None = None) -> SavedRun:
    """Read a checkpoint (`chunk` 0: untrained; None: the newest) and the configuration it was made
    with. UserError 3.
    """
    start = newest_start(RunDirectory(path), chunk)
    config, combat = start.config, Combat(start.config)
    met = start.meta.get("environment") or environment(config, combat.scene)
    frozen = tuple(_frozen(RunDirectory(path), config, side) for side in range(NUM_SIDES))
    state = load_state(start, combat, pools=False)
    return SavedRun(config, combat, start.iteration, state, met, frozen)


def _frozen(run: RunDirectory, config: Config, side: int) -> SavedPolicy | str | None:
    """Who sits in the place of a side that never learns; None for one that does."""
    row = stands_for(config, side)
    return None if row is None else row.scripted or kept_policy(run, config, row)


def policies(run: SavedRun, seed_index: int) -> Both:
    """Defenders' and attackers' policy of one of the run's seeds, as they are flown.

    Of a side that never learns, its untrained one: see `flown_by`.
    """
    both = policies_of(run.state.learners, run.config)  # leaves [S, ...]
    return jax.tree.map(lambda leaf: leaf[seed_index], both)


def flown_by(run: SavedRun, seed_index: int) -> tuple[SidePolicy | str, SidePolicy | str]:
    """Who flew in the run at last: the policies of one of its seeds, or in the place of a side that
    never learns, the frozen policy or the scripted pilot that it trained against.
    """
    live = policies(run, seed_index)

    def either(side: int) -> SidePolicy | str:
        frozen = run.frozen[side]
        if frozen is None:
            return live[side]
        return frozen if isinstance(frozen, str) else frozen.policy

    return either(DEFENDER), either(ATTACKER)


def shown_to(run: SavedRun, side: int) -> str:
    """The layout of `OBSERVATIONS` that `flown_by`'s policy sees; "": what the run's game shows."""
    frozen = run.frozen[side]
    known = isinstance(frozen, SavedPolicy)
    return own_view(frozen.info.environment, run.config.game) if known else ""


class Match(NamedTuple):
    """Which fights to fly with a run."""

    fights: int = 0  # 0: as many as the run's own evaluation, `run.evaluation_fights`
    seed: int = 0  # of the start states
    stochastic: bool = False  # draw the policies' actions instead of taking their mean
    # a scripted pilot in the defender's place (combat.scripted.PILOTS); "": the run's own
    defender: str = ""
    attacker: str = ""
    spawn: str = ""  # starts (`config.starts`); "": those of the run
    defenders: int = 0  # drones of that side; 0: as many as in the run
    attackers: int = 0


def play(run: SavedRun, seed_index: int, match: Match) -> FightResult:
    """The fights of `match` with the policies of one of the run's seeds; NumPy leaves. UserError
    for an unknown pilot, and for teams in which these policies cannot fly.
    """
    fights, combat = _fights_of(run, match)
    config, learn = combat.config, combat.config.learn

    flyers = flown_by(run, seed_index)
    names = [
        match_name or (flyer if isinstance(flyer, str) else "")
        for match_name, flyer in zip((match.defender, match.attacker), flyers, strict=True)
    ]
    flown = [None if isinstance(flyer, str) else flyer for flyer in flyers]

    def pilots_of(policy: SidePolicy | None, role: int) -> Team:
        if policy is None or names[role]:
            return scripted_team(combat, names[role], role)
        # who is frozen flew its mean action in training, too
        drawn = match.stochastic and run.frozen[role] is None
        return policy_team(config, learn, policy, role, drawn, shown_to(run, role))

    def fly(
        defender: SidePolicy | None, attacker: SidePolicy | None, key: jax.Array
    ) -> FightResult:
        start_key, fight_key = jax.random.split(key)
        pilots = pilots_of(defender, DEFENDER), pilots_of(attacker, ATTACKER)
        return fight(combat, *pilots, start_fights(combat, start_key, fights), fight_key)

    return jax.device_get(jax.jit(fly)(*flown, jax.random.key(match.seed)))


def drawn_numbers(run: SavedRun, match: Match) -> dict[str, Any]:
    """Which numbers the drones of `match` have, over the nominal ones, by setting and side; empty
    where none is random. Plain JSON; the fights are in the order of `play`.
    """
    fights, combat = _fights_of(run, match)
    start_key, _ = jax.random.split(jax.random.key(match.seed))
    start = start_fights(combat, start_key, fights)
    drones = drone_names(combat.sides)
    numbers = {
        name: {drone: factors[:, i].round(4).tolist() for i, drone in enumerate(drones)}
        for name, factors in drawn_in(combat.config, start, slice(None)).items()
    }
    return {"drawn": numbers} if numbers else {}


def _fights_of(run: SavedRun, match: Match) -> tuple[int, Combat]:
    """How many fights of which game."""
    config = game_flown(run.config, match)
    scene = run.combat.scene if config.game.sides == run.config.game.sides else None
    return match.fights or run.config.run.evaluation_fights, Combat(config, scene)


def game_flown(config: Config, match: Match) -> Config:
    """The game of `match` with a run of these settings: other starts, other sizes of the teams.

    UserError where the run's policies cannot fly in teams of that size.
    """
    trained, config = config.game, with_starts(config, match.spawn)
    game = replace(
        config.game,
        defenders=match.defenders or trained.defenders,
        attackers=match.attackers or trained.attackers,
    )
    if game.sides == trained.sides:
        return config
    needed, length = (layout_of(trained.observation, rules).size for rules in (trained, game))
    if needed != length:
        raise UserError(
            f"policies that fly {spelt(trained.sides)} see {needed} numbers, in fights of "
            f"{spelt(game.sides)} they would see {length}: game.observation = "
            f"{one_line(trained.observation)} grows with the teams, nearest does not"
        )
    if config.learn.mates == "own":
        raise UserError(
            f"with learn.mates = own each drone of {spelt(trained.sides)} has a policy, and nobody "
            f"has one for fights of {spelt(game.sides)}"
        )
    flown, known = replace(config, game=game), problems(config)
    if broken := [problem for problem in problems(flown) if problem not in known]:
        raise UserError(broken[0].message)
    return flown


def summary(config: Config, result: FightResult) -> dict[str, Any]:
    """Shares of outcomes and causes with 95 % Wilson intervals, and lengths; plain JSON."""
    fights = len(result.cause)
    table = np.asarray(outcome_table(config.game))
    winners = table[result.cause]
    seconds = result.steps * config.control_dt
    share = lambda hits: with_interval(int(np.sum(hits)), fights)
    return {
        "fights": fights,
        "win": {outcome.name.lower(): share(winners == outcome) for outcome in Outcome},
        "cause": {cause.name.lower(): share(result.cause == cause) for cause in ENDINGS},
        "crash": _crashes(config, result),
        "seconds": {
            "mean": float(seconds.mean()),
            **{f"p{q}": float(np.percentile(seconds, q)) for q in (5, 50, 95)},
        },
    }


def _crashes(config: Config, result: FightResult) -> dict[str, Any]:
    """Shares of each side's drones that crashed, and in a team those of each drone."""
    sides, fights = config.game.sides, len(result.cause)
    share = lambda down: with_interval(int(np.sum(down)), np.size(down))
    shares = {role: share(result.down[:, team(sides, side)]) for side, role in enumerate(SIDES)}
    each = dict(zip(drone_names(sides), np.reshape(result.down, (fights, -1)).T, strict=True))
    return shares | {name: share(down) for name, down in each.items() if name not in shares}


def evaluate(
    path: Path,
    match: Match,
    chunk: int | None = None,
    own_fights: int | None = None,
) -> int:
    """Print how a run's policies fare, or one and a scripted pilot, and write it; returns 0.

    `evaluation.json` is the run's own evaluation: `own_fights` (default: as its checkpoint says)
    between its newest policies. With other options a file beside it is written, see `file_name`.
    """
    run = load_run(path, chunk)
    own_fights = run.config.run.evaluation_fights if own_fights is None else own_fights
    match = match._replace(fights=match.fights or own_fights)
    if changed := environment_diff(run.met, environment(run.config, run.combat.scene)):
        differences = "; ".join(changed)
        print(f"note: trained in another environment than the one here: {differences}", flush=True)
    steps = run.iteration * run.config.steps_per_iteration
    written = lambda name, value: (value or value is False) and name not in ("fights", "seed")
    options = {name: value for name, value in match._asdict().items() if written(name, value)}
    print(f"flying {match.fights} fights of each seed ...", flush=True)
    results = []
    for index in range(run.config.train.num_seeds):
        result = summary(game_flown(run.config, match), play(run, index, match))
        about = {"seed": run.config.train.seed + index, "start_seed": match.seed, "steps": steps}
        results.append({**options, **about, **result, **drawn_numbers(run, match)})
        print(report_text(results[-1]), flush=True)
    file = RunDirectory(path).evaluation.with_name(file_name(match, chunk, own_fights))
    write_atomic(file, json.dumps(results, indent=2) + "\n")
    print(f"written to {file}")
    return 0


def file_name(match: Match, chunk: int | None, own_fights: int) -> str:
    """`evaluation.json`, or with other options, say, `evaluation-chunk3-stochastic.json`."""
    pilots = (("defender", match.defender), ("attacker", match.attacker))
    parts = [
        f"chunk{chunk}" if chunk is not None else "",
        "stochastic" if match.stochastic else "",
        f"fights{match.fights}" if match.fights != own_fights else "",
        f"seed{match.seed}" if match.seed else "",
        *(f"{role}_{name}" for role, name in pilots if name),
        f"spawn_{match.spawn}" if match.spawn else "",
        f"defenders{match.defenders}" if match.defenders else "",
        f"attackers{match.attackers}" if match.attackers else "",
    ]
    return "-".join(["evaluation", *filter(None, parts)]) + ".json"


def is_own(path: Path, steps: int, num_seeds: int, own_fights: int) -> bool:
    """Whether `path` holds the run's own evaluation after `steps`; UserError 3 if unreadable.

    Earlier versions wrote evaluations with other options into this file, too.
    """
    try:
        rows = json.loads(path.read_bytes())
        if not isinstance(rows, list):
            raise ValueError("not a list of seeds")
        options = [(row["fights"], row["stochastic"], row.get("start_seed", 0)) for row in rows]
        flown = [row["steps"] for row in rows]
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}", EXIT_DATA) from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        reason = one_line(str(error))
        raise UserError(f"{path}: damaged or no evaluation: {reason}", EXIT_DATA) from None
    return flown == [steps] * num_seeds and options == [(own_fights, False, 0)] * num_seeds


def report_text(result: dict[str, Any]) -> str:
    """One seed's result as a small table."""
    how = "drawn actions" if result["stochastic"] else "mean actions"
    scripted = [f", {role} is the scripted {result[role]}" for role in SIDES if role in result]
    starts = f", {result['spawn']} starts" if "spawn" in result else ""
    teams = [f", {result[side]} {side}" for side in ("defenders", "attackers") if side in result]
    lines = [
        f"seed {result['seed']} after {result['steps']:,} steps: {result['fights']} fights, {how}"
        f"{''.join(scripted)}{starts}{''.join(teams)} (95 % interval)"
    ]
    for group in ("win", "cause", "crash"):
        for name, (share, low, high) in result[group].items():
            if group == "win" or share > 0:
                shown = "tie" if name == "draw" else name
                lines.append(f"  {group:<6} {shown:<15} {share:6.3f}  [{low:.3f}, {high:.3f}]")
    length = result["seconds"]
    lines.append(
        f"  length {length['mean']:.2f} s (median {length['p50']:.2f}, 5-95 % {length['p5']:.2f}-{length['p95']:.2f})"
    )
    return "\n".join(lines)


def with_interval(hits: int, total: int) -> tuple[float, float, float]:
    """The share and its 95 % score interval (Wilson 1927)."""
    interval = stats.binomtest(hits, total).proportion_ci(0.95, method="wilson")
    return hits / total, float(interval.low), float(interval.high)

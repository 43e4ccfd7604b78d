"""`dronecombat evaluate`: the two policies of a run fight, and the outcomes are counted."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from dronecombat_jax.arena.match import fight, policy_pilot, start_fights
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.fingerprint import environment, environment_diff
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.combat.scripted import Pilot, build_pilot
from dronecombat_jax.config import Config
from dronecombat_jax.learn.rollout import policy_of, select
from dronecombat_jax.runs.atomic import write_atomic
from dronecombat_jax.runs.policy import as_flown
from dronecombat_jax.runs.records import ENDINGS
from dronecombat_jax.runs.resume import load_state, newest_start
from dronecombat_jax.runs.rundir import RunDirectory
from dronecombat_jax.types import ATTACKER, DEFENDER, ROLES, FightResult, Outcome, Policy, TrainState


class SavedRun(NamedTuple):
    """A run as read from disk."""

    config: Config
    combat: Combat
    iteration: int
    state: TrainState  # NumPy leaves [S, ...]
    met: dict[str, Any]  # the environment that it was trained in (`combat.fingerprint`)


def load_run(path: Path, chunk: int | None = None) -> SavedRun:
    """Read a checkpoint (`chunk` 0: untrained; None: the newest) and the configuration it was made with. UserError 3."""
    start = newest_start(RunDirectory(path), chunk)
    combat = Combat(start.config)
    met = start.meta.get("environment") or environment(start.config, combat.scene)
    return SavedRun(start.config, combat, start.iteration, load_state(start, combat), met)


def policies(run: SavedRun, seed_index: int) -> tuple[Policy, Policy]:
    """Defender's and attacker's policy of one of the run's seeds, as they are flown."""
    learners = jax.tree.map(lambda leaf: leaf[seed_index], run.state.learners)
    of_role = lambda role: as_flown(policy_of(select(learners, role)), run.config.learn)
    return of_role(DEFENDER), of_role(ATTACKER)


class Match(NamedTuple):
    """Which fights to fly with a run."""

    fights: int = 256
    seed: int = 0  # of the start states
    stochastic: bool = False  # draw the policies' actions instead of taking their mean
    defender: str = ""  # a scripted pilot in the defender's place (combat.scripted.PILOTS); "": the run's own
    attacker: str = ""
    spawn: str = ""  # "fixed" (the three points themselves) or "uniform" starts; "": those of the run


def play(run: SavedRun, seed_index: int, match: Match) -> FightResult:
    """The fights of `match` with the policies of one of the run's seeds; NumPy leaves. UserError for an unknown pilot."""
    game = run.config.game
    if match.spawn:
        game = replace(game, spawn=match.spawn, spawn_spread=0.0, defender_spread=0.0)
    config = replace(run.config, game=game)
    combat = Combat(config, run.combat.scene)
    learn = config.learn

    def pilot(name: str, policy: Policy, role: int) -> Pilot:
        if name:
            return build_pilot(name, config, combat.scene, role)
        return policy_pilot(learn, policy, role, match.stochastic)

    def fly(defender: Policy, attacker: Policy, key: jax.Array) -> FightResult:
        start_key, fight_key = jax.random.split(key)
        return fight(
            combat,
            pilot(match.defender, defender, DEFENDER),
            pilot(match.attacker, attacker, ATTACKER),
            start_fights(combat, start_key, match.fights),
            fight_key,
        )

    return jax.device_get(jax.jit(fly)(*policies(run, seed_index), jax.random.key(match.seed)))


def summary(config: Config, result: FightResult) -> dict[str, Any]:
    """Shares of outcomes and causes with 95 % Wilson intervals, and lengths; plain JSON."""
    fights = len(result.cause)
    table = np.asarray(outcome_table(config.game))
    winners = table[result.cause]
    seconds = result.steps * config.control_dt
    share = lambda hits: _wilson(int(np.sum(hits)), fights)
    return {
        "fights": fights,
        "win": {outcome.name.lower(): share(winners == outcome) for outcome in Outcome},
        "cause": {cause.name.lower(): share(result.cause == cause) for cause in ENDINGS},
        "crash": {role: share(result.down[:, agent]) for agent, role in enumerate(ROLES)},
        "seconds": {
            "mean": float(seconds.mean()),
            **{f"p{q}": float(np.percentile(seconds, q)) for q in (5, 50, 95)},
        },
    }


def evaluate(path: Path, match: Match, chunk: int | None = None) -> int:
    """Print how a run's policies fare, against each other or a scripted pilot; returns 0.

    Against each other, from the run's own starts, it is written to `evaluation.json`, too.
    """
    run = load_run(path, chunk)
    if changed := environment_diff(run.met, environment(run.config, run.combat.scene)):
        told = "; ".join(changed)
        print(f"note: trained in another environment than the one here: {told}", flush=True)
    steps = run.iteration * run.config.steps_per_iteration
    results = []
    for index in range(run.config.train.num_seeds):
        result = summary(run.config, play(run, index, match))
        told = {
            name: value for name, value in match._asdict().items() if value != "" and name not in ("fights", "seed")
        }
        results.append({**told, "seed": run.config.train.seed + index, "steps": steps, **result})
        print(report_text(results[-1]))
    if match.defender or match.attacker or match.spawn:
        return 0
    write_atomic(RunDirectory(path).evaluation, json.dumps(results, indent=2) + "\n")
    print(f"written to {RunDirectory(path).evaluation}")
    return 0


def report_text(result: dict[str, Any]) -> str:
    """One seed's result as a small table."""
    how = "drawn actions" if result["stochastic"] else "mean actions"
    scripted = [f", {role} is the scripted {result[role]}" for role in ROLES if role in result]
    starts = f", {result['spawn']} starts" if "spawn" in result else ""
    lines = [
        f"seed {result['seed']} after {result['steps']:,} steps: {result['fights']} fights, {how}"
        f"{''.join(scripted)}{starts} (95 % interval)"
    ]
    for group in ("win", "cause", "crash"):
        for name, (share, low, high) in result[group].items():
            if group == "win" or share > 0:
                lines.append(f"  {group:<6} {name:<15} {share:6.3f}  [{low:.3f}, {high:.3f}]")
    length = result["seconds"]
    lines.append(
        f"  length {length['mean']:.2f} s (median {length['p50']:.2f}, 5-95 % {length['p5']:.2f}-{length['p95']:.2f})"
    )
    return "\n".join(lines)


def _wilson(hits: int, total: int) -> tuple[float, float, float]:
    """Share and its 95 % score interval (Wilson 1927)."""
    z, share = 1.959964, hits / total
    centre = (share + z * z / (2 * total)) / (1 + z * z / total)
    half = z / (1 + z * z / total) * math.sqrt(share * (1 - share) / total + z * z / (4 * total * total))
    return share, max(0.0, centre - half), min(1.0, centre + half)

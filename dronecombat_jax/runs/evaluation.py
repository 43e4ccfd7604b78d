"""`dronecombat evaluate`: the two policies of a run fight, and the outcomes are counted."""

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from dronecombat_jax import settings
from dronecombat_jax.arena.match import fight, policy_pilot, start_fights
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config import Config
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.learn.rollout import policy_of, select
from dronecombat_jax.runs import checkpoint
from dronecombat_jax.runs.atomic import write_atomic
from dronecombat_jax.runs.records import ENDINGS
from dronecombat_jax.runs.rundir import RunDirectory
from dronecombat_jax.selfplay.chunk import init_state
from dronecombat_jax.types import ATTACKER, DEFENDER, ROLES, FightResult, Outcome, Policy, TrainState


class SavedRun(NamedTuple):
    """A run as read from disk."""

    config: Config
    combat: Combat
    iteration: int
    state: TrainState  # NumPy leaves [S, ...]


def load_run(path: Path, chunk: int | None = None) -> SavedRun:
    """Read a run's configuration and a checkpoint (`chunk` 0: untrained; None: the newest). UserError 3."""
    run = RunDirectory(path)
    config = settings.load(run.config, {})
    if chunk is None:
        iteration = checkpoint.latest(run.checkpoints, set_aside=False)
        if iteration is None:
            raise UserError(f"{run.checkpoints}: no checkpoint that can be used", EXIT_DATA)
    else:
        iteration = chunk * config.train.chunk_iterations
    combat = Combat(config)
    template = jax.eval_shape(lambda: init_state(combat))
    return SavedRun(config, combat, iteration, checkpoint.restore(run.checkpoints, iteration, template))


def policies(run: SavedRun, seed_index: int) -> tuple[Policy, Policy]:
    """Defender's and attacker's policy of one of the run's seeds."""
    learners = jax.tree.map(lambda leaf: leaf[seed_index], run.state.learners)
    return policy_of(select(learners, DEFENDER)), policy_of(select(learners, ATTACKER))


def play(run: SavedRun, seed_index: int, fights: int, seed: int, stochastic: bool = False) -> FightResult:
    """`fights` fights between the policies of one seed, from start states drawn by `seed`; NumPy leaves."""

    def match(defender: Policy, attacker: Policy, key: jax.Array) -> FightResult:
        learn = run.config.learn
        start_key, fight_key = jax.random.split(key)
        return fight(
            run.combat,
            policy_pilot(learn, defender, DEFENDER, stochastic),
            policy_pilot(learn, attacker, ATTACKER, stochastic),
            start_fights(run.combat, start_key, fights),
            fight_key,
        )

    return jax.device_get(jax.jit(match)(*policies(run, seed_index), jax.random.key(seed)))


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


def evaluate(path: Path, fights: int, chunk: int | None = None, seed: int = 0, stochastic: bool = False) -> int:
    """Print how the policies of a run fare against each other, and write `evaluation.json`; returns 0."""
    run = load_run(path, chunk)
    steps = run.iteration * run.config.steps_per_iteration
    results = []
    for index in range(run.config.train.num_seeds):
        result = summary(run.config, play(run, index, fights, seed, stochastic))
        results.append({"seed": run.config.train.seed + index, "steps": steps, "stochastic": stochastic, **result})
        print(report_text(results[-1]))
    write_atomic(RunDirectory(path).evaluation, json.dumps(results, indent=2) + "\n")
    print(f"written to {RunDirectory(path).evaluation}")
    return 0


def report_text(result: dict[str, Any]) -> str:
    """One seed's result as a small table."""
    how = "drawn actions" if result["stochastic"] else "mean actions"
    lines = [f"seed {result['seed']} after {result['steps']:,} steps: {result['fights']} fights, {how} (95 % interval)"]
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

"""From a program call's metrics to what people read: one flat record per iteration, one progress
line.
"""

import math
from typing import Any

import numpy as np

from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.opponents import LIVE, learns
from dronecombat_jax.config.sides import DUEL, drone_names, team
from dronecombat_jax.runs.progress import ProgressUpdate
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES, Cause, IterationMetrics, Outcome

AGAINST = "against/"  # before an opponent's name, in a record
ENDINGS = tuple(cause for cause in Cause if cause != Cause.NONE)


def records(config: Config, report: IterationMetrics, first_iteration: int) -> list[dict[str, Any]]:
    """One record per iteration and seed, rising; leaves of `report` are NumPy [S, I, ...].

    Shares, lengths and returns are of the counted fights that ended in the iteration, those flown
    from start to end by the same two (`selfplay.tally`), and NaN where none did. What a learner
    reports is None where it did not learn.
    """
    seeds, iterations = report.causes.shape[:2]
    learning = learning_pupils(config, report, first_iteration)
    return [
        _record(
            config,
            _pick(report, seed, i),
            first_iteration + i,
            config.train.seed + seed,
            learning[seed, i],
        )
        for i in range(iterations)
        for seed in range(seeds)
    ]


def learning_pupils(config: Config, report: IterationMetrics, first_iteration: int) -> np.ndarray:
    """Who learnt, [S, I, L] bool: not a defender that waits, nor a role that was played by its past
    or by another opponent, nor a side too far ahead.
    """
    from dronecombat_jax.selfplay.chunk import rests, waits

    frozen = np.asarray(report.frozen)  # [S, I]
    learning = np.arange(len(SIDES)) != frozen[..., None]
    learning &= np.asarray([learns(config, side) for side in range(len(SIDES))])
    iterations = first_iteration + np.arange(frozen.shape[1])
    learning[..., DEFENDER] &= ~np.asarray(waits(config, iterations))  # pyright: ignore[reportArgumentType]
    if config.train.lead_limit < 1.0:
        learning &= ~np.asarray(rests(config, report.causes, learning))  # pyright: ignore[reportArgumentType]
    return learning[..., [pupil.side for pupil in config.pupils]]


def progress_update(
    config: Config, report: IterationMetrics, iterations_done: int
) -> ProgressUpdate:
    """What the progress line shows after a call, all its iterations and seeds together."""
    causes = report.causes.sum(axis=(0, 1))
    crashes = _by_side(config, report.crashes.sum(axis=(0, 1)))
    wins, episodes = _wins(config, causes), causes.sum()
    chunk = -(-iterations_done // config.train.chunk_iterations)
    return ProgressUpdate(
        steps=iterations_done * config.steps_per_iteration * config.train.num_seeds,
        defender_wins=_share(wins[Outcome.DEFENDER], episodes),
        attacker_wins=_share(wins[Outcome.ATTACKER], episodes),
        ties=_share(wins[Outcome.DRAW], episodes),
        defender_crashes=_share(crashes[DEFENDER], episodes),
        attacker_crashes=_share(crashes[ATTACKER], episodes),
        note=f"chunk {chunk}/{config.num_chunks}",
    )


def _record(
    config: Config, report: IterationMetrics, iteration: int, seed: int, learning: np.ndarray
) -> dict[str, Any]:
    episodes = int(report.causes.sum())
    wins = _wins(config, report.causes)
    diverged, is_frozen = int(report.diverged), int(report.frozen) >= 0
    record: dict[str, Any] = {
        "iteration": iteration + 1,
        "steps": (iteration + 1) * config.steps_per_iteration,
        "seed": seed,
        "chunk": iteration // config.train.chunk_iterations + 1,
        "frozen": int(report.frozen) if is_frozen else None,
        "opponent": float(report.opponent) if is_frozen and report.opponent >= 0 else None,
        "diverged": diverged,
        "diverged_environments": diverged / config.train.num_envs,
        "episodes": episodes,
        "episode_steps": _share(report.episode_steps, episodes),
    }
    record |= {
        f"outcome/{cause.name.lower()}": _share(report.causes[cause], episodes) for cause in ENDINGS
    }
    record |= {
        f"win/{outcome.name.lower()}": _share(wins[outcome], episodes) for outcome in Outcome
    }
    record |= met_by_row(config, report.met)
    terms = {name: _by_side(config, term) for name, term in report.reward_terms._asdict().items()}
    crashes, returns = _by_side(config, report.crashes), _by_side(config, report.returns)
    for side, role in enumerate(SIDES):
        record[f"crash/{role}"] = _share(crashes[side], episodes)
        record |= {f"reward/{role}/{name}": float(term[side]) for name, term in terms.items()}
        record[f"return/{role}"] = _share(returns[side], episodes)
        own = [index for index, pupil in enumerate(config.pupils) if pupil.side == side]
        record |= _learnt(role, report, own, learning)
    return record | _of_drones(config, report, episodes, learning)


def _learnt(
    name: str, report: IterationMetrics, own: list[int], learning: np.ndarray
) -> dict[str, float | None]:
    """What the learners `own`, who learn or wait together, report: the mean of them."""
    return {
        f"{key}/{name}": float(np.mean(np.asarray(value)[own])) if learning[own[0]] else None
        for key, value in report.learners._asdict().items()
    }


def _by_side(config: Config, values: Any) -> tuple[Any, Any]:
    """The mean of each side's drones, of `values` [A]."""
    sides = config.game.sides
    if sides == DUEL:
        return values[DEFENDER], values[ATTACKER]
    return values[team(sides, DEFENDER)].mean(), values[team(sides, ATTACKER)].mean()


def _of_drones(
    config: Config, report: IterationMetrics, episodes: int, learning: np.ndarray
) -> dict[str, float | None]:
    """What each drone of a team did, and learnt, on its own; empty in a duel."""
    sides = config.game.sides
    record: dict[str, float | None] = {}
    for drone, (name, side) in enumerate(zip(drone_names(sides), sides, strict=True)):
        if sides.count(side) > 1:
            record[f"crash/{name}"] = _share(report.crashes[drone], episodes)
            record[f"return/{name}"] = _share(report.returns[drone], episodes)
    for index, pupil in enumerate(config.pupils):
        if pupil.name not in SIDES:
            record |= _learnt(pupil.name, report, [index], learning)
    return record


def met_by_row(config: Config, met: Any) -> dict[str, int]:
    """Counted fights against each opponent of the table, by who won; `met` [R, 3] or None.

    Such as `against/defender=scripted:hover/attacker`: how many of its fights the attacker won.
    """
    from dronecombat_jax.selfplay.opponents import counted_rows

    if met is None:
        return {}
    return {
        f"{AGAINST}{row.name if row else LIVE}/{outcome.name.lower()}": int(met[index, outcome])
        for index, row in enumerate(counted_rows(config))
        for outcome in Outcome
    }


def _wins(config: Config, causes: Any) -> dict[Outcome, float]:
    table = outcome_table(config.game)
    return {
        outcome: sum(causes[cause] for cause in ENDINGS if table[cause] == outcome)
        for outcome in Outcome
    }


def _share(count: Any, total: Any) -> float:
    return float(count) / float(total) if total else math.nan


def _pick(report: IterationMetrics, seed: int, iteration: int) -> IterationMetrics:
    import jax

    return jax.tree.map(lambda leaf: leaf[seed, iteration], report)

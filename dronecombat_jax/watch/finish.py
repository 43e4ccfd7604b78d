"""What a finished run leaves for a person: learning curves, an evaluation, a picture and a video of
a fight.
"""

from pathlib import Path

import jax
import numpy as np

from dronecombat_jax.arena.match import (
    Team,
    policy_team,
    record,
    scripted_team,
    start_fights,
    trajectory,
)
from dronecombat_jax.config.fields import Config
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files import metrics
from dronecombat_jax.files.rundir import RunDirectory
from dronecombat_jax.report.figures import learning_curves
from dronecombat_jax.report.video import render_fight
from dronecombat_jax.runs.evaluation import (
    Match,
    SavedRun,
    evaluate,
    flown_by,
    is_own,
    load_run,
    shown_to,
)
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, FightRecord, SidePolicy, Trajectory
from dronecombat_jax.watch.replay import write_replay

RECORDED_FIGHTS = 32
EVOLUTION = "dronecombat replay --evolution"


def finish(config: Config) -> None:
    """Draw, evaluate and film the run that `config.run` names.

    What cannot be drawn is said in one line.
    """
    run = RunDirectory(Path(config.run.directory) / config.run.name)
    if not run.path.is_dir():
        print(f"{run.path} has gone: no figures and no evaluation", flush=True)
        return
    if _is_finished(run, config):
        return
    if config.run.figures:
        _draw_curves(run)
    evaluate(run.path, Match(), own_fights=config.run.evaluation_fights)
    if config.run.video:
        saved = load_run(run.path)
        fight = typical_fight(saved, 0)
        try:
            render_fight(
                fight,
                saved.combat.scene,
                run.figures / "fight.png",
                run.video,
                intercept_radius=config.game.intercept_radius,
                reach_radius=config.game.reach_radius,
            )
        except UserError as error:
            print(f"no picture of a fight: {error.message}", flush=True)
        else:
            print(f"a fight: {run.figures / 'fight.png'} and {run.video}", flush=True)
    if config.run.replay:
        write_replay(run.path)
        print(
            f"replay: {run.replay} (open it in a browser; over the training: {EVOLUTION} {run.path})",
            flush=True,
        )


def _draw_curves(run: RunDirectory) -> None:
    """Draw the learning curves; damaged or missing metrics cost only them."""
    picture = run.figures / "learning.png"
    try:
        learning_curves(metrics.read(run.metrics), picture, run.name)
    except UserError as error:
        if error.exit_code != EXIT_DATA:
            raise
        print(f"no learning curves: {error.message}", flush=True)
    else:
        print(f"learning curves: {picture}", flush=True)


def _is_finished(run: RunDirectory, config: Config) -> bool:
    """Whether the last checkpoint has been evaluated and filmed already."""
    wanted = [run.evaluation]
    wanted += [run.figures / "learning.png"] if config.run.figures else []
    wanted += [run.video] if config.run.video else []
    wanted += [run.replay] if config.run.replay else []
    if not all(path.is_file() for path in wanted):
        return False
    steps = config.num_chunks * config.steps_per_chunk
    try:
        return is_own(run.evaluation, steps, config.train.num_seeds, config.run.evaluation_fights)
    except UserError as error:
        print(f"{error.message}; its fights are flown anew", flush=True)
        return False


def typical_fight(run: SavedRun, seed_index: int) -> Trajectory:
    """The fight of median length among those that ended in the most frequent way; strikes come
    first.
    """
    fights = record_fights(run, seed_index)
    cause, steps = np.asarray(fights.result.cause), np.asarray(fights.result.steps)
    struck = np.isin(cause, (Cause.INTERCEPT, Cause.REACHED))
    pool = np.flatnonzero(struck) if struck.any() else np.arange(len(cause))
    commonest = np.bincount(cause[pool]).argmax()
    pool = pool[cause[pool] == commonest]
    return trajectory(run.combat, fights, int(pool[np.argsort(steps[pool])[len(pool) // 2]]))


def record_fights(
    run: SavedRun, seed_index: int, fights: int = RECORDED_FIGHTS, seed: int = 0
) -> FightRecord:
    """Record fights of one seed's policies flying their mean actions; NumPy leaves."""

    who, combat = flown_by(run, seed_index), run.combat

    def team(policy: SidePolicy | None, role: int) -> Team:
        if policy is None:
            return scripted_team(combat, str(who[role]), role)
        seen = shown_to(run, role)
        return policy_team(run.config, run.config.learn, policy, role, observation=seen)

    def match(
        defender: SidePolicy | None, attacker: SidePolicy | None, key: jax.Array
    ) -> FightRecord:
        start_key, fight_key = jax.random.split(key)
        teams = team(defender, DEFENDER), team(attacker, ATTACKER)
        return record(combat, *teams, start_fights(combat, start_key, fights), fight_key)

    flown = [None if isinstance(flyer, str) else flyer for flyer in who]
    return jax.device_get(jax.jit(match)(*flown, jax.random.key(seed)))

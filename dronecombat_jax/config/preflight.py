"""Rules that need more than one setting, and the memory a run will take, before anything is
allocated.

What does not live here: the range of a single setting (`schema`), reading files (`settings`), or
whether a device exists (`machine.backend`). Nothing imports JAX.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from dronecombat_jax.config import flight_rules, network_rules, opponent_rules
from dronecombat_jax.config.devices import uneven_devices
from dronecombat_jax.config.estimates import (
    bytes_in_words,
    estimated_bytes,
    estimated_disk_bytes,
    free_bytes,
    keep_rule,
    machine_bytes,
)
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.problem import Problem
from dronecombat_jax.config.sides import DUEL, spelt

NO_WANDB = "it needs the wandb package. Fix: pip install 'dronecombat-jax[wandb]'"
_NAME = re.compile(r"(?!\.)[A-Za-z0-9._-]{0,100}")


def problems(config: Config) -> list[Problem]:
    """All rules that `config` breaks, on any machine; an empty list where it is sound."""
    if misspelt := opponent_rules.misspelt(config):
        plain = replace(config, selfplay=replace(config.selfplay, opponents=""))
        return misspelt + problems(plain)
    return [
        *flight_rules.broken(config),
        *_game(config),
        *_learning(config),
        *network_rules.broken(config),
        *_selfplay(config),
        *opponent_rules.broken(config),
        *_training(config),
        *_run(config),
    ]


def memory_problems(config: Config) -> list[Problem]:
    """One problem where training needs more memory than this machine has."""
    needed, available = estimated_bytes(config), machine_bytes()
    if available is None or needed <= available:
        return []
    envs, steps, seeds = config.train.num_envs, config.learn.rollout_steps, config.train.num_seeds
    return [
        Problem(
            ("train.num_envs", "learn.rollout_steps", "train.num_seeds", "learn.hidden_sizes"),
            f"train.num_envs = {envs}, learn.rollout_steps = {steps}, train.num_seeds = {seeds} need about "
            f"{bytes_in_words(needed)} of memory, and this machine has {bytes_in_words(available)}",
        )
    ]


def package_problems(config: Config) -> list[Problem]:
    """One problem where a package is missing that `config` asks for and that is an extra."""
    if config.run.wandb == "off" or has_wandb():
        return []
    return [Problem(("run.wandb",), f"run.wandb = {config.run.wandb}: {NO_WANDB}")]


def has_wandb() -> bool:
    """Whether the package is installed. TRAP: it leaves folders called wandb, which look like one."""
    spec = find_spec("wandb")
    return spec is not None and spec.origin is not None


def disk_problems(config: Config) -> list[Problem]:
    """One problem where the run will need more disk than is free; what it has written already
    counts as free.
    """
    needed, free = (
        estimated_disk_bytes(config),
        free_bytes(Path(config.run.directory) / (config.run.name or "run")),
    )
    if free is None or needed <= free:
        return []
    return [
        Problem(
            (
                "run.keep",
                "train.total_steps",
                "train.chunk_iterations",
                "train.num_seeds",
                "run.directory",
            ),
            f"run.keep = {config.run.keep!r}: {config.num_chunks} chunks need about {bytes_in_words(needed)} on the disk of "
            f'{config.run.directory}, and {bytes_in_words(free)} are free; run.keep = "every 10" or "last 5" needs less',
        )
    ]


def _game(config: Config) -> Iterator[Problem]:
    game = config.game
    low, high, crash = game.spawn_altitude_low, game.spawn_altitude_high, game.crash_altitude
    if low > high:
        yield Problem(
            ("game.spawn_altitude_low", "game.spawn_altitude_high"),
            f"game.spawn_altitude_low = {low:g} must not exceed game.spawn_altitude_high = {high:g}",
        )
    for name in ("spawn_spread", "defender_spread", "defender_setback"):
        if game.spawn == "uniform" and (value := getattr(game, name)):
            yield Problem(
                ("game.spawn", f"game.{name}"),
                f"game.{name} = {value:g} is of fixed starts; with game.spawn = uniform it must be 0",
            )
    if game.crash_rule == "grounded" and game.sides != DUEL:
        yield Problem(
            ("game.crash_rule", "game.defenders", "game.attackers"),
            f"game.crash_rule = grounded is for one drone a side, not {spelt(game.sides)}: "
            "ends or out is allowed",
        )
    if crash >= low:
        yield Problem(
            ("game.crash_altitude", "game.spawn_altitude_low"),
            f"game.crash_altitude = {crash:g} must be below game.spawn_altitude_low = {low:g}, or drones start crashed",
        )


def _learning(config: Config) -> Iterator[Problem]:
    learn = config.learn
    batch = config.steps_per_iteration
    if batch % learn.minibatches:
        yield Problem(
            ("learn.minibatches", "train.num_envs", "learn.rollout_steps"),
            f"train.num_envs * learn.rollout_steps = {config.train.num_envs} * {learn.rollout_steps} = {batch} must be a "
            f"multiple of learn.minibatches = {learn.minibatches}; nearest that fit: {_nearest_batches(config)}",
        )
    together = batch - config.solo_envs * learn.rollout_steps
    if config.selfplay.opponents:
        together = batch  # the whole table is asked (`opponent_rules`)
    if batch % learn.minibatches == 0 and (together == 0 or together % learn.minibatches):
        yield Problem(
            ("train.solo_share", "learn.minibatches", "train.num_envs", "learn.rollout_steps"),
            f"train.solo_share = {config.train.solo_share:g} leaves the defender {config.train.num_envs - config.solo_envs} "
            f"environments and {together} steps a rollout, which must be a multiple of learn.minibatches = "
            f"{learn.minibatches}",
        )
    if learn.critic == "central" and learn.algorithm != "ppo":
        yield Problem(
            ("learn.critic", "learn.algorithm"),
            f"learn.critic = central needs learn.algorithm = ppo: what {learn.algorithm} sees is its own business",
        )
    low, start, high = learn.min_learning_rate, learn.learning_rate, learn.max_learning_rate
    if low > high or (learn.learning_rate_schedule == "kl" and not low <= start <= high):
        yield Problem(
            ("learn.learning_rate", "learn.min_learning_rate", "learn.max_learning_rate"),
            "learn.min_learning_rate <= learn.learning_rate <= learn.max_learning_rate must hold, "
            f"but they are {low:g}, {start:g}, {high:g}",
        )
    low, start, high = learn.min_log_std, learn.initial_log_std, learn.max_log_std
    if not low <= start <= high:
        yield Problem(
            ("learn.initial_log_std", "learn.min_log_std", "learn.max_log_std"),
            "learn.min_log_std <= learn.initial_log_std <= learn.max_log_std must hold, "
            f"but they are {low:g}, {start:g}, {high:g}",
        )


def _selfplay(config: Config) -> Iterator[Problem]:
    probability = config.selfplay.probability
    if probability > 0.0 and config.game.scenario == "solo":
        yield Problem(
            ("selfplay.probability", "game.scenario"),
            f'selfplay.probability = {probability:g} needs game.scenario = "duel": in "solo" nobody learns to meet the attacker',
        )


def _training(config: Config) -> Iterator[Problem]:
    share = config.train.solo_share
    if share > 0.0 and config.game.scenario == "solo":
        yield Problem(
            ("train.solo_share", "game.scenario"),
            f'train.solo_share = {share:g} needs game.scenario = "duel": in "solo" the attacker flies alone everywhere',
        )


def _run(config: Config) -> Iterator[Problem]:
    if not _NAME.fullmatch(config.run.name):
        yield Problem(
            ("run.name",),
            "run.name must be at most 100 of A-Z a-z 0-9 . _ - and not start with a dot",
        )
    if keep_rule(config.run.keep) is None:
        yield Problem(
            ("run.keep",), f'run.keep = {config.run.keep!r} must be "all", "every N" or "last N"'
        )
    if not config.run.directory:
        yield Problem(("run.directory",), "run.directory must not be empty")
    if uneven := uneven_devices(config, config.run.devices or 1):
        yield Problem(("run.devices", "train.num_seeds", "train.num_envs"), uneven)
    last = config.train.seed + config.train.num_seeds - 1
    if last > 2**31 - 1:
        yield Problem(
            ("train.seed", "train.num_seeds"),
            f"the last seed, train.seed + train.num_seeds - 1 = {last}, must be at most {2**31 - 1}",
        )
    iterations = config.num_chunks * config.train.chunk_iterations
    if iterations > 2**31 - 1:  # the program counts them in an int32
        yield Problem(
            ("train.total_steps", "train.num_envs", "learn.rollout_steps"),
            f"train.total_steps = {config.train.total_steps} are {iterations} iterations of "
            f"{config.steps_per_iteration} environment steps; they must be at most {2**31 - 1}",
        )


def _nearest_batches(config: Config) -> str:
    """The neighbours that divide: of `minibatches` with the batch fixed, of `num_envs` otherwise."""
    batch, wanted, envs = (
        config.steps_per_iteration,
        config.learn.minibatches,
        config.train.num_envs,
    )
    fewer = next(n for n in range(min(wanted, batch), 0, -1) if batch % n == 0)
    more = next((n for n in range(wanted + 1, min(batch, 100_000) + 1) if batch % n == 0), None)
    step = wanted // math.gcd(wanted, config.learn.rollout_steps)
    below = envs // step * step
    counts = f"{below} or {below + step}" if below else f"{step}"
    return f"learn.minibatches {fewer}{f' or {more}' if more else ''}, train.num_envs {counts}"

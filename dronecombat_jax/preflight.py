"""Rules that need more than one setting, and the memory a run will take, before anything is allocated.

What does not live here: the range of a single setting (`schema`), reading files (`settings`), or
whether a device exists (`backend`). Nothing imports JAX.
"""

import math
import os
import re
import shutil
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from dronecombat_jax.config import Config

OBSERVATION_SIZE = 35  # eq. 5
ACTION_SIZE = 4
AGENTS = 2
PHYSICS_BYTES = 4700  # of MJX's arrays per environment (measured, docs/performance.md)
MAX_DEVICES = 1024
FIGHT_FLOATS = 36  # of one fight in a checkpoint
CHECKPOINT_BYTES = 40_000  # of a checkpoint's tables (measured)
RECORD_BYTES = 3_500  # of an iteration's records in metrics.jsonl and for TensorBoard (measured)
KEPT_ANYWAY = 2  # checkpoints: should the newest be damaged, there is another
_KEEP = re.compile(r"(every|last) ([1-9][0-9]{0,8})")
_NAME = re.compile(r"(?!\.)[A-Za-z0-9._-]{0,100}")
_CGROUP = Path("/sys/fs/cgroup/memory.max")


class Problem(NamedTuple):
    """A rule that is broken: the settings involved, the likeliest culprit first, and the rule."""

    keys: tuple[str, ...]
    message: str


def problems(config: Config) -> list[Problem]:
    """All rules that `config` breaks, on any machine; an empty list where it is sound."""
    return [*_flight(config), *_game(config), *_learning(config), *_selfplay(config), *_training(config), *_run(config)]


def memory_problems(config: Config) -> list[Problem]:
    """One problem where training needs more memory than this machine has."""
    needed, there = estimated_bytes(config), machine_bytes()
    if there is None or needed <= there:
        return []
    envs, steps, seeds = config.train.num_envs, config.learn.rollout_steps, config.train.num_seeds
    return [
        Problem(
            ("train.num_envs", "learn.rollout_steps", "train.num_seeds", "learn.hidden_sizes"),
            f"train.num_envs = {envs}, learn.rollout_steps = {steps}, train.num_seeds = {seeds} need about "
            f"{bytes_in_words(needed)} of memory, and this machine has {bytes_in_words(there)}",
        )
    ]


def disk_problems(config: Config) -> list[Problem]:
    """One problem where the run will need more disk than is free; what it has written already counts as free."""
    needed, free = estimated_disk_bytes(config), free_bytes(Path(config.run.directory) / (config.run.name or "run"))
    if free is None or needed <= free:
        return []
    return [
        Problem(
            ("run.keep", "train.total_steps", "train.chunk_iterations", "train.num_seeds", "run.directory"),
            f"run.keep = {config.run.keep!r}: {config.num_chunks} chunks need about {bytes_in_words(needed)} on the disk of "
            f'{config.run.directory}, and {bytes_in_words(free)} are free; run.keep = "every 10" or "last 5" needs less',
        )
    ]


def estimated_disk_bytes(config: Config) -> int:
    """What a run will have written by its end: checkpoints that stay, past players, logs (an estimate from below)."""
    train, chunks = config.train, config.num_chunks
    policy, value = _network_floats(config)
    fights = train.num_envs * FIGHT_FLOATS
    checkpoint = train.num_seeds * 4 * (AGENTS * 3 * (policy + value) + fights) + CHECKPOINT_BYTES
    players = train.num_seeds * 4 * policy * _pool_roles(config) * chunks
    logs = train.num_seeds * RECORD_BYTES * chunks * train.chunk_iterations
    return kept_checkpoints(config) * checkpoint + players + logs


def kept_checkpoints(config: Config) -> int:
    """Checkpoints that are left at a run's end, the untrained one included."""
    word, number = keep_rule(config.run.keep) or ("all", 1)
    chunks = config.num_chunks
    if word == "last":
        return min(chunks + 1, max(number, KEPT_ANYWAY))
    return len({*range(0, chunks + 1, number), *range(max(0, chunks + 1 - KEPT_ANYWAY), chunks + 1)})


def keep_rule(text: str) -> tuple[str, int] | None:
    """`run.keep` as a word and a number: ("all", 1), ("every", N) or ("last", N); None where it is none of these."""
    if text == "all":
        return "all", 1
    match = _KEEP.fullmatch(text)
    return (match[1], int(match[2])) if match else None


def free_bytes(path: Path) -> int | None:
    """Bytes free for `path` and what is below it already; None where that cannot be told."""
    try:
        existing = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
        used = sum(file.stat().st_size for file in path.rglob("*") if file.is_file()) if path.is_dir() else 0
        return shutil.disk_usage(existing).free + used
    except OSError:
        return None


def estimated_bytes(config: Config) -> int:
    """Memory for training, an estimate from below: rollout, physics, one mini-batch, learners, pool.

    Floats of four bytes. A transition of an agent holds two observations (the final one is kept), an
    action and ten scalars, and exists twice while a mini-batch is cut from it. A mini-batch holds three
    activations per hidden unit in each of two networks. A learner holds weights and Adam's two moments.
    """
    learn, train = config.learn, config.train
    transitions = train.num_envs * learn.rollout_steps
    rollout = 2 * transitions * AGENTS * (2 * OBSERVATION_SIZE + ACTION_SIZE + 10)
    minibatch = transitions // learn.minibatches * 6 * sum(learn.hidden_sizes)
    policy, value = _network_floats(config)
    learners = AGENTS * 3 * (policy + value)
    floats = rollout + minibatch + learners + _pool_floats(config, policy)
    return train.num_seeds * (4 * floats + PHYSICS_BYTES * train.num_envs)


def _network_floats(config: Config) -> tuple[int, int]:
    """Of one agent's policy, with its log-std, and of its value function."""
    sizes = (OBSERVATION_SIZE, *config.learn.hidden_sizes)
    trunk = sum((rows + 1) * columns for rows, columns in pairwise(sizes))
    return trunk + (sizes[-1] + 2) * ACTION_SIZE, trunk + sizes[-1] + 1


def _pool_floats(config: Config, policy: int) -> int:
    """Of the past players: every chunk's start, and with scope "environment" one in each environment besides."""
    environments = config.train.num_envs if config.selfplay.scope == "environment" else 0
    return policy * _pool_roles(config) * (config.num_chunks + environments)


def _pool_roles(config: Config) -> int:
    if config.selfplay.probability == 0.0:
        return 0
    return 2 if config.selfplay.roles == "both" else 1


def machine_bytes() -> int | None:
    """Memory of this machine or of the container around us; None where it cannot be told."""
    try:
        total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None
    try:
        return min(total, int(_CGROUP.read_text()))
    except (OSError, ValueError):  # no cgroup v2, or no limit ("max")
        return total


def _flight(config: Config) -> Iterator[Problem]:
    if config.sim.mjcf and config.sim.body != "isaac":
        yield Problem(
            ("sim.body", "sim.mjcf"),
            f"sim.body = {config.sim.body} is a mass and inertia for the package's drone; "
            "with sim.mjcf both come out of the file: leave sim.body out",
        )


def _game(config: Config) -> Iterator[Problem]:
    game = config.game
    low, high, crash = game.spawn_altitude_low, game.spawn_altitude_high, game.crash_altitude
    if low > high:
        yield Problem(
            ("game.spawn_altitude_low", "game.spawn_altitude_high"),
            f"game.spawn_altitude_low = {low:g} must not exceed game.spawn_altitude_high = {high:g}",
        )
    for name in ("spawn_spread", "defender_spread"):
        if game.spawn == "uniform" and (spread := getattr(game, name)):
            yield Problem(
                ("game.spawn", f"game.{name}"),
                f"game.{name} = {spread:g} widens fixed starts; with game.spawn = uniform it must be 0",
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
    if batch % learn.minibatches == 0 and (together == 0 or together % learn.minibatches):
        yield Problem(
            ("train.solo_share", "learn.minibatches", "train.num_envs", "learn.rollout_steps"),
            f"train.solo_share = {config.train.solo_share:g} leaves the defender {config.train.num_envs - config.solo_envs} "
            f"environments and {together} steps a rollout, which must be a multiple of learn.minibatches = "
            f"{learn.minibatches}",
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
        yield Problem(("run.name",), "run.name must be at most 100 of A-Z a-z 0-9 . _ - and not start with a dot")
    if keep_rule(config.run.keep) is None:
        yield Problem(("run.keep",), f'run.keep = {config.run.keep!r} must be "all", "every N" or "last N"')
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


def spread(num_seeds: int, wanted: int, available: int) -> int:
    """Devices that `num_seeds` seeds are spread over, the same number on each: `wanted`, or the most (0)."""
    most = min(num_seeds, available if wanted == 0 else wanted)
    return next(count for count in range(max(most, 1), 0, -1) if num_seeds % count == 0)


def mesh_shape(num_seeds: int, wanted: int, available: int) -> tuple[int, int]:
    """Devices along the seeds, and along the environments of each seed: in all `wanted`, or what serves best (0).

    Seeds come first, the same number on each device: they never wait for each other. Environments of one seed are
    spread only where more devices are asked for: on two cores one device does as well (docs/scaling.md).
    """
    if wanted == 0:
        return spread(num_seeds, 0, available), 1
    seeds = math.gcd(num_seeds, wanted)
    return seeds, wanted // seeds


def uneven_devices(config: Config, devices: int) -> str:
    """Why `devices` cannot share the work evenly, with the numbers that can; "" where they do."""
    seeds, envs = config.train.num_seeds, config.train.num_envs
    minibatch = config.steps_per_iteration // config.learn.minibatches
    defenders = (envs - config.solo_envs) * config.learn.rollout_steps // config.learn.minibatches

    def fits(devices: int) -> bool:
        _, each = mesh_shape(seeds, devices, devices)
        return envs % each == 0 and minibatch % each == 0 and defenders % each == 0

    if fits(devices):
        return ""
    shared, each = mesh_shape(seeds, devices, devices)
    batches = f"{minibatch}" if defenders == minibatch else f"{minibatch} (the defender's: {defenders})"
    counts = [str(count) for count in range(1, MAX_DEVICES + 1) if fits(count)]
    near = [count for count in counts if int(count) < devices][-2:] + [
        count for count in counts if int(count) > devices
    ][:2]
    return (
        f"run.devices = {devices}: {shared} for the seeds (train.num_seeds = {seeds}) leave {each} for the environments "
        f"of each, which must divide train.num_envs = {envs} and a mini-batch of {batches}; nearest that fit: {', '.join(near)}"
    )


def _nearest_batches(config: Config) -> str:
    """The neighbours that divide: of `minibatches` with the batch fixed, of `num_envs` otherwise."""
    batch, wanted, envs = config.steps_per_iteration, config.learn.minibatches, config.train.num_envs
    fewer = next(n for n in range(min(wanted, batch), 0, -1) if batch % n == 0)
    more = next((n for n in range(wanted + 1, min(batch, 100_000) + 1) if batch % n == 0), None)
    step = wanted // math.gcd(wanted, config.learn.rollout_steps)
    below = envs // step * step
    counts = f"{below} or {below + step}" if below else f"{step}"
    return f"learn.minibatches {fewer}{f' or {more}' if more else ''}, train.num_envs {counts}"


def bytes_in_words(count: int) -> str:
    """Such as 3.2 MiB or 1,500 GiB."""
    if count < 2**30:
        return f"{count / 2**20:.3g} MiB"
    return f"{count / 2**30:.3g} GiB" if count < 2**40 else f"{count / 2**30:,.0f} GiB"

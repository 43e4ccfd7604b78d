"""How much memory and disk a run will take, and how much there is.

What does not live here: whether that is enough (`preflight`). Nothing imports JAX.
"""

import os
import re
import shutil
from itertools import pairwise
from pathlib import Path

from dronecombat_jax.config import opponents
from dronecombat_jax.config.fields import Config

OBSERVATION_SIZE = 35  # eq. 5, of two drones
DRONE_SIZE, TARGET_SIZE = 16, 3  # its parts
ACTION_SIZE = 4
SIDES = 2  # learners
PHYSICS_BYTES = 4700  # of MJX's arrays per environment (measured, docs/performance.md)
FIGHT_FLOATS = 36  # of one fight in a checkpoint
CHECKPOINT_BYTES = 40_000  # of a checkpoint's tables (measured)
RECORD_BYTES = 3_500  # of an iteration's records in metrics.jsonl and for TensorBoard (measured)
KEPT_ANYWAY = 2  # checkpoints: should the newest be damaged, there is another
_KEEP = re.compile(r"(every|last) ([1-9][0-9]{0,8})")
_CGROUP = Path("/sys/fs/cgroup/memory.max")


def estimated_bytes(config: Config) -> int:
    """A lower estimate of the memory that training needs: rollout, physics, one mini-batch,
    learners, pool.

    Floats of four bytes. A transition of an agent holds two observations (the final one is kept),
    an action and ten scalars, for a central critic two whole states, too, with memory twice what is
    remembered, and exists twice while a mini-batch is cut from it. A mini-batch holds three
    activations per hidden unit in each of two networks. A learner holds weights and Adam's two
    moments.
    """
    learn, train = config.learn, config.train
    transitions = train.num_envs * learn.rollout_steps
    drones, seen = len(config.game.sides), observation_floats(config) + _recall(config)
    if learn.critic == "central":
        seen += DRONE_SIZE * drones + TARGET_SIZE + drones  # who observes
    rollout = 2 * transitions * drones * (2 * seen + ACTION_SIZE + 10)
    minibatch = transitions // learn.minibatches * 6 * sum(learn.hidden_sizes)
    policy, value = _network_floats(config)
    learners = len(config.pupils) * 3 * (policy + value)
    floats = rollout + minibatch + learners + _pool_floats(config, policy)
    return train.num_seeds * (4 * floats + PHYSICS_BYTES * train.num_envs)


def observation_floats(config: Config) -> int:
    """Of one drone's observation, as eq. 5 has it of all drones."""
    return DRONE_SIZE * len(config.game.sides) + TARGET_SIZE


def estimated_disk_bytes(config: Config) -> int:
    """A lower estimate of the disk space that a run takes at its end: kept checkpoints, past
    players, logs.
    """
    train, chunks = config.train, config.num_chunks
    policy, value = _network_floats(config)
    fights = train.num_envs * FIGHT_FLOATS
    learners = len(config.pupils) * 3 * (policy + value)
    checkpoint = train.num_seeds * 4 * (learners + fights) + CHECKPOINT_BYTES
    players = train.num_seeds * 4 * policy * _pool_policies(config) * chunks
    logs = train.num_seeds * RECORD_BYTES * chunks * train.chunk_iterations
    return kept_checkpoints(config) * checkpoint + players + logs


def kept_checkpoints(config: Config) -> int:
    """Checkpoints that are left at a run's end, the untrained one included."""
    word, number = keep_rule(config.run.keep) or ("all", 1)
    chunks = config.num_chunks
    if word == "last":
        return min(chunks + 1, max(number, KEPT_ANYWAY))
    newest = range(max(0, chunks + 1 - KEPT_ANYWAY), chunks + 1)
    return chunks // number + 1 + sum(chunk % number != 0 for chunk in newest)


def keep_rule(text: str) -> tuple[str, int] | None:
    """`run.keep` as a word and a number: ("all", 1), ("every", N) or ("last", N); None where it is
    none of these.
    """
    if text == "all":
        return "all", 1
    match = _KEEP.fullmatch(text)
    return (match[1], int(match[2])) if match else None


def free_bytes(path: Path) -> int | None:
    """Bytes free for `path` and what is below it already; None where that cannot be told."""
    try:
        existing = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
        used = (
            sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
            if path.is_dir()
            else 0
        )
        return shutil.disk_usage(existing).free + used
    except OSError:
        return None


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


def bytes_in_words(count: int) -> str:
    """A number of bytes for people, such as 3.2 MiB or 1,500 GiB."""
    if count < 2**30:
        return f"{count / 2**20:.3g} MiB"
    return f"{count / 2**30:.3g} GiB" if count < 2**40 else f"{count / 2**30:,.0f} GiB"


def _recall(config: Config) -> int:
    """Numbers that a policy remembers of its fight."""
    learn = config.learn
    if learn.memory == "gru":
        return learn.memory_size
    return observation_floats(config) * (learn.frames - 1) if learn.memory == "frames" else 0


def _network_floats(config: Config) -> tuple[int, int]:
    """How many floats one agent's policy (with its log-std) and its value function have."""
    sizes = (observation_floats(config) + _recall(config), *config.learn.hidden_sizes)
    trunk = sum((rows + 1) * columns for rows, columns in pairwise(sizes))
    gru = 0
    if config.learn.memory == "gru":
        gru = 3 * (sizes[0] + 1) * config.learn.memory_size + config.learn.memory_size
    return trunk + (sizes[-1] + 2) * ACTION_SIZE + gru, trunk + sizes[-1] + 1


def _pool_floats(config: Config, policy: int) -> int:
    """How many floats the past players have: one player for every chunk and, with scope
    "environment", one more in each environment.
    """
    environments = config.train.num_envs if config.selfplay.scope == "environment" else 0
    drawn = sum(
        (place.stop - place.first) * _policies_of(config, place.row.side)
        for place in opponents.places(config)
        if place.row is not None and place.row.past
    )
    return policy * (_pool_policies(config) * (config.num_chunks + environments) + drawn)


def _pool_policies(config: Config) -> int:
    """Policies in a slot of all pools together."""
    roles = {row.side for row in opponents.table(config) if row.past}
    return sum(_policies_of(config, side) for side in roles)


def _policies_of(config: Config, side: int) -> int:
    """Policies of a side: one, or one for each of its drones."""
    return sum(pupil.side == side for pupil in config.pupils)

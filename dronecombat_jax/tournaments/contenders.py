"""Players out of runs, policy files and scripted pilots, as they are named on the command line.

What does not live here: which of them meet, duplicates, and whether they know the same game
(`entrants`).
"""

import hashlib
from pathlib import Path
from typing import Any, NamedTuple

import jax

from dronecombat_jax.analysis.result import SCRIPTED, Entrant
from dronecombat_jax.arena.players import Player
from dronecombat_jax.combat.fingerprint import environment
from dronecombat_jax.combat.games import game_of
from dronecombat_jax.combat.scripted import PILOTS, names_of
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.opponents import learns
from dronecombat_jax.config.opponents import method as method_of
from dronecombat_jax.config.schema import build, one_line
from dronecombat_jax.config.settings import SCHEMA
from dronecombat_jax.errors import EXIT_CONFIG, UserError
from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.manifest import CheckpointError, state_digest
from dronecombat_jax.files.rundir import RunDirectory, find_run
from dronecombat_jax.learn.mates import Both
from dronecombat_jax.policies import shipped
from dronecombat_jax.policies.file import load_policy, tensors_of
from dronecombat_jax.policies.info import PolicyInfo
from dronecombat_jax.runs.resume import newest_start
from dronecombat_jax.runs.saved_policies import policies_in
from dronecombat_jax.types import ATTACKER, DEFENDER, SIDES, SidePolicy

SCRIPTED_PREFIX = "scripted:"
ALL = "all"
EXPORTED = "exported"  # the method of a policy file, which does not tell
POLICY_SUFFIX = ".safetensors"


class Contender(NamedTuple):
    """One player on one side."""

    role: int
    entrant: Entrant
    player: Player | None  # None: its checkpoint is missing or damaged
    environment: dict[str, Any] | None  # the game that it was trained in; None: knows any


class Found(NamedTuple):
    """What one word of the command line stands for."""

    contenders: list[Contender]
    config: Config | None = None  # of the game; None for scripted pilots
    bad: tuple[str, ...] = ()  # one line for each checkpoint that cannot be used


def find(word: str, every: int = 1, untrained: bool = False) -> Found:
    """The players that `word` names: `scripted:NAME`, `pilots:NAME`, either with `all`, a policy
    file, or a run.

    Of a run: both sides after every chunk, or every n-th and the last, as in the paper; also as
    they began with `untrained`. Raises UserError where there is nothing.
    """
    if word.startswith(SCRIPTED_PREFIX):
        return Found(_scripted(word.removeprefix(SCRIPTED_PREFIX)))
    if word.startswith(shipped.PREFIX):
        files = [_file(path) for path in shipped.paths(word.removeprefix(shipped.PREFIX))]
        return Found(
            [contender for file in files for contender in file.contenders], files[0].config
        )
    if word.endswith(POLICY_SUFFIX) or Path(word).is_file():
        return _file(Path(word))
    return _run(RunDirectory(find_run(word)), every, untrained)


def identity_of(policy: SidePolicy, normalize: bool) -> str:
    """sha256 in hex of all that decides how a policy flies."""
    tensors = tensors_of(policy)
    tensors.pop("observation_count")
    if not normalize:
        tensors = {
            name: array for name, array in tensors.items() if not name.startswith("observation_")
        }
    return hashlib.sha256(f"{state_digest(tensors)} {normalize}".encode()).hexdigest()


def _player(policy: SidePolicy, normalize: bool) -> Player:
    """A policy ready to fly."""
    return Player(identity_of(policy, normalize), policy, normalize)


def _scripted(name: str) -> list[Contender]:
    named = [(role, pilot) for role in PILOTS for pilot in names_of(role) if pilot == name]
    chosen = [(role, pilot) for role in PILOTS for pilot in PILOTS[role]] if name == ALL else named
    if not chosen:
        names = "; ".join(f"{SIDES[role]}s: {', '.join(names_of(role))}" for role in PILOTS)
        raise UserError(
            f"{one_line(SCRIPTED_PREFIX + name)}: no scripted pilot has this name ({names}; or {ALL})"
        )
    return [
        Contender(role, Entrant(pilot, pilot, SCRIPTED, "", -1, -1, 0), Player(pilot, pilot), None)
        for role, pilot in chosen
    ]


def _file(path: Path) -> Found:
    if path.suffix != POLICY_SUFFIX:
        raise UserError(
            f"{one_line(str(path))}: a policy file ends in {POLICY_SUFFIX}", EXIT_CONFIG
        )
    policy, info = load_policy(path)
    player = _player(policy, info.normalize_observations)
    entrant = Entrant(
        player.identity, one_line(path.stem), EXPORTED, info.run, info.seed, info.chunk, info.steps
    )
    contender = Contender(SIDES.index(info.role), entrant, player, info.environment)
    return Found([contender], _config_of(info))


def _config_of(info: PolicyInfo) -> Config:
    """The game of a policy file; what this version does not know is left out, and found by
    `environment_diff`.
    """
    entries = {key: SCHEMA[key] for key in info.environment if key in SCHEMA}
    values = {
        key: info.environment[key]
        for key, entry in entries.items()
        if not entry.problem(info.environment[key])
    }
    return build(Config, {key: entries[key].normal(value) for key, value in values.items()})


def _run(run: RunDirectory, every: int, untrained: bool) -> Found:
    newest = newest_start(run)
    config = newest.config
    steps = _chosen(run, config, every, untrained)
    if not steps:
        message = f"{run.path}: no chunk of training is done yet"
        return Found([], config, (message,))
    contenders, bad = [], []
    for step in steps:
        try:
            saved = newest.manifest if step == newest.iteration else step  # which has been verified
            arrays, manifest = checkpoint.load(run.checkpoints, saved)
            policies = policies_in(arrays, config, run.checkpoints / str(step))
            met = manifest.meta.get("environment") or environment(config)
        except CheckpointError as error:
            bad.append(error.message)
            policies, met = None, None
        contenders += [
            _contender(run, config, step, index, role, policies, met)
            for index in range(config.train.num_seeds)
            for role in _roles(config)
        ]
    return Found(contenders, config, tuple(bad))


def _chosen(run: RunDirectory, config: Config, every: int, untrained: bool) -> list[int]:
    """The steps to read: chunk ends from the first to the last that was saved.

    Also those that are gone since, unless the run keeps only some (`run.keep`).
    """
    chunk_iterations = config.train.chunk_iterations
    saved = [
        step // chunk_iterations
        for step in checkpoint.steps(run.checkpoints)
        if step % chunk_iterations == 0
    ]
    saved = [chunk for chunk in saved if chunk > 0 or untrained]
    if not saved:
        return []
    expected = range(saved[0], saved[-1] + 1) if config.run.keep == "all" else saved
    chunks = [chunk for chunk in expected if chunk % every == 0 or chunk == saved[-1]]
    return [chunk * chunk_iterations for chunk in chunks]


def _roles(config: Config) -> tuple[int, ...]:
    """The roles that learn in this run: a side that another opponent flies is no player of it."""
    return tuple(
        role
        for role in (DEFENDER, ATTACKER)
        if game_of(config).flies[role] and learns(config, role)
    )


def _contender(
    run: RunDirectory,
    config: Config,
    step: int,
    index: int,
    role: int,
    policies: Both | None,
    met: dict[str, Any] | None,
) -> Contender:
    """The player of one role and seed (by `index`) after `step` iterations; without `policies` a
    missing one.
    """
    name, seed = one_line(run.path.resolve().name), config.train.seed + index
    name = f"{name}/{seed}" if config.train.num_seeds > 1 else name
    method = method_of(config)
    chunk = step // config.train.chunk_iterations
    player, identity = None, f"missing:{name}:{chunk}"
    if policies is not None:
        policy = jax.tree.map(lambda leaf: leaf[index].copy(), policies[role])
        player = _player(policy, config.learn.normalize_observations)
        identity = player.identity
    steps = step * config.steps_per_iteration
    return Contender(
        role, Entrant(identity, f"{name} {chunk}", method, name, seed, chunk, steps), player, met
    )

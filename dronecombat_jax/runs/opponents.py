"""The frozen policies that a run trains against: read once, kept in the run's folder, verified
whenever they are read.

    opponents/defender-1.safetensors   who sits in the defender's place, the first such row

A run goes on with the copies, whatever has become of the file or run that was named: with other
opponents it would be another run. Their digests stand in every checkpoint. What does not live here:
the table of opponents (`config.opponents`), how they fly (`selfplay.opponents`).
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from dronecombat_jax.combat.fingerprint import own_view
from dronecombat_jax.combat.scripted import names_of
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.config.opponents import Row, table
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import EXIT_CONFIG, EXIT_DATA, UserError
from dronecombat_jax.files.atomic import cannot_write
from dronecombat_jax.files.manifest import CheckpointError
from dronecombat_jax.files.rundir import RunDirectory, find_run
from dronecombat_jax.files.tensorfile import PolicyError
from dronecombat_jax.learn.mates import of_mate
from dronecombat_jax.learn.memory import memory_size, recall_size
from dronecombat_jax.policies import shipped
from dronecombat_jax.policies.file import (
    SavedPolicy,
    digest_of,
    load_policy,
    require_environment,
    save_policy,
    tensors_of,
)
from dronecombat_jax.policies.info import metadata_of
from dronecombat_jax.selfplay.opponents import Guest
from dronecombat_jax.types import SIDES

SUFFIX = ".safetensors"
META = "opponents"  # of a checkpoint: digests of the copies by their names


class Frozen(NamedTuple):
    """The policies of a run that do not learn, by the names of their rows."""

    saved: dict[str, SavedPolicy]
    files: dict[str, str]  # the name of each one's copy

    def cast(self, game: GameConfig) -> dict[str, Guest]:
        """Who flies in `game`; NumPy leaves."""
        see = lambda saved: own_view(saved.info.environment, game)
        return {row: Guest(saved.policy, see(saved)) for row, saved in self.saved.items()}

    @property
    def digests(self) -> dict[str, str]:
        """sha256 of each copy's content, by its name."""
        return {self.files[row]: _digest(saved) for row, saved in self.saved.items()}

    @property
    def meta(self) -> dict[str, Any]:
        """What every checkpoint says of them; nothing where there are none."""
        return {META: self.digests} if self.files else {}

    @property
    def lines(self) -> list[str]:
        """Who they are, a line for each."""
        return [
            f"{row}: {saved.info.run}, seed {saved.info.seed}, chunk {saved.info.chunk} "
            f"({saved.info.steps:,} environment steps)"
            for row, saved in self.saved.items()
        ]


def read_named(config: Config) -> Frozen:
    """The policies that `selfplay.opponents` names, for a new run.

    UserError, one line: 2 for an unknown pilot or a policy of the other side, 3 for a file or run
    that cannot be read or knows another game.
    """
    for row in table(config):
        if row.scripted and row.scripted not in names_of(row.side):
            known = ", ".join(names_of(row.side))
            raise UserError(
                f"{one_line(row.name)}: no scripted {SIDES[row.side]} has this name ({known})",
                EXIT_CONFIG,
            )
    return _gather(config, lambda row, _: _named(row))


def read_kept(run: RunDirectory, config: Config, meta: dict[str, Any]) -> Frozen:
    """The copies that a run goes on with.

    CheckpointError where they are not those that the checkpoint with `meta` was trained against.
    """
    kept = _gather(config, lambda _, name: _copy(run, name))
    if kept.files and meta.get(META) != kept.digests:
        raise CheckpointError(
            f"{run.opponents}: these are not the opponents that the checkpoint was trained against"
        )
    return kept


def keep(run: RunDirectory, frozen: Frozen) -> None:
    """Write the copies into the folder of a new run. UserError 73."""
    if not frozen.files:
        return
    try:
        run.opponents.mkdir(exist_ok=True)
    except OSError as error:
        raise cannot_write(run.opponents, error) from error
    for row, (policy, info) in frozen.saved.items():
        save_policy(run.opponents / frozen.files[row], policy, info, force=True)


def kept_policy(run: RunDirectory, config: Config, wanted: Row) -> SavedPolicy:
    """The copy of one row of a run, for those who look at it. CheckpointError."""
    return _copy(run, next(name for row, name in _rows(config) if row == wanted))


def _gather(config: Config, read: Callable[[Row, str], SavedPolicy]) -> Frozen:
    frozen = Frozen({}, {})
    for row, name in _rows(config):
        saved = read(row, name)
        if saved.info.role != SIDES[row.side]:
            raise UserError(f"{one_line(row.name)}: it is a policy of the {saved.info.role}")
        try:
            require_environment(saved.info, config)
        except UserError as error:
            raise UserError(f"{one_line(row.name)}: {error.message}", error.exit_code) from None
        if (needed := memory_size(of_mate(saved.policy, 0))) > recall_size(config):
            raise UserError(
                f"{one_line(row.name)}: it remembers {needed} numbers of its fight, this run's policies "
                f"{recall_size(config)}: with learn.memory they must remember as many",
                EXIT_CONFIG,
            )
        frozen.saved[row.name], frozen.files[row.name] = saved, name
    return frozen


def _rows(config: Config) -> Iterator[tuple[Row, str]]:
    """The rows of frozen policies, and the names of their copies."""
    counts = [0] * len(SIDES)
    for row in table(config):
        if row.policy:
            counts[row.side] += 1
            yield row, f"{SIDES[row.side]}-{counts[row.side]}{SUFFIX}"


def _named(row: Row) -> SavedPolicy:
    """The policy that a row names: a file, pilots:NAME, or of a RUN, or RUN:CHUNK, its first seed."""
    word = row.policy
    if word.startswith(shipped.PREFIX):
        paths = shipped.paths(word.removeprefix(shipped.PREFIX))
        if len(paths) != 1:
            raise UserError(f"{one_line(row.name)}: name one pilot, not all of them", EXIT_CONFIG)
        return load_policy(paths[0])
    if word.endswith(SUFFIX) or Path(word).is_file():
        return load_policy(Path(word).expanduser())
    from dronecombat_jax.runs.evaluation import load_run
    from dronecombat_jax.runs.export import policy_of_run

    path, chunk = path_and_chunk(word)
    try:
        run = RunDirectory(find_run(path))
    except UserError as error:
        kinds = "no policy file, no pilots:NAME, no scripted:NAME"
        raise UserError(f"{one_line(row.name)}: {kinds}, and {error.message}", EXIT_DATA) from None
    saved = load_run(run.path, chunk)
    return SavedPolicy(*policy_of_run(saved, run, SIDES[row.side], saved.config.train.seed))


def path_and_chunk(word: str) -> tuple[str, int | None]:
    """RUN:CHUNK in two parts; None for RUN alone."""
    path, _, chunk = word.rpartition(":")
    return (path, int(chunk)) if chunk.isascii() and chunk.isdigit() and path else (word, None)


def _copy(run: RunDirectory, name: str) -> SavedPolicy:
    try:
        return load_policy(run.opponents / name)
    except PolicyError as error:
        raise CheckpointError(f"{error.message} (the run was trained against it)") from None


def _digest(saved: SavedPolicy) -> str:
    return digest_of(tensors_of(saved.policy), metadata_of(saved.info))

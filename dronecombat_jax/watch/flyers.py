"""Who flies a recorded fight, as a command line names it: a chunk, a file, a scripted pilot.

What does not live here: flying them (`recording`), the fields of tournaments (`entrants`).
"""

from pathlib import Path
from typing import Any, NamedTuple

from dronecombat_jax.arena.players import refuse_other_shape
from dronecombat_jax.combat.fingerprint import environment, game_diff, own_view
from dronecombat_jax.combat.games import game_of
from dronecombat_jax.combat.scripted import PILOTS, names_of
from dronecombat_jax.config import settings
from dronecombat_jax.config.fields import Config, LearnConfig
from dronecombat_jax.config.opponents import stands_for
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.errors import EXIT_DATA, UserError
from dronecombat_jax.files import checkpoint
from dronecombat_jax.files.rundir import RunDirectory, find_run
from dronecombat_jax.policies import shipped
from dronecombat_jax.policies.file import SavedPolicy
from dronecombat_jax.runs.evaluation import flown_by, load_run
from dronecombat_jax.runs.resume import newest_start
from dronecombat_jax.tournaments.contenders import POLICY_SUFFIX, SCRIPTED_PREFIX, find, identity_of
from dronecombat_jax.types import DEFENDER, SIDES, SidePolicy

ANCHOR_PRESET = "duel"  # the game of scripted pilots alone
# who flies where there is no run yet: pilots of the package, or where it holds none scripted ones
FIRST_LOOK = (f"{shipped.PREFIX}league-defender", f"{shipped.PREFIX}strong-attacker")
FIRST_STARTS = "even"  # from their own they are no match: the defender wins nearly all fights
FIRST_OPPONENT = f"{shipped.PREFIX}sippo-defender"  # of a person, who is to have a chance
SCRIPTED_LOOK = (f"{SCRIPTED_PREFIX}proportional_navigation", f"{SCRIPTED_PREFIX}weave")


class Flyer(NamedTuple):
    """One side of a recorded fight."""

    label: str
    pilot: SidePolicy | str  # NumPy leaves without leading axes; or the name of a scripted pilot
    learn: LearnConfig  # how the policy sees, and the bounds of its log-std
    identity: str  # as of `arena.players.Player`
    environment: dict[str, Any] | None = None  # the game that it was trained in; None: knows any
    chunk: int = -1  # of a run
    steps: int = 0  # environment steps trained
    observation: str = ""  # the layout that it sees, as of `arena.players.Player`


class Crew(NamedTuple):
    """Both sides, and their game: the run's, the first file's, or the default preset's."""

    config: Config
    flyers: tuple[Flyer, Flyer]
    run: RunDirectory | None
    starts: str = ""  # where fights start unless others are asked for (`config.starts`)


class Opponents(NamedTuple):
    """Whom a person can fly against, by role, and the game: the run's, the file's, or the default
    preset's.
    """

    config: Config
    flyers: tuple[Flyer | None, Flyer | None]
    run: RunDirectory | None


class Named(NamedTuple):
    """What a command line names; `wanted` by role, "" for the run's newest or the file's."""

    words: tuple[str, ...] = ()
    wanted: tuple[str, str] = ("", "")
    run_seed: int = -1  # of the run's seeds; -1: its first
    allow_mismatch: bool = False


def read_crew(named: Named) -> Crew:
    """Find and check both sides. UserError: 2 for unknown words, 3 for data or another game."""
    named, starts = _first_look(named)
    run, first, config = _read_words(named)
    if not game_of(config).flies[DEFENDER] and named.wanted[DEFENDER]:
        raise UserError("in a solo run the attacker flies alone: --defender has no place there")
    flyers = []
    for role, name in enumerate(SIDES):
        flyer = _wanted(named, role, run) if named.wanted[role] else first.get(role)
        if flyer is None and run is None:
            raise UserError(f"no {name} is named: give a run, a policy file, or --{name}")
        flyers.append(flyer or of_run(run, role, None, named.run_seed))  # pyright: ignore
    defender, attacker = (
        flyer._replace(observation=own_view(flyer.environment, config.game)) for flyer in flyers
    )
    crew = Crew(config, (defender, attacker), run, starts)
    _refuse_other_games(crew, named.allow_mismatch)
    return crew


def read_opponents(words: tuple[str, ...], run_seed: int = -1) -> Opponents:
    """Find the opponent that is named: RUN or RUN:CHUNK (its policies of both sides), a policy file,
    scripted:NAME; without a word the last run, or where there is none yet a defender of the package.
    UserError: 2 for words, 3 for data.
    """
    if len(words) > 1:
        kinds = "RUN, RUN:CHUNK, a policy file or scripted:NAME"
        raise UserError(f"name one opponent, not {len(words)}: {kinds}")
    word, chunk = words[0] if words else "", None
    run = None if words else last_run()
    if not words and run is None:
        word = FIRST_OPPONENT if shipped.names() else SCRIPTED_LOOK[DEFENDER]
    if run is None and _is_player(word):
        role, flyer, game = _player(word)
        both = (flyer, None) if role == DEFENDER else (None, flyer)
        return Opponents(game or settings.load(ANCHOR_PRESET), both, None)
    if run is None:
        path, chunk = _path_and_chunk(word)
        run = RunDirectory(find_run(path))
    config = newest_start(run).config
    both = tuple(
        of_run(run, role, chunk, run_seed) if flies else None
        for role, flies in enumerate(game_of(config).flies)
    )
    return Opponents(config, both, run)  # pyright: ignore[reportArgumentType]


def of_run(run: RunDirectory, role: int, chunk: int | None, run_seed: int) -> Flyer:
    """The policy of a run after `chunk` (0: untrained, None: the newest).

    UserError: 2 for a seed, 3 for a checkpoint.
    """
    saved = load_run(run.path, chunk)
    config, first = saved.config, saved.config.train.seed
    index = 0 if run_seed < 0 else run_seed - first
    if not 0 <= index < config.train.num_seeds:
        last = first + config.train.num_seeds - 1
        raise UserError(f"{run.path} has seeds {first} to {last}, not {run_seed}")
    policy = flown_by(saved, index)[role]
    if row := stands_for(config, role):  # what the run trained against
        normalize = config.learn.normalize_observations
        identity = policy if isinstance(policy, str) else identity_of(policy, normalize)
        label = f"{policy} (scripted)" if row.scripted else row.who
        frozen = saved.frozen[role]
        met = frozen.info.environment if isinstance(frozen, SavedPolicy) else None
        seen = own_view(met, config.game)
        return Flyer(label, policy, config.learn, identity, met, observation=seen)
    assert not isinstance(policy, str)
    name, chunk = run_name(run), saved.iteration // config.train.chunk_iterations
    seeded = f"{name}/{first + index}" if config.train.num_seeds > 1 else name
    steps = saved.iteration * config.steps_per_iteration
    return Flyer(
        label=f"{seeded} chunk {chunk}",
        pilot=policy,
        learn=config.learn,
        identity=identity_of(policy, config.learn.normalize_observations),
        environment=environment(config),
        chunk=chunk,
        steps=steps,
    )


def last_run(root: Path | str = "runs") -> RunDirectory | None:
    """The run in `root` that saved last; None where there is none."""
    saved = [folder for folder in Path(root).glob("*/checkpoints") if folder.is_dir()]
    if not saved:
        return None
    return RunDirectory(max(saved, key=lambda folder: folder.stat().st_mtime).parent)


def run_name(run: RunDirectory) -> str:
    """A run's name for people."""
    return one_line(run.path.resolve().name)


def chunks_along(run: RunDirectory, parts: int = 10) -> list[tuple[int, int]]:
    """(percent, chunk) of the saved chunks nearest to 0, 1/`parts`, ... 1 of the training."""
    config = newest_start(run).config
    size = config.train.chunk_iterations
    saved = [step // size for step in checkpoint.steps(run.checkpoints) if step % size == 0]
    if not saved:
        raise UserError(f"{run.path}: no chunk of training is saved", EXIT_DATA)
    last = saved[-1]
    nearest = lambda wanted: min(saved, key=lambda chunk: abs(chunk - wanted))
    chunks = dict.fromkeys(nearest(last * part / parts) for part in range(parts + 1))
    return [(round(100 * chunk / max(last, 1)), chunk) for chunk in chunks]


def _read_words(named: Named) -> tuple[RunDirectory | None, dict[int, Flyer], Config]:
    """The run, the other players by role, and the game."""
    run: RunDirectory | None = None
    flyers: dict[int, Flyer] = {}
    config: Config | None = None
    for word in named.words:
        if not _is_player(word):
            if run is not None:
                raise UserError(f"{one_line(word)}: a second run; name its player with a flag")
            run = RunDirectory(find_run(word))
            continue
        role, flyer, game = _player(word)
        if role in flyers:
            raise UserError(f"two {SIDES[role]}s are named: {flyers[role].label} and {flyer.label}")
        flyers[role] = flyer
        config = config or game
    if not named.words and not any(_stands_alone(word) for word in named.wanted):
        run = last_run()
    if run is not None:
        config = newest_start(run).config
    return run, flyers, config or settings.load(ANCHOR_PRESET)


def _first_look(named: Named) -> tuple[Named, str]:
    """Where nobody is named and there is no run yet: who flies, and from which starts."""
    if named.words or any(named.wanted) or last_run() is not None:
        return named, ""
    if shipped.names():
        return named._replace(words=FIRST_LOOK), FIRST_STARTS
    return named._replace(words=SCRIPTED_LOOK), ""


def _is_player(word: str) -> bool:
    named = word.startswith((SCRIPTED_PREFIX, shipped.PREFIX))
    return named or word.endswith(POLICY_SUFFIX) or Path(word).is_file()


def _stands_alone(word: str) -> bool:
    """Whether --defender or --attacker names somebody who needs no RUN."""
    return bool(word) and not (word.isascii() and word.isdigit())


def _player(word: str) -> tuple[int, Flyer, Config | None]:
    """A policy file or scripted:NAME, and the game that the file knows."""
    named = find(word)
    if len(named.contenders) != 1:
        raise UserError(f"{one_line(word)}: name one pilot, not all of them")
    role, entrant, player, met = named.contenders[0]
    assert player is not None  # only checkpoints of runs go missing
    label = f"{entrant.label} (scripted)" if isinstance(player.pilot, str) else entrant.label
    learn = LearnConfig(normalize_observations=player.normalize)
    flyer = Flyer(label, player.pilot, learn, player.identity, met, entrant.chunk, entrant.steps)
    return role, flyer, named.config


def _wanted(named: Named, role: int, run: RunDirectory | None) -> Flyer:
    """The player that --defender or --attacker names."""
    word = named.wanted[role]
    flag = f"--{SIDES[role]} {one_line(word)}"
    if not _stands_alone(word):
        if run is None:
            raise UserError(f"{flag}: a chunk number needs a RUN that it belongs to")
        return of_run(run, role, int(word), named.run_seed)
    names = {name for side in PILOTS for name in names_of(side)}
    if word in names or _is_player(word):
        its_role, flyer, _ = _player(f"{SCRIPTED_PREFIX}{word}" if word in names else word)
        if its_role != role:
            raise UserError(f"{flag}: it is a policy of the {SIDES[its_role]}")
        return flyer
    path, chunk = _path_and_chunk(word)
    try:
        other = RunDirectory(find_run(path))
    except UserError as error:
        pilots = ", ".join(names_of(role))
        kinds = f"no chunk number, no scripted pilot ({pilots}), no policy file"
        raise UserError(f"{flag}: {kinds}, and {error.message}") from None
    return of_run(other, role, chunk, -1)


def _path_and_chunk(word: str) -> tuple[str, int | None]:
    """RUN:CHUNK in two parts; None for RUN alone."""
    path, _, chunk = word.rpartition(":")
    return (path, int(chunk)) if chunk.isascii() and chunk.isdigit() and path else (word, None)


def _refuse_other_games(crew: Crew, allowed: bool) -> None:
    here = environment(crew.config)
    for role, flyer in enumerate(crew.flyers):
        if flyer.environment is None or not game_of(crew.config).flies[role]:
            continue
        lines = [one_line(line) for line in game_diff(flyer.environment, here, crew.config.game)]
        if lines and not allowed:
            more = f"; and {len(lines) - 5} more" if len(lines) > 5 else ""
            message = f"{flyer.label} was trained in another game: {'; '.join(lines[:5])}{more}"
            raise UserError(f"{message}; --allow-env-mismatch lets it fly here", EXIT_DATA)
        refuse_other_shape(flyer.label, role, flyer.pilot, crew.config, flyer.observation)

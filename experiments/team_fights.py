"""Teams of several sizes, everybody's defenders against everybody's attackers: the tables of
docs/teams.md.

    python experiments/team_fights.py [--runs runs/teams] [--fights 64]
    python experiments/team_fights.py --table

Takes the final policies of studies/teams.toml that are trained, scripted teams beside them, and flies
every pair from the same starts at rest, in the size that they were trained in; and what was trained
in the largest size also with one defender more than that, which nobody was trained for. What was
counted is kept in studies/team_fights.jsonl, a line a pair; a pair that is there is not flown again.
`--table` prints the tables of what is kept.

A run's defenders do not meet attackers of its own seed, of whatever method, so that all methods'
defenders meet the same attackers. An interval is Student's t over the seeds.
"""

import argparse
import json
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent))

import measured
import variants
from kept import read_lines
from measured import markdown_row

STUDY = Path(__file__).parent / "studies" / "teams.toml"
KEPT = STUDY.with_name("team_fights.jsonl")
SIZES = ((1, 1), (2, 1), (2, 2), (3, 2))  # defenders, attackers
UNSEEN = (4, 2)
TRAINED_FOR_UNSEEN = (3, 2)
METHODS = {"ippo": "IPPO", "mappo": "MAPPO", "strong": "strong"}
SCRIPTED = {"assigned_navigation": "navigation, assigned"}  # of the defenders
ATTACKERS = ("dash", "weave", "pincer", "decoy")
SCRIPTED_OF = (tuple(SCRIPTED), ATTACKERS)  # by side
TOUCH = 0.1  # m between team mates that both fly
NAMED = re.compile(r"(?P<method>\w+)-(?P<defenders>\d)v(?P<attackers>\d)/(?P<seed>\d+)")


class Pair(NamedTuple):
    """Who meets whom: runs as VARIANT/SEED, or the names of scripted pilots."""

    size: tuple[int, int]
    defender: str
    attacker: str

    @property
    def key(self) -> str:
        """Of its line."""
        return f"{spelt(self.size)} {self.defender} {self.attacker}"


class Fights(NamedTuple):
    """E recorded fights of D defenders and M attackers, T control steps of `control_dt` seconds."""

    position: NDArray[np.float32]  # [T + 1, E, D + M, 3] m
    crashed: NDArray[np.bool_]  # [T + 1, E, D + M], by then, not struck
    struck: NDArray[np.bool_]  # [T + 1, E, D + M], by then
    cause: NDArray[np.int32]  # [E] a `types.Cause`
    steps: NDArray[np.int32]  # [E] until the fight's end
    defenders: int
    control_dt: float


def spelt(size: tuple[int, int]) -> str:
    """Such as 3v2."""
    return f"{size[0]}v{size[1]}"


def counted(fights: Fights) -> dict[str, Any]:
    """What a pair came to: shares of its fights, seconds, and how defenders shared the work."""
    from dronecombat_jax.types import Cause

    caught = fights.cause == Cause.INTERCEPT
    length = len(fights.position) - 1
    seconds = np.where(caught, fights.steps, length) * fights.control_dt
    crashed = fights.crashed[-1]
    strikes = strikes_of(fights)
    busy = np.bincount([each.defender for each in strikes], minlength=1)
    return {
        "fights": len(caught),
        "intercepted": float(caught.mean()),
        "reached": float((fights.cause == Cause.REACHED).mean()),
        "defenders_crashed": float(crashed[:, : fights.defenders].mean()),
        "attackers_crashed": float(crashed[:, fights.defenders :].mean()),
        "mates_touched": touched(fights),
        "seconds": float(seconds.mean()),  # without an interception: to the end of time
        "rho": float(1.0 - seconds.mean() / (length * fights.control_dt)),
        "busiest": float(busy.max() / busy.sum()) if strikes else None,
        "by_nearest": _mean([each.was_nearest for each in strikes]),
        "mate_away": _mean([each.mate_away for each in strikes]),
        "divided": divided(fights),
    }


class Strike(NamedTuple):
    """An attacker is taken out, by the defender that is then the nearest of those that flew."""

    defender: int
    was_nearest: bool  # of all defenders to this attacker, at the fight's start
    mate_away: float  # m from the attacker to the nearest other defender that flew; inf: none did


def strikes_of(fights: Fights) -> list[Strike]:
    """Every strike of the fights, by step, fight and attacker."""
    down = fights.crashed | fights.struck
    new = down[1:] & ~down[:-1] & fights.struck[1:]
    found = []
    for step, fight, attacker in np.argwhere(new[..., fights.defenders :]):
        at = fights.position[:, fight]
        away = np.linalg.norm(
            at[:, : fights.defenders] - at[:, fights.defenders + attacker, None], axis=-1
        )
        flew = np.where(down[step, fight, : fights.defenders], np.inf, away[step + 1])
        defender = int(np.argmin(flew))
        mate = float(np.min(np.delete(flew, defender), initial=np.inf))
        found.append(Strike(defender, bool(np.argmin(away[0]) == defender), mate))
    return found


def _mean(values: Iterable[float]) -> float | None:
    """Of those that are finite; None: there are none."""
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else None


def touched(fights: Fights) -> float:
    """Share of fights in which two defenders that both fly come within `TOUCH`."""
    close = np.zeros(len(fights.cause), bool)
    flies = _flies(fights)[..., : fights.defenders]
    for one in range(fights.defenders):
        for other in range(one):
            apart = np.linalg.norm(
                fights.position[:, :, one] - fights.position[:, :, other], axis=-1
            )
            close |= np.any((apart < TOUCH) & flies[..., one] & flies[..., other], axis=0)
    return float(close.mean())


def divided(fights: Fights) -> float | None:
    """Of the steps in which two defenders and two attackers or more fly: the share in which every
    attacker is the nearest one of some defender. None where there are no such steps.
    """
    flies, count = _flies(fights), fights.defenders
    defend, attack = flies[..., :count], flies[..., count:]
    here = (defend.sum(axis=-1) >= 2) & (attack.sum(axis=-1) >= 2)
    if not here.any():
        return None
    way = fights.position[:, :, :count, None] - fights.position[:, :, None, count:]
    away = np.where(attack[:, :, None], np.linalg.norm(way, axis=-1), np.inf)
    nearest = np.argmin(away, axis=-1)  # [T + 1, E, D]
    minded = [np.any((nearest == each) & defend, axis=-1) for each in range(attack.shape[-1])]
    covered = np.all(np.stack(minded, axis=-1) | ~attack, axis=-1)
    return float(covered[here].mean())


def _flies(fights: Fights) -> NDArray[np.bool_]:
    """Who flies, [T + 1, E, D + M]: not down, and the fight not over."""
    under_way = np.arange(len(fights.position))[:, None] <= fights.steps
    return under_way[..., None] & ~fights.crashed & ~fights.struck


def pairs_of(runs: Iterable[str]) -> list[Pair]:
    """Who meets whom of the finished `runs`, VARIANT/SEED: see the module's words."""
    pairs = []
    for size, trained in [*((size, size) for size in SIZES), (UNSEEN, TRAINED_FOR_UNSEEN)]:
        own = [run for run in runs if run.partition("/")[0].endswith(f"-{spelt(trained)}")]
        for defender in [*own, *SCRIPTED]:
            met = [run for run in own if _seed(run) != _seed(defender)]
            pairs += [Pair(size, defender, attacker) for attacker in [*met, *ATTACKERS]]
    return pairs


def _seed(name: str) -> str | None:
    match = NAMED.fullmatch(name)
    return match and match["seed"]


def tables(lines: Sequence[dict[str, Any]]) -> str:
    """All tables, Markdown."""
    sizes = [spelt(size) for size in (*SIZES, UNSEEN)]
    trained = [x for x in lines if _seed(x["attacker"]) is not None]
    attackers = {
        "trained attackers": trained,
        "scripted attackers": [x for x in lines if x["attacker"] in ATTACKERS],
        **{f"`{name}`": [x for x in lines if x["attacker"] == name] for name in ATTACKERS},
    }
    columns = [*METHODS, *SCRIPTED]
    heads = [*METHODS.values(), *SCRIPTED.values()]
    parts = []
    for title, met in attackers.items():
        rows = [
            markdown_row(["defenders v attackers", *heads]),
            markdown_row(["---"] * (1 + len(heads))),
        ]
        for size in sizes:
            own = [x for x in met if x["size"] == size]
            cells = [_cell(own, who, "intercepted", 100.0) for who in columns]
            rows.append(
                markdown_row([size + (" (unseen)" if size == spelt(UNSEEN) else ""), *cells])
            )
        parts.append("\n".join([f"Interceptions, in per cent of the fights, {title}:", "", *rows]))
    kinds = {
        "reached": ("target reached, %", 100.0),
        "defenders_crashed": ("defenders crashed, %", 100.0),
        "mates_touched": (f"mates within {TOUCH:g} m, % of fights", 100.0),
        "seconds": ("seconds", 1.0),
        "rho": ("rho", 1.0),
        "busiest": ("strikes of the busiest, %", 100.0),
        "by_nearest": ("by the one nearest at the start, %", 100.0),
        "mate_away": ("next mate from the struck, m", 1.0),
        "divided": ("every attacker minded, % of steps", 100.0),
    }
    heads = ["defenders v attackers", "defenders", *(text for text, _ in kinds.values())]
    rows = [markdown_row(heads), markdown_row(["---"] * len(heads))]
    for size in sizes:
        own = [x for x in trained if x["size"] == size]
        for who, title in {**METHODS, **SCRIPTED}.items():
            cells = [_cell(own, who, kind, times) for kind, (_, times) in kinds.items()]
            rows.append(markdown_row([size, title, *cells]))
    parts.append("\n".join(["The same fights against trained attackers:", "", *rows]))
    return "\n\n".join(parts)


def _cell(lines: Sequence[dict[str, Any]], who: str, kind: str, times: float) -> str:
    """Mean over seeds of the defenders `who`, of a scripted team over the attackers' seeds, and the
    half-width of its 95 % interval.
    """
    by_seed: dict[str | None, list[float]] = {}
    for line in lines:
        own = NAMED.fullmatch(line["defender"])
        if (own["method"] if own else line["defender"]) != who or line[kind] is None:
            continue
        seed = own["seed"] if own else _seed(line["attacker"])
        by_seed.setdefault(seed, []).append(times * line[kind])
    values = [float(np.mean(each)) for each in by_seed.values()]
    digits = 0 if times > 1.0 else 2
    if not values:
        return ""
    if len(values) == 1:
        return f"{values[0]:.{digits}f}"
    return f"{np.mean(values):.{digits}f} ± {measured.half_width(values):.{digits}f}"


class Flyer:
    """Flies pairs; what they share is read and compiled once."""

    def __init__(self, study: variants.Study, folders: dict[str, Path], fights: int, seed: int):
        self.study, self.folders, self.fights, self.seed = study, folders, fights, seed
        self._runs: dict[str, Any] = {}
        self._programs: dict[Any, Any] = {}

    def _run(self, name: str) -> Any:
        from dronecombat_jax.runs.evaluation import load_run

        if name not in self._runs:
            self._runs[name] = load_run(self.folders[name])
        return self._runs[name]

    def _game(self, size: tuple[int, int]) -> Any:
        """The study's settings for teams of `size`; for the unseen one, of those that fly in it."""
        from dronecombat_jax.config import settings

        trained = TRAINED_FOR_UNSEEN if size == UNSEEN else size
        own = [each for each in self.study.variants if each.name.endswith(f"-{spelt(trained)}")]
        return settings.load(own[0].preset, own[0].settings)

    def fly(self, pair: Pair) -> Fights:
        """All fights of a pair."""
        import jax

        from dronecombat_jax.runs.evaluation import policies

        given = [
            policies(self._run(name), 0)[side]
            if name in self.folders
            else SCRIPTED_OF[side].index(name)
            for side, name in enumerate((pair.defender, pair.attacker))
        ]
        like = next((name for name in (pair.defender, pair.attacker) if name in self.folders), "")
        scripted = tuple(isinstance(each, int) for each in given)
        return _as_fights(
            pair.size, jax.device_get(self._program(pair.size, scripted, like)(*given))
        )

    def _program(self, size: tuple[int, int], scripted: tuple[bool, ...], like: str) -> Any:
        """A compiled function of both sides' policies, a number of `SCRIPTED_OF` in the place of a
        scripted team; the game is that of the run `like`, or the study's for this size.
        """
        import jax
        import jax.numpy as jnp

        from dronecombat_jax.arena.match import policy_team, record, scripted_team, start_fights
        from dronecombat_jax.combat.env import Combat
        from dronecombat_jax.combat.scripted import one_per_fight
        from dronecombat_jax.runs.evaluation import Match, game_flown

        if (size, scripted) in self._programs:
            return self._programs[size, scripted]
        config = self._run(like).config if like else self._game(size)
        config = game_flown(config, Match(defenders=size[0], attackers=size[1]))
        combat = Combat(config)

        def side(policy: Any, role: int) -> Any:
            if not scripted[role]:
                return policy_team(config, config.learn, policy, role)
            teams = [scripted_team(combat, name, role) for name in SCRIPTED_OF[role]]
            which = jnp.full(self.fights, policy)
            return [one_per_fight(pilots, which) for pilots in zip(*teams, strict=True)]

        def fly(defender: Any, attacker: Any) -> Any:
            start_key, fight_key = jax.random.split(jax.random.key(self.seed))
            start = start_fights(combat, start_key, self.fights)
            teams = side(defender, 0), side(attacker, 1)
            return record(combat, *teams, start, fight_key), config.control_dt

        self._programs[size, scripted] = jax.jit(fly)
        return self._programs[size, scripted]


def _as_fights(size: tuple[int, int], flown: Any) -> Fights:
    """A record of `arena.match` as this file counts it."""
    from dronecombat_jax.types import Cause

    record, control_dt = flown
    drones = sum(size)
    path = np.concatenate([record.start.qpos[None], record.qpos])
    position = path.reshape(*path.shape[:2], drones, 7)[..., :3]
    steps = np.arange(len(path))[:, None]
    over = steps >= record.result.steps  # [T + 1, E]
    caught = record.result.cause == Cause.INTERCEPT
    if record.struck is None:  # a duel: one strike, which ends it
        attacker = np.arange(drones) >= size[0]
        struck = (over & caught)[..., None] & attacker
        crashed = over[..., None] & record.result.down & ~struck
    else:
        fallen = np.concatenate([record.start.down[None], record.down])
        struck = np.concatenate([record.start.struck[None], record.struck])
        crashed = fallen & ~struck
    return Fights(
        position,
        crashed,
        struck,
        record.result.cause,
        record.result.steps,
        size[0],
        float(control_dt),
    )


def main() -> int:
    """Fly what is missing, print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=Path, default=Path("runs/teams"), help="the study's runs")
    parser.add_argument("--fights", type=int, default=64, help="of a pair (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the starts (%(default)s)")
    parser.add_argument("--table", action="store_true", help="fly nothing, print what is kept")
    flags = parser.parse_args()
    lines = read_lines(KEPT)
    if not flags.table:
        from dronecombat_jax.machine import backend

        backend.prepare("cpu")
        study = variants.read_study(STUDY)
        found = variants.whole(study, flags.runs)
        folders = {f"{name}/{seed}": folder for (name, seed), folder in found.items()}
        flyer = Flyer(study, folders, flags.fights, flags.seed)
        known = {line["pair"] for line in lines}
        with KEPT.open("a") as kept:
            for pair in pairs_of(folders):
                if pair.key in known:
                    continue
                about = {
                    "pair": pair.key,
                    "size": spelt(pair.size),
                    "defender": pair.defender,
                    "attacker": pair.attacker,
                }
                lines.append(about | counted(flyer.fly(pair)))
                kept.write(json.dumps(lines[-1]) + "\n")
                kept.flush()
                print(pair.key, f"{lines[-1]['intercepted']:.2f}", flush=True)
    print(tables(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())

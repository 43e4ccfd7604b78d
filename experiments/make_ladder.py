"""Make the ladders that come with the package, the cards of its pilots, and docs/ladder.md's tables.

    python experiments/make_ladder.py --episodes 100

All shipped and scripted pilots meet in two round robins: from the starts of the preset's game, at
rest, and from even ones. `--check SEED` also rates everybody anew from the starts of another seed, against the ladder as it
stands: how many of the new ratings lie in the intervals of the old?
"""

import argparse
import json
import re
import tempfile
from pathlib import Path

import numpy as np

from dronecombat_jax import prepare, tournament
from dronecombat_jax.policies import shipped

PRESET, SEED = "duel", 0
PAGE = Path(__file__).parents[1] / "docs" / "ladder.md"
MADE = r"(?<=<!-- made: {} -->\n).*?(?=<!-- end -->)"


def fly(episodes: int, seed: int, spawn: str):
    """The round robin of everybody from the starts `spawn`."""
    with tempfile.TemporaryDirectory() as root:
        everybody = [f"{shipped.PREFIX}{shipped.ALL}", "scripted:all"]
        how = {"episodes": episodes, "seed": seed, "spawn": spawn}
        return tournament(everybody, name="ladder", root=root, **how)


def make(episodes: int, spawn: str):
    """The ladder of the starts `spawn` from a new round robin."""
    from dronecombat_jax.combat.fingerprint import environment_digest
    from dronecombat_jax.config import settings
    from dronecombat_jax.tournaments.contenders import find
    from dronecombat_jax.tournaments.ladder import Ladder, standing

    named: dict[str, list[str]] = {}
    for name in shipped.names():
        (contender,) = find(f"{shipped.PREFIX}{name}").contenders
        named.setdefault(contender.entrant.identity, []).append(name)
    also = {identity: names[1:] for identity, names in named.items()}
    rungs = standing(fly(episodes, SEED, spawn), also)
    return Ladder(PRESET, environment_digest(settings.load(PRESET)), episodes, SEED, rungs, spawn)


def cards(ladder) -> dict[str, dict]:
    """The card of every shipped pilot: as it was, with its rating on the ladder."""
    table = json.loads((shipped.FOLDER / shipped.CARDS).read_text())
    for rung in ladder.rungs:
        for name in () if rung.scripted else (rung.name, *rung.also):
            table[name] |= {
                **{part: round(getattr(rung, part), 1) for part in ("rating", "low", "high")},
                "loses_to": [f"{other} ({share:.2f})" for other, share in rung.worst],
            }
    return table


def standing_page(ladder) -> str:
    """Two tables of docs/ladder.md."""
    lines = []
    for role in ("defender", "attacker"):
        lines += ["", f"| place | {role} | rating | 95 % | score | loses to (score) |"]
        lines += ["|---|---|---|---|---|---|"]
        for place, rung in enumerate(ladder.side(role), start=1):
            names = ", ".join(f"`{name}`" for name in (rung.name, *rung.also))
            worst = ", ".join(f"`{name}` ({share:.2f})" for name, share in rung.worst) or "nobody"
            interval = f"{rung.low:.0f} to {rung.high:.0f}"
            row = (place, names, f"{rung.rating:.0f}", interval, f"{rung.score:.2f}", worst)
            lines.append(f"| {' | '.join(map(str, row))} |")
    return "\n".join([*lines[1:], ""])


def check(ladder, seed: int) -> None:
    """Print how ratings from other starts compare with the ladder's intervals."""
    from dronecombat_jax.analysis.newcomer import rate_newcomer
    from dronecombat_jax.analysis.result import fight_scores

    result = fly(ladder.episodes, seed, ladder.spawn)
    points = fight_scores(result)
    sides = result.defenders, result.attackers
    rating = {rung.identity: rung.rating for rung in ladder.rungs}
    apart, inside = [], []
    for role, side in enumerate(sides):
        anchors = np.asarray([rating[other.identity] for other in sides[1 - role]])
        for index, entrant in enumerate(side):
            own = 1.0 - points[:, index] if role else points[index]
            placing = rate_newcomer(own, anchors)
            apart.append(placing.rating - rating[entrant.identity])
            # both ratings have the same error
            reach = np.sqrt(2.0) * (placing.high - placing.low) / 2
            inside.append(abs(apart[-1]) <= reach)
    spread = float(np.sqrt(np.mean(np.square(apart))))
    print(
        f"seed {seed}: {sum(inside)} of {len(inside)} ratings agree within both intervals; "
        f"root mean square of the differences {spread:.1f} points, largest {np.abs(apart).max():.1f}"
    )


def write(ladder) -> None:
    """A ladder, and what is made of it as it was rounded."""
    from dronecombat_jax.config.starts import AS_TRAINED
    from dronecombat_jax.tournaments.ladder import LADDERS, ladder_text, read_ladder

    (shipped.FOLDER / LADDERS[ladder.spawn]).write_text(ladder_text(ladder))
    ladder = read_ladder(ladder.spawn)
    if ladder.spawn == AS_TRAINED:
        table = json.dumps(cards(ladder), indent=1, sort_keys=True)
        (shipped.FOLDER / shipped.CARDS).write_text(table + "\n")
    tables = standing_page(ladder)
    made = re.compile(MADE.format(f"standing {ladder.spawn}"), re.DOTALL)
    PAGE.write_text(made.sub(lambda _: tables, PAGE.read_text(), count=1))


def write_all(episodes: int) -> None:
    """All ladders anew."""
    from dronecombat_jax.tournaments.ladder import LADDERS

    for spawn in LADDERS:
        write(make(episodes, spawn))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--check", type=int, metavar="SEED")
    given = parser.parse_args()
    prepare("cpu")
    if given.check is None:
        write_all(given.episodes)
        return
    from dronecombat_jax.tournaments.ladder import LADDERS, read_ladder

    for spawn in LADDERS:
        check(read_ladder(spawn), given.check)


if __name__ == "__main__":
    main()

"""Final policies against those that they never met: everybody's defender, everybody's attacker.

    python experiments/strangers.py runs/strength/strong-0 runs/strength/strong-1=other goalkeeper dash
    python experiments/strangers.py pilots:strong-defender pilots:sippo-attacker my_policy.safetensors

A word is a run's folder, whose final policies of both sides fly, a policy (a file, pilots:NAME), or a
scripted pilot; a label may follow after "=". All fly in the game of the first that is not scripted, from its
starts at rest, by mean actions.
Prints a table in Markdown, a row for each defender: how far from the target it strikes, and the share
of its fights that end at the target, by attacker.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from measured import markdown_row

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.scripted import names_of
from dronecombat_jax.errors import UserError
from dronecombat_jax.policies import shipped
from dronecombat_jax.tournaments.contenders import find
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause, Trajectory
from dronecombat_jax.watch.flyers import Flyer, Named, read_crew
from dronecombat_jax.watch.recording import Filming, Record, recorder

PLAIN = ("hover", "dash")  # stand on the other side while one is read
MIDDLE = (10, 90)  # percentiles: where most of a defender's strikes are


def main() -> None:
    """Read the flags, fly, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "pilots", nargs="+", help="a run's folder, a policy, or a scripted pilot; WORD=label"
    )
    parser.add_argument("--fights", type=int, default=128, help="of each pair")
    flags = parser.parse_args()
    words = [(word, label or word) for word, _, label in (it.partition("=") for it in flags.pilots)]
    first = next((word for word, _ in words if not scripted_sides(word)), None)
    if first is None:
        parser.error("name a run or a policy: its game is flown")
    try:
        crew = read_crew(Named((first,), PLAIN))
        defenders, attackers = (field(first, words, role) for role in (DEFENDER, ATTACKER))
    except UserError as error:
        parser.exit(error.exit_code, f"error: {error.message}\n")
    fly = recorder(Combat(crew.config), Filming(flags.fights))
    for cells in table(defenders, attackers, fly):
        print(markdown_row(cells), flush=True)


def scripted_sides(word: str) -> tuple[int, ...]:
    """The sides that have a scripted pilot of this name."""
    return tuple(role for role in (DEFENDER, ATTACKER) if word in names_of(role))


def sides_of(word: str) -> tuple[int, ...]:
    """Whom `word` has: a scripted pilot or a policy one side, a run both. UserError for a bad file."""
    if word.startswith(shipped.PREFIX) or Path(word).is_file():
        return tuple(one.role for one in find(word).contenders)
    return scripted_sides(word) or (DEFENDER, ATTACKER)


def field(first: str, words: Sequence[tuple[str, str]], role: int) -> dict[str, Flyer]:
    """Who flies on a side, by label."""

    def flyer(word: str) -> Flyer:
        wanted = (word, PLAIN[ATTACKER]) if role == DEFENDER else (PLAIN[DEFENDER], word)
        return read_crew(Named((first,), wanted)).flyers[role]

    return {label: flyer(word) for word, label in words if role in sides_of(word)}


def table(
    defenders: dict[str, Flyer], attackers: dict[str, Flyer], fly: Record
) -> Iterator[list[str]]:
    """Its rows, heads first, each as soon as it is flown."""
    yield ["defender", "strikes, m from the target", *(f"`{label}`" for label in attackers)]
    yield ["---"] * (2 + len(attackers))
    for label, defender in defenders.items():
        fights = [fly(defender, attacker) for attacker in attackers.values()]
        struck = [away(one) for each in fights for one in each if one.cause == Cause.INTERCEPT]
        low, high = np.percentile(struck, MIDDLE) if struck else (np.nan, np.nan)
        reached = [np.mean([one.cause == Cause.REACHED for one in each]) for each in fights]
        yield [f"`{label}`", f"{low:.1f} to {high:.1f}", *(f"{share:.2f}" for share in reached)]


def away(fight: Trajectory) -> float:
    """Metres from the defender to the target at the end."""
    return float(np.linalg.norm(fight.qpos[-1, :3] - fight.target))


if __name__ == "__main__":
    main()

"""How scripted pilots fare in teams: defenders that each take the nearest attacker, and that share.

    python experiments/team_pilots.py [--preset 2v2] [--fights 256] [--seed 0]

All pairs from the same starts, in one program. Prints a Markdown table of the shares of fights that
end in an interception, so that no attacker is left, with 95 % Wilson intervals, in per cent.
"""

import argparse

from dronecombat_jax.machine import backend

DEFENDERS = ("proportional_navigation", "assigned_navigation")
ATTACKERS = ("dash", "weave", "pincer", "decoy")


def main() -> None:
    """Read the flags, fight, print the table."""
    parser = argparse.ArgumentParser(description="Fight scripted teams against each other.")
    parser.add_argument("--preset", default="2v2", help="whose game (default %(default)s)")
    parser.add_argument("--fights", type=int, default=256, help="of a pair (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the starts (default %(default)s)")
    flags = parser.parse_args()
    backend.prepare("cpu")
    for line in table(flags.preset, flags.fights, flags.seed):
        print(line)


def table(preset: str, fights: int, seed: int) -> list[str]:
    """The table's lines."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    from dronecombat_jax.arena.match import fight, scripted_team, start_fights
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.combat.scripted import one_per_fight
    from dronecombat_jax.config import settings
    from dronecombat_jax.runs.evaluation import with_interval
    from dronecombat_jax.types import ATTACKER, DEFENDER, Cause

    combat = Combat(settings.load(preset))
    pairs = [(attacker, defender) for attacker in ATTACKERS for defender in DEFENDERS]
    which = np.repeat(np.arange(len(pairs)), fights)
    once = start_fights(combat, jax.random.key(seed), fights)
    start = jax.tree.map(lambda x: jnp.tile(x, (len(pairs), *[1] * (x.ndim - 1))), once)

    def side(names: tuple[str, ...], role: int, index: np.ndarray) -> list:
        teams = zip(*(scripted_team(combat, name, role) for name in names), strict=True)
        return [one_per_fight(pilots, jnp.asarray(index)) for pilots in teams]  # pyright: ignore

    defend = side(DEFENDERS, DEFENDER, which % len(DEFENDERS))
    attack = side(ATTACKERS, ATTACKER, which // len(DEFENDERS))
    fly = jax.jit(lambda start: fight(combat, defend, attack, start, jax.random.key(seed)).cause)
    stopped = np.asarray(fly(start)).reshape(len(pairs), fights) == Cause.INTERCEPT
    lines = ["| attackers | defenders | interception |", "|---|---|---|"]
    for (attacker, defender), hits in zip(pairs, stopped, strict=True):
        share, low, high = (100.0 * each for each in with_interval(int(hits.sum()), fights))
        lines.append(f"| `{attacker}` | `{defender}` | {share:.1f} [{low:.1f}, {high:.1f}] |")
    return lines


if __name__ == "__main__":
    main()

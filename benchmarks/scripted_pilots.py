"""How the scripted pilots fare against each other.

    python benchmarks/scripted_pilots.py [--fights 256] [--seed 0] [--preset paper] [--uniform | --setback 1.5]

Every attacker against every defender from the same starts, in one program. Prints a Markdown table
of shares with 95 % Wilson intervals in per cent; down: the share of fights in which that drone had
crashed by the end.
"""

import argparse
from dataclasses import replace

from dronecombat_jax.machine import backend


def main() -> None:
    """Read the flags, fight, print the table."""
    parser = argparse.ArgumentParser(description="Fight all scripted pilots against each other.")
    parser.add_argument(
        "--fights", type=int, default=256, help="fights per pair (default %(default)s)"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="of the start states (default %(default)s)"
    )
    parser.add_argument("--preset", default="paper", help="whose game (default %(default)s)")
    parser.add_argument(
        "--uniform", action="store_true", help="start anywhere, whatever the preset says"
    )
    parser.add_argument(
        "--setback",
        type=float,
        default=0.0,
        help="m that the defender starts farther from the target",
    )
    flags = parser.parse_args()
    if flags.uniform and flags.setback:
        parser.error("--setback is of fixed starts, and --uniform has none")
    backend.prepare("cpu")
    table(flags.fights, flags.seed, flags.preset, flags.uniform, flags.setback)


def table(fights: int, seed: int, preset: str, uniform: bool, setback: float) -> None:
    """Fight and print."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    from dronecombat_jax.arena.match import fight, start_fights
    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.combat.scripted import PILOTS, build_pilot, one_per_fight
    from dronecombat_jax.config import settings
    from dronecombat_jax.config.starts import with_starts
    from dronecombat_jax.runs.evaluation import summary
    from dronecombat_jax.types import ATTACKER, DEFENDER, FightResult

    config = with_starts(settings.load(preset), "uniform" if uniform else "")
    combat = Combat(replace(config, game=replace(config.game, defender_setback=setback)))
    attackers, defenders = list(PILOTS[ATTACKER]), list(PILOTS[DEFENDER])
    pairs = [(attacker, defender) for attacker in attackers for defender in defenders]
    which = np.repeat(np.arange(len(pairs)), fights)

    def pilot(names: list[str], index: np.ndarray):
        return one_per_fight(
            [build_pilot(name, combat.config, combat.scene) for name in names], jnp.asarray(index)
        )

    once = start_fights(combat, jax.random.key(seed), fights)
    start = jax.tree.map(lambda leaf: jnp.tile(leaf, (len(pairs),) + (1,) * (leaf.ndim - 1)), once)
    defender, attacker = (
        pilot(defenders, which % len(defenders)),
        pilot(attackers, which // len(defenders)),
    )
    match = jax.jit(lambda start: fight(combat, defender, attacker, start, jax.random.key(seed)))
    result = jax.device_get(match(start))

    columns = ("intercept", "reached", "defender down", "attacker down", "time-out", "seconds")
    print(
        f"{fights} fights a pair, preset {preset}, seed {seed}{', uniform starts' if uniform else ''}{f', setback {setback:g} m' if setback else ''}; shares in % [95 % interval]\n"
    )
    print("| attacker | defender | " + " | ".join(columns) + " |")
    print("|---|---|" + "---|" * len(columns))
    for index, names in enumerate(pairs):
        rows = which == index
        counted = summary(
            combat.config, FightResult(result.cause[rows], result.steps[rows], result.down[rows])
        )
        shares = [
            counted["cause"]["intercept"],
            counted["cause"]["reached"],
            *counted["crash"].values(),
        ]
        shares.append(counted["cause"]["timeout"])
        cells = [
            f"{100 * share:.1f} [{100 * low:.1f}, {100 * high:.1f}]" for share, low, high in shares
        ]
        print(f"| {' | '.join(names)} | {' | '.join(cells)} | {counted['seconds']['mean']:.2f} |")


if __name__ == "__main__":
    main()

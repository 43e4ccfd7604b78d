"""The numbers of the scripted `goalkeeper`, by the cross-entropy method, against attackers that beat it.

    python experiments/tune_goalkeeper.py ATTACKER ... [--rounds 8] [--candidates 40] [--fights 128]

An attacker is a policy (a file, pilots:NAME) or a scripted pilot. A round draws candidates about the best of
the round before; each fights every attacker from the same starts at rest in preset `duel`. Its score is the
mean over the attackers of the share that it stops, and the least one, half each. Prints each round, and the
numbers in the end, for `combat/guidance.py`.
"""

import argparse
import itertools
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax import prepare
from dronecombat_jax.arena.match import fight, policy_team, scripted_team, start_fights
from dronecombat_jax.combat.autopilot import airframe
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.fingerprint import own_view
from dronecombat_jax.combat.guidance import KEEPER, Keeper, Stance, goalkeeper
from dronecombat_jax.combat.scripted import Pilot, guided_pilot, names_of
from dronecombat_jax.config import settings
from dronecombat_jax.errors import UserError
from dronecombat_jax.tournaments.contenders import SCRIPTED_PREFIX, find
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause

KEPT = 0.2  # of a round's candidates
NAMES = ("distance", "look", "gain", "braking", "hurry", "velocity_gain", "along", "push")
SPREAD = np.asarray([0.08, 0.02, 0.8, 3.0, 0.3, 1.5, 0.3, 0.3])  # of the first round
LEAST = np.asarray([0.1, 0.0, 0.5, 2.0, 0.0, 2.0, 0.0, 0.05])


def numbers_of(keeper: Keeper) -> np.ndarray:
    """What `keeper_of` makes the goalkeeper of."""
    stance = keeper.stance._asdict()
    return np.asarray([stance[name] if name in stance else getattr(keeper, name) for name in NAMES])


def keeper_of(numbers: jax.Array) -> Keeper:
    """The goalkeeper of `numbers` [8], in the order of NAMES."""
    named: dict[str, Any] = dict(zip(NAMES, numbers, strict=True))
    distance, look = named.pop("distance"), named.pop("look")
    return Keeper(Stance(**named), distance, look)


def is_scripted(word: str) -> bool:
    """Whether a scripted pilot of either side has this name."""
    return any(word in names_of(role) for role in (DEFENDER, ATTACKER))


def shares(combat: Combat, attackers: Sequence[str], fights: int) -> Callable[..., jax.Array]:
    """A compiled function (numbers [8], key) -> share of fights that each attacker is stopped in."""
    config, teams = combat.config, []
    for word in attackers:
        (one,) = find(SCRIPTED_PREFIX + word if is_scripted(word) else word).contenders
        if one.role != ATTACKER or one.player is None:
            raise UserError(f"{word}: no attacker")
        pilot = one.player.pilot
        if isinstance(pilot, str):
            teams.append(scripted_team(combat, pilot, ATTACKER))
        else:
            view = own_view(one.environment, config.game)
            learn = replace(config.learn, normalize_observations=one.player.normalize)
            teams.append(policy_team(config, learn, pilot, ATTACKER, observation=view))
    body = airframe(config, combat.scene, DEFENDER)

    def keeper(numbers: jax.Array) -> Pilot:
        law = partial(goalkeeper, keeper=keeper_of(numbers))
        return guided_pilot(combat.sides, DEFENDER, law, body, config.control_dt)

    @jax.jit
    def fly(numbers: jax.Array, key: jax.Array) -> jax.Array:
        start, noise = jax.random.split(key)
        starts = start_fights(combat, start, fights)
        lost = [Cause.REACHED, Cause.DEFENDER_CRASH]
        causes = [fight(combat, keeper(numbers), team, starts, noise).cause for team in teams]
        return jnp.stack([1.0 - jnp.mean(jnp.isin(cause, jnp.asarray(lost))) for cause in causes])

    return fly


def score(stopped: np.ndarray) -> np.ndarray:
    """Of shares [..., attackers]: the mean and the least one, half each."""
    return 0.5 * (stopped.mean(axis=-1) + stopped.min(axis=-1))


def improved(
    count: Callable[[np.ndarray, jax.Array], np.ndarray],
    centre: np.ndarray,
    candidates: int,
    rng: np.random.Generator,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Round by round: the mean of the best candidates, and what the best one's shares were."""
    spread = SPREAD
    for number in itertools.count():
        drawn = centre + spread * rng.standard_normal((candidates, len(NAMES)))
        drawn = np.maximum(np.concatenate([centre[None], drawn[1:]]), LEAST)
        stopped = np.stack([count(each, jax.random.key(number)) for each in drawn])
        best = np.argsort(-score(stopped))[: max(2, int(KEPT * candidates))]
        centre, spread = drawn[best].mean(axis=0), drawn[best].std(axis=0) + 0.05 * SPREAD
        yield centre, stopped[best[0]]


def main() -> int:
    """Read the flags, search, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("attackers", nargs="+", help="a policy, pilots:NAME, or a scripted pilot")
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--candidates", type=int, default=40)
    parser.add_argument("--fights", type=int, default=128, help="of a candidate and an attacker")
    parser.add_argument("--seed", type=int, default=0)
    flags = parser.parse_args()
    prepare("cpu")
    try:
        fly = shares(Combat(settings.load("duel")), flags.attackers, flags.fights)
    except UserError as error:
        parser.exit(error.exit_code, f"error: {error.message}\n")
    fresh = jax.random.key(1_000_000 + flags.seed)
    count = lambda numbers, key: np.asarray(fly(jnp.asarray(numbers), key))
    centre = numbers_of(KEEPER)
    print("before", np.round(count(centre, fresh), 3), flush=True)
    search = improved(count, centre, flags.candidates, np.random.default_rng(flags.seed))
    for found, stopped in itertools.islice(search, flags.rounds):
        centre = found
        print(f"{score(stopped):.3f}", np.round(stopped, 2), flush=True)
    print("after", np.round(count(centre, fresh), 3))
    print({name: float(f"{value:.3g}") for name, value in zip(NAMES, centre, strict=True)})
    return 0


if __name__ == "__main__":
    sys.exit(main())

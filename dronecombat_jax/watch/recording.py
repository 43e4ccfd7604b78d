"""Fights recorded step by step, for replays and films. Nothing is drawn here.

Fight e of a seed starts as fight e of a tournament with that seed, however many are recorded.
What does not live here: who flies (`flyers`), counting outcomes (`evaluation`).
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.arena.lanes import fight_key, start_states
from dronecombat_jax.arena.match import Team, policy_team, record, scripted_team, trajectory
from dronecombat_jax.arena.players import content_words
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.types import EnvState, FightRecord, SidePolicy, Trajectory
from dronecombat_jax.watch.flyers import Flyer

Record = Callable[[Flyer, Flyer], list[Trajectory]]
# a scripted pilot's name, or how a policy is flown and what it sees, as `Flyer` has it
Kind = str | tuple[LearnConfig, str]


class Filming(NamedTuple):
    """Which fights to record."""

    fights: int = 9
    seed: int = 0  # of the start states
    stochastic: bool = False  # draw the policies' actions instead of taking their mean
    spawn: str = ""  # starts (`config.starts`); "": those of the run


def recorder(combat: Combat, filming: Filming) -> Record:
    """A function from both sides to their fights; compiled once for policies of one shape."""
    starts = jax.jit(partial(start_states, combat), static_argnums=1)(filming.seed, filming.fights)
    seed = jnp.uint32(filming.seed)

    @partial(jax.jit, static_argnums=0)
    def fly(
        kinds: tuple[Kind, ...], pilots: tuple[SidePolicy | None, ...], words: jax.Array
    ) -> Any:
        act = partial(_team, combat, filming.stochastic)
        each = [act(role, *given) for role, given in enumerate(zip(kinds, pilots, strict=True))]

        def fly_one(start: EnvState, episode: jax.Array) -> FightRecord:
            alone = jax.tree.map(lambda leaf: leaf[None], start)
            return record(combat, each[0], each[1], alone, fight_key(seed, words, episode))

        return jax.vmap(fly_one)(starts, jnp.arange(filming.fights))

    def call(defender: Flyer, attacker: Flyer) -> list[Trajectory]:
        both = (defender, attacker)
        kinds = tuple(
            flyer.pilot if isinstance(flyer.pilot, str) else (flyer.learn, flyer.observation)
            for flyer in both
        )
        pilots = tuple(None if isinstance(flyer.pilot, str) else flyer.pilot for flyer in both)
        words = np.concatenate([content_words(flyer.identity) for flyer in both])
        fights = joined(jax.device_get(fly(kinds, pilots, words)))
        return [trajectory(combat, fights, index) for index in range(filming.fights)]

    return call


def _team(
    combat: Combat,
    stochastic: bool,
    role: int,
    kind: Kind,
    policy: SidePolicy | None,
) -> Team:
    if isinstance(kind, str):
        return scripted_team(combat, kind, role)
    assert policy is not None
    learn, observation = kind
    return policy_team(combat.config, learn, policy, role, stochastic, observation)


def joined(fights: FightRecord) -> FightRecord:
    """Records of single fights, leaves [E, T, 1, ...] and [E, 1, ...], as that of E fights."""
    steps = (*fights[:3], fights.down, fights.struck)
    qpos, qvel, action, down, struck = jax.tree.map(
        lambda leaf: np.swapaxes(leaf[:, :, 0], 0, 1), steps
    )
    start, result = jax.tree.map(lambda leaf: leaf[:, 0], (fights.start, fights.result))
    return FightRecord(qpos, qvel, action, start, result, down, struck)

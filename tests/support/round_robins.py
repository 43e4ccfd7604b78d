"""Round robins of policies that nobody trained, as the tournament flies them and fight by fight."""

import jax
import numpy as np
from policies import make_policy

from dronecombat_jax.arena.lanes import fight_key, start_states
from dronecombat_jax.arena.match import fight, policy_pilot
from dronecombat_jax.arena.players import Player, content_words
from dronecombat_jax.arena.rectangle import Rules
from dronecombat_jax.arena.round_robin import play
from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.scripted import build_pilot
from dronecombat_jax.config.fields import LearnConfig
from dronecombat_jax.learn.mates import only
from dronecombat_jax.types import ATTACKER, DEFENDER, Cause


def player(seed: int, sizes: tuple[int, ...] = (35, 16, 8, 4), steer: float = 20.0) -> Player:
    """A policy that nobody trained; `steer` times harder on the stick than `make_policy`'s, log-std
    in its bounds.
    """
    policy = make_policy(sizes, seed)
    *first, last = policy.network.weights
    network = policy.network.replace(weights=(*first, last * np.float32(steer)))
    log_std = np.clip(policy.log_std, -20.0, 2.0)
    return Player(f"player-{seed}", policy.replace(network=network, log_std=log_std))


def remembering(seed: int, frames: int = 1, blind: bool = False, state: int = 0) -> Player:
    """A policy that sees its last `frames` observations, or a GRU's `state`; or, `blind`, the
    present observation alone of what it sees.
    """
    policy = make_policy((35 * frames + state, 16, 4), seed, frames, state)
    first, last = policy.network.weights
    seen = np.arange(first.shape[0])[:, None] < (35 if blind else first.shape[0])
    network = policy.network.replace(weights=(first * seen, last * np.float32(20.0)))
    log_std = np.clip(policy.log_std, -20.0, 0.0)
    return Player(f"remembering-{seed}", policy.replace(network=network, log_std=log_std))


def grid(
    combat: Combat, defenders: list[Player], attackers: list[Player], rules: Rules, **how
) -> np.ndarray:
    """Causes and steps of every fight [2, D, A, E]; -1 where it was not flown. Every cell must come
    once.
    """
    out = np.full((2, len(defenders), len(attackers), rules.episodes), -1)
    fights = 0
    for harvest in play(combat, defenders, attackers, rules, **how):
        fights += harvest.fights.sum()
        for row, column, cause, steps in harvest.cells:
            assert np.all(out[:, row, column] == -1)
            out[:, row, column] = cause, steps
    assert fights == np.sum(out[0] >= 0) == np.sum(out[0] > Cause.NONE)
    return out


def one_by_one(
    combat: Combat, defenders: list[Player], attackers: list[Player], rules: Rules
) -> np.ndarray:
    """The same grid by `match.fight`, one fight at a time."""
    starts = start_states(combat, rules.seed, rules.episodes)
    learn, config = LearnConfig(), combat.config

    def pilot(one: Player, role: int):
        if isinstance(one.pilot, str):
            return build_pilot(one.pilot, config, combat.scene, role)
        return policy_pilot(learn, only(one.pilot, "a duel"), role, rules.stochastic)

    def single(start, key, defender, attacker):
        return fight(combat, pilot(defender, DEFENDER), pilot(attacker, ATTACKER), start, key)

    # Policies are data, so that pairs of one size share a program; names are not.
    by_policy = jax.jit(lambda s, k, d, a: single(s, k, Player("", d), Player("", a)))
    by_name = jax.jit(single, static_argnums=(2, 3))
    out = np.zeros((2, len(defenders), len(attackers), rules.episodes), int)
    for row, defender in enumerate(defenders):
        for column, attacker in enumerate(attackers):
            words = np.concatenate(
                [content_words(defender.identity), content_words(attacker.identity)]
            )
            scripted = isinstance(defender.pilot, str), isinstance(attacker.pilot, str)
            for episode in range(rules.episodes):
                start = jax.tree.map(lambda leaf, e=episode: leaf[e : e + 1], starts)
                key = fight_key(np.uint32(rules.seed), words, np.int32(episode))
                if not any(scripted):
                    result = by_policy(start, key, defender.pilot, attacker.pilot)
                elif all(scripted):
                    result = by_name(start, key, defender, attacker)
                else:
                    continue
                out[:, row, column, episode] = result.cause[0], result.steps[0]
    return out

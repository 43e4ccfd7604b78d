"""The reward of eq. 9-12, term by term. Plain arrays of one fight.

r_d = dt [w (1 - tanh(|p_d - p_a| / c1)) - 0.05 |v_d|^2 - 0.01 |w_d|^2] + win - lose - crash
r_a = dt [w (1 - tanh(|p_a - p_t| / c2)) - 0.05 |v_a|^2 - 0.01 |w_a|^2] + win - lose - crash
"""

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.rules import Events, struck_out, teams, timeout_decides
from dronecombat_jax.config.fields import Config, GameConfig
from dronecombat_jax.config.sides import DUEL
from dronecombat_jax.types import Cause, Drones, RewardTerms


def reward_terms(
    config: Config,
    drones: Drones,
    target: jax.Array,
    events: Events,
    down: jax.Array,
    cause: jax.Array,
) -> RewardTerms:
    """Each term [A], weighted and signed, for the state after a control step.

    `drones` fields [A, ...]; `target` [3] m; `down` [A]: down before the step; `cause` []: a
    `Cause`. A drone that is out earns no dense reward, unless `crash_rule` is "grounded": then it
    lies there, is rewarded as ever and pays the crash penalty at every step.
    """
    weights, game = config.reward, config.game
    scale = config.control_dt if weights.time_scaled else 1.0
    grounded = game.crash_rule == "grounded"
    flying = jnp.ones_like(down) if grounded else ~down
    dense = scale * flying.astype(jnp.float32)

    out = events.down | struck_out(game, events)
    distance = jnp.linalg.norm(drones.position - goals(game, drones, target, out), axis=-1)
    scales = weights.defender_distance_scale, weights.attacker_distance_scale
    distance_scale = jnp.asarray([scales[side] for side in game.sides])
    approach = weights.approach_weight * (1.0 - jnp.tanh(distance / distance_scale))

    is_cause = lambda name: (cause == name).astype(jnp.float32)
    each = lambda defender, attacker: jnp.stack([(defender, attacker)[s] for s in game.sides])
    defended, attacked = teams(game)
    struck, reached = _struck(config, events, cause), is_cause(Cause.REACHED)
    all_of = lambda share, part: jnp.broadcast_to(share, (part.stop - part.start,))
    timeout = is_cause(Cause.TIMEOUT) * float(timeout_decides(game))
    win = weights.win * jnp.concatenate([struck[defended], all_of(reached, attacked)])
    win = win + weights.crash_win * each(
        is_cause(Cause.ATTACKER_CRASH), is_cause(Cause.DEFENDER_CRASH)
    )
    lost = all_of(weights.lose * reached, defended), weights.intercepted * struck[attacked]
    pays_crash = events.down if grounded else events.crashed
    return RewardTerms(
        approach=dense * approach,
        linear_velocity=-dense
        * weights.linear_velocity_penalty
        * jnp.sum(drones.velocity**2, axis=-1),
        angular_velocity=-dense
        * weights.angular_velocity_penalty
        * jnp.sum(drones.rate**2, axis=-1),
        win=win,
        lose=-jnp.concatenate(lost),
        crash=-weights.crash_penalty * pays_crash.astype(jnp.float32),
        timeout=timeout * each(weights.timeout_win, -weights.timeout_penalty),
    )


def goals(game: GameConfig, drones: Drones, target: jax.Array, out: jax.Array) -> jax.Array:
    """[A, 3] m, what each drone is to approach: a defender the nearest attacker that still flies,
    or the nearest of all where none does; an attacker the target. `out` [A] bool: who flies no more.
    """
    position = drones.position
    defended, attacked = teams(game)
    if game.sides == DUEL:
        return jnp.stack([position[1], target])
    flying = ~out[attacked]
    way = position[defended][:, None] - position[attacked][None]
    away = jnp.where(flying | ~jnp.any(flying), jnp.sum(way**2, axis=-1), jnp.inf)
    nearest = position[attacked][jnp.argmin(away, axis=-1)]
    return jnp.concatenate([nearest, jnp.broadcast_to(target, (game.attackers, 3))])


def _struck(config: Config, events: Events, cause: jax.Array) -> jax.Array:
    """What the strikes of this step are worth to each drone, [A], in units of one prize or price.

    To the defender that struck 1, to its team mates `reward.team_share`; to the attacker that was
    struck 1, to its team mates that share. In a duel it is the cause that counts.
    """
    share, strikes = config.reward.team_share, events.strikes
    if config.game.sides == DUEL or strikes is None:
        return jnp.repeat((cause == Cause.INTERCEPT).astype(jnp.float32), len(config.game.sides))
    taken = jnp.any(strikes, axis=0)
    by_defender = jnp.sum(jnp.where(strikes, 1.0, share * taken), axis=1)
    itself = jnp.eye(config.game.attackers, dtype=bool)
    of_attacker = jnp.sum(jnp.where(itself, 1.0, share) * taken, axis=1)
    return jnp.concatenate([by_defender, of_attacker])


def total(terms: RewardTerms) -> jax.Array:
    """The reward [A]."""
    return sum(terms[1:], terms[0])

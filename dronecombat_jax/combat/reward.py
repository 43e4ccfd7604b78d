"""The reward of eq. 9-12, term by term. Plain arrays of one fight.

r_d = dt [w (1 - tanh(|p_d - p_a| / c1)) - 0.05 |v_d|^2 - 0.01 |w_d|^2] + win - lose - crash
r_a = dt [w (1 - tanh(|p_a - p_t| / c2)) - 0.05 |v_a|^2 - 0.01 |w_a|^2] + win - lose - crash
"""

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.rules import Events, timeout_decides
from dronecombat_jax.config.fields import Config
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

    position = drones.position
    distance = jnp.linalg.norm(position - jnp.stack([position[1], target]), axis=-1)
    distance_scale = jnp.asarray([weights.defender_distance_scale, weights.attacker_distance_scale])
    approach = weights.approach_weight * (1.0 - jnp.tanh(distance / distance_scale))

    is_cause = lambda name: (cause == name).astype(jnp.float32)
    intercept, reached = is_cause(Cause.INTERCEPT), is_cause(Cause.REACHED)
    timeout = is_cause(Cause.TIMEOUT) * float(timeout_decides(game))
    win = weights.win * jnp.stack([intercept, reached])
    win = win + weights.crash_win * jnp.stack(
        [is_cause(Cause.ATTACKER_CRASH), is_cause(Cause.DEFENDER_CRASH)]
    )
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
        lose=-jnp.stack([weights.lose * reached, weights.intercepted * intercept]),
        crash=-weights.crash_penalty * pays_crash.astype(jnp.float32),
        timeout=timeout * jnp.asarray([weights.timeout_win, -weights.timeout_penalty]),
    )


def total(terms: RewardTerms) -> jax.Array:
    """The reward [A]."""
    return sum(terms[1:], terms[0])

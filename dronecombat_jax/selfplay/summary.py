"""What an iteration reports: how its fights ended, what was earned, and the records of past players.

What does not live here: which fights count (`tally`), the iteration itself (`chunk`).
"""

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.games import game_of
from dronecombat_jax.combat.rules import outcome_table
from dronecombat_jax.config.fields import Config
from dronecombat_jax.selfplay import opponents, tally
from dronecombat_jax.selfplay.pool import NOBODY, count_wins
from dronecombat_jax.selfplay.samplers import GRADES
from dronecombat_jax.types import (
    Cause,
    Flown,
    IterationMetrics,
    SelfPlay,
    Transition,
    UpdateMetrics,
)


def count_fights(
    config: Config, selfplay: SelfPlay | None, rollout: Transition, flown: Flown
) -> tuple[SelfPlay | None, jax.Array | None]:
    """Enter the fights of a `rollout` that count into the records of past players, and count them by
    the table's rows (`opponents.count_outcomes`).
    """
    outcomes = jnp.asarray(outcome_table(config.game))[rollout.cause]
    together = jnp.arange(config.train.num_envs) >= config.solo_envs
    counted = tally.counted(flown, rollout) & together
    met = opponents.count_outcomes(config, selfplay, outcomes, counted)
    if selfplay is not None:
        rho = 1.0 - rollout.clock / config.game.episode_steps
        grade, sides = GRADES[config.selfplay.record], opponents.past_sides(config, selfplay)
        selfplay = count_wins(selfplay, outcomes, counted, rho, grade, sides)
    return selfplay, met


def count_causes(rollout: Transition, flown: Flown) -> jax.Array:
    """How the fights of a `rollout` that count ended, `flown` [T, N]: [len(Cause)] int32."""
    counted = tally.counted(flown, rollout)
    return jnp.sum(
        jax.nn.one_hot(rollout.cause, len(Cause), dtype=jnp.int32) * counted[..., None], axis=(0, 1)
    )


def summarize(
    config: Config,
    rollout: Transition,
    flown: Flown,
    learners: UpdateMetrics,
    selfplay: SelfPlay | None,
) -> IterationMetrics:
    """Count what happened in a `rollout` of those that fly together, `flown` [T, N]; an absent
    defender has not crashed.
    """
    counted = tally.counted(flown, rollout)
    down = rollout.down & ~game_of(config).absent(config.game.sides)
    return IterationMetrics(
        causes=count_causes(rollout, flown),
        crashes=jnp.sum(down & counted[..., None], axis=(0, 1), dtype=jnp.int32),
        episode_steps=jnp.sum(flown.steps * counted, dtype=jnp.int32),
        returns=jnp.sum(flown.returns * counted[..., None], axis=(0, 1)),
        diverged=jnp.sum(rollout.cause == Cause.DIVERGED, dtype=jnp.int32),
        reward_terms=jax.tree.map(lambda term: jnp.mean(term, axis=(0, 1)), rollout.reward_terms),
        learners=learners,
        frozen=jnp.asarray(NOBODY, jnp.int32) if selfplay is None else selfplay.frozen,
        opponent=jnp.asarray(NOBODY, jnp.float32)
        if selfplay is None
        else jnp.mean(selfplay.opponent.astype(jnp.float32)),
    )

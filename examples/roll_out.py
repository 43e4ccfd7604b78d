"""A thousand fights side by side: random actions until all are over."""

import dronecombat_jax as dc

dc.prepare()  # settles what JAX reads from the environment, before JAX is imported

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402


def main(fights: int = 1000) -> dict[str, int]:
    """How many fights ended by which cause."""
    combat = dc.Combat(dc.load_config("duel"))
    state = jax.jit(jax.vmap(combat.reset))(jax.random.split(jax.random.key(0), fights))
    step = jax.jit(jax.vmap(combat.step))
    cause = jnp.zeros(fights, jnp.int32)
    for number in range(combat.config.game.episode_steps):
        action = jax.random.uniform(jax.random.key(number), (fights, 2, 4), minval=-1.0)
        state, output = step(state, action)
        cause = jnp.where(cause == 0, output.cause, cause)  # 0: the fight went on until here
    from dronecombat_jax.types import Cause

    return {ended.name.lower(): int(jnp.sum(cause == ended)) for ended in Cause if ended}


if __name__ == "__main__":
    print(main())

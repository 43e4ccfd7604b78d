"""A sampler of past opponents: who has been forgotten?

dronecombat train --preset smoke --selfplay.probability 0.5 --selfplay.sampler own_sampler:oldest_half
"""

import jax
import jax.numpy as jnp

import dronecombat_jax as dc
from dronecombat_jax.config.fields import SelfPlayConfig
from dronecombat_jax.selfplay.samplers import Members


def oldest_half(members: Members, selfplay: SelfPlayConfig) -> jax.Array:
    """Alike among the older half of the pool; a weight for each of its K slots."""
    return (members.slot <= (members.filled - 1) // 2).astype(jnp.float32)


def main(preset: str = "smoke") -> None:
    """Train with it."""
    changes = {
        "run.name": "own-sampler",
        "run.video": False,
        "selfplay.probability": 0.5,
        "selfplay.sampler": "own_sampler:oldest_half",
    }
    print(dc.train(preset, changes))


if __name__ == "__main__":
    main()

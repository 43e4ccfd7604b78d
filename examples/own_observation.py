"""What a drone sees, of one's own: 15 numbers instead of 35.

dronecombat train --preset smoke --game.observation own_observation:BEARINGS
"""

import jax
import jax.numpy as jnp

import dronecombat_jax as dc
from dronecombat_jax.combat.observe import Observation
from dronecombat_jax.sim.rotation import rotate_inverse
from dronecombat_jax.types import Drones


def bearings(drones: Drones, target: jax.Array) -> jax.Array:
    """[A, 15] in each drone's own frame: own velocity and rate, up, and two directions."""
    unit = lambda vector: vector / (jnp.linalg.norm(vector, axis=-1, keepdims=True) + 1e-6)
    other = jnp.flip(drones.position, axis=0) - drones.position
    into = lambda vector: rotate_inverse(drones.quaternion, vector)
    up = jnp.broadcast_to(jnp.asarray([0.0, 0.0, 1.0]), drones.position.shape)
    seen = [into(drones.velocity), drones.rate, into(up), into(unit(other))]
    return jnp.concatenate([*seen, into(unit(target - drones.position))], axis=-1)


FIELDS = (("v_self", 3), ("w_self", 3), ("up", 3), ("to_other", 3), ("to_target", 3))
BEARINGS = Observation(FIELDS, bearings)


def main(preset: str = "smoke") -> None:
    """Train with it."""
    changes = {
        "run.name": "own-observation",
        "run.video": False,
        "game.observation": "own_observation:BEARINGS",
    }
    print(dc.train(preset, changes))


if __name__ == "__main__":
    main()

"""From a wanted thrust and moment to the action that asks for them: `actuation` backwards.

For controllers that know the nominal body and the speeds of its rotors, such as the scripted
pilots. What does not live here: which thrust and moment (`combat.autopilot`).
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.actuation import collect, distribute, plant_of, rate_damping, thrusts_of
from dronecombat_jax.sim.rotors import Rotors
from dronecombat_jax.sim.scene import Scene

# (thrust [E] N, moment [E, 3] N m, rate [E, 3] rad/s, speeds [E, 4]) -> action [E, 4], not clipped
Ask = Callable[[jax.Array, jax.Array, jax.Array, jax.Array], jax.Array]


def full_thrust(sim: SimConfig, scene: Scene, role: int) -> float:
    """Thrust in N at full command, of the drone `role` that is flown by rotors."""
    assert scene.rotors is not None
    most = 4.0 * scene.rotors.max_thrust
    if sim.actuation == "mixed":
        most = min(most, sim.thrust_to_weight * float(scene.weight[role]))
    return most


def asking(sim: SimConfig, scene: Scene, role: int) -> Ask:
    """The inverse of `sim.actuation` for the drone `role`.

    It asks for more than is wanted, as much as makes up for the lag within a control step.
    """
    plant = plant_of(sim, scene)
    rotors, inertia = plant.rotors, plant.inertia[role]
    most = sim.thrust_to_weight * float(scene.weight[role])
    lag = (rotors.lag_up + rotors.lag_down) / 2.0
    share = 1.0 - float(np.exp(-sim.timestep * sim.substeps / lag))

    def ahead(thrust: jax.Array, moment: jax.Array, speeds: jax.Array):
        now = collect(rotors, thrusts_of(rotors, speeds))
        return now[0] + (thrust - now[0]) / share, now[1] + (moment - now[1]) / share

    def rotors_ask(thrust: jax.Array, moment: jax.Array, rate: jax.Array, speeds: jax.Array):
        return _share(rotors, distribute(rotors, *ahead(thrust, moment, speeds)))

    def mixed_ask(thrust: jax.Array, moment: jax.Array, rate: jax.Array, speeds: jax.Array):
        thrust, moment = ahead(thrust, moment, speeds)
        lift = 2.0 * thrust[:, None] / most - 1.0
        return jnp.concatenate([lift, moment / max(sim.moment_scale, 1e-9)], axis=-1)

    def ctbr_ask(thrust: jax.Array, moment: jax.Array, rate: jax.Array, speeds: jax.Array):
        lead, wanted = ahead(thrust, moment, speeds)
        _, present = collect(rotors, thrusts_of(rotors, speeds))
        gyroscopic = jnp.cross(rate, inertia * rate)
        turn = (wanted - gyroscopic + rate_damping(rotors) * (present - gyroscopic)) / inertia
        rates = (rate + turn / rotors.rate_gain) / jnp.asarray(rotors.max_rates)
        return jnp.concatenate([_share(rotors, lead[:, None] / 4.0), rates], axis=-1)

    return {"rotors": rotors_ask, "mixed": mixed_ask, "ctbr": ctbr_ask}[sim.actuation]


def _share(rotors: Rotors, thrusts: jax.Array) -> jax.Array:
    """-1 at the least thrust, 1 at the most."""
    return 2.0 * (thrusts - rotors.min_thrust) / (rotors.max_thrust - rotors.min_thrust) - 1.0

"""Every body with rotors: hover, full command and tumble, within what its source says."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.actuation import hover_speeds, plant_of
from dronecombat_jax.sim.craft import build_craft_step
from dronecombat_jax.sim.rotors import ROTORS, described, thrust_to_weight
from dronecombat_jax.sim.scene import load_scene
from dronecombat_jax.types import Craft

# Full thrust over weight, and m/s straight up at which drag and weight are the full thrust: 4 T/m g
# and (4 T - m g) / d of the sources' numbers, worked by hand.
PUBLISHED = {
    "firmware": (0.45 / 0.28449, (0.45 - 0.28449) / 0.0177),  # 1.58, 9.35
    "upgrade": (0.65 / 0.318825, (0.65 - 0.318825) / 0.0177),  # 2.04, 18.7
    "brushless": (0.8 / 0.385533, (0.8 - 0.385533) / 0.0236),  # 2.08, 17.6
    "racer": (34.0 / 7.37712, (34.0 - 7.37712) / 0.42),  # 4.61, 63.4
}
STEPS = 100  # 2 s
HOVER, FULL, TUMBLE = range(3)


def fly(body: str) -> tuple[np.ndarray, np.ndarray]:
    """qpos [T, 3, 14] and qvel [T, 3, 12]: at hover; spun up, full command; tumbling, idle."""
    sim = SimConfig(body=body, actuation="rotors", drag=True)
    scene = load_scene(sim)
    step, plant = build_craft_step(sim, scene), plant_of(sim, scene)
    rotors, hover = plant.rotors, hover_speeds(plant)
    idle = jnp.full((2, 4), (rotors.min_thrust / rotors.max_thrust) ** 0.5)
    craft = Craft(speeds=jnp.stack([hover, jnp.ones((2, 4)), idle]))
    qpos = jnp.tile(jnp.asarray([0.0, 0, 0, 1, 0, 0, 0, 0, 5, 0, 1, 0, 0, 0]), (3, 1))
    qvel = jnp.zeros((3, 12)).at[TUMBLE, 3:6].set(jnp.asarray([20.0, 4.0, 20.0]))
    share = float(plant.weight[0] / 4 - rotors.min_thrust) / (rotors.max_thrust - rotors.min_thrust)
    each = jnp.asarray([2 * share - 1, 5.0, -5.0])  # beyond the limits: clipped
    action = jnp.broadcast_to(each[:, None, None], (3, 2, 4))

    def advance(state, _):
        state = jax.vmap(step)(state[0], state[1], state[2], jnp.zeros(3, jnp.int32), action)
        return state, state[:2]

    path = jax.jit(lambda state: jax.lax.scan(advance, state, None, STEPS)[1])((qpos, qvel, craft))
    return np.asarray(path[0]), np.asarray(path[1])


@pytest.mark.parametrize("body", PUBLISHED)
def test_hover_step_and_tumble(body: str):
    ratio, top = PUBLISHED[body]
    assert thrust_to_weight(body) == pytest.approx(ratio, rel=1e-4)
    qpos, qvel = fly(body)
    np.testing.assert_allclose(qpos[:, HOVER], np.tile(qpos[0, HOVER], (STEPS, 1)), atol=1e-3)
    # v' = v + h (T/m - g - d v' / m) from rest: top (1 - (1 + h d / m)^-n)
    sim = SimConfig(body=body)
    mass, drag = load_scene(sim).mass[0], ROTORS[body].drag[2]
    n = 2 * np.arange(1, STEPS + 1)
    exact = top * (1 - (1 + sim.timestep * drag / mass) ** -n.astype(float))
    np.testing.assert_allclose(qvel[:, FULL, 2], exact, rtol=1e-3)
    np.testing.assert_allclose(qvel[0, FULL, 2], 0.02 * (ratio - 1) * 9.81, rtol=0.03)
    energy = 0.5 * np.sum(load_scene(sim).inertia[0] * qvel[:, TUMBLE, 3:6] ** 2, axis=-1)
    assert np.all(energy[1:] <= energy[:-1] * (1 + 1e-5)) and energy[-1] > 0.3 * energy[0]


def test_a_card_holds_every_number():
    numbers = described(ROTORS["brushless"])
    assert numbers["rotors.lag_up"] == 0.0608 and numbers["rotors.max_thrust"] == 0.2
    assert numbers["rotors.drag"] == [0.0215, 0.0215, 0.0236]
    assert len(numbers) == len(ROTORS["brushless"].__dataclass_fields__) - 1  # an X has no layout

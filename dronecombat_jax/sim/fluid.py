"""Drag of a drone in a fluid: MuJoCo's inertia-box model.

Source: MuJoCo's documentation, "Fluid forces, inertia model": a drone is the box that has its mass
and inertia. What does not live here: which fluid (`flown`), and how drag enters a step (`flight`).
Only a scene with a density or a viscosity has drag; the package's own has neither.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.sim.flown import Body, Flown


class Drag(NamedTuple):
    """Drag of one kind of motion: -(viscous + quadratic |u|) u along each principal axis."""

    viscous: jax.Array  # [A, 3] N s/m, or N m s/rad
    quadratic: jax.Array  # [A, 3] N s^2/m^2, or N m s^2/rad^2

    def resist(self, velocity: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Force (or torque), and its loss per unit of velocity, at `velocity`; each [A, 3]."""
        speed = jnp.abs(velocity)
        drag = -(self.viscous + self.quadratic * speed) * velocity
        return drag, self.viscous + 2.0 * self.quadratic * speed


def drags(flown: Flown) -> tuple[Drag, Drag]:
    """Linear and angular drag of both drones, about their principal axes."""
    of_bodies = [_of_box(box(body), flown) for body in flown.bodies]
    linear, angular = np.moveaxis(np.array(of_bodies), 0, 2).astype(np.float32)
    return Drag(*map(jnp.asarray, linear)), Drag(*map(jnp.asarray, angular))


def box(body: Body) -> np.ndarray:
    """Edges [3] in m of the homogeneous box with this mass and inertia."""
    inertia = np.asarray(body.inertia)
    return np.sqrt(6.0 * np.maximum(inertia.sum() - 2.0 * inertia, 1e-12) / body.mass)


def _of_box(edges: np.ndarray, flown: Flown) -> np.ndarray:
    """[2, 2, 3]: linear and angular, each viscous (a sphere, Stokes) and quadratic (faces)."""
    density, viscosity = flown.density, flown.viscosity
    diameter, (x, y, z) = edges.mean(), edges
    faces = np.array([y * z, x * z, x * y])
    spins = np.array([x * (y**4 + z**4), y * (x**4 + z**4), z * (x**4 + y**4)])
    linear = np.full(3, 3.0 * np.pi * diameter * viscosity), 0.5 * density * faces
    angular = np.full(3, np.pi * diameter**3 * viscosity), density * spins / 64.0
    return np.array([linear, angular])

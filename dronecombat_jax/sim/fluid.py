"""Drag of a drone in a fluid: MuJoCo's inertia-box model, as C MuJoCo's `implicit` integrator has it.

Source: MuJoCo's documentation, "Fluid forces, inertia model": the drone is taken for the box of its mass and inertia.
What does not live here: which fluid (`flown`), thrust and gyroscopic torque (`flight`). Only scenes with a density or
a viscosity use it; the package's own has none.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.sim.flown import Body, Flown


class Drag(NamedTuple):
    """Of one kind of motion: -(viscous + quadratic |u|) u along each principal axis."""

    viscous: jax.Array  # [A, 3] N s/m, or N m s/rad
    quadratic: jax.Array  # [A, 3] N s^2/m^2, or N m s^2/rad^2

    def resist(self, velocity: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Force (or torque) and what it loses per unit of velocity, each [A, 3], at `velocity` [A, 3]."""
        speed = jnp.abs(velocity)
        return -(
            self.viscous + self.quadratic * speed
        ) * velocity, self.viscous + 2.0 * self.quadratic * speed


def drags(flown: Flown) -> tuple[Drag, Drag]:
    """Linear and angular drag of both drones, about their principal axes."""
    linear, angular = zip(*(_of_box(box(body), flown) for body in flown.bodies), strict=True)
    stacked = lambda parts: Drag(
        *(jnp.asarray(np.stack(part), jnp.float32) for part in zip(*parts, strict=True))
    )
    return stacked(linear), stacked(angular)


def box(body: Body) -> np.ndarray:
    """Edges [3] in m of the homogeneous box with this mass and inertia."""
    inertia = np.asarray(body.inertia)
    return np.sqrt(6.0 * np.maximum(inertia.sum() - 2.0 * inertia, 1e-12) / body.mass)


def _of_box(
    edges: np.ndarray, flown: Flown
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """(viscous, quadratic) for linear and for angular motion: Stokes' law for a sphere, and pressure on the faces."""
    density, viscosity = flown.density, flown.viscosity
    diameter, (x, y, z) = edges.mean(), edges
    faces = np.array([y * z, x * z, x * y])
    spins = np.array([x * (y**4 + z**4), y * (x**4 + z**4), z * (x**4 + y**4)])
    linear = np.full(3, 3.0 * np.pi * diameter * viscosity), 0.5 * density * faces
    angular = np.full(3, np.pi * diameter**3 * viscosity), density * spins / 64.0
    return linear, angular

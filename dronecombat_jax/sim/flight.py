"""Flight: wrench, gyroscopic correction and physics substeps of both drones in MJX.

What does not live here: the MJCF and its indices (`scene`), one timestep (`physics`), the rules of
the game (`combat`).
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from dronecombat_jax.config.fields import SimConfig
from dronecombat_jax.sim.fluid import Drag, drags
from dronecombat_jax.sim.physics import build_physics
from dronecombat_jax.sim.rotation import body_z, rotate, rotate_inverse
from dronecombat_jax.sim.scene import Scene
from dronecombat_jax.types import Drones

Rotate = Callable[[jax.Array], jax.Array]
Turn = Callable[[jax.Array, jax.Array], jax.Array]
Push = Callable[[Drones, jax.Array], jax.Array]
Step = Callable[[jax.Array, jax.Array, jax.Array], tuple[jax.Array, jax.Array]]


def build_step(sim: SimConfig, scene: Scene) -> Step:
    """Return `step(qpos [14], qvel [12], action [A, 4]) -> (qpos, qvel)`, one control step of one
    scene.

    The constants of the scene and the choices of `sim` are bound here, once. The action is
    clipped to [-1, 1]; vmap over environments is the caller's.
    """
    advance = build_physics(scene)
    weight = jnp.asarray(scene.weight, jnp.float32)
    full_thrust = sim.thrust_to_weight * weight
    in_fluid = drags(scene.flown) if scene.flown.in_fluid else None
    push, turn = _pushing(sim, scene, in_fluid), build_turn(sim, scene)

    def substep(qpos: jax.Array, qvel: jax.Array, thrust: jax.Array, moment: jax.Array):
        drones = split(qpos, qvel)
        torque = turn(drones.rate, moment)
        force = push(drones, thrust[:, None] * body_z(drones.quaternion))
        applied = jnp.concatenate([force, torque], axis=-1).reshape(-1)
        qpos, qvel = advance(qpos, qvel, applied)
        return qpos, limit_rate(qvel, sim.max_body_rate)

    def step(qpos: jax.Array, qvel: jax.Array, action: jax.Array) -> tuple[jax.Array, jax.Array]:
        thrust, moment = wrench(action, full_thrust, sim.moment_scale)
        again = lambda state, _: (substep(state[0], state[1], thrust, moment), None)
        # no loop, but traced once
        state, _ = jax.lax.scan(again, (qpos, qvel), length=sim.substeps, unroll=True)
        return state

    return step


def build_turn(sim: SimConfig, scene: Scene) -> Turn:
    """Return `turn(rate [A, 3], moment [A, 3])`: the torque [A, 3] to apply, in the bodies' frames.

    The integrator adds MuJoCo's explicit gyroscopic torque; here come drag and what makes both
    implicit.
    """
    in_fluid = drags(scene.flown) if scene.flown.in_fluid else None
    inertia = jnp.asarray(scene.inertia, jnp.float32)
    inwards, outwards = principal_axes(scene)
    implicit = sim.gyroscopic == "implicit"

    def turn(rate: jax.Array, moment: jax.Array) -> jax.Array:
        rate, torque, damping = inwards(rate), inwards(moment), None
        if in_fluid is not None:
            drag, damping = in_fluid[1].resist(rate)
            torque = torque + drag
        if implicit:
            torque = torque + gyroscopic_correction(rate, torque, inertia, sim.timestep, damping)
        return outwards(torque)

    return turn


def _pushing(sim: SimConfig, scene: Scene, in_fluid: tuple[Drag, Drag] | None) -> Push:
    """`push(drones, force [A, 3])`: the force [A, 3] to apply, drag included; world frame.

    Drag is implicit: (m + h d) a = f, with the sum f of all forces and the slope d of the drag. The
    integrator has m a = f, so that drag is to be less by h d a.
    """
    if in_fluid is None:
        return lambda drones, force: force
    mass = jnp.asarray(scene.mass, jnp.float32)[:, None]
    weight = mass * jnp.asarray([0.0, 0.0, -scene.flown.gravity])
    wind = jnp.asarray(scene.flown.wind)
    inwards, outwards = principal_axes(scene)

    def push(drones: Drones, force: jax.Array) -> jax.Array:
        into = lambda vector: inwards(rotate_inverse(drones.quaternion, vector))
        drag, slope = in_fluid[0].resist(into(drones.velocity - wind))
        lost = sim.timestep * slope
        drag = drag - lost / (mass + lost) * (into(force + weight) + drag)
        return force + rotate(drones.quaternion, outwards(drag))

    return push


def principal_axes(scene: Scene, role: int | None = None) -> tuple[Rotate, Rotate]:
    """Rotations from the bodies' frames to their principal axes, and back.

    Of vectors [A, 3], or [..., 3] of the drone `role`. Where the axes are the bodies' own, as in
    the package's scene, both leave a vector alone.
    """
    if scene.axes is None:
        return (lambda vector: vector), (lambda vector: vector)
    axes = jnp.asarray(scene.axes if role is None else scene.axes[role], jnp.float32)
    back = jnp.swapaxes(axes, -1, -2)
    times = lambda matrix: lambda vector: jnp.sum(matrix * vector[..., None, :], axis=-1)
    return times(back), times(axes)


def split(qpos: jax.Array, qvel: jax.Array) -> Drones:
    """Split free-joint coordinates `qpos [..., 7 A]`, `qvel [..., 6 A]` into the drones' states."""
    pose = qpos.reshape(*qpos.shape[:-1], -1, 7)
    twist = qvel.reshape(*qvel.shape[:-1], -1, 6)
    return Drones(pose[..., :3], pose[..., 3:], twist[..., :3], twist[..., 3:])


def wrench(
    action: jax.Array, full_thrust: jax.Array, moment_scale: float
) -> tuple[jax.Array, jax.Array]:
    """Thrust [A] in N along body z and moment [A, 3] in N m about body axes of `action` [A, 4].

    Equations 7 and 8.
    """
    action = jnp.clip(action, -1.0, 1.0)
    return full_thrust * (action[:, 0] + 1.0) / 2.0, moment_scale * action[:, 1:]


def hover_command(thrust_to_weight: float) -> float:
    """The first action at which thrust equals weight."""
    return 2.0 / thrust_to_weight - 1.0


def gyroscopic_correction(
    rate: jax.Array,
    moment: jax.Array,
    inertia: jax.Array,
    timestep: float,
    damping: jax.Array | None = None,
) -> jax.Array:
    """Torque [A, 3] in N m that turns an explicit gyroscopic term into a backward-Euler one.

    With f = w x (I w), applied moment m and one Newton step on the implicit equation,
    J = I + h([w]x I - [I w]x), w' = w + J^-1 h (m - f); the integrator itself applies m - f, so the
    correction is I (w' - w) / h + f - m. The moment belongs inside: left out, flights under
    saturated moments part from C MuJoCo's `implicit` integrator by radians per second.
    Without a moment it never gains energy (Catto, "Numerical Methods", GDC 2015).
    `rate`, `moment` [A, 3] along the principal axes, `inertia` [A, 3] about them; `damping` [A, 3]
    N m s/rad: what the moment loses per rad/s, a part of J.
    """
    momentum = inertia * rate
    explicit = moment - jnp.cross(rate, momentum)
    jacobian = timestep * (skew(rate) * inertia[..., None, :] - skew(momentum))
    diagonal = inertia if damping is None else inertia + timestep * damping
    jacobian = jacobian + diagonal[..., None, :] * jnp.eye(3, dtype=rate.dtype)
    return inertia * solve_3x3(jacobian, explicit) - explicit


def skew(v: jax.Array) -> jax.Array:
    """Cross-product matrix [..., 3, 3] of `v` [..., 3]: skew(v) @ u = v x u."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    zero = jnp.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


def solve_3x3(matrix: jax.Array, vector: jax.Array) -> jax.Array:
    """Solve `matrix [..., 3, 3] x = vector [..., 3]` by Cramer's rule; cheap under vmap on every
    device.
    """
    a, b, c = matrix[..., 0], matrix[..., 1], matrix[..., 2]
    bc, ca, ab = jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)
    determinant = jnp.sum(a * bc, axis=-1)
    numerators = [jnp.sum(vector * cofactor, axis=-1) for cofactor in (bc, ca, ab)]
    return jnp.stack(numerators, axis=-1) / determinant[..., None]


def limit_rate(qvel: jax.Array, max_rate: float) -> jax.Array:
    """Scale each drone's body rate in `qvel` [6 A] down to `max_rate` rad/s, as PhysX caps it."""
    twist = qvel.reshape(-1, 6)
    norm = jnp.linalg.norm(twist[:, 3:], axis=-1, keepdims=True)
    rate = twist[:, 3:] * jnp.minimum(1.0, max_rate / jnp.maximum(norm, 1e-6))
    return jnp.concatenate([twist[:, :3], rate], axis=-1).reshape(-1)

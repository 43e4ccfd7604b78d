"""Stepping without policies: the environment, its physics alone, and what plain MJX would do.

Two physics steps are one environment step, as everywhere.
"""

import copy
from typing import Any

from benchmarks.size import Size
from benchmarks.worker import Part, peak_mib


def stepping(size: Size, per_core: bool) -> Part:
    """The three programs with `num_envs` environments, as one program on all cores or, `per_core`,
    on a device each.
    """
    from dronecombat_jax.machine import backend

    devices = backend.cores() if per_core else 1
    backend.prepare(size.device, devices)
    import jax

    from benchmarks.compiling import add, place, spread
    from dronecombat_jax.combat.env import Combat

    mesh = (
        jax.make_mesh((devices,), ("devices",), (jax.sharding.AxisType.Auto,))
        if devices > 1
        else None
    )
    combat = Combat(size.config())
    part = Part(
        facts={"devices": devices, "kind": jax.devices()[0].device_kind, "num_envs": size.num_envs}
    )
    work = devices * size.num_envs * size.flown_steps
    keys = place(jax.random.split(jax.random.key(0), devices), mesh)
    for name, build in (
        ("environment", environment),
        ("physics", physics),
        ("plain data", plain_data),
    ):
        add(part, name, work, spread(build(combat, size), mesh), keys)
        part.programs[-1].call()
        part.peak_mib = part.peak_mib or peak_mib()
    return part


def environment(combat: Any, size: Size) -> Any:
    """`fly(key)`: random actions and automatic reset, as in training; rules, rewards and
    observations are computed.
    """
    import jax
    import jax.numpy as jnp

    shape = (size.flown_steps, size.num_envs)

    def fly(key: jax.Array) -> tuple[Any, jax.Array]:
        first, actions, spawns = jax.random.split(key, 3)

        def step(env: Any, random: tuple[jax.Array, jax.Array]) -> tuple[Any, jax.Array]:
            action, numbers = random
            after, output = jax.vmap(combat.step)(env, action)
            done = output.terminated | output.truncated
            choose = lambda new, old: jnp.where(done.reshape(-1, *[1] * (new.ndim - 1)), new, old)
            following = jax.tree.map(choose, jax.vmap(combat.spawn)(numbers), after)
            return following, output.reward.sum() + output.observation.sum()

        start = jax.vmap(combat.spawn)(combat.start_numbers(first, shape[1:]))
        action = jax.random.uniform(
            actions, (*shape, len(combat.sides), 4), minval=-1.0, maxval=1.0
        )
        return jax.lax.scan(step, start, (action, combat.start_numbers(spawns, shape)))

    return fly


def physics(combat: Any, size: Size) -> Any:
    """`fly(key)`: the substeps alone, on the lean model; positions and velocities are all that is
    carried.
    """
    import jax

    from dronecombat_jax.sim.flight import build_step

    fly_one = build_step(combat.config.sim, combat.scene)

    def fly(key: jax.Array) -> tuple[jax.Array, jax.Array]:
        start = jax.vmap(combat.spawn)(combat.start_numbers(key, (size.num_envs,)))
        step = lambda carry, action: (jax.vmap(fly_one)(carry[0], carry[1], action), None)
        return jax.lax.scan(step, (start.qpos, start.qvel), gentle(combat, size, key))[0]

    return fly


def plain_data(combat: Any, size: Size) -> Any:
    """`fly(key)`: the full model with its actuators, and all of `mjx.Data` carried, as MJX's
    tutorial does.
    """
    import jax
    import jax.numpy as jnp
    import mujoco

    from dronecombat_jax.machine.backend import import_mjx

    mjx, scene, sim = import_mjx(), combat.scene, combat.config.sim
    full = copy.copy(scene.full)
    full.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER  # the file's own is for C MuJoCo alone
    model, data = mjx.put_model(full), mjx.make_data(full)
    columns = jnp.asarray(scene.controls)

    def fly(key: jax.Array) -> Any:
        start = jax.vmap(combat.spawn)(combat.start_numbers(key, (size.num_envs,)))
        action = gentle(combat, size, key)
        full_thrust = sim.thrust_to_weight * jnp.asarray(scene.weight, jnp.float32)
        thrust = full_thrust * (action[..., :1].squeeze(-1) + 1.0) / 2.0
        wrench = jnp.concatenate([thrust[..., None], sim.moment_scale * action[..., 1:]], axis=-1)
        control = jnp.zeros((*wrench.shape[:2], scene.full.nu)).at[..., columns].set(wrench)

        def step(data: Any, control: jax.Array) -> tuple[Any, None]:
            data = jax.vmap(lambda state, ctrl: state.replace(ctrl=ctrl))(data, control)
            for _ in range(sim.substeps):
                data = jax.vmap(mjx.step, in_axes=(None, 0))(model, data)
            return data, None

        many = jax.vmap(lambda qpos, qvel: data.replace(qpos=qpos, qvel=qvel))(
            start.qpos, start.qvel
        )
        return jax.lax.scan(step, many, control)[0]

    return fly


def gentle(combat: Any, size: Size, key: Any) -> Any:
    """Actions [T, N, A, 4] near hover: nobody tumbles, since the plain model's explicit gyroscopic
    term would diverge.
    """
    import jax

    from dronecombat_jax.sim.flight import hover_command

    hover = hover_command(combat.config.sim.thrust_to_weight)
    noise = 1e-3 * jax.random.normal(key, (size.flown_steps, size.num_envs, len(combat.sides), 4))
    return noise.at[..., 0].add(hover)

"""The duel in MJX as it is first written: the full scene, its site motors, and the whole `mjx.Data`
as state.

Rules, observation and reward are ours (`combat`), so that the game is the same; what differs is
what is stepped and carried. Every step draws a new start beside the flown state and chooses leaf by
leaf, as gymnax environments do.
"""

import copy
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
from flax import struct

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.observe import observe_world
from dronecombat_jax.combat.reward import reward_terms, total
from dronecombat_jax.combat.rules import detect, judge
from dronecombat_jax.machine.backend import import_mjx
from dronecombat_jax.sim.flight import gyroscopic_correction, limit_rate, split
from dronecombat_jax.types import Cause


class FullState(struct.PyTreeNode):
    """One fight."""

    data: Any  # mjx.Data of the full scene
    target: jax.Array  # [3] m
    clock: jax.Array  # [] int32


class FullCombat:
    """`reset` and `step` of one fight, under `jax.vmap`; the game of `combat`'s default settings."""

    def __init__(self, combat: Combat):
        self._combat, self._mjx = combat, import_mjx()
        model = copy.copy(combat.scene.full)
        # MJX has no `implicit`, with which this body does not diverge; hence Euler and our
        # gyroscopic torque.
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        self._low, self._high = jnp.asarray(model.actuator_ctrlrange.T, jnp.float32)
        self._inertia = jnp.asarray(combat.scene.inertia, jnp.float32)
        self._model, self._template = self._mjx.put_model(model), self._mjx.make_data(model)

    def reset(self, key: jax.Array) -> tuple[jax.Array, FullState]:
        """Observation [35] and state of a fight about to start."""
        start = self._combat.reset(key)
        data = self._template.replace(qpos=start.qpos, qvel=start.qvel)
        state = FullState(data, start.target, start.clock)
        return self._observe(state), state

    def step(
        self, key: jax.Array, state: FullState, action: jax.Array
    ) -> tuple[jax.Array, FullState, jax.Array, jax.Array]:
        """One control step with `action` [A, 4]: observation [35], state, reward [A] and done [].

        Where the fight ended, observation and state are those of a new one.
        """
        flown, reward, cause = self.fly(state, action)
        done = cause != Cause.NONE
        fresh_observation, fresh = self.reset(key)
        state = jax.tree.map(lambda new, old: jnp.where(done, new, old), fresh, flown)
        return jnp.where(done, fresh_observation, self._observe(flown)), state, reward, done

    def fly(self, state: FullState, action: jax.Array) -> tuple[FullState, jax.Array, jax.Array]:
        """One control step without reset: state, reward [A], cause []."""
        combat, sim = self._combat, self._combat.config.sim
        before = split(state.data.qpos, state.data.qvel)
        ctrl = self._low + 0.5 * (jnp.clip(action, -1.0, 1.0).reshape(-1) + 1.0) * (
            self._high - self._low
        )
        data = state.data.replace(ctrl=ctrl)
        moment = ctrl.reshape(2, 4)[:, 1:]
        for _ in range(sim.substeps):
            rate = split(data.qpos, data.qvel).rate
            torque = gyroscopic_correction(rate, moment, self._inertia, sim.timestep)
            applied = jnp.zeros((2, 6)).at[:, 3:].set(torque).reshape(-1)
            data = self._mjx.step(self._model, data.replace(qfrc_applied=applied))
            data = data.replace(qvel=limit_rate(data.qvel, sim.max_body_rate))
        drones, clock, down = split(data.qpos, data.qvel), state.clock + 1, jnp.zeros(2, bool)
        game = combat.config.game
        events = detect(game, before.position, drones.position, state.target, down, clock)
        cause = judge(game, events)
        reward = total(reward_terms(combat.config, drones, state.target, events, down, cause))
        return FullState(data, state.target, clock), reward, cause

    def _observe(self, state: FullState) -> jax.Array:
        return observe_world(split(state.data.qpos, state.data.qvel), state.target)[0]

"""The environment: `reset` and `step` of one fight over MJX, to be used under `jax.vmap`.

Rules, observation and reward live beside it as plain array functions; learning lives in `learn`.
"""

from functools import cached_property

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.games import game_of
from dronecombat_jax.combat.observe import observation_of, refuse_unfit, whole_of
from dronecombat_jax.combat.reward import total
from dronecombat_jax.combat.rules import detect, forfeit, struck_out, timeout_decides
from dronecombat_jax.combat.sensors import first_memory, refuse_unlimited, remembered, see
from dronecombat_jax.combat.starts import start_anywhere, start_positions
from dronecombat_jax.config.fields import Config
from dronecombat_jax.config.sides import DUEL, spelt
from dronecombat_jax.errors import UserError
from dronecombat_jax.machine import jax_variables
from dronecombat_jax.sim.craft import (
    CraftStep,
    build_craft_step,
    num_random,
    spawn_craft,
)
from dronecombat_jax.sim.flight import Step, build_step, split
from dronecombat_jax.sim.scene import Scene, load_scene
from dronecombat_jax.types import DEFENDER, Cause, EnvState, StepOutput

# A body state beyond this is a diverged simulation: no drone gets there in one episode.
MAX_COORDINATE = 1e4


class Combat:
    """One fight between drones of two sides. Holds the scene and the settings; every method is pure.

    `reset` and `step` act on one environment; use `jax.vmap` for many and `jax.jit` around it.
    """

    def __init__(self, config: Config, scene: Scene | None = None):
        jax_variables.require_float32()
        self.config = config
        self.sides = config.game.sides  # of each drone
        self.scene = scene or load_scene(config.sim, sides=self.sides)
        if self.scene.sides != self.sides:
            there, here = spelt(self.scene.sides), spelt(self.sides)
            raise UserError(f"the scene is made for {there} drones, and the game for {here}")
        self.game = game_of(config)
        self.observation = observation_of(config)
        refuse_unlimited(config, self.observation)
        refuse_unfit(config, self.observation)
        self.whole = whole_of(config)

    @property
    def absent(self) -> jax.Array:
        """Who stands still at its start and takes no part, [A] bool."""
        return self.game.absent(self.sides)

    @property
    def _position_numbers(self) -> int:
        """How many numbers the positions of all drones and of the target take."""
        return 3 * (len(self.sides) + 1)

    @cached_property
    def _fly(self) -> Step:
        """One control step in MJX: made when it is first flown, since to import MJX and to load the
        model take a second.
        """
        with jax.ensure_compile_time_eval():
            # constants, also where that is inside a traced function
            return build_step(self.config.sim, self.scene)

    @cached_property
    def _fly_craft(self) -> CraftStep:
        """The same for drones that are more than ideal rigid bodies (`sim.craft`)."""
        with jax.ensure_compile_time_eval():
            return build_craft_step(self.config.sim, self.scene)

    def start_numbers(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """Uniform numbers `[*shape, 9]` in [0, 1), enough to `spawn` that many fights.

        More where the drones' numbers are random, too (`sim.craft.num_random`); the positions are
        the same with and without.
        """
        return self._numbers(key, shape, self._position_numbers)

    def draw(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """`start_numbers` by its name in version 0.1.0."""
        return self.start_numbers(key, shape)

    def exploring_numbers(self, key: jax.Array, shape: tuple[int, ...]) -> jax.Array:
        """The same for `explore`: 2 more for each drone at the end where drones start moving, then 1
        and 6 more for each drone where some start anywhere, then 1 where some start at rest.
        """
        train, drones = self.config.train, len(self.sides)
        moving = (train.start_speed > 0.0) * 2 * drones
        anywhere = (train.start_anywhere > 0.0) * (1 + 6 * drones)
        at_rest = (train.start_at_rest > 0.0) * 1
        return self._numbers(key, shape, self._position_numbers + moving + anywhere + at_rest)

    def spawn(self, numbers: jax.Array) -> EnvState:
        """A fight about to start, from the `numbers` [K] that `start_numbers` gives for it.

        In `solo` the attacker flies alone; the defender stands still at its start and takes no
        part.
        """
        craft = spawn_craft(self.config, self.scene, numbers[self._position_numbers :])
        if craft is not None:
            numbers = numbers[: self._position_numbers]
        positions = start_positions(self.config.game, numbers.reshape(-1, 3))
        level = jnp.asarray([1.0, 0.0, 0.0, 0.0])
        drones = len(self.sides)
        pose = jnp.concatenate([positions[:drones], jnp.broadcast_to(level, (drones, 4))], axis=-1)
        state = EnvState(
            qpos=pose.reshape(-1),
            qvel=jnp.zeros(6 * drones),
            target=positions[drones],
            clock=jnp.zeros((), jnp.int32),
            down=self.absent,
            craft=craft,
            struck=None if self.sides == DUEL else jnp.zeros(drones, bool),
        )
        return first_memory(self.config.sensor, state)

    def explore(self, numbers: jax.Array, alone: jax.Array) -> EnvState:
        """A fight about to start in training, from the `numbers` of `exploring_numbers`; `alone` []
        bool: the defender is absent.

        Up to `train.start_speed` m/s along x and along y, each drone already moves, and in a share
        `train.start_anywhere` of the fights it starts anywhere, moving in any direction: exploring
        starts (Sutton and Barto, section 5.3). The fights that count, in evaluations and
        tournaments, `spawn` at rest; a share `train.start_at_rest` of these here does, too.
        """
        spawning = self._position_numbers + num_random(self.config)
        train, drones = self.config.train, len(self.sides)
        state = self.spawn(numbers[:spawning])
        defends = jnp.asarray([side == DEFENDER for side in self.sides])
        state = state.replace(down=state.down | (alone & defends))
        if not (train.start_speed or train.start_anywhere):
            return state
        pose, twist = state.qpos.reshape(-1, 7), state.qvel.reshape(-1, 6)
        stays, more = state.down[:, None], numbers[spawning:]
        if train.start_speed:
            over_ground = train.start_speed * (2.0 * more[: 2 * drones].reshape(-1, 2) - 1.0)
            twist = twist.at[:, :2].set(jnp.where(stays, 0.0, over_ground))
            more = more[2 * drones :]
        if train.start_anywhere:
            position, velocity = start_anywhere(
                train.start_speed, more[1 : 1 + 6 * drones].reshape(-1, 6)
            )
            here = (more[0] < train.start_anywhere) & ~stays
            pose = pose.at[:, :3].set(jnp.where(here, position, pose[:, :3]))
            twist = twist.at[:, :3].set(jnp.where(here, velocity, twist[:, :3]))
        if train.start_at_rest:
            as_spawned = numbers[-1] < train.start_at_rest
            pose = jnp.where(as_spawned, state.qpos.reshape(-1, 7), pose)
            twist = jnp.where(as_spawned, 0.0, twist)
        state = state.replace(qpos=pose.reshape(-1), qvel=twist.reshape(-1))
        return first_memory(self.config.sensor, state)

    def reset(self, key: jax.Array) -> EnvState:
        """A fight about to start, at random by `key`."""
        return self.spawn(self.start_numbers(key, ()))

    def _numbers(self, key: jax.Array, shape: tuple[int, ...], count: int) -> jax.Array:
        """Uniform numbers `[*shape, count]`, with those of the drones after the positions."""
        numbers = jax.random.uniform(key, (*shape, count))
        if more := num_random(self.config):
            others = jax.random.uniform(jax.random.fold_in(key, 1), (*shape, more))
            first = self._position_numbers
            parts = numbers[..., :first], others, numbers[..., first:]
            numbers = jnp.concatenate(parts, axis=-1)
        return numbers

    def observe(self, state: EnvState) -> jax.Array:
        """Observation [A, 35] of the state (eq. 5), as the sensors give it."""
        return see(self.config, self.observation, state)

    def observe_whole(self, state: EnvState) -> jax.Array:
        """What a central critic sees [A, 37]: the state itself, without errors of sensors."""
        return self.whole.observe(split(state.qpos, state.qvel), state.target)

    def step(
        self, state: EnvState, action: jax.Array, margin: jax.Array | float = 0.0
    ) -> tuple[EnvState, StepOutput]:
        """Fly one control step with `action` [A, 4]. Does not reset: a fight that ended must be
        replaced. `margin` [] m is added to the intercept radius (`train.strike_margin`).

        A state that is not finite ends this fight alone, as a tie with reward 0 (cause DIVERGED),
        at rest where it last was: its final observation is finite and cannot spoil a running mean.
        A drone that still flies and whose action is not finite loses the fight (cause .._INVALID),
        with reward 0 for both: it flies on 0 in place of what was not finite. Finite actions are
        clipped.
        """
        game = self.config.game
        before = split(state.qpos, state.qvel)
        invalid = ~jnp.all(jnp.isfinite(action), axis=-1) & ~state.down
        given = jnp.where(jnp.isfinite(action), action, 0.0)
        if state.craft is None:
            (qpos, qvel), craft = self._fly(state.qpos, state.qvel, given), None
        else:
            qpos, qvel, craft = self._fly_craft(
                state.qpos, state.qvel, state.craft, state.clock, given
            )
        sane = _sane(qpos) & _sane(qvel)
        qpos = jnp.where(sane & ~jnp.repeat(state.down, 7), qpos, _tame(state.qpos))
        qvel = jnp.where(sane & ~jnp.repeat(state.down, 6), qvel, 0.0)
        drones = split(qpos, qvel)
        clock = state.clock + 1

        places = before.position, drones.position, state.target
        events = detect(game, *places, state.down, clock, margin)
        lost = forfeit(invalid, self.sides)
        cause = jnp.where(jnp.any(invalid), lost, self.game.judge(game, events))
        diverged: jax.Array = jnp.int32(Cause.DIVERGED)
        cause = jnp.where(sane, cause, diverged)
        terms = self.game.reward(self.config, drones, state.target, events, state.down, cause)
        terms = jax.tree.map(lambda term: jnp.where(sane & ~jnp.any(invalid), term, 0.0), terms)

        # A drone that goes down stays where it is, at rest.
        down, struck = events.down, state.struck
        if struck is not None:  # in a duel a strike ends the fight
            struck = struck | (sane & struck_out(game, events) & ~events.down)
            down = down | struck
        down = jnp.where(sane, down, state.down)
        at_rest = jnp.where(jnp.repeat(down, 6), 0.0, qvel)
        after = state.replace(
            qpos=qpos, qvel=at_rest, clock=clock, down=down, craft=craft, struck=struck
        )
        after = remembered(self.config.sensor, after)
        truncated = (cause == Cause.TIMEOUT) & (not timeout_decides(game))
        output = StepOutput(
            observation=self.observe(after),
            reward=total(terms),
            reward_terms=terms,
            cause=cause,
            terminated=(cause != Cause.NONE) & ~truncated,
            truncated=truncated,
            active=sane & ~state.down & ~invalid,
            idle=sane & state.down,
        )
        return after, output


def _sane(values: jax.Array) -> jax.Array:
    """Whether all values are finite and within reach; NaN compares false."""
    return jnp.all(jnp.abs(values) < MAX_COORDINATE)


def _tame(qpos: jax.Array) -> jax.Array:
    """The values where they are sane, 0 elsewhere; this changes only a state that was broken from
    outside.
    """
    return jnp.where(jnp.abs(qpos) < MAX_COORDINATE, qpos, 0.0)

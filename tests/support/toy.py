"""A training program at toy size, and the comparison of states bit for bit; shared by the tests.

The drones coast here instead of being stepped by MJX, and the programs are compiled without
optimisation: both take most of the time of compiling, and neither is what is tested.
"""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.config.fields import Config, GameConfig, LearnConfig, TrainConfig
from dronecombat_jax.selfplay.chunk import build_advance, init_state
from dronecombat_jax.selfplay.opponents import Cast
from dronecombat_jax.types import TrainState

UNOPTIMISED = {"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True}
CHUNK = 2  # iterations
CONFIG = Config(
    game=GameConfig(episode_steps=20),
    learn=LearnConfig(
        hidden_sizes=(8, 8), rollout_steps=6, epochs=2, minibatches=2, minibatch_order="shuffled"
    ),
    # One chunk of head start, in which the attacker alone learns.
    train=TrainConfig(
        num_envs=8, chunk_iterations=CHUNK, head_start_steps=90, total_steps=400, seed=4
    ),
)


class Coasting(Combat):
    """The game without physics: each action pushes its drone, which a light gravity pulls down."""

    def __init__(self, config: Config):
        super().__init__(config)
        self._fly = self._coast

    def _coast(
        self, qpos: jax.Array, qvel: jax.Array, action: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        push = (
            jnp.concatenate([action[:, 1:], action[:, 1:]], axis=1).at[:, 2].set(action[:, 0] - 0.5)
        )
        qvel = qvel + push.reshape(-1)
        position = qpos.reshape(-1, 7).at[:, :3].add(0.05 * qvel.reshape(-1, 6)[:, :3])
        return position.reshape(-1), qvel


def build(config: Config, iterations: int, cast: Cast | None = None) -> SimpleNamespace:
    """The program, how often it was traced, and the state it starts from."""
    combat, traces = Coasting(config), []
    advance = build_advance(combat, iterations, cast=cast or {})

    def counted(state: TrainState):
        traces.append(1)
        return advance(state)

    program = jax.jit(counted, compiler_options=UNOPTIMISED)
    start = jax.jit(lambda: init_state(combat), compiler_options=UNOPTIMISED)
    with jax.debug_key_reuse(True):
        return SimpleNamespace(
            run=_checked(program),
            start=jax.device_get(start()),
            traces=traces,
            combat=combat,
            advance=advance,
        )


def two_chunks(config: Config) -> SimpleNamespace:
    """The program of `build`, one iteration a call, the states before and after each iteration of two
    chunks, and what each reported, NumPy leaves.
    """
    program = build(config, 1)
    states, reports = [program.start], []
    for _ in range(2 * CHUNK):
        state, report = program.run(states[-1])
        states.append(state)
        reports.append(jax.device_get(report))
    return SimpleNamespace(program=program, states=states, reports=reports)


def _checked(program):
    """Every call under the check that no random key is used twice; NumPy leaves, of which a test can
    pick without a program for each pick.
    """

    def run(state: TrainState):
        with jax.debug_key_reuse(True):
            return jax.device_get(program(state))

    return run


def assert_same_bits(a, b) -> None:
    for (path, x), y in zip(
        jax.tree_util.tree_leaves_with_path(a), jax.tree.leaves(b), strict=True
    ):
        assert np.asarray(x).tobytes() == np.asarray(y).tobytes(), jax.tree_util.keystr(path)


def differs(a, b) -> bool:
    pairs = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    return any(np.asarray(x).tobytes() != np.asarray(y).tobytes() for x, y in pairs)


def agent(state: TrainState, index: int):
    return jax.tree.map(lambda leaf: leaf[:, index], state.learners)

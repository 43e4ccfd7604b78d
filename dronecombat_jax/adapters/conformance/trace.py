"""What the checker sees of an environment of any library: N fights of A agents, step by step.

Here: the record and how it is flown. Not here: the libraries (`numpy_drivers`, `jax_drivers`), what is
a fault (`rules`).
"""

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.errors import UserError

BLOCK = 25  # steps


class Fault(NamedTuple):
    """One thing that is wrong."""

    rule: str
    text: str


class Look(NamedTuple):
    """What one step showed; a Trace has the same with a leading axis T."""

    observation: NDArray  # [N, A, ...] on which the next action follows
    final: NDArray  # [N, A, ...] after the step, before any new beginning
    shown: NDArray[np.bool_]  # [N] the final observation of a fight that ended was handed out
    reward: NDArray[np.float64]  # [N, A]
    terminated: NDArray[np.bool_]  # [N]
    truncated: NDArray[np.bool_]  # [N]
    flown: NDArray[np.bool_]  # [N] the step was one of the fight, not its new beginning alone
    begun: NDArray[np.bool_]  # [N] `observation` is the first of a new fight


class Trace(NamedTuple):
    """A whole flight."""

    start: NDArray  # [N, A, ...]
    look: Look  # leaves [T, N, ...]

    @property
    def ended(self) -> NDArray[np.bool_]:
        """The steps at which a fight ended, [T, N]."""
        return self.look.terminated | self.look.truncated

    def before(self) -> NDArray:
        """The observation before each step, [T, N, A, ...]."""
        return np.concatenate([self.start[None], self.look.observation[:-1]])


class Driver(ABC):
    """Steps environments of one library, and notes faults of its protocol on the way."""

    agents: tuple[str, ...]
    number: int  # N
    spaces: list[tuple[Any, Any]]  # of each agent: observations, actions
    time_limit: int | None = None
    reseeds: bool = True  # `reset(None)` gives the next fights

    def __init__(self, env: Any):
        self.env = env
        self.faults: list[Fault] = []

    @abstractmethod
    def reset(self, seed: int | None) -> NDArray:
        """Begin all fights; observations [N, A, ...]."""

    @abstractmethod
    def step(self, actions: NDArray) -> Look:
        """One step of all fights with `actions` [N, A, ...]."""

    def finish(self) -> None:  # noqa: B027 (most libraries have nothing more to try)
        """Whatever else is to be tried, at the very end."""

    def note(self, rule: str, text: str) -> None:
        """Note a fault, once for each rule."""
        if all(fault.rule != rule for fault in self.faults):
            self.faults.append(Fault(rule, text))

    def require_space(self, seen: Any, agent: int, what: str) -> NDArray:
        """`seen` [N, ...] as an array; notes a wrong shape, dtype or value. `what` names it."""
        space, name = self.spaces[agent][0], f"{what} of {self.agents[agent]}"
        array = np.asarray(seen)
        wanted = (len(array), *space.shape) if array.ndim else space.shape
        if array.shape != wanted:
            self.note("shape", f"the {name} has the shape {array.shape}, not {wanted}")
            return np.broadcast_to(np.zeros(space.shape, space.dtype), wanted)
        if array.dtype != np.dtype(space.dtype):
            self.note("dtype", f"the {name} is {array.dtype}; its space says {space.dtype}")
        if not np.all(np.isfinite(array)):
            self.note("space", f"the {name} is not finite")
        elif (low := getattr(space, "low", None)) is not None:
            if np.any(array < low) or np.any(array > space.high):
                self.note("space", f"the {name} lies outside its space")
        elif hasattr(space, "n") and np.any((array < 0) | (array >= space.n)):
            self.note("space", f"the {name} lies outside its space")
        return array

    def require_reward(self, seen: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """The rewards as float64; notes what is no number of `shape`."""
        array = np.asarray(seen)
        if array.shape != shape:
            self.note("shape", f"the reward has the shape {array.shape}, not {shape}")
            return np.zeros(shape)
        if not np.issubdtype(array.dtype, np.floating):
            self.note("dtype", f"the reward is {array.dtype}, not a float")
        if not np.all(np.isfinite(array.astype(np.float64))):
            self.note("reward", "a reward is not finite")
        return array.astype(np.float64)

    def require_flags(self, seen: Any, name: str, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """The flags as bool; notes what is none of `shape`."""
        array = np.asarray(seen)
        if array.shape != shape:
            self.note("shape", f"{name} has the shape {array.shape}, not {shape}")
            return np.zeros(shape, bool)
        if array.dtype != bool:
            self.note("dtype", f"{name} is {array.dtype}, not bool")
        return array.astype(bool)


def plan(driver: Driver, steps: int, seed: int) -> NDArray:
    """Actions [T, N, A, ...] in blocks of `BLOCK` steps: random at each step, then held at a corner
    of their space, then held nearest to 0; fights take turns.
    """
    random = np.random.default_rng([seed, 7])
    each = [_draw(space, (steps, driver.number), random) for _, space in driver.spaces]
    if any(leaf.shape != each[0].shape or leaf.dtype != each[0].dtype for leaf in each):
        raise UserError("check: agents with different action spaces are not supported")
    actions = np.stack(each, axis=2)
    block = np.arange(steps) // BLOCK
    style = _beside((block[:, None] + np.arange(driver.number)) % 3, actions)
    held, still = actions[block * BLOCK], np.zeros_like(actions)  # the first of each block
    for agent, (_, space) in enumerate(driver.spaces):
        if hasattr(space, "low") and np.all(np.isfinite(space.low) & np.isfinite(space.high)):
            middle = (np.asarray(space.low) + np.asarray(space.high)) / 2.0
            ends = np.where(held[:, :, agent] < middle, space.low, space.high)
            held[:, :, agent] = ends
            still[:, :, agent] = np.clip(still[:, :, agent], space.low, space.high)
    return np.where(style == 1, held, np.where(style == 2, still, actions))


def fly(driver: Driver, seed: int, actions: NDArray) -> Trace:
    """Begin with `seed` and fly all of `actions`; notes memory that is used again."""
    start = driver.reset(seed)
    kept, looks = start.copy(), []
    for action in actions:
        given = action.copy()
        looks.append(driver.step(given))
        if not np.array_equal(given, action):
            driver.note("action", "the caller's array of actions is written to")
    if not np.array_equal(start, kept, equal_nan=True):
        driver.note("memory", "an observation that was handed out is written to by a later step")
    return Trace(kept, Look(*(np.stack(leaf) for leaf in zip(*looks, strict=True))))


def _beside(style: NDArray, values: NDArray) -> NDArray:
    """`style` [T, N] with as many axes as `values`."""
    return style.reshape(*style.shape, *[1] * (values.ndim - style.ndim))


def _draw(space: Any, shape: tuple[int, ...], random: np.random.Generator) -> NDArray:
    """Actions of `space` with leading axes `shape`; unbounded ones are normal."""
    if hasattr(space, "n"):
        return random.integers(0, space.n, shape).astype(space.dtype)
    if not hasattr(space, "low"):
        raise UserError(f"check: actions of {type(space).__name__}: Box or Discrete is needed")
    full = (*shape, *space.shape)
    low = np.broadcast_to(np.asarray(space.low, np.float64), space.shape)
    high = np.broadcast_to(np.asarray(space.high, np.float64), space.shape)
    bounded = np.isfinite(low) & np.isfinite(high)
    even = np.where(bounded, low, 0.0) + random.random(full) * np.where(bounded, high - low, 0.0)
    drawn = np.where(bounded, even, np.clip(random.normal(size=full), low, high))
    return drawn.astype(space.dtype)

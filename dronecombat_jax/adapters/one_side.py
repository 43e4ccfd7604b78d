"""One side of a fight for a learner, the other flown by an opponent: pure functions of one fight.

A learner flies its whole side: of a team, all drones at once. In here: the fight with its key and
its opponent, and how it begins, goes on and begins anew. Not in here: any library's protocol
(`gymnasium_env`), who the opponents are (`opponents`).
"""

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct

from dronecombat_jax.combat.env import Combat
from dronecombat_jax.combat.rules import outcome_table, timeout_decides
from dronecombat_jax.combat.scripted import Pilot
from dronecombat_jax.config.schema import one_line
from dronecombat_jax.config.sides import team
from dronecombat_jax.errors import UserError
from dronecombat_jax.types import (
    ACTION_SIZE,
    ATTACKER,
    DEFENDER,
    NUM_SIDES,
    SIDES,
    EnvState,
    Outcome,
    StepOutput,
)

Tree = TypeVar("Tree")
WINS = {DEFENDER: Outcome.DEFENDER, ATTACKER: Outcome.ATTACKER}


class Bout(struct.PyTreeNode):
    """One fight of a learner against one of its opponents. The key is in here since the libraries'
    `step` is given none.
    """

    fight: EnvState
    key: jax.Array  # [] the next random numbers come from it, once
    opponent: jax.Array  # [] int32, which of the opponents flies this fight


class OneSide:
    """The fights of a learner that flies `role`. Every method is pure and for one fight: use
    `jax.vmap`.
    """

    def __init__(
        self, combat: Combat, role: int, pilots: tuple[Pilot, ...], exploring: bool = False
    ):
        """`pilots` can be met, each alike often; () in the scenario `solo`. `exploring`: as of
        `begin`.
        """
        self.combat, self.role, self.pilots, self.exploring = combat, role, pilots, exploring

    def start(self, key: jax.Array) -> Bout:
        """A fight about to begin against an opponent newly drawn."""
        spawn_key, opponent_key, key = jax.random.split(key, 3)
        opponent = jnp.zeros((), jnp.int32)
        if len(self.pilots) > 1:
            opponent = jax.random.randint(opponent_key, (), 0, len(self.pilots), jnp.int32)
        return Bout(begin(self.combat, spawn_key, self.exploring), key, opponent)

    def observe(self, bout: Bout) -> jax.Array:
        """What the learner sees, [35]; of a team of M drones [35 M], one after the other."""
        return seen(self.combat, self.role, self.combat.observe(bout.fight))

    def step(self, bout: Bout, action: jax.Array) -> tuple[Bout, StepOutput]:
        """One control step with the learner's `action` [4], or [4 M]; does not begin anew."""
        key, opponent_key = jax.random.split(bout.key)
        both = self.both(bout, action, opponent_key)
        fight, output = self.combat.step(bout.fight, both)
        return bout.replace(fight=fight, key=key), output

    def both(self, bout: Bout, action: jax.Array, key: jax.Array) -> jax.Array:
        """Both sides' actions [A, 4]; the opponent draws from `key`."""
        return all_actions(self.role, action, self._answer(bout, key))

    def _answer(self, bout: Bout, key: jax.Array) -> jax.Array:
        """The opponent's action [4], a team's [M, 4]. Pilots fly a batch of fights, here of one."""
        if not self.pilots:
            return jnp.zeros(ACTION_SIZE)
        alone = jax.tree.map(lambda leaf: leaf[None], bout.fight)
        seen = self.combat.observe(bout.fight)[None]
        answers = [pilot(alone, seen, key)[0] for pilot in self.pilots]
        return answers[0] if len(answers) == 1 else jnp.stack(answers)[bout.opponent]


def begin(combat: Combat, key: jax.Array, exploring: bool) -> EnvState:
    """A fight about to begin: at rest, or `exploring`, as in training: each drone moves with up to
    `train.start_speed`.
    """
    if not exploring:
        return combat.reset(key)
    return combat.explore(combat.exploring_numbers(key, ()), jnp.zeros((), bool))


def seen(combat: Combat, role: int, observation: jax.Array) -> jax.Array:
    """What the learner sees of all drones' `observation` [A, 35]: [35 M], its drones' one after the
    other.
    """
    return observation[team(combat.sides, role)].reshape(-1)


def earned(combat: Combat, role: int, reward: jax.Array) -> jax.Array:
    """What the learner earns of all drones' `reward` [A]: the mean of its own, []."""
    return jnp.mean(reward[team(combat.sides, role)])


def all_actions(role: int, own: jax.Array, others: jax.Array) -> jax.Array:
    """All drones' actions [A, 4], of the learner's `own` [4 M] and of its opponents', [4] or [M, 4]."""
    of_sides = [others.reshape(-1, ACTION_SIZE)] * NUM_SIDES
    of_sides[role] = own.reshape(-1, ACTION_SIZE)
    return jnp.concatenate(of_sides)


def role_of(side: int | str) -> int:
    """`DEFENDER` or `ATTACKER`, given as itself or by name. Raises UserError for anything else."""
    if side in SIDES:
        return SIDES.index(side)
    if side in (DEFENDER, ATTACKER) and not isinstance(side, bool):
        return int(side)
    raise UserError(
        f"role {one_line(str(side))}: there are {DEFENDER} ({SIDES[DEFENDER]}) and {ATTACKER} ({SIDES[ATTACKER]})"
    )


def refuse_wrong_number(combat: Combat, role: int, number: int) -> None:
    """Raise UserError for an opponent too many or too few, and for a side that does not take part."""
    solo = not combat.game.flies[DEFENDER]
    if solo and role == DEFENDER:
        raise UserError(
            "the defender is absent in game.scenario = solo: learn as the attacker, or fly a duel"
        )
    if solo != (number == 0):
        lack = "takes no opponent: the attacker is alone" if solo else "needs an opponent"
        raise UserError(f"game.scenario = {combat.config.game.scenario} {lack}")


def time_limit(combat: Combat) -> int | None:
    """Control steps after which an undecided fight is truncated; None where the time-out decides
    it.
    """
    game = combat.config.game
    return None if timeout_decides(game) else game.episode_steps


def scores(combat: Combat, role: int) -> np.ndarray:
    """What an end means for `role`, int32 by `Cause`: 1 won, 0 tied, -1 lost."""
    score = {WINS[role]: 1, Outcome.DRAW: 0, WINS[1 - role]: -1}
    return np.asarray([score[outcome] for outcome in outcome_table(combat.config.game)], np.int32)


def seed_words(seed: int) -> np.ndarray:
    """The two words [2] uint32 of the key for a seed of any size. Raises UserError below 0."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise UserError(f"seed = {one_line(str(seed))}: a whole number from 0 on is allowed")
    return np.random.SeedSequence(seed).generate_state(2, np.uint32)


def fight_keys(words: jax.Array, number: int) -> jax.Array:
    """A key for each of `number` fights, [N], of one seed's `words`: fight i's does not depend on
    how many there are, and other seeds share none of them.
    """
    key = jax.random.wrap_key_data(words)
    return jax.vmap(lambda index: jax.random.fold_in(key, index))(jnp.arange(number))


def choose(condition: jax.Array, new: Tree, old: Tree) -> Tree:
    """`new` where `condition` [N], else `old`; leaves [N, ...]."""

    def pick(new: jax.Array, old: jax.Array) -> jax.Array:
        return jnp.where(condition.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    return jax.tree.map(pick, new, old)


def choose_one(condition: jax.Array, new: Tree, old: Tree) -> Tree:
    """The same for one fight: `condition` []."""
    return jax.tree.map(lambda new, old: jnp.where(condition, new, old), new, old)

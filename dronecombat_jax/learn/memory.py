"""What a policy remembers of its fight, and what its network sees of it.

    frames   the last observations, scaled; the network sees them beside the present one, newest first
    gru      the state of a gated recurrent unit; the network sees it beside the observation

A fight keeps the numbers of every drone (`EnvState.recall`): 0 at its start, so that what was before
it is as the mean of all observations. How much a policy remembers follows from the shapes of its
arrays. One memory serves policy and value, which both train it: a second one, of the value's own,
would have to be flown for its sake. What does not live here: when it flies (`rollout`), its file (`policies`).
"""

import jax
import jax.numpy as jnp

from dronecombat_jax.combat.observe import observation_of
from dronecombat_jax.config.fields import Config
from dronecombat_jax.learn.recurrent import gru_step
from dronecombat_jax.types import EnvState, Policy


def memory_size(policy: Policy) -> int:
    """Numbers that a policy remembers of a fight; 0: it sees the present alone, as all do that have
    an encoder of others.
    """
    if policy.gru is not None:
        return policy.gru.state_weights.shape[-2]
    if policy.network.others is not None:
        return 0
    return policy.network.weights[0].shape[-2] - policy.observation_scaler.mean.shape[-1]


def recall_size(config: Config) -> int:
    """The same of the policies that are trained with `config`."""
    learn = config.learn
    if learn.memory == "gru":
        return learn.memory_size
    return (learn.frames - 1) * observation_of(config).size if learn.memory == "frames" else 0


def remember(
    policy: Policy, seen: jax.Array, recall: jax.Array | None
) -> tuple[jax.Array, jax.Array | None]:
    """What the network sees [..., in] of scaled observations `seen` [..., size], and what is
    remembered after them.

    `recall` [..., M] may be longer than this policy needs: it takes the first numbers.
    """
    size = memory_size(policy)
    if size == 0:
        return seen, recall
    if recall is None:
        raise ValueError(f"this policy remembers {size} numbers of its fight: it needs them")
    own, rest = recall[..., :size], recall[..., size:]
    if policy.gru is None:
        inputs = jnp.concatenate([seen, own], axis=-1)
        after = inputs[..., :size]
    else:
        columns = jnp.moveaxis(seen, -1, 0), jnp.moveaxis(own, -1, 0)
        after = jnp.moveaxis(gru_step(policy.gru, *columns), 0, -1)
        inputs = jnp.concatenate([seen, after], axis=-1)
    return inputs, jnp.concatenate([after, rest], axis=-1)


def with_recall(fights: EnvState, size: int) -> EnvState:
    """`fights` [...] of which nothing is remembered yet, with room for `size` numbers a drone."""
    return fights.replace(recall=jnp.zeros((*fights.down.shape, size)) if size else None)

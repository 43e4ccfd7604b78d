"""What every test shares: the environment is settled before JAX starts, programs are compiled once."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from dronecombat_jax.machine import backend

os.environ.setdefault("DRONECOMBAT_CACHE", str(Path(__file__).parents[1] / ".cache"))
os.environ.pop("MPLBACKEND", None)  # a notebook's: no test opens a window
backend.prepare("cpu")


@pytest.fixture(scope="session")
def arena() -> SimpleNamespace:
    """The default environment for 8 fights: `combat`, jitted `reset(keys)` and `step(states,
    actions)`, `traces`.
    """
    import jax

    from dronecombat_jax.combat.env import Combat
    from dronecombat_jax.config.fields import Config

    combat, traces = Combat(Config()), []

    def step(state, action):
        traces.append(action.shape)
        return combat.step(state, action)

    return SimpleNamespace(
        combat=combat,
        reset=jax.jit(lambda keys: jax.vmap(combat.reset)(keys)),
        step=jax.jit(jax.vmap(step)),
        traces=traces,
        size=8,
    )

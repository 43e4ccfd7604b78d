"""What tests of the game share."""

from types import SimpleNamespace

import jax
import pytest


@pytest.fixture
def fresh(arena: SimpleNamespace):
    """Eight fights about to start."""
    return arena.reset(jax.random.split(jax.random.key(0), arena.size))

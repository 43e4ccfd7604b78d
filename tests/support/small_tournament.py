"""The tournament that the tests of `tournaments` fly: few fights, small lanes."""

from dronecombat_jax.arena.lanes import Layout
from dronecombat_jax.arena.rectangle import Rules

RULES = Rules(episodes=3, seed=5)
LAYOUT = Layout(lanes=32, block=8, blocks=8, steps=5)
CHUNKS = 5

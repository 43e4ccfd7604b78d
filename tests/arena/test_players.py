"""Which players one program can fly."""

import numpy as np
from policies import make_policy

from dronecombat_jax.arena.players import Player, alike, kind_of, stack
from dronecombat_jax.types import Policy


def test_a_gru_and_frames_that_remember_as_much_need_two_programs():
    """35 numbers: a GRU's state, or one observation before the present one."""
    recurrent = Player("gru", make_policy((35 + 35, 8, 4), 0, state=35))
    framed = Player("frames", make_policy((2 * 35, 8, 4), 1, frames=2))
    players = [recurrent, framed, Player("dash", "dash"), recurrent]
    groups = alike(players)
    assert groups == [[0, 2, 3], [1]]
    kinds = [kind_of([players[index] for index in group]) for group in groups]
    assert [kind.memory for kind in kinds] == [35, 35]
    assert [kind.recurrent for kind in kinds] == [True, False]
    together = stack([players[index] for index in groups[0]])
    assert isinstance(together, Policy) and together.gru is not None
    assert np.shape(together.gru.state_weights) == (3, 35, 105)


def test_nobody_and_scripted_pilots_alone_have_a_program():
    assert alike([]) == [[]]
    kind = kind_of([Player("dash", "dash")])
    assert kind.sizes == () and kind.scripted and not (kind.plans or kind.recurrent)

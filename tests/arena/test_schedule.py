"""Who flies where: every fight once, every lane in a block of its player, and room that is never
exceeded.
"""

import numpy as np
import pytest

from dronecombat_jax.arena.lanes import Layout
from dronecombat_jax.arena.schedule import NOBODY, Schedule, tiles

EPISODES = 3


def check_blocks(schedule: Schedule, role: int, grouped: np.ndarray) -> None:
    """Each busy lane sits on a seat of its own, in a block that its player flies."""
    layout, blocks = schedule.layout, schedule.blocks(role)
    assert blocks.rows.shape == (layout.blocks, layout.block) and blocks.player.shape == (
        layout.blocks,
    )
    lanes = [lane for lane in np.flatnonzero(schedule.busy) if grouped[schedule.player[role, lane]]]
    for lane in lanes:
        block, place = divmod(int(blocks.seat[lane]), layout.block)
        assert (
            blocks.rows[block, place] == lane
            and blocks.player[block] == schedule.player[role, lane]
        )
    assert len(np.unique(blocks.seat[lanes])) == len(lanes)


@pytest.mark.parametrize(
    ("lanes", "block", "blocks"), [(32, 4, 12), (32, 4, 8), (16, 8, 2), (24, 1, 24)]
)
def test_every_fight_is_flown_once_whatever_ends_first(lanes: int, block: int, blocks: int):
    rng = np.random.default_rng(lanes + blocks)
    layout = Layout(lanes, block, blocks)
    wanted = rng.random((9, 13)) < 0.8
    grouped = [np.arange(9) != 4, np.ones(13, bool)]  # the fifth defender is scripted
    queue = tiles(wanted, layout, EPISODES)
    batches = [Schedule(layout, queue, grouped) for _ in range(2)]
    flown = np.zeros((*wanted.shape, EPISODES), int)
    for _ in range(10_000):
        for schedule in batches:
            begun = schedule.fill()
            assert np.all(schedule.busy[begun])
            for role in range(2):
                check_blocks(schedule, role, grouped[role])
            ended = schedule.busy & (rng.random(lanes) < 0.3)
            np.add.at(flown, schedule.take_out(ended), 1)
        if not any(schedule.busy.any() for schedule in batches) and next(queue, None) is None:
            break
    np.testing.assert_array_equal(flown, np.broadcast_to(wanted[..., None], flown.shape))


def test_tiles_hold_few_players_and_about_a_batch_of_fights():
    layout = Layout(512, 16, 44)
    squares = list(tiles(np.ones((100, 100), bool), layout, 5))
    assert sum(map(len, squares)) == 50_000
    for square in squares[:-1]:
        assert (
            len({fight.defender for fight in square}) <= 11
            and len({fight.attacker for fight in square}) <= 11
        )
    assert 512 <= len(squares[0]) < 2 * 512
    assert list(tiles(np.zeros((3, 3), bool), layout, 5)) == []


def test_with_little_room_lanes_wait_instead_of_taking_another_block():
    layout = Layout(lanes=8, block=4, blocks=2)
    schedule = Schedule(layout, tiles(np.ones((4, 4), bool), layout, 1), [np.ones(4, bool)] * 2)
    schedule.fill()
    for role in range(2):
        assert len(np.unique(schedule.player[role, schedule.busy])) <= 2
    assert np.any(schedule.player[0] == NOBODY)

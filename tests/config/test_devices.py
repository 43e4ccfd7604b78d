"""How seeds and environments are spread over devices."""

import pytest

from dronecombat_jax.config import devices, settings
from dronecombat_jax.errors import UserError


def test_devices_must_divide_seeds_and_environments():
    assert settings.load("smoke", {"train.num_seeds": 4, "run.devices": 2}).run.devices == 2
    assert settings.load("smoke", {"train.num_seeds": 1, "run.devices": 4}).run.devices == 4
    with pytest.raises(UserError) as error:  # 64 environments, mini-batches of 256
        settings.load("smoke", {"train.num_seeds": 4, "run.devices": 12})
    message = error.value.message
    assert (
        "run.devices = 12: 4 for the seeds (train.num_seeds = 4) leave 3 for the environments of each"
        in message
    )
    assert "train.num_envs = 64 and a mini-batch of 256; nearest that fit: 4, 8, 16, 32" in message


@pytest.mark.parametrize(
    ("seeds", "wanted", "available", "expected"),
    [(1, 0, 2, 1), (2, 0, 2, 2), (3, 0, 2, 1), (8, 0, 6, 4), (8, 2, 1, 2), (5, 0, 64, 5)],
)
def test_seeds_are_spread_evenly(seeds, wanted, available, expected):
    assert devices.spread(seeds, wanted, available) == expected
    assert devices.mesh_shape(seeds, wanted, available) == (expected, 1)


@pytest.mark.parametrize(
    ("seeds", "wanted", "expected"),
    [(1, 2, (1, 2)), (2, 8, (2, 4)), (6, 4, (2, 2)), (4, 12, (4, 3))],
)
def test_more_devices_than_seeds_go_to_the_environments(seeds, wanted, expected):
    assert devices.mesh_shape(seeds, wanted, wanted) == expected

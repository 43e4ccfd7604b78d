"""Memory and disk: estimated, and refused where there is less."""

import pytest

from dronecombat_jax.config import estimates, preflight, settings
from dronecombat_jax.errors import UserError


@pytest.mark.parametrize("name", settings.presets())
def test_every_preset_fits_a_small_machine(name):
    assert estimates.estimated_bytes(settings.load(name)) < 2 * 2**30


def test_the_memory_estimate_grows_with_seeds_and_counts_the_pool_only_in_self_play():
    one, two = (settings.load("smoke", {"train.num_seeds": count}) for count in (1, 2))
    assert estimates.estimated_bytes(two) == 2 * estimates.estimated_bytes(one)
    played = settings.load("smoke", {"selfplay.probability": 0.2})
    # 3 slots (the players as each of three chunks begins, the untrained one first) of 35-32-32-4
    # with a log-std per action, four bytes each.
    weights = 36 * 32 + 33 * 32 + 33 * 4 + 4
    assert estimates.estimated_bytes(played) - estimates.estimated_bytes(one) == 4 * 3 * weights
    spread = settings.load("smoke", {"selfplay.probability": 0.2, "selfplay.scope": "environment"})
    more = estimates.estimated_bytes(spread) - estimates.estimated_bytes(played)
    assert more == 4 * weights * spread.train.num_envs  # each environment holds a policy of its own


def test_team_mates_that_learn_a_policy_each_are_so_many_more_learners_and_past_players():
    team = {"game.defenders": 3, "selfplay.opponents": "defender=past 0.2 of chunks"}
    shared, own = (
        settings.load("smoke", team | {"learn.mates": mates}) for mates in ("shared", "own")
    )
    seen = 4 * 16 + 3  # of four drones and the target, by 32 and 32 units
    trunk = (seen + 1) * 32 + 33 * 32
    policy, value = trunk + 33 * 4 + 4, trunk + 33
    chunks, kept = 3, 4
    more = estimates.estimated_bytes(own) - estimates.estimated_bytes(shared)
    assert more == 4 * 2 * (3 * (policy + value) + chunks * policy)
    more = estimates.estimated_disk_bytes(own) - estimates.estimated_disk_bytes(shared)
    assert more == 4 * 2 * (kept * 3 * (policy + value) + chunks * policy)


def test_where_memory_and_disk_cannot_be_told_nothing_is_refused(monkeypatch):
    monkeypatch.setattr(preflight, "machine_bytes", lambda: None)
    monkeypatch.setattr(preflight, "free_bytes", lambda path: None)
    settings.load(None, {"train.num_envs": 10**6, "train.num_seeds": 1024}, check_machine=True)


def test_a_run_from_a_larger_machine_can_still_be_read(monkeypatch):
    monkeypatch.setattr(preflight, "machine_bytes", lambda: 1)
    assert settings.load("smoke").train.num_envs == 64


def test_this_machine_has_memory():
    there = estimates.machine_bytes()
    assert there is None or there > 2**28


def test_a_run_that_will_not_fit_on_the_disk_is_refused_with_what_needs_less(monkeypatch):
    monkeypatch.setattr(preflight, "free_bytes", lambda path: 2**30)
    large = {"learn.hidden_sizes": [256, 128], "run.directory": "/somewhere"}
    long = {**large, "train.total_steps": 1_200_000_000}
    with pytest.raises(
        UserError,
        match=r"2001 chunks need about 4\.\d+ GiB on the disk of /somewhere.*1 GiB are free",
    ):
        settings.load("duel", {**long, "train.total_steps": 2001 * 600_000}, check_machine=True)
    settings.load("duel", long | {"run.keep": "every 10"}, check_machine=True)
    settings.load("duel", long | {"run.keep": "last 5"}, check_machine=True)


def test_how_many_checkpoints_are_left():
    # 34 chunks, 0 to 34
    kept = lambda keep: estimates.kept_checkpoints(settings.load("duel", {"run.keep": keep}))
    # every 10: 0, 10, 20, 30, and the newest two 33, 34
    assert [kept("all"), kept("every 10"), kept("last 5"), kept("last 1"), kept("every 1")] == [
        35,
        6,
        5,
        2,
        35,
    ]

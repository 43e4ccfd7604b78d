"""The benchmark of the views: every view flies, and shares are of the core's rate in the same round."""

import importlib.util

import pytest
from toy import Coasting

from benchmarks import views
from dronecombat_jax.config.fields import Config


@pytest.fixture
def light(monkeypatch: pytest.MonkeyPatch):
    """Drones that coast compile in a second."""
    monkeypatch.setattr(views, "game", lambda: Coasting(Config()))
    monkeypatch.setattr(views, "ALONE", 5)


@pytest.mark.long
def test_every_view_flies(light):
    record = views.measure(4, 3, 2)
    there = importlib.util.find_spec("stable_baselines3") is not None
    assert set(record["left_out"]) == (set() if there else {"Stable-Baselines3 VecEnv"})
    assert record["rates"].keys() | record["left_out"].keys() == views.BUILDERS.keys()
    assert all(len(rates) == 2 and min(rates) > 0 for rates in record["rates"].values())


def test_shares_are_of_the_same_round():
    rates = {"core": [100.0, 1000.0, 100.0], "brax": [50.0, 800.0, 100.0]}
    lines = views.table({"rates": rates, "left_out": {"JaxMARL": "why"}}).splitlines()
    assert lines[3] == "| brax | 100 | 0.8 | 0.5 to 1 |"
    assert lines[-1] == "left out: JaxMARL (why)"

"""Commands without JAX."""

import sys
from types import ModuleType, SimpleNamespace

import pytest

from dronecombat_jax import cli as commands_room
from dronecombat_jax import machine, runs
from dronecombat_jax.errors import EXIT_STOPPED


@pytest.fixture(autouse=True)
def rooms(monkeypatch, tmp_path):
    """Stand-ins for the rooms that import JAX; `calls` lists what the commands asked of them."""
    calls: list[tuple] = []

    def stand_in(package: ModuleType, name: str, **functions) -> None:
        module = SimpleNamespace(**functions)
        monkeypatch.setitem(sys.modules, f"{package.__name__}.{name}", module)
        monkeypatch.setattr(package, name, module, raising=False)

    def record(name: str, code: int = 0):
        def call(*args, **kwargs) -> int:
            calls.append((name, *args, kwargs) if kwargs else (name, *args))
            return code

        return call

    stand_in(machine, "backend", prepare=record("prepare"), cores=lambda: 2)
    stand_in(commands_room, "doctor", doctor=record("doctor", 2), doctor_mjcf=record("doctor_mjcf"))
    stand_in(runs, "training", train=record("train", EXIT_STOPPED))
    match = lambda *asked: ("match", *asked)
    stand_in(runs, "evaluation", evaluate=record("evaluate"), Match=match)
    monkeypatch.chdir(tmp_path)
    return SimpleNamespace(calls=calls, stand_in=stand_in)

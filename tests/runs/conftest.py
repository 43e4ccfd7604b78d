"""A training loop whose program is a toy."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from toy_training import COMPILING, TOY, ToyState, report_of

from dronecombat_jax.config.fields import RunConfig
from dronecombat_jax.files import checkpoint, metrics
from dronecombat_jax.runs import program, training


@pytest.fixture
def toy(monkeypatch, tmp_path) -> SimpleNamespace:
    """`train(config)` over a program that counts; `hooks[iteration]` is called when it gets there."""
    hooks: dict[int, Callable[[], object]] = {}
    faults = {"skipped": 0, "diverged": 0}  # of every iteration: gradient steps, fights
    begun: list[int] = []

    def advance(state: ToyState):
        done = int(state.iteration[0]) + program.call_iterations(TOY)
        report = report_of(program.call_iterations(TOY), **faults)
        if hook := hooks.pop(done, None):
            hook()
        return ToyState(
            iteration=np.array([done], np.int32), history=state.history * 3 + done
        ), report

    def prepare(begun_run, config, saver):
        run, start = begun_run.run, begun_run.start
        begun.append(start.iteration if start else 0)
        state = ToyState(iteration=np.zeros(1, np.int32), history=np.ones(3, np.uint64))
        if start is not None:
            state = checkpoint.restore(run.checkpoints, start.iteration, state)
            for log in (run.metrics, run.chunks):
                metrics.truncate_after(log, start.iteration * config.steps_per_iteration)
        toy_program = SimpleNamespace(
            config=config,
            iterations=program.call_iterations(TOY),
            compile=compile_program,
            flight_seconds=lambda state: 1e-6,
        )
        return toy_program, state

    def compile_program(state):
        if hook := hooks.pop(COMPILING, None):
            hook()
        return advance

    monkeypatch.setattr(training, "_prepare", prepare)
    config = replace(TOY, run=RunConfig(name="toy", directory=str(tmp_path)))
    path = tmp_path / "toy"
    return SimpleNamespace(config=config, path=path, hooks=hooks, faults=faults, begun=begun)

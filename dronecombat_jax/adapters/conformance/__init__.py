"""A conformance checker for batched environments, of any of four libraries' kinds.

    report = check(env)          raises NonConforming, which names every fault
    report = examine(env)        the same, without raising
    print(report)                faults, and what no fight has shown

Taken are Gymnasium's vector environments, brax's batched ones, JaxMARL's and PettingZoo's parallel
ones. It looks from outside: it resets, steps and compares what comes back. Rules: `rules`. What does
not live here: how each library is driven (`numpy_drivers`, `jax_drivers`).
"""

from typing import Any, NamedTuple

from dronecombat_jax.adapters.conformance.rules import RULES
from dronecombat_jax.adapters.conformance.trace import Driver, Fault, fly, plan
from dronecombat_jax.errors import UserError


class Report(NamedTuple):
    """What was found."""

    faults: tuple[Fault, ...]
    unseen: tuple[str, ...]  # one line for each rule that nothing that happened could test

    def __str__(self) -> str:
        lines = [f"{fault.rule}: {fault.text}" for fault in self.faults] or ["no fault was found"]
        return "\n".join([*lines, *(f"not tested: {line}" for line in self.unseen)])


class NonConforming(AssertionError):
    """An environment has faults; `report` holds them."""

    def __init__(self, report: Report):
        super().__init__(str(report))
        self.report = report


def check(env: Any, **options: Any) -> Report:
    """`examine`, but raises NonConforming where there is a fault."""
    report = examine(env, **options)
    if report.faults:
        raise NonConforming(report)
    return report


def examine(
    env: Any, *, steps: int = 200, seed: int = 0, num_envs: int = 6, time_limit: int | None = None
) -> Report:
    """Fly `env` four times for `steps` steps with random and with constant actions, and judge.

    `num_envs`: fights side by side where `env` does not say it (brax, JaxMARL). `time_limit`: steps
    until truncation; None for what the environment states (`time_limit`, `spec.max_episode_steps`,
    `episode_length`, `max_steps`). Raises UserError for an environment of another kind and for
    spaces that are not a Box or Discrete.
    """
    if steps < 2 or num_envs < 1:
        raise UserError(f"steps = {steps}, num_envs = {num_envs}: at least 2 and 1 are needed")
    driver = _driver(env, num_envs)
    if time_limit is not None:
        driver.time_limit = time_limit
    actions = plan(driver, steps, seed)
    other = plan(driver, steps, seed + 1)
    other[:, ::2] = actions[:, ::2]  # every other fight is flown otherwise
    alike = actions.copy()
    alike[:] = actions[:, :1]
    flights = {
        "first": fly(driver, seed, actions),
        "again": fly(driver, seed, actions),
        "neighbours": fly(driver, seed, other),
        "alike": fly(driver, seed + 1, alike),
        "other seed": fly(driver, seed + 2, actions),
    }
    unseen: list[str] = []
    for rule in RULES:
        rule(driver, flights, unseen)
    driver.finish()
    return Report(tuple(driver.faults), tuple(unseen))


def _driver(env: Any, num_envs: int) -> Driver:
    """The driver of the library that `env` belongs to."""
    from dronecombat_jax.adapters.conformance import jax_drivers, numpy_drivers

    for driver in (numpy_drivers.of_gymnasium, numpy_drivers.of_pettingzoo):
        if (chosen := driver(env)) is not None:
            return chosen
    for driver in (jax_drivers.of_brax, jax_drivers.of_jaxmarl):
        if (chosen := driver(env, num_envs)) is not None:
            return chosen
    raise UserError(
        f"check: {type(env).__name__} is none of Gymnasium's VectorEnv, PettingZoo's ParallelEnv, "
        "brax's Env and JaxMARL's MultiAgentEnv"
    )

"""What is a fault: each rule compares flights of the same environment.

Flights (`Trace`): "first"; "again", the same once more; "neighbours", in which every other fight is
flown otherwise; "alike", in which all fights are given the same actions; "other seed", of another
seed. A rule notes faults with the driver, and in `unseen` what nothing that happened could test.
"""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from dronecombat_jax.adapters.conformance.trace import Driver, Trace

Rule = Callable[[Driver, Mapping[str, Trace], list[str]], None]

TOLERANCE = 1e-5
OFTEN, SELDOM = 0.5, 0.1  # shares of steps


def same_seed(driver: Driver, flights: Mapping[str, Trace], unseen: list[str]) -> None:
    """The same seed and actions give the same fights."""
    first, again = flights["first"], flights["again"]
    if not _alike(first.start, again.start) or not _same(first, again):
        driver.note("seed", "the same seed and actions gave other fights the second time")


def different_seeds(driver: Driver, flights: Mapping[str, Trace], unseen: list[str]) -> None:
    """Another seed gives other fights, and the fights of one seed differ from each other."""
    first, other = flights["first"], flights["other seed"]
    if _alike(first.start, other.start) and _same(first, other):
        driver.note("seeds-alike", "two seeds gave the same fights")
    alike = flights["alike"]
    if driver.number < 2:
        unseen.append("fights-alike, neighbours, lost-transition: there is one fight alone")
    elif all(_column_alike(alike, 0, index) for index in range(1, driver.number)):
        driver.note("fights-alike", "under the same actions all fights of a batch are the same")


def going_on(driver: Driver, flights: Mapping[str, Trace], unseen: list[str]) -> None:
    """`reset` without a seed gives the next fights: it does not begin the seed's fights again."""
    if not driver.reseeds:
        return
    first, second = driver.reset(3).copy(), driver.reset(None).copy()
    if _alike(first, second) and _alike(second, driver.reset(None)):
        driver.note("reset-repeats", "reset without a seed gave the same start three times")


def starts(driver: Driver, flights: Mapping[str, Trace], unseen: list[str]) -> None:
    """A fight that begins anew does not begin where it began before."""
    for index in range(driver.number):
        begun = _starts(flights["first"], index)
        if len(begun) < 3:
            continue
        if all(_alike(begun[1], start) for start in begun[2:]):
            driver.note("start-repeats", "fights begin anew from the same state each time")
        return
    unseen.append("start-repeats: no fight ended twice; more steps?")


def final_observation(driver: Driver, flights: Mapping[str, Trace], unseen: list[str]) -> None:
    """Every end hands out the observation after its last step: not the new start, not the old one."""
    first = flights["first"]
    ends = np.argwhere(first.ended)
    if not len(ends):
        unseen.append("final-observation, truncation and all of ends: no fight ended; more steps?")
        return
    missing = int(np.sum(first.ended & ~first.look.shown))
    if missing:
        text = f"{missing} of {len(ends)} ends did not hand out their final observation"
        driver.note("final-observation", text)
        return
    before, final, following = first.before(), first.look.final, _following(first)
    if all(_alike(final[t, i], following[t, i]) for t, i in ends if following[t, i] is not None):
        driver.note("final-observation", "the final observation is the first of the next fight")
    elif _stays(first) < SELDOM and all(_alike(final[t, i], before[t, i]) for t, i in ends):
        driver.note("final-observation", "the final observation is that of the step before")


def after_the_end(driver: Driver, flights: Mapping[str, Trace], unseen: list[str]) -> None:
    """The step that only begins a fight anew brings no reward and no end."""
    look = flights["first"].look
    idle = ~look.flown
    if np.any(look.reward[idle]):
        driver.note("after-the-end", "the step that begins a fight anew brings a reward")
    if np.any((look.terminated | look.truncated)[idle]):
        driver.note("after-the-end", "the step that begins a fight anew ends it at once")


def time_limit(driver: Driver, flights: Mapping[str, Trace], unseen: list[str]) -> None:
    """A fight that runs out of time is truncated, at the limit and nowhere else."""
    limit = driver.time_limit
    if limit is None:
        unseen.append("truncation: the environment states no time limit; pass time_limit=")
        return
    lengths, truncated = _lengths(flights["first"])
    if np.any(lengths > limit) or _longest(flights["first"]) > limit:
        driver.note("time-limit", f"a fight went on beyond {limit} steps")
    if np.any(truncated & (lengths < limit)):
        driver.note("time-limit", f"a fight was truncated before its {limit} steps")
    ran_out = lengths == limit
    if not ran_out.any():
        unseen.append(f"truncation: no fight lasted {limit} steps; more steps?")
    elif ran_out.sum() > 1 and not truncated[ran_out].any():
        text = f"all {ran_out.sum()} fights that lasted {limit} steps are told as terminated"
        driver.note("truncation", text)


def neighbours(driver: Driver, flights: Mapping[str, Trace], unseen: list[str]) -> None:
    """A fight does not depend on what others beside it do: looked at until its first end."""
    first, other = flights["first"], flights["neighbours"]
    for index in range(0, driver.number, 2):
        ended = np.flatnonzero(first.ended[:, index] | other.ended[:, index])
        until = ended[0] + 1 if len(ended) else len(first.ended)
        if driver.number > 1 and not _column_same(first, other, index, until):
            driver.note("neighbours", "a fight goes on otherwise if others beside it are flown so")
            return


def lost_transition(driver: Driver, flights: Mapping[str, Trace], unseen: list[str]) -> None:
    """When one fight begins anew, the others go on."""
    first = flights["first"]
    some = first.look.begun.any(axis=1, keepdims=True)
    goes_on = first.look.flown & ~first.look.begun
    beside, alone = goes_on & some, goes_on & ~some
    if not beside.any() or not alone.any():
        if driver.number > 1:
            unseen.append("lost-transition: no fight began anew while others went on; more steps?")
        return
    for name, still in (
        ("observation stays", _unchanged(first)),
        ("reward is 0", np.all(first.look.reward == 0.0, axis=-1)),
    ):
        if still[beside].mean() > OFTEN and still[alone].mean() < SELDOM:
            text = f"when a fight begins anew, the others' {name}: they lose a step"
            driver.note("lost-transition", text)


RULES: tuple[Rule, ...] = (
    same_seed,
    different_seeds,
    going_on,
    starts,
    final_observation,
    after_the_end,
    time_limit,
    neighbours,
    lost_transition,
)


def _alike(first: NDArray, second: NDArray) -> bool:
    """Equal up to rounding; what is missing in both is equal."""
    return bool(np.allclose(first, second, rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True))


def _same(first: Trace, second: Trace) -> bool:
    return all(_column_same(first, second, index) for index in range(first.ended.shape[1]))


def _column_same(first: Trace, second: Trace, index: int, until: int | None = None) -> bool:
    """Whether a fight of two flights is the same in its first `until` steps."""
    a, b = (
        (trace.look.reward, trace.look.terminated, trace.look.truncated, trace.before())
        for trace in (first, second)
    )
    return all(_alike(x[:until, index], y[:until, index]) for x, y in zip(a, b, strict=True))


def _column_alike(trace: Trace, first: int, second: int) -> bool:
    """Whether two fights of a flight are the same."""
    leaves = (trace.look.reward, trace.look.terminated, trace.before())
    return all(_alike(leaf[:, first], leaf[:, second]) for leaf in leaves)


def _starts(trace: Trace, index: int) -> list[NDArray]:
    """The first observations of a fight's beginnings, in order."""
    return [trace.start[index], *trace.look.observation[trace.look.begun[:, index], index]]


def _following(trace: Trace) -> NDArray:
    """By step and fight, the first observation of the next beginning from that step on."""
    following = np.full(trace.ended.shape, None, dtype=object)
    for index in range(trace.ended.shape[1]):
        start = None
        for step in reversed(range(len(trace.ended))):
            if trace.look.begun[step, index]:
                start = trace.look.observation[step, index]
            following[step, index] = start
    return following


def _unchanged(trace: Trace) -> NDArray[np.bool_]:
    """Whether a step left the observation of all agents as it was, [T, N]."""
    same = trace.look.observation == trace.before()
    return same.reshape(*trace.ended.shape, -1).all(axis=-1)


def _stays(trace: Trace) -> float:
    """Share of a fight's own steps that left the observation as it was."""
    goes_on = trace.look.flown & ~trace.look.begun
    return float(_unchanged(trace)[goes_on].mean()) if goes_on.any() else 0.0


def _lengths(trace: Trace) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Steps of each fight that ended, and whether it was truncated."""
    lengths, truncated = [], []
    for index in range(trace.ended.shape[1]):
        steps = 0
        for step in range(len(trace.ended)):
            steps += int(trace.look.flown[step, index])
            if trace.ended[step, index]:
                lengths.append(steps)
                truncated.append(bool(trace.look.truncated[step, index]))
                steps = 0
    return np.asarray(lengths, np.int64), np.asarray(truncated, bool)


def _longest(trace: Trace) -> int:
    """The most steps that any fight flew without an end."""
    longest = 0
    for index in range(trace.ended.shape[1]):
        steps = 0
        for step in range(len(trace.ended)):
            steps = 0 if trace.look.begun[step, index] else steps
            steps += int(trace.look.flown[step, index] and not trace.ended[step, index])
            longest = max(longest, steps)
    return longest

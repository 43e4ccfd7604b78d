"""How far a work of several steps is, shown before the progress line of the step that runs.

What does not live here: the line itself (`progress`), and what the steps do.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from dronecombat_jax.runs.progress import whole
from dronecombat_jax.runs.rate import duration_text

ENOUGH = 0.05  # of all: before that the estimate alone says what is left


class Overall:
    """Steps with the seconds that each is expected to take; `done` were done before."""

    def __init__(
        self,
        seconds: Sequence[float],
        done: Sequence[bool],
        clock: Callable[[], float] = time.monotonic,
    ):
        self._seconds, self._done = list(seconds), list(done)
        self._clock = clock
        self._began = clock()
        self._before = self._finished()

    def finish(self, step: int) -> None:
        """Step number `step` is done."""
        self._done[step] = True

    @contextmanager
    def at(self, step: int) -> Iterator[None]:
        """While step number `step` is at work, its progress lines open with how far all is."""
        token = whole.set(lambda share: f"{self.text(step, share)} | ")
        try:
            yield
        finally:
            whole.reset(token)

    def text(self, step: int, share: float = 0.0) -> str:
        """The progress of all steps, such as "step 2 of 4, all 37 %, about 0:02:10 left", with
        `share` of the step done.
        """
        total = sum(self._seconds)
        reached = self._finished() + share * self._seconds[step]
        left = (total - reached) * self._pace(reached)
        percent = int(100 * reached / total)
        number, count = step + 1, len(self._seconds)
        return f"step {number} of {count}, all {percent} %, about {duration_text(left)} left"

    def _pace(self, reached: float) -> float:
        """Seconds that an expected second takes, by what was done since the start."""
        here = reached - self._before
        if here < ENOUGH * sum(self._seconds):
            return 1.0
        return (self._clock() - self._began) / here

    def _finished(self) -> float:
        return sum(seconds for seconds, done in zip(self._seconds, self._done, strict=True) if done)

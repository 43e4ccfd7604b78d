"""How far a work of several steps is, and that the line of each step says it."""

import io

from dronecombat_jax.runs.overall import Overall
from dronecombat_jax.runs.progress import Progress, ProgressUpdate


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_what_is_left_is_first_the_estimate_and_then_what_was_measured():
    clock = Clock()
    overall = Overall([100.0, 300.0, 600.0], [False] * 3, clock)
    assert overall.text(0) == "step 1 of 3, all 0 %, about 0:16:40 left"
    clock.now = 4.0  # two hundredths of a step: too little to measure by
    assert overall.text(0, 0.02) == "step 1 of 3, all 0 %, about 0:16:38 left"
    clock.now = 200.0  # twice as long as expected
    overall.finish(0)
    assert overall.text(1) == "step 2 of 3, all 10 %, about 0:30:00 left"
    clock.now = 500.0  # half of a step of 300 in 300: 250 expected seconds took 500
    assert overall.text(1, 0.5) == "step 2 of 3, all 25 %, about 0:25:00 left"


def test_steps_that_were_done_before_say_nothing_of_the_pace():
    clock = Clock()
    overall = Overall([100.0, 100.0], [True, False], clock)
    clock.now = 1.0
    assert overall.text(1) == "step 2 of 2, all 50 %, about 0:01:40 left"


def test_a_steps_line_opens_with_the_whole_while_it_is_at_work():
    stream = io.StringIO()
    clock = Clock()
    overall = Overall([50.0, 50.0], [True, False], clock)
    with overall.at(1):
        inside = Progress("run", 200, stream=stream)
    outside = Progress("run", 200, stream=stream)
    clock.now = 25.0
    for progress in (inside, outside):
        progress.update(ProgressUpdate(100))
    first, second = stream.getvalue().splitlines()
    assert first.startswith("step 2 of 2, all 75 %, about 0:00:25 left | run: 100/200 50 %")
    assert second.startswith("run: 100/200 50 %")

"""What is shown: right numbers, one line at a time, nothing that a name could smuggle in."""

import io
import math
import os
import re

import pytest
from rich.console import Console

from dronecombat_jax.runs.progress import (
    Progress,
    ProgressUpdate,
    TerminalProgress,
    make_progress,
    outcome_text,
)
from dronecombat_jax.runs.rate import RateMeter, count_text, duration_text


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_rate_over_the_last_minute():
    clock = Clock()
    meter = RateMeter(clock)
    meter.restart(1000)
    assert math.isnan(meter.rate()) and math.isnan(meter.remaining(10))
    for second in range(1, 31):  # slow first half minute: 10 steps/s
        clock.now = second
        meter.add(1000 + 10 * second)
    assert meter.rate() == pytest.approx(10.0)
    for second in range(31, 121):  # then 100 steps/s, long enough to forget the start
        clock.now = second
        meter.add(1300 + 100 * (second - 30))
    assert meter.rate() == pytest.approx(100.0, rel=0.01)
    assert meter.remaining(10_300 + 3000) == pytest.approx(30.0, rel=0.01)
    clock.now += 10
    assert meter.remaining(10_300 + 3000) == pytest.approx(20.0, rel=0.02)
    meter.restart(5)
    assert math.isnan(meter.rate())


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (9999, "9,999"), (3_600_000, "3.60 M"), (1e9, "1.00 G"), (123_456, "123,456")],
)
def test_counts(value: float, text: str):
    assert count_text(value) == text


def test_durations():
    assert [duration_text(x) for x in (0.4, 59.6, 3661, 360_000, math.nan)] == [
        "0:00:00",
        "0:01:00",
        "1:01:01",
        "100:00:00",
        "...",
    ]


def test_lines_are_throttled_and_the_last_is_shown():
    clock, stream = Clock(), io.StringIO()
    with Progress("run", 1000, stream=stream, clock=clock) as progress:
        with progress.compiling("training"):
            clock.now = 12.34
        for second in range(1, 11):
            clock.now = 12.34 + second
            progress.update(
                ProgressUpdate(100 * second, 0.5, 0.25, 0.25, 0.1, 0.05, note="chunk 1/2")
            )
    lines = stream.getvalue().splitlines()
    assert lines[:2] == ["compiling training ...", "compiled training in 12.3 s"]
    assert [line.split()[1] for line in lines[2:]] == ["100/1,000", "600/1,000", "1,000/1,000"]
    assert lines[3] == (
        "run: 600/1,000 60 %  100 steps/s  ETA 0:00:04; defender won 50 % crashed 10 % | "
        "attacker won 25 % crashed 5 % | tie 25 % | chunk 1/2"
    )


def test_no_ended_episode_and_nothing_done():
    assert (
        outcome_text(ProgressUpdate(0))
        == "defender won - crashed - | attacker won - crashed - | tie -"
    )
    stream = io.StringIO()
    with Progress("run", 10, stream=stream):
        pass
    assert stream.getvalue() == ""


def test_hostile_title_and_note():
    stream = io.StringIO()
    with Progress("a\nb\x1b[31m", 10, stream=stream) as progress:
        progress.update(ProgressUpdate(1, note="[/bold]\r\x07"))
    assert stream.getvalue().count("\n") == 1
    assert "a?b?[31m:" in stream.getvalue() and stream.getvalue().endswith("| [/bold]??\n")


def test_a_closed_pipe_does_not_stop_a_run():
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as stream, Progress("run", 10, stream=stream) as progress:
        for step in range(3):
            progress.message("hello")
            progress.update(ProgressUpdate(step))
        # the stream's own buffer may be flushed now
        os.dup2(os.open(os.devnull, os.O_WRONLY), writing)


def make_console(width: int) -> Console:
    return Console(
        file=io.StringIO(),
        force_terminal=True,
        width=width,
        color_system=None,
        legacy_windows=False,
    )


@pytest.mark.parametrize("width", [40, 80, 160])
def test_terminal_updates_in_place(width: int):
    console = make_console(width)
    with TerminalProgress("[red]run[/nope] \x1b[31m", 1000, 0, console) as progress:
        with progress.compiling("[bold]training"):
            progress.message("[/] 50 % [link]")
        progress.update(ProgressUpdate(500, 0.5, 0.25, 0.25, 0.1, 0.05, note="[/x]"))
    output = console.file.getvalue()  # type: ignore[attr-defined]
    assert "[/] 50 % [link]" in output and "compiled [bold]training in 0.0 s" in output
    assert "\x1b[31m" not in output
    assert "\x1b[1A" in output and output.count("\x1b[?25l") == output.count("\x1b[?25h") == 1
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", output)
    assert "500/1,000 50 %" in plain if width >= 80 else True
    assert all(len(line) <= width for line in plain.replace("\r", "\n").splitlines())


def test_a_compilation_that_fails_ends_the_display():
    console = make_console(80)
    with (
        pytest.raises(RuntimeError),
        TerminalProgress("run", 10, 0, console) as progress,
        progress.compiling("x"),
    ):
        raise RuntimeError
    assert "\x1b[?25h" in console.file.getvalue()  # type: ignore[attr-defined]


def test_lines_where_stdout_is_no_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.delenv(name, raising=False)
    with make_progress("run", 10) as progress:
        progress.update(ProgressUpdate(10))
    assert type(progress) is Progress and capsys.readouterr().out.startswith("run: 10/10 100 %")

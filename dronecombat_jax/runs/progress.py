"""What a person sees while training runs: a display on a terminal, plain lines elsewhere.

The display never touches a device and never stops a run: where the terminal has gone it falls
silent.
"""

import contextlib
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from types import TracebackType
from typing import IO, TYPE_CHECKING, NamedTuple

from dronecombat_jax.runs.rate import RateMeter, count_text, duration_text, rate_text, share_text

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

_LINE_SECONDS = 5.0


def _alone(share: float) -> str:
    """What stands before a line where the work is not part of something larger: nothing."""
    return ""


# Of the share that is done of this piece of work: what stands before its line (`overall`).
whole: ContextVar[Callable[[float], str]] = ContextVar("whole", default=_alone)


class ProgressUpdate(NamedTuple):
    """The state after one program call; shares are of the episodes that ended in it, NaN where none
    did.
    """

    steps: int  # environment steps so far, all seeds together
    defender_wins: float = math.nan
    attacker_wins: float = math.nan
    ties: float = math.nan
    defender_crashes: float = math.nan
    attacker_crashes: float = math.nan
    note: str = ""  # such as "chunk 3/34"


class Progress:
    """Lines, at most one every few seconds: the display where no terminal is. A context manager.

    `total_steps` and `done_steps` (a resume) are environment steps, all seeds together, or what
    else `unit` says.
    """

    def __init__(
        self,
        title: str,
        total_steps: int,
        done_steps: int = 0,
        stream: IO[str] | None = None,
        clock: Callable[[], float] = time.monotonic,
        unit: str = "steps",
    ):
        self.title, self.unit = printable(title), unit
        self.total_steps = total_steps
        self.last = ProgressUpdate(done_steps)
        self.meter = RateMeter(clock)
        self.meter.restart(done_steps)
        self._clock = clock
        self._whole = whole.get()
        self._stream = sys.stdout if stream is None else stream
        self._shown_at = -math.inf
        self._shown = self.last

    def __enter__(self) -> "Progress":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def update(self, update: ProgressUpdate) -> None:
        """Show the state after a program call."""
        self.last = update
        self.meter.add(update.steps)
        if self._clock() - self._shown_at >= _LINE_SECONDS:
            self._show()

    def message(self, text: str) -> None:
        """Show one line that stays."""
        try:
            print(printable(text), file=self._stream, flush=True)
        except (OSError, ValueError):  # the reader of the pipe has gone, or the file is closed
            self._stream = open(os.devnull, "w")  # noqa: SIM115 - lives as long as the process

    @contextlib.contextmanager
    def compiling(self, what: str) -> Iterator[None]:
        """Announce a compilation, report its time after it, and start the rate anew."""
        self.message(f"compiling {what} ...")
        start = self._clock()
        yield
        self.message(f"compiled {what} in {self._clock() - start:.1f} s")
        self.meter.restart(self.last.steps)

    def close(self) -> None:
        """End the display; an update that was throttled away is still shown."""
        if self._shown is not self.last:
            self._show()

    def _show(self) -> None:
        self._shown, self._shown_at = self.last, self._clock()
        self.message(f"{self._before()}{self.title}: {steps_text(self)}; {outcome_text(self.last)}")

    def _before(self) -> str:
        """How far the larger work is that this is a part of; "" where it is part of none."""
        return self._whole(min(self.last.steps / max(self.total_steps, 1), 1.0))


class TerminalProgress(Progress):
    """Two rows that update in place: bar, rate and ETA; shares of both sides."""

    def __init__(
        self, title: str, total_steps: int, done_steps: int, console: "Console", unit: str = "steps"
    ):
        from rich.live import Live

        super().__init__(title, total_steps, done_steps, unit=unit)
        self._console = console
        self._compiling = ""
        self._compiling_since = 0.0
        self._live = Live(get_renderable=self._render, console=console, refresh_per_second=4)

    def __enter__(self) -> "TerminalProgress":
        self._live.start()
        return self

    def update(self, update: ProgressUpdate) -> None:
        self.last = update
        self.meter.add(update.steps)
        self._live.refresh()

    def message(self, text: str) -> None:
        from rich.text import Text

        # Text: neither [markup] in a name nor numbers get a colour
        self._console.print(Text(printable(text)), highlight=False, soft_wrap=True)

    @contextlib.contextmanager
    def compiling(self, what: str) -> Iterator[None]:
        self._compiling, self._compiling_since = printable(what), self._clock()
        try:
            with super().compiling(what):
                yield
        finally:
            self._compiling = ""

    def close(self) -> None:
        self._live.stop()

    def _render(self) -> "RenderableType":
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        row = Table.grid(padding=(0, 1), expand=True)
        row.add_column(no_wrap=True, max_width=24, overflow="ellipsis")
        row.add_column(ratio=1)
        row.add_column(no_wrap=True)
        bar = ProgressBar(total=self.total_steps, completed=min(self.last.steps, self.total_steps))
        row.add_row(Text(self.title, style="bold"), bar, Text(steps_text(self)))
        if self._compiling:
            seconds = self._clock() - self._compiling_since
            status = Text(f"compiling {self._compiling}: {seconds:.0f} s", style="yellow")
        else:
            text = self._before() + outcome_text(self.last)
            status = Text(text, no_wrap=True, overflow="ellipsis")
        return Group(row, status)


def make_progress(
    title: str, total_steps: int, done_steps: int = 0, unit: str = "steps"
) -> Progress:
    """The display that fits stdout: in place on a terminal, lines in a file, a pipe or a notebook."""
    from rich.console import Console

    console = Console()
    if console.is_terminal and not console.is_dumb_terminal and not console.is_jupyter:
        return TerminalProgress(title, total_steps, done_steps, console, unit)
    return Progress(title, total_steps, done_steps, unit=unit)


def steps_text(progress: Progress) -> str:
    """Done and total environment steps, rate, time left."""
    done, total = progress.last.steps, progress.total_steps
    percent = 100.0 * min(done / total, 1.0) if total else 100.0
    return (
        f"{count_text(done)}/{count_text(total)} {percent:.0f} %  {rate_text(progress.meter.rate(), progress.unit)}  "
        f"ETA {duration_text(progress.meter.remaining(total))}"
    )


def outcome_text(update: ProgressUpdate) -> str:
    """Shares of both sides: won and crashed; ties; the note."""
    text = (
        f"defender won {share_text(update.defender_wins)} crashed {share_text(update.defender_crashes)} | "
        f"attacker won {share_text(update.attacker_wins)} crashed {share_text(update.attacker_crashes)} | "
        f"tie {share_text(update.ties)}"
    )
    return f"{text} | {printable(update.note)}" if update.note else text


def printable(text: str) -> str:
    """`text` on one line and without control characters: names may come from anywhere."""
    return "".join(character if character.isprintable() else "?" for character in text)

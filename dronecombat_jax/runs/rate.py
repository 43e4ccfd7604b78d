"""Environment steps per second, and numbers as people read them."""

import math
import time
from collections import deque
from collections.abc import Callable

_WINDOW_SECONDS = 60.0


class RateMeter:
    """Environment steps per second over the last minute, and from them the time that is left."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._points: deque[tuple[float, int]] = deque()

    def restart(self, steps: int) -> None:
        """Forget the past: `steps` are done now (after compiling, at a resume)."""
        self._points = deque([(self._clock(), steps)])

    def add(self, steps: int) -> None:
        """`steps` environment steps are done now."""
        now = self._clock()
        self._points.append((now, steps))
        while len(self._points) > 2 and self._points[1][0] < now - _WINDOW_SECONDS:
            self._points.popleft()

    def rate(self) -> float:
        """Steps per second; NaN before the second point."""
        if len(self._points) < 2:
            return math.nan
        (start, first), (end, last) = self._points[0], self._points[-1]
        return (last - first) / (end - start) if end > start else math.nan

    def remaining(self, total: int) -> float:
        """Seconds until `total` steps are done, running down between updates; NaN while unknown."""
        rate = self.rate()
        if not rate > 0:
            return math.nan
        end, last = self._points[-1]
        return max(0.0, (total - last) / rate - (self._clock() - end))


def count_text(steps: float) -> str:
    """A number for people: 1,234 as it is, 1,234,567 as 1.23 M."""
    for factor, unit in ((1e9, "G"), (1e6, "M")):
        if steps >= factor:
            return f"{steps / factor:.2f} {unit}"
    return f"{steps:,.0f}"


def rate_text(rate: float, unit: str = "steps") -> str:
    """Steps (or another `unit`) per second, or "..." while unknown."""
    return f"... {unit}/s" if math.isnan(rate) else f"{rate:,.0f} {unit}/s"


def duration_text(seconds: float) -> str:
    """h:mm:ss, or "..." while unknown."""
    if math.isnan(seconds):
        return "..."
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"


def share_text(share: float) -> str:
    """A share in percent, or "-" where no episode ended."""
    return "-" if math.isnan(share) else f"{100 * share:.0f} %"

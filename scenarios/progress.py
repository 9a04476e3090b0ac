"""How far a run has come, on stderr: a bar on a terminal, a plain line now and then where nobody watches."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Protocol, runtime_checkable

BAR_WIDTH = 24
BAR_EVERY_S = 0.1
LINE_EVERY_S = 5.0


@runtime_checkable
class Stream(Protocol):
    """What a progress needs of its stream."""

    def write(self, text: str, /) -> int: ...  # noqa: D102
    def flush(self) -> None: ...  # noqa: D102
    def isatty(self) -> bool: ...  # noqa: D102


class Progress:
    """Called as `progress(stage, done, total)`; every stage ends with a line of its own."""

    def __init__(self, out: Stream | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.out = out if out is not None else sys.stderr
        self.clock = clock
        self.bar = self.out.isatty()
        self.stage = ""
        self.started_s = self.said_s = clock()
        self.open_line = False

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Say how far the stage has come, unless the last word is too fresh."""
        now = self.clock()
        if stage != self.stage:
            self.close()
            self.stage, self.started_s, self.said_s = stage, now, -float("inf") if self.bar else now
        last = done >= total
        if not last and now - self.said_s < (BAR_EVERY_S if self.bar else LINE_EVERY_S):
            return
        self.said_s = now
        text = self._text(done, total, now - self.started_s)
        if self.bar:
            filled = BAR_WIDTH * done // max(total, 1)
            self.out.write(f"\r\x1b[K{text}  [{'#' * filled}{'.' * (BAR_WIDTH - filled)}]")
            self.open_line = True
        else:
            self.out.write(text + "\n")
        self.out.flush()
        if last:
            self.close()
            self.stage = ""

    def close(self) -> None:
        """End the bar's line, so that what is written next stands below it."""
        if self.open_line:
            self.out.write("\n")
            self.out.flush()
        self.open_line = False

    def _text(self, done: int, total: int, elapsed_s: float) -> str:
        text = f"{self.stage}: {done} of {total}"
        if done <= 0 or elapsed_s <= 0:
            return text
        rate = done / elapsed_s
        if done >= total:
            return f"{text}, {rate:.3g} a second, took {_duration(elapsed_s)}"
        return f"{text}, {rate:.3g} a second, {_duration((total - done) / rate)} left"


def _duration(seconds: float) -> str:
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"

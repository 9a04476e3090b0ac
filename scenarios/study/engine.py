"""Who makes the runs: worker processes of this machine. Any of them may die, and costs the one run it was at."""

from __future__ import annotations

import select
import time
from collections import deque
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from scenarios.study.child import Child, FalseStart
from scenarios.study.ledger import Job, Outcome

MOST_FALSE_STARTS = 5
LONGEST_WAIT_S = 1.0

Started = list[str]
Event = Started | Outcome | None
"""Keys of runs just handed out, or what became of one; None now and then, while nothing happens."""


@runtime_checkable
class Engine(Protocol):
    """Makes runs in any order, and says what happens as it happens."""

    def events(self, jobs: Iterable[Job]) -> Iterator[Event]:
        """Hand out every job and tell its outcome; closing the iterator ends all workers."""


def groups(jobs: Iterable[Job]) -> Iterator[list[Job]]:
    """Jobs that share a recording: same point, same seed, one for each method."""
    return (list(group) for _, group in groupby(jobs, key=lambda job: (job.point, job.seed)))


def as_line(job: Job) -> dict[str, Any]:
    """A job as it is sent to a worker."""
    return {"key": job.key, "values": job.values, "method": job.method, "seed": job.seed}


class Processes:
    """Worker processes of our own, each fed a job at a time over a pipe.

    joblib would take fewer lines, but it gives up the whole pool, and all runs in it, when one worker is killed.
    """

    def __init__(
        self, setup: dict[str, Any], workers: int, time_limit_s: float, log: Path | None = None, keep: bool = False
    ) -> None:
        self.setup, self.workers, self.time_limit_s, self.log, self.keep = setup, workers, time_limit_s, log, keep
        self.children: dict[int, Child] = {}

    def close(self) -> None:
        """End the workers that were kept for further jobs."""
        while self.children:
            self.children.popitem()[1].kill()

    def events(self, jobs: Iterable[Job]) -> Iterator[Event]:
        """Hand out jobs; those that share a recording go to one worker, one after the other.

        Raises:
            WorkersFail: when workers cannot be started.
        """
        waiting = groups(jobs)
        mine: list[deque[Job]] = [deque() for _ in range(self.workers)]
        children, false_starts, idle = self.children, 0, False
        try:
            while True:
                for i in range(self.workers):
                    if (child := children.get(i)) is not None and child.busy:
                        continue
                    if (job := _next(mine, i, waiting)) is None:
                        continue
                    if child is None:
                        children[i] = Child(self.setup, self.time_limit_s, self.log)
                        mine[i].appendleft(job)
                    else:
                        child.send(as_line(job))
                        yield [job.key]
                if not (busy := {i: child for i, child in children.items() if child.busy}):
                    idle = True
                    return
                for i in _speaking(busy):
                    try:
                        outcome = children[i].hear()
                        false_starts = 0
                    except FalseStart:
                        outcome, false_starts = None, false_starts + 1
                        if false_starts == MOST_FALSE_STARTS:
                            raise
                    if children[i].ended or (outcome is not None and outcome.cause == "memory"):
                        children.pop(i).kill()
                    if outcome is not None:
                        yield outcome
                yield None
        finally:
            if not (self.keep and idle):
                self.close()


def _next(mine: list[deque[Job]], i: int, waiting: Iterator[list[Job]]) -> Job | None:
    """The next job of a worker: of its own group, of a new one, or at the end the last of somebody else's."""
    if not mine[i]:
        mine[i].extend(next(waiting, []))
    if mine[i]:
        return mine[i].popleft()
    longest = max(mine, key=len)
    return longest.pop() if longest else None


def _speaking(busy: dict[int, Child]) -> list[int]:
    """Which children have something to say within the next moment, or are late."""
    left_s = min(child.deadline_s for child in busy.values()) - time.monotonic()
    said = select.select(list(busy.values()), [], [], max(min(left_s, LONGEST_WAIT_S), 0))[0]
    now = time.monotonic()
    return [i for i, child in busy.items() if child in said or child.deadline_s <= now]

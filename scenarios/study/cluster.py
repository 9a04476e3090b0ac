"""The same runs on a Dask cluster: each of its worker threads keeps one process of ours, which may die as anywhere."""

from __future__ import annotations

import json
import queue
import re
import threading
from collections.abc import Iterable, Iterator
from contextlib import suppress
from hashlib import sha256
from typing import Any

from scenarios.document import BadInput
from scenarios.study.child import Child, FalseStart, WorkersFail, run_one
from scenarios.study.engine import MOST_FALSE_STARTS, Event, as_line, groups
from scenarios.study.ledger import Job, Outcome

ADDRESS = re.compile(r"(tcp|tls)://[^\s/:]+:\d{1,5}|(tcp|tls)://\[[0-9a-fA-F:]+\]:\d{1,5}")
CONNECT_S, FIRST_WORKER_S, LOOK_S = 10.0, 60.0, 2.0
IN_FLIGHT_EACH = 2  # groups a worker thread: one at work, one at hand

_SETUPS: dict[str, tuple[dict[str, Any], float]] = {}
_KEPT = threading.local()
_CHILDREN: list[Child] = []


class Cluster:
    """An engine on a scheduler and workers that somebody started.

    The scheduler sees a task for each group of runs that share a recording, of some hundred bytes, and no more of them
    at a time than keep every worker busy. When a Dask worker dies its tasks go to another one.
    """

    def __init__(self, address: str, setup: dict[str, Any], time_limit_s: float) -> None:
        if not ADDRESS.fullmatch(address):
            raise BadInput([f"--dask: got {address[:60]!r}; give it as tcp://HOST:PORT"])
        self.address, self.setup, self.time_limit_s = address, setup, time_limit_s
        self.name = sha256(json.dumps([setup, time_limit_s], sort_keys=True).encode()).hexdigest()[:16]

    def events(self, jobs: Iterable[Job]) -> Iterator[Event]:
        """Hand out jobs as workers become free.

        Raises:
            BadInput: when the scheduler cannot be reached, or Dask is not installed.
            WorkersFail: when it goes away, no worker joins, or the workers run other code.
        """
        client = _connected(self.address)
        try:
            with _lost_said(self.address):
                client.wait_for_workers(1, timeout=FIRST_WORKER_S)
                client.register_plugin(_plugin(self.name, self.setup, self.time_limit_s))
            yield from self._hand_out(client, groups(jobs))
        finally:
            if client.status == "running":  # what we leave on a cluster that is gone ends with its workers
                with suppress(Exception):
                    client.unregister_worker_plugin(self.name)
            with suppress(Exception):
                client.close(timeout=2)

    def _hand_out(self, client: Any, waiting: Iterator[list[Job]]) -> Iterator[Event]:
        answers: queue.Queue = queue.Queue()
        flying: dict[Any, list[Job]] = {}
        exhausted = False
        while True:
            room = IN_FLIGHT_EACH * max(sum(client.nthreads().values()), 1) if not exhausted else 0
            while len(flying) < room:
                if not (group := next(waiting, [])):
                    exhausted = True
                    break
                lines = [as_line(job) for job in group]
                future = client.submit(make_group, self.name, lines, key=f"pipetwin-{group[0].key}", pure=False)
                flying[future] = group
                future.add_done_callback(answers.put)
                yield [job.key for job in group]
            if exhausted and not flying:
                return
            for future in _done(answers):
                yield from _outcomes(future, flying.pop(future))
            if client.status != "running":
                raise WorkersFail(f"{self.address}: the scheduler went away; the same command goes on when it is back")
            yield None


def _connected(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise BadInput(["--dask: needs Dask; pip install 'pipetwin[cluster]'"]) from error
    try:
        return Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise BadInput([f"--dask {address}: no scheduler answers there within {CONNECT_S:g} s"]) from error


def _plugin(name: str, setup: dict[str, Any], time_limit_s: float) -> Any:
    from scenarios.study.dask_plugin import Recipe

    return Recipe(name, setup, time_limit_s)


class _lost_said:  # noqa: N801  used as a verb
    """Dask's errors while setting up, in words."""

    def __init__(self, address: str) -> None:
        self.address = address

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, TimeoutError):
            raise WorkersFail(f"{self.address}: no worker has joined the scheduler within {FIRST_WORKER_S:g} s")
        if isinstance(error, OSError):
            raise WorkersFail(f"{self.address}: the scheduler went away: {error}")


def _done(answers: queue.Queue) -> Iterator[Any]:
    with suppress(queue.Empty):
        yield answers.get(timeout=LOOK_S)
        while True:
            yield answers.get_nowait()


def _outcomes(future: Any, group: list[Job]) -> Iterator[Outcome]:
    """What became of a group; a task that Dask gave up (its workers kept dying) is each of its runs' failure."""
    if future.status == "finished":
        for said in future.result():
            yield Outcome(**said)
        return
    if future.status == "cancelled":
        raise WorkersFail("the scheduler dropped what it was given; the same command goes on when it is back")
    error = future.exception()
    if isinstance(error, WorkersFail):
        raise error
    for job in group:
        yield Outcome(job.key, 0.0, cause="killed", error=f"Dask gave it up: {str(error).splitlines()[0][:200]}")


# ---- on the workers


def learn(name: str, setup: dict[str, Any], time_limit_s: float) -> None:
    """Keep what a study needs, in a Dask worker."""
    _SETUPS[name] = setup, time_limit_s


def forget(name: str) -> None:
    """End the processes of a study, in a Dask worker."""
    _SETUPS.pop(name, None)
    for child in [child for child in _CHILDREN if child.study == name]:
        _CHILDREN.remove(child)
        child.kill()


def make_group(name: str, lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Make runs one after the other in this thread's own process, in a Dask worker."""
    outcomes = []
    for line in lines:
        for attempt in range(1, MOST_FALSE_STARTS + 1):
            try:
                child = _child(name)
                outcomes.append(run_one(child, line)._asdict())
                if outcomes[-1]["cause"] == "memory":
                    child.kill()
                break
            except FalseStart:
                if attempt == MOST_FALSE_STARTS:
                    raise
    return outcomes


def _child(name: str) -> Child:
    """The process of this thread, a new one when it ended or served another study."""
    child: Child | None = getattr(_KEPT, "child", None)
    if child is not None and (child.ended or child.study != name):
        child.kill()
        if child in _CHILDREN:
            _CHILDREN.remove(child)
        child = None
    if child is None:
        setup, time_limit_s = _SETUPS[name]
        child = _KEPT.child = Child(setup, time_limit_s, study=name)
        _CHILDREN.append(child)
    return child

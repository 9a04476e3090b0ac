"""One worker process as its keeper sees it: jobs in, answers out, and an end that never goes unnoticed."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from scenarios.study.ledger import Outcome

ROOT = Path(__file__).resolve().parents[2]
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
STARTS_WITHIN_S = 300.0
CHUNK = 1 << 16
PATIENCE_S = 0.2


class WorkersFail(RuntimeError):
    """No worker can be started; the message says why."""


class FalseStart(WorkersFail):
    """One worker ended before it could do anything; the next may do better."""


class Child:
    """A worker with at most one job at a time; killed for good when it is late."""

    def __init__(self, setup: dict[str, Any], time_limit_s: float, log: Path | None = None, study: str = "") -> None:
        self.setup, self.time_limit_s, self.log, self.study = setup, time_limit_s, log, study
        self.ready, self.key = False, ""
        self.since_s = time.monotonic()
        self._buffer = b""
        with open(log or os.devnull, "ab") as said:  # noqa: PTH123  a log, or nowhere
            self.process = subprocess.Popen(  # noqa: S603  our own program
                # -P: a folder the user stands in must not shadow the program's own modules
                [sys.executable, "-P", "-m", "scenarios.study.worker", str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=said,
                env=_environment(),
            )
        self._write(setup)

    def fileno(self) -> int:
        """What tells when an answer is there."""
        assert self.process.stdout is not None  # noqa: S101  it is a pipe
        return self.process.stdout.fileno()

    @property
    def busy(self) -> bool:
        """Whether it is starting, or at a job."""
        return not self.ready or bool(self.key)

    @property
    def ended(self) -> bool:
        """Whether the process is no more."""
        return self.process.returncode is not None

    @property
    def deadline_s(self) -> float:
        """When the job, or the start, has taken too long; monotonic."""
        if not self.busy:
            return float("inf")
        return self.since_s + (self.time_limit_s if self.ready else STARTS_WITHIN_S)

    def send(self, job: dict[str, Any]) -> None:
        """Give it a job."""
        self.key, self.since_s = job["key"], time.monotonic()
        self._write(job)

    def hear(self, patience_s: float = 0.0) -> Outcome | None:
        """What has become of its job, if that is known by now; a child that is late is ended.

        Raises:
            FalseStart: when it ended, or was late, before it was ready.
            WorkersFail: when it must not take part.
        """
        if select.select([self], [], [], patience_s)[0]:
            return self._heard()
        return self._late() if self.deadline_s <= time.monotonic() else None

    def _heard(self) -> Outcome | None:
        chunk = os.read(self.fileno(), CHUNK)
        if not chunk:
            return self._ended()
        self._buffer += chunk
        line, newline, rest = self._buffer.partition(b"\n")
        if not newline:
            return None
        self._buffer = rest
        said = json.loads(line)
        if "unfit" in said:
            raise WorkersFail(f"a worker cannot take part: {said['unfit']}")
        if "ready" in said:
            self.ready = True
            return None
        key, self.key = self.key, ""
        return Outcome(key, **{name: value for name, value in said.items() if name != "key"})

    def _late(self) -> Outcome | None:
        self.kill()
        if not self.ready:
            raise FalseStart(f"a worker did not start within {STARTS_WITHIN_S:g} s{self._last_words()}")
        return self._lost("time", f"took more than the time limit of {self.time_limit_s:g} s")

    def kill(self) -> None:
        """End it at once."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with suppress(BrokenPipeError):
                    pipe.close()

    def _ended(self) -> Outcome | None:
        status = self.process.wait()
        self.kill()
        if not self.ready:
            raise FalseStart(f"a worker ended as it started ({_status(status)}){self._last_words()}")
        return self._lost("killed", f"its worker ended: {_status(status)}") if self.key else None

    def _lost(self, cause: str, error: str) -> Outcome | None:
        key, self.key = self.key, ""
        return Outcome(key, round(time.monotonic() - self.since_s, 3), cause=cause, error=error) if key else None

    def _write(self, what: dict[str, Any]) -> None:
        assert self.process.stdin is not None  # noqa: S101  it is a pipe
        with suppress(BrokenPipeError):  # its end is noticed where answers are read
            self.process.stdin.write(json.dumps(what).encode() + b"\n")
            self.process.stdin.flush()

    def _last_words(self) -> str:
        if self.log is None or not self.log.is_file():
            return ""
        with self.log.open("rb") as said:
            said.seek(max(self.log.stat().st_size - 2000, 0))
            lines = said.read().decode(errors="replace").split("\n")
        words = [line for line in lines if line.strip()]
        return f": {words[-1].strip()}" if words else ""


def run_one(child: Child, job: dict[str, Any]) -> Outcome:
    """Have a child make one run, and wait for it; who keeps several waits for all of them at once instead."""
    while not child.ready:
        child.hear(PATIENCE_S)
    child.send(job)
    while (outcome := child.hear(PATIENCE_S)) is None:
        pass
    return outcome


def _environment() -> dict[str, str]:
    """Ours, with this very program to import, and one thread a worker: workers share the cores already."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    return {**os.environ, "PYTHONPATH": path, **dict.fromkeys(ONE_THREAD, "1")}


def _status(status: int) -> str:
    if status == -9:
        return "killed by signal 9, as for want of memory or by hand"
    return f"killed by signal {-status}" if status < 0 else f"exit status {status}"

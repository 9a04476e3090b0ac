"""The process that makes runs: jobs come as lines of JSON on its input, what became of them goes out the same way."""

from __future__ import annotations

import errno
import json
import os
import resource
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO

LONGEST_ERROR = 500
MB = 2**20

MakeRun = Callable[[Any], tuple[list[Any], list[list[float]]]]


def main() -> None:
    """Serve until the input ends."""
    # what any library prints goes to the log and cannot mix with the answers
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    parent = int(sys.argv[1])
    from sensor_model.workers import die_with_parent

    die_with_parent()
    if os.getppid() != parent:
        return  # it died before the kernel was asked to tell
    _first_to_go()
    for stop in (signal.SIGINT, signal.SIGTERM):  # to a whole group; they are the parent's to answer
        signal.signal(stop, signal.SIG_IGN)
    serve(sys.stdin, answers)


def _first_to_go() -> None:
    """Where memory runs out, the kernel shall end a worker and not the parent."""
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("500")


def serve(jobs: TextIO, answers: TextIO) -> None:
    """Set up from the first line, then make the run of every further line."""
    setup = json.loads(jobs.readline() or "{}")
    if not setup:
        return
    if (unfit := _unfit(setup)) is not None:
        _say(answers, {"unfit": unfit})
        return
    if setup["memory_limit_mb"]:
        resource.setrlimit(resource.RLIMIT_DATA, (setup["memory_limit_mb"] * MB, resource.RLIM_INFINITY))
    make = run_function(setup)
    _say(answers, {"ready": os.getpid()})
    for line in jobs:
        _say(answers, outcome(make, json.loads(line)))


def run_function(setup: dict[str, Any]) -> MakeRun:
    """The function that makes a run, which the program (never a file) names, prepared for this study."""
    module, name = setup["make"].split(":")
    return getattr(import_module(module), name)(setup["recipe"])


def outcome(make: MakeRun, job: dict[str, Any]) -> dict[str, Any]:
    """What became of one run; an error is an answer like any other."""
    start = time.perf_counter()
    said: dict[str, Any] = {"key": job["key"]}
    try:
        said["figures"], said["defects"] = make(job)
        json.dumps(said, allow_nan=False)
    except MemoryError:
        said = {"key": job["key"], "cause": "memory", "error": "ran out of memory"}
    except Exception as error:
        full = getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT)
        said = {"key": job["key"], "cause": "disk" if full else "raised", "error": _words(error)}
    return {**said, "seconds": time.perf_counter() - start}


def _words(error: Exception) -> str:
    words = str(error).splitlines()
    known = type(error).__module__.split(".")[0] in ("twin", "sensor_model", "algorithms", "scenarios")
    text = words[0] if words and known else f"{type(error).__name__}: {words[0] if words else 'no words'}"
    return text[:LONGEST_ERROR]


def _unfit(setup: dict[str, Any]) -> str | None:
    """Why this process cannot make the study's runs: it would come to other numbers."""
    from scenarios.study.code import code_version

    ours, theirs = code_version(), setup["recipe"]["code"]
    return None if ours == theirs else f"it runs other code ({ours}) than the study was planned with ({theirs})"


def _say(answers: TextIO, what: dict[str, Any]) -> None:
    answers.write(json.dumps(what) + "\n")
    answers.flush()


if __name__ == "__main__":
    main()

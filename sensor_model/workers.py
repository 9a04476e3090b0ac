"""Work spread over processes that die with their parent; results come back in order, whatever the number of workers."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
from collections.abc import Callable, Iterable, Iterator
from typing import Any

PR_SET_PDEATHSIG = 1  # linux/prctl.h


def spread(
    function: Callable[..., Any], jobs: Iterable[tuple], workers: int, peaks_kb: dict[int, int] | None = None
) -> Iterator[Any]:
    """Call a function on every job's arguments and yield the results in the jobs' order; jobs are taken as needed.

    `peaks_kb` takes the peak memory of each worker so far, by its process number.
    """
    if workers == 1:
        for job in jobs:
            yield function(*job)
        return
    from joblib import Parallel, delayed

    parallel = Parallel(n_jobs=workers, return_as="generator", pre_dispatch="4*n_jobs", batch_size=1)
    for result, worker, peak_kb in parallel(delayed(_mortal)(function, job) for job in jobs):
        if peaks_kb is not None:
            peaks_kb[worker] = peak_kb
        yield result


def die_with_parent() -> None:
    """Have the kernel kill this process when the thread that started it ends, however that comes about."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _mortal(function: Callable[..., Any], job: tuple) -> tuple[Any, int, int]:
    die_with_parent()
    import cv2

    cv2.setNumThreads(1)
    result = function(*job)
    return result, os.getpid(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

"""Frames of a live log looked at by workers, in order; what each showed is kept on disk, so that a restart goes on."""

from __future__ import annotations

import json
import os
import time
from collections import deque
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np

from algorithms.decode import decode
from algorithms.method import Method
from scenarios.field.live_log import Due
from scenarios.field.look import Look, look
from sensor_model.recording import BadRecording, SlitPixels, read_frame, write_slit_pixels
from sensor_model.rig import Rig
from sensor_model.workers import die_with_parent

AHEAD = 3  # frames in the workers' hands, for each of them
LARGEST_FACTS_BYTES = 4096


class Shown(NamedTuple):
    """A frame, what it showed, whether an earlier life had looked at it, and when it was written (s since 1970).

    `written_s` is NaN for a frame that was there before anybody followed.
    """

    due: Due
    look: Look
    kept: bool
    written_s: float


@dataclass
class Eyes:
    """The workers, and the frames that are with them."""

    folder: Path
    rig: Rig
    method: Method
    pool: Executor
    workers: int
    began_s: float
    waiting: deque[tuple[Due, Future | Look, float]] = field(default_factory=deque)

    @property
    def full(self) -> bool:
        """Whether the workers have enough to do."""
        return len(self.waiting) >= AHEAD * self.workers


def open_eyes(folder: Path, rig: Rig, method: Method, workers: int) -> Eyes:
    """Start the workers, and have them ready before the first frame."""
    folder.mkdir(parents=True, exist_ok=True)
    pool = ProcessPoolExecutor(workers, get_context("spawn"), _begin, (rig, method))
    for ready in [pool.submit(_ready) for _ in range(workers)]:
        ready.result()
    return Eyes(folder, rig, method, pool, workers, time.time())


def _begin(rig: Rig, method: Method) -> None:
    """Have all that is compiled loaded: the first frame is no later than the others."""
    die_with_parent()
    import cv2

    cv2.setNumThreads(1)
    decode(np.zeros((rig.camera.height_px, rig.camera.width_px, 3), dtype=np.uint8), rig, method.decode)


def _ready() -> None:
    time.sleep(0.05)  # so long that no worker answers for another


def hand_over(eyes: Eyes, due: Due) -> None:
    """Have a frame looked at, unless it was before."""
    kept = _kept(eyes, due)
    if kept is not None:
        eyes.waiting.append((due, kept, float("nan")))
        return
    written_s = due.file.stat().st_mtime if due.file.exists() else time.time()
    written_s = written_s if written_s >= eyes.began_s else float("nan")
    eyes.waiting.append((due, eyes.pool.submit(_look, eyes.folder, due, eyes.rig, eyes.method), written_s))


def next_shown(eyes: Eyes) -> Shown | None:
    """The oldest frame, if its worker is done with it."""
    if not eyes.waiting:
        return None
    due, what, written_s = eyes.waiting[0]
    if isinstance(what, Future) and not what.done():
        return None
    eyes.waiting.popleft()
    return Shown(due, what.result() if isinstance(what, Future) else what, isinstance(what, Look), written_s)


def close_eyes(eyes: Eyes) -> None:
    """Let the workers go."""
    eyes.pool.shutdown(wait=True, cancel_futures=True)


def _look(folder: Path, due: Due, rig: Rig, method: Method) -> Look:
    """Look at a frame, and keep what it showed: the slits first, then the line that says that they are whole."""
    shown = look(due.file, due.frame.index, rig, method)
    slits, facts = _files(folder, due)
    work = slits.with_suffix(f".{os.getpid()}.npy")
    write_slit_pixels(work, shown.seen)
    work.replace(slits)
    exposure = [None if value != value else value for value in (shown.level, shown.full_share, shown.black_share)]
    text = json.dumps({"digest": shown.digest.hex(), "exposure": exposure, "fault": shown.fault[:2000]})
    work = facts.with_suffix(f".{os.getpid()}")
    work.write_text(text)
    work.replace(facts)
    return shown


def _files(folder: Path, due: Due) -> tuple[Path, Path]:
    return folder / f"{due.frame.stamp_ns}.npy", folder / f"{due.frame.stamp_ns}.json"


def _kept(eyes: Eyes, due: Due) -> Look | None:
    """What an earlier life saw in a frame; None where it did not come to it, or left something else."""
    slits, facts = _files(eyes.folder, due)
    if not facts.is_file() or facts.stat().st_size > LARGEST_FACTS_BYTES:
        return None
    try:
        seen = read_frame(slits, eyes.rig)
        said = json.loads(facts.read_text())
        level, full, black = (float("nan") if value is None else float(value) for value in said["exposure"])
        digest, fault = bytes.fromhex(said["digest"]), str(said["fault"])
    except (BadRecording, OSError, ValueError, KeyError, TypeError, RecursionError):
        return None  # it is looked at again
    return Look(seen, digest, level, full, black, fault) if isinstance(seen, SlitPixels) else None

"""A log followed while it is written: state, wall map and defects as frames come; stopped and started, it goes on."""

from __future__ import annotations

import json
import shutil
import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from algorithms.closed_blocks import copied
from algorithms.method import Method
from algorithms.reconstruct import State, begin, sized, step, trajectory
from algorithms.types import Reconstruction
from algorithms.wall_map import MapBuilder, MapTorn, finish_map
from scenarios.document import BadInput
from scenarios.field.live_eyes import Eyes, Shown, close_eyes, hand_over, next_shown, open_eyes
from scenarios.field.live_log import LiveLog, next_due, open_live, read_more
from scenarios.field.live_page import Live, Server, live_page, serve
from scenarios.field.look import Watched, begin_watch, watch
from scenarios.field.read import read_log
from scenarios.field.replay import Replay, concluded, sample_indices, write_about, write_replay
from scenarios.field.told import Told
from scenarios.run import Report, Sample
from scenarios.run_folder import run_folder
from sensor_model.recording import BadRecording, read_frame

POLL_S = 0.004
SHOW_EVERY_S, SHOW_SHARE = 2.0, 0.03  # from page to page, and how much of the time one may take
LATE_PERIODS = 2.0
MOST_TIMES = 2000


@dataclass
class Followed:
    """What is carried along: the measurement's state, what was noticed, and how timely all of it was."""

    log: LiveLog
    state: State
    watched: Watched
    shown: int = 0
    looked: int = 0
    live: int = 0
    late: int = 0
    waits_s: deque[float] = field(default_factory=lambda: deque(maxlen=MOST_TIMES))


@dataclass
class Easel:
    """The local page, who draws it, and when it is due again."""

    server: Server
    artist: ThreadPoolExecutor
    page: Future[float] | None = None
    due_s: float = 0.0


def follow(folder: Path, method: Method, out: Path, workers: int, port: int, idle_s: float, progress: Report) -> Replay:
    """Follow a recording to its end, show it on a local page, and leave what `replay` would.

    It ends when its writer says so (a line `# end` in `cam0/data.csv`), or after so long a silence.

    Raises:
        BadInput: when nothing can be followed there.
        RunFailed: when a stage fails.
    """
    kept = _kept_folder(out, folder, method)
    log = _opened(folder, idle_s)
    eyes = open_eyes(kept / "slits", log.rig, method, workers)
    server = serve(port)
    progress(f"live at {server.address}", 0, 0)
    followed = Followed(log, begin(log.rig, log.pipe, method), begin_watch(log.rig))
    try:
        with ThreadPoolExecutor(1) as artist:
            _fold(followed, eyes, Easel(server, artist), idle_s, progress)
        result = _written(followed, eyes, out, progress)
    except BadRecording as error:
        raise BadInput([str(error)]) from error
    finally:
        close_eyes(eyes)
        server.close()
    shutil.rmtree(kept)
    return result


def _kept_folder(out: Path, folder: Path, method: Method) -> Path:
    """Where a life leaves to the next what it saw; of another log or by another method it is of no use."""
    kept, same = out.with_name(f"{out.name}.live"), json.dumps([str(folder.resolve()), method.model_dump(mode="json")])
    mark = kept / "of.json"
    if kept.is_symlink() or (kept.exists() and not mark.is_file()):
        raise BadInput([f"{kept}: is there already, and no live replay left it; remove it, or choose another with -o"])
    if mark.is_file() and mark.read_text() != same:
        raise BadInput([f"{kept}: belongs to another log or method; remove it, or choose another with -o"])
    kept.mkdir(parents=True, exist_ok=True)
    mark.write_text(same)
    return kept


def _opened(folder: Path, idle_s: float) -> LiveLog:
    """The log, waited for if need be."""
    since = time.monotonic()
    while True:
        inside = folder / "recording"
        try:
            log = open_live(inside if inside.is_dir() else folder)
        except BadRecording as error:
            raise BadInput([str(error)]) from error
        if log is not None:
            return log
        if time.monotonic() - since > idle_s:
            raise BadInput([f"{folder}: no rig.yaml and pipe.yaml came within {idle_s:g} s; give a recording's folder"])
        time.sleep(POLL_S)


def _fold(followed: Followed, eyes: Eyes, easel: Easel, idle_s: float, progress: Report) -> None:
    """Take frames in until the log ends."""
    log, quiet_since = followed.log, time.monotonic()
    while True:
        if read_more(log):
            quiet_since = time.monotonic()
        over = log.ended or time.monotonic() - quiet_since > idle_s
        while not eyes.full and (due := next_due(log, over)) is not None:
            hand_over(eyes, due)
        shown = next_shown(eyes)
        if shown is not None:
            _take(followed, shown)
            progress("live", followed.shown, followed.shown + len(eyes.waiting) + len(log.waiting) + 1)
            quiet_since = time.monotonic()
        elif over and not eyes.waiting and not log.waiting and not read_more(log):
            return
        else:
            time.sleep(POLL_S)
        if followed.shown:
            _show(easel, followed)


def _show(easel: Easel, followed: Followed) -> None:
    """Have the page made anew while frames go on, some time after the last one was done."""
    if easel.page is not None and easel.page.done():
        easel.due_s = time.monotonic() + max(SHOW_EVERY_S, easel.page.result() / SHOW_SHARE)
        easel.page = None
    if easel.page is None and time.monotonic() >= easel.due_s:
        easel.page = easel.artist.submit(_draw, easel.server, *_so_far(followed))


def _draw(server: Server, live: Live, state: State) -> float:
    """Measure a moment and show it; the processor's time that took, s."""
    began = time.thread_time()
    found, why = _measured(state)
    server.show(live_page(live._replace(found=found, why=why)))
    return time.thread_time() - began


def _take(followed: Followed, shown: Shown) -> None:
    """One frame into the state."""
    result = step(followed.state, shown.due.frame, shown.look.seen)
    rig, azimuths = followed.log.rig, followed.state.method.decode.azimuths
    watch(followed.watched, shown.look, result, rig, azimuths)
    followed.shown += 1
    followed.looked += not shown.kept
    if np.isfinite(shown.written_s):
        wait_s = time.time() - shown.written_s
        stamps = [one.stamp_ns for one in followed.state.results[-2:]]
        period_s = (stamps[-1] - stamps[0]) / 1e9 if len(stamps) == 2 else np.inf
        followed.waits_s.append(wait_s)
        followed.live += 1
        followed.late += bool(wait_s > LATE_PERIODS * period_s)


def _timely(followed: Followed) -> dict[str, float | int | None]:
    """How timely the frames were that came while it was followed."""
    waits = np.array(followed.waits_s)
    middle, most = (round(float(np.percentile(waits, q)), 4) if waits.size else None for q in (50, 99))
    return {
        "looked_at": followed.looked,
        "frames": followed.live,
        "late": followed.late,
        "wait_s_median": middle,
        "wait_s_99_pct": most,
    }


def _so_far(followed: Followed) -> tuple[Live, State]:
    """What is known at this moment, and a state to measure it from, which the one that goes on does not touch."""
    state, latest = followed.state, followed.state.results[-1]
    waits, builder = np.array(followed.waits_s), state.builder
    copy = MapBuilder(builder.settings, {b: list(p) for b, p in builder.waiting.items()}, copied(builder.done))
    live = Live(
        frames=followed.shown,
        distance_mm=float(latest.alignment.T_pipe_camera[2, 3]),
        decode_yield=latest.decode_yield,
        reason=latest.alignment.reason,
        late_share=followed.late / max(followed.live, 1),
        wait_s=float(np.median(waits)) if waits.size else float("nan"),
        unreadable=sum(1 for fault in followed.watched.fault if fault),
        found=None,
        why="",
    )
    return live, replace(state, builder=copy, results=[latest])


def _measured(state: State) -> tuple[Reconstruction | None, str]:
    """Wall map and defects of the frames so far."""
    try:
        wall = finish_map(state.builder)
    except MapTorn as error:
        return None, str(error)
    if wall.touched().stop == 0:
        return None, state.results[-1].alignment.reason or "no point lies where a wall can be"
    return sized(trajectory(state.results), wall, state.rig, state.pipe, state.method), ""


def _written(followed: Followed, eyes: Eyes, out: Path, progress: Report) -> Replay:
    """The folder that `replay` would have left."""
    log = followed.log
    with run_folder(out) as folder:
        recording, remarks = read_log(log.folder, Told(), folder / "recording", progress)
        samples = tuple(_sample(followed, eyes, index) for index in sample_indices(len(recording)))
        result = concluded(recording, followed.state, followed.watched, samples, remarks)
        write_replay(result, followed.state.method, log.folder.name, folder, {})
        write_about(log.folder, {"live": _timely(followed)}, folder)
    return replace(result, recording=replace(result.recording, folder=out / "recording"))


def _sample(followed: Followed, eyes: Eyes, index: int) -> Sample:
    """A frame for the page, with the slits that were kept of it."""
    result = followed.state.results[index]
    seen = read_frame(eyes.folder / f"{result.stamp_ns}.npy", followed.log.rig)
    return Sample(index, float(result.alignment.T_pipe_camera[2, 3]), seen)  # type: ignore[arg-type]

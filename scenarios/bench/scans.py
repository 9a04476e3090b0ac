"""Whole recordings: each sensed and decoded once, then registered frame by frame by every method of the bench."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from algorithms.method import Method
from algorithms.reconstruct import begin, register, see
from algorithms.triangulate import triangulate
from algorithms.types import Alignment, RingPoints
from algorithms.wall_map import on_a_wall
from scenarios.bench.clouds import MOST_POINTS, Cloud
from scenarios.bench.errors import FrameError, frame_error
from scenarios.run import RunFailed, sensed, true_poses
from scenarios.scenario import Scenario
from scenarios.score import FrameTally, placed, tally_shape
from sensor_model.geometry import apply
from sensor_model.recording import Recording, SlitPixels, open_recording
from sensor_model.rig import Rig
from sensor_model.streams import stream
from sensor_model.workers import spread
from twin.simulate import DriveFailed, simulate
from twin.truth import Truth

Report = Callable[[str, int, int], None]
WARM_UP = 3  # frames: the first compiles, the second finds a map, the third is like all others


@dataclass(frozen=True)
class Scan:
    """One drive as the sensor saw it, held in memory: the recording's logs, its slit pixels, and what really was."""

    scenario: Scenario
    truth: Truth
    recording: Recording
    seen: tuple[SlitPixels, ...]
    T_true: Float[np.ndarray, "frames 4 4"]


class Registered(NamedTuple):
    """One frame by one method, and the milliseconds that its registration took."""

    number: int
    points: RingPoints
    alignment: Alignment
    ms: float


class Judged(NamedTuple):
    """All frames of a scan by one method: errors against the truth, and the paper's circles and planes."""

    errors: list[FrameError]
    tally: FrameTally
    travel_mm: float


def take_scan(scenario: Scenario, workers: int, progress: Report) -> Scan:
    """Simulate, sense and decode; what was written on the way is gone when this returns.

    Raises:
        RunFailed: when a stage fails.
    """
    try:
        truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(scenario.seed, "drive"))
        with TemporaryDirectory(prefix="pipetwin-") as folder:
            sensed(scenario, truth, Path(folder), workers, {}, progress)
            recording = open_recording(Path(folder))
            ahead = 1 if scenario.sensing.fidelity == "points" else workers
            jobs = ((recording, index, scenario.method) for index in range(len(recording)))
            seen = []
            for pixels in spread(_seen, jobs, ahead):
                seen.append(pixels)
                progress("decode", len(seen), len(recording))
    except (DriveFailed, ValueError, OSError) as error:
        raise RunFailed(f"{scenario.name}: {error}") from error
    return Scan(scenario, truth, recording, tuple(seen), true_poses(truth, recording))


def _seen(recording: Recording, index: int, method: Method) -> SlitPixels:
    return see(recording[index], recording.rig, method)


def triangulated(scan: Scan, rig: Rig | None = None) -> tuple[RingPoints, ...]:
    """The points of every frame, by the rig that goes with the recording or by another."""
    return tuple(triangulate(pixels, rig or scan.recording.rig) for pixels in scan.seen)


def registered(
    scan: Scan, points: tuple[RingPoints, ...], settings: Any, rig: Rig | None = None
) -> Iterator[Registered]:
    """Every frame by one method from the first on, each with the prior that odometry and IMU give it."""
    method = scan.scenario.method.model_copy(update={"registration": settings})
    state = begin(rig or scan.recording.rig, scan.recording.pipe, method)
    for index, frame_points in enumerate(points):
        frame = scan.recording.frame(index)
        start = time.perf_counter()
        alignment = register(state, frame, frame_points)
        yield Registered(index, frame_points, alignment, (time.perf_counter() - start) * 1e3)


def warm_up(scan: Scan, points: tuple[RingPoints, ...], settings: Any) -> None:
    """Let a method compile, on the scan's first frames, before anybody looks at the clock."""
    for _ in registered(scan, points[:WARM_UP], settings):
        pass


def judge(scan: Scan, label: str, frames: Iterator[Registered]) -> Judged:
    """Each frame's errors, and its circle and plane.

    Which points are false slits, and which lie on a defect, is told by the TRUE pose, alike for all methods.
    """
    pipe, nominal = scan.truth.pipe, scan.recording.pipe
    tally = FrameTally(pipe, scan.scenario.true_rig or scan.scenario.rig, optics=scan.scenario.sensing.optics)
    errors = []
    for index, points, found, ms in frames:
        T_true = scan.T_true[index]
        errors.append(
            frame_error(scan.scenario.name, scan.scenario.seed, index, label, found, T_true, pipe.bore_radius_mm, ms)
        )
        if found.converged:
            kept = on_a_wall(points, T_true, nominal)
            xyz, walls = placed(points.xyz_mm, kept, T_true, tally.outlines, pipe.bore_radius_mm)
            tally_shape(tally, apply(found.T_pipe_camera @ np.linalg.inv(T_true), xyz), walls)
    return Judged(errors, tally, float(np.ptp(scan.T_true[:, 2, 3])))


def as_placed(scan: Scan, frame: Registered) -> Float[np.ndarray, "n 3"]:
    """A frame's points where a method put them (pipe frame), without false slits, which the TRUE pose tells."""
    real = on_a_wall(frame.points, scan.T_true[frame.number], scan.recording.pipe)
    return apply(frame.alignment.T_pipe_camera, frame.points.xyz_mm[real])


def scan_errors(
    scenario: Scenario, seed: int, methods: Mapping[str, Any], workers: int, progress: Report
) -> Iterator[tuple[list[FrameError], Cloud]]:
    """For every method, the errors of every frame of one recording, and the cloud; `methods` are settings by label."""
    scan = take_scan(scenario.model_copy(update={"seed": seed}), workers, progress)
    points, bore = triangulated(scan), scan.truth.pipe.bore_radius_mm
    step = max(sum(frame.sigma_mm.size for frame in points) // MOST_POINTS, 1)
    for label, settings in methods.items():
        warm_up(scan, points, settings)
        errors, parts = [], [np.zeros((0, 3))]
        for frame in registered(scan, points, settings):
            T_true, found = scan.T_true[frame.number], frame.alignment
            errors.append(frame_error(scenario.name, seed, frame.number, label, found, T_true, bore, frame.ms))
            if found.converged:
                parts.append(as_placed(scan, frame)[frame.number % step :: step])
            progress(label, frame.number + 1, len(points))
        yield errors, Cloud(scenario.name, label, np.concatenate(parts), bore)

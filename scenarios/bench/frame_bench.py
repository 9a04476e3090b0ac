"""Methods side by side on synthetic frames: the same frames, the same priors, one clock."""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from algorithms.registration import REGISTRATIONS
from algorithms.types import Alignment, Wall
from scenarios.bench.errors import FrameError, frame_error
from scenarios.bench.frames import FrameCase, TrueFrame, cramer_rao, draw_pose, make_frame
from sensor_model.geometry import apply, swing_onto, transform
from sensor_model.recording import NominalPipe
from sensor_model.settings import Settings
from sensor_model.streams import stream
from sensor_model.workers import spread

FORWARD = np.array([0.0, 0.0, 1.0])
STEP_MM = 50 / 15  # a frame's travel at the preset robot's speed and the sensor's rate
TURN_DEG, WANDER_DEG, WANDER_MM = 0.3, 0.1, 0.05  # how else the sensor moves between frames, one std
TRAVEL_STD_MM, ROLL_STD_DEG = 0.05, 0.3
WALL_MM = 7.5


def frame_errors(
    cases: dict[str, FrameCase], methods: dict[str, Settings], seeds: int, workers: int
) -> Iterator[FrameError]:
    """Every method on `seeds` frames of every case; the same frames for all, in a fixed order."""
    jobs = ((name, case, seed, methods) for name, case in cases.items() for seed in range(seeds))
    for errors in spread(_one_frame, jobs, workers):
        yield from errors


def _one_frame(name: str, case: FrameCase, seed: int, methods: dict[str, Settings]) -> list[FrameError]:
    before, frame = two_frames(case, seed)
    bound, told = cramer_rao(frame), _told(case)
    errors = []
    for label, settings in methods.items():
        _warmed_up(settings)
        found, ms = timed_alignment(settings, before, frame, told)
        errors.append(frame_error(name, seed, seed, label, found, frame.T_pipe_camera, case.radius_mm, ms, bound))
    return errors


def two_frames(case: FrameCase, seed: int) -> tuple[TrueFrame, TrueFrame]:
    """A frame and the one before it, a step upstream; what is wrong with the wall moves with the sensor."""
    rng = stream(seed, "bench", 0)
    T_pipe_camera = draw_pose(case, rng)
    turn = np.radians(rng.standard_normal(3) * [WANDER_DEG, WANDER_DEG, TURN_DEG])
    shift = np.append(rng.standard_normal(2) * WANDER_MM, -STEP_MM)
    T_before = transform(Rotation.from_rotvec(turn).as_matrix() @ T_pipe_camera[:3, :3], T_pipe_camera[:3, 3] + shift)
    # the same draws for both put the same patch and the same gap into both; only the noise is its own
    first, second = (
        make_frame(case, T, stream(seed, "bench", 1), stream(seed, "bench", 2 + k))
        for k, T in enumerate((T_before, T_pipe_camera))
    )
    return first, second


def _told(case: FrameCase) -> NominalPipe:
    return NominalPipe(inner_radius_mm=case.told_radius_mm, wall_thickness_mm=WALL_MM)


def timed_alignment(
    settings: Settings, before: TrueFrame, frame: TrueFrame, pipe: NominalPipe
) -> tuple[Alignment, float]:
    """Align a frame, and say what it took in ms; a method with a map aligns and maps the frame before it first.

    Travel and roll are told as odometry and IMU would tell them. Centre and tilt are not told: such a method starts
    from what it found in the frame before, the others from the middle of the pipe.
    """
    method = REGISTRATIONS[_kind(settings)]
    wall, prior = Wall(pipe), odometry(frame.T_pipe_camera)
    if method.begin and method.grow:
        wall = Wall(pipe, method.begin(settings))
        first = method.align(before.points, wall, odometry(before.T_pipe_camera), settings)
        if first.converged:
            method.grow(wall.seen, before.points, first)
            prior = _moved(prior, first)
    start = time.perf_counter()
    found = method.align(frame.points, wall, prior, settings)
    return found, 1000 * (time.perf_counter() - start)


def odometry(T_pipe_camera: Float[np.ndarray, "4 4"]) -> Alignment:
    """What odometry and IMU say of a pose: travel and roll, and nothing of centre and tilt."""
    R = T_pipe_camera[:3, :3]
    upright = swing_onto(R @ FORWARD, FORWARD) @ R
    information = np.diag([0.0, 0.0, TRAVEL_STD_MM**-2, 0.0, 0.0, np.radians(ROLL_STD_DEG) ** -2])
    return Alignment(transform(upright, np.array([0.0, 0.0, T_pipe_camera[2, 3]])), information)


def _moved(prior: Alignment, last: Alignment) -> Alignment:
    """The prior with centre and axis as in the frame before, the axis as the camera saw it there."""
    R = prior.T_pipe_camera[:3, :3]
    R = swing_onto(R @ last.T_pipe_camera[2, :3], FORWARD) @ R
    center = np.append(last.T_pipe_camera[:2, 3], prior.T_pipe_camera[2, 3])
    return Alignment(transform(R, center), prior.information)


def _kind(settings: Any) -> str:
    return str(settings.kind)


@cache
def _warmed_up(settings: Settings) -> None:
    """Compile a method, so that no frame's clock holds it."""
    case = FrameCase(points=2_000, defect_share=0.4)
    before, frame = two_frames(case, 0)
    timed_alignment(settings, before, frame, _told(case))


def first_alignments(
    case: FrameCase, methods: dict[str, Settings]
) -> tuple[TrueFrame, dict[str, tuple[Alignment, Float[np.ndarray, "n 3"]]]]:
    """The first frame of a case, each method's alignment of it, and its points where that puts them in the pipe."""
    before, frame = two_frames(case, 0)
    out = {}
    for label, settings in methods.items():
        found, _ = timed_alignment(settings, before, frame, _told(case))
        out[label] = found, apply(found.T_pipe_camera, frame.points.xyz_mm)
    return frame, out

"""The whole measurement: a fold over frames, so that a live robot and a log on disk run the same code."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from algorithms.decode import decode
from algorithms.localisation.odometry import Odometry, advance, launch, predict, settle
from algorithms.method import Method
from algorithms.registration import REGISTRATIONS
from algorithms.registration.fusion import covariance
from algorithms.sizing.background import deviation_mm, noise_mm
from algorithms.sizing.measure import measure_defects
from algorithms.sizing.thresholds import THRESHOLDS
from algorithms.triangulate import triangulate
from algorithms.types import Alignment, FrameResult, Reconstruction, RingPoints, Trajectory, Wall, WallMap
from algorithms.wall_map import MapBuilder, add_points, finish_map, on_a_wall
from sensor_model.recording import Frame, NominalPipe, SlitPixels
from sensor_model.rig import Rig

FORWARD = np.array([0.0, 0.0, 1.0])


class ReconstructionFailed(RuntimeError):
    """The scan gives no wall map; the message says why."""


@dataclass
class State:
    """What is carried from frame to frame."""

    rig: Rig
    pipe: NominalPipe
    method: Method
    builder: MapBuilder
    wall: Wall
    odometry: Odometry | None = None
    results: list[FrameResult] = field(default_factory=list)


def begin(rig: Rig, pipe: NominalPipe, method: Method) -> State:
    """Start a scan."""
    registration = REGISTRATIONS[method.registration.kind]
    seen = registration.begin(method.registration) if registration.begin else None
    return State(rig, pipe, method, MapBuilder(method.map), Wall(pipe, seen))


def see(frame: Frame, rig: Rig, method: Method) -> SlitPixels:
    """The slit pixels of a frame: decoded from its picture, unless it came with them."""
    if frame.slit_pixels is not None:
        return frame.slit_pixels
    if frame.picture is None:
        raise ValueError(f"frame {frame.index} has neither a picture nor slit pixels")
    return decode(frame.picture, rig, method.decode)


def step(state: State, frame: Frame, seen: SlitPixels) -> FrameResult:
    """One frame: triangulate, register, map."""
    points = triangulate(seen, state.rig)
    alignment = register(state, frame, points)
    kept = np.zeros(points.sigma_mm.size, dtype=bool)
    if alignment.converged:
        kept = on_a_wall(points, alignment.T_pipe_camera, state.pipe)
        add_points(state.builder, points, kept, alignment)
    result = FrameResult(frame.index, frame.stamp_ns, points, kept, alignment, decode_yield(points, state))
    # the points live on in the map only
    state.results.append(replace(result, points=_NOTHING, kept=np.zeros(0, dtype=bool)))
    return result


def register(state: State, frame: Frame, points: RingPoints) -> Alignment:
    """One frame's pose: predicted by odometry and IMU, then aligned."""
    registration = REGISTRATIONS[state.method.registration.kind]
    if state.odometry is None:
        state.odometry = _launched(state, frame, points)
    else:
        state.odometry = advance(state.odometry, frame, state.rig, state.method.localisation)
    prior = predict(state.odometry, frame, state.rig, state.method.localisation)
    alignment = registration.align(points, state.wall, prior, state.method.registration)
    if alignment.converged:
        state.odometry = settle(state.odometry, alignment)
        if registration.grow:
            registration.grow(state.wall.seen, points, alignment)
    return alignment


def decode_yield(points: RingPoints, state: State) -> float:
    """Share of all (slit, azimuth) places of the picture in which a slit was seen."""
    camera, azimuths = state.rig.camera, state.method.decode.azimuths
    turn = np.arctan2(points.pixel[:, 0] - camera.cx_px, camera.cy_px - points.pixel[:, 1]) / (2 * np.pi)
    seen = np.zeros((len(state.rig.projector.slits), azimuths), dtype=bool)
    seen[points.ring, np.rint(turn * azimuths).astype(np.int64) % azimuths] = True
    return np.count_nonzero(seen) / seen.size


def _launched(state: State, frame: Frame, points: RingPoints) -> Odometry:
    """Roll by gravity about the pipe's axis, which the first fit gives."""
    settings, align = state.method.localisation, REGISTRATIONS[state.method.registration.kind].align
    level = launch(frame, state.rig, state.pipe.launch_mm, FORWARD, settings)
    first = align(points, state.wall, predict(level, frame, state.rig, settings), state.method.registration)
    if not first.converged:
        return level
    return launch(frame, state.rig, state.pipe.launch_mm, first.T_pipe_camera[2, :3].copy(), settings)


_NOTHING = RingPoints(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0))


def finish(state: State) -> Reconstruction:
    """Close the map and size the defects.

    Raises:
        ReconstructionFailed: when no frame could be registered, with the commonest reason.
    """
    path, wall = mapped(state)
    return sized(path, wall, state.rig, state.pipe, state.method)


def mapped(state: State) -> tuple[Trajectory, WallMap]:
    """Close the map.

    Raises:
        ReconstructionFailed: when no frame could be registered, with the commonest reason.
    """
    if not any(result.alignment.converged for result in state.results):
        reasons = [result.alignment.reason for result in state.results] or ["there are no frames"]
        raise ReconstructionFailed(f"no frame registered: {max(set(reasons), key=reasons.count)}")
    wall = finish_map(state.builder)
    if not wall.seen.any():
        raise ReconstructionFailed("no point lies where a wall can be; check the nominal pipe and the rig")
    return trajectory(state.results), wall


def sized(path: Trajectory, wall: WallMap, rig: Rig, pipe: NominalPipe, method: Method) -> Reconstruction:
    """Size the defects of a closed map."""
    deviation = deviation_mm(wall)
    noise = noise_mm(wall, deviation)
    threshold = THRESHOLDS[method.sizing.threshold.rule](deviation, noise, method.sizing.threshold)
    steepest = float(rig.projector.slit_half_angles_rad[-1])
    defects = measure_defects(wall, deviation, threshold, noise, pipe, steepest, method.sizing)
    return Reconstruction(path, wall, deviation, noise, threshold, defects)


def trajectory(results: list[FrameResult]) -> Trajectory:
    """The path, one row a frame."""
    alignments: list[Alignment] = [result.alignment for result in results]
    return Trajectory(
        stamp_ns=np.array([result.stamp_ns for result in results], dtype=np.int64),
        T_pipe_camera=np.array([a.T_pipe_camera for a in alignments]),
        covariance=np.array([covariance(a.information) for a in alignments]),
        registered=np.array([a.converged for a in alignments]),
        radius_mm=np.array([a.radius_mm for a in alignments]),
        decode_yield=np.array([result.decode_yield for result in results]),
        reason=tuple(a.reason for a in alignments),
    )


def reconstruct(recording: Iterable[Frame], rig: Rig, pipe: NominalPipe, method: Method) -> Reconstruction:
    """The fold over a whole recording."""
    state = begin(rig, pipe, method)
    for frame in recording:
        step(state, frame, see(frame, rig, method))
    return finish(state)

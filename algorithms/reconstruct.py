"""The whole measurement: a fold over frames, so that a live robot and a log on disk run the same code."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from numba import njit

from algorithms.decode import decode
from algorithms.hindsight import ahead_mm, moved_along, moved_results, moves, straightened
from algorithms.localisation import ESTIMATORS, Estimator
from algorithms.method import Method
from algorithms.registration import REGISTRATIONS
from algorithms.registration.fusion import covariance
from algorithms.sizing.background import deviation_mm, noise_of_rows
from algorithms.sizing.measure import measure_defects
from algorithms.sizing.unlit import drop_unlit
from algorithms.triangulate import triangulate
from algorithms.types import Alignment, FrameResult, Reconstruction, RingPoints, Trajectory, Wall, WallMap
from algorithms.wall_map import MapBuilder, MapTorn, add_points, finish_map, on_a_wall, shift_waiting
from sensor_model.geometry import fast_arctan2, turn_of_frame
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
    map_z_mm: list[float] = field(default_factory=list)
    """Where the camera stood, frame by frame, as the map has it."""
    where: Any = None
    """The localisation's own state; None before the first frame."""
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
    return decode(frame.picture, rig, method.decode, frame.index)


def step(state: State, frame: Frame, seen: SlitPixels) -> FrameResult:
    """One frame: triangulate, register, map."""
    points = triangulate(seen, state.rig)
    alignment = register(state, frame, points)
    kept = np.zeros(points.sigma_mm.size, dtype=bool)
    state.map_z_mm.append(float(alignment.T_pipe_camera[2, 3]))
    if alignment.converged:
        kept = on_a_wall(points, alignment.T_pipe_camera, state.pipe)
        add_points(state.builder, points, kept, alignment)
    result = FrameResult(frame.index, frame.stamp_ns, points, kept, alignment, decode_yield(frame, points, state))
    # the points live on in the map only
    none = np.zeros(0, dtype=bool)
    state.results.append(replace(result, points=_NOTHING, kept=none, alignment=replace(alignment, inliers=none)))
    return result


def register(state: State, frame: Frame, points: RingPoints) -> Alignment:
    """One frame's pose: predicted by wheels and IMU, then aligned."""
    registration, estimator = REGISTRATIONS[state.method.registration.kind], estimator_of(state.method)
    if state.where is None:
        state.where = _launched(state, frame, points)
    else:
        state.where = estimator.advance(state.where, frame, state.rig, state.method.localisation)
    prior = estimator.predict(state.where)
    alignment = registration.align(points, state.wall, prior, state.method.registration)
    alignment = replace(alignment, evidence=alignment.information - prior.information * alignment.converged)
    if alignment.converged:
        if estimator.look:
            state.where, alignment = estimator.look(state.where, points, alignment, state.method.localisation)
            _leap(state, float(alignment.T_pipe_camera[2, 3] - prior.T_pipe_camera[2, 3]))
        state.where = estimator.settle(state.where, alignment)
        if registration.grow:
            registration.grow(state.wall.seen, points, alignment)
    return alignment


def _leap(state: State, along_mm: float) -> None:
    """The distance was corrected: what the map has of the wall around the sensor goes along."""
    moved_mm, begin_mm = shift_waiting(state.builder, along_mm)
    if moved_mm:
        ahead = ahead_mm(state.rig, state.pipe)
        state.map_z_mm = [z + moved_mm if z + ahead >= begin_mm else z for z in state.map_z_mm]


def estimator_of(method: Method) -> Estimator:
    """The estimator of a method."""
    return ESTIMATORS[method.localisation.kind]


def decode_yield(frame: Frame, points: RingPoints, state: State) -> float:
    """Share of all (slit, azimuth) places of the picture in which a slit was seen."""
    camera, turn = state.rig.camera, turn_of_frame(frame.index)
    shape = len(state.rig.projector.slits), state.method.decode.azimuths
    return share_of_places(points.pixel, points.ring, (camera.cx_px, camera.cy_px), shape, turn)


@njit(cache=True, error_model="numpy")
def share_of_places(pixel, slit, middle_px, shape, turn):
    """Share of all places, each a slit's and the line around a middle nearest to a pixel, that were seen."""
    around, seen = np.empty(slit.size), np.zeros(shape, dtype=np.bool_)
    for i in range(slit.size):
        angle = fast_arctan2(pixel[i, 0] - middle_px[0], middle_px[1] - pixel[i, 1])
        around[i] = np.rint(angle / (2 * np.pi) * shape[1] - turn)
    for i in range(slit.size):
        place = int(around[i])
        seen[slit[i], place + shape[1] if place < 0 else place] = True
    return np.count_nonzero(seen) / seen.size


def _launched(state: State, frame: Frame, points: RingPoints) -> Any:
    """Roll by gravity about the pipe's axis, which the first fit gives."""
    settings, align = state.method.localisation, REGISTRATIONS[state.method.registration.kind].align
    estimator = estimator_of(state.method)
    level = estimator.launch(frame, state.rig, state.pipe, FORWARD, settings)
    prior = estimator.predict(level)
    first = align(points, state.wall, prior, state.method.registration)
    if not first.converged:
        return level
    return estimator.launch(frame, state.rig, state.pipe, first.T_pipe_camera[2, :3].copy(), settings)


_NOTHING = RingPoints(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0))


def finish(state: State) -> Reconstruction:
    """Close the map and size the defects.

    Raises:
        ReconstructionFailed: when no frame could be registered, with the commonest reason.
    """
    path, wall = mapped(state)
    found = sized(path, wall, state.rig, state.pipe, state.method)
    estimator = estimator_of(state.method)
    return replace(found, episodes=estimator.episodes(state.where)) if estimator.episodes else found


def mapped(state: State) -> tuple[Trajectory, WallMap]:
    """Close the map; an estimator that looks back then moves poses and map together.

    Raises:
        ReconstructionFailed: when no frame could be registered, with the commonest reason.
    """
    if not any(result.alignment.converged for result in state.results):
        reasons = [result.alignment.reason for result in state.results] or ["there are no frames"]
        raise ReconstructionFailed(f"no frame registered: {max(set(reasons), key=reasons.count)}")
    try:
        wall = finish_map(state.builder)
    except MapTorn as error:
        raise ReconstructionFailed(str(error)) from error
    if wall.touched().stop == 0:
        raise ReconstructionFailed("no point lies where a wall can be; check the nominal pipe and the rig")
    look_back = estimator_of(state.method).look_back
    if look_back is None:
        return trajectory(state.results), wall
    seen, map_z_mm = look_back(state.where), np.array(state.map_z_mm)
    of_map = moved_along(map_z_mm, moves(state.results, seen), seen)
    wall = straightened(wall, map_z_mm, of_map, ahead_mm(state.rig, state.pipe))
    return trajectory(moved_results(state.results, seen)), wall


def sized(path: Trajectory, wall: WallMap, rig: Rig, pipe: NominalPipe, method: Method) -> Reconstruction:
    """Size the defects of a closed map, which loses the cells that hold false slits alone."""
    steepest = float(rig.projector.slit_half_angles_rad[-1])
    drop_unlit(wall, steepest)
    deviation = deviation_mm(wall)
    noise = noise_of_rows(wall, deviation)
    defects = measure_defects(wall, deviation, noise, pipe, steepest, method.sizing)
    return Reconstruction(path, wall, deviation, defects)


def trajectory(results: list[FrameResult]) -> Trajectory:
    """The path, one row a frame."""
    alignments: list[Alignment] = [result.alignment for result in results]
    return Trajectory(
        stamp_ns=np.array([result.stamp_ns for result in results], dtype=np.int64),
        T_pipe_camera=np.array([a.T_pipe_camera for a in alignments]),
        covariance=np.array([covariance(a.information) for a in alignments]),
        axis_std=np.array([axis_std(a) for a in alignments]),
        registered=np.array([a.converged for a in alignments]),
        radius_mm=np.array([a.radius_mm for a in alignments]),
        decode_yield=np.array([result.decode_yield for result in results]),
        reason=tuple(a.reason for a in alignments),
    )


def axis_std(alignment: Alignment) -> Float[np.ndarray, "6"]:
    """How well a frame's own picture fixes each axis; infinite where it shows nothing, as along a bare wall."""
    if alignment.evidence is None or not alignment.converged:
        return np.full(6, np.inf)
    # roll about the pipe's axis, not about the camera's centre, which would go around with it
    M, (x, y, _) = np.eye(6), alignment.T_pipe_camera[:3, 3]
    M[:2, 5] = -y, x
    return np.sqrt(np.diag(covariance(M.T @ alignment.evidence @ M)))


def reconstruct(recording: Iterable[Frame], rig: Rig, pipe: NominalPipe, method: Method) -> Reconstruction:
    """The fold over a whole recording."""
    state = begin(rig, pipe, method)
    for frame in recording:
        step(state, frame, see(frame, rig, method))
    return finish(state)

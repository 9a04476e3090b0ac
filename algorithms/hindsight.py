"""What is known only when the log has ended, taken back into poses and wall map: each frame's move along and about."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from algorithms.large_arrays import pieces, room
from algorithms.types import Alignment, FrameResult, LookedBack, WallMap
from sensor_model.geometry import transform, twist_about_z_rad, wrap_rad
from sensor_model.recording import NominalPipe
from sensor_model.rig import Rig

MOTION = np.ix_([2, 5], [2, 5])


def moves(results: list[FrameResult], seen: LookedBack) -> Float[np.ndarray, "frames 2"]:
    """How far along (mm) and about (rad) the pipe each frame must move to stand where hindsight has it."""
    T = np.array([result.alignment.T_pipe_camera for result in results])
    return np.column_stack([seen.z_mm - T[:, 2, 3], wrap_rad(seen.roll_rad - twist_about_z_rad(T[:, :3, :3]))])


def moved_along(
    map_z_mm: Float[np.ndarray, "frames"], move: Float[np.ndarray, "frames 2"], seen: LookedBack
) -> Float[np.ndarray, "frames 2"]:
    """The moves of what the frames put into the map, some of which was moved already when the distance leapt."""
    return np.column_stack([seen.z_mm - map_z_mm, move[:, 1]])


def moved_results(results: list[FrameResult], seen: LookedBack) -> list[FrameResult]:
    """The frames with their poses moved, and the information on distance and roll that hindsight has."""
    along_and_about = moves(results, seen)
    return [
        replace(result, alignment=moved(result.alignment, along_mm, about_rad, covariance))
        for result, (along_mm, about_rad), covariance in zip(results, along_and_about, seen.covariance, strict=True)
    ]


def moved(alignment: Alignment, along_mm: float, about_rad: float, covariance: np.ndarray) -> Alignment:
    """Moved along and turned about the pipe's axis, which leaves the fit of the cylinder as good as it was."""
    information = alignment.information.copy()
    if alignment.converged:
        turn = np.eye(6)
        turn[:3, :3] = turn[3:, 3:] = about(about_rad)
        information = turn @ information @ turn.T
        information[[2, 5], :] = information[:, [2, 5]] = 0.0
        information[MOTION] = np.linalg.inv(covariance)
    T = transform(about(about_rad), np.array([0.0, 0.0, along_mm])) @ alignment.T_pipe_camera
    return replace(alignment, T_pipe_camera=T, information=information)


def about(angle_rad: float) -> Float[np.ndarray, "3 3"]:
    """A turn about the pipe's axis."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def ahead_mm(rig: Rig, pipe: NominalPipe) -> float:
    """How far ahead of the camera the rings land on the wall, in the middle."""
    angles = rig.projector.slit_half_angles_rad
    return float(rig.projector.apex_mm[2] + np.mean(pipe.inner_radius_mm / np.tan(angles)))


def straightened(
    wall: WallMap, z_mm: Float[np.ndarray, "frames"], move: Float[np.ndarray, "frames 2"], ahead: float
) -> WallMap:
    """The map as if its frames had stood where hindsight has them.

    A row was made by the frames that had it about `ahead` before them, and goes where these go; within a row they
    stay as they were to each other. Cells are moved whole: a row may be left out or stand twice, none is made up.
    """
    order = np.argsort(z_mm, kind="stable")
    place, step = z_mm[order] + ahead, wall.z_mm[1] - wall.z_mm[0] if wall.z_mm.size > 1 else 1.0
    along, about_rad = (np.interp(wall.z_mm, place, move[order, k]) for k in (0, 1))
    goes_to = np.maximum.accumulate(wall.z_mm + along)
    rows = np.arange(np.floor(goes_to[0] / step), np.ceil(goes_to[-1] / step)) + 0.5
    from_row = np.rint(np.interp(rows * step, goes_to, np.arange(wall.z_mm.size))).astype(np.int64)
    cells = wall.theta_rad.size
    shift = np.rint(about_rad[from_row] / (2 * np.pi) * cells).astype(np.int64)
    names = ("radius_mm", "spread_mm", "sigma_mm", "count", "light_slope")
    before = [part for name in names if (part := getattr(wall, name)) is not None]
    after = [room((cells, rows.size), part.dtype) for part in before]
    for part in pieces(*after, *before):
        column = np.mod(np.arange(cells)[:, None] - shift[None, part], cells)
        for old, new in zip(before, after, strict=True):
            new[:, part] = old[column, from_row[None, part]]
    return WallMap(wall.theta_rad, rows * step, *after)

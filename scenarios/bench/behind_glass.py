"""A calibration with the glass tube in place, in closed loop: camera and boards' poses first, then the slits' cones."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix
from scipy.spatial.transform import Rotation

from algorithms.calibration.cone_fit import Sight
from algorithms.calibration.surfaces import FlatBoard
from scenarios.bench.calibrated import (
    LEAST_PLACE_STD,
    BoardSession,
    Calibrated,
    Plane,
    draw_board,
    fitted,
    pose_of,
    ray_noise,
    see_board,
)
from sensor_model.geometry import fisheye_project, fisheye_rays
from sensor_model.glass import ORIGIN, Glass, aimed_at, tube_of
from sensor_model.rig import Camera, Rig
from sensor_model.streams import stream

CORNER_STEP_MM, CORNER_REACH_MM = 15.0, 180.0
CORNER_NOISE_PX = 0.1
LEAST_ANGLE = np.tan(np.radians(18.0))  # nearer to the axis a camera looks out of the tube's end
LENS = ("fx_px", "fy_px", "skew_px", "cx_px", "cy_px", "k1", "k2", "k3", "k4")
POSE = 6


def calibrate_behind_glass(true_rig: Rig, glass: Glass, seed: int, session: BoardSession) -> Calibrated:
    """The rig that marked boards give when camera and projector both look through the glass.

    The camera is fitted with the boards' poses, so that it takes up what a central camera can of the glass; the boards
    are then where that camera sees them.
    """
    rng = stream(seed, "boards")
    boards = [draw_board(session, rng) for _ in range(session.boards)]
    grid = _grid()
    seen = [_corners(true_rig.camera, board, grid, glass, rng) for board in boards]
    camera, poses = _fit_camera(true_rig.camera, boards, grid, seen)
    held, sights = np.diag(np.full(POSE, LEAST_PLACE_STD**-2)), []  # freed, they would take up what the glass bends
    for board, pose in zip(boards, poses, strict=True):
        pixel, slit = see_board(true_rig, board, session.points, rng, glass)
        rays = fisheye_rays(pixel, camera.intrinsics)
        sights.append(Sight(rays, slit, FlatBoard(pose, held), ray_noise(rays, session, camera)))
    return fitted(true_rig.model_copy(update={"camera": camera}), sights, session)


def _grid() -> Float[np.ndarray, "corners 3"]:
    steps = np.arange(-CORNER_REACH_MM, CORNER_REACH_MM + 1, CORNER_STEP_MM)
    x, y = (a.ravel() for a in np.meshgrid(steps, steps))
    return np.stack([x, y, np.zeros_like(x)], axis=1)


def _placed(pose: np.ndarray, grid: np.ndarray) -> Float[np.ndarray, "corners 3"]:
    return Rotation.from_rotvec(pose[:3]).apply(grid) + pose[3:]


def _corners(
    camera: Camera, board: Plane, grid: np.ndarray, glass: Glass, rng: np.random.Generator
) -> Float[np.ndarray, "corners 2"]:
    """Pixels of a board's corners as seen through the glass; NaN for those that are not."""
    xyz = _placed(pose_of(board), grid)
    ahead = xyz[:, 2] > 5.0
    seen = aimed_at(tube_of(glass), ORIGIN, xyz) if glass.thickness_mm > 0 else xyz
    pixel = fisheye_project(seen, camera.intrinsics) + CORNER_NOISE_PX * rng.standard_normal((len(grid), 2))
    inside = ((pixel >= 0) & (pixel <= [camera.width_px - 1, camera.height_px - 1])).all(axis=1)
    steep = np.hypot(xyz[:, 0], xyz[:, 1]) > LEAST_ANGLE * xyz[:, 2]
    return np.where((ahead & inside & steep)[:, None], pixel, np.nan)


def _fit_camera(
    start: Camera, boards: list[Plane], grid: np.ndarray, seen: list[np.ndarray]
) -> tuple[Camera, Float[np.ndarray, "boards 6"]]:
    """Lens and boards' poses that put the corners where they are seen."""
    known = [np.isfinite(pixel[:, 0]) for pixel in seen]
    first = np.concatenate([start.intrinsics, *(pose_of(board) for board in boards)])

    def misfit(x: np.ndarray) -> np.ndarray:
        poses = x[len(LENS) :].reshape(-1, POSE)
        parts = [
            fisheye_project(_placed(pose, grid[mine]), x[: len(LENS)]) - pixel[mine]
            for pose, mine, pixel in zip(poses, known, seen, strict=True)
        ]
        return np.concatenate(parts).ravel()

    rows = np.cumsum([0, *(2 * np.count_nonzero(mine) for mine in known)])
    depends = lil_matrix((rows[-1], first.size), dtype=int)
    depends[:, : len(LENS)] = 1
    for i in range(len(boards)):
        depends[rows[i] : rows[i + 1], len(LENS) + POSE * i : len(LENS) + POSE * (i + 1)] = 1
    found = least_squares(misfit, first, x_scale="jac", jac_sparsity=depends)
    lens = dict(zip(LENS, found.x[: len(LENS)].tolist(), strict=True))
    return start.model_copy(update=lens), found.x[len(LENS) :].reshape(-1, POSE)

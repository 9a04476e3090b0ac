"""Where a board stands before the camera, and how its picture moves with pose, lens and the board's own shape."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from algorithms.robust import spread
from sensor_model.geometry import fisheye_rays

STEPS, SETTLED = 60, 1e-9
CUT_SIGMAS, LEAST_SIGMA_PX = 3.5, 0.1
STEEPEST_RAD = 1.35  # a ray flatter than this has no place on the plane in front of the camera


class Slopes(NamedTuple):
    """Pixels of board points, and their derivatives by the lens, by the pose and by the points themselves."""

    pixel: Float[np.ndarray, "n 2"]
    by_lens: Float[np.ndarray, "n 2 9"]
    by_pose: Float[np.ndarray, "n 2 6"]
    by_point: Float[np.ndarray, "n 2 3"]


def seen(intrinsics: Float[np.ndarray, "9"], pose: Float[np.ndarray, "6"], points: Float[np.ndarray, "n 3"]) -> Slopes:
    """The fisheye picture of points on a board whose pose is a rotation vector and a translation."""
    import cv2

    fx, fy, skew, cx, cy = intrinsics[:5]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    pixel, J = cv2.fisheye.projectPoints(
        points[None], pose[:3].copy(), pose[3:].copy(), matrix, intrinsics[5:].copy(), alpha=skew / fx
    )
    J = J.reshape(-1, 2, 15)  # by fx fy, cx cy, k1..k4, rotation, translation, alpha = skew / fx
    by_alpha = J[..., 14:]
    by_fx = J[..., :1] - by_alpha * skew / fx**2
    by_lens = np.concatenate([by_fx, J[..., 1:2], by_alpha / fx, J[..., 2:8]], axis=-1)
    rotation, _ = cv2.Rodrigues(pose[:3])
    return Slopes(pixel.reshape(-1, 2), by_lens, J[..., 8:14], J[..., 11:14] @ rotation)


def first_pose(
    intrinsics: Float[np.ndarray, "9"], points: Float[np.ndarray, "n 3"], pixel: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "6"] | None:
    """A pose by PnP on the undistorted rays, or None."""
    import cv2

    rays = fisheye_rays(pixel, intrinsics)
    ahead = rays[:, 2] > np.cos(STEEPEST_RAD)
    if np.count_nonzero(ahead) < 4:
        return None
    plane = rays[ahead, :2] / rays[ahead, 2:]
    found, turn, move = cv2.solvePnP(points[ahead], plane, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE)
    return np.concatenate([turn.ravel(), move.ravel()]) if found and move[2, 0] > 0 else None


def settled_pose(
    intrinsics: Float[np.ndarray, "9"],
    points: Float[np.ndarray, "n 3"],
    pixel: Float[np.ndarray, "n 2"],
    pose: Float[np.ndarray, "6"],
    robust: bool = False,
) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "n 2"], Float[np.ndarray, "6 6"]]:
    """The pose of least reprojection error, the residuals (px, drawn less found) and the pose's information per px2.

    Robust: points further off than 3.5 robust standard deviations have no say.
    """
    for _ in range(STEPS):
        view = seen(intrinsics, pose, points)
        residual = view.pixel - pixel
        weight = _weights(residual) if robust else np.ones(len(pixel))
        H = np.einsum("nij,n,nik->jk", view.by_pose, weight, view.by_pose)
        step = -np.linalg.solve(H, np.einsum("nij,n,ni->j", view.by_pose, weight, residual))
        pose = pose + step
        if np.abs(step).max() < SETTLED * max(1.0, float(np.abs(pose).max())):
            break
    return pose, residual, H


def _weights(residual: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    off = np.linalg.norm(residual, axis=1)
    sigma = max(spread(residual.ravel()), LEAST_SIGMA_PX)
    return (off < CUT_SIGMAS * sigma * np.sqrt(2.0)).astype(float)


def rms_px(residual_px: Float[np.ndarray, "*batch 2"]) -> float:
    """Root mean square distance of a point."""
    return float(np.sqrt(np.mean(np.sum(residual_px**2, axis=-1))))

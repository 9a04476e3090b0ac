"""Which way is up in the pipe: an attitude from the direction of gravity and the pipe's axis."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from sensor_model.geometry import twist_about_z_rad

VERTICAL_COSINE = 0.98


def is_vertical(down_camera: Float[np.ndarray, "3"], axis_camera: Float[np.ndarray, "3"]) -> bool:
    """Whether the pipe stands so upright that gravity says nothing of roll."""
    return bool(abs(down_camera @ axis_camera) > VERTICAL_COSINE)


def level_attitude(
    down_camera: Float[np.ndarray, "3"], axis_camera: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """`R_pipe_camera` from gravity and the pipe's axis, both as the camera sees them: 12 o'clock is up.

    In a vertical pipe gravity says nothing of roll; there the camera's own upright is the datum.
    """
    if is_vertical(down_camera, axis_camera):
        down_camera = np.array([0.0, 1.0, 0.0])
    y = down_camera - (down_camera @ axis_camera) * axis_camera
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, axis_camera), y, axis_camera])


def rolled_attitude(roll_rad: float, axis_camera: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """`R_pipe_camera` with a given roll about the pipe's axis as the camera sees it."""
    # the axis comes from the last pose and makes the next: its rounded length would grow from frame to frame
    R = level_attitude(np.array([0.0, 1.0, 0.0]), axis_camera / np.linalg.norm(axis_camera))
    turn = roll_rad - float(twist_about_z_rad(R))
    return Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix() @ R

"""Roll by gravity as a row of a Kalman filter: nearly all that it says in a level pipe, nothing in a vertical one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from algorithms.localisation.fused_model import BIAS_X, BIAS_Y, GYRO, ROLL, InertialSettings
from algorithms.localisation.imu import force_camera_m_s2
from algorithms.localisation.upright import is_vertical, level_attitude
from sensor_model.geometry import twist_about_z_rad
from sensor_model.recording import Frame
from sensor_model.rig import Rig

SHORTEST_S = 0.01  # one sample says as much as an average over this
PROBE_M_S2 = 1e-3


class GravityRow(NamedTuple):
    """The roll that gravity shows at the frame's stamp (rad), what of the state it is, and its variance (rad2)."""

    seen: float
    H: Float[np.ndarray, "1 n"]
    variance: float


def gravity_row(
    frame: Frame, rig: Rig, axis_camera: Float[np.ndarray, "3"], n: int, rate_rad_s: float, settings: InertialSettings
) -> GravityRow | None:
    """What gravity says of roll; None without a sample or where the pipe is too upright.

    The accelerometer's own biases turn the direction of down, and enter the row; they are told from roll only as the
    robot rolls.
    """
    if not len(frame.imu):
        return None
    force = force_camera_m_s2(frame, rig)
    size = float(np.linalg.norm(force))
    if not size > 0 or is_vertical(-force / size, axis_camera):
        return None
    roll = _roll_rad(force, axis_camera)
    # the samples' mean is that of their middle
    late_s = (frame.stamp_ns - float(frame.imu_stamps_ns.mean())) / 1e9
    H = np.zeros((1, n))
    H[0, ROLL], H[0, GYRO] = 1.0, late_s
    for k, axis in ((BIAS_X, 0), (BIAS_Y, 1)):
        H[0, k] = (_roll_rad(force + PROBE_M_S2 * np.eye(3)[axis], axis_camera) - roll) / PROBE_M_S2
    seconds = max((int(frame.imu_stamps_ns[-1]) - int(frame.imu_stamps_ns[0])) / 1e9, SHORTEST_S)
    # what shakes as fast as it is read does not average out: a frame is worth no more than its samples agree
    shaken = float(frame.imu[:, 3:].std(axis=0).max())
    noise = settings.accelerometer_noise_density / np.sqrt(seconds)
    spread = float(np.linalg.norm([noise, settings.vibration_m_s2, shaken]))
    across = float(np.linalg.norm(np.cross(force, axis_camera)))
    return GravityRow(roll + rate_rad_s * late_s, H, float((spread / across) ** 2))


def _roll_rad(force_camera: Float[np.ndarray, "3"], axis_camera: Float[np.ndarray, "3"]) -> float:
    """Roll at which the specific force points up; acceleration along the pipe does not enter."""
    return float(twist_about_z_rad(level_attitude(-force_camera / np.linalg.norm(force_camera), axis_camera)))

"""The hand-eye calibration recovers the mount through rounding, lag, drift and spoiled rows; weak turns are refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.hand_eye import calibrate_hand_eye, cleaned, null_space
from sensor_model.geometry import wxyz_from_rotation

MOUNT = Rotation.from_euler("xyz", [2.0, -4.0, 88.0], degrees=True)  # R_camera_imu
WORLD_BOARD = Rotation.from_euler("xyz", [80.0, 10.0, 30.0], degrees=True)
ROWS, POSES, LAG = 340, 320, 7.4


def _log(rng, drift_rad=0.0, digits=2, spoiled=0, second_axis=0.3):
    """Attitudes at every row, and the board's poses at the last rows, seen later than the rows say."""
    t = np.linspace(0, 1, ROWS + 20)
    turns = np.stack([second_axis * np.sin(9 * t), second_axis * np.cos(7 * t), 1.3 * np.sin(6.3 * t)], axis=1)
    camera_board = Slerp(np.arange(t.size), Rotation.from_rotvec(turns) * Rotation.from_euler("y", 170, degrees=True))
    rows = np.arange(ROWS, dtype=float)
    board = camera_board(np.arange(POSES) + (ROWS - POSES) - LAG + 10)
    heading = Rotation.from_rotvec(drift_rad * (rows / ROWS)[:, None] * [0, 0, 1.0])
    imu = heading * WORLD_BOARD * camera_board(rows + 10).inv() * MOUNT
    q = wxyz_from_rotation(imu.as_matrix())
    q[rng.choice(ROWS, spoiled, replace=False)] *= 1.7
    return np.round(q, digits), board.as_rotvec()


def test_the_mount_is_recovered_through_rounding_lag_drift_and_spoiled_rows():
    q, poses = _log(np.random.default_rng(0), drift_rad=0.15, spoiled=5)
    found = calibrate_hand_eye(q, poses)
    off = (Rotation.from_matrix(found.fit.R_camera_imu) * MOUNT.inv()).magnitude()
    assert np.degrees(off) < 1.0
    assert found.fit.lag_rows == pytest.approx(LAG, abs=0.3)
    assert found.rmse_cross_validated_rad.max() < 0.012  # rounding to 0.01 alone is 0.006 an axis
    assert found.rmse_without_drift_rad.max() > 2 * found.rmse_cross_validated_rad.max()
    assert np.ptp(found.fit.heading_rad) == pytest.approx(0.15, rel=0.25)
    assert found.bad_rows >= 5


def test_without_rounding_it_is_exact_and_the_null_space_is_ill_posed():
    q, poses = _log(np.random.default_rng(1), digits=12)
    found = calibrate_hand_eye(q, poses)
    assert np.degrees((Rotation.from_matrix(found.fit.R_camera_imu) * MOUNT.inv()).magnitude()) < 0.05
    turns = Rotation.from_rotvec(np.random.default_rng(2).normal(0, 0.5, (40, 3)))
    exact, condition = null_space(turns, MOUNT * turns * MOUNT.inv())
    assert condition > 1e12
    scaled = exact * np.sqrt(3) * np.sign(np.linalg.det(exact))
    assert scaled == pytest.approx(MOUNT.as_matrix(), abs=1e-6)


def test_turning_about_one_axis_only_and_too_few_poses_are_refused():
    q, poses = _log(np.random.default_rng(3), second_axis=0.0)
    with pytest.raises(CannotCalibrate, match="about a second"):
        calibrate_hand_eye(q, poses)
    with pytest.raises(CannotCalibrate, match="10 poses"):
        calibrate_hand_eye(q, poses[:10])
    with pytest.raises(CannotCalibrate, match="unit length"):
        cleaned(np.full((50, 4), 0.9))


def test_the_real_log_meets_the_paper_s_error_on_every_axis(shared):
    from scenarios.calibration.imu import read_log, read_poses

    folder = shared / "real" / "imu"
    if not folder.is_dir():
        pytest.skip("no real IMU log")
    found = calibrate_hand_eye(read_log(folder / "imucam_log_final_cal.csv"), read_poses(folder / "orient.mat"))
    assert found.rmse_cross_validated_rad.max() < 0.022
    assert 22 < found.fit.lag_rows < 24
    assert found.rmse_without_drift_rad[1] > 0.03  # the heading's drift is what the second axis suffers from

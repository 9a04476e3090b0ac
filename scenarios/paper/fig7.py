"""Fig. 7 of the paper: rotation by camera and by IMU after the hand-eye calibration, on a log like the sensor's own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from scenarios.calibration.imu import calibrate
from scenarios.provenance import versions
from scenarios.run_folder import run_folder
from sensor_model.geometry import rotation_from_wxyz
from sensor_model.rig import preset_rig
from sensor_model.streams import stream

# what the published log is: rows at 15 Hz, of which the last show the board, in steps of 0.01, late by so many rows
RATE_HZ, ROWS, POSES, STEP, LAG_ROWS = 15.0, 737, 648, 0.01, 22.5
TURN_RAD, SHORTEST_S, LONGEST_S, WAVES = 0.25, 5.0, 20.0, 4  # by hand in front of a board, about every axis
# and what is left in it when rounding is known: the device's own noise, its heading's drift, the board's pose
ATTITUDE_NOISE_DEG, HEADING_DRIFT_DEG, BOARD_NOISE_DEG = 0.5, 10.0, 0.1
LEVEL = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # the camera looks along the world's x; its z is up


def run_fig7(seed: int, out: Path) -> dict[str, Any]:
    """Write the twin's log and its board poses, calibrate from them, and give the figures and the mount's true error.

    Raises:
        BadInput: when the folder cannot be written.
    """
    mount = preset_rig()
    with run_folder(out) as folder:
        attitudes, rotvecs = twin_log(seed, mount.imu.R_camera_imu)
        rows = [
            f"{round(i * 1e9 / RATE_HZ)},{w:.2f},{x:.2f},{y:.2f},{z:.2f}" for i, (w, x, y, z) in enumerate(attitudes)
        ]
        (folder / "log.csv").write_text("\n".join(["#timestamp [ns],w,x,y,z", *rows]) + "\n")
        poses = [",".join(f"{value:.9f}" for value in row) for row in rotvecs]
        (folder / "poses.csv").write_text("\n".join(["rx,ry,rz", *poses]) + "\n")
        figures = calibrate(folder / "log.csv", folder / "poses.csv", mount, folder / "fig7.yaml")
        found = rotation_from_wxyz(np.array(figures["q_camera_imu_wxyz"]))
        off = Rotation.from_matrix(found @ mount.imu.R_camera_imu.T)
        figures["mount_error_deg"] = float(np.degrees(off.magnitude()))
        (folder / "run.json").write_text(json.dumps({**versions(), "seed": seed, **figures}, indent=1) + "\n")
    return figures


def twin_log(
    seed: int, R_camera_imu: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, "rows 4"], Float[np.ndarray, "poses 3"]]:
    """The device's attitudes (w, x, y, z, rounded as it logs them), and the board's rotation seen by the camera."""
    rng = stream(seed, "attitude")
    period_s = rng.uniform(SHORTEST_S, LONGEST_S, (WAVES, 3))
    phase = rng.uniform(0, 2 * np.pi, (WAVES, 3))

    def camera_at(time_s: Float[np.ndarray, "n"]) -> Rotation:
        waves = np.sin(2 * np.pi * time_s[:, None, None] / period_s + phase)
        return LEVEL * Rotation.from_rotvec(TURN_RAD * waves.sum(axis=1) / np.sqrt(WAVES / 2))

    board = camera_at(np.arange(POSES) / RATE_HZ).inv() * Rotation.from_rotvec([2.0, 1.0, 0.5])
    shaken = Rotation.from_rotvec(np.radians(BOARD_NOISE_DEG) * rng.standard_normal((POSES, 3))) * board
    time_s = (np.arange(ROWS) - (ROWS - POSES) + LAG_ROWS) / RATE_HZ
    heading = np.radians(HEADING_DRIFT_DEG) * np.linspace(0, 1, ROWS)
    noise = Rotation.from_rotvec(np.radians(ATTITUDE_NOISE_DEG) * rng.standard_normal((ROWS, 3)))
    drifted = Rotation.from_rotvec(heading[:, None] * np.array([0.0, 0.0, 1.0]))
    attitude = drifted * camera_at(time_s) * Rotation.from_matrix(R_camera_imu) * noise
    return np.round(attitude.as_quat(canonical=True)[:, [3, 0, 1, 2]] / STEP) * STEP, shaken.as_rotvec()

"""`pipetwin calibrate imu`: a log of attitudes and the board's poses in, the IMU's mount out, with a page."""

from __future__ import annotations

import json
import subprocess
import sys
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.hand_eye import HandEyeCalibration, calibrate_hand_eye
from scenarios.calibration.camera import page_of
from scenarios.calibration.rig_file import write_rig
from scenarios.document import BadInput
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.canvas import BLUE, VERMILION, Picture, drawing, to_picture
from scenarios.run_folder import whole_file
from sensor_model.geometry import wxyz_from_rotation
from sensor_model.rig import Rig

LARGEST_BYTES, MOST_ROWS = 64 * 2**20, 200_000
DEVICE_COLUMNS, DEVICE_QUATERNION = 15, 11  # clock, ns, 3 gyro, 3 acceleration, 3 Euler, quaternion w x y z
OURS = "#timestamp [ns]"
DAY_S = 86_400.0
LONGEST_S = 60.0
READ_MAT = """
import json, resource, sys
resource.setrlimit(resource.RLIMIT_AS, (2**32, 2**32))
import numpy as np
from scipy.io import loadmat
held = loadmat(sys.argv[1], variable_names=["rvecs"])["rvecs"]
json.dump(np.asarray(held, dtype=float).reshape(len(held), -1).tolist(), sys.stdout)
"""
WORST_RMSE_RAD = 0.022  # the paper's largest


def calibrate(log: Path, poses: Path, base: Rig, out: Path) -> dict[str, Any]:
    """Calibrate, write rig and page, and give the figures.

    Raises:
        BadInput: naming the file and what is wrong with it.
    """
    attitudes, rotvecs = read_log(log), read_poses(poses)
    try:
        found = calibrate_hand_eye(attitudes, rotvecs)
    except CannotCalibrate as error:
        raise BadInput([f"{log} with {poses}: {error}"]) from error
    mount = base.imu.model_copy(
        update={"q_camera_imu_wxyz": tuple(wxyz_from_rotation(found.fit.R_camera_imu).tolist())}
    )
    write_rig(base.model_copy(update={"imu": mount}), out)
    figures = _figures(found)
    with whole_file(page_of(out, "imu")) as work:
        work.write_text(_page(found, figures), encoding="utf-8")
    return figures


def read_log(file: Path) -> Float[np.ndarray, "rows 4"]:
    """Attitudes (w, x, y, z) of the device's own log, or of a recording's `orientation0/data.csv`.

    Raises:
        BadInput: naming file, line and value.
    """
    lines = read_text(file).splitlines()
    if len(lines) > MOST_ROWS:
        raise BadInput([f"{file}: {len(lines)} rows; at most {MOST_ROWS} are taken"])
    ours = bool(lines) and lines[0].startswith(OURS)
    rows, last_s = [], -np.inf
    for number, line in enumerate(lines[1:], start=2):
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) != (5 if ours else DEVICE_COLUMNS):
            expected = "a stamp and w, x, y, z" if ours else f"{DEVICE_COLUMNS} columns, the quaternion last"
            raise BadInput([f"{file}:{number}: got {len(cells)} columns; {expected} are expected"])
        try:
            stamp_s = int(cells[0]) * 1e-9 if ours else clock_s(cells[0]) + int(cells[1]) * 1e-9
            q = [float(cell) for cell in (cells[1:] if ours else cells[DEVICE_QUATERNION:])]
        except ValueError as error:
            raise BadInput([f"{file}:{number}: {error}; numbers are expected"]) from error
        if not all(map(isfinite, q)):
            raise BadInput([f"{file}:{number}: got {', '.join(cells[-4:])}; finite numbers are expected"])
        if not ours and last_s - stamp_s > DAY_S / 2:
            stamp_s += DAY_S  # midnight
        if stamp_s <= last_s:
            raise BadInput([f"{file}:{number}: stamp {cells[0]} is not after the one before; stamps must rise"])
        rows.append(q)
        last_s = stamp_s
    if len(rows) < 2:
        raise BadInput([f"{file}: got {len(rows)} rows; a log has 2 or more"])
    return np.array(rows)


def clock_s(text: str) -> float:
    """Seconds since midnight of the device's clock, h:mm:ss."""
    hours, minutes, seconds = (int(part) for part in text.split(":"))
    return 3600.0 * hours + 60.0 * minutes + seconds


def read_poses(file: Path) -> Float[np.ndarray, "poses 3"]:
    """Rotation vectors of the board (rad, camera frame): `rvecs` of a .mat file, or a CSV of rx, ry, rz.

    Raises:
        BadInput: naming the file and what is wrong.
    """
    if file.suffix.lower() == ".mat":
        rotvecs = _from_mat(file)
    else:
        try:
            cells = [line.split(",")[:3] for line in read_text(file).splitlines()[1:]]
            rotvecs = np.array([[float(cell) for cell in row] for row in cells])
        except ValueError as error:
            raise BadInput([f"{file}: {error}; rows of rx, ry, rz in rad under a header are expected"]) from error
    if rotvecs.ndim != 2 or rotvecs.shape[1] != 3 or len(rotvecs) > MOST_ROWS:
        raise BadInput([f"{file}: got poses of shape {rotvecs.shape}; (n, 3) are expected, n at most {MOST_ROWS}"])
    if not np.isfinite(rotvecs).all():
        raise BadInput([f"{file}: pose {int(np.argmin(np.isfinite(rotvecs).all(axis=1))) + 1} is not finite"])
    return rotvecs


def _from_mat(file: Path) -> np.ndarray:
    """`rvecs` of a .mat file, read in a process of its own: a damaged file can end scipy's reader with the process."""
    _bytes(file)
    program = [sys.executable, "-c", READ_MAT, str(file.absolute())]
    try:
        done = subprocess.run(program, capture_output=True, timeout=LONGEST_S, check=False)  # noqa: S603  our own
    except subprocess.TimeoutExpired as error:
        raise BadInput([f"{file}: is no MATLAB file that can be read within {LONGEST_S:g} s"]) from error
    if done.returncode:
        last = (done.stderr.decode(errors="replace").strip().splitlines() or ["it ends the reader"])[-1]
        said = (
            "holds no rvecs" if last.startswith("KeyError: 'rvecs'") else f"is no MATLAB file that can be read: {last}"
        )
        raise BadInput([f"{file}: {said}"])
    return np.array(json.loads(done.stdout), dtype=float)


def read_text(file: Path) -> str:
    """A file of UTF-8 text, of bounded size.

    Raises:
        BadInput: for another one.
    """
    try:
        return _bytes(file).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput([f"{file}: is no text; a CSV in UTF-8 is expected"]) from error


def _bytes(file: Path) -> bytes:
    try:
        if not file.is_file():
            raise BadInput([f"{file}: no such file"])
        if file.stat().st_size > LARGEST_BYTES:
            raise BadInput([f"{file}: got more than {LARGEST_BYTES / 2**20:g} MiB"])
        return file.read_bytes()
    except OSError as error:
        raise BadInput([f"{file}: cannot be read: {error.strerror}"]) from error


def _figures(found: HandEyeCalibration) -> dict[str, Any]:
    fit = found.fit
    return {
        "rmse_rad": found.rmse_cross_validated_rad.tolist(),
        "rmse_fit_rad": fit.rmse_rad.tolist(),
        "rmse_without_heading_drift_rad": found.rmse_without_drift_rad.tolist(),
        "rmse_tsai_lenz_rad": found.tsai_lenz_rmse_rad.tolist(),
        "lag_rows": fit.lag_rows,
        "condition_number": found.condition_number,
        "null_space_off_rotation": found.null_space_error,
        "absolute_over_consecutive": found.absolute_rmse_rad / found.consecutive_rmse_rad,
        "heading_drift_deg": float(np.degrees(np.ptp(fit.heading_rad))),
        "q_camera_imu_wxyz": wxyz_from_rotation(fit.R_camera_imu).tolist(),
        "poses": int(fit.inliers.size),
        "outliers": int((~fit.inliers).sum()),
        "spoiled_rows": found.bad_rows,
        "weak": ""
        if found.rmse_cross_validated_rad.max() < WORST_RMSE_RAD
        else "the error is above the paper's 0.022 rad",
    }


def _page(found: HandEyeCalibration, figures: dict[str, Any]) -> str:
    ways = {
        "left-out blocks": "rmse_rad",
        "fit": "rmse_fit_rad",
        "no heading drift": "rmse_without_heading_drift_rad",
        "Tsai-Lenz": "rmse_tsai_lenz_rad",
    }
    rows = [["way", "x (rad)", "y (rad)", "z (rad)"]]
    rows += [[way, *(f"{value:.4f}" for value in figures[key])] for way, key in ways.items()]
    words = [
        f"The log lags by {figures['lag_rows']:.2f} rows. The device's heading drifts by "
        f"{figures['heading_drift_deg']:.1f} degrees during the log; taken as none, that is the error of one axis.",
        f"The null-space way (Eq. 18): condition number {figures['condition_number']:.3g}; its matrix is "
        f"{figures['null_space_off_rotation']:.2g} away from a rotation.",
        f"Differences to the first frame (Eq. 20) leave {figures['absolute_over_consecutive']:.2f} times the RMSE of "
        "differences between neighbours (Eq. 19).",
    ]
    verdict = "RMSE on left-out blocks: " + ", ".join(f"{value:.4f}" for value in figures["rmse_rad"]) + " rad."
    sections = [
        Section("Errors per axis", words, rows),
        Section("Camera and IMU (the paper's Fig. 7)", [], (), [_turn_figure(found)]),
    ]
    return calibration_page("IMU calibration", "", verdict, not figures["weak"], sections)


def _turn_figure(found: HandEyeCalibration) -> Picture:
    camera = (found.camera * found.camera[0].inv()).as_rotvec()
    imu = camera - (found.fit.error_rad - found.fit.error_rad[0])
    with drawing(7.5) as figure:
        for k, axes in enumerate(figure.subplots(3, 1, sharex=True)):
            axes.plot(camera[:, k], color=BLUE, label="camera")
            axes.plot(imu[:, k], color=VERMILION, linewidth=0.8, label="IMU")
            axes.set_ylabel(f"{'xyz'[k]} (rad)")
        axes.set_xlabel("pose")
        axes.legend()
        return to_picture(figure, "Rotation about x, y and z by camera and IMU.", "Rotation since the first pose.")

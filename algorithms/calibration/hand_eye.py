"""The camera-IMU rotation (section 3.2.1): Tsai and Lenz, then lag, heading drift and both frames together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation, Slerp

from algorithms.calibration.failure import CannotCalibrate
from algorithms.robust import MAD_TO_SIGMA

NORM_TOLERANCE = 0.05  # a unit quaternion logged to 0.01 is this near to 1
MEDIAN_ROWS = 3
LEAST_POSES, LEAST_TURN_RAD, LEAST_SECOND_AXIS = 30, 0.1, 0.02
TSAI_POSES = 60
SOFT_RAD = 0.03
KNOT_ROWS = 60  # a heading drifts no faster than a line over so many rows
DRIFT_STD_RAD = 0.05  # from knot to knot
FOLDS, BLOCK_ROWS = 5, 12
LAG_STARTS = (-0.5, 0.5, 1.5)  # between rows: on a row, where the attitude bends, the search gets stuck
OUTLIER_SIGMAS = 5.0


@dataclass(frozen=True)
class HandEye:
    """The mount, and what it leaves; errors are rotation vectors in the camera's axes, rad, camera less IMU.

    `R_world_board` is where the board stood; `heading_rad` the drift about the world's vertical at each pose.
    """

    R_camera_imu: Float[np.ndarray, "3 3"]
    R_world_board: Float[np.ndarray, "3 3"]
    lag_rows: float
    heading_rad: Float[np.ndarray, "poses"]
    error_rad: Float[np.ndarray, "poses 3"]
    inliers: Bool[np.ndarray, "poses"]

    @property
    def rmse_rad(self) -> Float[np.ndarray, "3"]:
        """Per axis, over the inliers."""
        return np.sqrt(np.mean(self.error_rad[self.inliers] ** 2, axis=0))


@dataclass(frozen=True)
class HandEyeCalibration:
    """The fit and its cross-validation, beside what simpler ways give."""

    fit: HandEye
    rmse_cross_validated_rad: Float[np.ndarray, "3"]
    rmse_without_drift_rad: Float[np.ndarray, "3"]
    tsai_lenz_rmse_rad: Float[np.ndarray, "3"]
    absolute_rmse_rad: float
    consecutive_rmse_rad: float
    condition_number: float
    null_space_error: float
    bad_rows: int
    camera: Rotation
    imu: Rotation


def cleaned(q_wxyz: Float[np.ndarray, "rows 4"]) -> tuple[Rotation, Bool[np.ndarray, "rows"]]:
    """The log's attitudes with spoiled rows bridged and a median filter over three rows; which rows were good.

    Raises:
        CannotCalibrate: when most rows are no unit quaternions.
    """
    norm = np.linalg.norm(q_wxyz, axis=1)
    good = np.abs(norm - 1) < NORM_TOLERANCE
    if good.mean() < 0.5:
        raise CannotCalibrate(f"{(~good).sum()} of {good.size} quaternions have no unit length")
    rows = np.flatnonzero(good)
    bridged = Slerp(rows, Rotation.from_quat(q_wxyz[rows][:, [1, 2, 3, 0]]))(
        np.clip(np.arange(good.size), rows[0], rows[-1])
    )
    q = bridged.as_quat()
    signs = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0))
    q[1:] *= signs[:, None]
    padded = np.concatenate([q[:1], q, q[-1:]])
    stacked = np.stack([padded[k : k + len(q)] for k in range(MEDIAN_ROWS)])
    return Rotation.from_quat(np.median(stacked, axis=0)), good


def calibrate_hand_eye(
    q_world_imu_wxyz: Float[np.ndarray, "rows 4"], board_rotvecs: Float[np.ndarray, "poses 3"]
) -> HandEyeCalibration:
    """The IMU's mount from a log and the board's poses seen by the camera, which pair with the log's last rows.

    Raises:
        CannotCalibrate: for too few poses, or turns that leave the mount open.
    """
    imu, good = cleaned(q_world_imu_wxyz)
    board = Rotation.from_rotvec(board_rotvecs)
    poses = len(board)
    if poses < LEAST_POSES or poses > len(imu):
        raise CannotCalibrate(
            f"{poses} poses for {len(imu)} rows; from {LEAST_POSES} poses to as many as there are rows"
        )
    _check_turns(board)
    first = len(imu) - poses
    lag, start = _coarse(imu, board, first)
    plain = _fit(imu, board, first, lag, start, np.ones(poses, dtype=bool), drift=False)
    fits = [
        _fit(
            imu, board, first, np.floor(plain.lag_rows) + off, _unknowns(plain), np.ones(poses, dtype=bool), drift=True
        )
        for off in LAG_STARTS
    ]
    fit = min(fits, key=lambda one: float(np.median(np.linalg.norm(one.error_rad, axis=1))))
    fit = _fit(imu, board, first, fit.lag_rows, _unknowns(fit), fit.inliers, drift=True)
    paired = _at(imu, first, poses, fit.lag_rows)
    tsai = tsai_lenz(paired, board)
    turns = {name: _relative(paired, board, name) for name in ("absolute", "consecutive")}
    by = {name: _aligned(*pair) for name, pair in turns.items()}
    null, condition = null_space(*turns["absolute"])
    return HandEyeCalibration(
        fit,
        _cross_validated(imu, board, first, fit),
        plain.rmse_rad,
        _turn_rmse(tsai, *turns["absolute"]),
        float(np.linalg.norm(_turn_rmse(by["absolute"], *turns["absolute"]))),
        float(np.linalg.norm(_turn_rmse(by["consecutive"], *turns["absolute"]))),
        condition,
        float(np.linalg.norm(null.T @ null - np.eye(3))),
        int((~good).sum()),
        board,
        paired,
    )


def _check_turns(board: Rotation) -> None:
    turns = (board * board[0].inv()).as_rotvec()
    size = np.linalg.svd(turns / np.sqrt(len(turns)), compute_uv=False)
    if size[0] < LEAST_TURN_RAD or size[1] < LEAST_SECOND_AXIS:
        raise CannotCalibrate(
            f"the camera turns by {size[0]:.3f} rad RMS about one axis and {size[1]:.3f} about a second; turn it about "
            f"two axes or more, by {LEAST_TURN_RAD:g} and {LEAST_SECOND_AXIS:g} at least"
        )


def _at(imu: Rotation, first: int, poses: int, lag_rows: float) -> Rotation:
    """The attitude that belongs to each pose: so many rows before the row it is paired with."""
    rows = np.clip(np.arange(poses) + first - lag_rows, 0, len(imu) - 1)
    return Slerp(np.arange(len(imu)), imu)(rows)


def _relative(imu: Rotation, board: Rotation, way: str) -> tuple[Rotation, Rotation]:
    """Turns of IMU and camera in their own frames: to the first (Eq. 20) or between neighbours (Eq. 19)."""
    if way == "absolute":
        return imu[1:].inv() * imu[0], board[1:] * board[0].inv()  # Eq. 20
    return imu[1:].inv() * imu[:-1], board[1:] * board[:-1].inv()  # Eq. 19


def _aligned(imu_turn: Rotation, camera_turn: Rotation) -> Rotation:
    """R_camera_imu that best carries the IMU's turning axes onto the camera's: R_c = R_cal R_m R_cal^T (Eq. 15)."""
    return Rotation.align_vectors(camera_turn.as_rotvec(), imu_turn.as_rotvec())[0]


def _turn_rmse(mount: Rotation, imu_turn: Rotation, camera_turn: Rotation) -> Float[np.ndarray, "3"]:
    error = (camera_turn * (mount * imu_turn * mount.inv()).inv()).as_rotvec()
    return np.sqrt(np.mean(error**2, axis=0))


def tsai_lenz(imu: Rotation, board: Rotation) -> Rotation:
    """R_camera_imu by OpenCV's hand-eye calibration (Tsai and Lenz), from poses spread over the log."""
    import cv2

    chosen = np.unique(np.linspace(0, len(board) - 1, TSAI_POSES).astype(int))
    still = [np.zeros((3, 1)) for _ in chosen]
    R_imu_camera, _ = cv2.calibrateHandEye(
        list(imu[chosen].as_matrix()), still, list(board[chosen].as_matrix()), still, method=cv2.CALIB_HAND_EYE_TSAI
    )
    return Rotation.from_matrix(R_imu_camera).inv()


def null_space(imu_turn: Rotation, camera_turn: Rotation) -> tuple[Float[np.ndarray, "3 3"], float]:
    """The paper's first way: R_c X - X R_m = 0 (Eq. 18) as A x = 0; the null vector as a matrix, and A's condition."""
    eye = np.eye(3)
    A = np.concatenate(
        [
            np.kron(c, eye) - np.kron(eye, m.T)
            for c, m in zip(camera_turn.as_matrix(), imu_turn.as_matrix(), strict=True)
        ]
    )
    _, size, V = np.linalg.svd(A, full_matrices=False)
    return V[-1].reshape(3, 3), float(size[0] / max(size[-1], np.finfo(float).tiny))


def _coarse(imu: Rotation, board: Rotation, first: int) -> tuple[float, np.ndarray]:
    """The whole number of rows, and the frames, that fit best."""
    best, found = np.inf, (0.0, np.zeros(6))
    for lag in range(first + 1):
        paired = _at(imu, first, len(board), float(lag))
        mount = _aligned(*_relative(paired, board, "absolute"))
        # imu -> world = (board -> world) (camera -> board) (imu -> camera)
        R_world_board = (paired * mount.inv() * board).mean()
        error = (paired.inv() * R_world_board * board.inv() * mount).magnitude()
        if np.median(error) < best:
            best = float(np.median(error))
            found = (float(lag), np.concatenate([R_world_board.as_rotvec(), mount.as_rotvec()]))
    return found


def _unknowns(fit: HandEye) -> np.ndarray:
    return np.concatenate(
        [Rotation.from_matrix(fit.R_world_board).as_rotvec(), Rotation.from_matrix(fit.R_camera_imu).as_rotvec()]
    )


def _heading(values: np.ndarray, poses: int) -> Float[np.ndarray, "poses"]:
    """The drift at every pose: straight lines between knots."""
    knots = np.linspace(0, poses - 1, values.size) if values.size else np.zeros(1)
    return np.interp(np.arange(poses), knots, values if values.size else np.zeros(1))


def _errors(
    unknowns: np.ndarray, lag_rows: float, heading: np.ndarray, imu: Rotation, board: Rotation, first: int
) -> Float[np.ndarray, "poses 3"]:
    """Rotation from the IMU's to the camera's word on where the camera looks, in camera axes."""
    R_world_board, mount = Rotation.from_rotvec(unknowns[:3]), Rotation.from_rotvec(unknowns[3:6])
    drift = Rotation.from_rotvec(heading[:, None] * np.array([0.0, 0.0, 1.0]))
    paired = drift.inv() * _at(imu, first, len(board), lag_rows)
    return (mount * (paired.inv() * R_world_board * board.inv() * mount) * mount.inv()).as_rotvec()


def _fit(
    imu: Rotation,
    board: Rotation,
    first: int,
    lag_rows: float,
    start: np.ndarray,
    used: Bool[np.ndarray, "poses"],
    drift: bool,
) -> HandEye:
    """Both frames, the lag to a fraction of a row and, where `drift`, the heading's drift, robustly."""
    from scipy.optimize import least_squares

    poses = len(board)
    knots = max(poses // KNOT_ROWS + 1, 2) if drift else 0

    def misfit(x: np.ndarray) -> np.ndarray:
        error = _errors(x[:6], x[6], _heading(x[7:], poses), imu, board, first)[used]
        return np.concatenate([error.ravel(), np.diff(x[7:]) / DRIFT_STD_RAD * 0.01, x[7:8] / DRIFT_STD_RAD * 0.01])

    x0 = np.concatenate([start, [lag_rows], np.zeros(knots)])
    x = least_squares(misfit, x0, loss="soft_l1", f_scale=SOFT_RAD, diff_step=1e-5, x_scale="jac").x
    heading = _heading(x[7:], poses)
    error = _errors(x[:6], x[6], heading, imu, board, first)
    sigma = MAD_TO_SIGMA * np.median(np.abs(error[used]), axis=0)
    inliers = (np.abs(error) < OUTLIER_SIGMAS * np.maximum(sigma, 1e-4)).all(axis=1)
    return HandEye(
        Rotation.from_rotvec(x[3:6]).as_matrix(),
        Rotation.from_rotvec(x[:3]).as_matrix(),
        float(x[6]),
        heading,
        error,
        inliers,
    )


def _cross_validated(imu: Rotation, board: Rotation, first: int, fit: HandEye) -> Float[np.ndarray, "3"]:
    """RMSE per axis on blocks of rows that had no part in the fit; all their rows count."""
    block = np.arange(len(board)) // BLOCK_ROWS % FOLDS
    errors = np.empty((len(board), 3))
    for fold in range(FOLDS):
        out = block == fold
        part = _fit(imu, board, first, fit.lag_rows, _unknowns(fit), ~out, drift=True)
        errors[out] = part.error_rad[out]
    return np.sqrt(np.mean(errors**2, axis=0))

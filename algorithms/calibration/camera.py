"""The camera's calibration: lens, board poses and the printed board's own shape from pictures of a checkerboard."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from algorithms.calibration.board_pose import first_pose, rms_px, seen, settled_pose
from algorithms.calibration.boards import Checkerboard
from algorithms.calibration.failure import CannotCalibrate

NAMES = ("fx_px", "fy_px", "skew_px", "cx_px", "cy_px", "k1", "k2", "k3", "k4")
LEAST_PICTURES, FOLDS = 5, 5
PARALLEL_DEG = 5.0
FIRST_FOCAL_SHARES = (0.2, 0.27, 0.35, 0.45, 0.6, 0.8, 1.1)  # of the picture's width
STEPS, SETTLED = 80, 1e-9
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-8, 1e6
CORNER_PX = 0.2  # what the shape's prior is weighed against
IN_PLANE_SQUARES, BEND_SQUARES = 0.01, 0.05  # how far a printed board's corners may lie from their places
SHAPE_GAIN = 0.95  # a shape is believed that takes the error of left-out pictures below this share
WORST_PICTURE = 4.0  # times the middle picture's error
WEAK_FOCAL_SHARE, WEAK_CENTER_PX = 0.005, 4.0  # of 95 % intervals
NORMAL_95 = 1.96


@dataclass(frozen=True)
class CameraFit:
    """Lens and poses of least reprojection error; `shape` is the board as it is, in squares."""

    intrinsics: Float[np.ndarray, "9"]
    std: Float[np.ndarray, "9"]
    poses: Float[np.ndarray, "pictures 6"]
    shape: Float[np.ndarray, "corners 3"]
    residual_px: Float[np.ndarray, "pictures corners 2"]

    @property
    def rms_px(self) -> float:
        """RMS reprojection error per corner."""
        return rms_px(self.residual_px)

    @property
    def picture_rms_px(self) -> Float[np.ndarray, "pictures"]:
        """The same picture by picture."""
        return np.sqrt(np.mean(np.sum(self.residual_px**2, axis=-1), axis=-1))


@dataclass(frozen=True)
class CameraCalibration:
    """The fit that predicts left-out pictures best, the flat board's beside it, and which pictures were used."""

    fit: CameraFit
    flat: CameraFit
    bent: CameraFit
    held_out_rms_px: float
    flat_held_out_rms_px: float
    bent_held_out_rms_px: float
    used: tuple[int, ...]
    far_off: tuple[int, ...]
    weakness: str

    @property
    def board_is_bent(self) -> bool:
        """Whether the estimated shape was kept."""
        return self.fit is self.bent


def calibrate_camera(
    pixel: Float[np.ndarray, "pictures corners 2"], board: Checkerboard, size_px: tuple[int, int]
) -> CameraCalibration:
    """Calibrate from the corners found in each picture.

    A board pinned or taped to something is not flat; its shape is estimated along, and kept only where it helps on
    pictures left out (5-fold).

    Raises:
        CannotCalibrate: for too few pictures, or boards that all stand alike.
    """
    used = np.arange(len(pixel))
    far_off: list[int] = []
    while True:
        _check_count(used.size)
        flat, bent = _both(pixel[used], board, size_px)
        errors = bent.picture_rms_px
        worst = int(np.argmax(errors))
        if errors[worst] <= WORST_PICTURE * np.median(errors):
            break
        far_off.append(int(used[worst]))
        used = np.delete(used, worst)
    _check_poses(bent.poses)
    flat, flat_out = _judged(pixel[used], flat, board, bend=False)
    bent, bent_out = _judged(pixel[used], bent, board, bend=True)
    better = bent_out < SHAPE_GAIN * flat_out
    fit, out = (bent, bent_out) if better else (flat, flat_out)
    return CameraCalibration(
        fit, flat, bent, out, flat_out, bent_out, tuple(used.tolist()), tuple(far_off), _weakness(fit.std, fit)
    )


def _check_count(pictures: int) -> None:
    if pictures < LEAST_PICTURES:
        raise CannotCalibrate(f"{pictures} pictures can be used; at least {LEAST_PICTURES} are needed")


def _check_poses(poses: Float[np.ndarray, "pictures 6"]) -> None:
    """Boards that all stand alike leave the focal length open."""
    import cv2

    normals = np.array([cv2.Rodrigues(pose[:3])[0][:, 2] for pose in poses])
    mean = normals.mean(axis=0)
    off_deg = np.degrees(np.arccos(np.clip(normals @ (mean / np.linalg.norm(mean)), -1.0, 1.0)))
    if off_deg.max() < PARALLEL_DEG:
        raise CannotCalibrate(
            f"the boards are all parallel within {off_deg.max():.1f} deg; tilt them by {PARALLEL_DEG:g} deg or more"
        )


def _weakness(std: Float[np.ndarray, "9"], fit: CameraFit) -> str:
    interval = NORMAL_95 * std
    faults = []
    focal = float(max(interval[0] / fit.intrinsics[0], interval[1] / fit.intrinsics[1]))
    if not focal < WEAK_FOCAL_SHARE:
        faults.append(f"the focal length is known to {100 * focal:.2g} % only (95 %)")
    center = float(max(interval[3], interval[4]))
    if not center < WEAK_CENTER_PX:
        faults.append(f"the centre is known to {center:.2g} px only (95 %)")
    return "; ".join(faults)


def _both(
    pixel: Float[np.ndarray, "pictures corners 2"], board: Checkerboard, size_px: tuple[int, int]
) -> tuple[CameraFit, CameraFit]:
    intrinsics, poses = _start(pixel, board, size_px)
    flat = fit_camera(pixel, board.corners, intrinsics, poses, bend=False)
    return flat, fit_camera(pixel, board.corners, flat.intrinsics, flat.poses, bend=True)


def _start(
    pixel: Float[np.ndarray, "pictures corners 2"], board: Checkerboard, size_px: tuple[int, int]
) -> tuple[Float[np.ndarray, "9"], Float[np.ndarray, "pictures 6"]]:
    """An equidistant lens about the picture's middle, of the focal length under which the boards look flattest.

    Raises:
        CannotCalibrate: where none does.
    """
    best, start = np.inf, None
    for share in FIRST_FOCAL_SHARES:
        focal = share * size_px[0]
        lens = np.array([focal, focal, 0.0, (size_px[0] - 1) / 2, (size_px[1] - 1) / 2, 0.0, 0.0, 0.0, 0.0])
        poses = [first_pose(lens, board.corners, corners) for corners in pixel]
        known = [(pose, corners) for pose, corners in zip(poses, pixel, strict=True) if pose is not None]
        if len(known) < len(pixel):
            continue
        error = float(np.median([rms_px(seen(lens, pose, board.corners).pixel - at) for pose, at in known]))
        if error < best:
            best, start = error, (lens, np.array([pose for pose, _ in known]))
    if start is None:
        raise CannotCalibrate("no fisheye camera fits these boards; are they of another size?")
    return start


def fit_camera(
    pixel: Float[np.ndarray, "pictures corners 2"],
    corners: Float[np.ndarray, "corners 3"],
    intrinsics: Float[np.ndarray, "9"],
    poses: Float[np.ndarray, "pictures 6"],
    bend: bool,
) -> CameraFit:
    """Levenberg-Marquardt over lens, poses and, where `bend`, the corners' places on the board, which have a prior."""
    pictures, now = len(pixel), (intrinsics, poses, corners)
    H, g, residual, cost = _normal_equations(pixel, corners, *now, bend)
    damping = FIRST_DAMPING
    for _ in range(STEPS):
        step = -np.linalg.solve(H + damping * np.diag(np.diag(H)), g)
        tried = (
            now[0] + step[:9],
            now[1] + step[9 : 9 + 6 * pictures].reshape(-1, 6),
            now[2] + step[9 + 6 * pictures :].reshape(-1, 3) if bend else corners,
        )
        trial = _normal_equations(pixel, corners, *tried, bend)
        if not trial[3] <= cost:
            damping = max(10 * damping, LEAST_DAMPING)
            if damping > MOST_DAMPING:
                break
            continue
        gain = cost - trial[3]
        now, (H, g, residual, cost) = tried, trial
        damping = damping / 10 if damping > LEAST_DAMPING else 0.0
        if gain < SETTLED * cost:
            break
    intrinsics, poses, shape = now
    freedom = max(residual.size - len(g), 1)
    variance = float(np.sum(residual**2)) / freedom
    return CameraFit(intrinsics, np.sqrt(variance * np.diag(np.linalg.inv(H))[:9]), poses, shape, residual)


def _normal_equations(
    pixel: np.ndarray, corners: np.ndarray, intrinsics: np.ndarray, poses: np.ndarray, shape: np.ndarray, bend: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Hessian, gradient, residuals and cost; unknowns are the lens, the poses, then the corners' places."""
    pictures, count = len(pixel), len(shape)
    size = 9 + 6 * pictures + (3 * count if bend else 0)
    H, g, residual = np.zeros((size, size)), np.zeros(size), np.empty(pixel.shape)
    last = np.arange(9 + 6 * pictures, size)
    each = np.arange(count)
    for i in range(pictures):
        view = seen(intrinsics, poses[i], shape)
        residual[i] = view.pixel - pixel[i]
        parts = [view.by_lens.reshape(-1, 9), view.by_pose.reshape(-1, 6)]
        if bend:
            own = np.zeros((count, 2, count, 3))  # a corner moves its own picture only
            own[each, :, each] = view.by_point
            parts.append(own.reshape(2 * count, 3 * count))
        J = np.concatenate(parts, axis=1)
        place = np.concatenate([np.arange(9), np.arange(9 + 6 * i, 15 + 6 * i), last])
        H[np.ix_(place, place)] += J.T @ J
        g[place] += J.T @ residual[i].ravel()
    cost = float(np.sum(residual**2))
    if bend:
        weight = np.tile((CORNER_PX / np.array([IN_PLANE_SQUARES, IN_PLANE_SQUARES, BEND_SQUARES])) ** 2, count)
        off = (shape - corners).ravel()
        H[last, last] += weight
        g[last] += weight * off
        cost += float(np.sum(weight * off**2))
    return H, g, residual, cost


def _judged(
    pixel: Float[np.ndarray, "pictures corners 2"], fit: CameraFit, board: Checkerboard, bend: bool
) -> tuple[CameraFit, float]:
    """Fold by fold without some pictures: the RMS error of those, and standard deviations no smaller than folds differ.

    Of pictures left out the poses alone are fitted. Where folds differ by more than the corners' scatter explains
    (delete-a-group jackknife, the mean of all unknowns), the model lacks something, and the stated deviations grow.
    """
    residuals, lenses = [], []
    folds = min(FOLDS, len(pixel))
    for fold in range(folds):
        out: Bool[np.ndarray, " pictures"] = np.arange(len(pixel)) % folds == fold
        part = fit_camera(pixel[~out], board.corners, fit.intrinsics, fit.poses[~out], bend)
        lenses.append(part.intrinsics)
        for corners, pose in zip(pixel[out], fit.poses[out], strict=True):
            residuals.append(settled_pose(part.intrinsics, part.shape, corners, pose)[1])
    variance = (folds - 1) * np.var(lenses, axis=0)
    wider = max(float(np.sqrt(np.mean(variance / fit.std**2))), 1.0)
    return replace(fit, std=wider * fit.std), rms_px(np.array(residuals))


def board_error_px(
    intrinsics: Float[np.ndarray, "9"],
    pixel: Sequence[Float[np.ndarray, "corners 2"]],
    shape: Float[np.ndarray, "corners 3"],
) -> float:
    """RMS reprojection error that a given lens leaves on given corners, each board's pose fitted."""
    residuals = []
    for corners in pixel:
        pose = first_pose(intrinsics, shape * [1, 1, 0], corners)
        if pose is None:
            return float("nan")
        residuals.append(settled_pose(intrinsics, shape, corners, pose)[1])
    return rms_px(np.array(residuals))

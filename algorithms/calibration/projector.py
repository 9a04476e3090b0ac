"""The projector's calibration: slits seen on flat boards of known pose, one cone of light to each slit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from algorithms.calibration.failure import CannotCalibrate
from algorithms.robust import spread
from sensor_model.geometry import cone_frame, fisheye_rays, jag_rad, projector_azimuth_rad, transform

STEPS, SETTLED = 60, 1e-7
CUT_SIGMAS, LEAST_SIGMA_MM = 3.0, 0.02
LEAST_POINTS, LEAST_BOARDS, LEAST_HALVED = 100, 2, 8
LEAST_RANGE_SPREAD = 0.05  # of the mean range: boards that all stand alike leave apex and angle open
WORST_CONDITION = 1e10
FIRST_APEX_MM, FIRST_AXIS = np.array([0.0, 0.0, -50.0]), np.array([0.0, 0.0, 1.0])
ALIKE_POINTS = 8.0  # neighbours on a jagged slit that err alike count as one
POSE_STEP = 1e-6
ALIKE_CORNERS = 4.0  # so do the corners of a marker
JAG_CELLS = 360  # of the correction's table around the slide
SLIDE_GAIN = 0.98  # a correction is kept that takes the left-out residual below this share
WEAK_ANGLE_DEG = 0.2
LEAST_JAG_COUNT, JAG_PRIOR_COUNT = 2, 0.5


@dataclass(frozen=True)
class BoardPoints:
    """Where slits were seen on boards: camera frame, slit, number of the board."""

    xyz_mm: Float[np.ndarray, "n 3"]
    slit: Int[np.ndarray, "n"]
    board: Int[np.ndarray, "n"]

    def of(self, chosen: Bool[np.ndarray, "n"]) -> BoardPoints:
        """Some of them."""
        return BoardPoints(self.xyz_mm[chosen], self.slit[chosen], self.board[chosen])


@dataclass(frozen=True)
class Cones:
    """Cones of light: apex and axis of each slit (the same for all where they share them), half angles, inliers."""

    apex_mm: Float[np.ndarray, "slits 3"]
    axis: Float[np.ndarray, "slits 3"]
    half_angle_rad: Float[np.ndarray, "slits"]
    std: Float[np.ndarray, "unknowns"]
    inliers: Bool[np.ndarray, "n"]


def on_board(
    pixel: Float[np.ndarray, "n 2"], intrinsics: Float[np.ndarray, "9"], T_camera_board: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n 3"]:
    """Where camera rays meet the board's plane (camera frame, mm); NaN where they do not, ahead."""
    rays = fisheye_rays(pixel, intrinsics)
    normal, place = T_camera_board[:3, 2], T_camera_board[:3, 3]
    facing = rays @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        range_mm = (place @ normal) / facing
    return np.where((range_mm > 0)[:, None], range_mm[:, None] * rays, np.nan)


def fit_projector(points: BoardPoints, slits: int, shared: bool = True) -> Cones:
    """Cones through points on boards: Gauss-Newton on distances from the cones, points far off cut and tried again.

    Shared: one apex and one axis for all slits (5 + slits unknowns); else each slit has its own.

    Raises:
        CannotCalibrate: where the points leave the cones open.
    """
    _check(points)
    if shared:
        return _fit_shared(points.xyz_mm, points.slit, slits)
    apex, axis, angle = np.full((slits, 3), np.nan), np.full((slits, 3), np.nan), np.full(slits, np.nan)
    inliers = np.zeros(points.slit.size, dtype=bool)
    for j in range(slits):
        mine = points.slit == j
        if np.count_nonzero(mine) >= LEAST_POINTS and np.unique(points.board[mine]).size >= LEAST_BOARDS:
            own = _fit_shared(points.xyz_mm[mine], np.zeros(np.count_nonzero(mine), dtype=np.int64), 1)
            apex[j], axis[j], angle[j] = own.apex_mm[0], own.axis[0], own.half_angle_rad[0]
            inliers[mine] = own.inliers
    return Cones(apex, axis, angle, np.zeros(0), inliers)


def _check(points: BoardPoints) -> None:
    if np.unique(points.board).size < LEAST_BOARDS or points.slit.size < LEAST_POINTS:
        raise CannotCalibrate(
            f"{points.slit.size} slit points on {np.unique(points.board).size} boards; at least {LEAST_POINTS} points "
            f"on {LEAST_BOARDS} boards are needed"
        )
    depth = points.xyz_mm[:, 2]
    if np.std(depth) < LEAST_RANGE_SPREAD * np.mean(depth):
        raise CannotCalibrate(
            f"all boards stand {np.mean(depth):.0f} mm away within {np.std(depth):.1f} mm; apex and angle cannot be "
            "told apart: put the board nearer and further"
        )


def _fit_shared(xyz_mm: Float[np.ndarray, "n 3"], slit: Int[np.ndarray, "n"], slits: int) -> Cones:
    apex, axis = FIRST_APEX_MM, FIRST_AXIS
    kept = np.ones(slit.size, dtype=bool)
    angle, _ = _angles(xyz_mm, apex, axis)
    half = np.array([np.median(angle[slit == j]) if (slit == j).any() else np.nan for j in range(slits)])
    known = np.flatnonzero(np.isfinite(half))
    column = np.full(slits, -1)
    column[known] = np.arange(known.size)
    for _ in range(STEPS):
        J, residual = _slopes(xyz_mm, slit, apex, axis, half, column, known.size)
        kept = _inliers(residual, slit, slits, kept)
        H = J[kept].T @ J[kept]
        if np.linalg.cond(H / np.sqrt(np.outer(np.diag(H), np.diag(H)))) > WORST_CONDITION:
            raise CannotCalibrate("the boards leave the cones open: put the board nearer and further, and tilt it")
        step = -np.linalg.solve(H, J[kept].T @ residual[kept])
        apex, axis, half = _moved(apex, axis, half, known, step)
        if np.abs(step).max() < SETTLED:
            break
    variance = float(np.sum(residual[kept] ** 2)) / max(kept.sum() - H.shape[0], 1)
    std = np.sqrt(ALIKE_POINTS * variance * np.diag(np.linalg.inv(H)))
    return Cones(np.tile(apex, (slits, 1)), np.tile(axis, (slits, 1)), half, std, kept)


def _inliers(residual: np.ndarray, slit: np.ndarray, slits: int, kept: np.ndarray) -> np.ndarray:
    """What lies near its slit's own middle residual; each slit is as rough as it is."""
    out = np.zeros(slit.size, dtype=bool)
    for j in range(slits):
        mine = slit == j
        if (mine & kept).any():
            sigma = max(spread(residual[mine & kept]), LEAST_SIGMA_MM)
            out[mine] = np.abs(residual[mine] - np.median(residual[mine & kept])) < CUT_SIGMAS * sigma
    return out


def _moved(
    apex: np.ndarray, axis: np.ndarray, half: np.ndarray, known: np.ndarray, step: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    tilted = cone_frame(axis) @ np.array([step[3], step[4], 1.0])
    moved = half.copy()
    moved[known] += step[5 : 5 + known.size]
    return apex + step[:3], tilted / np.linalg.norm(tilted), moved


def _angles(xyz_mm: np.ndarray, apex: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angle of each point's light with the axis, and its distance from the apex."""
    to = xyz_mm - apex
    along = to @ axis
    across = np.linalg.norm(to - along[:, None] * axis, axis=1)
    return np.arctan2(across, along), np.hypot(across, along)


def _slopes(
    xyz_mm: np.ndarray,
    slit: np.ndarray,
    apex: np.ndarray,
    axis: np.ndarray,
    half: np.ndarray,
    column: np.ndarray,
    count: int,
) -> tuple[Float[np.ndarray, "n unknowns"], Float[np.ndarray, "n"]]:
    """Distances from the cones, mm, and their derivatives by apex, axis (two tilts) and half angles."""
    angle, range_mm = _angles(xyz_mm, apex, axis)
    residual = (angle - half[slit]) * range_mm
    to = xyz_mm - apex
    along = to @ axis
    outward = to - along[:, None] * axis
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    frame = cone_frame(axis)
    J = np.zeros((slit.size, 5 + count))
    # the apex moved along the cone's normal moves the cone by as much
    J[:, :3] = -(outward * np.cos(angle)[:, None] - axis * np.sin(angle)[:, None])
    J[:, 3] = -range_mm * (outward @ frame[:, 0])
    J[:, 4] = -range_mm * (outward @ frame[:, 1])
    J[np.arange(slit.size), 5 + column[slit]] = -range_mm
    return J, residual


def distances_mm(points: BoardPoints, cones: Cones) -> Float[np.ndarray, "n"]:
    """How far each point lies off its slit's cone."""
    out = np.full(points.slit.size, np.nan)
    for j in range(cones.half_angle_rad.size):
        mine = points.slit == j
        angle, range_mm = _angles(points.xyz_mm[mine], cones.apex_mm[j], cones.axis[j])
        out[mine] = (angle - cones.half_angle_rad[j]) * range_mm
    return out


def azimuths_rad(xyz_mm: Float[np.ndarray, "n 3"], cones: Cones) -> Float[np.ndarray, "n"]:
    """Azimuth of points about the projector's axis."""
    return projector_azimuth_rad(xyz_mm, transform(cone_frame(cones.axis[0]), cones.apex_mm[0]))


def jag_table_rad(points: BoardPoints, cones: Cones) -> Float[np.ndarray, "slits cells"]:
    """The slide's own jaggedness: mean excess of the half angle by slit and azimuth; 0 where it was not seen twice.

    `points` should be inliers only.
    """
    angle, _ = _angles(points.xyz_mm, cones.apex_mm[0], cones.axis[0])
    excess = angle - cones.half_angle_rad[points.slit]
    return excess_table_rad(excess, points.slit, azimuths_rad(points.xyz_mm, cones), cones.half_angle_rad.size)


def excess_table_rad(
    excess_rad: Float[np.ndarray, "n"], slit: Int[np.ndarray, "n"], azimuth_rad: Float[np.ndarray, "n"], slits: int
) -> Float[np.ndarray, "slits cells"]:
    """Mean excess by slit and azimuth, drawn towards nothing where few points speak."""
    cell = (azimuth_rad / (2 * np.pi) * JAG_CELLS).astype(np.int64) % JAG_CELLS
    place = slit * JAG_CELLS + cell
    count = np.bincount(place, minlength=slits * JAG_CELLS)
    total = np.bincount(place, weights=excess_rad, minlength=slits * JAG_CELLS)
    mean = np.where(count >= LEAST_JAG_COUNT, total / (count + JAG_PRIOR_COUNT), 0.0)
    return mean.reshape(slits, JAG_CELLS)


@dataclass(frozen=True)
class SeenBoards:
    """Boards with slits on them: pixels, slit and board of each point; pose of each board and what it is worth.

    `information` is of the pose (rotation vector and translation, camera frame) per px2 of corner error.
    """

    pixel: Float[np.ndarray, "n 2"]
    slit: Int[np.ndarray, "n"]
    board: Int[np.ndarray, "n"]
    poses: Float[np.ndarray, "boards 6"]
    information: Float[np.ndarray, "boards 6 6"]
    corner_px: Float[np.ndarray, "boards"]

    def some(self, boards: Int[np.ndarray, "some"]) -> SeenBoards:
        """Only some of the boards, numbered anew."""
        chosen = np.isin(self.board, boards)
        number = np.full(len(self.poses), -1)
        number[boards] = np.arange(boards.size)
        return SeenBoards(
            self.pixel[chosen],
            self.slit[chosen],
            number[self.board[chosen]],
            self.poses[boards],
            self.information[boards],
            self.corner_px[boards],
        )


@dataclass(frozen=True)
class ProjectorFit:
    """Cones and the boards' poses that agree with them, and the points on the boards."""

    cones: Cones
    poses: Float[np.ndarray, "boards 6"]
    points: BoardPoints


def points_on(seen: SeenBoards, poses: Float[np.ndarray, "boards 6"], intrinsics: np.ndarray) -> BoardPoints:
    """All slit points on boards that stand so."""
    rays = fisheye_rays(seen.pixel, intrinsics)
    planes = np.array([_plane(pose) for pose in poses])
    facing = np.einsum("ni,ni->n", rays, planes[seen.board, :3])
    return BoardPoints(rays * (planes[seen.board, 3] / facing)[:, None], seen.slit, seen.board)


def _plane(pose: np.ndarray) -> np.ndarray:
    """Normal and distance of a board's plane."""
    normal = Rotation.from_rotvec(pose[:3]).as_matrix()[:, 2]
    return np.append(normal, normal @ pose[3:])


def fit_with_boards(seen: SeenBoards, intrinsics: Float[np.ndarray, "9"], slits: int) -> ProjectorFit:
    """Cones of shared apex and axis together with the boards' poses, each held by its markers.

    A few markers in a corner of the board fix its plane under the rings badly; eight cones seen on it help.

    Raises:
        CannotCalibrate: where the points leave the cones open.
    """
    poses = seen.poses
    points = points_on(seen, poses, intrinsics)
    _check(points)
    start = _fit_shared(points.xyz_mm, points.slit, slits)
    apex, axis, half, kept = start.apex_mm[0], start.axis[0], start.half_angle_rad, start.inliers
    known = np.flatnonzero(np.isfinite(half))
    column = np.full(slits, -1)
    column[known] = np.arange(known.size)
    first = 5 + known.size
    rays = fisheye_rays(seen.pixel, intrinsics)
    for _ in range(STEPS):
        points = points_on(seen, poses, intrinsics)
        J, residual = _slopes(points.xyz_mm, seen.slit, apex, axis, half, column, known.size)
        kept = _inliers(residual, seen.slit, slits, kept)
        sigma = np.array([max(spread(residual[kept & (seen.slit == j)]), LEAST_SIGMA_MM) if j in known else 1.0
                          for j in range(slits)])  # fmt: skip
        J = np.concatenate([J, _by_boards(seen, poses, rays, points, -J[:, :3])], axis=1)
        weight = kept / (ALIKE_POINTS * sigma[seen.slit] ** 2)
        H, g = (J * weight[:, None]).T @ J, (J * weight[:, None]).T @ residual
        for i in range(len(poses)):
            block = slice(first + 6 * i, first + 6 * i + 6)
            held = seen.information[i] / (ALIKE_CORNERS * max(seen.corner_px[i], 0.1) ** 2 / 2)
            H[block, block] += held
            g[block] += held @ (poses[i] - seen.poses[i])
        step = -np.linalg.solve(H, g)
        apex, axis, half = _moved(apex, axis, half, known, step)
        poses = poses + step[first:].reshape(-1, 6)
        if np.abs(step).max() < SETTLED:
            break
    std = np.sqrt(np.diag(np.linalg.inv(H)))[:first]
    cones = Cones(np.tile(apex, (slits, 1)), np.tile(axis, (slits, 1)), half, std, kept)
    return ProjectorFit(cones, poses, points_on(seen, poses, intrinsics))


def _by_boards(
    seen: SeenBoards, poses: np.ndarray, rays: np.ndarray, points: BoardPoints, normals: np.ndarray
) -> Float[np.ndarray, "n columns"]:
    """Change of the distances from the cones with the boards' poses; `normals` are those of the cones."""
    J = np.zeros((seen.slit.size, 6 * len(poses)))
    along = np.einsum("ni,ni->n", rays, normals)
    for i, pose in enumerate(poses):
        mine = seen.board == i
        plane = _plane(pose)
        facing = rays[mine] @ plane[:3]
        range_mm = np.einsum("ni,ni->n", points.xyz_mm[mine], rays[mine])
        for k in range(6):
            moved = pose.copy()
            moved[k] += POSE_STEP
            change = (_plane(moved) - plane) / POSE_STEP
            # n . (t ray) = d, differentiated
            by_range = (change[3] - range_mm * (rays[mine] @ change[:3])) / facing
            J[mine, 6 * i + k] = along[mine] * by_range
    return J


@dataclass(frozen=True)
class ProjectorCalibration:
    """The fit of all boards; what halves of the boards say; the slide's correction, judged on boards left out."""

    fit: ProjectorFit
    own: Cones
    halves: tuple[Cones, ...]
    table_rad: Float[np.ndarray, "slits cells"]
    plain_mm: Float[np.ndarray, "boards"]
    corrected_mm: Float[np.ndarray, "boards"]

    @property
    def correction_helps(self) -> bool:
        """Whether the correction learned from the other boards lowers the residual of a board left out."""
        return bool(np.mean(self.corrected_mm) < SLIDE_GAIN * np.mean(self.plain_mm))

    def residual_rms_mm(self, slit: int) -> float:
        """RMS distance of a slit's inliers from its cone."""
        mine = (self.fit.points.slit == slit) & self.fit.cones.inliers
        return float(np.sqrt(np.mean(distances_mm(self.fit.points, self.fit.cones)[mine] ** 2)))

    @property
    def weakness(self) -> str:
        """What makes it weak, in words."""
        known = np.isfinite(self.fit.cones.half_angle_rad)
        worst_deg = float(np.degrees(1.96 * self.fit.cones.std[5:].max()))
        faults = [] if worst_deg < WEAK_ANGLE_DEG else [f"half angles are known to {worst_deg:.2g} deg only (95 %)"]
        apart = [np.degrees(np.nanmax(np.abs(half.half_angle_rad - self.fit.cones.half_angle_rad)[known]))
                 for half in self.halves]  # fmt: skip
        if apart and max(apart) > WEAK_ANGLE_DEG:
            faults.append(f"halves of the boards put a half angle {max(apart):.2g} deg off")
        return "; ".join(faults)


def calibrate_projector(seen: SeenBoards, intrinsics: Float[np.ndarray, "9"], slits: int) -> ProjectorCalibration:
    """Fit the cones, try two halves of the boards apart, and learn the slide's jaggedness.

    Raises:
        CannotCalibrate: where the boards leave the cones open.
    """
    fit = fit_with_boards(seen, intrinsics, slits)
    boards = len(seen.poses)
    halves = [np.arange(boards)[first::2] for first in (0, 1)] if boards >= LEAST_HALVED else []
    plain, corrected = [], []
    for left_out in range(boards if boards > LEAST_BOARDS else 0):
        others = np.delete(np.arange(boards), left_out)
        taught = fit_with_boards(seen.some(others), intrinsics, slits)
        table = jag_table_rad(taught.points.of(taught.cones.inliers), taught.cones)
        rms = _left_out_mm(fit, seen.board == left_out, taught.cones, table)
        plain.append(rms[0])
        corrected.append(rms[1])
    table = jag_table_rad(fit.points.of(fit.cones.inliers), fit.cones)
    return ProjectorCalibration(
        fit,
        fit_projector(fit.points, slits, shared=False),
        tuple(fit_with_boards(seen.some(half), intrinsics, slits).cones for half in halves),
        table,
        np.array(plain) if plain else np.zeros(1),
        np.array(corrected) if corrected else np.ones(1),
    )


def _left_out_mm(
    fit: ProjectorFit, mine: Bool[np.ndarray, "n"], cones: Cones, table: Float[np.ndarray, "slits cells"]
) -> tuple[float, float]:
    """RMS distance of one board's inliers from cones that it had no part in, without and with their correction."""
    one = fit.points.of(mine & fit.cones.inliers)
    off = distances_mm(one, cones)
    range_mm = np.linalg.norm(one.xyz_mm - cones.apex_mm[0], axis=1)
    jag = jag_rad(table, one.slit, azimuths_rad(one.xyz_mm, cones)) * range_mm
    known = np.isfinite(off)
    return float(np.sqrt(np.mean(off[known] ** 2))), float(np.sqrt(np.mean((off - jag)[known] ** 2)))

"""The projector's calibration: slits seen on flat boards that their markers place, one cone of light to each slit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from algorithms.calibration.cone_fit import ConeFit, Sight, first_cones, fit_cones, points_mm
from algorithms.calibration.cones import Cones, excess_rad
from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.slide import excess_table_rad
from algorithms.calibration.surfaces import FlatBoard, Places
from sensor_model.geometry import cone_frame, fisheye_rays, jag_rad, projector_azimuth_rad

LEAST_POINTS, LEAST_BOARDS, LEAST_HALVED = 100, 2, 8
MOST_GROUPS = 8  # of boards that are left out in turn; of fewer boards, each by itself
LEAST_RANGE_SPREAD = 0.05  # of the mean range: boards that all stand alike leave apex and angle open
ALIKE_CORNERS = 16.0  # corners near each other err alike, by how the board is printed and bent and by the lens
LEAST_CORNER_PX = 0.1
SLIDE_GAIN = 0.98  # a correction is kept that takes the left-out residual below this share
WEAK_ANGLE_DEG = 0.2
NORMAL_95 = 1.96


@dataclass(frozen=True)
class SeenBoards:
    """Boards with slits on them: pixels, their noise, slit and board of each; pose of each board, what it is worth.

    `information` is of the pose (rotation vector and translation, camera frame) per px2 of corner error.
    """

    pixel: Float[np.ndarray, "n 2"]
    sigma_px: Float[np.ndarray, "n"]
    slit: Int[np.ndarray, "n"]
    board: Int[np.ndarray, "n"]
    poses: Float[np.ndarray, "boards 6"]
    information: Float[np.ndarray, "boards 6 6"]
    corner_px: Float[np.ndarray, "boards"]

    def sights(self, intrinsics: Float[np.ndarray, "9"]) -> list[Sight]:
        """Each board with its rays, held where its markers put it."""
        rays, sigma_rad = fisheye_rays(self.pixel, intrinsics), self.sigma_px / intrinsics[0]
        px2 = ALIKE_CORNERS * np.maximum(self.corner_px, LEAST_CORNER_PX) ** 2 / 2
        held = self.information / px2[:, None, None]
        mine = [self.board == i for i in range(len(self.poses))]
        return [
            Sight(rays[one], self.slit[one], FlatBoard(self.poses[i], held[i]), sigma_rad[one])
            for i, one in enumerate(mine)
        ]


@dataclass(frozen=True)
class ProjectorCalibration:
    """The fit of all boards; each slit's cone by itself; what halves of the boards say; the slide's correction.

    `covariance` is of apex, two tilts and half angles: the fit's own, or so much larger as leaving out boards in turn
    shows them to disagree.
    """

    fit: ConeFit
    covariance: Float[np.ndarray, "unknowns unknowns"]
    own_half_angle_rad: Float[np.ndarray, "slits"]
    halves: tuple[Cones, ...]
    table_rad: Float[np.ndarray, "slits cells"]
    plain_mm: Float[np.ndarray, "groups"]
    corrected_mm: Float[np.ndarray, "groups"]

    @property
    def correction_helps(self) -> bool:
        """Whether the correction learned from the other boards lowers the residual of those left out."""
        return bool(np.mean(self.corrected_mm) < SLIDE_GAIN * np.mean(self.plain_mm))

    @property
    def half_angle_std_rad(self) -> Float[np.ndarray, "slits"]:
        """Standard deviations of the half angles."""
        return np.sqrt(np.diag(self.covariance)[5:])

    @property
    def weakness(self) -> str:
        """What makes it weak, in words."""
        half = self.fit.cones.half_angle_rad
        worst_deg = float(np.degrees(NORMAL_95 * self.half_angle_std_rad.max()))
        faults = [] if worst_deg < WEAK_ANGLE_DEG else [f"half angles are known to {worst_deg:.2g} deg only (95 %)"]
        apart = [float(np.degrees(np.nanmax(np.abs(one.half_angle_rad - half)))) for one in self.halves]
        if apart and max(apart) > WEAK_ANGLE_DEG:
            faults.append(f"halves of the boards put a half angle {max(apart):.2g} deg off")
        return "; ".join(faults)


def fit_boards(sights: list[Sight], slits: int, start: Cones | None = None) -> ConeFit:
    """Cones of shared apex and axis together with the boards' poses, each held by its markers.

    A few markers in a corner of the board fix its plane under the rings badly; eight cones seen on it help.

    Raises:
        CannotCalibrate: where the boards leave the cones open.
    """
    points = sum(one.slit.size for one in sights)
    if len(sights) < LEAST_BOARDS or points < LEAST_POINTS:
        raise CannotCalibrate(
            f"{points} slit points on {len(sights)} boards; at least {LEAST_POINTS} points on {LEAST_BOARDS} boards "
            "are needed"
        )
    depth = np.concatenate([points_mm(one, np.zeros(6), np.zeros(0))[:, 2] for one in sights])
    if np.std(depth) < LEAST_RANGE_SPREAD * np.mean(depth):
        raise CannotCalibrate(
            f"all boards stand {np.mean(depth):.0f} mm away within {np.std(depth):.1f} mm; apex and angle cannot be "
            "told apart: put the board nearer and further"
        )
    return fit_cones(sights, start or first_cones(sights, slits))


def calibrate_projector(seen: SeenBoards, intrinsics: Float[np.ndarray, "9"], slits: int) -> ProjectorCalibration:
    """Fit the cones, try two halves of the boards apart, and learn the slide's jaggedness.

    Raises:
        CannotCalibrate: where the boards leave the cones open.
    """
    sights = seen.sights(intrinsics)
    fit = fit_boards(sights, slits)
    groups = min(len(sights), MOST_GROUPS) if len(sights) > LEAST_BOARDS else 0
    group = np.arange(len(sights)) % max(groups, 1)
    plain, corrected, moved = [], [], []
    for out in range(groups):
        taught = fit_boards([sights[i] for i in np.flatnonzero(group != out)], slits, fit.cones)
        rms = _left_out_mm(fit, group[fit.picture] == out, taught.cones, jag_table_rad(taught))
        plain.append(rms[0])
        corrected.append(rms[1])
        moved.append(_moved_by(fit.cones, taught.cones))
    halved = (0, 1) if len(sights) >= LEAST_HALVED else ()
    return ProjectorCalibration(
        fit,
        fit.covariance * _disagreement(np.array(moved), fit.std),
        np.array([_own_half_angle_rad(fit, j) for j in range(slits)]),
        tuple(fit_boards(sights[first::2], slits, fit.cones).cones for first in halved),
        jag_table_rad(fit),
        np.array(plain) if plain else np.zeros(1),
        np.array(corrected) if corrected else np.ones(1),
    )


def _moved_by(one: Cones, other: Cones) -> Float[np.ndarray, "unknowns"]:
    """The unknowns of one less those of the other."""
    tilt = (one.axis - other.axis) @ cone_frame(one.axis)[:, :2]
    return np.concatenate([one.apex_mm[0] - other.apex_mm[0], tilt, one.half_angle_rad - other.half_angle_rad])


def _disagreement(moved: Float[np.ndarray, "groups unknowns"], std: Float[np.ndarray, "unknowns"]) -> float:
    """How many times the stated variance the jackknife over the boards finds, the mean of all unknowns; at least 1."""
    if not len(moved):
        return 1.0
    variance = (len(moved) - 1) * np.nanmean(moved**2, axis=0)
    return max(float(np.nanmean(variance / std**2)), 1.0)


def _own_half_angle_rad(fit: ConeFit, slit: int) -> float:
    """Half angle of a slit's cone with an apex and an axis of its own; NaN where the boards leave it open."""
    xyz = fit.xyz_mm[fit.inliers & (fit.slit == slit)]
    range_mm = np.linalg.norm(xyz, axis=1)
    alone = Cones(fit.cones.apex_mm[:1], fit.cones.axis, fit.cones.half_angle_rad[slit : slit + 1])
    try:
        slits, exact = np.zeros(range_mm.size, dtype=np.int64), np.zeros(range_mm.size)
        one = Sight(xyz / range_mm[:, None], slits, Places(range_mm), exact)
        return float(fit_cones([one], alone).cones.half_angle_rad[0])
    except CannotCalibrate:
        return float("nan")


def jag_table_rad(fit: ConeFit) -> Float[np.ndarray, "slits cells"]:
    """The slide's own jaggedness: mean excess of the half angle by slit and azimuth; 0 where it was not seen twice."""
    used = fit.inliers
    azimuth = projector_azimuth_rad(fit.xyz_mm[used], fit.cones.T_camera_projector)
    return excess_table_rad(fit.excess_rad[used], fit.slit[used], azimuth, fit.cones.half_angle_rad.size)


def _left_out_mm(
    fit: ConeFit, left_out: Bool[np.ndarray, "n"], cones: Cones, table: Float[np.ndarray, "slits cells"]
) -> tuple[float, float]:
    """RMS distance of some boards' inliers from cones that they had no part in, without and with their correction."""
    mine = fit.inliers & left_out
    xyz, slit = fit.xyz_mm[mine], fit.slit[mine]
    off = excess_rad(xyz, slit, cones)
    jag = jag_rad(table, slit, projector_azimuth_rad(xyz, cones.T_camera_projector))
    range_mm = np.linalg.norm(xyz - cones.apex_mm[0], axis=1)
    known = np.isfinite(off)
    both = off * range_mm, (off - jag) * range_mm
    return float(np.sqrt(np.mean(both[0][known] ** 2))), float(np.sqrt(np.mean(both[1][known] ** 2)))

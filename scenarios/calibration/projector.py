"""`pipetwin calibrate projector`: pairs of pictures of a marked board in, the projector of a rig out, with a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from algorithms.calibration.board_pose import first_pose, rms_px, settled_pose
from algorithms.calibration.boards import ArucoGrid, marker_corners
from algorithms.calibration.cones import with_cones
from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.poses_needed import off_from, pose_curve
from algorithms.calibration.projector import NORMAL_95, ProjectorCalibration, SeenBoards, calibrate_projector
from algorithms.calibration.slide import with_jag
from algorithms.calibration.surfaces import plane_of
from algorithms.decode import DecodeSettings, decode
from scenarios.calibration.camera import page_of
from scenarios.calibration.covariance_file import write_covariance
from scenarios.calibration.in_pipe import read_for
from scenarios.calibration.pictures import ENDINGS, MOST_PICTURES, gray
from scenarios.calibration.pose_curve import curve_figures, curve_section
from scenarios.calibration.rig_file import write_rig
from scenarios.document import BadInput
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.canvas import SERIES, Picture, drawing, to_picture
from scenarios.run_folder import whole_file
from sensor_model.geometry import fisheye_rays, projector_azimuth_rad
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig

LEAST_MARKERS, LEAST_PAIRS, LEAST_POINTS = 4, 3, 100
MARGIN_MM = 8.0  # around the printed grid, where no slit is read
WHITE, RINGS = "Cam", "Proj"
SUBSET_SEED = 0


class Pair(NamedTuple):
    """One pose of the board: slit pixels on its white part, its pose, and what that is worth."""

    name: str
    seen: SlitPixels
    pose: Float[np.ndarray, "6"]
    information: Float[np.ndarray, "6 6"]
    corner_px: float
    markers: int


def calibrate(
    folder: Path, camera_rig: Rig, board: ArucoGrid, out: Path, true_rig: Rig | None = None
) -> dict[str, Any]:
    """Calibrate, write rig, covariance and page, and give the figures; with the true rig the errors too.

    Raises:
        BadInput: where the pictures do not do.
    """
    names = _pairs(folder)
    pairs, rejected = [], {}
    for name in names:
        try:
            pairs.append(_pair(name, camera_rig, board))
        except BadInput as error:
            rejected[name.stem] = error.lines[0]
    told = list(rejected.values())
    if len(pairs) < LEAST_PAIRS:
        short = f"{len(pairs)} of {len(names)} pairs can be used; at least {LEAST_PAIRS} are needed"
        raise BadInput([f"{folder}: {short}", *told])
    slits = camera_rig.projector.slits
    together = _together(pairs)
    try:
        found = calibrate_projector(together, camera_rig.camera.intrinsics, len(slits))
    except CannotCalibrate as error:
        raise BadInput([f"{folder}: {error}", *told]) from error
    lost = [slit.name for slit, angle in zip(slits, found.fit.cones.half_angle_rad, strict=True) if not angle > 0]
    if lost:
        raise BadInput([f"{folder}: no picture shows the slits {', '.join(lost)}", *told])
    rig = rig_of(found, camera_rig)
    write_rig(rig, out)
    write_covariance(rig.projector, found.covariance, out)
    sights = together.sights(camera_rig.camera.intrinsics)
    curve = pose_curve(sights, found.fit, camera_rig, true_rig, np.random.default_rng(SUBSET_SEED))
    figures = _figures(found, pairs, rejected, camera_rig)
    figures["poses"] = curve_figures(curve, true_rig is not None)
    if true_rig is not None:
        figures["off_true_rig"] = off_from(rig, true_rig)._asdict()
    with whole_file(page_of(out, "projector")) as work:
        work.write_text(_page(found, figures, camera_rig, curve_section(curve, true_rig is not None)), encoding="utf-8")
    return figures


def rig_of(found: ProjectorCalibration, base: Rig) -> Rig:
    """The rig with the calibrated projector."""
    rig = base.model_copy(update={"projector": with_cones(base.projector, found.fit.cones)})
    return with_jag(rig, found.table_rad) if found.correction_helps else rig


def _pairs(folder: Path) -> list[Path]:
    """The pictures under white light that have one under the rings.

    Raises:
        BadInput: when there are none.
    """
    if not folder.is_dir():
        raise BadInput([f"{folder}: is no folder; give one with {WHITE}NN.png and {RINGS}NN.png"])
    whites = sorted(file for file in folder.glob(f"{WHITE}*") if file.suffix.lower() in ENDINGS)
    found = [file for file in whites if _rings_of(file).is_file()]
    if not found or len(found) > MOST_PICTURES:
        held = f"holds {len(found)} pairs of pictures"
        raise BadInput([f"{folder}: {held}; give one with {WHITE}NN.png and {RINGS}NN.png, at most {MOST_PICTURES}"])
    return found


def _rings_of(white: Path) -> Path:
    return white.with_name(RINGS + white.name.removeprefix(WHITE))


def _pair(white: Path, rig: Rig, board: ArucoGrid) -> Pair:
    """Board pose from the markers, slits from the picture under the rings, less those on the printed grid.

    Raises:
        BadInput: saying what is wrong with the pair.
    """
    markers = marker_corners(gray(read_for(white, rig)), board)
    if markers.ids.size < LEAST_MARKERS:
        raise BadInput(
            [f"{white}: {markers.ids.size} markers of the board are read; at least {LEAST_MARKERS} are needed"]
        )
    intrinsics = rig.camera.intrinsics
    start = first_pose(intrinsics, markers.board_mm, markers.pixel)
    if start is None:
        raise BadInput([f"{white}: its markers give no pose of the board"])
    pose, residual, information = settled_pose(intrinsics, markers.board_mm, markers.pixel, start, robust=True)
    seen = decode(read_for(_rings_of(white), rig), rig, DecodeSettings())
    kept = _off_the_print(seen, intrinsics, pose, board)
    if np.count_nonzero(kept) < LEAST_POINTS:
        raise BadInput([f"{_rings_of(white)}: {np.count_nonzero(kept)} slit points; {LEAST_POINTS} are needed"])
    on_white = SlitPixels(seen.pixel[kept], seen.slit[kept], seen.sigma_px[kept])
    return Pair(white.stem, on_white, pose, information, rms_px(residual), int(markers.ids.size))


def _off_the_print(seen: SlitPixels, intrinsics: np.ndarray, pose: np.ndarray, board: ArucoGrid) -> np.ndarray:
    rays, plane = fisheye_rays(seen.pixel, intrinsics), plane_of(pose)
    with np.errstate(divide="ignore", invalid="ignore"):
        range_mm = plane[3] / (rays @ plane[:3])
    x, y, _ = ((range_mm[:, None] * rays - pose[3:]) @ Rotation.from_rotvec(pose[:3]).as_matrix()).T
    pitch = board.marker_mm + board.gap_mm
    across = (x > -MARGIN_MM) & (x < board.columns * pitch - board.gap_mm + MARGIN_MM)
    along = (y > -MARGIN_MM) & (y < board.rows * pitch - board.gap_mm + MARGIN_MM)
    return np.isfinite(range_mm) & (range_mm > 0) & ~(across & along)


def _together(pairs: list[Pair]) -> SeenBoards:
    return SeenBoards(
        np.concatenate([pair.seen.pixel for pair in pairs]),
        np.concatenate([pair.seen.sigma_px for pair in pairs]),
        np.concatenate([pair.seen.slit for pair in pairs]),
        np.concatenate([np.full(pair.seen.slit.size, i) for i, pair in enumerate(pairs)]),
        np.array([pair.pose for pair in pairs]),
        np.array([pair.information for pair in pairs]),
        np.array([pair.corner_px for pair in pairs]),
    )


def _figures(found: ProjectorCalibration, pairs: list[Pair], rejected: dict[str, str], rig: Rig) -> dict[str, Any]:
    fit, cones, std = found.fit, found.fit.cones, np.sqrt(np.diag(found.covariance))
    return {
        "slits": [
            {
                "name": slit.name,
                "half_angle_deg": float(np.degrees(cones.half_angle_rad[j])),
                "interval_95_deg": float(np.degrees(NORMAL_95 * found.half_angle_std_rad[j])),
                "residual_rms_mm": fit.rms_mm(j),
                "points": int(((fit.slit == j) & fit.inliers).sum()),
                "own_cone_half_angle_deg": _or_none(np.degrees(found.own_half_angle_rad[j])),
                "halves_deg": [_or_none(np.degrees(half.half_angle_rad[j])) for half in found.halves],
            }
            for j, slit in enumerate(rig.projector.slits)
        ],
        "apex_mm": cones.apex_mm[0].tolist(),
        "apex_interval_95_mm": (NORMAL_95 * std[:3]).tolist(),
        "axis": cones.axis.tolist(),
        "axis_interval_95_deg": np.degrees(NORMAL_95 * std[3:5]).tolist(),
        "inlier_share": float(fit.inliers.mean()),
        "points_alike": fit.alike,
        "left_out_residual_mm": float(np.mean(found.plain_mm)),
        "left_out_residual_corrected_mm": float(np.mean(found.corrected_mm)),
        "correction_kept": found.correction_helps,
        "pairs_used": len(pairs),
        "pairs_rejected": rejected,
        "markers": {pair.name: f"{pair.markers} markers, {pair.corner_px:.2f} px" for pair in pairs},
        "weak": found.weakness,
    }


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _page(found: ProjectorCalibration, figures: dict[str, Any], rig: Rig, poses: Section) -> str:
    rows = [("slit", "half angle (deg)", "± (95 %)", "residual RMS (mm)", "points", "own cone (deg)", "halves (deg)")]
    for row in figures["slits"]:
        halves = ", ".join(_angle(angle, 2) for angle in row["halves_deg"])
        rows.append((row["name"], f"{row['half_angle_deg']:.3f}", f"{row['interval_95_deg']:.3f}",
                     f"{row['residual_rms_mm']:.3f}", str(row["points"]),
                     _angle(row["own_cone_half_angle_deg"], 3), halves))  # fmt: skip
    apex, axis = figures["apex_mm"], figures["axis"]
    place = (
        f"Apex at ({apex[0]:.2f}, {apex[1]:.2f}, {apex[2]:.2f}) mm, axis ({axis[0]:.4f}, {axis[1]:.4f}, {axis[2]:.4f})."
    )
    gain = f"{figures['left_out_residual_mm']:.3f} mm on boards left out, "
    gain += f"{figures['left_out_residual_corrected_mm']:.3f} mm with the jaggedness learned from the others"
    gain += "; the correction is kept." if found.correction_helps else "; the correction is not kept."
    boards = [("picture", "markers, their error"), *figures["markers"].items()]
    rejected = [f"{name}: not used: {why}" for name, why in figures["pairs_rejected"].items()]
    sections = [
        Section("Cones", [place], rows),
        Section("Distances from the cones", [gain], (), [_residual_figure(found, rig)]),
        poses,
        Section("Boards", rejected, boards),
    ]
    verdict = f"{len(rows) - 1} slits from {figures['pairs_used']} boards. " + (
        f"Weak: {figures['weak']}." if figures["weak"] else gain
    )
    return calibration_page("Projector calibration", "", verdict, not figures["weak"], sections)


def _angle(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _residual_figure(found: ProjectorCalibration, rig: Rig) -> Picture:
    fit = found.fit
    azimuth = np.degrees(projector_azimuth_rad(fit.xyz_mm, fit.cones.T_camera_projector))
    with drawing(10.0) as figure:
        for j, (axes, slit) in enumerate(
            zip(figure.subplots(len(rig.projector.slits), 1, sharex=True), rig.projector.slits, strict=True)
        ):
            for board in range(len(fit.own)):
                mine = (fit.slit == j) & (fit.picture == board) & fit.inliers
                axes.plot(azimuth[mine], fit.distance_mm[mine], ".", ms=1.2, color=SERIES[board % 6])
            axes.set_ylabel(f"{slit.name} (mm)")
        axes.set_xlabel("azimuth about the projector's axis (degrees)")
        return to_picture(
            figure,
            "Distances of the slit points from their cones over azimuth, a row a slit, a colour a board.",
            "What all boards show alike is the slide's own jaggedness.",
        )

"""Scoring: the only place where truth and estimate meet."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from algorithms.sizing.disposition import at_least
from algorithms.types import FrameResult, Reconstruction, WallMap, seen_share
from scenarios.equations import circle, depth_quality_pct, err_pct, error_pct, plane_normal, radius_closeness_pct
from scenarios.matching import false_calls, match
from scenarios.oracle import oracle_err_pct
from sensor_model.bent_light import shown_places
from sensor_model.geometry import fisheye_rays, twist_about_z_rad, wrap_rad
from sensor_model.optics import Optics
from sensor_model.rig import Rig
from sensor_model.wall_rays import near_wall, wall_ranges_mm
from sensor_model.ways import view_of
from twin.features.base import Feature
from twin.pipe import Pipe
from twin.truth import Truth

NEAR_DEFECT_MM = 5.0
SAME_CLOCK_DEG = 0.01
DRY_AIR = Optics()  # between sensor and wall: no glass, no water
RIM_MM = 1.0  # neighbouring pixels whose ranges differ by more see two walls, one behind the other


@dataclass(frozen=True)
class Score:
    """One flat row; `None` where the scenario leaves a figure without meaning (no defect found, say)."""

    defects_true: int
    defects_found: int
    false_calls: int | None
    length_error_mm_max: float | None
    width_error_mm_max: float | None
    depth_error_mm_max: float | None
    depth_bias_mm: float | None
    floors_not_seen: int
    at_least_wrong: int
    eq29_err_pct_max: float | None
    eq29_oracle_err_pct_max: float | None
    eq30_error_pct_max: float | None
    eq32_quality_pct: float | None
    radius_closeness_pct: float
    radius_closeness_wall_pct: float
    normal_variance: float
    center_variance_mm2: float
    center_variance_wall_mm2: float
    center_rms_mm: float
    tilt_rms_deg: float
    roll_rms_deg: float
    roll_max_deg: float
    distance_error_pct: float
    clock_spread_deg: float | None
    frames: int
    frames_registered: int
    decode_yield: float
    not_seen_share: float | None
    wrong_words: float
    map_rms_mm: float | None
    seen_share: float | None


MEANINGS = {
    "defects_true": "defects in the pipe",
    "defects_found": "of them found",
    "false_calls": "calls that match no true defect",
    "length_error_mm_max": "largest error of length (axial, at half depth), blind sizing",
    "width_error_mm_max": "largest error of width (arc, at half depth), blind sizing",
    "depth_error_mm_max": "largest error of the largest depth, where the floor was seen",
    "depth_bias_mm": "mean signed error of depth, where the floor was seen",
    "floors_not_seen": "found defects to whose floor no light came: their depth is a least one",
    "at_least_wrong": "of them less deep than the stated least depth",
    "eq29_err_pct_max": "Eq. 29, blind, worst defect",
    "eq29_oracle_err_pct_max": "Eq. 29 with the threshold chosen by the TRUE size (oracle), worst defect",
    "eq30_error_pct_max": "Eq. 30, worst defect",
    "eq32_quality_pct": "Eq. 32, depth quality",
    "radius_closeness_pct": "Eq. 28, all points of a frame",
    "radius_closeness_wall_pct": "Eq. 28 without defect points",
    "normal_variance": "Table 1: variance of the frames' plane normals",
    "center_variance_mm2": "Table 1: variance of the frames' circle centres",
    "center_variance_wall_mm2": "the same without defect points",
    "center_rms_mm": "camera centre across the pipe against the true pose, RMS",
    "tilt_rms_deg": "pipe axis against the true pose, RMS",
    "roll_rms_deg": "roll against the true pose, RMS",
    "roll_max_deg": "roll against the true pose, largest",
    "distance_error_pct": "travel at the end against the truth, in % of travel",
    "clock_spread_deg": "spread of measured clock positions over defects that truly share one",
    "frames": "frames in the recording",
    "frames_registered": "of them registered",
    "decode_yield": "slit pixels found, of all slits times azimuths",
    "not_seen_share": "share of the true defects' floor that no ring showed",
    "wrong_words": "share of decoded points given to a wrong slit, by the truth",
    "map_rms_mm": "wall map against the true radius, seen cells, RMS",
    "seen_share": "share of the scanned wall's cells that were seen",
}


@dataclass
class FrameTally:
    """What scoring gathers from each frame as it passes, so that no points need to be kept."""

    pipe: Pipe
    rig: Rig
    points: int = 0
    wrong: int = 0
    radius_mm: list[float] = field(default_factory=list)
    radius_wall_mm: list[float] = field(default_factory=list)
    center_mm: list[np.ndarray] = field(default_factory=list)
    center_wall_mm: list[np.ndarray] = field(default_factory=list)
    normal: list[np.ndarray] = field(default_factory=list)
    normal_wall: list[np.ndarray] = field(default_factory=list)
    optics: Optics = DRY_AIR

    @cached_property
    def outlines(self) -> Float[np.ndarray, "features 4"]:
        """Where the true defects are."""
        return defect_outlines(self.pipe)


def tally_frame(tally: FrameTally, result: FrameResult, T_true: Float[np.ndarray, "4 4"]) -> None:
    """Take one frame's figures: wrong words by the true pose, and the paper's circle and plane of Fig. 11c."""
    points = result.points
    if points.sigma_mm.size:
        tally.points += points.sigma_mm.size
        right = true_slits(tally.pipe, tally.rig, points.pixel, T_true, tally.optics) == points.ring
        tally.wrong += int(np.sum(~right))
    if result.alignment.converged:
        T, bore = result.alignment.T_pipe_camera, tally.pipe.bore_radius_mm
        tally_shape(tally, *placed(points.xyz_mm, result.kept, T, tally.outlines, bore))


def tally_shape(tally: FrameTally, xyz_pipe_mm: Float[np.ndarray, "n 3"], walls: int) -> None:
    """Take the circle and the plane of Fig. 11c, of all points of a frame and of the first, on the undamaged wall."""
    alone = xyz_pipe_mm[:walls] if walls > 10 else xyz_pipe_mm
    for xyz, centers, radii, normals in (
        (xyz_pipe_mm, tally.center_mm, tally.radius_mm, tally.normal),
        (alone, tally.center_wall_mm, tally.radius_wall_mm, tally.normal_wall),
    ):
        center, radius = circle(xyz[:, :2])
        centers.append(center)
        radii.append(radius)
        normals.append(plane_normal(xyz))


def true_slits(
    pipe: Pipe,
    rig: Rig,
    pixel: Float[np.ndarray, "n 2"],
    T_true: Float[np.ndarray, "4 4"],
    optics: Optics = DRY_AIR,
) -> np.ndarray:
    """The slit that a pixel really shows: its cone passes through the wall point there, give or take a slit's width.

    By way of the glass tube and of standing water, where the optics have them: through its surface, not in its mirror.

    -1 where there is none: a shadow taken for a slit, or a pixel off the pipe. A pixel at a rim, where its neighbour
    shows a wall much nearer or further, shows either of them.
    """
    slit, range_mm = _shown(pipe, rig, pixel, T_true, optics)
    for shift_px in (-1.0, 1.0):
        none = np.flatnonzero(slit < 0)
        if none.size == 0:
            break
        from_center = pixel[none] - [rig.camera.cx_px, rig.camera.cy_px]
        outward = from_center / np.maximum(np.linalg.norm(from_center, axis=1, keepdims=True), 1.0)
        beside, there_mm = _shown(pipe, rig, pixel[none] + shift_px * outward, T_true, optics)
        rim = np.abs(there_mm - range_mm[none]) > RIM_MM
        slit[none[rim]] = beside[rim]
    return slit


def _shown(
    pipe: Pipe, rig: Rig, pixel: Float[np.ndarray, "n 2"], T_true: Float[np.ndarray, "4 4"], optics: Optics
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """The slit in each pixel, -1 for none, and the range of the wall there."""
    eye, projector = T_true[:3, 3], rig.projector
    rays_camera = fisheye_rays(pixel, rig.camera.intrinsics)
    wall = near_wall(pipe, float(eye[2]))
    axis = tuple(projector.T_camera_projector[:3, 2].tolist())
    ends_mm = pipe.start_mm - eye[2], pipe.end_mm - eye[2]
    if optics.glass.thickness_mm > 0 or optics.water.depth_mm > 0:
        aimed, along, ways_mm = shown_places(wall, view_of(pipe, T_true, rig, optics.glass, optics.water), rays_camera)
        ones = np.ones(len(aimed))
        return _slits_at(aimed, along, ones, projector.apex_mm, axis, projector.slit_tangents, ends_mm), ways_mm
    rays = rays_camera @ T_true[:3, :3].T
    ranges = wall_ranges_mm(wall, tuple(eye.tolist()), rays)
    slit = _slits_at(rays_camera, rays[:, 2], ranges, projector.apex_mm, axis, projector.slit_tangents, ends_mm)
    return slit, ranges


@njit(cache=True, error_model="numpy")
def _slits_at(rays_camera, along_pipe, ranges, apex, axis, tangents, ends_mm):
    """The slit between whose two tangents (2, slits) the light to each place in the camera frame passes, else -1.

    Beyond the pipe's ends, as seen from the camera, there is none.
    """
    slit, tangent, low, high = np.full(ranges.size, -1), np.empty(ranges.size), ends_mm[0], ends_mm[1]
    for i in range(ranges.size):
        x, y = ranges[i] * rays_camera[i, 0] - apex[0], ranges[i] * rays_camera[i, 1] - apex[1]
        z = ranges[i] * rays_camera[i, 2] - apex[2]
        along = x * axis[0] + y * axis[1] + z * axis[2]
        across2 = x * x + y * y + z * z - along * along
        inside = (along > 0) & (low <= ranges[i] * along_pipe[i]) & (ranges[i] * along_pipe[i] <= high)
        tangent[i] = np.sqrt(across2 if across2 > 0.0 else 0.0) / along if inside else -1.0
    for k in range(tangents.shape[1]):
        begin, end = tangents[0, k], tangents[1, k]
        for i in range(ranges.size):
            slit[i] = k if (begin <= tangent[i]) & (tangent[i] <= end) else slit[i]
    return slit


def defect_outlines(pipe: Pipe) -> Float[np.ndarray, "features 4"]:
    """Of each true defect: distance, angle around the wall, half length and half width with what counts as near, mm."""
    sizes = [(feature, feature.size(pipe.bore_radius_mm)) for feature in pipe.features]
    rows = [(f.distance_mm, np.radians(f.clock_deg), size.length_mm / 2, size.width_mm / 2) for f, size in sizes]
    near = np.array([0.0, 0.0, NEAR_DEFECT_MM, NEAR_DEFECT_MM])
    return np.array(rows).reshape(-1, 4) + near


@njit(cache=True, error_model="numpy")
def placed(xyz_camera, kept, T_pipe_camera, outlines, bore_radius_mm):
    """The kept points in the pipe frame, those on or close to a true defect last, and how many are not."""
    T, n = T_pipe_camera, np.count_nonzero(kept)
    xyz, first, last = np.empty((n, 3)), 0, n
    for i in range(kept.size):
        if not kept[i]:
            continue
        px, py, pz = xyz_camera[i, 0], xyz_camera[i, 1], xyz_camera[i, 2]
        x = T[0, 0] * px + T[0, 1] * py + T[0, 2] * pz + T[0, 3]
        y = T[1, 0] * px + T[1, 1] * py + T[1, 2] * pz + T[1, 3]
        z = T[2, 0] * px + T[2, 1] * py + T[2, 2] * pz + T[2, 3]
        near = False
        for k in range(outlines.shape[0]):
            if abs(z - outlines[k, 0]) < outlines[k, 2]:
                turn = np.arctan2(x, -y) - outlines[k, 1]
                arc = bore_radius_mm * (turn - 2.0 * np.pi * np.round(turn / (2.0 * np.pi)))
                near = near or abs(arc) < outlines[k, 3]
        if near:
            last -= 1
        row = last if near else first
        first += not near
        xyz[row, 0], xyz[row, 1], xyz[row, 2] = x, y, z
    return xyz, first


def score(found: Reconstruction, truth: Truth, tally: FrameTally) -> Score:
    """Compare a reconstruction with what really happened."""
    return Score(
        **_defects(found, truth.pipe), **_table1(tally, truth.pipe), **_poses(found, truth), **_map(found, truth)
    )


def _worst(values: list[float]) -> float | None:
    return float(np.max(np.abs(values))) if values else None


def _defects(found: Reconstruction, pipe: Pipe) -> dict:
    pairs = match(pipe, found.defects)
    rows = [(pipe.features[i].size(pipe.bore_radius_mm), found.defects[j], pipe.features[i]) for i, j in pairs]
    measured = np.array([[d.length_mm, d.width_mm, d.depth_mm] for _, d, _ in rows]).reshape(-1, 3)
    true = np.array([list(size) for size, _, _ in rows]).reshape(-1, 3)
    error = measured - true
    lit = np.array([defect.floor_seen for _, defect, _ in rows], dtype=bool)
    least = [size.depth_mm < at_least(d.depth_mm, d.depth_std_mm) for size, d, _ in rows if not d.floor_seen]
    return {
        "defects_true": len(pipe.features),
        "defects_found": len(pairs),
        # what a scanned bore shows of its own, nobody listed
        "false_calls": None if pipe.scanned is not None else len(false_calls(pipe, found.defects, pairs)),
        "length_error_mm_max": _worst(list(error[:, 0])),
        "width_error_mm_max": _worst(list(error[:, 1])),
        "depth_error_mm_max": _worst(list(error[lit, 2])),
        "depth_bias_mm": float(error[lit, 2].mean()) if lit.any() else None,
        "floors_not_seen": int(np.sum(~lit)),
        "at_least_wrong": sum(least),
        "eq29_err_pct_max": _worst([err_pct(m[0], m[1], t[0], t[1]) for m, t in zip(measured, true, strict=True)]),
        "eq29_oracle_err_pct_max": _worst(oracle_err_pct(pipe, [f for _, _, f in rows if not f.inward], found)),
        "eq30_error_pct_max": _worst([error_pct(m, t) for m, t in zip(measured, true, strict=True)]),
        "eq32_quality_pct": depth_quality_pct(measured[:, 2], true[:, 2]) if rows else None,
        "clock_spread_deg": _clock_spread_deg(rows),
    }


def _clock_spread_deg(rows: list) -> float | None:
    """Largest disagreement in clock position between defects that truly share one; None without two such."""
    spread = [
        abs(float(np.degrees(wrap_rad(a[1].theta_rad - b[1].theta_rad))))
        for k, a in enumerate(rows)
        for b in rows[k + 1 :]
        if abs(wrap_rad(np.radians(a[2].clock_deg - b[2].clock_deg))) < np.radians(SAME_CLOCK_DEG)
    ]
    return max(spread) if spread else None


def _table1(tally: FrameTally, pipe: Pipe) -> dict:
    return {
        "radius_closeness_pct": radius_closeness_pct(np.array(tally.radius_mm), pipe.bore_radius_mm),
        "radius_closeness_wall_pct": radius_closeness_pct(np.array(tally.radius_wall_mm), pipe.bore_radius_mm),
        "normal_variance": float(np.var(np.array(tally.normal), axis=0).sum()),
        "center_variance_mm2": float(np.var(np.array(tally.center_mm), axis=0).sum()),
        "center_variance_wall_mm2": float(np.var(np.array(tally.center_wall_mm), axis=0).sum()),
        "wrong_words": tally.wrong / max(tally.points, 1),
    }


@dataclass(frozen=True)
class PoseErrors:
    """Estimated less true poses of the registered frames, one row a frame."""

    z_true_mm: Float[np.ndarray, "n"]
    center_mm: Float[np.ndarray, "n 2"]
    distance_mm: Float[np.ndarray, "n"]
    tilt_deg: Float[np.ndarray, "n"]
    roll_deg: Float[np.ndarray, "n"]


def pose_errors(found: Reconstruction, truth: Truth) -> PoseErrors:
    """Errors of the trajectory against the true poses at the frames' own stamps."""
    path, ok = found.trajectory, found.trajectory.registered
    T_true = truth.pose_at(path.stamp_ns[ok] / 1e9)
    T = path.T_pipe_camera[ok]
    # the pipe's axis in camera coordinates is the third row of R_pipe_camera
    cosine = np.clip(np.sum(T[:, 2, :3] * T_true[:, 2, :3], axis=1), -1, 1)
    sine = np.linalg.norm(np.cross(T[:, 2, :3], T_true[:, 2, :3]), axis=1)
    turn = T[:, :3, :3] @ np.swapaxes(T_true[:, :3, :3], -1, -2)
    shift = T[:, :3, 3] - T_true[:, :3, 3]
    return PoseErrors(
        z_true_mm=T_true[:, 2, 3],
        center_mm=shift[:, :2],
        distance_mm=shift[:, 2],
        tilt_deg=np.degrees(np.arctan2(sine, cosine)),
        roll_deg=np.degrees(twist_about_z_rad(turn)),
    )


def _poses(found: Reconstruction, truth: Truth) -> dict:
    errors = pose_errors(found, truth)
    travel = max(float(np.ptp(errors.z_true_mm)), 1e-9)
    return {
        "center_rms_mm": float(np.sqrt(np.mean(np.sum(errors.center_mm**2, axis=1)))),
        "tilt_rms_deg": float(np.sqrt(np.mean(errors.tilt_deg**2))),
        "roll_rms_deg": float(np.sqrt(np.mean(errors.roll_deg**2))),
        "roll_max_deg": float(np.max(np.abs(errors.roll_deg))),
        "distance_error_pct": float(abs(errors.distance_mm[-1] - errors.distance_mm[0]) / travel * 100),
        "frames": len(found.trajectory.stamp_ns),
        "frames_registered": int(found.trajectory.registered.sum()),
        "decode_yield": float(found.trajectory.decode_yield.mean()),
    }


def _map(found: Reconstruction, truth: Truth) -> dict:
    wall, pipe = found.wall, truth.pipe
    scanned = wall.scanned()
    radius, z = wall.radius_mm[:, scanned], wall.z_mm[scanned]
    seen = np.isfinite(radius)
    error = (radius - pipe.radius(wall.theta_rad[:, None], z[None, :]))[seen]
    hidden = [share for feature in pipe.features for share in _hidden_floor(wall, pipe, feature)]
    return {
        "not_seen_share": float(np.mean(hidden)) if hidden else None,
        "map_rms_mm": float(np.sqrt(np.mean(error**2))) if error.size else None,
        "seen_share": seen_share(wall),
    }


def _hidden_floor(wall: WallMap, pipe: Pipe, feature: Feature) -> Bool[np.ndarray, "cells"]:
    """For every cell of a feature's floor (deeper than half its depth): whether no point fell into it.

    The cells are the map's, continued over what the scan never reached.
    """
    size = feature.size(pipe.bore_radius_mm)
    cell = wall.z_mm[1] - wall.z_mm[0] if wall.z_mm.size > 1 else 1.0
    start = wall.z_mm[0] if wall.z_mm.size else 0.5 * cell
    low, high = feature.distance_mm - size.length_mm / 2, feature.distance_mm + size.length_mm / 2
    row = np.arange(np.ceil((low - start) / cell), np.floor((high - start) / cell) + 1).astype(np.int64)
    arc = feature.arc_mm(wall.theta_rad, pipe.bore_radius_mm)
    column = np.flatnonzero(np.abs(arc) <= size.width_mm / 2)
    floor = pipe.radius(wall.theta_rad[column, None], start + row[None, :] * cell) - pipe.bore_radius_mm
    inside = (row >= 0) & (row < wall.z_mm.size)
    seen = np.zeros(floor.shape, dtype=bool)
    seen[:, inside] = wall.seen[np.ix_(column, row[inside])]
    return ~seen[floor > size.depth_mm / 2]

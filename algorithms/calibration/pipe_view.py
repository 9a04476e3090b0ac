"""One picture of a pipe by itself: its slits as points on a cylinder, which of them could be seen, and how they lie."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from jaxtyping import Bool, Float, UInt8

from algorithms.decode import DecodeSettings, decode
from algorithms.registration import cylinder_map
from algorithms.registration.cylinder_map import CylinderMapSettings
from algorithms.robust import spread
from algorithms.triangulate import triangulate
from algorithms.types import Alignment, RingPoints, Wall
from sensor_model.geometry import apply, fisheye_project, inverse, wrap_rad
from sensor_model.recording import NominalPipe
from sensor_model.rig import Rig

WRONG_MM = 5.0  # a wrong label moves a point by tens of mm
INNER_SLITS = 5
EDGE_PX = 20  # so near the picture's edge a slit's outer band is cut off
SAMPLES_A_LINE = 4
CENTER_STD_MM, TILT_STD_RAD = 25.0, 0.15  # what is known of the pose beforehand
MORE_PASSES = 2  # a first cylinder from the whole cloud starts the next


@dataclass(frozen=True)
class PipeView:
    """A decoded picture: points, the cylinder through them, radial residuals; which bins were to be seen and were."""

    points: RingPoints
    alignment: Alignment
    residual_mm: Float[np.ndarray, "n"]
    expected: Bool[np.ndarray, "slits lines"]
    found: Bool[np.ndarray, "slits lines"]
    ms: dict[str, float]

    @property
    def right(self) -> Bool[np.ndarray, "n"]:
        """Points near the cylinder."""
        return np.abs(self.residual_mm) < WRONG_MM

    def coverage(self, slits: slice) -> float:
        """Share of the bins in view, outside the strut's sector, that have a point near the cylinder."""
        bins = self.expected[slits]
        return float((self.found[slits] & bins).sum() / bins.sum()) if bins.any() else float("nan")


def view_pipe(picture: UInt8[np.ndarray, "height width 3"], rig: Rig, settings: DecodeSettings) -> PipeView:
    """Decode a picture and fit a cylinder of free radius; `alignment.converged` says whether there is one."""
    started = perf_counter()
    seen = decode(picture, rig, settings)
    decoded = perf_counter()
    points = triangulate(seen, rig)
    triangulated = perf_counter()
    alignment = fit_cylinder(points)
    fitted = perf_counter()
    residual = radial_mm(points.xyz_mm, alignment)
    expected = bins_in_view(rig, alignment, settings.azimuths)
    found = _found(points, np.abs(residual) < WRONG_MM, rig, settings.azimuths)
    ms = {
        "decode": 1e3 * (decoded - started),
        "triangulate": 1e3 * (triangulated - decoded),
        "cylinder": 1e3 * (fitted - triangulated),
    }
    return PipeView(points, alignment, residual, expected, found, ms)


def fit_cylinder(points: RingPoints) -> Alignment:
    """The likeliest cylinder (cylinder-map) of free radius, from next to no prior."""
    information = np.diag([CENTER_STD_MM**-2] * 2 + [0.0] + [TILT_STD_RAD**-2] * 2 + [0.0])
    radius = float(np.median(np.hypot(points.xyz_mm[:, 0], points.xyz_mm[:, 1]))) if points.ring.size else 75.0
    prior = Alignment(np.eye(4), information)
    settings = CylinderMapSettings(radius_std_pct=None)
    found = prior
    for _ in range(MORE_PASSES):
        pipe = NominalPipe(inner_radius_mm=max(radius, 6.0), wall_thickness_mm=1.0)
        found = cylinder_map.align(points, Wall(pipe), prior, settings)
        if not found.converged:
            break
        prior, radius = Alignment(found.T_pipe_camera, information), found.radius_mm
    return found


def radial_mm(xyz_mm: Float[np.ndarray, "n 3"], alignment: Alignment) -> Float[np.ndarray, "n"]:
    """How far points lie outside the cylinder."""
    x, y, _ = apply(alignment.T_pipe_camera, xyz_mm).T
    return np.hypot(x, y) - alignment.radius_mm


def axis_of(alignment: Alignment) -> Float[np.ndarray, "4"]:
    """Where the pipe's axis crosses the camera's plane (mm) and how it slopes, camera frame."""
    T_camera_pipe = inverse(alignment.T_pipe_camera)
    direction = T_camera_pipe[:3, 2] / T_camera_pipe[2, 2]
    place = T_camera_pipe[:3, 3] - T_camera_pipe[2, 3] * direction
    return np.array([place[0], place[1], direction[0], direction[1]])


def robust_residual_mm(view: PipeView) -> float:
    """Robust standard deviation of the residuals of all points near the cylinder."""
    return spread(view.residual_mm[view.right])


def bins_in_view(rig: Rig, alignment: Alignment, lines: int) -> Bool[np.ndarray, "slits lines"]:
    """On which lines each slit can be seen on the cylinder: inside the picture and outside the strut's sector."""
    projector, camera = rig.projector, rig.camera
    azimuth = np.arange(lines * SAMPLES_A_LINE) * 2 * np.pi / (lines * SAMPLES_A_LINE)
    blocked = np.radians(projector.strut_width_deg / 2 + projector.strut_softness_deg)
    lit = np.abs(wrap_rad(azimuth - np.radians(projector.strut_clock_deg))) > blocked
    out = np.zeros((len(projector.slits), lines), dtype=bool)
    if not np.isfinite(alignment.radius_mm):
        return out
    for j, half in enumerate(projector.slit_half_angles_rad):
        pixel = fisheye_project(on_cylinder(rig, alignment, azimuth, float(half)), camera.intrinsics)
        with np.errstate(invalid="ignore"):
            inside = ((pixel > EDGE_PX) & (pixel < np.array([camera.width_px, camera.height_px]) - EDGE_PX)).all(
                axis=1
            ) & lit
        line = _lines(pixel, rig, lines)
        seen = np.bincount(line, weights=inside, minlength=lines)
        out[j] = (seen > 0) & (seen == np.bincount(line, minlength=lines))
    return out


def on_cylinder(rig: Rig, alignment: Alignment, azimuth: np.ndarray, half: float) -> Float[np.ndarray, "n 3"]:
    """Where a slit's light meets the cylinder (camera frame); NaN where it does not."""
    T_pipe_projector = alignment.T_pipe_camera @ rig.projector.T_camera_projector
    light = np.stack(
        [np.sin(half) * np.sin(azimuth), -np.sin(half) * np.cos(azimuth), np.full(azimuth.size, np.cos(half))], axis=1
    )
    direction = light @ T_pipe_projector[:3, :3].T
    start = T_pipe_projector[:3, 3]
    a = np.sum(direction[:, :2] ** 2, axis=1)
    b = direction[:, :2] @ start[:2]
    with np.errstate(invalid="ignore"):
        range_mm = (-b + np.sqrt(b * b - a * (start[:2] @ start[:2] - alignment.radius_mm**2))) / a
    return apply(inverse(alignment.T_pipe_camera), start + range_mm[:, None] * direction)


def _lines(pixel: Float[np.ndarray, "n 2"], rig: Rig, lines: int) -> np.ndarray:
    """The decoder's line nearest to each pixel."""
    off = np.nan_to_num(pixel - np.array([rig.camera.cx_px, rig.camera.cy_px]))
    angle = np.mod(np.arctan2(off[:, 0], -off[:, 1]), 2 * np.pi)
    return np.rint(angle / (2 * np.pi) * lines).astype(np.int64) % lines


def _found(points: RingPoints, right: Bool[np.ndarray, "n"], rig: Rig, lines: int) -> Bool[np.ndarray, "slits lines"]:
    out = np.zeros((len(rig.projector.slits), lines), dtype=bool)
    out[points.ring[right], _lines(points.pixel[right], rig, lines)] = True
    return out

"""Frames with exact truth and no picture: wall points along the cones of light, with the errors that a case states."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field
from scipy.spatial.transform import Rotation

from algorithms.types import RingPoints
from sensor_model.geometry import transform
from sensor_model.settings import Settings

APEX_MM = np.array([0.0, 0.0, -53.0])
FARTHEST_MM = 400.0  # light that meets the wall further out than this is not seen again
FALSE_FROM, FALSE_TO = 0.4, 1.15  # where along its ray a false point lies, in parts of the way to the wall

Share = Annotated[float, Field(ge=0, lt=1)]


class FrameCase(Settings):
    """One kind of frame: how many points where, how noisy, and what is wrong with them.

    `noise_mm` is across the wall (one standard deviation), and goes along the light. A defect is one patch on a run of
    rings, as large as its share of the points says. `told_radius_error_pct` is what the nominal radius is wrong by.
    """

    points: Annotated[int, Field(ge=10, le=1_000_000)] = 10_000
    rings: Annotated[int, Field(ge=1, le=40)] = 7
    length_mm: Annotated[float, Field(ge=0, le=300)] = 100.0
    ahead_mm: Annotated[float, Field(gt=0, le=300)] = 120.0
    arc_deg: Annotated[float, Field(gt=10, le=360)] = 360.0
    tilt_deg: Annotated[float, Field(ge=0, le=30)] = 2.0
    offset_mm: Annotated[float, Field(ge=0, le=30)] = 4.0
    noise_mm: Annotated[float, Field(ge=0, le=5)] = 0.1
    defect_share: Share = 0.0
    defect_depth_mm: float = 7.5
    spurious_share: Share = 0.0
    radius_mm: Annotated[float, Field(gt=10)] = 76.2
    ovality_pct: Annotated[float, Field(ge=0, le=10)] = 0.0
    told_radius_error_pct: Annotated[float, Field(ge=-20, le=20)] = 0.0

    @property
    def told_radius_mm(self) -> float:
        """The nominal radius as the measurement is told."""
        return self.radius_mm * (1 + self.told_radius_error_pct / 100)


LIMIT_CASES = {
    "clean": FrameCase(),
    "defect-10": FrameCase(defect_share=0.1),
    "defect-30": FrameCase(defect_share=0.3),
    "tilted": FrameCase(tilt_deg=10, offset_mm=10),
    "arc-200": FrameCase(arc_deg=200),
    "sigma-0.05": FrameCase(noise_mm=0.05),
    "sigma-0.2": FrameCase(noise_mm=0.2),
    "points-2000": FrameCase(points=2_000),
    "points-40000": FrameCase(points=40_000),
    "points-200000": FrameCase(points=200_000),
    "hard": FrameCase(defect_share=0.3, tilt_deg=10, offset_mm=10, arc_deg=260, noise_mm=0.2, spurious_share=0.02),
}
"""Where the error is compared with the Cramer-Rao bound."""

ROBUST_CASES = {
    "outliers-40": FrameCase(defect_share=0.2, spurious_share=0.25),
    "outliers-40-patch": FrameCase(defect_share=0.4),
    "outliers-40-spurious": FrameCase(spurious_share=0.4),
    "tilt-20": FrameCase(tilt_deg=20),
    "arc-120": FrameCase(arc_deg=120),
    "short-50": FrameCase(length_mm=50),
    "five-rings": FrameCase(rings=5, points=1_000),
    "spurious-15": FrameCase(spurious_share=0.15),
    "sigma-0.3": FrameCase(noise_mm=0.3),
    "patch-1.88": FrameCase(defect_share=0.3, defect_depth_mm=1.88),
    "patch-0.5": FrameCase(defect_share=0.3, defect_depth_mm=0.5),
    "outliers-45": FrameCase(defect_share=0.31, spurious_share=0.2, arc_deg=260),
    "outliers-45-patch": FrameCase(defect_share=0.45, arc_deg=260),
    "outliers-45-spurious": FrameCase(spurious_share=0.45, arc_deg=260),
}
"""Where no frame may fail."""

OTHER_CASES = {
    "told-radius-1-off": FrameCase(told_radius_error_pct=1.0, arc_deg=260),
    "oval-1": FrameCase(ovality_pct=1.0),
}

CASES = LIMIT_CASES | ROBUST_CASES | OTHER_CASES


class TrueFrame(NamedTuple):
    """A frame with what is true of it: the pose, the points without noise, and which are on the undamaged wall."""

    points: RingPoints
    T_pipe_camera: Float[np.ndarray, "4 4"]
    exact_mm: Float[np.ndarray, "n 3"]
    on_wall: Bool[np.ndarray, "n"]


def draw_pose(case: FrameCase, rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """`T_pipe_camera` with the case's tilt and offset, each in a direction of its own, at any roll."""
    roll, about, towards = rng.uniform(0, 2 * np.pi, 3)
    tilt = np.radians(case.tilt_deg) * np.array([np.cos(about), np.sin(about), 0.0])
    R = (Rotation.from_rotvec([0, 0, roll]) * Rotation.from_rotvec(tilt)).as_matrix()
    return transform(R, np.array([case.offset_mm * np.cos(towards), case.offset_mm * np.sin(towards), 0.0]))


def make_frame(
    case: FrameCase, T_pipe_camera: Float[np.ndarray, "4 4"], rng: np.random.Generator, noise_rng: np.random.Generator
) -> TrueFrame:
    """Points where the light of each ring meets the wall, seen from a pose; azimuths are random over the arc.

    `rng` draws where arc and patch lie and which azimuths are seen, `noise_rng` the errors.
    """
    at = case.ahead_mm + np.linspace(-0.5, 0.5, case.rings) * case.length_mm
    half_angle = np.arctan2(case.radius_mm, at - APEX_MM[2])
    patch = _patch(case, rng)
    begin = rng.uniform(0, 2 * np.pi)
    rows, missing = [], case.points
    while missing > 0:
        part, ring = rng.uniform(0, 1, missing), rng.integers(0, case.rings, missing)
        azimuth, alpha = begin + part * np.radians(case.arc_deg), half_angle[ring]
        light = np.column_stack([np.sin(alpha) * np.sin(azimuth), -np.sin(alpha) * np.cos(azimuth), np.cos(alpha)])
        deep = patch(part, ring)
        reach = np.where(
            deep,
            _range_mm(light, T_pipe_camera, case, case.defect_depth_mm),
            _range_mm(light, T_pipe_camera, case, 0.0),
        )
        seen = (reach < FARTHEST_MM) & (APEX_MM[2] + reach * light[:, 2] > 0)
        rows.append((light[seen], reach[seen], ring[seen], deep[seen]))
        missing -= int(seen.sum())
    light, reach, ring, deep = (np.concatenate(part) for part in zip(*rows, strict=True))
    return _measured(case, T_pipe_camera, light, reach, ring, deep, noise_rng)


def _patch(case: FrameCase, rng: np.random.Generator):
    """Whether a place (part of the arc, ring) lies in the defect, whose proportions are drawn."""
    if case.defect_share == 0:
        return lambda part, _: np.zeros(part.shape, dtype=bool)
    rings = max(int(np.ceil(case.defect_share * case.rings)), int(rng.integers(1, case.rings + 1)))
    width = min(case.defect_share * case.rings / rings, 1.0)
    first, begin = int(rng.integers(0, case.rings - rings + 1)), rng.uniform()
    return lambda part, ring: (ring >= first) & (ring < first + rings) & ((part - begin) % 1.0 < width)


def _range_mm(light: np.ndarray, T_pipe_camera: np.ndarray, case: FrameCase, deeper_mm: float) -> np.ndarray:
    """How far each ray goes from the apex to the wall; an oval wall is met by a few steps from the round one."""
    ray = light @ T_pipe_camera[:3, :3].T
    origin = T_pipe_camera[:3, :3] @ APEX_MM + T_pipe_camera[:3, 3]
    a, b = np.sum(ray[:, :2] ** 2, axis=1), ray[:, :2] @ origin[:2]
    radius = np.full(len(ray), case.radius_mm + deeper_mm)
    for _ in range(1 if case.ovality_pct == 0 else 30):
        reach = (-b + np.sqrt(b**2 - a * (origin[:2] @ origin[:2] - radius**2))) / a
        x, y = origin[0] + reach * ray[:, 0], origin[1] + reach * ray[:, 1]
        swell = case.ovality_pct / 100 * (y**2 - x**2) / (x**2 + y**2)
        radius = case.radius_mm * (1 + swell) + deeper_mm
    return reach


def _measured(case, T_pipe_camera, light, reach, ring, deep, rng) -> TrueFrame:
    exact = APEX_MM + reach[:, None] * light
    wall = exact @ T_pipe_camera[:3, :3].T + T_pipe_camera[:3, 3]
    ray = light @ T_pipe_camera[:3, :3].T
    facing = np.sum(ray[:, :2] * wall[:, :2], axis=1) / np.hypot(wall[:, 0], wall[:, 1])
    sigma = max(case.noise_mm, 1e-6) / facing
    xyz = exact + (rng.standard_normal(len(reach)) * case.noise_mm / facing)[:, None] * light
    false = rng.uniform(size=len(reach)) < case.spurious_share
    part = rng.uniform(FALSE_FROM, FALSE_TO, len(reach))
    xyz[false] = (APEX_MM + (part * reach)[:, None] * light)[false]
    points = RingPoints(xyz, ring, np.zeros((len(reach), 2)), light, sigma)
    return TrueFrame(points, T_pipe_camera, exact, ~(deep | false))


class Bound(NamedTuple):
    """Smallest possible RMS errors (Cramer-Rao) of an unbiased fit that knows which points are wall."""

    axis_rad: float
    center_mm: float
    radius_mm: float


def cramer_rao(frame: TrueFrame) -> Bound:
    """The bound of one frame, its pose's roll and travel known."""
    R, t = frame.T_pipe_camera[:3, :3], frame.T_pipe_camera[:3, 3]
    lever = frame.exact_mm[frame.on_wall] @ R.T
    normal = lever + t
    normal[:, 2] = 0.0
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    facing = np.abs(np.sum(frame.points.direction[frame.on_wall] @ R.T * normal, axis=1))
    sigma = frame.points.sigma_mm[frame.on_wall] * facing
    J = np.column_stack([normal[:, :2], np.cross(lever, normal)[:, :2], -np.ones(len(lever))]) / sigma[:, None]
    variance = np.diag(np.linalg.inv(J.T @ J))
    return Bound(*(float(np.sqrt(v)) for v in (variance[2] + variance[3], variance[0] + variance[1], variance[4])))

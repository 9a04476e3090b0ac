"""Registration by point-to-plane ICP against the wall seen so far (section 4.2's second peer)."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field
from scipy.spatial.transform import Rotation

from algorithms.registration.checks import unfit
from algorithms.registration.first_frame import BEYOND_SHARE, Start, place_first
from algorithms.registration.from_axis import sigma_across_mm
from algorithms.registration.fusion import fuse
from algorithms.registration.growing_cloud import (
    CloudSettings,
    GrowingCloud,
    add_to_cloud,
    near_cloud,
    refresh_normals,
    thinned,
)
from algorithms.robust import spread
from algorithms.types import Alignment, RingPoints, Wall, failed
from sensor_model.geometry import apply, transform
from sensor_model.settings import Settings

TUKEY_SIGMAS = 4.685  # the biweight that keeps 95 % of the efficiency under normal noise
LEAST_SCALE_MM = 1e-6
DAMPING = 1e-3  # Levenberg's, of the normal matrix' trace: a motion that hardly shows is made in small steps
SETTLED_MM = 1e-4  # by how much a step changes the residuals
NEARLY_SETTLED_MM = 0.05  # nearest neighbours may swap for ever: below the noise that is no failure


class IcpSettings(Settings):
    """Settings of the ICP and of the cloud that it registers against."""

    kind: Literal["icp"] = "icp"
    start: Start = "cylinder"
    cloud: CloudSettings = CloudSettings()
    correspondence_mm: Annotated[float, Field(gt=0, le=100)] = 5.0
    iterations: Annotated[int, Field(ge=1, le=1000)] = 40
    min_matched_share: Annotated[float, Field(gt=0, lt=1)] = 0.3


class Matches(NamedTuple):
    """Of n points those (k) that found a plane of the cloud within reach: its normal, and how far off it they lie."""

    rows: Bool[np.ndarray, "n"]
    normal: Float[np.ndarray, "k 3"]
    residual_mm: Float[np.ndarray, "k"]


class Settled(NamedTuple):
    """Where the iterations came to rest, or the reason why they did not."""

    T_pipe_camera: Float[np.ndarray, "4 4"]
    reason: str = ""


def begin(settings: IcpSettings) -> GrowingCloud:
    """A cloud of nothing yet."""
    return GrowingCloud(settings.cloud)


def grow(seen: GrowingCloud, points: RingPoints, alignment: Alignment) -> None:
    """Put a registered frame into the cloud."""
    T = alignment.T_pipe_camera
    refresh_normals(seen, add_to_cloud(seen, apply(T, points.xyz_mm), float(T[2, 3])))


def align(points: RingPoints, wall: Wall, prior: Alignment, settings: IcpSettings) -> Alignment:
    """The pose in which the points lie on the planes of the wall seen so far; from the prior's pose.

    All six numbers are estimated, and the information is what the normal matrix claims: along and about the axis of
    a smooth wall that is the pattern of the rings, not the wall.
    """
    if reason := unfit(points):
        return failed(prior, points.sigma_mm.size, reason)
    if is_first(wall.seen, points, prior, settings.correspondence_mm):
        return place_first(points, wall, prior, settings.start)
    settled = iterate(wall.seen, points, prior.T_pipe_camera, settings, list(range(6)))
    if settled.reason:
        return failed(prior, points.sigma_mm.size, settled.reason)
    own = own_alignment(wall.seen, points, settled.T_pipe_camera, settings)
    return fuse(prior, own) if own.converged else failed(prior, points.sigma_mm.size, own.reason)


def is_first(cloud: GrowingCloud | None, points: RingPoints, prior: Alignment, reach_mm: float) -> bool:
    """Whether the frame looks where nothing was seen."""
    if cloud is None:
        return True
    near = near_cloud(cloud, apply(prior.T_pipe_camera, points.xyz_mm), reach_mm)
    return bool(near.mean() < BEYOND_SHARE)


def iterate(
    cloud: GrowingCloud, points: RingPoints, T_start: Float[np.ndarray, "4 4"], settings: IcpSettings, free: list[int]
) -> Settled:
    """Match and step by turns until the pose rests; `free` are the motions allowed, in the order of the information.

    They are taken about a point of the pipe's axis, so that 2 and 5 move along the axis and turn about it.
    """
    # thinned as the prior sees them, so that it does not matter how the camera's axes lie
    xyz = thinned(apply(T_start, points.xyz_mm), cloud.settings.voxel_mm)
    pivot, moved = np.array([0.0, 0.0, float(xyz[:, 2].mean())]), np.eye(4)
    reach = float(np.sqrt(np.mean(np.sum((xyz - pivot) ** 2, axis=1))))
    levers = np.array([1.0, 1.0, 1.0, reach, reach, reach])  # a turn counts by how far it moves the points
    change = np.inf
    for _ in range(settings.iterations):
        here = apply(moved, xyz)
        found = match(cloud, here, settings.correspondence_mm)
        if found.rows.mean() < settings.min_matched_share:
            return Settled(T_start, _too_few(found))
        step = np.zeros(6)
        step[free], change = _step(found, here[found.rows] - pivot, free, levers)
        if not np.isfinite(step).all():
            return Settled(T_start, "the wall seen so far fixes no pose")
        R = Rotation.from_rotvec(step[3:]).as_matrix()
        moved = transform(R, pivot - R @ pivot + step[:3]) @ moved
        if change < SETTLED_MM:
            break
    if change > NEARLY_SETTLED_MM:
        return Settled(T_start, f"still moving by {change:.2g} mm after {settings.iterations} iterations")
    return Settled(moved @ T_start)


def match(cloud: GrowingCloud, xyz_pipe_mm: Float[np.ndarray, "n 3"], correspondence_mm: float) -> Matches:
    """The nearest point of the cloud, where it is near enough and has a normal."""
    distance, nearest = cloud.tree.query(xyz_pipe_mm, distance_upper_bound=correspondence_mm)
    rows = np.isfinite(distance)
    normal = cloud.normal[nearest[rows]]
    rows[rows] = planar = np.isfinite(normal[:, 0])
    normal, plane_mm = normal[planar], cloud.points_mm[nearest[rows]]
    return Matches(rows, normal, np.sum(normal * (xyz_pipe_mm[rows] - plane_mm), axis=1))


def _step(
    found: Matches, lever_mm: Float[np.ndarray, "k 3"], free: list[int], levers: Float[np.ndarray, "6"]
) -> tuple[np.ndarray, float]:
    """One step of Levenberg's on the distances from the planes, and by how much it changes them (RMS, mm)."""
    J = jacobian(found.normal, lever_mm) / levers
    w = biweight(found.residual_mm)
    H, g = (J * w[:, None]).T @ J, (J * w[:, None]).T @ found.residual_mm
    damping = DAMPING * np.trace(H) * np.eye(len(free))
    H = H[np.ix_(free, free)]
    step = -np.linalg.solve(H + damping, g[free])
    return step / levers[free], float(np.sqrt(step @ H @ step / w.sum()))


def jacobian(normal: Float[np.ndarray, "k 3"], lever_mm: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 6"]:
    """How distances from planes change as points move and turn about where the levers start."""
    return np.hstack([normal, np.cross(lever_mm, normal)])


def biweight(residual_mm: Float[np.ndarray, "k"]) -> Float[np.ndarray, "k"]:
    """Tukey's weights, their width by the residuals' own spread."""
    u = residual_mm / (TUKEY_SIGMAS * max(spread(residual_mm), LEAST_SCALE_MM))
    return np.where(np.abs(u) < 1, (1 - u**2) ** 2, 0.0)


def own_alignment(
    cloud: GrowingCloud, points: RingPoints, T_pipe_camera: Float[np.ndarray, "4 4"], settings: IcpSettings
) -> Alignment:
    """The pose with what the residuals and their normal matrix say of it."""
    xyz = apply(T_pipe_camera, points.xyz_mm)
    found = match(cloud, xyz, settings.correspondence_mm)
    if found.rows.mean() < settings.min_matched_share:
        return Alignment(T_pipe_camera, np.zeros((6, 6)), found.rows, False, _too_few(found))
    scale, w = max(spread(found.residual_mm), LEAST_SCALE_MM), biweight(found.residual_mm)
    J = jacobian(found.normal, xyz[found.rows] - T_pipe_camera[:3, 3])
    inliers = found.rows.copy()
    inliers[found.rows] = w > 0
    sigma = sigma_across_mm(points, T_pipe_camera[2, :3].copy())[found.rows]
    information = (J * w[:, None]).T @ J / scale**2
    return Alignment(T_pipe_camera, information, inliers, noise_scale=spread(found.residual_mm / sigma))


def _too_few(found: Matches) -> str:
    return f"only {found.rows.mean():.0%} of the points lie near the wall seen so far"

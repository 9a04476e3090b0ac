"""Registration by generalised ICP (small_gicp) against the wall seen so far: planes onto planes."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Annotated, Any, Literal

import numpy as np
from jaxtyping import Bool, Float
from pydantic import Field

from algorithms.registration.checks import unfit
from algorithms.registration.first_frame import Start, place_first
from algorithms.registration.fusion import fuse
from algorithms.registration.growing_cloud import CloudSettings, GrowingCloud, add_to_cloud, near_cloud, thinned
from algorithms.registration.icp import is_first
from algorithms.types import Alignment, RingPoints, Wall, failed
from sensor_model.geometry import apply
from sensor_model.settings import Settings

NOT_INSTALLED = "small_gicp is not installed: pip install 'pipetwin[gicp]'"
RESTS_RAD, RESTS_MM = 1e-4, 1e-2  # a wall point moves by 0.01 mm


class GicpSettings(Settings):
    """Settings of GICP and of the cloud that it registers against."""

    kind: Literal["gicp"] = "gicp"
    start: Start = "cylinder"
    cloud: CloudSettings = CloudSettings(voxel_mm=4.0)
    correspondence_mm: Annotated[float, Field(gt=0, le=100)] = 5.0
    iterations: Annotated[int, Field(ge=1, le=1000)] = 50
    min_matched_share: Annotated[float, Field(gt=0, lt=1)] = 0.3


@dataclass
class PlaneCloud:
    """The growing cloud, and small_gicp's form of it: points with covariances, and their tree."""

    cloud: GrowingCloud
    target: Any = None
    tree: Any = None


def begin(settings: GicpSettings) -> PlaneCloud:
    """A cloud of nothing yet."""
    return PlaneCloud(GrowingCloud(settings.cloud))


def grow(seen: PlaneCloud, points: RingPoints, alignment: Alignment) -> None:
    """Put a registered frame into the cloud; all covariances are made anew, small_gicp cannot be given any."""
    T = alignment.T_pipe_camera
    add_to_cloud(seen.cloud, apply(T, points.xyz_mm), float(T[2, 3]))
    seen.target, seen.tree = with_covariances(seen.cloud.points_mm, seen.cloud.settings.neighbours)


def align(points: RingPoints, wall: Wall, prior: Alignment, settings: GicpSettings) -> Alignment:
    """The pose that lays the planes about the points onto those about the wall's; from the prior's pose."""
    if reason := cannot(points):
        return failed(prior, points.sigma_mm.size, reason)
    seen: PlaneCloud | None = wall.seen
    if seen is None or is_first(seen.cloud, points, prior, settings.correspondence_mm):
        return place_first(points, wall, prior, settings.start)
    import small_gicp

    source, _ = prepared(points, prior.T_pipe_camera, settings.cloud)
    found = small_gicp.align(
        seen.target,
        source,
        seen.tree,
        max_correspondence_distance=settings.correspondence_mm,
        num_threads=1,
        max_iterations=settings.iterations,
        rotation_epsilon=RESTS_RAD,
        translation_epsilon=RESTS_MM,
    )
    T = found.T_target_source @ prior.T_pipe_camera
    near = near_cloud(seen.cloud, apply(T, points.xyz_mm), settings.correspondence_mm)
    return concluded(found, points, prior, near, settings.min_matched_share)


def cannot(points: RingPoints) -> str:
    """Why small_gicp cannot be asked, or nothing."""
    return unfit(points) or ("" if find_spec("small_gicp") else NOT_INSTALLED)


def with_covariances(xyz_mm: Float[np.ndarray, "n 3"], neighbours: int) -> tuple[Any, Any]:
    """small_gicp's cloud of these points with the covariance of each one's neighbourhood, and their tree."""
    import small_gicp

    cloud = small_gicp.PointCloud(xyz_mm)
    tree = small_gicp.KdTree(cloud, num_threads=1)
    small_gicp.estimate_covariances(cloud, tree, num_neighbors=neighbours, num_threads=1)
    return cloud, tree


def prepared(points: RingPoints, T_pipe_camera: Float[np.ndarray, "4 4"], settings: CloudSettings) -> tuple[Any, Any]:
    """A frame where a pose puts it, thinned like the cloud (so it does not matter how the camera's axes lie)."""
    return with_covariances(thinned(apply(T_pipe_camera, points.xyz_mm), settings.voxel_mm), settings.neighbours)


def concluded(
    found: Any, points: RingPoints, prior: Alignment, matched: Bool[np.ndarray, "n"], min_matched_share: float
) -> Alignment:
    """small_gicp's result as an alignment: its own Hessian over its own residuals' scale.

    Its authors take what the last iteration gives; here such a pose is called weak.
    """
    n = points.sigma_mm.size
    if matched.mean() < min_matched_share:
        return failed(prior, n, f"only {matched.mean():.0%} of the points lie near the wall seen so far")
    if not (found.num_inliers and np.isfinite(found.T_target_source).all()):
        return failed(prior, n, "no pose that is finite")
    T_pipe_camera = found.T_target_source @ prior.T_pipe_camera
    scale2 = max(2 * found.error / found.num_inliers, 1e-12)  # its error is half the sum of squares
    to_theirs = to_their_motion(found.T_target_source, T_pipe_camera[:3, 3])
    information = to_theirs.T @ found.H @ to_theirs / scale2
    weak = "" if found.converged else f"still moving after {found.iterations + 1} iterations"
    return fuse(prior, Alignment(T_pipe_camera, information, matched, reason=weak))


def to_their_motion(T: Float[np.ndarray, "4 4"], camera_mm: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6 6"]:
    """Takes a motion in the order of `Alignment.information`, about the camera, to small_gicp's.

    Theirs is the rotation and then the translation that are applied to the source before T.
    """
    R_back, lever = T[:3, :3].T, camera_mm - T[:3, 3]
    x, y, z = lever
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[np.zeros((3, 3)), R_back], [R_back, R_back @ cross]])

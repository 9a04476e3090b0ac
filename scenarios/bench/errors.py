"""What a method did with one frame, against the truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from algorithms.types import Alignment
from scenarios.bench.frames import Bound
from sensor_model.geometry import twist_about_z_rad

FAILED_DEG, FAILED_MM = 1.0, 1.0
NO_BOUND = Bound(float("nan"), float("nan"), float("nan"))


class FrameError(NamedTuple):
    """One frame by one method; errors are estimated less true, NaN where the method gave no pose.

    `center_mm` is how far the pipe's axis passes the camera beside its true place, so that roll does not enter it;
    `ms` is what the registration took.
    """

    scenario: str
    seed: int
    frame: int
    method: str
    verdict: str
    reason: str
    axis_deg: float
    center_mm: float
    radius_mm: float
    travel_mm: float
    roll_deg: float
    bound: Bound
    ms: float

    @property
    def failed(self) -> bool:
        """No pose, or one that is off by more than 1 degree or 1 mm."""
        return self.verdict == "failed" or self.axis_deg > FAILED_DEG or self.center_mm > FAILED_MM


class PoseError(NamedTuple):
    """Estimated less true: axis and centre as distances, travel and roll with their signs."""

    axis_deg: float
    center_mm: float
    travel_mm: float
    roll_deg: float


def pose_error(T: Float[np.ndarray, "4 4"], T_true: Float[np.ndarray, "4 4"]) -> PoseError:
    """How far one pose is from the true one."""
    axis, axis_true = T[2, :3], T_true[2, :3]
    sine, cosine = np.linalg.norm(np.cross(axis, axis_true)), axis @ axis_true
    beside, beside_true = T[:2, 3] @ T[:2, :3], T_true[:2, 3] @ T_true[:2, :3]
    return PoseError(
        axis_deg=float(np.degrees(np.arctan2(sine, cosine))),
        center_mm=float(np.linalg.norm(beside - beside_true)),
        travel_mm=float(T[2, 3] - T_true[2, 3]),
        roll_deg=float(np.degrees(twist_about_z_rad(T[:3, :3] @ T_true[:3, :3].T))),
    )


def frame_error(
    scenario: str,
    seed: int,
    frame: int,
    method: str,
    found: Alignment,
    T_true: Float[np.ndarray, "4 4"],
    true_radius_mm: float,
    ms: float,
    bound: Bound = NO_BOUND,
) -> FrameError:
    """Score one alignment."""
    nothing = float("nan")
    off = pose_error(found.T_pipe_camera, T_true) if found.converged else PoseError(*[nothing] * 4)
    return FrameError(
        scenario,
        seed,
        frame,
        method,
        found.verdict,
        found.reason,
        off.axis_deg,
        off.center_mm,
        float(found.radius_mm - true_radius_mm) if found.converged else nothing,
        off.travel_mm,
        off.roll_deg,
        bound,
        ms,
    )

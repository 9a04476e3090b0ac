"""What crosses the stages of the measurement: points, alignments, the wall map, defects, the reconstruction."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from algorithms.large_arrays import pieces
from sensor_model.recording import NominalPipe

Matrix6 = Float[np.ndarray, "6 6"]


@dataclass(frozen=True)
class RingPoints:
    """Wall points of one frame in the camera frame, each with the slit it came from.

    A point is uncertain along `direction`, the light ray through it, by `sigma_mm` (one standard deviation).
    """

    xyz_mm: Float[np.ndarray, "n 3"]
    ring: Int[np.ndarray, "n"]
    pixel: Float[np.ndarray, "n 2"]
    direction: Float[np.ndarray, "n 3"]
    sigma_mm: Float[np.ndarray, "n"]


@dataclass(frozen=True)
class Wall:
    """What a registration is told of the wall: what is written down of the pipe, and what was seen of it so far.

    `seen` is the method's own map, for those methods that register against one.
    """

    pipe: NominalPipe
    seen: Any = None


@dataclass(frozen=True)
class Alignment:
    """Where the camera is in the pipe, and what that is worth.

    `information` is in the order tx ty tz rx ry rz (mm and rad, pipe axes, rotation about the camera's centre); a
    direction that was not measured has none. `inliers` labels the points used; `reason` says why not converged, or
    what makes a converged pose weak.
    """

    T_pipe_camera: Float[np.ndarray, "4 4"]
    information: Matrix6
    inliers: Bool[np.ndarray, "n"] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    converged: bool = True
    reason: str = ""
    radius_mm: float = float("nan")
    noise_scale: float = float("nan")
    evidence: Matrix6 | None = None
    """The part of the information that this frame's own picture brought; None where nobody asked."""

    @property
    def verdict(self) -> Literal["good", "weak", "failed"]:
        """Whether to trust the pose; `reason` has the words."""
        if not self.converged:
            return "failed"
        return "weak" if self.reason else "good"


def failed(prior: Alignment, points: int, reason: str) -> Alignment:
    """An alignment that says why there is none: the prior's pose, worth nothing."""
    return Alignment(prior.T_pipe_camera, np.zeros((6, 6)), np.zeros(points, dtype=bool), False, reason)


@dataclass(frozen=True)
class WallMap:
    """The wall unrolled: cells around (theta) by along (z), NaN or 0 where nothing was seen.

    `spread_mm` is how far a cell's points scatter, `sigma_mm` the standard deviation that a typical one of them states,
    `light_slope` how far outward the steepest of the light that its points saw goes in a millimetre along the pipe;
    None in a map that was read from a file.
    """

    theta_rad: Float[np.ndarray, "around"]
    z_mm: Float[np.ndarray, "along"]
    radius_mm: Float[np.ndarray, "around along"]
    spread_mm: Float[np.ndarray, "around along"]
    sigma_mm: Float[np.ndarray, "around along"]
    count: Int[np.ndarray, "around along"]
    light_slope: Float[np.ndarray, "around along"] | None = None

    @property
    def seen(self) -> Bool[np.ndarray, "around along"]:
        """Cells with at least one point."""
        return self.count > 0

    @property
    def cell_z_mm(self) -> float:
        """Length of a cell along the pipe; 1 mm where a single row leaves it open."""
        return float(self.z_mm[1] - self.z_mm[0]) if self.z_mm.size > 1 else 1.0

    def cell_arc_mm(self, inner_radius_mm: float) -> float:
        """Width of a cell around a bore."""
        return inner_radius_mm * 2 * np.pi / self.theta_rad.size

    def scanned(self) -> slice:
        """Columns from the first to the last z at which at least half of the circumference was seen."""
        seen = [np.mean(self.count[:, part] > 0, axis=0) for part in pieces(self.count)]
        rows = np.flatnonzero(np.concatenate([*seen, np.zeros(0)]) >= 0.5)
        return slice(int(rows[0]), int(rows[-1]) + 1) if rows.size else slice(0, 0)

    def touched(self) -> slice:
        """Columns from the first to the last z at which anything was seen."""
        seen = [np.any(self.count[:, part] > 0, axis=0) for part in pieces(self.count)]
        rows = np.flatnonzero(np.concatenate([*seen, np.zeros(0, dtype=bool)]))
        return slice(int(rows[0]), int(rows[-1]) + 1) if rows.size else slice(0, 0)


# classes of what is no metal loss by length and width
INWARD, INWARD_RING, THROUGH, NO_LIGHT = "inward", "inward ring", "through", "no light returned"


def seen_share(wall: WallMap) -> float | None:
    """Share of the scanned wall's cells that were seen; None where nothing was scanned."""
    count = wall.count[:, wall.scanned()]
    seen = sum(int(np.count_nonzero(count[:, part] > 0)) for part in pieces(count))
    return seen / count.size if count.size else None


@dataclass(frozen=True)
class Defect:
    """One measured defect; standard deviations beside the sizes.

    Where no light reached the floor (`floor_seen` is false) depth, wall loss and volume are least ones. The volume is
    that of the seen cells; `feature_class` is the Pipeline Operators Forum's, for information, or one of these four.
    What stands inward has a height for its depth. The wall loss is a share of the nominal wall; its standard deviation
    holds that wall's tolerance, too.
    """

    start_mm: float
    length_mm: float
    width_mm: float
    depth_mm: float
    theta_rad: float
    wall_loss_pct: float
    length_std_mm: float
    width_std_mm: float
    depth_std_mm: float
    wall_loss_std_pct: float
    unseen_share: float
    seen_cells: int
    cut_by_scan_end: bool
    floor_seen: bool = True
    volume_mm3: float = float("nan")
    feature_class: str = ""
    disposition: str = ""

    @property
    def inward(self) -> bool:
        """Whether it stands inward and so takes no wall."""
        return self.feature_class in (INWARD, INWARD_RING)

    @property
    def distance_mm(self) -> float:
        """Axial position of its middle."""
        return self.start_mm + self.length_mm / 2

    @property
    def end_mm(self) -> float:
        """Where it ends along the pipe."""
        return self.start_mm + self.length_mm


@dataclass(frozen=True)
class FrameResult:
    """What became of one frame; `kept` labels the points that lie where a wall can be, which alone enter the map."""

    index: int
    stamp_ns: int
    points: RingPoints
    kept: Bool[np.ndarray, "n"]
    alignment: Alignment
    decode_yield: float


@dataclass(frozen=True)
class Episode:
    """A stretch of the log that was not as it should be: who (a wheel, a sensor), from when to when, by how much.

    The `amount` of a slip is the mm that the rim went more than the robot; of a gap, the seconds without a
    sample; of a joint from the list, the mm by which the distance was off there.
    """

    kind: Literal["slip", "gap", "joint"]
    who: str
    start_ns: int
    end_ns: int
    amount: float


@dataclass(frozen=True)
class LookedBack:
    """The path as it seems once the log has ended, a row a frame: distance (mm) and roll (rad), with covariance."""

    z_mm: Float[np.ndarray, "frames"]
    roll_rad: Float[np.ndarray, "frames"]
    covariance: Float[np.ndarray, "frames 2 2"]


@dataclass(frozen=True)
class Trajectory:
    """The camera's path, one row a frame; `registered` is false where the pose is only predicted.

    `axis_std` is how well each frame's own picture fixes each axis (tx ty tz rx ry rz, mm and rad), without odometry,
    IMU and memory: infinite along an axis that it does not show.
    """

    stamp_ns: Int[np.ndarray, "frames"]
    T_pipe_camera: Float[np.ndarray, "frames 4 4"]
    covariance: Float[np.ndarray, "frames 6 6"]
    axis_std: Float[np.ndarray, "frames 6"]
    registered: Bool[np.ndarray, "frames"]
    radius_mm: Float[np.ndarray, "frames"]
    decode_yield: Float[np.ndarray, "frames"]
    reason: tuple[str, ...]


@dataclass(frozen=True)
class Reconstruction:
    """The result of one scan; how far each cell is beyond the undamaged bore, NaN where nothing was seen."""

    trajectory: Trajectory
    wall: WallMap
    deviation_mm: Float[np.ndarray, "around along"]
    defects: tuple[Defect, ...]
    episodes: tuple[Episode, ...] = ()

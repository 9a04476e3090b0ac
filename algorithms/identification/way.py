"""The way that the camera went, as rows for a drive that goes it again: distance, offset, roll, tilt, and slip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import make_lsq_spline
from scipy.spatial.transform import Rotation

from algorithms.identification.estimate import Quantity, Unknown, about, blocks_of, of_blocks
from algorithms.types import Trajectory

ROW_S = 0.1
MOST_ROWS = 5000
POSE_KNOT_S = 0.5  # offset, roll and tilt are as smooth as this; what is faster is shaking
SLIP_STEP_MM = 0.02
CUBIC = 3
SHARED = 0.1
AHEAD_MM = 100.0  # of the camera, where the rings meet the wall


@dataclass(frozen=True)
class Way:
    """Rows of time (s), z, x, y (mm), roll, tilt about x, tilt about y (rad); and each wheel's slip so far (mm)."""

    rows: Float[np.ndarray, "rows 7"]
    slip_mm: Float[np.ndarray, "rows wheels"]


def angles_rad(path: Trajectory) -> Float[np.ndarray, "frames 3"]:
    """Roll, tilt about x and tilt about y of each frame; the tilt turns along with the roll."""
    x, y, z = Rotation.from_matrix(path.T_pipe_camera[:, :3, :3]).as_euler("xyz").T
    return np.column_stack([np.unwrap(z), x, y])


def rows_of(
    path: Trajectory,
    start_ns: int,
    encoder_s: Float[np.ndarray, "k"],
    consensus_mm: Float[np.ndarray, "k"],
    scaled_mm: Float[np.ndarray, "k wheels"],
    launch_mm: float | None,
) -> Way:
    """The rows: between frames the wheels tell the distance, and across the pipe the frames that were registered.

    Args:
        path: the frames' poses.
        start_ns: the stamp at which the rows begin.
        encoder_s: times of the encoders since then.
        consensus_mm: the way that the wheels agree on.
        scaled_mm: the way of each wheel.
        launch_mm: where the log begins, for a distance by the wheels alone; None: as the frames have it.
    """
    frame_s = (path.stamp_ns - start_ns) / 1e9
    end_s = float(encoder_s[-1])
    count = int(np.clip(np.ceil(end_s / ROW_S) + 1, 4, MOST_ROWS))
    time_s = np.linspace(0.0, end_s, count)
    way = np.interp(time_s, encoder_s, consensus_mm)
    off = path.T_pipe_camera[:, 2, 3] - np.interp(frame_s, encoder_s, consensus_mm)
    z = way + (np.interp(time_s, frame_s, off) if launch_mm is None else launch_mm - way[0])
    seen = path.registered
    poses = np.column_stack([path.T_pipe_camera[:, :2, 3], angles_rad(path)])
    across = np.column_stack([_smooth(frame_s[seen], column[seen], time_s) for column in poses.T])
    return Way(np.column_stack([time_s, z, across]), _slip(time_s, encoder_s, scaled_mm, z))


def rows_by_wheels(
    launch_mm: float, encoder_s: Float[np.ndarray, "k"], consensus_mm: Float[np.ndarray, "k"], scaled_mm: np.ndarray
) -> Way:
    """The rows of a log without a registered frame: the wheels' way down the middle of the pipe."""
    count = int(np.clip(np.ceil(encoder_s[-1] / ROW_S) + 1, 4, MOST_ROWS))
    time_s = np.linspace(0.0, float(encoder_s[-1]), count)
    z = launch_mm + np.interp(time_s, encoder_s, consensus_mm - consensus_mm[0])
    return Way(np.column_stack([time_s, z, np.zeros((count, 5))]), _slip(time_s, encoder_s, scaled_mm, z))


def _smooth(known_s: np.ndarray, values: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """A cubic spline through noise; the mean where there are too few values for one."""
    if known_s.size < 2 * CUBIC + 2:
        return np.full(time_s.size, values.mean() if values.size else 0.0)
    inner = np.arange(known_s[0] + POSE_KNOT_S, known_s[-1] - POSE_KNOT_S / 2, POSE_KNOT_S)
    # a knot without a value beside it would leave the spline open
    filled = np.diff(np.searchsorted(known_s, np.concatenate([[known_s[0]], inner, [known_s[-1]]]))) > 1
    inner = inner[filled[:-1] & filled[1:]] if inner.size else inner
    knots = np.concatenate([[known_s[0]] * (CUBIC + 1), inner, [known_s[-1]] * (CUBIC + 1)])
    spline = make_lsq_spline(known_s, values, knots, k=CUBIC)
    return spline(np.clip(time_s, known_s[0], known_s[-1]))


def _slip(time_s: np.ndarray, encoder_s: np.ndarray, scaled_mm: np.ndarray, z: np.ndarray) -> np.ndarray:
    """How far each rim has gone more than the camera, in whole steps, so that counting noise is none."""
    rim = np.column_stack([np.interp(time_s, encoder_s, wheel - wheel[0]) for wheel in scaled_mm.T])
    slip = rim - (z - z[0])[:, None]
    return np.round((slip - slip[0]) / SLIP_STEP_MM) * SLIP_STEP_MM


def path_quantities(path: Trajectory, rough_mm: float) -> dict[str, Quantity]:
    """Travel, and means of offset and tilt and the turn about the pipe, from the registered frames.

    What the scatter of a frame's points, `rough_mm`, does to slanted light shifts all frames alike, by a tenth of it.
    """
    seen = path.registered
    if np.count_nonzero(seen) < 10:
        nothing = Unknown(f"{np.count_nonzero(seen)} frames were registered; 10 are needed")
        return dict.fromkeys(
            ("travel_mm", "offset_x_mm", "offset_y_mm", "tilt_x_deg", "tilt_y_deg", "turned_deg"), nothing
        )
    angles = np.degrees(angles_rad(path))
    stds = np.sqrt(np.maximum(np.diagonal(path.covariance, axis1=1, axis2=2), 0))
    said = {
        "offset_x_mm": path.T_pipe_camera[:, 0, 3],
        "offset_y_mm": path.T_pipe_camera[:, 1, 3],
        "tilt_x_deg": angles[:, 1],
        "tilt_y_deg": angles[:, 2],
    }
    out: dict[str, Quantity] = {}
    z = path.T_pipe_camera[:, 2, 3]
    frames = int(np.count_nonzero(seen))
    out["travel_mm"] = about(
        float(z[-1] - z[0]), float(stds[-1, 2]), frames, "wheels, IMU and what the rings see twice"
    )
    for name, values in said.items():
        shared = SHARED * rough_mm * (float(np.degrees(1 / AHEAD_MM)) if name.startswith("tilt") else 1.0)
        parts = np.array([values[seen][part].mean() for part in blocks_of(frames)])
        out[name] = of_blocks(parts, "cylinder fits, mean of the drive by stretches of time", shared)
    turned = float(angles[-1, 0] - angles[0, 0])
    out["turned_deg"] = about(
        turned, float(np.degrees(np.hypot(stds[0, 5], stds[-1, 5]))), frames, "gyroscope and gravity"
    )
    return out

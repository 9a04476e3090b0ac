"""Each ring's own profile of the wall as the robot moves on, with what is fixed to the sensor taken off."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from algorithms.localisation.lags import Profile, within
from algorithms.types import Alignment, RingPoints
from sensor_model.geometry import apply, wall_angle_rad

BINS = 180  # of the wall around, and of the slide
LEARNING_FRAMES = 60
LEARN_MM = 25.0  # of way before the slide's pattern is believed
CLIP_MM = 0.3
STEP_MM = 0.05  # a frame that moved less shows nothing new


@dataclass
class RingProfiles:
    """Per ring: of the last frames the camera's z, and where along the pipe and how high the wall was seen, by bins.

    `pattern` is how high each place of the slide sees the wall on the average: its jaggedness, which goes with the
    sensor. A feature of the wall passes and is cut off in the average; a pattern never passes.
    """

    rings: int
    pattern_mm: Float[np.ndarray, "rings bins"] = field(init=False)
    learnt: Float[np.ndarray, "rings bins"] = field(init=False)
    frames: list[tuple[float, np.ndarray, np.ndarray]] = field(default_factory=list)
    way_mm: float = 0.0
    at_mm: float = -np.inf

    def __post_init__(self) -> None:
        self.pattern_mm, self.learnt = np.zeros((self.rings, BINS)), np.zeros((self.rings, BINS))


def add_frame(seen: RingProfiles, points: RingPoints, alignment: Alignment, keep_mm: float) -> bool:
    """Take a registered frame in; False where the sensor has hardly moved since the last."""
    T = alignment.T_pipe_camera
    here = float(T[2, 3])
    moved = here - seen.at_mm
    if moved < -STEP_MM:
        seen.frames.clear()  # backwards, a ring follows what it has seen itself
    elif moved < STEP_MM:
        return False
    if np.isfinite(moved):
        seen.way_mm += abs(moved)
    seen.at_mm = here
    xyz = apply(T, points.xyz_mm)
    height = np.hypot(xyz[:, 0], xyz[:, 1]) - alignment.radius_mm
    on_slide = _bin(wall_angle_rad(points.xyz_mm[:, 0], points.xyz_mm[:, 1]))
    flat = points.ring * BINS + on_slide
    known = seen.learnt.ravel()[flat] > 0
    own = np.where(known, height - seen.pattern_mm.ravel()[flat], height)
    _learn(seen, flat, own)
    if seen.way_mm >= LEARN_MM:
        cell = points.ring * BINS + _bin(wall_angle_rad(xyz[:, 0], xyz[:, 1]))
        z, h = (_mean(cell, value, seen.rings) for value in (xyz[:, 2], own))
        seen.frames.append((here, z, h))
    while seen.frames and seen.frames[0][0] < here - keep_mm:
        seen.frames.pop(0)
    return True


def shift(seen: RingProfiles, moved_mm: float) -> None:
    """Move all that was seen along the pipe."""
    seen.at_mm += moved_mm
    seen.frames[:] = [(here + moved_mm, z + moved_mm, h) for here, z, h in seen.frames]


def _bin(angle_rad: np.ndarray) -> Int[np.ndarray, "n"]:
    return np.floor(angle_rad / (2 * np.pi) * BINS).astype(np.int64) % BINS


def _mean(cell: np.ndarray, value: np.ndarray, rings: int) -> Float[np.ndarray, "rings bins"]:
    count = np.bincount(cell, minlength=rings * BINS)
    total = np.bincount(cell, weights=value, minlength=rings * BINS)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(rings, BINS)


def _learn(seen: RingProfiles, place: np.ndarray, own: np.ndarray) -> None:
    """Let the pattern follow, a little a frame, and no further than a point of a bare wall would pull it."""
    step = _mean(place, np.clip(own, -CLIP_MM, CLIP_MM), seen.rings)
    here = np.isfinite(step)
    seen.learnt[here] += 1
    share = 1 / np.minimum(seen.learnt[here], LEARNING_FRAMES)
    seen.pattern_mm[here] += share * step[here]


def profile(seen: RingProfiles, ring: int, low_mm: float, high_mm: float) -> tuple[Profile, Float[np.ndarray, "m"]]:
    """One ring's profile between two places, and the camera's z of its rows."""
    rows = [(here, z[ring], h[ring]) for here, z, h in seen.frames if _overlaps(z[ring], low_mm, high_mm)]
    if not rows:
        return Profile(np.zeros((0, BINS)), np.zeros((0, BINS))), np.zeros(0)
    whole = Profile(np.array([row[1] for row in rows]), np.array([row[2] for row in rows]))
    return within(whole, low_mm, high_mm), np.array([row[0] for row in rows])


def _overlaps(z_mm: np.ndarray, low_mm: float, high_mm: float) -> bool:
    seen = z_mm[np.isfinite(z_mm)]
    return bool(seen.size and seen.max() >= low_mm and seen.min() <= high_mm)


def front_mm(seen: RingProfiles) -> Float[np.ndarray, "rings"]:
    """How far along the pipe each ring sees in the last frame, in the middle; -inf where it sees nothing."""
    z = seen.frames[-1][1]
    rows = np.isfinite(z).any(axis=1)
    front = np.full(z.shape[0], -np.inf)
    front[rows] = np.nanmedian(z[rows], axis=1)
    return front

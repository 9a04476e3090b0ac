"""Marks on the way: past poses, and pieces of wall first seen from them, in the filter's state while they matter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from algorithms.localisation.fused import Fused
from algorithms.localisation.fused_model import ROLL, SCALE, S

POSE, TILE = "pose", "tile"


@dataclass(frozen=True)
class Mark:
    """A past distance and roll in the state: where it was believed to be when it was made, and of which tile it is."""

    kind: str
    at_mm: float
    roll_rad: float
    number: int = 0


@dataclass(frozen=True)
class Sight:
    """The pose from which something was seen, between two marks: rows that pick it from the state, and as believed."""

    rows: Float[np.ndarray, "2 n"]
    at_mm: float
    roll_rad: float


def place(state: Fused, k: int) -> int:
    """Where in the state the k-th mark's distance stands; its roll comes next."""
    return SCALE + state.distances_mm.size + 2 * k


def mark_pose(state: Fused) -> Fused:
    """Keep the pose of now."""
    rows = np.zeros((2, state.x.size))
    rows[0, S] = rows[1, ROLL] = 1.0
    return _added(state, Mark(POSE, float(state.x[S]), float(state.x[ROLL])), rows, np.zeros(2))


def mark_tile(state: Fused, number: int, sight: Sight, std: Float[np.ndarray, "2"]) -> Fused:
    """Keep a tile by the pose from which its first ring saw it, as exactly as that ring shows it."""
    return _added(state, Mark(TILE, sight.at_mm, sight.roll_rad, number), sight.rows, std)


def _added(state: Fused, mark: Mark, rows: np.ndarray, std: np.ndarray) -> Fused:
    A = np.vstack([np.eye(state.x.size), rows])
    P = A @ state.P @ A.T
    P[-2:, -2:] += np.diag(std**2)
    return replace(state, x=A @ state.x, P=P, marks=(*state.marks, mark))


def sight(state: Fused, at_mm: float) -> Sight | None:
    """The pose at a distance as it was believed at the time, from the marks before and after; None without a mark."""
    poses = [(mark.at_mm, mark.roll_rad, k) for k, mark in enumerate(state.marks) if mark.kind == POSE]
    if not poses:
        return None
    at = np.array([pose[0] for pose in poses])
    high = int(np.clip(np.searchsorted(at, at_mm), 0, at.size - 1))
    low = max(high - 1, 0) if at_mm < at[high] else high
    share = (at_mm - at[low]) / (at[high] - at[low]) if at[high] > at[low] else 0.0
    rows, seen = np.zeros((2, state.x.size)), np.zeros(2)
    for pose, part in ((poses[low], 1 - share), (poses[high], share)):
        rows[:, place(state, pose[2]) : place(state, pose[2]) + 2] += part * np.eye(2)
        seen += part * np.array(pose[:2])
    return Sight(rows, float(seen[0]), float(seen[1]))


def tile_mark(state: Fused, number: int) -> int | None:
    """Which mark a tile has."""
    found = [k for k, mark in enumerate(state.marks) if mark.kind == TILE and mark.number == number]
    return found[0] if found else None


def let_go(state: Fused, poses_before_mm: float, tiles_before: int) -> Fused:
    """Say which marks are over; they leave the state with the next step of the filter, on which the way back relies."""
    over = tuple(
        k
        for k, mark in enumerate(state.marks)
        if (mark.kind == POSE and mark.at_mm < poses_before_mm) or (mark.kind == TILE and mark.number < tiles_before)
    )
    return replace(state, leaving=over)

"""Two lists of places on one pipe's wall laid over each other: an offset along it and a turn about it, robustly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from algorithms.sizing.measure import TRAVEL_STD_SHARE
from sensor_model.geometry import wrap_rad

GATE_MM = 15.0  # of two middles that are one defect's, once laid over each other
DRIFT_SHARE = 3 * TRAVEL_STD_SHARE  # of the distance between two places: what travel may drift apart from scan to scan
FURTHEST_MM = 500.0  # launches are no further apart
UNLIKE = 0.7  # sizes this far apart, as logarithms of their ratio, make a pair count half
ROUNDS = 5
MOST_PROPOSERS = 30  # the largest places of each list propose and weigh


class Places(NamedTuple):
    """Middles on the wall, and a size of each that helps to tell them apart; NaN twice: a joint, all around."""

    z_mm: Float[np.ndarray, "n"]
    theta_rad: Float[np.ndarray, "n"]
    size_mm: Float[np.ndarray, "n"]


@dataclass(frozen=True)
class Laid:
    """What carries the second list onto the first: z + offset, theta + turn; and which pairs say so.

    `spread_mm` is how far the pairs scatter about it. `words` say how sure it is; `sure` is false where one pair, or
    none, has to do, or where another offset would do as well.
    """

    offset_mm: float
    turn_rad: float
    pairs: tuple[tuple[int, int], ...]
    spread_mm: float
    sure: bool
    words: str


def lay_over(first: Places, second: Places, radius_mm: float) -> Laid:
    """The offset and turn under which most of the second list's places fall on the first's, then the least ones.

    Every pair proposes its own, and none at all is proposed too; each proposal is weighed by the pairs that it makes.
    """
    a, b = _largest(first), _largest(second)
    i, k = (index.ravel() for index in np.indices((a.z_mm.size, b.z_mm.size)))
    dz, turn = a.z_mm[i] - b.z_mm[k], np.nan_to_num(wrap_rad(a.theta_rad[i] - b.theta_rad[k]))
    near = (np.abs(dz) <= FURTHEST_MM) & (np.isnan(a.theta_rad[i]) == np.isnan(b.theta_rad[k]))
    proposals = [(0.0, 0.0), *zip(dz[near].tolist(), turn[near].tolist(), strict=True)]
    judged = [(_weight(a, b, radius_mm, *proposal), proposal) for proposal in proposals]
    (best, (offset, angle)) = max(judged, key=lambda item: (round(item[0], 3), -abs(item[1][0]), -abs(item[1][1])))
    rival = max((weight for weight, other in judged if _apart(other, (offset, angle), radius_mm)), default=0.0)
    pairs = _pairs(first, second, radius_mm, offset, angle)
    for _ in range(ROUNDS if pairs else 0):
        offset, angle = _refined(first, second, pairs)
        pairs = _pairs(first, second, radius_mm, offset, angle)
    return _laid(first, second, radius_mm, offset, angle, pairs, best, rival)


def _largest(places: Places) -> Places:
    kept = np.sort(np.argsort(-np.nan_to_num(places.size_mm, nan=np.inf), kind="stable")[:MOST_PROPOSERS])
    return Places(places.z_mm[kept], places.theta_rad[kept], places.size_mm[kept])


def _laid(
    first: Places,
    second: Places,
    radius_mm: float,
    offset: float,
    angle: float,
    pairs: list[tuple[int, int]],
    best: float,
    rival: float,
) -> Laid:
    off = [np.hypot(*_difference(first, second, radius_mm, offset, angle, *pair)) for pair in pairs]
    spread = float(np.median(off)) if off else float("nan")
    if not pairs:
        return Laid(0.0, 0.0, (), spread, False, "no pair of places falls together; the scans are taken as they are")
    where = f"{offset:+.1f} mm along the pipe and {np.degrees(angle):+.1f} degrees about it, by {len(pairs)} pairs"
    if len(pairs) == 1:
        return Laid(offset, angle, tuple(pairs), spread, False, f"{where[:-1]}: one pair alone cannot be checked")
    if rival > best - 0.75:
        return Laid(offset, angle, tuple(pairs), spread, False, f"{where}; another offset would do nearly as well")
    return Laid(offset, angle, tuple(pairs), spread, True, f"{where}, which scatter by {spread:.1f} mm")


def _weight(first: Places, second: Places, radius_mm: float, offset: float, angle: float) -> float:
    """How many pairs an offset makes; those far apart or of unlike size count less."""
    total = 0.0
    for i, k in _pairs(first, second, radius_mm, offset, angle):
        off = np.hypot(*_difference(first, second, radius_mm, offset, angle, i, k))
        unlike = np.nan_to_num(abs(np.log(first.size_mm[i] / second.size_mm[k])))
        total += (1 - 0.5 * min(off / GATE_MM, 1.0)) * (1 - 0.5 * min(unlike / UNLIKE, 1.0))
    return total


def _pairs(first: Places, second: Places, radius_mm: float, offset: float, angle: float) -> list[tuple[int, int]]:
    """Pairs within the gate, each place used once, nearest in sum."""
    if not (first.z_mm.size and second.z_mm.size):
        return []
    far = 1e9
    i, k = np.indices((first.z_mm.size, second.z_mm.size))
    dz, arc = _difference(first, second, radius_mm, offset, angle, i, k)
    anchor = float(np.median(first.z_mm))
    reach = GATE_MM + DRIFT_SHARE * np.abs(first.z_mm - anchor)[:, None]
    cost = np.where((np.abs(dz) <= reach) & (np.abs(arc) <= GATE_MM), np.hypot(dz, arc), far)
    return [(int(a), int(b)) for a, b in zip(*linear_sum_assignment(cost), strict=True) if cost[a, b] < far]


def _difference(first, second, radius_mm, offset, angle, i, k):
    """How far apart two places are once laid over each other, mm: along the pipe, and around it (joints: nothing)."""
    dz = first.z_mm[i] - second.z_mm[k] - offset
    arc = radius_mm * wrap_rad(first.theta_rad[i] - second.theta_rad[k] - angle)
    joints = np.isnan(first.theta_rad[i]).astype(int) + np.isnan(second.theta_rad[k])
    return dz, np.select([joints == 0, joints == 2], [arc, 0.0], np.inf)


def _refined(first: Places, second: Places, pairs: list[tuple[int, int]]) -> tuple[float, float]:
    """Medians over the pairs; joints say nothing of the turn."""
    i, k = np.array(pairs).T
    offset, turns = float(np.median(first.z_mm[i] - second.z_mm[k])), first.theta_rad[i] - second.theta_rad[k]
    turns = turns[np.isfinite(turns)]
    if not turns.size:
        return offset, 0.0
    middle = float(np.angle(np.exp(1j * turns).mean()))
    return offset, float(wrap_rad(middle + np.median(wrap_rad(turns - middle))))


def _apart(one: tuple[float, float], other: tuple[float, float], radius_mm: float) -> bool:
    """Whether two proposals are not the same one found by another pair."""
    arc = radius_mm * float(wrap_rad(one[1] - other[1]))
    return bool(abs(one[0] - other[0]) > 2 * GATE_MM or abs(arc) > 2 * GATE_MM)

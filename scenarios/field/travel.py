"""The way by the rings against the way by the wheels: a place of the wall that one ring sees, the next see later."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from algorithms.localisation.lags import REACH, lag_along_mm
from algorithms.localisation.ring_profiles import RingProfiles, add_frame, front_mm, profile
from algorithms.types import Alignment, RingPoints

KEEP_MM = 190.0
EVERY_MM = 20.0
WINDOW_MM = 60.0
NOISE_MM, LAG_STD_MM, LAG_STD_SHARE = 0.1, 0.15, 0.05
NEAREST_MM = 20.0  # rings that lie nearer to each other say little


class Way(NamedTuple):
    """By how much the wheels say more than the rings, as a share, and the standard deviation of that."""

    more: float
    std: float


@dataclass
class OneWay:
    """What the rings said so far, taken one way round: sums of lag times gap and of gap squared, by their weights."""

    seen: RingProfiles
    lag_gap: float = 0.0
    gap_gap: float = 0.0
    due_mm: float = KEEP_MM / 2


@dataclass
class Travel:
    """Both ways round: as the wheels say, and as if they all were wired the other way."""

    rings: int
    told: OneWay = field(init=False)
    turned: OneWay = field(init=False)

    def __post_init__(self) -> None:
        self.told, self.turned = OneWay(RingProfiles(self.rings)), OneWay(RingProfiles(self.rings))
        self.turned.due_mm += EVERY_MM / 2  # not both in one frame, which would then be late


def travel_on(travel: Travel, points: RingPoints, alignment: Alignment) -> None:
    """Take a registered frame in."""
    T = alignment.T_pipe_camera.copy()
    T[2, 3] = -T[2, 3]
    _on(travel.told, points, alignment)
    _on(travel.turned, points, replace(alignment, T_pipe_camera=T))


def _on(one: OneWay, points: RingPoints, alignment: Alignment) -> None:
    before = one.seen.at_mm
    if not add_frame(one.seen, points, alignment, KEEP_MM) or not one.seen.frames or one.seen.way_mm < one.due_mm:
        return
    one.due_mm = one.seen.way_mm + EVERY_MM
    fronts, step_mm = front_mm(one.seen), abs(one.seen.at_mm - before)
    first, between = int(np.argmax(fronts)), 1.7 * step_mm + 1.0
    for ring in np.flatnonzero(np.isfinite(fronts) & (fronts < fronts.max() - NEAREST_MM)).tolist():
        low, high = fronts[ring] - WINDOW_MM, fronts[ring] - REACH
        more = REACH + between
        own, reference = (profile(one.seen, k, low - more, high + more)[0] for k in (ring, first))
        if not own.z_mm.size or not reference.z_mm.size:
            continue
        lag = lag_along_mm(reference, own, (low, high), between, NOISE_MM)
        if np.isfinite(lag.std):
            gap = fronts[first] - fronts[ring]
            weight = 1 / (lag.std**2 + LAG_STD_MM**2 + (LAG_STD_SHARE * step_mm) ** 2)
            one.lag_gap += weight * lag.lag * gap
            one.gap_gap += weight * gap**2


def way(one: OneWay) -> Way:
    """What the rings say of the way; an infinite standard deviation where the wall shows nothing."""
    if one.gap_gap <= 0:
        return Way(0.0, float("inf"))
    return Way(float(one.lag_gap / one.gap_gap), float(1 / np.sqrt(one.gap_gap)))

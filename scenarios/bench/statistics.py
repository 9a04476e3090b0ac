"""From errors of frames to figures of methods: medians with intervals, failures, and method against method in pairs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from scenarios.bench.errors import FrameError

CONFIDENCE = 0.95
FEWEST_PAIRS = 6
NO_MATTER = 0.05  # of the noise floor


class Interval(NamedTuple):
    """A median and the interval that holds the true one with 95 % confidence, whatever the distribution."""

    median: float
    low: float
    high: float


class Row(NamedTuple):
    """One method on some frames. Ratios are RMS errors over the Cramer-Rao bound, None where there is none."""

    method: str
    level: str
    frames: int
    failures: int
    axis_rms_deg: float | None
    center_rms_mm: float | None
    radius_rms_mm: float | None
    crb_ratio_axis: float | None
    crb_ratio_center: float | None
    crb_ratio_radius: float | None
    ms_median: float
    weak: int
    center_median_mm: Interval
    axis_median_deg: Interval
    travel_rms_mm: float | None
    roll_rms_deg: float | None
    scenarios: tuple[str, ...]


class Pair(NamedTuple):
    """Two methods on the frames for which both gave a pose: error of the camera's centre of `a` less that of `b`.

    `floor_mm` is the median bound of these frames: no difference far below it means anything. `p` is Wilcoxon's.
    """

    scenario: str
    a: str
    b: str
    frames: int
    a_nearer_share: float
    difference_mm: Interval
    p: float
    floor_mm: float | None


def rows(errors: Iterable[FrameError], level: str) -> list[Row]:
    """A row a method, over all its frames, in the order in which methods come."""
    by_method: dict[str, list[FrameError]] = {}
    for error in errors:
        by_method.setdefault(error.method, []).append(error)
    return [_row(method, level, mine) for method, mine in by_method.items()]


def _row(method: str, level: str, errors: list[FrameError]) -> Row:
    posed = [e for e in errors if e.verdict != "failed"]
    axis, center = np.array([e.axis_deg for e in posed]), np.array([e.center_mm for e in posed])
    radius = np.array([e.radius_mm for e in posed])
    bounds = np.array([e.bound for e in posed]).reshape(-1, 3)
    return Row(
        method=method,
        level=level,
        frames=len(errors),
        failures=sum(e.failed for e in errors),
        axis_rms_deg=_rms(axis),
        center_rms_mm=_rms(center),
        radius_rms_mm=_rms(radius),
        crb_ratio_axis=_rms(np.radians(axis) / bounds[:, 0]),
        crb_ratio_center=_rms(center / bounds[:, 1]),
        crb_ratio_radius=_rms(radius / bounds[:, 2]),
        ms_median=float(np.median([e.ms for e in errors])),
        weak=sum(e.verdict == "weak" for e in errors),
        center_median_mm=interval(center),
        axis_median_deg=interval(axis),
        travel_rms_mm=_rms(np.array([e.travel_mm for e in posed])),
        roll_rms_deg=_rms(np.array([e.roll_deg for e in posed])),
        scenarios=tuple(dict.fromkeys(e.scenario for e in errors)),
    )


def _rms(values: np.ndarray) -> float | None:
    """Root mean square; None of nothing, or where a method does not give the figure."""
    if not values.size or not np.isfinite(values).all():
        return None
    return float(np.sqrt(np.mean(values**2)))


def interval(values: np.ndarray) -> Interval:
    """Median with its distribution-free interval, from the order statistics that the binomial law picks."""
    from scipy.stats import binom

    n = values.size
    if n == 0:
        return Interval(float("nan"), float("nan"), float("nan"))
    ordered = np.sort(values)
    below = int(binom.ppf((1 - CONFIDENCE) / 2, n, 0.5))
    low, high = max(below - 1, 0), min(n - below, n - 1)
    return Interval(float(np.median(ordered)), float(ordered[low]), float(ordered[high]))


def pairs(errors: Iterable[FrameError]) -> list[Pair]:
    """Every two methods on every scenario, frame by frame."""
    by_scenario: dict[str, dict[str, dict[tuple[int, int], FrameError]]] = {}
    for e in errors:
        by_scenario.setdefault(e.scenario, {}).setdefault(e.method, {})[e.seed, e.frame] = e
    return [
        pair
        for scenario, methods in by_scenario.items()
        for a, b in combinations(methods, 2)
        if (pair := _pair(scenario, a, b, methods[a], methods[b])) is not None
    ]


def _pair(scenario: str, a: str, b: str, mine: dict, other: dict) -> Pair | None:
    shared = [k for k in mine if k in other and mine[k].verdict != "failed" and other[k].verdict != "failed"]
    if len(shared) < FEWEST_PAIRS:
        return None
    from scipy.stats import wilcoxon

    difference = np.array([mine[k].center_mm - other[k].center_mm for k in shared])
    floor = np.median([mine[k].bound.center_mm for k in shared])
    return Pair(
        scenario,
        a,
        b,
        len(shared),
        float(np.mean(difference < 0)),
        interval(difference),
        float(wilcoxon(difference).pvalue) if difference.any() else 1.0,
        float(floor) if np.isfinite(floor) else None,
    )


def nearest_method(of: Iterable[Row]) -> Row | None:
    """The method with the fewest failures, and of those the smallest median error of the centre."""
    posed = [row for row in of if row.frames > row.failures]
    return min(posed, key=lambda row: (row.failures, row.center_median_mm.median), default=None)


def winner_words(pair: Pair) -> str:
    """What a pair says, in words: who is nearer, or that the frames do not tell."""
    if pair.difference_mm.low <= 0 <= pair.difference_mm.high:
        return "no difference"
    if pair.floor_mm is not None and abs(pair.difference_mm.median) < NO_MATTER * pair.floor_mm:
        return "a difference below the noise floor"
    return f"{pair.a if pair.difference_mm.median < 0 else pair.b} is nearer"


def plain(row: Row) -> dict[str, object]:
    """A row as JSON gives it."""
    out: dict[str, object] = row._asdict()
    out["center_median_mm"] = list(row.center_median_mm)
    out["axis_median_deg"] = list(row.axis_median_deg)
    out["scenarios"] = list(row.scenarios)
    return out


def by_scenario(errors: Sequence[FrameError]) -> dict[str, list[FrameError]]:
    """The errors of each scenario."""
    out: dict[str, list[FrameError]] = {}
    for e in errors:
        out.setdefault(e.scenario, []).append(e)
    return out

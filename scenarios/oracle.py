"""ORACLE: the paper's threshold search (section 4.4.1), which chooses with the TRUE size: an upper bound, no method."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int
from scipy.cluster.vq import kmeans

from algorithms.sizing.segment import segment
from algorithms.types import Reconstruction, WallMap
from scenarios.equations import err_pct
from twin.features.base import Feature
from twin.pipe import Pipe

CLUSTERS = 10
SAMPLES = 20_000


def oracle_err_pct(pipe: Pipe, features: list[Feature], found: Reconstruction) -> list[float]:
    """Smallest Eq. 29 of each feature over the thresholds M_1 .. M_N, the means of the map's intensity clusters.

    100 where none fits.
    """
    if not features:
        return []
    seen = found.deviation_mm[np.isfinite(found.deviation_mm)]
    start = np.linspace(seen.min(), seen.max(), CLUSTERS + 2)[1:-1]
    thin = seen[:: max(seen.size // SAMPLES, 1)]
    best = np.full(len(features), 100.0)
    for threshold in np.sort(kmeans(thin, start)[0]):
        labels = segment(found.deviation_mm > threshold, found.wall, pipe.bore_radius_mm, join_mm=3.0)
        best = np.minimum(best, [_err_pct(pipe, feature, found.wall, labels) for feature in features])
    return [float(smallest) for smallest in best]


def _err_pct(pipe: Pipe, feature: Feature, wall: WallMap, labels: Int[np.ndarray, "around along"]) -> float:
    """Eq. 29 of the group that fills most of a feature's outline; infinite without one."""
    size = feature.size(pipe.bore_radius_mm)
    from_middle = feature.arc_mm(wall.theta_rad, pipe.bore_radius_mm)
    beside = np.abs(from_middle) < size.width_mm / 2
    inside = labels[np.ix_(beside, np.abs(wall.z_mm - feature.distance_mm) < size.length_mm / 2)]
    numbers = inside[inside > 0]
    if numbers.size == 0:
        return float("inf")
    cells = labels == np.bincount(numbers).argmax()
    z, arc = wall.z_mm[cells.any(axis=0)], from_middle[cells.any(axis=1)]
    cell = wall.z_mm[1] - wall.z_mm[0], 2 * np.pi * pipe.bore_radius_mm / wall.theta_rad.size
    return err_pct(np.ptp(z) + cell[0], np.ptp(arc) + cell[1], size.length_mm, size.width_mm)

"""ORACLE: the paper's threshold search (section 4.4.1), which chooses with the TRUE size: an upper bound, no method."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from scipy.cluster.vq import kmeans

from algorithms.sizing.segment import segment
from algorithms.types import Reconstruction, WallMap
from scenarios.equations import err_pct
from twin.features.base import Feature
from twin.pipe import Pipe

CLUSTERS = 10
SAMPLES = 20_000
JOIN_MM = 3.0


def oracle_err_pct(pipe: Pipe, features: list[Feature], found: Reconstruction) -> list[float]:
    """Smallest Eq. 29 of each feature over the thresholds M_1 .. M_N, the means of the map's intensity clusters.

    100 where none fits.
    """
    if not features:
        return []
    best = np.full(len(features), 100.0)
    for threshold in cluster_means(found):
        labels = segment(found.deviation_mm > threshold, found.wall, pipe.bore_radius_mm, JOIN_MM)
        best = np.minimum(best, [_err_pct(pipe, feature, found.wall, labels) for feature in features])
    return [float(smallest) for smallest in best]


def cluster_means(found: Reconstruction) -> Float[np.ndarray, "clusters"]:
    """The means M_1 .. M_N of the intensity clusters of a map, ascending, mm."""
    seen = found.deviation_mm[np.isfinite(found.deviation_mm)]
    start = np.linspace(seen.min(), seen.max(), CLUSTERS + 2)[1:-1]
    return np.sort(kmeans(seen[:: max(seen.size // SAMPLES, 1)], start)[0])


def group_err_pct(pipe: Pipe, feature: Feature, found: Reconstruction, threshold_mm: float) -> float:
    """Eq. 29 of one feature by one threshold; infinite where nothing of it lies beyond."""
    labels = segment(found.deviation_mm > threshold_mm, found.wall, pipe.bore_radius_mm, JOIN_MM)
    return _err_pct(pipe, feature, found.wall, labels)


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
    cell_arc = wall.cell_arc_mm(pipe.bore_radius_mm)
    return err_pct(np.ptp(z) + wall.cell_z_mm, np.ptp(arc) + cell_arc, size.length_mm, size.width_mm)

"""ORACLE: the paper's threshold search (section 4.4.1), which chooses with the TRUE size: an upper bound, no method."""

from __future__ import annotations

import numpy as np
from scipy.cluster.vq import kmeans

from algorithms.sizing.measure import segment
from algorithms.types import Reconstruction
from scenarios.equations import err_pct
from twin.features.base import Feature
from twin.pipe import Pipe

CLUSTERS = 10
SAMPLES = 20_000


def oracle_err_pct(pipe: Pipe, feature: Feature, found: Reconstruction) -> float:
    """Smallest Eq. 29 over the thresholds M_1 .. M_N, the means of the map's intensity clusters; 100 when none fits."""
    wall, size = found.wall, feature.size(pipe.bore_radius_mm)
    seen = found.deviation_mm[np.isfinite(found.deviation_mm)]
    start = np.linspace(seen.min(), seen.max(), CLUSTERS + 2)[1:-1]
    thin = seen[:: max(seen.size // SAMPLES, 1)]
    means = np.sort(kmeans(thin, start)[0])
    dz = np.abs(wall.z_mm - feature.distance_mm) < size.length_mm / 2
    from_middle = feature.arc_mm(wall.theta_rad, pipe.bore_radius_mm)
    inside = (np.abs(from_middle)[:, None] < size.width_mm / 2) & dz[None, :]
    best = 100.0
    for threshold in means:
        labels = segment(found.deviation_mm > threshold, wall, pipe.bore_radius_mm, join_mm=3.0)
        numbers = labels[inside & (labels > 0)]
        if numbers.size == 0:
            continue
        cells = labels == np.bincount(numbers).argmax()
        z = wall.z_mm[cells.any(axis=0)]
        arc = from_middle[cells.any(axis=1)]
        cell = wall.z_mm[1] - wall.z_mm[0], 2 * np.pi * pipe.bore_radius_mm / wall.theta_rad.size
        length, width = np.ptp(z) + cell[0], np.ptp(arc) + cell[1]
        best = min(best, err_pct(length, width, size.length_mm, size.width_mm))
    return best

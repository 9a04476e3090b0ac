"""Which measured defect is which true one."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from algorithms.types import Defect
from twin.pipe import Pipe

GATE_MM = 15.0  # a measured middle further than this outside the true outline is another defect


def match(pipe: Pipe, defects: tuple[Defect, ...]) -> list[tuple[int, int]]:
    """Pairs (index of the true feature, index of the measured defect), each used once, nearest in sum."""
    far = 1e9
    cost = np.full((len(pipe.features), len(defects)), far)
    for i, feature in enumerate(pipe.features):
        size = feature.size(pipe.bore_radius_mm)
        for j, defect in enumerate(defects):
            dz = abs(defect.distance_mm - feature.distance_mm)
            arc = abs(float(feature.arc_mm(defect.theta_rad, pipe.bore_radius_mm)))
            if dz <= size.length_mm / 2 + GATE_MM and arc <= size.width_mm / 2 + GATE_MM:
                cost[i, j] = np.hypot(dz, arc)
    if not cost.size:
        return []
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    return [(int(i), int(j)) for i, j in pairs if cost[i, j] < far]

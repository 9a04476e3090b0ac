"""Which measured defect is which true one."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from algorithms.types import Defect
from twin.pipe import Pipe

GATE_MM = 15.0  # a measured middle further than this outside the true outline is another defect


def is_obstacle(pipe: Pipe, defect: Defect) -> bool:
    """Whether what stands inward is part of the true pipe (a joint's bead, debris, a taper), and so no false call."""
    if not defect.inward:
        return False
    beads = [(joint.distance_mm, joint.bead_mm) for joint in pipe.joints if joint.bead_height_mm > 0]
    lumps = [(lump.distance_mm, lump.diameter_mm) for lump in pipe.debris]
    narrower = [((t.from_mm + t.to_mm) / 2, t.to_mm - t.from_mm) for t in pipe.tapers]
    places = [(z, (long + defect.length_mm) / 2 + GATE_MM) for z, long in beads + lumps + narrower]
    return any(abs(defect.distance_mm - z) <= reach for z, reach in places)


def match(pipe: Pipe, defects: tuple[Defect, ...]) -> list[tuple[int, int]]:
    """Pairs (index of the true feature, index of the measured defect), each used once, nearest in sum."""
    far = 1e9
    cost = np.full((len(pipe.features), len(defects)), far)
    for i, feature in enumerate(pipe.features):
        size = feature.size(pipe.bore_radius_mm)
        for j, defect in enumerate(defects):
            if defect.inward != feature.inward:
                continue
            dz = abs(defect.distance_mm - feature.distance_mm)
            arc = abs(float(feature.arc_mm(defect.theta_rad, pipe.bore_radius_mm)))
            if dz <= size.length_mm / 2 + GATE_MM and arc <= size.width_mm / 2 + GATE_MM:
                cost[i, j] = np.hypot(dz, arc)
    if not cost.size:
        return []
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    return [(int(i), int(j)) for i, j in pairs if cost[i, j] < far]


def false_calls(pipe: Pipe, defects: tuple[Defect, ...], pairs: list[tuple[int, int]]) -> list[Defect]:
    """Calls with neither a true feature nor an obstacle of the true pipe."""
    paired = {j for _, j in pairs}
    return [d for j, d in enumerate(defects) if j not in paired and not is_obstacle(pipe, d)]

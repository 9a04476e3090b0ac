"""A joint of the pipe in one ring's profile: it stands all around the wall at one place."""

from __future__ import annotations

import numpy as np

from algorithms.localisation.lags import Profile

SECTORS = 12
LEAST_SECTORS = 9  # of twelve, some of which strut and drop-outs may hide
WIDEST_MM = 30.0
SPREAD_MM = 6.0


def joint_mm(own: Profile, feature_mm: float) -> float | None:
    """Where along the pipe a joint's middle lies; None where there is none."""
    z, height = own
    high = np.abs(np.nan_to_num(height)) > feature_mm
    columns = np.flatnonzero(high.any(axis=0))
    if np.unique(columns * SECTORS // height.shape[1]).size < LEAST_SECTORS:
        return None
    weight = np.where(high, np.abs(height) - feature_mm, 0.0)
    middle = np.nansum(weight * z, axis=0)[columns] / weight.sum(axis=0)[columns]
    spread = float(np.median(np.abs(middle - np.median(middle))))
    if spread > SPREAD_MM or np.ptp(z[high]) > WIDEST_MM:
        return None
    return float(np.nansum(weight * z) / weight.sum())

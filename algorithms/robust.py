"""One robust measure of spread for all stages."""

from __future__ import annotations

import numpy as np

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def spread(values: np.ndarray) -> float:
    """Standard deviation by the median absolute deviation from the median; NaN of nothing."""
    return MAD_TO_SIGMA * float(np.median(np.abs(values - np.median(values)))) if values.size else float("nan")

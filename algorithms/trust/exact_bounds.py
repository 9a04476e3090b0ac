"""Exact bounds of shares and of rates: Clopper-Pearson's, Poisson's, and runs of hits; no normal approximation."""

from __future__ import annotations

from math import ceil, log
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import beta, chi2


class Share(NamedTuple):
    """So many of `n`, with the two-sided Clopper-Pearson interval of its probability (not a number of none)."""

    counted: int
    n: int
    share: float
    low: float
    high: float
    confidence: float


class Rate(NamedTuple):
    """Calls over a length, per metre, with the exact Poisson interval, and the one-sided upper bound."""

    calls: int
    length_m: float
    per_m: float
    low_per_m: float
    high_per_m: float
    upper_per_m: float
    confidence: float


def share_upper(count: int | float, n: int | float, confidence: float = 0.95) -> float:
    """The one-sided Clopper-Pearson upper bound (MIL-HDBK-1823A, Table G-I, of the false-call probability)."""
    _check(count, n, confidence)
    return 1.0 if count == n else float(beta.ppf(confidence, count + 1, n - count))


def share_lower(count: int | float, n: int | float, confidence: float = 0.95) -> float:
    """The one-sided Clopper-Pearson lower bound."""
    _check(count, n, confidence)
    return 0.0 if count == 0 else float(beta.ppf(1 - confidence, count, n - count + 1))


def share_of(count: int, n: int, confidence: float = 0.95) -> Share:
    """A share with its two-sided Clopper-Pearson interval (1934)."""
    _check(count, n, confidence)
    if n == 0:
        return Share(0, 0, float("nan"), 0.0, 1.0, confidence)
    one_sided = (1 + confidence) / 2
    low, high = share_lower(count, n, one_sided), share_upper(count, n, one_sided)
    return Share(count, n, count / n, low, high, confidence)


def _check(count: int | float, n: int | float, confidence: float) -> None:
    if not 0 <= count <= n:
        raise ValueError(f"{count} of {n} is no share")
    if not 0 < confidence < 1:
        raise ValueError(f"a confidence of {confidence} is not between 0 and 1")


def rate_of(count: int, length_m: float, confidence: float = 0.95) -> Rate:
    """False calls per metre of pipe that has nothing to call, with exact Poisson (Garwood 1936) bounds."""
    if count < 0:
        raise ValueError(f"{count} calls cannot be")
    if not (np.isfinite(length_m) and length_m > 0):
        raise ValueError(f"a length of {length_m} m is not greater than 0")
    if not 0 < confidence < 1:
        raise ValueError(f"a confidence of {confidence} is not between 0 and 1")
    tail = (1 - confidence) / 2
    low = chi2.ppf(tail, 2 * count) / 2 if count else 0.0
    high, upper = chi2.ppf(1 - tail, 2 * count + 2) / 2, chi2.ppf(confidence, 2 * count + 2) / 2
    per_m, low, high, upper = (float(value) / length_m for value in (count, low, high, upper))
    return Rate(count, length_m, per_m, low, high, upper, confidence)


def hits_needed(pod: float = 0.9, confidence: float = 0.95) -> int:
    """How many hits in a row show a POD with a confidence: 29 for 90/95."""
    return ceil(log(1 - confidence) / log(pod))


def run_of_hits_bound(
    size: Float[np.ndarray, "n"], hit: Bool[np.ndarray, "n"], pod: float = 0.9, confidence: float = 0.95
) -> float | None:
    """A bound of the size from which on the POD is at least `pod`, of no curve: POD only must not fall with size.

    The largest size of the first 29 targets (for 90/95) above the largest miss, none of them missed; each target is
    to be looked at once, or to count as hit only where every look hit. None where there are not so many.
    """
    needed = hits_needed(pod, confidence)
    misses = size[~hit]
    above = np.sort(size[size > (misses.max() if misses.size else -np.inf)])
    return float(above[needed - 1]) if above.size >= needed else None

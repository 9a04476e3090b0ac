"""Whether stated intervals hold the truth as often as they say: counted where the truth is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Shaped
from scipy.stats import norm

from algorithms.trust.exact_bounds import Share, share_lower, share_of, share_upper

LEAST_CASES = 30


class Coverage(NamedTuple):
    """How often intervals held the truth, on which side they missed, how wide they are, and what that says.

    `cases` is what the intervals count as where those of one scan miss together (`n` where they do not); the bounds of
    `held` are Clopper-Pearson's with it. `median_ratio` is the median error over the stated half width: 0.34 is right
    for normal errors at 95 %, whatever the tails.
    """

    stated: float
    n: int
    missing: int
    cases: float
    held: Share
    truth_below: int
    truth_above: int
    median_half_width: float
    median_ratio: float
    verdict: str


def coverage_of(
    low: Float[np.ndarray, "n"],
    high: Float[np.ndarray, "n"],
    truth: Float[np.ndarray, "n"],
    stated: float = 0.95,
    scan: Shaped[np.ndarray, "n"] | None = None,
) -> Coverage:
    """Count the intervals that hold the truth.

    Intervals with an end that is no number are `missing` and not counted. With `scan`, the intervals of one scan may
    share an error: the count is then worth fewer cases, after Korn and Graubard (1998).

    Raises:
        ValueError: for no interval at all, an interval that ends before it begins, or a truth that is not finite.
    """
    if not 0 < stated < 1:
        raise ValueError(f"a stated share of {stated} is not between 0 and 1")
    known = ~(np.isnan(low) | np.isnan(high))
    if not np.isfinite(truth).all():
        raise ValueError("a truth that is not finite")
    if np.any(low[known] > high[known]):
        raise ValueError("an interval that ends before it begins")
    if not known.any():
        raise ValueError(f"{low.size} intervals, of which none states both ends")
    low, high, truth = low[known], high[known], truth[known]
    holds = (low <= truth) & (truth <= high)
    n = int(known.sum())
    cases = float(n) if scan is None else effective_cases(holds, scan[known])
    held = _share(int(holds.sum()), n, cases)
    half = (high - low) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.abs((high + low) / 2 - truth) / half
    ratio = ratio[np.isfinite(ratio)]
    return Coverage(
        stated,
        n,
        int((~known).sum()),
        cases,
        held,
        int(np.sum(truth < low)),
        int(np.sum(truth > high)),
        float(np.median(half)),
        float(np.median(ratio)) if ratio.size else float("nan"),
        _verdict(held, stated, cases),
    )


def _share(count: int, n: int, cases: float) -> Share:
    """The share of all, with the interval that so many cases give."""
    if cases >= n:
        return share_of(count, n)
    part = count / n * cases
    return Share(count, n, count / n, share_lower(part, cases, 0.975), share_upper(part, cases, 0.975), 0.95)


def effective_cases(holds: Shaped[np.ndarray, "n"], scan: Shaped[np.ndarray, "n"]) -> float:
    """How many independent cases the intervals of some scans are worth: n over the design effect, at most n."""
    _, which, sizes = np.unique(scan, return_inverse=True, return_counts=True)
    share, n, scans = float(holds.mean()), holds.size, sizes.size
    if scans < 2 or share in (0.0, 1.0):
        return float(min(n, scans)) if scans < 2 else float(n)
    left = np.bincount(which, holds - share)
    variance = scans / (scans - 1) * float(np.sum(left**2)) / n**2
    return float(min(n, share * (1 - share) / variance)) if variance > 0 else float(n)


def _verdict(held: Share, stated: float, cases: float) -> str:
    if cases < LEAST_CASES:
        return "too few cases to tell"
    if held.low > stated:
        return "wider than stated"
    if held.high < stated:
        return "narrower than stated"
    return "as stated"


def right_median_ratio(stated: float = 0.95) -> float:
    """The median error over the half width of intervals that are right, for normal errors."""
    return float(norm.ppf(0.75) / norm.ppf((1 + stated) / 2))


def statement(coverage: Coverage) -> str:
    """The sentence of the report."""
    held = coverage.held
    missing = f"; {coverage.missing} more stated no interval" if coverage.missing else ""
    worth = f", worth {coverage.cases:.0f} independent ones" if coverage.cases < coverage.n else ""
    return (
        f"stated {100 * coverage.stated:g} % intervals hold the truth in {100 * held.share:.1f} % "
        f"[{100 * held.low:.1f}, {100 * held.high:.1f}] of {coverage.n} cases{worth}: {coverage.verdict}{missing}"
    )

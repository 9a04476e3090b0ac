"""A tool's performance as the inspection trade states it: tolerance at a certainty, classes, identification."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import binom

from algorithms.trust.exact_bounds import Share, share_lower, share_of, share_upper

TOLERANCE_PCT = 10.0  # of the wall
CERTAINTIES = (0.8, 0.9)
CONFIDENCE = 0.95
Verdict = Literal["shown", "not shown", "refuted"]


class Certainty(NamedTuple):
    """Whether at least `certainty` of sizes lie within the tolerance, judged by one-sided 95 % bounds of the share.

    `tolerance_pct` is the half width, in per cent of the wall, that the sizes themselves keep with this certainty, and
    `tolerance_upper_pct` its one-sided 95 % bound of order statistics (None where there are too few).
    """

    certainty: float
    verdict: Verdict
    lower: float
    upper: float
    tolerance_pct: float
    tolerance_upper_pct: float | None


class Unity(NamedTuple):
    """Measured over true depths: error in per cent of the wall, and the share within the tolerance."""

    n: int
    tolerance_pct: float
    bias_pct: float
    standard_deviation_pct: float
    worst_pct: float
    inside: Share
    certainties: tuple[Certainty, ...]


class Confusion(NamedTuple):
    """Counts of true (rows) over reported classes (columns), and the share that is right."""

    classes: tuple[str, ...]
    counts: Int[np.ndarray, "classes classes"]
    right: Share


class Identification(NamedTuple):
    """Of all features how many were found, and of those found how many were called what they are (POI)."""

    detected: Share
    identified: Share


def unity_of(
    measured: Float[np.ndarray, "n"],
    true: Float[np.ndarray, "n"],
    wall_mm: float,
    tolerance_pct: float = TOLERANCE_PCT,
) -> Unity:
    """How near measured depths come to true ones (API 1163; POF 100: +-10 % of the wall at 80 % certainty).

    Raises:
        ValueError: for no depth, or ones that are not finite; a depth that was not measured is no size to judge here.
    """
    if not measured.size:
        raise ValueError("no sizes to judge")
    if not (np.isfinite(measured).all() and np.isfinite(true).all()):
        raise ValueError("sizes that are not finite")
    if not (np.isfinite(wall_mm) and wall_mm > 0):
        raise ValueError(f"a wall of {wall_mm} mm is not greater than 0")
    error_pct = 100 * (measured - true) / wall_mm
    inside = np.abs(error_pct) <= tolerance_pct
    n = int(measured.size)
    return Unity(
        n,
        tolerance_pct,
        float(error_pct.mean()),
        float(error_pct.std(ddof=1)) if n > 1 else float("nan"),
        float(np.abs(error_pct).max()),
        share_of(int(inside.sum()), n),
        tuple(_certainty(certainty, inside, np.abs(error_pct)) for certainty in CERTAINTIES),
    )


def _certainty(certainty: float, inside: Bool[np.ndarray, "n"], away_pct: Float[np.ndarray, "n"]) -> Certainty:
    count, n = int(inside.sum()), inside.size
    lower, upper = share_lower(count, n, CONFIDENCE), share_upper(count, n, CONFIDENCE)
    verdict: Verdict = "shown" if lower >= certainty else "refuted" if upper < certainty else "not shown"
    ordered = np.sort(away_pct)
    own = float(ordered[int(np.ceil(certainty * n)) - 1])
    # the k-th of n is above the quantile with probability P(fewer than k lie below it)
    k = int(binom.ppf(CONFIDENCE, n, certainty)) + 1
    bound = float(ordered[k - 1]) if k <= n else None
    return Certainty(certainty, verdict, lower, upper, own, bound)


def confusion_of(true: Sequence[str], reported: Sequence[str], classes: Sequence[str]) -> Confusion:
    """Count reported classes over true ones.

    Raises:
        ValueError: for lists of unequal length, or a class that is none of `classes`.
    """
    if len(true) != len(reported):
        raise ValueError(f"{len(true)} true classes and {len(reported)} reported ones")
    places = {name: k for k, name in enumerate(classes)}
    if unknown := sorted({*true, *reported} - set(places)):
        raise ValueError(f"no class {', '.join(unknown)}; known: {', '.join(classes)}")
    counts = np.zeros((len(classes), len(classes)), dtype=int)
    for one, other in zip(true, reported, strict=True):
        counts[places[one], places[other]] += 1
    return Confusion(tuple(classes), counts, share_of(int(np.trace(counts)), len(true)))


def identification_of(found: Bool[np.ndarray, "n"], right: Bool[np.ndarray, "n"]) -> Identification:
    """Probability of detection and of identification, each with its interval; `right` counts only where found."""
    hits = int(found.sum())
    return Identification(share_of(hits, int(found.size)), share_of(int((found & right).sum()), hits))


def unity_words(unity: Unity) -> list[str]:
    """The statement in lines: the share inside, then a verdict for each certainty."""
    inside = unity.inside
    lines = [
        f"{inside.counted} of {inside.n} within +-{unity.tolerance_pct:g} % of the wall: {100 * inside.share:.1f} % "
        f"[{100 * inside.low:.1f}, {100 * inside.high:.1f}]"
    ]
    for c in unity.certainties:
        bound = "too few to bound it" if c.tolerance_upper_pct is None else f"at most {c.tolerance_upper_pct:.1f} %"
        lines.append(
            f"+-{unity.tolerance_pct:g} % at {100 * c.certainty:g} % certainty: {c.verdict} (share at least "
            f"{100 * c.lower:.1f} %, at most {100 * c.upper:.1f} %); own tolerance {c.tolerance_pct:.1f} %, {bound}"
        )
    return lines

"""One quantity out of a log: its value, the interval that holds it 95 times in 100, and what both rest on."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2, t

LEVEL = 0.95
BLOCKS = 8
LEAST_BLOCKS = 2
MANY = 8
NORMAL_95 = 1.959964


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval, on how many independent values it rests, and from what it was made."""

    value: float
    low: float
    high: float
    count: int
    source: str

    def scaled(self, factor: float) -> Estimate:
        """The same in another unit."""
        low, high = sorted((self.low * factor, self.high * factor))
        return Estimate(self.value * factor, low, high, self.count, self.source)


@dataclass(frozen=True)
class Unknown:
    """A quantity that the log does not tell, and why not."""

    reason: str

    def scaled(self, factor: float) -> Unknown:  # noqa: ARG002  as of what is known
        """As unknown in any unit."""
        return self


Quantity = Estimate | Unknown


def blocks_of(n: int, blocks: int = BLOCKS) -> list[slice]:
    """A log of n values cut into so many stretches, as equal as can be."""
    edges = np.linspace(0, n, min(blocks, max(n, 1)) + 1).round().astype(int)
    return [slice(a, b) for a, b in pairwise(edges.tolist())]


def of_blocks(values: Float[np.ndarray, "blocks"], source: str, more_std: float = 0.0) -> Quantity:
    """Mean of values that know nothing of each other; Student's t for the interval.

    Args:
        values: one a block; what is not finite is left out.
        source: what they are.
        more_std: standard deviation that all of them share, and that their scatter does not show.
    """
    sound = values[np.isfinite(values)]
    if sound.size < LEAST_BLOCKS:
        return Unknown(f"{sound.size} stretches of the log show it; {LEAST_BLOCKS} are needed")
    mean = float(sound.mean())
    half = t_factor(sound.size - 1) * float(np.hypot(sound.std(ddof=1) / np.sqrt(sound.size), more_std))
    return Estimate(mean, mean - half, mean + half, int(sound.size), source)


def root_of(found: Quantity) -> Quantity:
    """The root of a variance and of its bounds; a variance below zero is none."""
    if isinstance(found, Unknown):
        return found
    value, low, high = (float(np.sqrt(max(bound, 0.0))) for bound in (found.value, found.low, found.high))
    return Estimate(value, low, high, found.count, found.source)


def widened(found: Quantity, more_std: float) -> Quantity:
    """The same with an error that its own interval does not know of."""
    if isinstance(found, Unknown):
        return found
    half = float(np.hypot((found.high - found.low) / 2, NORMAL_95 * more_std))
    return Estimate(found.value, found.value - half, found.value + half, found.count, found.source)


def about(value: float, std: float, count: int, source: str) -> Estimate:
    """A value of known standard deviation."""
    return Estimate(value, value - NORMAL_95 * std, value + NORMAL_95 * std, count, source)


def t_factor(freedom: int) -> float:
    """Student's factor of a two-sided 95 % interval."""
    return float(t.ppf(0.5 + LEVEL / 2, freedom))


def of_variances(variances: Float[np.ndarray, "n"], freedom: float, source: str) -> Estimate:
    """Standard deviation from variances that each have so many degrees of freedom; chi-squared for the interval.

    Many of them that scatter by more than chance are worth as much less.
    """
    total = float(freedom * variances.size)
    variance = float(variances.mean())
    if variances.size >= MANY:
        total /= max(float(np.var(variances, ddof=1)) * freedom / (2 * variance**2), 1.0)
    low, high = (np.sqrt(total * variance / chi2.ppf(q, total)) for q in (0.5 + LEVEL / 2, 0.5 - LEVEL / 2))
    return Estimate(float(np.sqrt(variance)), float(low), float(high), int(total), source)


def of_share(hits: Float[np.ndarray, "blocks"], tries: Float[np.ndarray, "blocks"], source: str) -> Quantity:
    """A share; the interval is Wilson's, as wide as the blocks' scatter beyond chance makes it."""
    total = float(tries.sum())
    if total == 0:
        return Unknown("nothing was to be seen")
    share = float(hits.sum()) / total
    used = tries > 0
    chance = np.maximum(share * (1 - share) * tries[used], 1e-300)
    freedom = max(int(np.count_nonzero(used)) - 1, 1)
    excess = max(float(np.sum((hits[used] - share * tries[used]) ** 2 / chance)) / freedom, 1.0) if share > 0 else 1.0
    z2 = t_factor(freedom) ** 2 * excess if excess > 1 else NORMAL_95**2
    middle = (share + z2 / (2 * total)) / (1 + z2 / total)
    half = np.sqrt(z2) / (1 + z2 / total) * np.sqrt(share * (1 - share) / total + z2 / (4 * total**2))
    # rounding must not push a bound past the value
    low, high = min(max(middle - half, 0.0), share), max(middle + half, share)
    return Estimate(share, float(low), float(high), int(total), source)

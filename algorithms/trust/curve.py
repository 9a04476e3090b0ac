"""What every POD curve gives, and the sizes that likelihood-ratio regions bound; never the delta method."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2

SCALES = ("log", "linear")
HANDBOOK_DROP = 3.841  # chi2(1) at 95 %, as the handbook prints it
FARTHEST = 1e4  # spreads of the curve; a bound beyond says nothing,
FARTHEST_LOG = float(np.log(1e6))  # nor does one a million times the size of the curve's middle

Outcome = Literal["separated", "all hits", "all misses", "no rise", "a step", "too few sizes", "no spread"]


class NoCurve(NamedTuple):
    """Why there is no curve: a named outcome, and the reason in words. It is false."""

    outcome: Outcome
    reason: str

    def __bool__(self) -> bool:
        return False


@runtime_checkable
class Curve(Protocol):
    """A fitted POD curve on its own axis x, which is the size or its logarithm, and the likelihood around it."""

    @property
    def scale(self) -> str:
        """`log` or `linear`."""

    @property
    def log_likelihood(self) -> float:
        """That of the likeliest curve, which this is."""

    @property
    def mu(self) -> float:
        """The curve's own middle."""

    def place(self, pod: float) -> float:
        """The x at which the curve reaches a POD; not a number where it never does."""

    def spread(self) -> float:
        """The sigma of the curve in x."""

    def pod(self, x: np.ndarray) -> np.ndarray:
        """The POD at x."""

    def log_likelihood_through(self, x: float, pod: float) -> float:
        """The best log-likelihood of all curves that rise, or are flat, and take this POD at x."""

    def log_likelihood_without(self, pod: float, side: Literal["above", "below"]) -> float:
        """The best log-likelihood of all curves that stay on one side of this POD at any size."""


def one_sided_drop(confidence: float) -> float:
    """The fall of twice the log-likelihood that a one-sided bound of this confidence allows: 2.706 for 95 %."""
    return float(chi2.ppf(2 * confidence - 1, 1))


def to_x(size: np.ndarray | float, scale: str) -> np.ndarray:
    """The curve's axis: the size, or its natural logarithm (size 0 is minus infinity there)."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(size) if scale == "log" else size, dtype=float)


def to_size(x: float, scale: str) -> float:
    """The size at x; a linear curve that would need a size below nothing gives 0."""
    with np.errstate(over="ignore"):
        return float(np.exp(x)) if scale == "log" else max(float(x), 0.0)


def size_at(curve: Curve, pod: float) -> float | None:
    """The size at which the curve reaches a POD (a50, a90); None where it never does."""
    size = to_size(curve.place(pod), curve.scale)
    return size if np.isfinite(size) else None


def size_bound(curve: Curve, pod: float, drop: float, side: Literal["upper", "lower"] = "upper") -> float | None:
    """The largest (smallest) size at which a curve inside the likelihood-ratio region reaches this POD.

    The region holds every curve whose twice log-likelihood is at most `drop` below the best one's: for a90/95
    `one_sided_drop(0.95)`, or 3.841 as MIL-HDBK-1823A takes it (Appendix G, the loglikelihood ratio criterion).
    None where the region holds curves that never reach the POD: then the data give no bound (a lower one is 0).
    """
    sign, nowhere = (1.0, None) if side == "upper" else (-1.0, 0.0)
    reach = min(FARTHEST * curve.spread(), FARTHEST_LOG) if curve.scale == "log" else FARTHEST * curve.spread()

    def fall(x: float) -> float:
        return 2 * (curve.log_likelihood - curve.log_likelihood_through(x, pod)) - drop

    if 2 * (curve.log_likelihood - curve.log_likelihood_without(pod, "above" if sign > 0 else "below")) <= drop:
        return nowhere
    inside = _inside(curve, pod, fall, -sign, reach)
    if inside is None:
        return 0.0 if side == "upper" else None
    outside = bracket(fall, inside, sign * curve.spread(), reach)
    if outside is None:
        return nowhere
    return to_size(float(brentq(fall, inside, outside, xtol=1e-12, rtol=1e-12)), curve.scale)


def _inside(curve: Curve, pod: float, fall: Callable[[float], float], inward: float, reach: float) -> float | None:
    """A place at which a curve of the region takes the POD: where the likeliest one does, if it ever does."""
    place = curve.place(pod)
    if np.isfinite(place):
        return place
    if fall(curve.mu) <= 0:
        return curve.mu
    return bracket(lambda x: -fall(x), curve.mu, inward * curve.spread(), reach)


def bracket(fall: Callable[[float], float], start: float, step: float, farthest: float) -> float | None:
    """A place where `fall` is above nothing, sought outward from `start` by doubling; None if there is none near."""
    while abs(step) < farthest:
        if fall(start + step) > 0:
            return start + step
        step *= 2
    return None

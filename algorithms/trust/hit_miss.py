"""Probability of detection from hits and misses: a generalised linear model of size (MIL-HDBK-1823A, Appendix G)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from algorithms.trust.curve import NoCurve, to_x
from algorithms.trust.links import LINKS, STEEPEST, Link

FEWEST_SIZES = 3
MOST_STEPS = 200
SETTLED = 1e-13


@dataclass(frozen=True)
class HitMiss:
    """Looks at targets of known size, each a hit or a miss; `weight` is what a look counts, 1 for an only look.

    `blank_calls` of `blank_looks` (counted by weight too) are calls where there was nothing to find.
    """

    size: Float[np.ndarray, "n"]
    hit: Bool[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]
    blank_looks: float = 0.0
    blank_calls: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.size).all() and np.all(self.size > 0)):
            raise ValueError("sizes must be finite and greater than 0; looks where nothing is are `blank_looks`")
        if not (np.isfinite(self.weight).all() and np.all(self.weight > 0)):
            raise ValueError("weights must be finite and greater than 0")


@dataclass(frozen=True)
class HitMissCurve:
    """POD = F(intercept + slope x) with x the size or its logarithm; `covariance` is of intercept and slope.

    `mu` and `sigma` are the curve's own place and spread in x: F((x - mu) / sigma).
    """

    data: HitMiss
    link: str
    scale: str
    intercept: float
    slope: float
    covariance: Float[np.ndarray, "2 2"]
    log_likelihood: float

    @property
    def mu(self) -> float:
        """The x at which the predictor is nothing (with logit and probit the place of a50)."""
        return -self.intercept / self.slope

    @property
    def sigma(self) -> float:
        """The spread in x."""
        return 1 / self.slope

    @property
    def deviance(self) -> float:
        """Twice the log-likelihood below that of a perfect forecast; of hits and misses one by one."""
        return -2 * self.log_likelihood

    def place(self, pod: float) -> float:
        """The x at which the curve reaches a POD."""
        return self.mu + self.sigma * float(LINKS[self.link].quantile(pod))

    def spread(self) -> float:
        """The sigma of the curve in x."""
        return self.sigma

    def pod(self, x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """The POD at x."""
        return LINKS[self.link].cdf(np.clip(self.intercept + self.slope * x, -STEEPEST, STEEPEST))

    def log_likelihood_through(self, x: float, pod: float) -> float:
        """The best of all curves that rise, or are flat, and take this POD at x."""
        link, data = LINKS[self.link], self.data
        level = float(link.quantile(pod))
        from_x = to_x(data.size, self.scale) - x
        (slope,), best = maximise(link, np.full(data.size.size, level), from_x[:, None], data)
        if slope > 0:
            return best
        return log_likelihood(link, np.full(data.size.size, level), data)

    def log_likelihood_without(self, pod: float, side: Literal["above", "below"]) -> float:
        """The best of all curves that stay below (above) this POD at any size: they are flat."""
        share = float(np.average(self.data.hit, weights=self.data.weight))
        level = min(share, pod) if side == "above" else max(share, pod)
        link = LINKS[self.link]
        return log_likelihood(link, np.full(self.data.size.size, float(link.quantile(level))), self.data)


def fit_hit_miss(data: HitMiss, link: str = "logit", scale: str = "log") -> HitMissCurve | NoCurve:
    """The likeliest curve, by Fisher scoring; or, by name, why there is none.

    Hits and misses that some size parts have no likeliest curve: its slope would be infinite, and what programs
    print then is where they stopped. MIL-HDBK-1823A's models are `logit` on `log` or `linear` sizes.
    """
    if (missing := no_curve(data)) is not None:
        return missing
    x = to_x(data.size, scale)
    middle = float(np.average(x, weights=data.weight))
    design = np.column_stack([np.ones_like(x), x - middle])
    (height, slope), best = maximise(LINKS[link], np.zeros_like(x), design, data)
    if slope <= 0:
        return NoCurve("no rise", f"hits do not grow with size (slope {slope:.3g}): no a50, no a90")
    plain = np.column_stack([np.ones_like(x), x])
    intercept = float(height - slope * middle)
    information = _information(LINKS[link], intercept + slope * x, plain, data)
    return HitMissCurve(data, link, scale, intercept, float(slope), np.linalg.inv(information), best)


def no_curve(data: HitMiss) -> NoCurve | None:
    """Why these hits and misses have no curve, or nothing."""
    n, hits = data.size.size, int(data.hit.sum())
    sizes = np.unique(data.size).size
    if n == 0 or sizes < FEWEST_SIZES:
        return NoCurve("too few sizes", f"{n} looks at {sizes} different sizes; at least {FEWEST_SIZES} are needed")
    if hits == n:
        return NoCurve("all hits", f"all {n} looks are hits: nothing shows where detection begins to fail")
    if hits == 0:
        return NoCurve("all misses", f"all {n} looks are misses: nothing shows where detection begins")
    largest_miss, smallest_hit = float(data.size[~data.hit].max()), float(data.size[data.hit].min())
    if largest_miss <= smallest_hit:
        return NoCurve(
            "separated",
            f"every miss is at {largest_miss:g} or below and every hit at {smallest_hit:g} or above: the slope has no "
            "likeliest value (it would be infinite); more targets near these sizes are needed",
        )
    largest_hit, smallest_miss = float(data.size[data.hit].max()), float(data.size[~data.hit].min())
    if largest_hit <= smallest_miss:
        return NoCurve("no rise", f"every hit is at {largest_hit:g} or below, every miss at {smallest_miss:g} or above")
    return None


def maximise(
    link: Link, offset: Float[np.ndarray, "n"], design: Float[np.ndarray, "n k"], data: HitMiss
) -> tuple[Float[np.ndarray, "k"], float]:
    """The likeliest coefficients of predictor = offset + design @ coefficients, and their log-likelihood.

    Fisher scoring with halved steps: these likelihoods have one summit.
    """
    coefficients = np.zeros(design.shape[1])
    best = log_likelihood(link, offset, data)
    for _ in range(MOST_STEPS):
        predictor = offset + design @ coefficients
        gradient = design.T @ _score(link, predictor, data)
        step = np.linalg.lstsq(_information(link, predictor, design, data), gradient, rcond=None)[0]
        coefficients, value = _halved(link, offset, design, data, coefficients, step, best)
        settled, best = value - best <= SETTLED * (1 + abs(best)), value
        if settled:
            break
    return coefficients, best


def _halved(
    link: Link,
    offset: np.ndarray,
    design: np.ndarray,
    data: HitMiss,
    start: np.ndarray,
    step: np.ndarray,
    best: float,
) -> tuple[np.ndarray, float]:
    """The first of the step, its half, its quarter ... that does not lose likelihood."""
    for _ in range(60):
        value = log_likelihood(link, offset + design @ (start + step), data)
        if value >= best:
            return start + step, value
        step = step / 2
    return start, best


def log_likelihood(link: Link, predictor: Float[np.ndarray, "n"], data: HitMiss) -> float:
    """The weighted log-likelihood of the hits and misses."""
    predictor = np.clip(predictor, -STEEPEST, STEEPEST)
    with np.errstate(divide="ignore"):
        return float(data.weight @ np.where(data.hit, link.log_cdf(predictor), link.log_sf(predictor)))


def _score(link: Link, predictor: np.ndarray, data: HitMiss) -> np.ndarray:
    predictor = np.clip(predictor, -STEEPEST, STEEPEST)
    log_pdf = link.log_pdf(predictor)
    with np.errstate(divide="ignore", over="ignore"):
        up, down = np.exp(log_pdf - link.log_cdf(predictor)), np.exp(log_pdf - link.log_sf(predictor))
    return data.weight * np.where(data.hit, up, -down)


def _information(link: Link, predictor: np.ndarray, design: np.ndarray, data: HitMiss) -> np.ndarray:
    """The expected information of the coefficients, as generalised linear models state it."""
    predictor = np.clip(predictor, -STEEPEST, STEEPEST)
    with np.errstate(divide="ignore"):
        log_weight = 2 * link.log_pdf(predictor) - link.log_cdf(predictor) - link.log_sf(predictor)
    return design.T @ ((data.weight * np.exp(log_weight))[:, None] * design)

"""Hit/miss curves that start above 0 or end below 1: false calls at any size, and targets never to be found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from algorithms.trust.curve import NoCurve, to_x
from algorithms.trust.hit_miss import HitMiss, HitMissCurve, fit_hit_miss, no_curve
from algorithms.trust.links import LINKS, STEEPEST

NEAREST = 1e-9  # of a POD to 0, to 1, to its floor or its ceiling
STEEPEST_RATIO = 1e4  # to the plain curve's slope
ON_THE_RISE = (0.01, 0.99)  # of the way from floor to ceiling
NO_SLOPE = 1e-9
FIRST_FLOOR, FIRST_CEILING = 0.01, 0.99

Parameters = Float[np.ndarray, "k"]
Value = Callable[[Parameters], tuple[float, Parameters]]


@dataclass(frozen=True)
class FloorCeilingCurve:
    """POD = floor + (ceiling - floor) F((x - mu) / sigma); a blank place is called with probability `floor`."""

    data: HitMiss
    link: str
    scale: str
    floor_free: bool
    ceiling_free: bool
    mu: float
    sigma: float
    floor: float
    ceiling: float
    log_likelihood: float

    @property
    def deviance(self) -> float:
        """Twice the log-likelihood of the looks at targets below a perfect forecast's; blank places are not in it."""
        blank = _blank_log_likelihood(self, self.floor)[0]
        return -2 * (self.log_likelihood - blank)

    def place(self, pod: float) -> float:
        """The x at which the curve reaches a POD; not a number outside floor and ceiling."""
        if not self.floor < pod < self.ceiling:
            return float("nan")
        share = (pod - self.floor) / (self.ceiling - self.floor)
        return self.mu + self.sigma * float(LINKS[self.link].quantile(share))

    def spread(self) -> float:
        """The sigma of the curve in x."""
        return self.sigma

    def pod(self, x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """The POD at x."""
        rise = LINKS[self.link].cdf(np.clip((x - self.mu) / self.sigma, -STEEPEST, STEEPEST))
        return self.floor + (self.ceiling - self.floor) * rise

    def log_likelihood_through(self, x: float, pod: float) -> float:
        """The best of all curves that rise, or are flat, and take this POD at x."""
        link, from_x = LINKS[self.link], (to_x(self.data.size, self.scale) - x) / self.sigma

        def value(of: Parameters) -> tuple[float, Parameters]:
            slope, below, above = of[0], pod * of[1], (1 - pod) * of[2]
            floor, ceiling = pod - below, pod + above
            share = below / (below + above)
            level = float(link.quantile(share))
            total, by_predictor, by_floor, by_ceiling = _slopes(self, level + slope * from_x, floor, ceiling)
            by_level = by_predictor.sum() / float(np.exp(link.log_pdf(level))) / (below + above)
            by_below, by_above = by_level * (1 - share) - by_floor, by_ceiling - by_level * share
            return total, np.array([by_predictor @ from_x, pod * by_below, (1 - pod) * by_above])

        near = [np.clip((pod - self.floor) / pod, 0.01, 1.0), np.clip((self.ceiling - pod) / (1 - pod), 0.01, 1.0)]
        below = (NEAREST, 1.0) if self.floor_free else (1.0, 1.0)
        above = (NEAREST, 1.0) if self.ceiling_free else (1.0, 1.0)
        starts = [[slope, *near] for slope in (0.2, 1.0, 4.0)]
        return best_of(value, starts, [(0.0, STEEPEST_RATIO), below, above])[1]

    def log_likelihood_without(self, pod: float, side: Literal["above", "below"]) -> float:
        """The best of all curves that stay below (above) this POD at any size."""
        low, high = (0.0, pod) if side == "above" else (pod, 1.0)
        free = self.ceiling_free if side == "above" else self.floor_free
        return self._within(low, high) if free else self._flat(low, high)

    def _flat(self, low: float, high: float) -> float:
        """The best curve that does not rise between these limits: what is left without a size that reaches the POD."""
        data = self.data
        share = float(np.clip(np.average(data.hit, weights=data.weight), max(low, NEAREST), min(high, 1 - NEAREST)))
        called = data.blank_calls / data.blank_looks if data.blank_looks else 0.0
        floor = min(called, share) if self.floor_free else 0.0
        level = float(LINKS[self.link].quantile((share - floor) / (1 - floor))) if share > floor else -STEEPEST
        return _slopes(self, np.full(data.size.size, level), floor, 1.0)[0]

    def _within(self, low: float, high: float) -> float:
        """The best curve whose floor and ceiling stay inside these limits, where they are free."""
        return _best_curve(self, low if self.floor_free else 0.0, high if self.ceiling_free else 1.0)[1]


def _slopes(
    curve: FloorCeilingCurve, predictor: Float[np.ndarray, "n"], floor: float, ceiling: float
) -> tuple[float, Float[np.ndarray, "n"], float, float]:
    """The weighted log-likelihood and its slopes: by each predictor, by the floor, by the ceiling.

    Blank places count where the floor is free: there the POD is the floor.
    """
    data, link = curve.data, LINKS[curve.link]
    predictor = np.clip(predictor, -STEEPEST, STEEPEST)
    rise, density = link.cdf(predictor), np.exp(link.log_pdf(predictor))
    pod = np.clip(floor + (ceiling - floor) * rise, NEAREST**2, 1 - 1e-15)
    total = data.weight @ np.where(data.hit, np.log(pod), np.log1p(-pod))
    by_pod = data.weight * np.where(data.hit, 1 / pod, -1 / (1 - pod))
    by_floor, by_ceiling = by_pod @ (1 - rise), by_pod @ rise
    blank, by_blank = _blank_log_likelihood(curve, floor)
    by_predictor = by_pod * (ceiling - floor) * density
    return float(total + blank), by_predictor, float(by_floor + by_blank), float(by_ceiling)


def _blank_log_likelihood(curve: FloorCeilingCurve, floor: float) -> tuple[float, float]:
    """The log-likelihood of calls at blank places and its slope by the floor; nothing where the floor is not free."""
    called, quiet = curve.data.blank_calls, curve.data.blank_looks - curve.data.blank_calls
    if not curve.floor_free or called + quiet == 0:
        return 0.0, 0.0
    at = float(np.clip(floor, NEAREST, 1 - NEAREST))
    return float(called * np.log(at) + quiet * np.log1p(-at)), called / at - quiet / (1 - at)


def _best_curve(curve: FloorCeilingCurve, lowest: float, highest: float) -> tuple[Parameters, float]:
    """The best middle and slope (in the curve's own units) and shares of floor and ceiling between two limits."""
    place = (to_x(curve.data.size, curve.scale) - curve.mu) / curve.sigma

    def value(of: Parameters) -> tuple[float, Parameters]:
        floor, ceiling = _ends(of, lowest, highest)
        total, by_predictor, by_floor, by_ceiling = _slopes(curve, of[1] * (place - of[0]), floor, ceiling)
        return total, np.array(
            [
                -of[1] * by_predictor.sum(),
                by_predictor @ (place - of[0]),
                (highest - lowest) * (by_floor + (1 - of[3]) * by_ceiling),
                (highest - floor) * by_ceiling,
            ]
        )

    ends = [(FIRST_FLOOR if curve.floor_free else 0.0, FIRST_CEILING if curve.ceiling_free else 1.0)]
    if curve.floor_free or curve.ceiling_free:
        ends.append((0.15 if curve.floor_free else 0.0, 0.85 if curve.ceiling_free else 1.0))
    starts = [[at, slope, *end] for at in (-0.7, 0.0, 0.7) for slope in (1.0, 4.0) for end in ends]
    most, least = (1 - 1e-6 if curve.floor_free else 0.0), (1e-6 if curve.ceiling_free else 1.0)
    middles = (float(place.min()) - 3, float(place.max()) + 3)
    return best_of(value, starts, [middles, (NO_SLOPE, STEEPEST_RATIO), (0.0, most), (least, 1.0)])


def _ends(of: Parameters, lowest: float, highest: float) -> tuple[float, float]:
    """Floor and ceiling from their shares of the way from the lowest to the highest, and from the floor to that."""
    floor = lowest + (highest - lowest) * of[2]
    return float(floor), float(floor + (highest - floor) * of[3])


def best_of(
    value: Value, starts: Sequence[Sequence[float]], bounds: Sequence[tuple[float, float]]
) -> tuple[Parameters, float]:
    """The largest value found from several starts inside the bounds: these likelihoods may have several summits."""
    low, high = np.array(bounds, dtype=float).T

    def down(of: Parameters) -> tuple[float, Parameters]:
        total, slopes = value(of)
        return -total, -slopes

    options = {"ftol": 1e-14, "gtol": 1e-9, "maxiter": 500}
    found = [
        minimize(down, np.clip(start, low, high), jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        for start in starts
    ]
    best = min(found, key=lambda one: one.fun)
    return best.x, -float(best.fun)


def fit_floor_ceiling(
    data: HitMiss, link: str = "logit", scale: str = "log", floor: bool = True, ceiling: bool = True
) -> FloorCeilingCurve | NoCurve:
    """The likeliest curve with a floor, a ceiling or both free; or, by name, why there is none.

    With a free floor, calls at blank places count as evidence of it.
    """
    if (missing := no_curve(data)) is not None:
        return missing
    x = to_x(data.size, scale)
    plain = fit_hit_miss(data, link, scale)
    middle, spread = float(np.median(x)), float(np.std(x))
    if isinstance(plain, HitMissCurve):
        middle, spread = plain.mu, plain.sigma
    first = FloorCeilingCurve(data, link, scale, floor, ceiling, middle, spread, 0.0, 1.0, -np.inf)
    of, best = _best_curve(first, 0.0, 1.0)
    if of[1] <= 10 * NO_SLOPE:
        return NoCurve("no rise", "hits do not grow with size: no a50, no a90")
    rise = LINKS[link].cdf(np.clip(of[1] * ((np.unique(x) - middle) / spread - of[0]), -STEEPEST, STEEPEST))
    if np.sum((rise > ON_THE_RISE[0]) & (rise < ON_THE_RISE[1])) < 2:
        return NoCurve(
            "a step", "the likeliest curve is a step: with floor or ceiling free its slope would be infinite"
        )
    bottom, top = _ends(of, 0.0, 1.0)
    mu, sigma = float(middle + spread * of[0]), float(spread / of[1])
    return FloorCeilingCurve(data, link, scale, floor, ceiling, mu, sigma, bottom, top, best)

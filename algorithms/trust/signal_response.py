"""Probability of detection from signals over sizes (a-hat vs a): a censored line (MIL-HDBK-1823A, Appendix G)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import log_ndtr, ndtr, ndtri

from algorithms.trust.curve import NoCurve, to_x
from algorithms.trust.links import LOG_SQRT_2PI

FEWEST_TARGETS, FEWEST_SIZES = 4, 3
MOST_STEPS = 200
SETTLED = 1e-13


@dataclass(frozen=True)
class Signals:
    """Signals from targets of known size. `below` marks signals known only to be at most the stated value
    (under the noise), `above` those known only to be at least it (saturated); `weight` is what a look counts.
    """  # noqa: D205

    size: Float[np.ndarray, "n"]
    signal: Float[np.ndarray, "n"]
    below: Bool[np.ndarray, "n"]
    above: Bool[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.size).all() and np.all(self.size > 0)):
            raise ValueError("sizes must be finite and greater than 0")
        if not np.isfinite(self.signal).all():
            raise ValueError("signals must be finite")
        if np.any(self.below & self.above):
            raise ValueError("a signal cannot be below and above its limits")
        if not (np.isfinite(self.weight).all() and np.all(self.weight > 0)):
            raise ValueError("weights must be finite and greater than 0")


@dataclass(frozen=True)
class SignalCurve:
    """signal = intercept + slope x + tau e, e normal; a signal above `decision` is a hit.

    x and signal are as measured, or their natural logarithms.
    `covariance` is of intercept, slope, tau. POD = Phi((x - mu) / sigma).
    """

    data: Signals
    scale: str
    signal_scale: str
    decision: float
    intercept: float
    slope: float
    tau: float
    covariance: Float[np.ndarray, "3 3"]
    log_likelihood: float

    @property
    def mu(self) -> float:
        """The x at which half of the signals exceed the decision: that of a50."""
        return (self._decision - self.intercept) / self.slope

    @property
    def sigma(self) -> float:
        """The spread of the curve in x."""
        return self.tau / self.slope

    @property
    def place_covariance(self) -> Float[np.ndarray, "2 2"]:
        """The covariance of mu and sigma, as the handbook prints it; no bound here is made of it."""
        to_mu = np.array([-1.0, -self.mu, 0.0]) / self.slope
        to_sigma = np.array([0.0, -self.sigma, 1.0]) / self.slope
        jacobian = np.stack([to_mu, to_sigma])
        return jacobian @ self.covariance @ jacobian.T

    @property
    def _decision(self) -> float:
        return float(to_x(self.decision, self.signal_scale))

    def place(self, pod: float) -> float:
        """The x at which the curve reaches a POD."""
        return self.mu + self.sigma * float(ndtri(pod))

    def spread(self) -> float:
        """The sigma of the curve in x."""
        return self.sigma

    def pod(self, x: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """The POD at x."""
        return ndtr((x - self.mu) / self.sigma)

    def log_likelihood_through(self, x: float, pod: float) -> float:
        """The best of all lines that rise, or are flat, and give this POD at x."""
        sizes, signals = self._axes()
        over = signals - self._decision
        offset = np.full(sizes.size, -float(ndtri(pod)))
        of, best = maximise(self.data, offset, np.column_stack([over, x - sizes]), 1 / self.tau)
        if of[1] > 0:
            return best
        return maximise(self.data, offset, over[:, None], 1 / self.tau)[1]

    def log_likelihood_without(self, pod: float, side: Literal["above", "below"]) -> float:
        """The best of all flat lines whose POD stays below (above) this one."""
        over = self._axes()[1] - self._decision
        of, best = maximise(self.data, np.zeros(over.size), np.column_stack([over, -np.ones(over.size)]), 1 / self.tau)
        level, limit = of[1], float(ndtri(pod))
        if level <= limit if side == "above" else level >= limit:
            return best
        return maximise(self.data, np.full(over.size, -limit), over[:, None], 1 / self.tau)[1]

    def _axes(self) -> tuple[np.ndarray, np.ndarray]:
        return to_x(self.data.size, self.scale), to_x(self.data.signal, self.signal_scale)


def fit_signals(
    data: Signals, decision: float, scale: str = "log", signal_scale: str = "linear"
) -> SignalCurve | NoCurve:
    """The likeliest line with normal scatter, censored signals included (the handbook's model); or, by name, why none.

    Raises:
        ValueError: when signals or the decision are not greater than 0 on a logarithmic signal scale.
    """
    if signal_scale == "log" and (decision <= 0 or np.any(data.signal <= 0)):
        raise ValueError("a logarithmic signal scale needs signals and a decision greater than 0")
    x, y = to_x(data.size, scale), to_x(data.signal, signal_scale)
    exact = ~(data.below | data.above)
    if (missing := _no_line(x, y, exact)) is not None:
        return missing
    middle, base, unit = float(x.mean()), float(y[exact].mean()), float(y[exact].std())
    design = np.column_stack([(y - base) / unit, -np.ones_like(x), middle - x])
    of, best = maximise(data, np.zeros_like(x), design, 1.0)
    tau = unit / of[0]
    slope = of[2] * tau
    intercept = base + of[1] * tau - slope * middle
    if slope <= 0:
        return NoCurve("no rise", f"signals do not grow with size (slope {slope:.3g}): no a50, no a90")
    best -= float(data.weight @ exact) * np.log(unit)
    covariance = np.linalg.inv(_information(data, x, y, intercept, slope, tau))
    return SignalCurve(
        data, scale, signal_scale, decision, float(intercept), float(slope), float(tau), covariance, float(best)
    )


def _no_line(x: np.ndarray, y: np.ndarray, exact: np.ndarray) -> NoCurve | None:
    n, sizes = int(exact.sum()), np.unique(x[exact]).size
    if n < FEWEST_TARGETS or sizes < FEWEST_SIZES:
        why = f"{n} signals between the limits at {sizes} different sizes; at least {FEWEST_TARGETS} at {FEWEST_SIZES}"
        return NoCurve("too few sizes", f"{why} are needed")
    design = np.column_stack([np.ones(n), x[exact] - x[exact].mean()])
    left = y[exact] - design @ np.linalg.lstsq(design, y[exact], rcond=None)[0]
    if np.std(left) <= 1e-12 * (np.abs(y[exact]).max() + 1):
        return NoCurve("no spread", "the signals lie on the line exactly: without scatter there is no curve")
    return None


def maximise(
    data: Signals, offset: Float[np.ndarray, "n"], design: Float[np.ndarray, "n k"], precision: float
) -> tuple[Float[np.ndarray, "k"], float]:
    """The likeliest coefficients of r = offset + design @ c, where r is how far a signal lies over the line in taus.

    The first coefficient is 1/tau, the others the line's over tau: so written the likelihood of a censored line has one
    summit (Olsen 1978), and Newton's method with halved steps finds it. The first start is `precision`.
    """
    coefficients = np.zeros(design.shape[1])
    coefficients[0] = precision
    best = _value(data, offset, design, coefficients)
    for _ in range(MOST_STEPS):
        gradient, curvature = _derivatives(data, offset, design, coefficients)
        step = np.linalg.lstsq(curvature, gradient, rcond=None)[0]
        for _ in range(60):
            value = _value(data, offset, design, coefficients + step)
            if value >= best:
                break
            step = step / 2
        else:
            break
        coefficients, gain, best = coefficients + step, value - best, value
        if gain <= SETTLED * (1 + abs(best)):
            break
    return coefficients, best


def _value(data: Signals, offset: np.ndarray, design: np.ndarray, of: np.ndarray) -> float:
    if of[0] <= 0:
        return -np.inf
    over = offset + design @ of
    exact = np.log(of[0]) - LOG_SQRT_2PI - 0.5 * over**2
    return float(data.weight @ np.where(data.below, log_ndtr(over), np.where(data.above, log_ndtr(-over), exact)))


def _derivatives(
    data: Signals, offset: np.ndarray, design: np.ndarray, of: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Slope of the log-likelihood, and its curvature downward."""
    over = offset + design @ of
    side = np.where(data.below, over, -over)
    ratio = np.exp(-0.5 * side**2 - LOG_SQRT_2PI - log_ndtr(side))  # of density to tail
    exact = ~(data.below | data.above)
    by_over = np.where(exact, -over, np.where(data.below, ratio, -ratio))
    bend = np.where(exact, 1.0, ratio * (side + ratio))
    weight = float(data.weight @ exact)
    gradient = design.T @ (data.weight * by_over)
    curvature = design.T @ ((data.weight * bend)[:, None] * design)
    gradient[0] += weight / of[0]
    curvature[0, 0] += weight / of[0] ** 2
    return gradient, curvature


def _information(
    data: Signals, x: np.ndarray, y: np.ndarray, intercept: float, slope: float, tau: float
) -> Float[np.ndarray, "3 3"]:
    """The observed information of intercept, slope and tau, at their likeliest values."""
    design = np.column_stack([y, -np.ones_like(x), -x])
    of = np.array([1.0, intercept, slope]) / tau
    curvature = _derivatives(data, np.zeros_like(x), design, of)[1]
    # (1, intercept, slope) / tau by intercept, slope, tau: at the summit the information moves over by this alone
    jacobian = np.array([[0, 0, -1 / tau], [1, 0, -intercept / tau], [0, 1, -slope / tau]]) / tau
    return jacobian.T @ curvature @ jacobian

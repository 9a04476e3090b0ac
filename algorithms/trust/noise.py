"""What signals a place without a target gives, and how often it would be called (MIL-HDBK-1823A, noise analysis)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize
from scipy.stats import expon, lognorm, norm, weibull_min

FEWEST = 3
LAWS: dict[str, Callable] = {
    "normal": lambda of: norm(of[0], np.exp(of[1])),
    "lognormal": lambda of: lognorm(np.exp(of[1]), scale=np.exp(of[0])),
    "exponential": lambda of: expon(scale=np.exp(of[0])),
    "weibull": lambda of: weibull_min(np.exp(of[1]), scale=np.exp(of[0])),
}


class Noise(NamedTuple):
    """A law of the noise: its mean and standard deviation (of the logarithm for a lognormal), and its likelihood."""

    law: str
    n: int
    mean: float
    standard_deviation: float
    log_likelihood: float
    parameters: tuple[float, ...]

    def quantile(self, share: float) -> float:
        """The signal that this share of the noise stays below."""
        return float(LAWS[self.law](self.parameters).ppf(share))

    def call_probability(self, decision: float) -> float:
        """How often noise alone exceeds the decision: the probability of a false positive."""
        return float(LAWS[self.law](self.parameters).sf(decision))


def fit_noise(signal: Float[np.ndarray, "n"], below: Bool[np.ndarray, "n"], law: str = "normal") -> Noise:
    """The likeliest noise of a law, of signals of which some are known only to be at most the stated value.

    Raises:
        ValueError: for fewer than three signals, all censored or all the same, or not positive where the law asks it.
    """
    if signal.size < FEWEST or not np.isfinite(signal).all():
        raise ValueError(f"{signal.size} noise signals; at least {FEWEST}, all finite, are needed")
    if law != "normal" and np.any(signal <= 0):
        raise ValueError(f"{law} noise needs signals greater than 0")
    seen = signal[~below]
    if seen.size < 2 or np.ptp(seen) == 0:
        raise ValueError("the noise signals do not differ: no law can be fitted")
    on = np.log(seen) if law == "lognormal" else seen
    if law == "normal" or law == "lognormal":
        start = [float(on.mean()), float(np.log(on.std()))]
    else:
        start = [float(np.log(seen.mean())), 0.0][: 1 if law == "exponential" else 2]

    def down(of: np.ndarray) -> float:
        at = LAWS[law](of)
        return -float(np.sum(np.where(below, at.logcdf(signal), at.logpdf(signal))))

    options = {"xatol": 1e-10, "fatol": 1e-12, "maxiter": 4000}
    best = minimize(down, start, method="Nelder-Mead", options=options)
    of = tuple(float(value) for value in best.x)
    frozen = LAWS[law](of)
    mean, spread = (of[0], float(np.exp(of[1]))) if law == "lognormal" else (float(frozen.mean()), float(frozen.std()))
    return Noise(law, signal.size, mean, spread, -float(best.fun), of)

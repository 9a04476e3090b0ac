"""Whether signals keep to what a POD from them assumes: a straight line, one spread, normal scatter."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, shapiro

from algorithms.trust.curve import to_x
from algorithms.trust.signal_response import SignalCurve, maximise

DOUBTFUL = 0.05
FEWEST = 8


class SignalChecks(NamedTuple):
    """How likely data this far from each assumption are where it holds (p values)."""

    straight: float
    one_spread: float
    normal: float

    def doubts(self) -> list[str]:
        """What the data speak against, in words."""
        said = {
            "straight": "the line bends",
            "one_spread": "the scatter changes with size",
            "normal": "the scatter is not normal",
        }
        return [
            f"{words} (p {getattr(self, name):.2g}): try another scale of size or signal, or fewer sizes"
            for name, words in said.items()
            if getattr(self, name) < DOUBTFUL
        ]


def check_signals(curve: SignalCurve) -> SignalChecks | None:
    """The three assumptions that MIL-HDBK-1823A and ASTM E3023 ask to be looked at, as tests; None of too few signals.

    Straight: a quadratic term's likelihood ratio, censored signals included. One spread: Koenker's test, and normal:
    Shapiro and Wilk's, of the residuals of signals between the limits.
    """
    data = curve.data
    exact = ~(data.below | data.above)
    if exact.sum() < FEWEST:
        return None
    x, y = to_x(data.size, curve.scale), to_x(data.signal, curve.signal_scale)
    unit = (x - x.mean()) / x.std()
    scaled = (y - curve.intercept - curve.slope * x) / curve.tau  # the line as it is, plus more of each term
    design = np.column_stack([scaled, -np.ones_like(x), -unit, -(unit**2)])
    straight = maximise(data, np.zeros_like(x), design[:, :3], 1.0)[1]
    bent = maximise(data, np.zeros_like(x), design, 1.0)[1]
    squares, size = scaled[exact] ** 2, np.column_stack([np.ones(int(exact.sum())), unit[exact]])
    fitted = size @ np.linalg.lstsq(size, squares, rcond=None)[0]
    explained = np.var(fitted) / np.var(squares)
    return SignalChecks(
        float(chi2.sf(max(2 * (bent - straight), 0.0), 1)),
        float(chi2.sf(exact.sum() * explained, 1)),
        float(shapiro(scaled[exact]).pvalue),
    )

"""What is said of a POD curve: a50, a90 and a90/95, each bound with its convention."""

from __future__ import annotations

from dataclasses import replace
from math import exp, sqrt
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from algorithms.trust.curve import HANDBOOK_DROP, Curve, one_sided_drop, size_at, size_bound
from algorithms.trust.noise import Noise
from algorithms.trust.signal_response import SignalCurve

POD, CONFIDENCE = 0.9, 0.95


class Bound(NamedTuple):
    """An upper bound of the size at which a curve reaches a POD, and how it was made; None where there is none."""

    convention: str
    size: float | None


class Decision(NamedTuple):
    """A decision, the size it finds with 90 %, that size's one-sided 95 % bound, and how often it calls noise."""

    decision: float
    a90: float | None
    a90_95: float | None
    false_call_probability: float


def a90_95(curve: Curve) -> tuple[Bound, ...]:
    """The bound of a90 by the one-sided 95 % likelihood-ratio region, and by the handbook's (two-sided 95 %)."""
    drop = one_sided_drop(CONFIDENCE)
    return (
        Bound(f"likelihood ratio {drop:.3f}, one-sided 95 %", size_bound(curve, POD, drop)),
        Bound(
            f"likelihood ratio {HANDBOOK_DROP:g}, one-sided 97.5 %, as MIL-HDBK-1823A",
            size_bound(curve, POD, HANDBOOK_DROP),
        ),
    )


def lower_curve(curve: Curve, pods: list[float], drop: float) -> list[tuple[float, float]]:
    """The lower bound of the curve, one-sided: at each size the POD that the region still allows (size, POD).

    Where a POD has no bound the list ends.
    """
    found = []
    for pod in pods:
        size = size_bound(curve, pod, drop)
        if size is None:
            break
        found.append((size, pod))
    return found


def over_decisions(curve: SignalCurve, noise: Noise, count: int = 25) -> list[Decision]:
    """What each decision would give, from the middle of the noise to beyond its 99.9 % (MIL-HDBK-1823A's trade-off)."""
    ends = min(noise.quantile(0.5), curve.decision), max(1.2 * noise.quantile(0.999), 1.1 * curve.decision)
    found = []
    for decision in np.linspace(*ends, count):
        moved = replace(curve, decision=float(decision))  # the line does not depend on it
        bound = size_bound(moved, POD, one_sided_drop(CONFIDENCE))
        found.append(Decision(float(decision), size_at(moved, POD), bound, noise.call_probability(float(decision))))
    return found


def handbook_signal_bound(curve: SignalCurve) -> float:
    """a90/95 of signals as MIL-HDBK-1823A prints it (Fig. G-6): Wald's bound of log a90, z = 1.645.

    Only to reproduce the handbook: it is a normal approximation, and comes out smaller than the likelihood's.
    """
    direction = np.array([1.0, norm.ppf(POD)])
    error = sqrt(float(direction @ curve.place_covariance @ direction))
    x = curve.place(POD) + float(norm.ppf(CONFIDENCE)) * error
    return exp(x) if curve.scale == "log" else x

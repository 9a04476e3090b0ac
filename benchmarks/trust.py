"""How often stated bounds of POD hold, over many made-up inspections: a table of shares with exact intervals.

    python benchmarks/trust.py --runs 400 --seed 0

A run draws targets of random sizes from a known curve, fits, and asks whether a90/95 is at least the true a90. Right is
95 % (97.5 % for the handbook's 3.841). Wald's bound of log a90 is what programs with the delta method print.
"""

from __future__ import annotations

import argparse
from collections import Counter
from math import exp, inf, log

import numpy as np
from scipy.stats import norm

from algorithms.trust.curve import HANDBOOK_DROP, NoCurve, one_sided_drop, size_bound
from algorithms.trust.detection import handbook_signal_bound
from algorithms.trust.exact_bounds import run_of_hits_bound, share_of
from algorithms.trust.floor_ceiling import fit_floor_ceiling
from algorithms.trust.hit_miss import HitMissCurve, fit_hit_miss
from algorithms.trust.links import LINKS
from algorithms.trust.repeats import dispersed_drop, dispersion, pooled
from algorithms.trust.signal_response import Signals, fit_signals

MU, SIGMA = log(4.0), 0.3
SIZES = (0.5, 12.0)
DROP = one_sided_drop(0.95)


def wald_bound(curve: HitMissCurve) -> float:
    """Wald's bound of log a90 with the delta method, for comparison only."""
    to_x = curve.place(0.9)
    direction = np.array([1.0, to_x]) / -curve.slope
    return exp(to_x + norm.ppf(0.95) * float(np.sqrt(direction @ curve.covariance @ direction)))


def hit_miss(rng: np.random.Generator, targets: int) -> dict[str, tuple[float | None, float]]:
    """One inspection with one look a target: bounds by name, each with the true a90."""
    size = rng.uniform(*SIZES, targets)
    hit = rng.random(targets) < LINKS["logit"].cdf((np.log(size) - MU) / SIGMA)
    truth = exp(MU + SIGMA * float(LINKS["logit"].quantile(0.9)))
    each = np.arange(targets)
    free = {f"hit/miss, {targets} targets, no curve (29 in a row)": (run_of_hits_bound(size, hit), truth)}
    curve = fit_hit_miss(pooled(size, hit, each))
    if isinstance(curve, NoCurve):
        return free
    name = f"hit/miss, {targets} targets"
    return free | {
        f"{name}, likelihood ratio 2.706": (size_bound(curve, 0.9, DROP), truth),
        f"{name}, likelihood ratio 3.841": (size_bound(curve, 0.9, HANDBOOK_DROP), truth),
        f"{name}, Wald (delta method)": (wald_bound(curve), truth),
    }


def floor_ceiling(rng: np.random.Generator, targets: int) -> dict[str, tuple[float | None, float]]:
    """One inspection whose curve starts at 0.05 and ends at 0.97."""
    size = rng.uniform(*SIZES, targets)
    hit = rng.random(targets) < 0.05 + 0.92 * LINKS["logit"].cdf((np.log(size) - MU) / SIGMA)
    truth = exp(MU + SIGMA * float(LINKS["logit"].quantile(0.85 / 0.92)))
    data = pooled(size, hit, np.arange(targets))
    both, plain = fit_floor_ceiling(data), fit_hit_miss(data)
    out: dict[str, tuple[float | None, float]] = {}
    if not isinstance(both, NoCurve):
        out[f"floor 0.05, ceiling 0.97, {targets} targets, both fitted"] = (size_bound(both, 0.9, DROP), truth)
    if not isinstance(plain, NoCurve):
        out[f"floor 0.05, ceiling 0.97, {targets} targets, neither fitted"] = (size_bound(plain, 0.9, DROP), truth)
    return out


def repeated(rng: np.random.Generator, targets: int, between: float) -> dict[str, tuple[float | None, float]]:
    """Three looks a target; targets of one size differ by a normal shift of so many sigmas of a probit curve."""
    size = rng.uniform(*SIZES, targets)
    shift = between * rng.standard_normal(targets)
    pod = norm.cdf((np.log(size) - MU) / SIGMA + shift)
    hit = (rng.random((3, targets)) < pod).T.ravel()
    truth = exp(MU + SIGMA * np.sqrt(1 + between**2) * norm.ppf(0.9))  # of a target and look drawn at random
    each, sizes = np.repeat(np.arange(targets), 3), np.repeat(size, 3)
    once = fit_hit_miss(pooled(sizes, hit, each), "probit")
    free = fit_hit_miss(pooled(sizes, hit, each, "independent"), "probit")
    if isinstance(once, NoCurve) or isinstance(free, NoCurve):
        return {}
    name = f"{targets} targets x 3 looks, targets differ by {between:g} sigma"
    spread = dispersion(free, sizes, hit, each)
    measured = size_bound(free, 0.9, dispersed_drop(0.95, spread)) if spread else None
    return {
        f"{name}, each target once": (size_bound(once, 0.9, DROP), truth),
        f"{name}, dispersion measured": (measured, truth),
        f"{name}, looks as if independent": (size_bound(free, 0.9, DROP), truth),
    }


def signals(rng: np.random.Generator, targets: int) -> dict[str, tuple[float | None, float]]:
    """One inspection by signals, those under 2 known only to be so."""
    size = rng.uniform(*SIZES, targets)
    signal = 1 + 2 * np.log(size) + 0.8 * rng.standard_normal(targets)
    below = signal <= 2
    data = Signals(size, np.maximum(signal, 2), below, np.zeros(targets, bool), np.ones(targets))
    curve = fit_signals(data, 3.0)
    if isinstance(curve, NoCurve):
        return {}
    truth = exp(1 + 0.4 * norm.ppf(0.9))
    name = f"signals, {targets} targets"
    return {
        f"{name}, likelihood ratio 2.706": (size_bound(curve, 0.9, DROP), truth),
        f"{name}, likelihood ratio 3.841": (size_bound(curve, 0.9, HANDBOOK_DROP), truth),
        f"{name}, Wald (as the handbook prints)": (handbook_signal_bound(curve), truth),
    }


def main() -> None:
    """Print the table."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--runs", type=int, default=400)
    ask.add_argument("--seed", type=int, default=0)
    given = ask.parse_args()
    held: Counter[str] = Counter()
    unbounded: Counter[str] = Counter()
    runs: Counter[str] = Counter()
    for rng in np.random.default_rng(given.seed).spawn(given.runs):
        made = hit_miss(rng, 60) | hit_miss(rng, 300) | floor_ceiling(rng, 500) | signals(rng, 40) | signals(rng, 200)
        made |= repeated(rng, 150, 0.0) | repeated(rng, 150, 1.0) | repeated(rng, 150, 3.0)
        for name, (bound, truth) in made.items():
            runs[name] += 1
            unbounded[name] += bound is None
            held[name] += (inf if bound is None else bound) >= truth
    width = max(map(len, runs))
    print(f"{'bound':<{width}}  runs  no bound  holds the true a90 [exact 95 %]")
    for name in sorted(runs):
        share = share_of(held[name], runs[name])
        ends = f"[{100 * share.low:.1f}, {100 * share.high:.1f}]"
        print(f"{name:<{width}}  {share.n:4d}  {unbounded[name]:8d}  {100 * share.share:5.1f} % {ends}")


if __name__ == "__main__":
    main()

"""Targets looked at more than once: what a repeated look is worth."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import f as f_law

from algorithms.trust.curve import Curve, to_x
from algorithms.trust.hit_miss import HitMiss

Rule = Literal["once", "independent"]


class Dispersion(NamedTuple):
    """How much more hits vary from target to target than independent looks would: 1 if as much, the looks a target
    if repeats only repeat. `degrees_of_freedom` are those of its estimate.
    """  # noqa: D205

    factor: float
    degrees_of_freedom: int


def look_weights(target: Int[np.ndarray, "n"], rule: Rule = "once") -> Float[np.ndarray, "n"]:
    """What each look counts: `once` lets a target count once, however often it was looked at; `independent` all looks.

    With as many looks at each target, `once` is MIL-HDBK-1823A's rule (Appendix G, repeated measures: the deviance is
    divided by the number of looks), and it works as well where the numbers differ. The truth lies between the two.
    """
    if rule == "independent":
        return np.ones(target.size)
    _, which, looks = np.unique(target, return_inverse=True, return_counts=True)
    return 1.0 / looks[which]


def dispersion(
    curve: Curve, size: Float[np.ndarray, "n"], hit: Bool[np.ndarray, "n"], target: Int[np.ndarray, "n"]
) -> Dispersion | None:
    """Pearson's dispersion of the hits per target about a curve fitted to all looks (McCullagh and Nelder, 4.5).

    None with no repeats, or with too few targets. Below 1 it is taken as 1, above the looks a target as those.
    """
    _, first, which, looks = np.unique(target, return_index=True, return_inverse=True, return_counts=True)
    free = looks.size - 2
    if looks.max(initial=0) < 2 or free < 1:
        return None
    hits = np.bincount(which, hit.astype(float))
    pod = np.clip(curve.pod(to_x(size[first], curve.scale)), 1e-6, 1 - 1e-6)
    factor = float(np.sum((hits - looks * pod) ** 2 / (looks * pod * (1 - pod))) / free)
    return Dispersion(float(np.clip(factor, 1.0, looks.max())), free)


def dispersed_drop(confidence: float, spread: Dispersion) -> float:
    """The one-sided drop where looks count as independent and the dispersion is measured: an F law's."""
    return float(spread.factor * f_law.ppf(2 * confidence - 1, 1, spread.degrees_of_freedom))


def all_hit(
    size: Float[np.ndarray, "n"], hit: Bool[np.ndarray, "n"], target: Int[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "targets"], Bool[np.ndarray, "targets"]]:
    """Each target's size, and whether every look at it was a hit."""
    _, first, which = np.unique(target, return_index=True, return_inverse=True)
    return size[first], np.bincount(which, ~hit) == 0


def pooled(
    size: Float[np.ndarray, "n"], hit: Bool[np.ndarray, "n"], target: Int[np.ndarray, "n"], rule: Rule = "once"
) -> HitMiss:
    """All looks as data for a curve; looks at size 0 are looks at blank places, and say what calls them."""
    weight = look_weights(target, rule)
    real = size > 0
    blank, called = float(weight[~real].sum()), float(weight[~real & hit].sum())
    return HitMiss(size[real], hit[real], weight[real], blank, called)

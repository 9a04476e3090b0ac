"""Probability of detection from a CSV of looks: hits and misses, or signals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from algorithms.trust.curve import SCALES, NoCurve, size_at, size_bound
from algorithms.trust.detection import CONFIDENCE, POD, Bound, a90_95, handbook_signal_bound, over_decisions
from algorithms.trust.exact_bounds import hits_needed, run_of_hits_bound, share_of, share_upper
from algorithms.trust.floor_ceiling import FloorCeilingCurve, fit_floor_ceiling
from algorithms.trust.hit_miss import HitMissCurve, fit_hit_miss
from algorithms.trust.links import LINKS
from algorithms.trust.noise import fit_noise
from algorithms.trust.repeats import all_hit, dispersed_drop, dispersion, look_weights, pooled
from algorithms.trust.signal_checks import check_signals
from algorithms.trust.signal_response import SignalCurve, Signals, fit_signals
from scenarios.document import BadInput
from scenarios.trust.columns import read_table
from scenarios.trust.looks import Looks, PodQuestion, Row, read_looks

FEWEST_HIT_MISS, FEWEST_SIGNALS = 60, 40
FEWEST_ON_THE_RISE = 10


class Pod(NamedTuple):
    """What the looks say: figures for JSON, the curve or why there is none, and the other curves' rows."""

    figures: Row
    curve: Any
    looks: Looks
    others: list[Row]
    notes: list[str]


def pod_of(file: Path, question: PodQuestion) -> Pod:
    """Read the looks and fit.

    Raises:
        BadInput: for a file, column or cell that cannot be used, by file and line.
    """
    looks = read_looks(read_table(file), question)
    return _of_hits(looks, question) if question.hit else _of_signals(looks, question, file)


# ---- hits and misses


def _fit(looks: Looks, question: PodQuestion) -> HitMissCurve | FloorCeilingCurve | NoCurve:
    data = pooled(looks.size, looks.value == 1, looks.target)
    if question.floor or question.ceiling:
        return fit_floor_ceiling(data, question.link, question.size_scale, question.floor, question.ceiling)
    return fit_hit_miss(data, question.link, question.size_scale)


def _of_hits(looks: Looks, question: PodQuestion) -> Pod:
    hit, real = looks.value == 1, looks.size > 0
    curve = _fit(looks, question)
    figures: Row = {"kind": "hit/miss", **_counts(looks), "hits": int(hit[real].sum()), "link": question.link}
    figures |= {"size_scale": question.size_scale} | _shape(curve)
    bounds = [] if isinstance(curve, NoCurve) else [*a90_95(curve), *_repeat_bounds(looks, question)]
    size, whole = all_hit(looks.size[real], hit[real], looks.target[real])
    needed = hits_needed(POD, CONFIDENCE)
    words = f"no curve: {needed} targets in a row above the largest miss, POD only not falling with size"
    bounds.append(Bound(words, run_of_hits_bound(size, whole)))
    figures["a90_95"] = [bound._asdict() for bound in bounds]
    if (~real).any():
        figures["false_calls"] = _false_calls(int(hit[~real].sum()), int((~real).sum()))
    others = [_other_row(looks, question, link, scale) for link in LINKS for scale in SCALES]
    return Pod(figures, curve, looks, others, _notes(curve, looks, figures, FEWEST_HIT_MISS))


def _counts(looks: Looks) -> Row:
    real = looks.size > 0
    repeats = np.unique(looks.target[real], return_counts=True)[1] if real.any() else np.zeros(1, dtype=int)
    return {
        "looks": int(real.sum()),
        "targets": int(repeats.size) if real.any() else 0,
        "looks_per_target": [int(repeats.min()), int(repeats.max())],
        "sizes": [float(looks.size[real].min()), float(looks.size[real].max())] if real.any() else None,
    }


def _shape(curve: Any) -> Row:
    """What a curve is, or why there is none."""
    if isinstance(curve, NoCurve):
        return {"outcome": curve.outcome, "reason": curve.reason, "a50": None, "a90": None}
    out: Row = {"outcome": "curve", "mu": curve.mu, "sigma": curve.sigma}
    if isinstance(curve, HitMissCurve):
        out |= {"intercept": curve.intercept, "slope": curve.slope, "deviance": curve.deviance}
    elif isinstance(curve, FloorCeilingCurve):
        out |= {"floor": curve.floor, "ceiling": curve.ceiling, "deviance": curve.deviance}
    else:
        out |= {"intercept": curve.intercept, "slope": curve.slope, "tau": curve.tau}
        out["mu_sigma_covariance"] = curve.place_covariance.tolist()
    if not isinstance(curve, FloorCeilingCurve):
        out["standard_errors"] = np.sqrt(np.diag(curve.covariance)).tolist()
        out["covariance"] = curve.covariance.tolist()
    return out | {"a50": size_at(curve, 0.5), "a90": size_at(curve, POD)}


def _repeat_bounds(looks: Looks, question: PodQuestion) -> list[Bound]:
    """Where targets were looked at repeatedly: the bounds if looks were independent, and as they were seen to be."""
    real = looks.size > 0
    size, hit, target = looks.size[real], looks.value[real] == 1, looks.target[real]
    curve = fit_hit_miss(pooled(size, hit, target, "independent"), question.link, question.size_scale)
    if isinstance(curve, NoCurve) or question.floor or question.ceiling:
        return []
    spread = dispersion(curve, size, hit, target)
    if spread is None:
        return []
    free = a90_95(curve)[0]
    measured = size_bound(curve, POD, dispersed_drop(CONFIDENCE, spread))
    return [
        Bound(f"if repeats were independent: {free.convention}", free.size),
        Bound(f"as repeats were seen to agree: dispersion {spread.factor:.2f}, one-sided 95 %", measured),
    ]


def _other_row(looks: Looks, question: PodQuestion, link: str, scale: str) -> Row:
    """Another link or scale on the same looks, for comparison: the smaller the deviance, the likelier."""
    asked = question.model_copy(update={"link": link, "size_scale": scale, "floor": False, "ceiling": False})
    curve = _fit(looks, asked)
    row: Row = {"model": f"{link}, {scale} size", "outcome": "curve"}
    if isinstance(curve, NoCurve):
        return row | {"outcome": curve.outcome}
    handbook = a90_95(curve)
    return row | {
        "deviance": -2 * curve.log_likelihood,
        "a50": size_at(curve, 0.5),
        "a90": size_at(curve, POD),
        "a90_95": handbook[0].size,
        "a90_95_handbook": handbook[1].size,
    }


def _false_calls(called: int, blanks: int) -> Row:
    """How often nothing was called, with the handbook's upper bounds (Table G-I)."""
    return {
        **share_of(called, blanks)._asdict(),
        "upper": {f"{100 * c:g} %": share_upper(called, blanks, c) for c in (0.5, 0.9, 0.95)},
    }


# ---- signals


def _of_signals(looks: Looks, question: PodQuestion, file: Path) -> Pod:
    decision = float(question.decision or 0.0)
    noise = looks.size <= (question.noise_to or 0.0)
    real = looks.size > 0
    value, below, above = _censored(looks.value, question)
    weight = look_weights(looks.target)
    data = Signals(looks.size[real], value[real], below[real], above[real], weight[real])
    try:
        curve = fit_signals(data, decision, question.size_scale, question.signal_scale)
    except ValueError as error:
        raise BadInput([f"{file}: {', '.join(question.signal)}: {error}"]) from error
    figures: Row = {"kind": "signal", **_counts(looks), "decision": decision, "size_scale": question.size_scale}
    figures |= {"signal_scale": question.signal_scale, "at_most_left": int(below[real].sum())}
    figures |= {"at_least_right": int(above[real].sum())} | _shape(curve)
    bounds: list[Bound] = []
    if isinstance(curve, SignalCurve):
        bounds = list(a90_95(curve))
        words = (
            "Wald bound of log a90, z 1.645: MIL-HDBK-1823A's own print for signals, an approximation, not used here"
        )
        bounds.append(Bound(words, handbook_signal_bound(curve)))
        bounds += _free_signal_bounds(data, curve)
    figures["a90_95"] = [bound._asdict() for bound in bounds]
    notes = _notes(curve, looks, figures, FEWEST_SIGNALS)
    if isinstance(curve, SignalCurve) and (checks := check_signals(curve)):
        figures["checks"] = checks._asdict()
        notes += checks.doubts()
    if noise.any():
        figures |= _noise(value[noise], below[noise], curve, question, notes)
    others = [_other_signal_row(data, decision, scale, other) for scale in SCALES for other in SCALES]
    return Pod(figures, curve, looks, others, notes)


def _free_signal_bounds(data: Signals, curve: SignalCurve) -> list[Bound]:
    """Where targets were looked at repeatedly: the same bounds if looks were independent."""
    if np.all(data.weight == 1):
        return []
    free = fit_signals(replace(data, weight=np.ones_like(data.weight)), curve.decision, curve.scale, curve.signal_scale)
    if isinstance(free, NoCurve):
        return []
    bounds = [*a90_95(free), Bound("Wald bound of log a90, z 1.645", handbook_signal_bound(free))]
    return [Bound(f"if repeats were independent: {bound.convention}", bound.size) for bound in bounds]


def _censored(value: np.ndarray, question: PodQuestion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Signals put to their limits, and which were."""
    low = -np.inf if question.left is None else question.left
    high = np.inf if question.right is None else question.right
    return np.clip(value, low, high), value <= low, value >= high


def _noise(
    signal: np.ndarray, below: np.ndarray, curve: SignalCurve | NoCurve, question: PodQuestion, notes: list[str]
) -> Row:
    """The law of the noise, its quantiles, how often noise alone is a hit, and what other decisions would give."""
    law = "lognormal" if question.signal_scale == "log" else "normal"
    try:
        noise = fit_noise(signal, below, law)
    except ValueError as error:
        notes.append(f"no law of the noise: {error}")
        return {}
    decision = float(question.decision or 0.0)
    called = int(np.sum(signal > decision))
    said = {
        "law": law,
        "n": noise.n,
        "mean": noise.mean,
        "standard_deviation": noise.standard_deviation,
        "quantiles": {f"{100 * share:g} %": noise.quantile(share) for share in (0.9, 0.95, 0.99, 0.999)},
        "false_call_probability": noise.call_probability(decision),
        "called": _false_calls(called, signal.size),
    }
    if isinstance(curve, NoCurve):
        return {"noise": said}
    return {"noise": said, "decisions": [row._asdict() for row in over_decisions(curve, noise)]}


def _other_signal_row(data: Signals, decision: float, scale: str, signal_scale: str) -> Row:
    row: Row = {"model": f"{signal_scale} signal, {scale} size", "outcome": "curve"}
    try:
        curve = fit_signals(data, decision, scale, signal_scale)
    except ValueError:
        return row | {"outcome": "signals or decision not greater than 0"}
    if isinstance(curve, NoCurve):
        return row | {"outcome": curve.outcome}
    checks, bounds = check_signals(curve), a90_95(curve)
    row |= {"a50": size_at(curve, 0.5), "a90": size_at(curve, POD), "a90_95": bounds[0].size}
    return row | {"a90_95_handbook": bounds[1].size} | (checks._asdict() if checks else {})


# ---- what a reader should know


def _notes(curve: Any, looks: Looks, figures: Row, fewest: int) -> list[str]:
    """What is weak about these figures."""
    notes = []
    few, most = figures["looks_per_target"]
    if figures["targets"] < fewest:
        notes.append(f"{figures['targets']} targets; MIL-HDBK-1823A asks for at least {fewest}")
    if most > 1:
        each = f"{most} looks each" if few == most else f"{few} to {most} looks each"
        notes.append(f"{each}: each target counts once, however often it was looked at (the handbook's rule)")
    if isinstance(curve, NoCurve):
        return notes
    largest = figures["sizes"][1]
    bounds = [bound["size"] for bound in figures["a90_95"][:2]]
    if figures["a90"] is None:
        notes.append("the curve never reaches a POD of 0.9: there is no a90")
    elif any(size is None for size in bounds):
        notes.append("the data do not bound a90: curves that never reach a POD of 0.9 are inside the region")
    elif max(bounds) > largest:
        notes.append(f"a90/95 lies beyond the largest target, {largest:g}: it is extrapolated")
    if "hits" in figures:
        sizes = looks.size[looks.size > 0]
        pod = curve.pod(np.log(sizes) if curve.scale == "log" else sizes)
        rising = np.unique(looks.target[looks.size > 0][(pod > 0.1) & (pod < 0.9)]).size
        if rising < FEWEST_ON_THE_RISE:
            notes.append(f"{rising} targets lie where the POD is between 0.1 and 0.9: the slope rests on few")
    return notes

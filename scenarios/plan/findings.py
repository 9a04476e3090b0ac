"""What a plan's scans say: detection and tolerances by kind, and every limit's verdict."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from algorithms.trust.curve import NoCurve, size_at
from algorithms.trust.detection import a90_95
from algorithms.trust.exact_bounds import Rate, Share, rate_of, run_of_hits_bound, share_of
from algorithms.trust.hit_miss import fit_hit_miss
from algorithms.trust.repeats import pooled
from scenarios.document import BadInput
from scenarios.fidelity.agreed import PICTURE, trusts
from scenarios.plan.plan_file import SCORES, Limits, Plan
from scenarios.study.conduct import opened
from scenarios.study.gather import Mean, mean_of
from scenarios.study.ledger import DONE, STATES
from twin.features import FAMILIES

Decision = Literal["go", "no go", "open"]
SIZED = 6
SAME_MM = 1e-6


@dataclass(frozen=True)
class Looks:
    """Every defect of a plan's scans: its kind, its true size, and the measured one (NaN where it was missed)."""

    kind: np.ndarray
    depth_pct: Float[np.ndarray, "n"]
    true_mm: Float[np.ndarray, "n 3"]
    measured_mm: Float[np.ndarray, "n 3"]
    scan: np.ndarray

    @property
    def hit(self) -> np.ndarray:
        """Which were found."""
        return np.isfinite(self.measured_mm[:, 2])

    def errors(self, wall_mm: float) -> dict[str, Float[np.ndarray, "found"]]:
        """Errors of the found ones: length and width in mm, depth in percent of the wall."""
        error = (self.measured_mm - self.true_mm)[self.hit]
        return {"length_mm": error[:, 0], "width_mm": error[:, 1], "depth_pct": 100 * error[:, 2] / wall_mm}

    def of(self, kind: str) -> Looks:
        """Those of one kind."""
        own = self.kind == kind
        return Looks(self.kind[own], self.depth_pct[own], self.true_mm[own], self.measured_mm[own], self.scan[own])


@dataclass(frozen=True)
class Scans:
    """A study of the plan's scans: its looks, and the figures of every run that is done."""

    looks: Looks
    figures: dict[str, Float[np.ndarray, "runs"]]
    counts: dict[str, int]
    seconds: float
    """Of a run, median."""


@dataclass(frozen=True)
class Detection:
    """One kind's detection over depth, in percent of the wall."""

    kind: str
    found: Share
    a50_pct: float | None
    a90_pct: float | None
    a90_95_pct: float | None
    convention: str
    shown_in: str


@dataclass(frozen=True)
class Tolerance:
    """How far off a share of all is at most, with the confidence; None where there are too few to say."""

    what: str
    n: int
    bias: float
    share_within: float | None
    promised: float | None
    shown_in: str
    """The fidelity whose scans show it: that of the plan's scans where it agrees with pictures, else pictures."""


@dataclass(frozen=True)
class Kept:
    """One limit, what was found of it, and whether it is shown to be kept."""

    limit: str
    asked: float
    found: float | None
    bound: float | None
    decision: Decision


def read_scans(folder: Path, plan: Plan) -> Scans:
    """What the ledger of a plan's study holds.

    Raises:
        BadInput: when no run is done.
    """
    rows: list[list[float]] = []
    kinds, scans, seconds = [], [], []
    with opened(folder) as ledger:
        identity = ledger.about("identity")
        names, paths = identity["record"], identity["paths"]
        figures: dict[str, list[float]] = {name: [] for name in names}
        for number, row in enumerate(ledger.rows(by_key=False)):
            if row.state != STATES[DONE]:
                continue
            for name, value in zip(names, row.figures, strict=True):
                figures[name].append(np.nan if value is None else float(value))
            features = row.values[paths.index("pipe.features")]
            kinds += _kinds_in_order(row.defects, features, plan)
            rows += [sizes if len(sizes) == SIZED else [*sizes[:3], np.nan, np.nan, np.nan] for sizes in row.defects]
            scans += [number] * len(row.defects)
            seconds.append(row.seconds or 0.0)
        counts = ledger.counts()
    if not seconds:
        raise BadInput([f"{folder}: no scan ended well; `pipetwin status {folder}` says why"])
    table = np.array(rows, dtype=float).reshape(-1, SIZED)
    depth_pct = 100 * table[:, 2] / plan.scene.pipe.wall_mm
    looks = Looks(np.array(kinds, dtype=object), depth_pct, table[:, :3], table[:, 3:], np.array(scans))
    return Scans(looks, {k: np.array(v) for k, v in figures.items()}, counts, float(np.median(seconds)))


def _kinds_in_order(defects: list[list[float]], features: list[dict[str, Any]], plan: Plan) -> list[str]:
    """The plan's name of the kind of each true defect of a run, known by its true size."""
    bore = plan.scene.pipe.bore_radius_mm
    known = []
    for number, feature in enumerate(features):
        size = FAMILIES[feature["kind"]].model_validate(feature).size(bore)
        known.append((np.array(size), number))
    names = []
    for sizes in defects:
        apart = [float(np.abs(size - sizes[:3]).max()) for size, _ in known]
        nearest = int(np.argmin(apart))
        if apart[nearest] > SAME_MM:
            raise ValueError(f"a true defect of {sizes[:3]} mm is none of the scan's")
        names.append(_name_of(features[known[nearest][1]], plan))
    return names


def _name_of(feature: dict[str, Any], plan: Plan) -> str:
    """Under which name the plan asks for such a defect."""
    for name, given in plan.file.defects.items():
        fixed = {key: value for key, value in given.items() if not isinstance(value, list | tuple)}
        if all(feature.get(key) == value for key, value in fixed.items()) and all(
            given[key][0] <= feature[key] <= given[key][1] for key in given if key in feature and key not in fixed
        ):
            return name
    raise ValueError(f"{feature} is none of the plan's defects")


def shown_by(plan: Plan, limit: str, scans: Scans, pictures: Scans | None) -> tuple[Scans, str]:
    """Which scans show a figure, and their fidelity: the plan's where it is trusted, else those in pictures if any."""
    if pictures is None or trusts(plan.scene, SCORES[limit]):
        return scans, plan.scene.sensing.fidelity
    return pictures, PICTURE


def detection(looks: Looks, kind: str, shown_in: str = PICTURE) -> Detection:
    """Detection of one kind: a curve where there are hits and misses that one can be fitted to."""
    own = looks.of(kind)
    found = share_of(int(own.hit.sum()), own.hit.size)
    target = np.arange(own.hit.size)
    curve = fit_hit_miss(pooled(own.depth_pct, own.hit, target), "logit", "log")
    if isinstance(curve, NoCurve):
        bound = run_of_hits_bound(own.depth_pct, own.hit)
        run = "the 29 smallest above the largest miss were found" if bound else "too few above the largest miss"
        words = f"no curve ({curve.outcome}): {run}"
        return Detection(kind, found, None, None, bound, words, shown_in)
    best = a90_95(curve)[0]
    return Detection(kind, found, size_at(curve, 0.5), size_at(curve, 0.9), best.size, best.convention, shown_in)


def all_detections(plan: Plan, scans: Scans, pictures: Scans | None) -> list[Detection]:
    """Detection of every kind, by scans in a fidelity that is trusted in it."""
    seen_in, shown_in = shown_by(plan, "a90_95_pct", scans, pictures)
    return [detection(seen_in.looks, kind, shown_in) for kind in plan.file.defects]


def tolerance(
    what: str, errors: Float[np.ndarray, "n"], share: float, confidence: float, shown_in: str = PICTURE
) -> Tolerance:
    """A distribution-free tolerance limit of the size of an error, by its order statistics (Wilks 1941)."""
    from scipy.stats import binom

    errors = errors[np.isfinite(errors)]
    n = errors.size
    if n == 0:
        return Tolerance(what, 0, float("nan"), None, None, shown_in)
    ordered = np.sort(np.abs(errors))
    # the r-th smallest covers the share with the confidence when fewer than r of n lie below the share's quantile
    rank = int(binom.ppf(confidence, n, share)) + 1
    promised = float(ordered[rank - 1]) if rank <= n else None
    return Tolerance(what, n, float(errors.mean()), float(np.quantile(ordered, share)), promised, shown_in)


def kept_limits(
    plan: Plan, scans: Scans, pictures: Scans | None, by_kind: list[Detection], tolerances: list[Tolerance]
) -> list[Kept]:
    """Every limit that was asked, with its verdict."""
    limits: Limits = plan.file.limits
    found = {one.what: one for one in tolerances}
    rows: list[Kept] = []
    if limits.a90_95_pct is not None:
        for one in by_kind:
            rows.append(at_most(f"a90_95_pct of {one.kind}", limits.a90_95_pct, one.a90_pct, one.a90_95_pct))
    for limit in ("depth_error_pct", "length_error_mm", "width_error_mm", "distance_error_pct", "roll_error_deg"):
        asked, own = getattr(limits, limit), found.get(limit)
        if asked is not None and own is not None:
            rows.append(at_most(limit, asked, own.share_within, own.promised))
    if limits.false_calls_per_m is not None:
        rate = false_calls(plan, shown_by(plan, "false_calls_per_m", scans, pictures)[0])
        rows.append(at_most("false_calls_per_m", limits.false_calls_per_m, rate.per_m, rate.upper_per_m))
    if limits.seen_share_pct is not None:
        seen = seen_share_pct(shown_by(plan, "seen_share_pct", scans, pictures)[0])
        low = None if seen.half is None else -(seen.mean - seen.half)
        row = at_most("seen_share_pct", -limits.seen_share_pct, -seen.mean, low)
        rows.append(Kept(row.limit, -row.asked, seen.mean, None if low is None else -low, row.decision))
    return rows


def at_most(limit: str, asked: float, found: float | None, bound: float | None) -> Kept:
    """Kept when even the bound keeps it, broken when the estimate itself does not, else open."""
    if bound is not None and bound <= asked:
        return Kept(limit, asked, found, bound, "go")
    return Kept(limit, asked, found, bound, "no go" if found is not None and found > asked else "open")


def false_calls(plan: Plan, scans: Scans) -> Rate:
    """False calls per metre of the stretch, over all scans."""
    calls = scans.figures["false_calls"]
    metres = calls.size * (plan.file.stretch_mm[1] - plan.file.stretch_mm[0]) / 1000
    return rate_of(int(np.nansum(calls)), metres, plan.file.confidence)


def seen_share_pct(scans: Scans) -> Mean:
    """Share of the wall that was seen, percent."""
    return mean_of(100 * scans.figures["seen_share"])


def all_errors(plan: Plan, scans: Scans) -> dict[str, Float[np.ndarray, "n"]]:
    """Every error that a tolerance is promised for: of sizes over all kinds, of distance and roll over all scans."""
    errors = scans.looks.errors(plan.scene.pipe.wall_mm)
    return {
        "depth_error_pct": errors["depth_pct"],
        "length_error_mm": errors["length_mm"],
        "width_error_mm": errors["width_mm"],
        "distance_error_pct": scans.figures["distance_error_pct"],
        "roll_error_deg": scans.figures["roll_rms_deg"],
    }


def shown_errors(plan: Plan, scans: Scans, pictures: Scans | None) -> dict[str, tuple[Float[np.ndarray, "n"], str]]:
    """Every promised error with its fidelity: of the plan's scans where that is trusted, else of pictures if any.

    It is trusted where it agrees with pictures in scenarios like the plan's, unless the plan's own pictures gainsay it.
    """
    own, shown = plan.scene.sensing.fidelity, {}
    dear = {} if pictures is None else all_errors(plan, pictures)
    for what, values in all_errors(plan, scans).items():
        seen = dear.get(what, np.empty(0))
        trusted = trusts(plan.scene, SCORES[what]) and not _gainsaid(
            values, seen, plan.file.share, plan.file.confidence
        )
        shown[what] = (values, own) if trusted else (seen, PICTURE)
    return shown


def _gainsaid(own: Float[np.ndarray, "n"], seen: Float[np.ndarray, "m"], share: float, confidence: float) -> bool:
    """Whether pictures that can promise by themselves lie inside the cheap scans' promise less often than it says."""
    cheap, dear = (tolerance("", errors, share, confidence) for errors in (own, seen))
    if cheap.promised is None or dear.promised is None:
        return False
    return bool(np.mean(np.abs(seen[np.isfinite(seen)]) <= cheap.promised) < share)


def all_tolerances(plan: Plan, scans: Scans, pictures: Scans | None) -> list[Tolerance]:
    """A tolerance for each of them, of scans in a fidelity that is trusted in it; of none where there are none."""
    share, confidence = plan.file.share, plan.file.confidence
    shown = shown_errors(plan, scans, pictures)
    return [tolerance(what, values, share, confidence, shown_in) for what, (values, shown_in) in shown.items()]

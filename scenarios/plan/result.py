"""What a plan's studies say together: what is promised, what speed costs, what limits it, whether pictures agree."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from typing import Any

import numpy as np

from algorithms.trust.exact_bounds import Share, share_of
from scenarios.extrapolated import reasons_of
from scenarios.fidelity.agreed import PICTURE, compared_on
from scenarios.plan.findings import (
    Detection,
    Kept,
    Scans,
    Tolerance,
    all_detections,
    all_errors,
    all_tolerances,
    false_calls,
    kept_limits,
    seen_share_pct,
)
from scenarios.plan.plan_file import Plan, scene_speed
from scenarios.plan.scans import rows_of
from scenarios.plan.studies import CONFIRM, MAIN, causes_of, study_of
from scenarios.provenance import versions
from scenarios.study.gather import Mean, mean_of
from scenarios.study.plain import canonical
from scenarios.study.plan import Recipe


@dataclass(frozen=True)
class Without:
    """What the same scans are like with one cause switched off: paired change of the mean error, by size."""

    cause: str
    change: dict[str, Mean]


@dataclass(frozen=True)
class AtSpeed:
    """The same scans at one speed."""

    speed_mm_s: float
    minutes_per_m: float
    found: Share
    depth_error_pct: Mean
    seen_share_pct: Mean


@dataclass(frozen=True)
class Confirmed:
    """Of the errors in pictures, how many lie inside what was promised."""

    what: str
    promised: float
    inside: Share


@dataclass(frozen=True)
class Result:
    """Everything that the page shows."""

    plan: Plan
    scans: Scans
    detections: list[Detection]
    tolerances: list[Tolerance]
    kept: list[Kept]
    speeds: list[AtSpeed]
    without: list[Without]
    confirmed: list[Confirmed]
    extrapolated: list[str]
    """Why it goes beyond what the testbench was held against."""

    @property
    def decision(self) -> str:
        """Go when every limit is shown to be kept, no go when one is broken."""
        decisions = {row.decision for row in self.kept}
        return "no limits" if not decisions else next(d for d in ("no go", "open", "go") if d in decisions)


def result_of(plan: Plan, found: dict[str, Scans], few: int) -> Result:
    """Everything that the plan's studies say."""
    scans = found[MAIN]
    pictures = found.get(CONFIRM)
    detections, tolerances = all_detections(plan, scans, pictures), all_tolerances(plan, scans, pictures)
    confirmed = [] if pictures is None else _confirmed(plan, pictures, tolerances)
    kept = withheld(kept_limits(plan, scans, pictures, detections, tolerances), confirmed, plan.file.share)
    own = scene_speed(plan.scene)
    speeds = [_at_speed(plan, found[MAIN], own, few)] if own and plan.file.speeds_mm_s else []
    for speed in plan.file.speeds_mm_s:
        if speed != own:
            speeds.append(_at_speed(plan, found[f"speed-{speed:g}"], speed, few))
    without = [
        Without(cause, _changes(plan, scans, found[name], few))
        for cause, name in ((cause, study_of(cause)) for cause in causes_of(plan))
    ]
    speeds, beyond = sorted(speeds, key=_speed), beyond_validated(plan, few)
    return Result(plan, scans, detections, tolerances, kept, speeds, without, confirmed, beyond)


def beyond_validated(plan: Plan, scans: int) -> list[str]:
    """Why the plan's first scans are extrapolated, each figure once, with its first value."""
    rows = rows_of(plan, scans, 0)
    recipe = Recipe(plan.base, tuple(rows), {"default": plan.base["method"]}, (), "")
    return reasons_of(recipe.scenario(values, "default", 0) for values in zip(*rows.values(), strict=True))


def _speed(one: AtSpeed) -> float:
    return one.speed_mm_s


def _at_speed(plan: Plan, scans: Scans, speed_mm_s: float, few: int) -> AtSpeed:
    """The first scans of a study, so that all speeds met the same defects."""
    early = np.isin(scans.looks.scan, np.unique(scans.looks.scan)[:few])
    hit = scans.looks.hit[early]
    error = (scans.looks.measured_mm - scans.looks.true_mm)[early][hit][:, 2]
    return AtSpeed(
        speed_mm_s,
        1000 / speed_mm_s / 60,
        share_of(int(hit.sum()), hit.size),
        mean_of(np.abs(100 * error / plan.scene.pipe.wall_mm)),
        mean_of(100 * scans.figures["seen_share"][:few]),
    )


def _changes(plan: Plan, scans: Scans, without: Scans, few: int) -> dict[str, Mean]:
    """Mean change of each size of error when a cause is switched off, paired by defect or by scan."""
    wall = plan.scene.pipe.wall_mm
    n = without.looks.hit.size  # the same defects in the same order, as long as no run failed
    changed: dict[str, Mean] = {}
    if np.array_equal(scans.looks.true_mm[:n], without.looks.true_mm):
        after, before = (np.abs(one.measured_mm - one.true_mm)[:n] for one in (without.looks, scans.looks))
        for k, (name, scale) in enumerate((("length_mm", 1.0), ("width_mm", 1.0), ("depth_pct", 100 / wall))):
            changed[name] = mean_of(scale * (after - before)[:, k])
    for name in ("distance_error_pct", "roll_rms_deg"):
        after, before = without.figures[name], scans.figures[name][:few]
        if after.size == before.size:
            changed[name] = mean_of(np.abs(after) - np.abs(before))
    return changed


def contradicted(confirmed: list[Confirmed], share: float) -> set[str]:
    """What fresh pictures show to be promised too much of."""
    return {one.what for one in confirmed if one.inside.high < share}


def withheld(kept: list[Kept], confirmed: list[Confirmed], share: float) -> list[Kept]:
    """The limits, open again where pictures show that the promise which would keep them does not hold."""
    broken = contradicted(confirmed, share)
    return [replace(row, decision="open") if row.decision == "go" and row.limit in broken else row for row in kept]


def _confirmed(plan: Plan, pictures: Scans, tolerances: list[Tolerance]) -> list[Confirmed]:
    """How many errors of fresh scans in pictures lie inside the promise, where that was made without them."""
    values, rows = all_errors(plan, pictures), []
    for one in tolerances:
        if one.shown_in == PICTURE:
            continue
        own = values[one.what][np.isfinite(values[one.what])]
        if one.promised is not None and own.size:
            inside = share_of(int((np.abs(own) <= one.promised).sum()), own.size)
            rows.append(Confirmed(one.what, one.promised, inside))
    return rows


def worst_cause(result: Result) -> str:
    """The cause without which depth errors are smallest, if it is told from chance."""
    known = [(one.change["depth_pct"], one.cause) for one in result.without if "depth_pct" in one.change]
    told = [(mean.mean, cause) for mean, cause in known if mean.half is not None and mean.mean + mean.half < 0]
    if not told:
        return "No single cause is told from chance in the depth errors."
    change, cause = min(told)
    return f"Depth is limited most by {cause}: without, its mean error is {-change:.2g} % of the wall smaller."


def settings_hash(plan: Plan) -> str:
    """Of the plan's file and its scene, so that two plans can be told apart."""
    return sha256(canonical([plan.file.model_dump(mode="json"), plan.base]).encode()).hexdigest()[:16]


def not_covered(result: Result) -> list[str]:
    """What the plan says nothing of."""
    plan, seen = result.plan, seen_share_pct(result.scans)
    words = [
        f"{100 - seen.mean:.1f} % of the wall is not seen and NOT INSPECTED; detection is stated on wall that is seen.",
        "Defect kinds, sizes and settings outside the stated ranges.",
        "Wall loss from outside: only internal loss is seen.",
    ]
    words += [f"Extrapolated: {reason}." for reason in result.extrapolated]
    if not result.confirmed:
        words.append(
            "Scans in pictures: the figures stand on the cheap fidelity; give `confirm` to hold it against them."
        )
    unshown = [one.what for one in result.tolerances if one.shown_in == PICTURE and one.promised is None]
    if unshown:
        words.append(f"{', '.join(unshown)}: the cheap fidelity is not trusted there, and pictures are too few.")
    if result.scans.counts["failed"]:
        words.append(f"{result.scans.counts['failed']} scans that failed; their defects are in no figure.")
    if not plan.file.vary:
        words.append("Any change from scan to scan but seed and defects: `vary` is empty.")
    return words


def as_json(result: Result) -> dict[str, Any]:
    """All of it as plain data."""
    plan = result.plan
    rate = false_calls(plan, result.scans)
    return {
        "plan": plan.file.name,
        "decision": result.decision,
        "extrapolated": result.extrapolated,
        "version": versions()["pipetwin"],
        "settings": settings_hash(plan),
        "seed": plan.file.seed,
        "confidence": plan.file.confidence,
        "share": plan.file.share,
        "scans": result.scans.counts,
        "trust": compared_on(plan.scene),
        "detections": [{**asdict(one), "found": one.found._asdict()} for one in result.detections],
        "tolerances": [asdict(one) for one in result.tolerances],
        "false_calls": rate._asdict(),
        "seen_share_pct": seen_share_pct(result.scans)._asdict(),
        "limits": [asdict(one) for one in result.kept],
        "speeds": [_plain(asdict(one)) for one in result.speeds],
        "without": [
            {"cause": one.cause, "change": {k: m._asdict() for k, m in one.change.items()}} for one in result.without
        ],
        "confirmed": [_plain(asdict(one)) for one in result.confirmed],
        "not_covered": not_covered(result),
    }


def _plain(row: dict[str, Any]) -> dict[str, Any]:
    return {key: value._asdict() if hasattr(value, "_asdict") else value for key, value in row.items()}

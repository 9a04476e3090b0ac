"""The scans of a plan: how many its confidence needs, and which defects each of them meets."""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, log
from typing import Any

import numpy as np

from algorithms.trust.exact_bounds import hits_needed
from scenarios.document import BadInput
from scenarios.plan.plan_file import DRAWN_DEPTHS, Plan, PlanFile
from scenarios.scenario import Scenario
from scenarios.study.factors import Factor
from scenarios.study.study import factors_of

TARGETS_FOR_A_CURVE = 60  # of a kind: MIL-HDBK-1823A's least for hits and misses
SHALLOW_SHARE = 0.6  # of the depths up to the detection limit, where hits and misses decide whether it is kept
MARGIN_MM = 12.0  # between a defect and the end of its slot
STRUT_MARGIN_DEG = 6.0
DIGITS = 3
SIZES_ALONG = ("length_mm", "path_length_mm", "diameter_mm")
SIZES_AROUND = ("width_mm", "diameter_mm", "path_length_mm")


def scans_needed(plan: Plan) -> int:
    """How many scans show what the plan is to promise, with its confidence."""
    file = plan.file
    if file.scans is not None:
        return file.scans
    of_a_kind = max(TARGETS_FOR_A_CURVE, hits_needed(file.share, file.confidence))
    needed = ceil(of_a_kind * len(file.defects) / file.per_scan)
    if file.limits.false_calls_per_m is not None:
        metres = -log(1 - file.confidence) / file.limits.false_calls_per_m  # none at all called in so many
        needed = max(needed, ceil(1000 * metres / (file.stretch_mm[1] - file.stretch_mm[0])))
    return needed


def rows_of(plan: Plan, scans: int, draw: int) -> dict[str, list[Any]]:
    """What differs from scan to scan, by its path: a seed of its own, its defects, and what the plan lets vary.

    Raises:
        BadInput: when a defect does not fit into its place in the pipe.
    """
    file = plan.file
    rng = np.random.default_rng([file.seed, draw])
    seeds = rng.choice(2**31 - 1, size=scans, replace=False)
    features = [list(_features(file, plan.scene, number, rng)) for number in range(scans)]
    drawn: dict[str, list[Any]] = {path: factor.at(rng.random(scans)) for path, factor in _varied(plan).items()}
    return {"seed": [int(seed) for seed in seeds], "pipe.features": features, **drawn}


def _varied(plan: Plan) -> dict[str, Factor]:
    return factors_of(plan.document, plan.file.vary, "vary")


def _features(file: PlanFile, scene: Scenario, scan: int, rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    """The defects of one scan: one a slot of the stretch, its kinds in turn, beside the strut's sector."""
    names = list(file.defects)
    slot_mm = (file.stretch_mm[1] - file.stretch_mm[0]) / file.per_scan
    for k in range(file.per_scan):
        name = names[(scan * file.per_scan + k) % len(names)]
        given = {key: _drawn(value, rng) for key, value in file.defects[name].items()}
        limit = file.limits.a90_95_pct
        if limit is not None and rng.random() < SHALLOW_SHARE:
            given[DRAWN_DEPTHS] = _drawn([file.defects[name][DRAWN_DEPTHS][0], limit], rng)
        depth_mm = round(scene.pipe.wall_mm * given.pop(DRAWN_DEPTHS) / 100, DIGITS)
        long = max((given[key] for key in SIZES_ALONG if key in given), default=0.0)
        free = slot_mm - long - 2 * MARGIN_MM
        if free < 0:
            words = f"a {name} of {long:g} mm does not fit into {slot_mm:g} mm; lengthen stretch_mm or lower per_scan"
            raise BadInput([f"{scene.name}: defects.{name}: {words}"])
        middle = file.stretch_mm[0] + slot_mm * k + MARGIN_MM + long / 2 + free * rng.random()
        wide = max((given[key] for key in SIZES_AROUND if key in given), default=0.0)
        clock = _lit_clock_deg(scene, wide, rng)
        place = {"distance_mm": round(middle, DIGITS), "clock_deg": round(clock, DIGITS)}
        yield {**given, **place, "depth_mm": depth_mm}


def _drawn(value: Any, rng: np.random.Generator) -> Any:
    if isinstance(value, list | tuple):
        return round(float(rng.uniform(*value)), DIGITS)
    return value


def _lit_clock_deg(scene: Scenario, wide_mm: float, rng: np.random.Generator) -> float:
    """A clock position whose whole defect lies beside the strut's sector: detection is stated on wall that is seen."""
    projector = scene.rig.projector
    hidden = projector.strut_width_deg / 2 + STRUT_MARGIN_DEG + np.degrees(wide_mm / 2 / scene.pipe.bore_radius_mm)
    if hidden >= 180:
        raise BadInput([f"{scene.name}: a defect {wide_mm:g} mm wide does not fit beside the strut's sector"])
    return float((projector.strut_clock_deg + hidden + rng.random() * (360 - 2 * hidden)) % 360)

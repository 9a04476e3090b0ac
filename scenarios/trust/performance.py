"""The performance of a set of runs as the trade states it, with the rows that each figure rests on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from algorithms.sizing.disposition import at_least
from algorithms.trust.coverage import Coverage, coverage_of, effective_cases
from algorithms.trust.exact_bounds import Rate, Share, rate_of, share_lower, share_of
from algorithms.trust.feature_class import CLASSES
from algorithms.trust.performance import Confusion, Identification, Unity, confusion_of, identification_of, unity_of
from algorithms.types import INWARD, INWARD_RING, NO_LIGHT, THROUGH, Defect
from scenarios.document import BadInput
from scenarios.matching import GATE_MM
from scenarios.trust.runs import ScanOf, Target, read_scan, targets_of
from twin.pipe import Pipe

Row = dict[str, Any]
DIMENSIONS = ("length_mm", "width_mm", "depth_mm")
K95 = 1.96
EVERY_CLASS = (*CLASSES, INWARD, INWARD_RING, THROUGH, NO_LIGHT)
MOST_RUNS = 100_000
DRAWS, SHUFFLE_SEED = 5, 20231


class Shuffled(NamedTuple):
    """What scans find of features that are not theirs.

    `exchanged`: by the truth of the next pipe that differs. `moved`: by that truth (their own, where none differs)
    turned and moved at random, `DRAWS` times; what is found so is chance, of which `by_chance` is the expectation for
    calls at random places. `leak`: more was found than that, whose draws count as wholes.
    """

    exchanged: Share
    moved: Share
    by_chance: float
    leak: bool


class Performance(NamedTuple):
    """All that the page states; what has no meaning for a set of runs (nothing found, say) is None."""

    scans: tuple[ScanOf, ...]
    targets: tuple[Target, ...]
    false: tuple[tuple[str, Defect], ...]
    unity: Unity | None
    least: Share
    confusion: Confusion
    identification: Identification
    on_seen_wall: Share
    false_calls: Rate
    coverage: dict[str, Coverage]
    shuffled: Shuffled


def performance_of(folders: Sequence[Path]) -> Performance:
    """Read the runs and judge them.

    Raises:
        BadInput: for a folder that is no run, one given twice, or runs without any true feature in what was scanned.
    """
    if len(folders) > MOST_RUNS:
        raise BadInput([f"{len(folders)} runs; at most {MOST_RUNS} are taken"])
    twice = sorted({str(f) for f in folders if sum(f.resolve() == other.resolve() for other in folders) > 1})
    if twice:
        raise BadInput([f"{folder}: given twice; a run counts once" for folder in twice])
    return performance_of_scans(tuple(read_scan(folder) for folder in folders))


def performance_of_scans(scans: tuple[ScanOf, ...]) -> Performance:
    """Judge scans that were read or just made."""
    judged = [targets_of(scan, scan.pipe, scan.seen_share) for scan in scans]
    targets = tuple(target for some, _ in judged for target in some)
    false = tuple((scan.folder.name, call) for scan, (_, calls) in zip(scans, judged, strict=True) for call in calls)
    found = [t for t in targets if t.found is not None]
    names = [(t.true_class, t.found.feature_class) for t in found if t.found]
    least = [
        t.true.depth_mm >= at_least(t.found.depth_mm, t.found.depth_std_mm)
        for t in found
        if t.found and not t.found.floor_seen
    ]
    return Performance(
        scans,
        targets,
        false,
        _unity(sized(targets)),
        share_of(sum(least), len(least)),
        confusion_of([a for a, _ in names], [b for _, b in names], EVERY_CLASS),
        _identification(targets),
        _found([t for t in targets if t.inspected]),
        rate_of(len(false), sum(scan.length_m for scan in scans)),
        _coverage(targets),
        shuffled(scans),
    )


def sized(targets: Sequence[Target]) -> list[Target]:
    """Those found whose depth is a loss of wall that was seen to its floor."""
    return [t for t in targets if t.found is not None and t.found.floor_seen and not t.feature.inward]


def _unity(targets: list[Target]) -> Unity | None:
    """Depths in per cent of each one's own wall, so that runs in different pipes can be judged together."""
    if not targets:
        return None
    measured, true = depths_pct(targets)
    return unity_of(measured, true, 100.0)


def depths_pct(targets: list[Target]) -> tuple[np.ndarray, np.ndarray]:
    """Measured and true depths in per cent of the wall."""
    measured = np.array([100 * t.found.depth_mm / t.wall_mm for t in targets if t.found])
    return measured, np.array([100 * t.true.depth_mm / t.wall_mm for t in targets])


def _identification(targets: Sequence[Target]) -> Identification:
    found = np.array([t.found is not None for t in targets], dtype=bool)
    right = np.array([t.found is not None and t.found.feature_class == t.true_class for t in targets], dtype=bool)
    return identification_of(found, right)


def intervals(targets: Sequence[Target]) -> list[Row]:
    """Each stated 95 % interval with the truth; a length that the scan's end cut off is a least one and states none."""
    rows = []
    for t in sized(targets):
        for k, name in enumerate(DIMENSIONS):
            if t.found is None or (name == "length_mm" and t.found.cut_by_scan_end):
                continue
            value, std = getattr(t.found, name), getattr(t.found, name.replace("_mm", "_std_mm"))
            low, high, true = value - K95 * std, value + K95 * std, t.true[k]
            rows.append(
                {"run": t.run, "feature": t.number, "dimension": name, "low_mm": low, "high_mm": high, "true_mm": true}
            )
    return rows


def _coverage(targets: Sequence[Target]) -> dict[str, Coverage]:
    rows, out = intervals(targets), {}
    for name in DIMENSIONS:
        own = [row for row in rows if row["dimension"] == name]
        if not any(np.isfinite(row["low_mm"]) for row in own):
            continue
        low, high, true = (np.array([row[key] for row in own]) for key in ("low_mm", "high_mm", "true_mm"))
        out[name] = coverage_of(low, high, true, scan=np.array([row["run"] for row in own]))
    return out


def shuffled(scans: Sequence[ScanOf]) -> Shuffled:
    """Judge every scan by truths that are not its own."""
    rng = np.random.default_rng(SHUFFLE_SEED)
    exchanged: list[Target] = []
    moved: list[tuple[Target, ScanOf, int]] = []
    for i, scan in enumerate(scans):
        others = (scans[(i + k) % len(scans)].pipe for k in range(1, len(scans)))
        other = next((pipe for pipe in others if pipe.features != scan.pipe.features), None)
        exchanged += _judged(scan, other) if other else []
        for draw in range(DRAWS):
            wrong = _moved(other or scan.pipe, scan, rng)
            moved += [(target, scan, i * DRAWS + draw) for target in _judged(scan, wrong)]
    if not moved:
        return Shuffled(_found(exchanged), _found([]), 0.0, False)
    chance = float(np.mean([_by_chance(target, scan) for target, scan, _ in moved]))
    hit = np.array([target.found is not None for target, _, _ in moved])
    cases = effective_cases(hit, np.array([draw for _, _, draw in moved]))
    leak = share_lower(float(hit.mean()) * cases, cases, 0.975) > chance
    return Shuffled(_found(exchanged), _found([target for target, _, _ in moved]), chance, leak)


def _judged(scan: ScanOf, pipe: Pipe) -> list[Target]:
    return targets_of(scan, pipe, (0.0,) * len(pipe.features))[0]


def _found(targets: Sequence[Target]) -> Share:
    return share_of(sum(t.found is not None for t in targets), len(targets))


def _moved(pipe: Pipe, scan: ScanOf, rng: np.random.Generator) -> Pipe:
    """A pipe whose features are all turned alike and moved alike, within what was scanned."""
    low, high = scan.scanned_mm
    turn, shift = rng.uniform(0, 360), rng.uniform(0, high - low)
    features = [
        f.model_copy(
            update={
                "clock_deg": (f.clock_deg + turn) % 360,
                "distance_mm": low + (f.distance_mm - low + shift) % (high - low),
            }
        )
        for f in pipe.features
    ]
    return pipe.model_copy(update={"features": tuple(features)})


def _by_chance(target: Target, scan: ScanOf) -> float:
    """The chance that one of a scan's calls, each at any place of the wall, is taken for a feature."""
    bore, n = scan.pipe.bore_radius_mm, len(scan.defects)
    around = min(target.true.width_mm + 2 * GATE_MM, 2 * np.pi * bore)
    share = (target.true.length_mm + 2 * GATE_MM) * around / (1000 * scan.length_m * 2 * np.pi * bore)
    return float(1 - (1 - min(share, 1.0)) ** n)


def target_rows(targets: Sequence[Target]) -> list[Row]:
    """A row a true feature, found or missed: the looks that `pipetwin pod` reads."""
    return [_target_row(target) for target in targets]


def _target_row(t: Target) -> Row:
    place = f"{t.feature.distance_mm:.6g} mm, {t.feature.clock_deg:g} deg"
    row: Row = {
        "target": f"{t.kind} {' x '.join(f'{mm:.6g}' for mm in t.true)} mm at {place}",
        "run": t.run,
        "feature": t.number,
        "kind": t.kind,
        "distance_mm": t.feature.distance_mm,
        "clock_deg": t.feature.clock_deg,
        **{f"true_{name}": float(value) for name, value in zip(DIMENSIONS, t.true, strict=True)},
        "true_loss_pct": 100 * t.true.depth_mm / t.wall_mm,
        "seen_share": t.seen_share,
        "found": int(t.found is not None),
        "true_class": t.true_class,
    }
    if t.found is not None:
        row |= {name: getattr(t.found, name) for name in DIMENSIONS}
        row |= {"floor_seen": int(t.found.floor_seen), "class": t.found.feature_class}
    return row

"""The same pipe twice: defects paired, how each grew with what is open of it, what is new, what is gone."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from algorithms.types import INWARD_RING, Defect
from scenarios.field.alignment import Laid, Places, lay_over
from scenarios.field.export_tally import TWO_SIDED_95, box_cells, joints_mm, remarks
from scenarios.found_run import FoundRun, read_found
from sensor_model.geometry import clock_position

SEEN_ENOUGH = 0.6  # of a defect's place: gaps between rings hide none, a strut or the scan's end may
SAME_BORE_MM = 5.0  # bores further apart than this are not one pipe's
SIZES = ("length", "width", "depth")

Fate = Literal["paired", "new", "gone", "not seen before", "not seen now"]


class Growth(NamedTuple):
    """A later size less the earlier one, and its 95 % interval; None where one of the two is only a least size."""

    change_mm: float
    half_width_mm: float | None

    @property
    def verdict(self) -> str:
        """Whether the interval leaves zero out."""
        if self.half_width_mm is None:
            return "open"
        if abs(self.change_mm) <= self.half_width_mm:
            return "no change shown"
        return "grown" if self.change_mm > 0 else "smaller"


class Matched(NamedTuple):
    """One defect of the pipe, in either scan or both, and how much of its place the other scan saw."""

    fate: Fate
    before: Defect | None
    after: Defect | None
    growth: dict[str, Growth]
    seen_share: float
    deepest_there_mm: float

    @property
    def one(self) -> Defect:
        """The later measurement of it, or else the only one."""
        found = self.after or self.before
        assert found is not None  # noqa: S101  one of the two is there
        return found


class Matching(NamedTuple):
    """Two runs laid over each other: `laid` carries the later scan's places onto the earlier one's."""

    before: FoundRun
    after: FoundRun
    laid: Laid
    rows: tuple[Matched, ...]


def match_runs(before_folder: Path, after_folder: Path) -> Matching:
    """Pair the defects of two run folders, the earlier first.

    Raises:
        BadInput: when one cannot be read.
    """
    return matched(read_found(before_folder), read_found(after_folder))


def matched(before: FoundRun, after: FoundRun) -> Matching:
    """Pair the defects of two runs."""
    laid = lay_over(_places(before), _places(after), before.bore_radius_mm)
    pairs = [(i, k) for i, k in laid.pairs if i < len(before.defects) and k < len(after.defects)]
    pairs = [(i, k) for i, k in pairs if before.defects[i].inward == after.defects[k].inward]
    rows = [_paired(before.defects[i], after.defects[k]) for i, k in pairs]
    rows += [
        _alone(after, one, laid.offset_mm, laid.turn_rad, False)
        for i, one in enumerate(before.defects)
        if i not in {i for i, _ in pairs}
    ]
    rows += [
        _alone(before, one, -laid.offset_mm, -laid.turn_rad, True)
        for k, one in enumerate(after.defects)
        if k not in {k for _, k in pairs}
    ]
    return Matching(before, after, laid, tuple(sorted(rows, key=lambda row: _along_before(row, laid))))


def _along_before(row: Matched, laid: Laid) -> float:
    """Where a defect is in the earlier scan's distances."""
    return row.before.distance_mm if row.before else row.one.distance_mm + laid.offset_mm


def _places(run: FoundRun) -> Places:
    """Defects, then joints that are no ring among them."""
    rings = [d.distance_mm for d in run.defects if d.feature_class == INWARD_RING]
    joints = np.array([z for z in joints_mm(run) if z not in rings], dtype=float)
    nothing = np.full(joints.size, np.nan)
    found = places_of(run.defects)
    return Places(*(np.concatenate(pair) for pair in zip(found, (joints, nothing, nothing), strict=True)))


def places_of(defects: tuple[Defect, ...]) -> Places:
    """Where defects are, and how large on the wall; a ring has no place around it."""
    rows = [(d.distance_mm, d.theta_rad, (d.length_mm * d.width_mm) ** 0.5) for d in defects]
    z, theta, size = np.array(rows, dtype=float).reshape(-1, 3).T
    ring = np.array([d.feature_class == INWARD_RING for d in defects], dtype=bool)
    return Places(z, np.where(ring, np.nan, theta), np.where(ring, np.nan, size))


def _paired(before: Defect, after: Defect) -> Matched:
    growth = {name: _growth(name, before, after) for name in SIZES}
    return Matched("paired", before, after, growth, 1.0, after.depth_mm)


def _growth(name: str, before: Defect, after: Defect) -> Growth:
    change = getattr(after, f"{name}_mm") - getattr(before, f"{name}_mm")
    std = np.hypot(*(getattr(one, f"{name}_std_mm") for one in (before, after)))
    least = [
        (name == "length" and one.cut_by_scan_end) or (name == "depth" and not one.floor_seen)
        for one in (before, after)
    ]
    return Growth(float(change), None if any(least) else float(TWO_SIDED_95 * std))


def _alone(other: FoundRun, defect: Defect, offset_mm: float, turn_rad: float, later: bool) -> Matched:
    """A defect of one scan that has no partner: the other scan's map says whether it could have had one."""
    start, theta = defect.start_mm - offset_mm, defect.theta_rad - turn_rad
    depths = other.deviation_mm[box_cells(other, start, defect.length_mm, theta, defect.width_mm)]
    length = max(defect.length_mm / other.wall.cell_z_mm, 1.0)
    # what lies beyond the map's ends was not seen either
    share = float(np.isfinite(depths).sum() / max(depths.shape[0] * length, depths.size, 1))
    deepest = float(np.nanpercentile(depths, 90)) if np.isfinite(depths).any() else float("nan")
    seen = share >= SEEN_ENOUGH
    fate: Fate = ("new" if seen else "not seen before") if later else ("gone" if seen else "not seen now")
    return Matched(fate, None if later else defect, defect if later else None, {}, share, deepest)


def table(found: Matching) -> list[dict[str, Any]]:
    """A row a defect, in the earlier scan's distances and clock positions."""
    rows = []
    for number, row in enumerate(found.rows, start=1):
        one, moved = row.one, row.before is None
        row_of: dict[str, Any] = {
            "defect": number,
            "fate": row.fate,
            "distance_mm": round(_along_before(row, found.laid), 2),
            "clock": clock_position(one.theta_rad + found.laid.turn_rad if moved else (row.before or one).theta_rad),
        }
        for name in SIZES:
            for when, defect in (("before", row.before), ("after", row.after)):
                row_of[f"{name}_{when}_mm"] = None if defect is None else round(getattr(defect, f"{name}_mm"), 3)
            growth = row.growth.get(name)
            row_of[f"{name}_change_mm"] = growth and round(growth.change_mm, 3)
            half = growth.half_width_mm if growth else None
            row_of[f"{name}_change_low_mm"] = None if half is None or not growth else round(growth.change_mm - half, 3)
            row_of[f"{name}_change_high_mm"] = None if half is None or not growth else round(growth.change_mm + half, 3)
            row_of[f"{name}_verdict"] = growth.verdict if growth else None
        row_of["seen_share_in_other"] = round(row.seen_share, 3)
        row_of["remark"] = "; ".join(_said(row))
        rows.append(row_of)
    return rows


def _said(row: Matched) -> list[str]:
    said = [
        f"{when}: {text}" for when, one in (("before", row.before), ("after", row.after)) for text in remarks_of(one)
    ]
    if row.fate == "gone":
        said.append(f"its place was seen, and is {row.deepest_there_mm:.2f} mm deep there now")
    elif row.fate == "new":
        said.append(f"its place was seen before, and was {row.deepest_there_mm:.2f} mm deep then")
    elif row.fate != "paired":
        share = f"only {100 * row.seen_share:.0f} % of its place was seen"
        said.append(f"{share} {'before' if row.fate == 'not seen before' else 'now'}: nothing is said of it")
    return said


def remarks_of(defect: Defect | None) -> list[str]:
    """What a reader of a defect's sizes must know; nothing of none."""
    return [] if defect is None else remarks(defect)


def words(found: Matching) -> str:
    """The outcome in one line."""
    fates = [row.fate for row in found.rows]
    grown = sum(any(g.verdict == "grown" for g in row.growth.values()) for row in found.rows)
    counted = [f"{fates.count('paired')} paired, {grown} of them grown", f"{fates.count('new')} new"]
    counted.append(f"{fates.count('gone')} gone")
    unseen = fates.count("not seen before") + fates.count("not seen now")
    counted += [f"{unseen} in a place that one scan did not see"] if unseen else []
    return f"{', '.join(counted)}. Laid over each other: {found.laid.words}."

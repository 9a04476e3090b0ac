"""The trade's pipe tally: joints and defects in order of distance, each with what is known of it and how well."""

from __future__ import annotations

import csv
import re
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from algorithms.sizing.disposition import at_least
from algorithms.types import INWARD_RING, NO_LIGHT, THROUGH, Defect
from scenarios.found_run import FoundRun, read_found
from sensor_model.geometry import clock_position

TWO_SIDED_95 = 1.96
SAME_JOINT_MM = 50.0  # ties to one joint by several frames; joints are metres apart
STATED = re.compile(r"joint at (-?[0-9.]+(?:e[+-]?[0-9]+)?) mm")
COLUMNS = (
    "row",
    "kind",
    "joint",
    "distance_mm",
    "from_upstream_joint_mm",
    "start_mm",
    "deepest_mm",
    "deepest_clock",
    "clock",
    "length_mm",
    "length_low_mm",
    "length_high_mm",
    "width_mm",
    "width_low_mm",
    "width_high_mm",
    "depth_mm",
    "depth_low_mm",
    "depth_high_mm",
    "wall_loss_pct",
    "wall_loss_low_pct",
    "wall_loss_high_pct",
    "class",
    "seen_share",
    "disposition",
    "remark",
)


class Interval(NamedTuple):
    """A size with its 95 % interval; no upper end where only a least size is known."""

    value: float
    low: float
    high: float | None


def export_tally(run_folder: Path, out: Path) -> None:
    """One CSV, millimetres: intervals are 95 %, an empty upper end is open, joints count downstream from the launch.

    Raises:
        BadInput: when the run cannot be read.
    """
    with out.open("w", newline="") as file:
        rows = csv.DictWriter(file, COLUMNS, restval="")
        rows.writeheader()
        rows.writerows(tally(read_found(run_folder)))


def tally(run: FoundRun) -> list[dict[str, Any]]:
    """The rows of the tally."""
    joints = joints_mm(run)
    others = [one for one in run.defects if one.feature_class != INWARD_RING]
    rows = [{"kind": "joint", "distance_mm": z} for z in joints] + [_defect_row(run, one) for one in others]
    rows.sort(key=lambda row: row["distance_mm"])
    for number, row in enumerate(rows, start=1):
        upstream = int(np.searchsorted(joints, row["distance_mm"], side="right"))
        row["row"], row["joint"] = number, upstream
        if row["kind"] == "defect" and upstream:
            row["from_upstream_joint_mm"] = row["distance_mm"] - joints[upstream - 1]
    return [{name: f"{v:.2f}" if isinstance(v, float) else v for name, v in row.items()} for row in rows]


def joints_mm(run: FoundRun) -> list[float]:
    """Where the scan met joints: written down where it was tied to one, or rings that stand inward, as beads do."""
    places = [one.distance_mm for one in run.defects if one.feature_class == INWARD_RING]
    for episode in run.episodes:
        if episode.kind == "joint":
            stated = STATED.fullmatch(episode.who)
            places.append(float(stated[1]) if stated else run.distance_at_mm(episode.start_s))
    kept: list[float] = []
    for z in sorted(places):
        if not kept or z - kept[-1] > SAME_JOINT_MM:
            kept.append(z)
    return kept


def _defect_row(run: FoundRun, defect: Defect) -> dict[str, Any]:
    row: dict[str, Any] = {
        "kind": "defect",
        "distance_mm": defect.distance_mm,
        "start_mm": defect.start_mm,
        "clock": clock_position(defect.theta_rad),
        "class": defect.feature_class,
        "seen_share": 1 - defect.unseen_share,
        "disposition": defect.disposition,
        "remark": "; ".join(remarks(defect)),
    }
    z, theta = deepest_place(run, defect)
    if np.isfinite(z):
        row |= {"deepest_mm": z, "deepest_clock": clock_position(theta)}
    for name, unit, size in intervals(defect):
        row |= {f"{name}_{unit}": size.value, f"{name}_low_{unit}": size.low}
        row[f"{name}_high_{unit}"] = "" if size.high is None else size.high
    return row


def intervals(defect: Defect) -> list[tuple[str, str, Interval]]:
    """Length, width, depth and wall loss with their 95 % intervals."""
    cut, shallow = defect.cut_by_scan_end, not defect.floor_seen
    return [
        ("length", "mm", _interval(defect.length_mm, defect.length_std_mm, cut)),
        ("width", "mm", _interval(defect.width_mm, defect.width_std_mm, False)),
        ("depth", "mm", _interval(defect.depth_mm, defect.depth_std_mm, shallow)),
        ("wall_loss", "pct", _interval(defect.wall_loss_pct, defect.wall_loss_std_pct, shallow, most=100.0)),
    ]


def _interval(value: float, std: float, least_only: bool, most: float = inf) -> Interval:
    if least_only:
        return Interval(value, at_least(value, std), None)
    return Interval(value, max(value - TWO_SIDED_95 * std, 0.0), max(min(value + TWO_SIDED_95 * std, most), value))


def remarks(defect: Defect) -> list[str]:
    """What a reader of the sizes must know."""
    said = []
    if defect.cut_by_scan_end:
        said.append("cut by the scan's end: the length is a least one")
    if defect.inward:
        said.append("stands inward: its depth is a height, and takes no wall")
    if defect.feature_class == NO_LIGHT:
        said.append("a dark place alone: nothing is known of its depth")
    elif not defect.floor_seen and defect.feature_class != THROUGH:
        said.append("no light reached the floor: depth and wall loss are least ones")
    return said


def deepest_place(run: FoundRun, defect: Defect) -> tuple[float, float]:
    """Distance and angle of the deepest seen cell within a defect's box; NaN where nothing there was seen."""
    cells = box_cells(run, defect.start_mm, defect.length_mm, defect.theta_rad, defect.width_mm)
    depths = run.deviation_mm[cells]
    if not np.isfinite(depths).any():
        return float("nan"), float("nan")
    line, column = np.unravel_index(np.nanargmax(depths), depths.shape)
    return float(run.wall.z_mm[cells[1][0, column]]), float(run.wall.theta_rad[cells[0][line, 0]])


def box_cells(
    run: FoundRun, start_mm: float, length_mm: float, theta_rad: float, width_mm: float
) -> tuple[np.ndarray, np.ndarray]:
    """Cells of the map in a box on the wall, to index with; none where the scan did not come."""
    wall = run.wall
    turn = np.abs(np.mod(wall.theta_rad - theta_rad + np.pi, 2 * np.pi) - np.pi)
    around = np.flatnonzero(turn <= width_mm / 2 / run.bore_radius_mm + np.pi / wall.theta_rad.size)
    half_cell = wall.cell_z_mm / 2
    along = np.flatnonzero((wall.z_mm >= start_mm - half_cell) & (wall.z_mm <= start_mm + length_mm + half_cell))
    lines, columns = np.ix_(around, along)
    return lines, columns

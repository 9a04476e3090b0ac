"""What run folders say of the defects in their pipes: each true one found or missed, and each call that was false."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from algorithms.trust.feature_class import CLASSES, feature_class
from algorithms.types import INWARD, THROUGH, Defect, WallMap
from scenarios.document import BadInput
from scenarios.found_run import read_found
from scenarios.matching import false_calls, match
from scenarios.run import scenario_and_truth
from sensor_model.geometry import wrap_rad
from twin.features.base import Feature, TrueSize
from twin.pipe import Pipe

LEAST_SEEN = 0.5  # of a true outline's cells: what was seen less is not inspected wall


@dataclass(frozen=True)
class ScanOf:
    """One run: its pipe, the stretch that it scanned, how much of each feature it saw, and what it called."""

    folder: Path
    pipe: Pipe
    scanned_mm: tuple[float, float]
    seen_share: tuple[float, ...]
    defects: tuple[Defect, ...]

    @property
    def length_m(self) -> float:
        """Length scanned."""
        return (self.scanned_mm[1] - self.scanned_mm[0]) / 1000


@dataclass(frozen=True)
class Target:
    """One true feature within the scanned stretch, and what was made of it."""

    run: str
    folder: Path
    number: int
    kind: str
    feature: Feature
    true: TrueSize
    wall_mm: float
    seen_share: float
    found: Defect | None

    @property
    def true_class(self) -> str:
        """Its class by its true size, or by what it is."""
        if self.feature.inward:
            return INWARD
        if self.kind == "hole":
            return THROUGH
        return CLASSES[int(feature_class(np.array([self.true[0]]), np.array([self.true[1]]), self.wall_mm)[0])]

    @property
    def inspected(self) -> bool:
        """Whether enough of it was seen for a miss to be one."""
        return self.seen_share >= LEAST_SEEN


def read_scan(folder: Path) -> ScanOf:
    """One run's folder.

    Raises:
        BadInput: when it is no whole run, or a file of it says something else.
    """
    _, truth = scenario_and_truth(folder)
    found = read_found(folder)
    if truth.pipe.scanned is not None:
        raise BadInput([f"{folder}: its bore is a scan, and nobody listed what that shows; it cannot be judged by it"])
    return scan_of(folder, truth.pipe, found.wall, found.defects)


def scan_of(folder: Path, pipe: Pipe, wall: WallMap, defects: tuple[Defect, ...]) -> ScanOf:
    """A measurement beside the true pipe.

    Raises:
        BadInput: when nothing was scanned.
    """
    columns = wall.z_mm[wall.scanned()]
    if not columns.size:
        raise BadInput([f"{folder}: nothing of the wall was scanned"])
    seen = tuple(_seen_share(wall, feature, pipe.bore_radius_mm) for feature in pipe.features)
    return ScanOf(folder, pipe, (float(columns[0]), float(columns[-1] + wall.cell_z_mm)), seen, defects)


def _seen_share(wall: WallMap, feature: Feature, bore_mm: float) -> float:
    """How much of a feature's true outline holds a point; what lies outside the map was not seen."""
    size = feature.size(bore_mm)
    along = np.abs(wall.z_mm + wall.cell_z_mm / 2 - feature.distance_mm) <= size.length_mm / 2
    around = np.abs(wrap_rad(wall.theta_rad - np.radians(feature.clock_deg))) * bore_mm <= size.width_mm / 2
    cells = wall.seen[np.ix_(around, along)]
    wanted = size.length_mm / wall.cell_z_mm * size.width_mm / wall.cell_arc_mm(bore_mm)
    return float(min(cells.sum() / max(wanted, 1.0), 1.0))


def targets_of(scan: ScanOf, pipe: Pipe, seen_share: tuple[float, ...]) -> tuple[list[Target], list[Defect]]:
    """Every true feature of a pipe within what a scan covers, as it was found or missed; and the false calls."""
    pairs = dict(match(pipe, scan.defects))
    run, low, high = scan.folder.name, *scan.scanned_mm
    targets = [
        Target(
            run,
            scan.folder,
            i + 1,
            f.kind,
            f,
            f.size(pipe.bore_radius_mm),
            pipe.wall_mm,
            seen_share[i],
            _of(pairs, i, scan),
        )
        for i, f in enumerate(pipe.features)
        if low <= f.distance_mm <= high
    ]
    return targets, false_calls(pipe, scan.defects, list(pairs.items()))


def _of(pairs: dict[int, int], i: int, scan: ScanOf) -> Defect | None:
    return scan.defects[pairs[i]] if i in pairs else None

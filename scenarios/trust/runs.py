"""What run folders say of the defects in their pipes: each true one found or missed, and each call that was false."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from algorithms.trust.feature_class import CLASSES, feature_class
from algorithms.types import INWARD, THROUGH, Defect, WallMap
from scenarios.document import BadInput
from scenarios.matching import false_calls, match
from scenarios.run import scenario_and_truth
from scenarios.trust.columns import Table, numbers, place_of, raise_faults, read_table
from sensor_model.geometry import wrap_rad
from twin.features.base import Feature, TrueSize
from twin.pipe import Pipe

LEAST_SEEN = 0.5  # of a true outline's cells: what was seen less is not inspected wall
MAP_ARRAYS = ("theta_rad", "z_mm", "radius_mm", "spread_mm", "sigma_mm", "count")
WRITTEN = (
    "start_mm",
    "theta_deg",
    "length_mm",
    "width_mm",
    "depth_mm",
    "length_std_mm",
    "width_std_mm",
    "depth_std_mm",
    "wall_loss_pct",
    "unseen_share",
    "cut_by_scan_end",
    "floor_seen",
    "volume_mm3",
)


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
    wall = _wall(folder / "reconstruction" / "wall_map.npz")
    columns = wall.z_mm[wall.scanned()]
    if not columns.size:
        raise BadInput([f"{folder}: nothing of the wall was scanned"])
    pipe = truth.pipe
    if pipe.scanned is not None:
        raise BadInput([f"{folder}: its bore is a scan, and nobody listed what that shows; it cannot be judged by it"])
    seen = tuple(_seen_share(wall, feature, pipe.bore_radius_mm) for feature in pipe.features)
    ends = float(columns[0]), float(columns[-1] + wall.cell_z_mm)
    return ScanOf(folder, pipe, ends, seen, _defects(folder / "reconstruction" / "defects.csv"))


def _wall(file: Path) -> WallMap:
    try:
        with np.load(file, allow_pickle=False) as held:
            arrays = {name: held[name] for name in MAP_ARRAYS}
    except (OSError, ValueError, KeyError) as error:
        raise BadInput([f"{file}: cannot be read: {error}; run it again"]) from error
    return WallMap(**{name: array if name == "count" else array.astype(float) for name, array in arrays.items()})


def _defects(file: Path) -> tuple[Defect, ...]:
    if file.is_file() and len(file.read_text().splitlines()) == 1:
        return ()  # a head alone: nothing was called
    table = read_table(file)
    faults: list[str] = []
    columns = {name: numbers(table, name, faults, empty=True) for name in WRITTEN}
    classes, dispositions = (_text(table, name) for name in ("feature_class", "disposition"))
    raise_faults(faults)
    found = []
    for i, (name, word) in enumerate(zip(classes, dispositions, strict=True)):
        values = {key: float(column[i]) for key, column in columns.items()}
        cut, lit, theta_deg = (values.pop(key) for key in ("cut_by_scan_end", "floor_seen", "theta_deg"))
        found.append(
            Defect(
                **values,
                theta_rad=float(np.radians(theta_deg)),
                seen_cells=0,
                cut_by_scan_end=bool(cut),
                floor_seen=bool(lit),
                feature_class=name,
                disposition=word,
            )
        )
    return tuple(found)


def _text(table: Table, column: str) -> list[str]:
    k = place_of(table, column)
    return [row[k] for row in table.rows]


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

"""Reference cylinders of a metrology institute: our plain least-squares fit against their certified answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from algorithms.registration.least_squares_cylinder import CylinderFit, fit_cylinder
from scenarios.document import BadInput
from scenarios.report.plain_rows import text_table

LIMITS = {"position_um": 0.1, "direction_urad": 0.1, "radius_um": 0.1}
COLUMNS = {
    "data": "data",
    "points": "points",
    "position_um": "position um",
    "direction_urad": "direction urad",
    "radius_um": "radius um",
    "passes": "passes",
}
ANSWER = "px py pz dx dy dz r"
Row = dict[str, Any]


def fit_references(folder: Path) -> list[Row]:
    """A row for every `NAME.asc` (x y z in mm, a point a line), judged by `NAME.answer.txt`.

    Raises:
        BadInput: for files that are missing or say something else.
    """
    files = sorted(folder.glob("*.asc")) if folder.is_dir() else []
    if not files:
        raise BadInput([f"{folder}: {'no *.asc file here' if folder.is_dir() else 'is no folder'}"])
    faults, read = [], []
    for file in files:
        try:
            read.append((file.stem, _numbers(file, 3), _numbers(file.with_suffix(".answer.txt"), 1)))
            if len(read[-1][2]) != 7:
                raise ValueError(f"{len(read[-1][2])} numbers in the answer; 7 are expected ({ANSWER})")
        except (OSError, ValueError) as error:
            faults.append(f"{file}: {getattr(error, 'strerror', None) or error}")
    if faults:
        raise BadInput(faults)
    return [_judged(name, xyz, answer[:, 0]) for name, xyz, answer in read]


def _numbers(file: Path, columns: int) -> np.ndarray:
    if not file.is_file():
        raise ValueError(f"{file.name}: no such file, or no plain one")
    rows = [line.split() for line in file.read_text().splitlines() if line.strip()]
    if not rows or any(len(row) != columns for row in rows):
        raise ValueError(f"{file.name}: lines of {columns} numbers are expected")
    return np.array(rows, dtype=float)


def _judged(name: str, xyz: np.ndarray, answer: np.ndarray) -> Row:
    try:
        fit = fit_cylinder(xyz)
    except ValueError as error:
        raise BadInput([f"{name}: {error}"]) from error
    off = errors(fit, answer)
    passes = all(off[key] <= most for key, most in LIMITS.items())
    return {"data": name, "points": len(xyz), **off, "passes": passes}


def errors(fit: CylinderFit, answer: np.ndarray) -> dict[str, float]:
    """How far their point lies from our axis, the angle between the axes, and the radii's difference."""
    place, direction, radius = answer[:3], answer[3:6] / np.linalg.norm(answer[3:6]), answer[6]
    return {
        "position_um": float(np.linalg.norm(np.cross(place - fit.center_mm, fit.axis)) * 1e3),
        "direction_urad": float(np.arcsin(min(float(np.linalg.norm(np.cross(direction, fit.axis))), 1.0)) * 1e6),
        "radius_um": float(abs(fit.radius_mm - radius) * 1e3),
    }


def words(rows: list[Row]) -> str:
    """The table for a terminal."""
    shown = [{**row, "passes": "yes" if row["passes"] else "NO"} for row in rows]
    limits = ", ".join(f"{COLUMNS[key]} {most:g}" for key, most in LIMITS.items())
    return f"{text_table(shown, COLUMNS)}\nat most: {limits}; {sum(row['passes'] for row in rows)} of {len(rows)} pass"

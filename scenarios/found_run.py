"""What a run's folder holds of its measurement, read back: truth, score and pictures need not be there."""

from __future__ import annotations

import csv
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from math import isfinite, prod
from pathlib import Path
from stat import S_ISREG
from typing import Any

import numpy as np
from jaxtyping import Float

from algorithms.types import Defect, Reconstruction, WallMap
from scenarios.artefacts import DEFECT_COLUMNS, EPISODE_COLUMNS
from scenarios.document import BadInput, shown
from sensor_model.geometry import rotation_from_wxyz, transform
from sensor_model.recording import BadRecording, NominalPipe, Recording, open_recording
from sensor_model.rig import load_settings

MADE = "reconstruction"
LARGEST_TABLE_BYTES = 200_000_000
LARGEST_MAP_BYTES = 2_000_000_000
MOST_FAULTS = 20
LARGEST_RADIUS_MM = 1e5
LARGEST_NUMBER = 1e12  # seconds since 1970 are below, whatever else is
LEAST = dict.fromkeys(("length_mm", "width_mm"), 1e-3)
LEAST |= dict.fromkeys(
    ("depth_mm", "length_std_mm", "width_std_mm", "depth_std_mm", "wall_loss_std_pct", "seen_cells", "unseen_share"),
    0.0,
)
MAP_ARRAYS = ("theta_rad", "z_mm", "radius_mm", "spread_mm", "sigma_mm", "count", "wall_dev_mm")


@dataclass(frozen=True)
class NotedEpisode:
    """A stretch of the log that was not as it should be, as `episodes.csv` has it."""

    kind: str
    who: str
    start_s: float
    end_s: float
    amount: float


@dataclass(frozen=True)
class FoundRun:
    """A measurement as its folder tells it; the path has the registered frames only."""

    folder: Path
    wall: WallMap
    deviation_mm: Float[np.ndarray, "around along"]
    defects: tuple[Defect, ...]
    time_s: Float[np.ndarray, "n"]
    T_pipe_camera: Float[np.ndarray, "n 4 4"]
    episodes: tuple[NotedEpisode, ...]

    @property
    def bore_radius_mm(self) -> float:
        """Median of the local undamaged bore, from which depths are counted."""
        return float(np.nanmedian(self.wall.radius_mm - self.deviation_mm))

    def distance_at_mm(self, time_s: float) -> float:
        """Where along the pipe the camera was at a time."""
        return float(np.interp(time_s, self.time_s, self.T_pipe_camera[:, 2, 3]))


def read_found(folder: Path) -> FoundRun:
    """A run's measurement.

    Raises:
        BadInput: when the folder is no run, or a file in it cannot be used: file, line, value and what is expected.
    """
    made = folder / MADE
    if not made.is_dir():
        raise BadInput([f"{folder}: reconstruction/ is missing; `pipetwin run` makes such a folder"])
    wall, deviation = read_map(made / "wall_map.npz")
    time_s, T = _read_tum(made / "trajectory.tum")
    episodes = made / "episodes.csv"
    return FoundRun(
        folder,
        wall,
        deviation,
        tuple(_rows(made / "defects.csv", DEFECT_COLUMNS, _defect)),
        time_s,
        T,
        tuple(_rows(episodes, EPISODE_COLUMNS, _episode)) if episodes.is_file() else (),
    )


def found_of(folder: Path, found: Reconstruction) -> FoundRun:
    """A measurement that was just made, as its folder would tell it."""
    path = found.trajectory
    kept = path.registered
    episodes = tuple(
        NotedEpisode(one.kind, one.who, one.start_ns / 1e9, one.end_ns / 1e9, one.amount) for one in found.episodes
    )
    time_s, T = path.stamp_ns[kept] / 1e9, path.T_pipe_camera[kept]
    return FoundRun(folder, found.wall, found.deviation_mm, found.defects, time_s, T, episodes)


def recording_of(folder: Path) -> Recording | None:
    """The run's own log, where it is there; None where the folder has none.

    Raises:
        BadInput: when it is there and cannot be read.
    """
    if not (folder / "recording").is_dir():
        return None
    try:
        return open_recording(folder / "recording")
    except BadRecording as error:
        raise BadInput([str(error)]) from error


def nominal_pipe_of(folder: Path) -> NominalPipe | None:
    """What the operator wrote down of the pipe, where the folder has it.

    Raises:
        BadInput: when it is there and cannot be read.
    """
    file = folder / "recording" / "pipe.yaml"
    if not file.is_file():
        return None
    try:
        return load_settings(NominalPipe, file)
    except (OSError, ValueError) as error:
        raise BadInput([f"{file}: {error}"]) from error


def read_map(file: Path) -> tuple[WallMap, Float[np.ndarray, "around along"]]:
    """A run's `wall_map.npz`: the wall, and its deviation from the local bore.

    Raises:
        BadInput: naming file, array and what is expected.
    """
    held = read_arrays(file, MAP_ARRAYS, LARGEST_MAP_BYTES)
    theta, z = (held[name].astype(float) for name in ("theta_rad", "z_mm"))
    grid = (theta.size, z.size)
    for name in MAP_ARRAYS[2:]:
        if held[name].shape != grid:
            raise BadInput([f"{file}: {name}: got shape {held[name].shape}; {grid} goes with theta_rad and z_mm"])
    for name, places in (("theta_rad", theta), ("z_mm", z)):
        if places.ndim != 1 or places.size < 2 or not (np.isfinite(places).all() and (np.diff(places) > 0).all()):
            raise BadInput([f"{file}: {name}: must be at least 2 finite numbers, each beyond the last"])
    if np.nanmax(np.abs(held["radius_mm"]), initial=0.0) > LARGEST_RADIUS_MM:
        raise BadInput([f"{file}: radius_mm: must be at most {LARGEST_RADIUS_MM:g}"])
    radius, spread, sigma, deviation = (
        held[name].astype(float) for name in ("radius_mm", "spread_mm", "sigma_mm", "wall_dev_mm")
    )
    if np.nanmin(radius - deviation, initial=np.inf) <= 0:
        raise BadInput([f"{file}: wall_dev_mm: must be less than radius_mm, for the bore is what remains"])
    return WallMap(theta, z, radius, spread, sigma, held["count"].astype(np.int64)), deviation


def read_arrays(file: Path, names: tuple[str, ...], most_bytes: int) -> dict[str, np.ndarray]:
    """Arrays of an .npz by name; how much it unpacks to is looked at first, and nothing in it is run.

    Raises:
        BadInput: for a file that is not there, too large, none of numbers, or lacks a name.
    """
    try:
        if not S_ISREG(file.stat().st_mode):
            raise BadInput([f"{file}: is no plain file"])
        with zipfile.ZipFile(file) as parts:
            unpacked = sum(part.file_size for part in parts.infolist())
            if unpacked > most_bytes:
                raise BadInput([f"{file}: unpacks to {unpacked} bytes; at most {most_bytes}"])
            missing = [name for name in names if f"{name}.npy" not in parts.namelist()]
            if missing:
                raise BadInput([f"{file}: {', '.join(missing)} missing; {', '.join(names)} are expected"])
            return {name: _array(file, parts, name) for name in names}
    except BadInput:
        raise
    except Exception as error:  # zipfile and numpy's reader of headers raise whatever they trip over
        raise BadInput([f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}"]) from error


def _array(file: Path, parts: zipfile.ZipFile, name: str) -> np.ndarray:
    """One array, once its header promises numbers, and as many as there are."""
    part = parts.getinfo(f"{name}.npy")
    with parts.open(part) as packed:
        if np.lib.format.read_magic(packed) != (1, 0):
            raise BadInput([f"{file}: {name}: version 1.0 of numpy's format is expected"])
        shape, _, dtype = np.lib.format.read_array_header_1_0(packed)
        held = part.file_size - packed.tell()
    if dtype.kind not in "fiu":
        raise BadInput([f"{file}: {name}: got {dtype}; numbers are expected"])
    if min(shape, default=0) < 0 or prod(shape) * dtype.itemsize != held:
        raise BadInput([f"{file}: {name}: shape {shape} of {dtype} is promised, {held} bytes are held"])
    with parts.open(part) as packed:
        array: np.ndarray = np.lib.format.read_array(packed, allow_pickle=False)
        return array


def _read_tum(file: Path) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 4 4"]]:
    """Times (s) and poses (mm)."""
    rows, faults = [], []
    for line, text in _lines(file):
        if text.startswith("#") or not text.strip():
            continue
        numbers = [_number(word) for word in text.split()]
        if len(numbers) != 8 or None in numbers:
            faults.append(f"{file}:{line}: got {shown(text.strip())}; 8 finite numbers are expected")
        else:
            rows.append(numbers)
    _raise(faults)
    if not rows:
        raise BadInput([f"{file}: has no pose"])
    table = np.array(rows, dtype=float)
    lengths = np.linalg.norm(table[:, 4:], axis=1)
    if (np.abs(lengths - 1) > 0.01).any() or (np.diff(table[:, 0]) <= 0).any():
        raise BadInput([f"{file}: times must grow from row to row, and quaternions have length 1"])
    return table[:, 0], transform(rotation_from_wxyz(table[:, [7, 4, 5, 6]]), table[:, 1:4] * 1e3)


def _lines(file: Path) -> Iterator[tuple[int, str]]:
    try:
        if not S_ISREG(file.stat().st_mode):  # a pipe would be waited for
            raise BadInput([f"{file}: is no plain file"])
        if file.stat().st_size > LARGEST_TABLE_BYTES:
            raise BadInput([f"{file}: is larger than {LARGEST_TABLE_BYTES / 1e6:g} MB"])
        with file.open(encoding="utf-8", newline="") as text:
            yield from enumerate(text, start=1)
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput([f"{file}: cannot be read: {getattr(error, 'strerror', None) or 'is no UTF-8 text'}"]) from error


def _rows(file: Path, columns: tuple[str, ...], make: Callable[[dict[str, str]], Any]) -> Iterator[Any]:
    """The rows of a table that `scenarios.artefacts` wrote."""
    table = csv.reader(text for _, text in _lines(file))
    faults: list[str] = []
    try:
        head = next(table, [])
        missing = [name for name in columns if name not in head]
        if missing:
            raise BadInput([f"{file}:1: {', '.join(missing)} missing; another version of pipetwin wrote it"])
        for row in table:
            if len(row) != len(head):
                faults.append(f"{file}:{table.line_num}: got {len(row)} cells; the head has {len(head)}")
                continue
            try:
                yield make(dict(zip(head, row, strict=True)))
            except ValueError as error:
                faults.append(f"{file}:{table.line_num}: {error}")
    except csv.Error as error:
        raise BadInput([f"{file}:{table.line_num}: {error}"]) from error
    _raise(faults)


def _raise(faults: list[str]) -> None:
    if faults:
        more = [f"and {len(faults) - MOST_FAULTS} more"] if len(faults) > MOST_FAULTS else []
        raise BadInput(faults[:MOST_FAULTS] + more)


def _number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if isfinite(value) and abs(value) <= LARGEST_NUMBER else None


def _finite(row: dict[str, str], name: str) -> float:
    value = _number(row[name])
    if value is None:
        raise ValueError(f"{name}: got {shown(row[name])}; must be a finite number")
    if value < LEAST.get(name, -LARGEST_NUMBER):
        raise ValueError(f"{name}: got {shown(row[name])}; must be at least {LEAST[name]:g}")
    return value


def _defect(row: dict[str, str]) -> Defect:
    own: dict[str, Any] = {name: row[name] for name in ("feature_class", "disposition")}
    own |= {name: bool(_finite(row, name)) for name in ("cut_by_scan_end", "floor_seen")}
    own |= {"theta_rad": float(np.radians(_finite(row, "theta_deg"))), "seen_cells": int(_finite(row, "seen_cells"))}
    own |= {part.name: _finite(row, part.name) for part in fields(Defect) if part.name not in own}
    return Defect(**own)


def _episode(row: dict[str, str]) -> NotedEpisode:
    return NotedEpisode(row["kind"], row["who"], *(_finite(row, name) for name in ("start_s", "end_s", "amount")))

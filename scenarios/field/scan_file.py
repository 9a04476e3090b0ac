"""A scanned bore out of a file (PLY, or a run's wall_map.npz) as a scenario's wall."""

from __future__ import annotations

from pathlib import Path, PurePath
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Float

from scenarios.document import BadInput, shown
from scenarios.found_run import read_arrays
from sensor_model.geometry import wall_angle_rad
from twin.scanned import LONGEST_TEXT, MOST_CELLS, ScannedWall, scanned_wall

LARGEST_BYTES = 200_000_000
MOST_POINTS = 20_000_000
LONGEST_HEADER = 4_000
CELL_Z_MM, CELLS_AROUND = 1.0, 360  # of a cloud of points
LEAST_SEEN = 0.3  # of all cells
UNEVEN_SHARE = 0.01  # of a cell's size
FURTHEST_MM = 1e7
SHADOW_MM = 25.0  # a longer gap along the pipe is no shadow
LEVEL_MM = 0.5  # ends of a gap that differ by less are one surface
LEAST_ROW = 0.25  # of a row's cells: fewer say nothing of its bore
KINDS = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
KINDS |= {"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"}
KINDS |= {"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"}
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


def with_scan(data: Any, source: str) -> tuple[Any, tuple[str, str] | None]:
    """A scenario's data with its scanned wall read, if it names one by its file alone; else what is wrong with it.

    The fault is what was given, and why it will not do. The file must lie in the scenario file's folder, or below it.
    """
    given = data.get("pipe") if isinstance(data, dict) else None
    scan = given.get("scanned") if isinstance(given, dict) else None
    if not (isinstance(scan, dict) and set(scan) == {"file"} and isinstance(scan["file"], str)):
        return data, None
    name = scan["file"]
    try:
        wall = read_scan(_beside(name, Path(source).parent), name)
    except BadInput as error:
        return data, (shown(name), "; ".join(error.lines))
    return {**data, "pipe": {**data["pipe"], "scanned": wall.model_dump()}}, None


def _beside(name: str, folder: Path) -> Path:
    pure = PurePath(name)
    if pure.is_absolute() or ".." in pure.parts or "\0" in name:
        raise BadInput(["must be a relative path that stays in the scenario file's folder"])
    file, home = (folder / name).resolve(), folder.resolve()
    if not file.is_relative_to(home):
        raise BadInput([f"leads out of the scenario file's folder, to {file}"])
    return file


def read_scan(file: Path, name: str) -> ScannedWall:
    """A scan's radii as settings; unseen cells are filled as `filled` says.

    Raises:
        BadInput: with the file and the reason.
    """
    if not file.is_file():
        raise BadInput([f"{file}: no such file"])
    if file.stat().st_size > LARGEST_BYTES:
        raise BadInput([f"{file}: {file.stat().st_size} bytes; at most {LARGEST_BYTES}"])
    readers = {".npz": _read_npz, ".ply": _read_ply}
    if file.suffix not in readers:
        raise BadInput([f"{file}: ends in {shown(file.suffix)}; .npz (a run's wall_map.npz) or .ply are taken"])
    first_z, cell_z, radius = readers[file.suffix](file)
    if radius.size > MOST_CELLS or radius.shape[1] < 2:
        raise BadInput([f"{file}: {radius.shape[0]} x {radius.shape[1]} cells; at most {MOST_CELLS}, and 2 along"])
    seen = float(np.isfinite(radius).mean())
    if seen < LEAST_SEEN:
        raise BadInput([f"{file}: {100 * seen:.1f} % of its cells were seen; at least {100 * LEAST_SEEN:g} % must be"])
    try:
        return scanned_wall(name, first_z, cell_z, filled(radius, cell_z))
    except ValueError as error:
        long = f"; its cells may pack to {LONGEST_TEXT} characters" if "String should" in str(error) else ""
        raise BadInput([f"{file}: {str(error).splitlines()[-1].strip()}{long}"]) from error


def filled(radius_mm: Float[np.ndarray, "around along"], cell_z_mm: float) -> Float[np.ndarray, "around along"]:
    """Unseen cells filled with what they most likely are, for a wall must be somewhere.

    A short gap along the pipe is a shadow, which falls where the wall lies deeper: it takes its deeper end, or the mean
    of two level ends. A longer one, under the strut, takes the median of its row around the wall.
    """
    along = np.arange(radius_mm.shape[1])
    seen = np.isfinite(radius_mm)
    before = np.maximum.accumulate(np.where(seen, along, -1), axis=1)
    after = np.flip(np.minimum.accumulate(np.flip(np.where(seen, along, along.size), axis=1), axis=1), axis=1)
    both = (before >= 0) & (after < along.size) & ((after - before - 1) * cell_z_mm <= SHADOW_MM)
    lines = np.arange(radius_mm.shape[0])[:, None]
    ends = np.stack([radius_mm[lines, before.clip(min=0)], radius_mm[lines, after.clip(max=along.size - 1)]])
    level = np.abs(ends[0] - ends[1]) < LEVEL_MM
    shadow = np.where(level, ends.mean(axis=0), ends.max(axis=0))
    out = np.where(seen, radius_mm, np.where(both, shadow, np.nan))
    known = np.flatnonzero(seen.mean(axis=0) >= LEAST_ROW)
    if not known.size:
        raise BadInput([f"no row around the wall has {100 * LEAST_ROW:g} % of its cells seen"])
    bore = np.interp(along, known, [float(np.nanmedian(radius_mm[:, k])) for k in known])
    return np.where(np.isfinite(out), out, bore)


def _read_npz(file: Path) -> tuple[float, float, np.ndarray]:
    """A radius grid as a run leaves it: `theta_rad`, `z_mm` (even steps, cells' middles) and `radius_mm`."""
    held = read_arrays(file, ("theta_rad", "z_mm", "radius_mm"), LARGEST_BYTES)
    theta, z, radius = (held[name].astype(float) for name in ("theta_rad", "z_mm", "radius_mm"))
    if theta.ndim != 1 or z.ndim != 1 or radius.shape != (theta.size, z.size) or z.size < 2 or theta.size < 8:
        raise BadInput([f"{file}: radius_mm has shape {radius.shape}; theta_rad {theta.shape} and z_mm {z.shape}"])
    turn, step = 2 * np.pi / theta.size, float(np.median(np.diff(z)))
    middles = (np.arange(theta.size) + 0.5) * turn
    even = step > 0 and np.abs(np.diff(z) - step).max() <= UNEVEN_SHARE * step
    if not (even and np.abs(theta - middles).max() <= UNEVEN_SHARE * turn):
        raise BadInput([f"{file}: cells must lie evenly, from half a cell after 12 o'clock and along z"])
    radius = np.where(np.isfinite(radius) & (radius > 0), radius, np.nan)
    some = np.flatnonzero(np.isfinite(radius).any(axis=0))
    ends = slice(int(some[0]), int(some[-1]) + 1) if some.size else slice(0, z.size)
    return float(z[ends.start]), step, radius[:, ends]


def _read_ply(file: Path) -> tuple[float, float, np.ndarray]:
    """The vertices of a PLY in the pipe frame, mm: the median radius in each cell."""
    xyz = _vertices(file)
    if not len(xyz):
        raise BadInput([f"{file}: has no vertex"])
    if not (np.abs(xyz) <= FURTHEST_MM).all():
        raise BadInput([f"{file}: a vertex is no number, or lies beyond {FURTHEST_MM:g} mm"])
    first = float(np.floor(xyz[:, 2].min() / CELL_Z_MM))
    along = int(np.floor(xyz[:, 2].max() / CELL_Z_MM) - first) + 1
    if along * CELLS_AROUND > MOST_CELLS:
        most = MOST_CELLS // CELLS_AROUND * CELL_Z_MM
        raise BadInput([f"{file}: reaches over {along * CELL_Z_MM:g} mm of z; at most {most:g} mm are taken"])
    around = (wall_angle_rad(xyz[:, 0], xyz[:, 1]) / (2 * np.pi) * CELLS_AROUND).astype(int) % CELLS_AROUND
    row = (np.floor(xyz[:, 2] / CELL_Z_MM) - first).astype(int)
    radius = np.full(CELLS_AROUND * along, np.nan)
    cells, medians = _medians(around * along + row, np.hypot(xyz[:, 0], xyz[:, 1]))
    radius[cells] = medians
    return (first + 0.5) * CELL_Z_MM, CELL_Z_MM, radius.reshape(CELLS_AROUND, along)


def _medians(cell: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The cells that hold something, and the median of each."""
    order = np.lexsort((value, cell))
    cells, begin, count = np.unique(cell[order], return_index=True, return_counts=True)
    low, high = value[order][begin + (count - 1) // 2], value[order][begin + count // 2]
    return cells, (low + high) / 2


def _vertices(file: Path) -> Float[np.ndarray, "n 3"]:
    with file.open("rb") as text:
        order, count, columns = _header(file, text)
        if order:
            rows = np.fromfile(text, np.dtype([(name, order + kind) for name, kind in columns]), count)
        else:
            rows = _text_rows(file, text, count, columns)
    if len(rows) != count:
        raise BadInput([f"{file}: {count} vertices are promised, {len(rows)} held"])
    with np.errstate(invalid="ignore"):  # what is no number is refused below
        return np.column_stack([rows[axis].astype(float) for axis in "xyz"])


def _text_rows(file: Path, text: BinaryIO, count: int, columns: list[tuple[str, str]]) -> np.ndarray:
    rows = np.zeros(count, dtype=[(name, "f8") for name, _ in columns])
    for k in range(count):
        words = text.readline(LONGEST_HEADER).split()
        try:
            rows[k] = tuple(float(word) for word in words)
        except ValueError:
            raise BadInput([f"{file}: vertex {k}: got {words[:8]}; {len(columns)} numbers are expected"]) from None
    return rows


def _header(file: Path, text: BinaryIO) -> tuple[str, int, list[tuple[str, str]]]:
    """Byte order (empty: plain text), number of vertices, and their columns; vertices come first."""
    lines: list[list[str]] = []
    while not lines or lines[-1] != ["end_header"]:
        line = text.readline(LONGEST_HEADER)
        if not line.endswith(b"\n") or len(lines) > 100 or (not lines and line.strip() != b"ply"):
            raise BadInput([f"{file}: is no PLY: a header from 'ply' to 'end_header' is expected"])
        lines.append(line.decode("ascii", "replace").split())
    formats = [words[1] for words in lines if words[:1] == ["format"] and len(words) == 3]
    elements = [k for k, words in enumerate(lines) if words[:1] == ["element"]]
    if len(formats) != 1 or formats[0] not in ORDERS or not elements:
        raise BadInput([f"{file}: a format line ({', '.join(ORDERS)}) and an element are expected"])
    words = lines[elements[0]]
    if len(words) != 3 or words[1] != "vertex" or not words[2].isdecimal() or int(words[2]) > MOST_POINTS:
        raise BadInput(
            [f"{file}: got {shown(' '.join(words))}; first of all, at most {MOST_POINTS} vertices are taken"]
        )
    end = elements[1] if len(elements) > 1 else len(lines)
    given = [line for line in lines[elements[0] + 1 : end] if line[:1] == ["property"]]
    columns = [(line[2], KINDS[line[1]]) for line in given if len(line) == 3 and line[1] in KINDS]
    names = [name for name, _ in columns]
    if len(columns) != len(given) or len(set(names)) < len(names) or not {"x", "y", "z"} <= set(names):
        raise BadInput([f"{file}: a vertex has {shown(names)}; x, y and z are needed, each property once and plain"])
    return ORDERS[formats[0]], int(words[2]), columns

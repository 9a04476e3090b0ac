"""What the twin page shows of a run, small enough for one page: wall, defects, path, slip and pictures."""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from algorithms.types import Defect
from scenarios.artefacts import deepest_shown_mm
from scenarios.field.export_csv import path_table
from scenarios.field.export_tally import Interval, deepest_place, intervals, joints_mm, remarks
from scenarios.found_run import FoundRun
from scenarios.report.canvas import SERIES
from scenarios.report.comparison import LOOK_AHEAD_RADII
from scenarios.view.page import packed, shades
from sensor_model.geometry import clock_position
from sensor_model.recording import BadRecording, Recording

MOST_COLUMNS, MOST_LINES = 3000, 360  # of the wall as drawn
MOST_POSES = 1500
MOST_PICTURES, PICTURE_WIDTH_PX, JPEG_QUALITY = 150, 480, 60
MOST_PICTURE_BYTES = 3_000_000
UNITS = {"mm": "mm", "pct": "%"}
LEVELS = 255  # shades of depth; level 0 is what was not seen


@dataclass(frozen=True)
class Drawn:
    """The wall as levels of depth: 0 where nothing was seen, 1 at `low_mm` to `LEVELS` at `high_mm` and beyond."""

    level: UInt8[np.ndarray, "around along"]
    low_mm: float
    high_mm: float
    start_mm: float
    cell_mm: float


@dataclass(frozen=True)
class Shots:
    """Camera pictures as JPEGs, where the camera was, and how many could not be read."""

    z_mm: tuple[float, ...]
    jpeg: tuple[bytes, ...]
    unreadable: int


def page_data(run: FoundRun, shots: Shots, log: Recording | None) -> dict[str, Any]:
    """Everything that the page's script needs."""
    wall, path = drawn_wall(run), thinned(path_table(run), MOST_POSES)
    slip = slip_mm(run, log)
    return {
        "wall": {
            "level": packed(wall.level, "<u1"),
            "around": wall.level.shape[0],
            "along": wall.level.shape[1],
            "start": wall.start_mm,
            "cell": wall.cell_mm,
            "low": round(wall.low_mm, 3),
            "high": round(wall.high_mm, 3),
            "shades": shades(LEVELS),
        },
        "radius": round(run.bore_radius_mm, 3),
        "ahead": round(LOOK_AHEAD_RADII * run.bore_radius_mm, 1),
        "defects": [_defect(run, number, one) for number, one in enumerate(run.defects, start=1)],
        "joints": [round(z, 1) for z in joints_mm(run)],
        "path": {
            name: np.round(path[:, k], 3).tolist() for k, name in enumerate(("time", "z", "x", "y", "roll", "tilt"))
        },
        "slip": None if slip is None else np.round(thinned(slip, MOST_POSES).T, 3).tolist(),
        "episodes": [
            {"from": run.distance_at_mm(one.start_s), "to": run.distance_at_mm(one.end_s), "who": one.who}
            for one in run.episodes
            if one.kind == "slip"
        ],
        "shots": [
            {"z": round(z, 1), "jpeg": b64encode(jpeg).decode()} for z, jpeg in zip(shots.z_mm, shots.jpeg, strict=True)
        ],
        "series": list(SERIES),
    }


def _defect(run: FoundRun, number: int, one: Defect) -> dict[str, Any]:
    z, theta = deepest_place(run, one)
    deepest = f"deepest at {z:.0f} mm, {clock_position(theta)}" if np.isfinite(z) else "nothing seen within"
    sizes = [f"{name.replace('_', ' ')} {sized(size)} {UNITS[unit]}" for name, unit, size in intervals(one)]
    said = [one.disposition or "no disposition", one.feature_class or "no class", deepest, *remarks(one)]
    return {
        "name": f"Defect {number}",
        "z": round(one.distance_mm, 2),
        "theta": round(one.theta_rad, 4),
        "length": round(one.length_mm, 2),
        "width": round(one.width_mm, 2),
        "words": f"{one.distance_mm:.0f} mm, {clock_position(one.theta_rad)}: {', '.join(sizes)}; {'; '.join(said)}.",
    }


def sized(size: Interval) -> str:
    """A size with its interval, as the page writes it."""
    if size.high is None:
        return f"at least {size.low:.1f}"
    return f"{size.value:.1f} ({size.low:.1f} to {size.high:.1f})"


def thinned(rows: np.ndarray, most: int) -> np.ndarray:
    """At most so many rows, evenly, the first and the last among them."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(most, len(rows))).round().astype(int))]


def drawn_wall(run: FoundRun) -> Drawn:
    """The deviation of the scanned stretch; where cells are drawn as one, the deepest of them is."""
    seen = np.isfinite(run.deviation_mm)
    columns = np.flatnonzero(seen.any(axis=0))
    part = run.deviation_mm[:, columns[0] : columns[-1] + 1] if columns.size else run.deviation_mm[:, :1]
    along = -(-part.shape[1] // MOST_COLUMNS)
    around = next(n for n in range(1, len(part) + 1) if len(part) % n == 0 and len(part) // n <= MOST_LINES)
    pooled = _deepest_of(part, around, along)
    low = min(float(np.nanpercentile(part, 0.5)), 0.0) if columns.size else 0.0
    high = deepest_shown_mm(run.deviation_mm)
    level = 1 + np.clip((np.nan_to_num(pooled) - low) / (high - low), 0, 1) * (LEVELS - 1)
    level[~np.isfinite(pooled)] = 0
    start = run.wall.z_mm[columns[0] if columns.size else 0] - run.wall.cell_z_mm / 2
    return Drawn(level.round().astype(np.uint8), low, high, float(start), run.wall.cell_z_mm * along)


def _deepest_of(values: Float[np.ndarray, "around along"], around: int, along: int) -> np.ndarray:
    """Largest value of each block of cells, NaN of none."""
    lines, columns = len(values) // around, -(-values.shape[1] // along)
    padded = np.full((len(values), columns * along), -np.inf)
    padded[:, : values.shape[1]] = np.where(np.isfinite(values), values, -np.inf)
    deepest = padded.reshape(lines, around, columns, along).max(axis=(1, 3))
    return np.where(np.isfinite(deepest), deepest, np.nan)


def slip_mm(run: FoundRun, log: Recording | None) -> Float[np.ndarray, "n wheels"] | None:
    """How much further each encoder's rim went than the camera since the start; None without the run's log."""
    if log is None:
        return None
    turn_mm = np.pi * np.array(log.rig.wheels.diameters_mm) / log.rig.wheels.counts_per_turn
    at = [np.interp(run.time_s, log.encoder_stamps_ns / 1e9, wheel) for wheel in log.counts.T]
    rim = np.stack(at, axis=1) * turn_mm
    travel = run.T_pipe_camera[:, 2, 3]
    return (rim - rim[0]) - (travel - travel[0])[:, None]


def camera_shots(run: FoundRun, log: Recording | None) -> Shots:
    """Pictures evenly over the distance, small ones; fewer of them where they would be too many bytes."""
    if log is None or not log.frame_files or not log.frame_files[0].endswith(".png"):
        return Shots((), (), 0)
    at = np.interp(log.frame_stamps_ns / 1e9, run.time_s, run.T_pipe_camera[:, 2, 3])
    wanted = np.linspace(at.min(), at.max(), min(MOST_PICTURES, len(at)))
    frames = np.unique([int(np.argmin(np.abs(at - z))) for z in wanted])
    places, jpegs, unreadable = [], [], 0
    for index in sorted(frames, key=lambda k: at[k]):
        try:
            jpegs.append(_small(log[int(index)].picture))
            places.append(float(at[index]))
        except BadRecording:
            unreadable += 1
    while sum(map(len, jpegs)) > MOST_PICTURE_BYTES:
        places, jpegs = places[::2], jpegs[::2]
    return Shots(tuple(places), tuple(jpegs), unreadable)


def _small(picture: UInt8[np.ndarray, "height width 3"] | None) -> bytes:
    """A picture as a small JPEG."""
    from PIL import Image

    if picture is None:
        raise BadRecording("a frame of slit pixels among pictures")
    image = Image.fromarray(picture)
    image.thumbnail((PICTURE_WIDTH_PX, PICTURE_WIDTH_PX))
    file = BytesIO()
    image.save(file, format="JPEG", quality=JPEG_QUALITY, optimize=True)
    return file.getvalue()

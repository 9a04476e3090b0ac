"""Logs that hold less than a recording: pictures of the rings alone, or the IMU's own file alone."""

from __future__ import annotations

from math import isfinite
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from algorithms.calibration.pipe_view import INNER_SLITS, PipeView, axis_of, robust_residual_mm, view_pipe
from algorithms.decode import DecodeSettings
from algorithms.identification.estimate import Quantity, Unknown, of_blocks
from algorithms.identification.identify import edge_quantities
from algorithms.identification.inertial import Imu
from algorithms.identification.slits import slit_figures
from scenarios.calibration.imu import clock_s, read_text
from scenarios.document import BadInput
from sensor_model.rig import Rig

DEVICE_COLUMNS, MOST_ROWS = 15, 1_000_000
GRAVITY_LEAST_M_S2 = 5.0
DAY_S = 86_400.0


def read_device_log(file: Path) -> tuple[Imu, str]:
    """The IMU's own file (clock, ns, rates in degrees a second, m/s2, ...), and what has to be said of it.

    Raises:
        BadInput: naming file, line and value.
    """
    rows, last_s = [], -np.inf
    lines = read_text(file).splitlines()
    if len(lines) > MOST_ROWS:
        raise BadInput([f"{file}: {len(lines)} rows; at most {MOST_ROWS} are taken"])
    for number, line in enumerate(lines[1:], start=2):
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) != DEVICE_COLUMNS:
            wanted = "clock, ns, 3 rates, 3 accelerations, 3 angles and a quaternion"
            raise BadInput([f"{file}:{number}: got {len(cells)} columns; {DEVICE_COLUMNS} are expected: {wanted}"])
        try:
            stamp_s = clock_s(cells[0]) + int(cells[1]) * 1e-9
            values = [float(cell) for cell in cells[2:8]]
        except ValueError as error:
            raise BadInput([f"{file}:{number}: {error}; numbers are expected"]) from error
        if not all(map(isfinite, values)):
            raise BadInput([f"{file}:{number}: got {', '.join(cells[2:8])}; finite numbers are expected"])
        if last_s - stamp_s > DAY_S / 2:
            stamp_s += DAY_S  # midnight
        if stamp_s <= last_s:
            raise BadInput([f"{file}:{number}: stamp {cells[0]} is not after the one before; stamps must rise"])
        rows.append([stamp_s, *values])
        last_s = stamp_s
    if len(rows) < 2:
        raise BadInput([f"{file}: got {len(rows)} rows; a log has 2 or more"])
    table = np.array(rows)
    unknown = np.zeros(len(table), dtype=bool), np.ones(len(table), dtype=bool)
    imu = Imu(table[:, 0] - table[0, 0], np.radians(table[:, 1:4]), table[:, 4:7], *unknown)
    bare = float(np.median(np.linalg.norm(imu.force_m_s2, axis=1))) < GRAVITY_LEAST_M_S2
    return imu, "The device has taken gravity off its accelerations: nothing is said of their bias." if bare else ""


def views_of(pictures: list[UInt8[np.ndarray, "height width 3"]], rig: Rig) -> list[PipeView]:
    """The pictures in which a pipe is seen."""
    views = [view_pipe(picture, rig, DecodeSettings()) for picture in pictures]
    return [view for view in views if view.alignment.converged]


def view_quantities(views: list[PipeView], rig: Rig) -> dict[str, Quantity]:
    """What single pictures tell of pipe, slits and edges, a value a picture."""
    if not views:
        return {"diameter_mm": Unknown("no picture shows a pipe")}
    source = "cylinder of each picture by itself"
    places = np.array([axis_of(view.alignment) for view in views])
    columns = {
        "diameter_mm": np.array([2 * view.alignment.radius_mm for view in views]),
        "offset_x_mm": -places[:, 0],
        "offset_y_mm": -places[:, 1],
        "tilt_deg": np.degrees(np.arctan(np.hypot(places[:, 2], places[:, 3]))),
        "residual_mm": np.array([robust_residual_mm(view) for view in views]),
        "coverage_inner": np.array([view.coverage(slice(0, INNER_SLITS)) for view in views]),
        "coverage_outer": np.array([view.coverage(slice(INNER_SLITS, None)) for view in views]),
    }
    out: dict[str, Quantity] = {name: of_blocks(values, source) for name, values in columns.items()}
    figures = [slit_figures(view.points, view.alignment, rig, from_camera=True) for view in views]
    return out | edge_quantities(figures)

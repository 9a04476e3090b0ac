"""Path, defects, episodes and wall as tables in a folder, for a spreadsheet."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import numpy as np

from scenarios.found_run import FoundRun, read_found
from sensor_model.geometry import clock_position, twist_about_z_rad

PATH_COLUMNS = ("time_s", "distance_mm", "x_mm", "y_mm", "roll_deg", "tilt_deg")


def export_csv(run_folder: Path, out: Path) -> None:
    """`path.csv`, `defects.csv`, `episodes.csv` and `wall.csv` (deviation, a column a clock position, empty: unseen).

    Raises:
        BadInput: when the run cannot be read.
    """
    run = read_found(run_folder)
    out.mkdir()
    with (out / "path.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(PATH_COLUMNS)
        rows.writerows([f"{value:.6f}" for value in row] for row in path_table(run))
    with (out / "wall.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["distance_mm", *(clock_position(theta) for theta in run.wall.theta_rad)])
        for z, line in zip(run.wall.z_mm, run.deviation_mm.T, strict=True):
            rows.writerow([f"{z:g}", *("" if np.isnan(value) else f"{value:.3f}" for value in line)])
    for name in ("defects.csv", "episodes.csv"):
        if (run_folder / "reconstruction" / name).is_file():
            shutil.copyfile(run_folder / "reconstruction" / name, out / name)


def path_table(run: FoundRun) -> np.ndarray:
    """The columns of `PATH_COLUMNS`, a row a registered frame."""
    R = run.T_pipe_camera[:, :3, :3]
    roll = np.degrees(np.unwrap(twist_about_z_rad(R)))
    tilt = np.degrees(np.arccos(np.clip(R[:, 2, 2], -1, 1)))
    return np.column_stack([run.time_s, run.T_pipe_camera[:, [2, 0, 1], 3], roll, tilt])

"""The seen wall as a binary STL of its surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenarios.artefacts import mesh_faces
from scenarios.found_run import read_found
from sensor_model.geometry import wall_direction

TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")])


def export_stl(run_folder: Path, out: Path) -> None:
    """Millimetres, pipe frame; what was not seen stays open, and normals point to the axis.

    Raises:
        BadInput: when the run cannot be read.
    """
    run = read_found(run_folder)
    around, along = np.nonzero(np.isfinite(run.deviation_mm))
    places = wall_direction(run.wall.theta_rad[around]) * run.wall.radius_mm[around, along][:, None]
    places[:, 2] = run.wall.z_mm[along]
    with out.open("wb") as file:
        file.write(b"pipetwin: seen pipe wall, mm".ljust(80, b" ") + bytes(4))
        count = 0
        for faces in mesh_faces(run.deviation_mm):
            block = np.zeros(len(faces), dtype=TRIANGLE)
            corners = places[faces["corners"][:, ::-1]]
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            block["normal"] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
            block["corners"] = corners
            file.write(block.tobytes())
            count += len(faces)
        file.seek(80)
        file.write(count.to_bytes(4, "little"))

"""The seen wall as an E57 point cloud in metres (ASTM E2807)."""

from __future__ import annotations

from pathlib import Path

from scenarios.document import BadInput
from scenarios.field.wall_points import wall_points
from scenarios.found_run import read_found


def export_e57(run_folder: Path, out: Path) -> None:
    """One point a seen cell: metres, colour, and the deviation from the local bore (mm) as intensity.

    Raises:
        BadInput: when the run cannot be read, or pye57 is not there.
    """
    try:
        import pye57
    except ImportError as error:
        raise BadInput(["--to e57: needs pye57; pip install 'pipetwin[field]', or give --to ply"]) from error
    points = wall_points(read_found(run_folder))
    names = ("cartesianX", "cartesianY", "cartesianZ")
    fields = dict(zip(names, points.xyz_mm.T / 1e3, strict=True))
    fields |= {f"color{name}": column for name, column in zip(("Red", "Green", "Blue"), points.rgb.T, strict=True)}
    fields["intensity"] = points.deviation_mm
    with pye57.E57(str(out), mode="w") as file:
        file.write_scan_raw(fields, name="pipe wall, intensity is wall_dev_mm")

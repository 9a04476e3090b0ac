"""The seen wall as a LAS 1.4 point cloud in metres, for survey software."""

from __future__ import annotations

from pathlib import Path

from scenarios.document import BadInput
from scenarios.field.wall_points import wall_points
from scenarios.found_run import read_found

SCALE_M = 1e-6  # a micrometre, over two kilometres to either side


def export_las(run_folder: Path, out: Path) -> None:
    """One point a seen cell: metres, colour, and `wall_dev_mm` as an extra dimension.

    Raises:
        BadInput: when the run cannot be read, or laspy is not there.
    """
    try:
        import laspy
    except ImportError as error:
        raise BadInput(["--to las: needs laspy; pip install 'pipetwin[field]', or give --to ply"]) from error
    points = wall_points(read_found(run_folder))
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [SCALE_M] * 3, [0.0] * 3
    header.add_extra_dim(laspy.ExtraBytesParams("wall_dev_mm", "float32", "radius less the local bore, mm"))
    header.system_identifier, header.generating_software = "pipe scan", "pipetwin"
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.xyz_mm.T / 1e3
    cloud.red, cloud.green, cloud.blue = points.rgb.T.astype("uint16") * 257  # LAS has 16 bits a colour
    cloud["wall_dev_mm"] = points.deviation_mm
    with out.open("wb") as file:
        cloud.write(file, do_compress=False)

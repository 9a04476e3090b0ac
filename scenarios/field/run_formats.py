"""A run, its log or what was measured, in the formats that other tools open: one function a format, all alike."""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from scenarios.document import BadInput, nearest
from scenarios.field.export_bag import export_mcap, export_rosbag2
from scenarios.field.export_csv import export_csv
from scenarios.field.export_e57 import export_e57
from scenarios.field.export_las import export_las
from scenarios.field.export_ply import export_ply
from scenarios.field.export_stl import export_stl
from scenarios.field.export_tally import export_tally
from scenarios.field.export_tum import export_tum
from scenarios.field.export_video import export_video


class Format(NamedTuple):
    """What writes it, given the run's folder and the place to write, and what that is called in `RUN/export`."""

    write: Callable[[Path, Path], None]
    name: str


FORMATS = {
    "mcap": Format(export_mcap, "recording.mcap"),
    "rosbag2": Format(export_rosbag2, "rosbag2"),
    "video": Format(export_video, "video"),
    "tum": Format(export_tum, "trajectory.tum"),
    "ply": Format(export_ply, "wall.ply"),
    "las": Format(export_las, "wall.las"),
    "e57": Format(export_e57, "wall.e57"),
    "stl": Format(export_stl, "wall.stl"),
    "csv": Format(export_csv, "tables"),
    "tally": Format(export_tally, "tally.csv"),
}


def export_run(run_folder: Path, to: str, out: Path | None) -> Path:
    """Write one format, whole or not at all; returns where it lies.

    Raises:
        BadInput: for a format that runs have not, a run that cannot be read, or a place that cannot be written.
    """
    if to not in FORMATS:
        names = tuple(FORMATS)
        raise BadInput([f"--to: got {to or 'nothing'}; a run goes to {', '.join(names)}{nearest(to, names)}"])
    place = out or run_folder / "export" / FORMATS[to].name
    work = place.with_name(f".{place.stem}.partial-{secrets.token_hex(4)}{place.suffix}")
    try:
        if out is None:
            place.parent.mkdir(exist_ok=True)
            if place.parent.is_symlink():
                raise BadInput([f"{place.parent}: is a link to somewhere else; give a place with -o"])
        FORMATS[to].write(run_folder, work)
        if place.is_dir() and work.is_dir() and all((work / part.name).exists() for part in place.iterdir()):
            shutil.rmtree(place)  # an older export of the same kind
        work.rename(place)
    except OSError as error:
        raise BadInput([f"{place}: cannot be written: {error.strerror or error}"]) from error
    finally:
        if work.is_dir():
            shutil.rmtree(work)
        work.unlink(missing_ok=True)
    return place

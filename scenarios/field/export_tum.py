"""The camera's path as a TUM file, for evo."""

from __future__ import annotations

import shutil
from pathlib import Path

from scenarios.found_run import read_found


def export_tum(run_folder: Path, out: Path) -> None:
    """Seconds, metres and quaternions x y z w of the registered frames: the camera in the pipe frame.

    Raises:
        BadInput: when the run cannot be read.
    """
    read_found(run_folder)  # only what reads well is handed on
    shutil.copyfile(run_folder / "reconstruction" / "trajectory.tum", out)

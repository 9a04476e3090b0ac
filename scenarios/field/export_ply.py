"""The seen wall as a coloured PLY mesh with its deviation, for CloudCompare and MeshLab."""

from __future__ import annotations

from pathlib import Path

from scenarios.artefacts import write_mesh
from scenarios.found_run import read_found


def export_ply(run_folder: Path, out: Path) -> None:
    """Millimetres, pipe frame; what was not seen stays open.

    Raises:
        BadInput: when the run cannot be read.
    """
    run = read_found(run_folder)
    write_mesh(run.wall, run.deviation_mm, out)

"""What really happens when a robot goes through a pipe: the one door into this room."""

from __future__ import annotations

import numpy as np

from twin.drives import DRIVES, AnyDrive
from twin.drives.base import DriveFailed
from twin.pipe import Pipe
from twin.robot import Robot
from twin.truth import Truth

__all__ = ["DriveFailed", "simulate"]

AHEAD_RADII = 3.0  # the sensor's innermost light meets the wall about so many bore radii ahead of the camera
PROJECTOR_BEHIND_MM = 60.0


def simulate(pipe: Pipe, robot: Robot, drive: AnyDrive, rng: np.random.Generator) -> Truth:
    """Move through the pipe in the way that `drive` states.

    Raises:
        ValueError: when the drive leaves the pipe, or its sensor would look out of it.
        DriveFailed: when the robot tips, gets stuck or does not fit.
    """
    check_room(pipe, robot, drive)
    return DRIVES[drive.kind].drive(pipe, robot, drive, rng)


def check_room(pipe: Pipe, robot: Robot, drive: AnyDrive) -> None:
    """Refuse a drive for which the pipe is too short.

    Raises:
        ValueError: with both places and what is needed.
    """
    lowest, highest = drive.span_mm
    behind = robot.behind_camera_mm if drive.kind == "robot" else PROJECTOR_BEHIND_MM
    ahead = AHEAD_RADII * pipe.bore_radius_mm
    if lowest - behind < pipe.start_mm:
        raise ValueError(
            f"the drive leaves the pipe: at z = {lowest:g} mm it reaches {behind:.0f} mm behind the camera, to "
            f"{lowest - behind:.0f} mm, and the pipe starts at {pipe.start_mm:g} mm"
        )
    if highest + ahead > pipe.end_mm:
        raise ValueError(
            f"the drive leaves the pipe: at z = {highest:g} mm the sensor sees {ahead:.0f} mm ahead, to "
            f"{highest + ahead:.0f} mm, and the pipe ends at {pipe.end_mm:g} mm"
        )

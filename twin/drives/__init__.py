"""Ways to move through the pipe: one file each, one line here; each turns settings into the truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from twin.drives import gantry, recorded, robot
from twin.drives.gantry import GantryDrive
from twin.drives.recorded import RecordedDrive
from twin.drives.robot import RobotDrive
from twin.truth import Truth


class Drive(NamedTuple):
    """A way to move: its settings and its verb, `drive(pipe, robot, settings, rng)`."""

    settings: type[Any]
    drive: Callable[..., Truth]


DRIVES = {
    "robot": Drive(RobotDrive, robot.drive),
    "gantry": Drive(GantryDrive, gantry.drive),
    "recorded": Drive(RecordedDrive, recorded.drive),
}

AnyDrive = Annotated[RobotDrive | GantryDrive | RecordedDrive, Field(discriminator="kind")]

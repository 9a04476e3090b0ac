"""What an operator says of a log: rig, pipe, topics; and whose word counts where the log says it too."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from algorithms.method import Method
from scenarios.calibration.rig_file import read_rig, read_settings
from scenarios.document import BadInput
from sensor_model.recording import NominalPipe
from sensor_model.rig import Rig


class Told(NamedTuple):
    """Each is None where the log itself is to say it."""

    rig: Rig | None = None
    pipe: NominalPipe | None = None
    topics: Path | None = None


def needed(told: Told, log: Path) -> tuple[Rig, NominalPipe]:
    """Rig and pipe, once nobody else can say them.

    Raises:
        BadInput: naming what is not known.
    """
    if told.rig is None:
        raise BadInput([f"{log}: does not say by which rig it was made; give --rig rig.yaml"])
    if told.pipe is None:
        raise BadInput([f"{log}: does not say in which pipe it was made; give --pipe pipe.yaml"])
    return told.rig, told.pipe


def told_by(rig: str | None, pipe: Path | None, topics: Path | None, method: Path | None) -> tuple[Told, Method | None]:
    """What the command line says, read.

    Raises:
        BadInput: naming the file and every fault.
    """
    from scenarios.load import load_scenario

    told = Told(read_rig(rig) if rig else None, read_settings(NominalPipe, pipe) if pipe else None, topics)
    # any scenario will do to carry the method, which is then checked as `run` checks it
    return told, load_scenario("paper-robot", method=method).method if method else None

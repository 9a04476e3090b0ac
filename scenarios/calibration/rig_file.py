"""The rig that a calibration starts from, and the one it writes."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from scenarios.document import BadInput
from scenarios.run_folder import whole_file
from sensor_model.rig import Rig, load_settings, preset_rig, rigs, save_settings


def read_rig(name: str) -> Rig:
    """A rig that comes with pipetwin, or one from a YAML file.

    Raises:
        BadInput: naming the file and what is wrong.
    """
    if name in rigs():
        return preset_rig(name)
    file = Path(name)
    if not file.is_file():
        raise BadInput([f"{name}: no such rig; give one of {', '.join(rigs())}, or a rig.yaml"])
    try:
        return load_settings(Rig, file)
    except ValidationError as error:
        raise BadInput(
            [f"{name}: {'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in error.errors()]
        ) from error
    except (OSError, ValueError) as error:
        raise BadInput([f"{name}: {str(error).splitlines()[0]}; give a rig.yaml"]) from error


def write_rig(rig: Rig, out: Path) -> None:
    """Write a rig whole or not at all.

    Raises:
        BadInput: when it cannot be written.
    """
    with whole_file(out) as work:
        save_settings(rig, work)

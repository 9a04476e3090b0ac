"""The rig that a calibration or a replay starts from, and the one that a calibration writes."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from scenarios.document import BadInput
from scenarios.run_folder import whole_file
from sensor_model.rig import AnySettings, Rig, load_settings, preset_rig, rigs, save_settings


def read_rig(name: str) -> Rig:
    """A rig that comes with pipetwin, or one from a YAML file.

    Raises:
        BadInput: naming the file and what is wrong.
    """
    if name in rigs():
        return preset_rig(name)
    if not Path(name).is_file():
        raise BadInput([f"{name}: no such rig; give one of {', '.join(rigs())}, or a rig.yaml"])
    return read_settings(Rig, Path(name))


def read_settings(kind: type[AnySettings], file: Path) -> AnySettings:
    """Settings of a kind from a YAML file.

    Raises:
        BadInput: naming the file and every fault.
    """
    try:
        return load_settings(kind, file)
    except ValidationError as error:
        faults = error.errors()
        raise BadInput([f"{file}: {'.'.join(map(str, fault['loc']))}: {fault['msg']}" for fault in faults]) from error
    except (OSError, ValueError) as error:
        raise BadInput([f"{file}: {str(error).splitlines()[0]}; give a {kind.__name__.lower()}'s YAML"]) from error


def write_rig(rig: Rig, out: Path) -> None:
    """Write a rig whole or not at all.

    Raises:
        BadInput: when it cannot be written.
    """
    with whole_file(out) as work:
        save_settings(rig, work)

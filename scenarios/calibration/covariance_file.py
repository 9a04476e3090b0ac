"""What a projector's calibration leaves open, in a file beside its rig: where the next calibration starts from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field

from scenarios.calibration.rig_file import read_settings
from scenarios.document import BadInput
from scenarios.run_folder import whole_file
from sensor_model.rig import Projector, Vector3, save_settings
from sensor_model.settings import Settings

ALIKE = 1e-9
Row = Annotated[tuple[float, ...], Field(max_length=80)]


class ProjectorCovariance(Settings):
    """Covariance of apex (mm), two tilts of the axis and half angles (rad), in this order; and of which projector."""

    apex_mm: Vector3
    axis: Vector3
    half_angle_deg: Row
    covariance: Annotated[tuple[Row, ...], Field(max_length=80)]


def covariance_file(rig_file: Path) -> Path:
    """Where it lies: beside the rig."""
    return rig_file.with_name(f"{rig_file.stem}-covariance.yaml")


def write_covariance(projector: Projector, covariance: Float[np.ndarray, "n n"], rig_file: Path) -> None:
    """Write it beside a rig.

    Raises:
        BadInput: when it cannot be written.
    """
    held = ProjectorCovariance(**_stated(projector), covariance=tuple(tuple(row) for row in covariance.tolist()))
    with whole_file(covariance_file(rig_file)) as work:
        save_settings(held, work)


def read_covariance(projector: Projector, rig_file: Path) -> Float[np.ndarray, "n n"] | None:
    """The covariance that goes with a rig's projector; None where there is no such file.

    Raises:
        BadInput: for one that is no covariance, or of another projector.
    """
    file = covariance_file(rig_file)
    if not file.is_file():
        return None
    held = read_settings(ProjectorCovariance, file)
    stated = _stated(projector)
    for name, value in stated.items():
        got = np.array(getattr(held, name))
        if got.shape != np.shape(value) or np.abs(got - value).max() > ALIKE:
            raise BadInput([f"{file}: {name}: got {got.tolist()}; the rig beside it has {list(value)}"])
    unknowns = 5 + len(projector.slits)
    if len(held.covariance) != unknowns or {len(row) for row in held.covariance} != {unknowns}:
        raise BadInput([f"{file}: covariance: got {len(held.covariance)} rows; {unknowns} x {unknowns} are expected"])
    matrix = np.array(held.covariance)
    if np.abs(matrix - matrix.T).max() > ALIKE or np.linalg.eigvalsh(matrix).min() <= 0:
        raise BadInput([f"{file}: covariance: is not symmetric with positive variances"])
    return matrix


def _stated(projector: Projector) -> dict[str, tuple[float, ...]]:
    angles = tuple(slit.half_angle_deg for slit in projector.slits)
    return {"apex_mm": projector.apex_mm, "axis": projector.axis, "half_angle_deg": angles}

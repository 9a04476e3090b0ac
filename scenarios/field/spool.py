"""A reference spool as its certificate has it, and how far rig and sizes may drift."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from scenarios.document import BadInput, read_file
from scenarios.faults import checked, fault_lines
from sensor_model.settings import ClockDeg, Settings

Length = Annotated[float, Field(gt=0, le=10_000)]
Open = Annotated[float, Field(ge=0, le=100, description="Expanded uncertainty (95 %) of the certified size.")]
Limit = Annotated[float, Field(ge=0, le=100, description="Drift that is let pass, beyond what is open of the sizes.")]
Degrees = Annotated[float, Field(ge=-90, le=90)]


class CertifiedDefect(Settings):
    """One defect of the spool; distances count from the spool's own datum, sizes as `docs/sizing.md` defines them."""

    name: Annotated[str, Field(min_length=1, max_length=64)]
    distance_mm: float
    clock_deg: ClockDeg
    length_mm: Length
    width_mm: Length
    depth_mm: Length
    length_u95_mm: Open
    width_u95_mm: Open
    depth_u95_mm: Open


class Drift(Settings):
    """What is let pass: of the rig in the bore's diameter, roundness, scatter and axis, and of each defect's sizes."""

    diameter_mm: Limit = 0.15
    roundness_mm: Limit = 0.03
    residual_ratio: Annotated[
        float, Field(gt=0, le=100, description="Scatter of the wall's points, over what they state, at most.")
    ] = 1.05
    axis_deg: Limit = 0.3
    length_mm: Limit = 1.0
    width_mm: Limit = 0.5
    depth_mm: Limit = 0.1


class Spool(Settings):
    """A spool with known defects.

    `axis_deg` is the pipe's axis in the camera's x and y as accepted; without it the axis is shown and not judged.
    """

    name: Annotated[str, Field(min_length=1, max_length=64)]
    inner_radius_mm: Annotated[float, Field(gt=5, le=2000)]
    inner_radius_u95_mm: Open
    wall_thickness_mm: Length
    defects: tuple[CertifiedDefect, ...] = Field(min_length=1, max_length=1000)
    axis_deg: tuple[Degrees, Degrees] | None = None
    drift: Drift = Drift()

    @model_validator(mode="after")
    def _defects_fit(self) -> Spool:
        names = [one.name for one in self.defects]
        if len(set(names)) < len(names):
            raise ValueError("every defect needs a name of its own")
        for one in self.defects:
            if one.depth_mm > self.wall_thickness_mm:
                raise ValueError(f"{one.name} is deeper than the wall, {self.wall_thickness_mm:g} mm")
        return self


def read_spool(file: Path) -> Spool:
    """Read a spool's YAML.

    Raises:
        BadInput: with a line for every fault: file, line, column, field, value and what is allowed.
    """
    document = read_file(file, kind="spool")
    spool, faults = checked(Spool, document.data)
    if spool is None or document.faults:
        raise BadInput(fault_lines(document, faults))
    return spool

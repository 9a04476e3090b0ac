"""A scenario: everything that defines one run, frozen; the same scenario and seed give the same bytes."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, TypeAdapter, model_validator

from algorithms.method import Method
from scenarios.bench.calibrated import BoardSession, calibrate
from sensor_model.glass import Glass
from sensor_model.recording import NominalPipe
from sensor_model.rig import Rig, preset_rig
from sensor_model.sense import Sensing
from sensor_model.settings import Settings
from twin.drives import AnyDrive
from twin.pipe import Pipe
from twin.robot import SIZES, Robot

PRESET = "endoscope"


def _on_preset(value: Any) -> Any:
    """A rig by its name, or by what differs from the preset."""
    if isinstance(value, str):
        return preset_rig(value)
    return _merged(preset_rig(PRESET).model_dump(), value) if isinstance(value, dict) else value


AnyRig = Annotated[Rig, BeforeValidator(_on_preset, json_schema_input_type=str | dict[str, Any])]
_RIG: TypeAdapter[Rig] = TypeAdapter(AnyRig)


def _of_size(value: Any) -> Any:
    """A robot by the size it is built for, or by what differs from the 6 inch one."""
    if isinstance(value, str):
        if value not in SIZES:
            raise ValueError(f"no robot is called {value!r}; there are {', '.join(SIZES)}")
        return SIZES[value]
    return value


AnyRobot = Annotated[Robot, BeforeValidator(_of_size, json_schema_input_type=str | dict[str, Any])]


class Scenario(Settings):
    """Pipe, robot, drive, rig, sensing, method, seed.

    `robot` is the size it is built for (4-inch, 6-inch, 8-inch), or what differs from the 6 inch one.
    `rig` is the nominal one, which goes with the recording and which the measurement believes: a name, or what differs
    from the preset. `true_rig` states only what really is different (a calibration error); the rest is as in `rig`.
    With `calibration` the measurement believes neither: its projector is what a session of boards before the true rig
    gives, another one with another seed.
    `nominal_pipe` is what the operator writes down of the pipe; left out, it is the pipe without its features and
    ovality, launched where the drive starts.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
    why: Annotated[str, Field(max_length=400)]
    pipe: Pipe
    robot: AnyRobot = Robot()
    drive: AnyDrive
    nominal_pipe: NominalPipe | None = None
    rig: AnyRig = preset_rig(PRESET)
    true_rig: Rig | None = None
    calibration: BoardSession | None = None
    sensing: Sensing = Sensing()
    method: Method = Method()
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0

    @model_validator(mode="before")
    @classmethod
    def _true_rig_over_rig(cls, data: Any) -> Any:
        if not (isinstance(data, dict) and isinstance(data.get("true_rig"), dict)):
            return data
        base = _RIG.validate_python(data.get("rig", PRESET)).model_dump()
        return {**data, "true_rig": _merged(base, data["true_rig"])}


def nominal_rig(scenario: Scenario) -> Rig:
    """The rig that goes with the recording: as stated, or as calibrated on boards in closed loop.

    Raises:
        ConesNotFound: when the session's pictures do not determine the projector.
    """
    if scenario.calibration is None:
        return scenario.rig
    glass = scenario.sensing.optics.glass
    return _calibrated(scenario.true_rig or scenario.rig, scenario.seed, scenario.calibration, glass)


@lru_cache(maxsize=8)
def _calibrated(true_rig: Rig, seed: int, session: BoardSession, glass: Glass) -> Rig:
    return calibrate(true_rig, seed, session, glass).rig


def nominal_pipe(scenario: Scenario) -> NominalPipe:
    """What the measurement is told of the pipe."""
    if scenario.nominal_pipe is not None:
        return scenario.nominal_pipe
    pipe = scenario.pipe
    return NominalPipe(
        inner_radius_mm=pipe.bore_radius_mm, wall_thickness_mm=pipe.wall_mm, launch_mm=scenario.drive.start_mm
    )


def _merged(base: dict, changes: dict) -> dict:
    both = dict(base)
    for key, value in changes.items():
        nested = isinstance(value, dict) and isinstance(both.get(key), dict)
        both[key] = _merged(both[key], value) if nested else value
    return both

"""The settings of every stage of the measurement in one frozen object: what tuning exports and the robot loads."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator

from algorithms.decode import DecodeSettings
from algorithms.localisation.odometry import OdometrySettings
from algorithms.registration import AnyRegistration, CylinderMapSettings
from algorithms.sizing.measure import SizingSettings
from algorithms.wall_map import MapSettings
from sensor_model.settings import Settings


def _of_default_kind(value: Any) -> Any:
    """Settings without a kind are those of the default method."""
    kind = CylinderMapSettings.model_fields["kind"].default
    return {"kind": kind, **value} if isinstance(value, dict) else value


class Method(Settings):
    """One way to measure."""

    decode: DecodeSettings = DecodeSettings()
    localisation: OdometrySettings = OdometrySettings()
    registration: Annotated[AnyRegistration, BeforeValidator(_of_default_kind)] = CylinderMapSettings()
    map: MapSettings = MapSettings()
    sizing: SizingSettings = SizingSettings()

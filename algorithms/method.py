"""The settings of every stage of the measurement in one frozen object: what tuning exports and the robot loads."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator

from algorithms.decode import DecodeSettings
from algorithms.localisation import AnyEstimator, PaperSettings
from algorithms.registration import AnyRegistration, CylinderMapSettings
from algorithms.sizing.measure import SizingSettings
from algorithms.wall_map import MapSettings
from sensor_model.settings import Settings


def _of_kind(default: type[Settings]) -> BeforeValidator:
    """Settings without a kind are those of the default one."""
    kind = default.model_fields["kind"].default
    return BeforeValidator(lambda value: {"kind": kind, **value} if isinstance(value, dict) else value)


class Method(Settings):
    """One way to measure."""

    decode: DecodeSettings = DecodeSettings()
    localisation: Annotated[AnyEstimator, _of_kind(PaperSettings)] = PaperSettings()
    registration: Annotated[AnyRegistration, _of_kind(CylinderMapSettings)] = CylinderMapSettings()
    map: MapSettings = MapSettings()
    sizing: SizingSettings = SizingSettings()
